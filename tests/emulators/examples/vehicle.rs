//! A vehicle without hardware: emulated devices until Ctrl-C, and the configuration that reads them.
//!
//! `cargo run -p emulators --example vehicle > vehicle.toml`, and in another terminal
//! `robot-edge check vehicle.toml --connect` and `robot-edge run --vehicle vehicle.toml`.

#![allow(clippy::print_stdout, reason = "an example")]

use emulators::Emulator;
use emulators::ldlrs::LdLrs;
use emulators::lms111::Lms111;
use emulators::mti::Mti;
use emulators::nmea::Nmea;

fn main() -> ! {
    let front = Emulator::on_tcp(Lms111::default());
    let mast = Emulator::on_tcp(LdLrs::default());
    let imu = Emulator::on_serial(Mti::default());
    let receiver = Emulator::on_serial(Nmea::default());
    println!("preset = \"generic2d\"\n\n[localization]\nsource = \"static\"");
    println!("\n[sensors.laser]\ntopic = \"/front\"");
    println!(
        "\n[devices.front]\nkind = \"sick_cola\"\ntcp = \"{}\"",
        front.address
    );
    println!(
        "\n[devices.mast]\nkind = \"sick_ldlrs\"\ntcp = \"{}\"",
        mast.address
    );
    println!(
        "\n[devices.imu]\nkind = \"xsens\"\nserial = \"{}\"",
        imu.address
    );
    println!(
        "\n[devices.receiver]\nkind = \"nmea\"\nserial = \"{}\"",
        receiver.address
    );
    loop {
        std::thread::park();
    }
}
