//! Devices and their codecs in step, without a clock or a socket, on lines that damage bytes.

#![cfg(test)]
#![cfg(target_os = "linux")]

use std::time::Duration;

use drivers::Decoder;
use drivers::config::DeviceConfig;
use drivers::device::{Device, Event, Step};
use drivers::dynamixel::Dynamixel;
use drivers::hokuyo::Hokuyo;
use drivers::imagenex::Imagenex852;
use drivers::imagenex_deltat::ImagenexDeltat;
use drivers::nmea::Nmea;
use drivers::ntrip::Ntrip;
use drivers::packet_lidar::PacketLidar;
use drivers::ping::Ping1d;
use drivers::roboteq_encoders::{RoboteqEncoders, WheelEncoder};
use drivers::rplidar::Rplidar;
use drivers::sick_cola::SickCola;
use drivers::sick_ldlrs::SickLdlrs;
use drivers::ublox::Ublox;
use drivers::xsens::Xsens;
use emulators::packets::Packets;
use measurement::MeasurementData;

use crate::recorded::{os0, vlp16};

#[path = "supervised/recorded.rs"]
mod recorded;
#[path = "../../../robot-edge/recording/src/shared_data.rs"]
mod shared_data;
#[path = "../../tests/all/skip.rs"]
mod skip;

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

/// Samples of 10 s, each checked; as the supervisor does it, without its time-outs. `sent` gets what the
/// emulator sent.
fn run<D: Device, E: emulators::Device>(
    device: &mut D,
    mut emulator: E,
    odds: u64,
    sent: &mut Vec<Vec<u8>>,
) -> usize {
    const TICK: Duration = Duration::from_millis(5);
    let mut random = Random(0x1234_5678_9ABC_DEF0);
    let mut decoder = device.connect();
    let mut before = sent.len();
    sent.push(emulator.power_on());
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
        sent.push(emulator.receive(&damage(&to_device, odds, &mut random), uptime));
        sent.extend(emulator.run(uptime));
        sent.retain(|bytes| !bytes.is_empty());
        for bytes in &sent[before..] {
            decoder.push(&damage(bytes, odds, &mut random));
        }
        before = sent.len();
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
                // Both ends belong to it (REP-117; of a DeltaT the manual has one at the end).
                let is_range = (scan.range_min_m..=scan.range_max_m).contains(range);
                // An LD-LRS says 0 where it has none.
                let is_none = range.is_nan() || [0.0, f32::INFINITY].contains(range);
                assert!(is_range || is_none, "{range}");
            }
        }
        MeasurementData::Imu(imu) => {
            let vectors = [imu.angular_velocity_radps, imu.linear_acceleration_mps2];
            assert!(vectors.as_flattened().iter().all(|part| part.is_finite()));
        }
        MeasurementData::Fix(fix) => {
            assert!(fix.latitude_deg.abs() <= 90.0 && fix.longitude_deg.abs() <= 180.0);
        }
        MeasurementData::Joints(joints) => {
            assert!(joints.iter().all(|(_, angle_rad)| angle_rad.is_finite()));
        }
        MeasurementData::Cloud(cloud) => {
            for point in &cloud.points {
                assert!(point.position_m.iter().all(|metres| metres.is_finite()));
                assert!((0.0..=1.0).contains(&point.after_s), "{point:?}");
            }
        }
        other => panic!("{other:?}"),
    }
}

/// What the device sends, whole or in pieces, in order or not, damaged much, little or not, to a codec and a session
/// in any state.
fn fuzz<D: Device>(name: &str, device: &mut D, sent: &[Vec<u8>]) {
    if std::env::var("FUZZ_ONLY").is_ok_and(|only| only != name) {
        return;
    }
    let inputs = std::env::var("FUZZ_INPUTS").map_or(10_000_000, |text| text.parse().unwrap());
    let mut random = Random(0x0FED_CBA9_8765_4321);
    let mut decoder = device.connect();
    let mut events = Vec::new();
    let (mut messages, mut next) = (0_u64, 0);
    for input in 0..inputs {
        if input % 4096 == 0 {
            decoder = device.connect();
        }
        next += 1;
        if next >= sent.len() || random.one_in(8) {
            next = random.next() as usize % sent.len();
        }
        let mut piece = sent[next].as_slice();
        if random.one_in(4) {
            let from = random.next() as usize % piece.len();
            piece = &piece[from..piece.len().min(from + 1 + random.next() as usize % 50)];
        }
        let odds = [10, 300, u64::MAX][random.next() as usize % 3];
        decoder.push(&damage(piece, odds, &mut random));
        while let Some(message) = decoder.next_message() {
            let awaited = random.one_in(2).then(|| random.next() as usize % 12);
            device.take(message, awaited, &mut events);
            for event in events.drain(..) {
                if let Event::Sample(sample) = event {
                    check(&sample.data);
                }
            }
            messages += 1;
        }
    }
    println!("{name}: {inputs} inputs, {messages} messages");
}

fn fuzz_with<D: Device, E: emulators::Device>(name: &str, mut device: D, emulator: E) {
    let mut sent = Vec::new();
    run(&mut device, emulator, u64::MAX, &mut sent);
    fuzz(name, &mut device, &sent);
}

