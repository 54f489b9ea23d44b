//! Devices and their codecs in step, without a clock or a socket, on lines that damage bytes.

#![cfg(test)]
#![cfg(target_os = "linux")]

use std::time::Duration;

use drivers::Decoder;
use drivers::config::DeviceConfig;
use drivers::device::{Device, Event, Step};
use drivers::hokuyo::Hokuyo;
use drivers::imagenex::Imagenex852;
use drivers::nmea::Nmea;
use drivers::ping::Ping1d;
use drivers::rplidar::Rplidar;
use drivers::sick_cola::SickCola;
use drivers::sick_ldlrs::SickLdlrs;
use drivers::ublox::Ublox;
use drivers::xsens::Xsens;
use measurement::MeasurementData;

/// A xorshift generator: the same damage in each run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn one_in(&mut self, odds: u64) -> bool {
        self.next().is_multiple_of(odds)
    }
}

/// Bytes are flipped, lost, doubled or made up, one in `odds`.
fn damage(bytes: &[u8], odds: u64, random: &mut Random) -> Vec<u8> {
    let mut damaged = Vec::with_capacity(bytes.len());
    for byte in bytes {
        if !random.one_in(odds) {
            damaged.push(*byte);
            continue;
        }
        match random.next() % 4 {
            0 => damaged.push(byte ^ (1 << (random.next() % 8))),
            1 => {}
            2 => damaged.extend([*byte, *byte]),
            _ => damaged.extend([random.next() as u8, *byte]),
        }
    }
    damaged
}

/// Samples of 10 s, each checked; as the supervisor does it, without its time-outs.
fn run<D: Device, E: emulators::Device>(mut device: D, mut emulator: E, odds: u64) -> usize {
    const TICK: Duration = Duration::from_millis(5);
    let mut random = Random(0x1234_5678_9ABC_DEF0);
    let mut decoder = device.connect();
    let mut line = emulator.power_on();
    emulator.connect();
    let (mut step, mut is_asked, mut asked_at, mut samples) = (0, false, 0, 0);
    for tick in 0..2000_u32 {
        let uptime = tick * TICK;
        let mut to_device = Vec::new();
        if !is_asked || tick - asked_at > 100 {
            is_asked = true;
            asked_at = tick;
            loop {
                match device.step(step) {
                    Step::Ask(request) => to_device.extend(request.bytes),
                    Step::Tell(bytes) => {
                        to_device.extend(bytes);
                        step += 1;
                        continue;
                    }
                    Step::Skip => {
                        step += 1;
                        continue;
                    }
                    Step::Done => {}
                }
                break;
            }
        }
        let is_done = device.step(step) == Step::Done;
        if is_done && device.poll_period().is_some() && tick % 20 == 0 {
            to_device.extend(device.poll());
        }
        line.extend(emulator.receive(&damage(&to_device, odds, &mut random), uptime));
        line.extend(emulator.run(uptime).concat());
        decoder.push(&damage(&std::mem::take(&mut line), odds, &mut random));
        while let Some(message) = decoder.next_message() {
            let awaited = (is_asked && device.step(step) != Step::Done).then_some(step);
            let mut events = Vec::new();
            device.take(message, awaited, &mut events);
            for event in events {
                match event {
                    Event::Accepted if awaited == Some(step) => {
                        step += 1;
                        is_asked = false;
                    }
                    Event::Refused(_) | Event::Restarted => {
                        decoder = device.connect();
                        emulator.connect();
                        step = 0;
                        is_asked = false;
                    }
                    Event::Sample(sample) => {
                        check(&sample.data);
                        assert!(sample.age < Duration::from_secs(2), "{:?}", sample.age);
                        samples += 1;
                    }
                    _ => {}
                }
            }
        }
    }
    samples
}

fn check(data: &MeasurementData) {
    match data {
        MeasurementData::Scan { scan, .. } => {
            assert!(scan.sweep_duration().is_some(), "{scan:?}");
            for range in &scan.ranges_m {
                let is_range = (scan.range_min_m..scan.range_max_m).contains(range);
                assert!(
                    is_range || range.is_nan() || *range == f32::INFINITY,
                    "{range}"
                );
            }
        }
        MeasurementData::Imu(imu) => {
            let vectors = [imu.angular_velocity_radps, imu.linear_acceleration_mps2];
            assert!(vectors.as_flattened().iter().all(|part| part.is_finite()));
        }
        MeasurementData::Fix(fix) => {
            assert!(fix.latitude_deg.abs() <= 90.0 && fix.longitude_deg.abs() <= 180.0);
        }
        other => panic!("{other:?}"),
    }
}

/// Without damage nearly all comes; with one bad byte of 10,000 enough; with one of 30, nothing wrong.
fn survives<D: Device, E: emulators::Device + Default>(
    new: impl Fn(&DeviceConfig) -> D,
    least: [usize; 2],
) {
    let config = DeviceConfig::default();
    let whole = run(new(&config), E::default(), u64::MAX);
    assert!(whole >= least[0], "{whole}");
    let some = run(new(&config), E::default(), 10_000);
    assert!((least[1]..=whole).contains(&some), "{some} of {whole}");
    // Nodes of an RPLIDAR have no sum: a false angle makes two sweeps of one.
    let has_sums = !std::any::type_name::<E>().ends_with("Rplidar");
    let most = if has_sums { whole } else { 4 * whole };
    for odds in [300, 30] {
        let few = run(new(&config), E::default(), odds);
        assert!(few <= most, "{few} of {whole}");
    }
}

#[test]
fn lasers() {
    survives::<_, emulators::lms111::Lms111>(SickCola::new, [450, 300]);
    survives::<_, emulators::ldlrs::LdLrs>(SickLdlrs::new, [40, 20]);
    survives::<_, emulators::hokuyo::Hokuyo>(|_| Hokuyo::default(), [350, 200]);
    survives::<_, emulators::rplidar::Rplidar>(Rplidar::new, [40, 20]);
}

#[test]
fn others() {
    survives::<_, emulators::mti::Mti>(Xsens::new, [800, 500]);
    survives::<_, emulators::nmea::Nmea>(Nmea::new, [90, 60]);
    survives::<_, emulators::ublox::Ublox>(Ublox::new, [40, 20]);
    survives::<_, emulators::ping1d::Ping1d>(Ping1d::new, [80, 50]);
    survives::<_, emulators::imagenex852::Imagenex852>(
        |config| Imagenex852::new(config).unwrap(),
        [80, 50],
    );
}