#[test]
#[ignore = "takes minutes; `FUZZ_INPUTS` for each codec, ten million if not set; `FUZZ_ONLY` names one"]
fn no_input_panics_a_codec() {
    let config = |text: &str| toml::from_str::<DeviceConfig>(text).unwrap();
    let any = DeviceConfig::default();
    fuzz_with(
        "hokuyo",
        Hokuyo::default(),
        emulators::hokuyo::Hokuyo::default(),
    );
    fuzz_with(
        "rplidar",
        Rplidar::new(&any),
        emulators::rplidar::Rplidar::default(),
    );
    fuzz_with("xsens", Xsens::new(&any), emulators::mti::Mti::default());
    fuzz_with("nmea", Nmea::new(&any), emulators::nmea::Nmea::default());
    fuzz_with(
        "ublox",
        Ublox::new(&any),
        emulators::ublox::Ublox::default(),
    );
    fuzz_with(
        "ping1d",
        Ping1d::new(&any),
        emulators::ping1d::Ping1d::default(),
    );
    let sounder = Imagenex852::new(&any).unwrap();
    fuzz_with(
        "imagenex852",
        sounder,
        emulators::imagenex852::Imagenex852::default(),
    );
    fuzz_with(
        "imagenex_deltat",
        ImagenexDeltat::default(),
        emulators::deltat::Deltat::default(),
    );
    let servo = config("kind = 'dynamixel'\nservo = 'x_series'\nservo_id = 1\njoint = 'tilt'");
    let servo = Dynamixel::new(&servo).unwrap();
    fuzz_with("dynamixel", servo, emulators::dynamixel::XSeries::default());
    let caster = Ntrip::new(&config("kind = 'ntrip'\ntcp = 'a:1'\nmountpoint = 'M'")).unwrap();
    fuzz_with("ntrip", caster, emulators::ntrip::Caster::new("M"));
    let encoder = WheelEncoder::new(100.0, 0).unwrap();
    let mut wheels = RoboteqEncoders::new([("left", encoder), ("right", encoder)]);
    let lines = [
        "OK", "?Q0", "0012FB64", "?Q1", "FFFFFF38", "?Z", "05", "FB", "+", "-", "W", "!A7F",
    ];
    let lines = lines.map(|line| format!("{line}\r").into_bytes());
    fuzz("roboteq_encoders", &mut wheels, &lines);
    for (name, lidar, emulator) in recorded_lidars() {
        fuzz_with(name, lidar, emulator);
    }
    let mid360 = lidar("kind = 'livox'\nudp_listen = '0.0.0.0:56301'");
    fuzz_with("livox", mid360, emulators::livox::Points::default());
    // Longest: hundreds of beams each.
    for coding in ["a", "b"] {
        let config = config(&format!("kind = 'sick_cola'\ncoding = '{coding}'"));
        let device = SickCola::new(&config);
        fuzz_with(
            &format!("sick_cola {coding}"),
            device,
            emulators::lms111::Lms111::default(),
        );
    }
    fuzz_with(
        "sick_ldlrs",
        SickLdlrs::new(&any),
        emulators::ldlrs::LdLrs::default(),
    );
}

fn lidar(config: &str) -> PacketLidar {
    PacketLidar::new(&toml::from_str(config).unwrap()).unwrap()
}

/// Names, codecs and emulators.
fn recorded_lidars() -> Vec<(&'static str, PacketLidar, Packets)> {
    let vlp16 = vlp16().map(|packets| ("velodyne", lidar("kind = 'velodyne'"), packets));
    let os0 = os0().map(|(packets, metadata)| {
        let config = format!("kind = 'ouster'\nmetadata = '{}'", metadata.display());
        ("ouster", lidar(&config), packets)
    });
    vlp16.into_iter().chain(os0).collect()
}

/// Without damage nearly all comes; with one bad byte of 10,000 enough; with one of 30, nothing wrong.
fn survives<D: Device, E: emulators::Device + Default>(
    new: impl Fn(&DeviceConfig) -> D,
    least: [usize; 2],
) {
    let config = DeviceConfig::default();
    // Nodes of an RPLIDAR have no sum: a false angle makes two sweeps of one.
    let has_sums = !std::any::type_name::<E>().ends_with("Rplidar");
    let run = |odds| run(&mut new(&config), E::default(), odds, &mut Vec::new());
    survives_damage(run, has_sums, least);
}

fn survives_damage(mut run: impl FnMut(u64) -> usize, has_sums: bool, least: [usize; 2]) {
    let whole = run(u64::MAX);
    assert!(whole >= least[0], "{whole}");
    let most = if has_sums { whole } else { 4 * whole };
    let some = run(10_000);
    assert!((least[1]..=most).contains(&some), "{some} of {whole}");
    for odds in [300, 30] {
        let few = run(odds);
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
fn lidars() {
    let mid360 = || lidar("kind = 'livox'\nudp_listen = '0.0.0.0:56301'");
    survives::<_, emulators::livox::Points>(|_| mid360(), [90, 60]);
    for (name, mut lidar, packets) in recorded_lidars() {
        println!("{name}");
        let run = |odds| run(&mut lidar, packets.clone(), odds, &mut Vec::new());
        survives_damage(run, false, [90, 60]);
    }
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
