//! Packets that are lost or damaged, and any bytes.

use proptest::prelude::*;
use serde_json::json;

use super::*;
use crate::livox::tests::{millimetres, packet};
use crate::{ouster, velodyne};

fn livox_packets(count: u16) -> Vec<Vec<u8>> {
    let points = [[1000, 0, 0], [0, -2000, 500]].map(|position| millimetres(position, 0));
    let packets = (0..count).map(|number| packet(u64::from(number) * 480_000, number, 1, &points));
    packets.collect()
}

#[test]
fn a_packet_is_lost_or_refused_and_not_both() {
    let mut sensors = vec![(Sensor::Livox(Box::default()), livox_packets(20), 40)];
    if let Some(packets) = velodyne::tests::recorded() {
        // The mark of its first block.
        sensors.push((Sensor::Velodyne(Box::default()), packets, 0));
    }
    if let Some((ouster, mut packets)) = ouster::tests::datagrams("os0-32_fw2.2") {
        packets.retain(|bytes| bytes.len() == ouster.packet_bytes());
        // Its first column has no such number.
        sensors.push((Sensor::Ouster(Box::new(ouster)), packets, 41));
    }
    for (sensor, packets, place) in sensors {
        for (missing, damaged, stray, lost, refused) in [
            (&[][..], &[][..], false, 0, 0),
            (&[5, 6, 9], &[], false, 3, 0),
            (&[], &[5, 6, 9], false, 0, 3),
            (&[5], &[6], false, 1, 1),
            (&[6], &[5], false, 1, 1),
            // Another sensor's packet is none of those that are missing.
            (&[5], &[], true, 1, 1),
            (&[], &[], true, 0, 1),
        ] {
            let mut decoder = LidarDecoder::new(sensor.clone());
            for (at, bytes) in packets[..20].iter().enumerate() {
                if stray && at == 6 {
                    decoder.push(RobotTime::default(), &[0; 10]).unwrap_err();
                }
                if missing.contains(&at) {
                    continue;
                }
                let mut bytes = bytes.clone();
                if damaged.contains(&at) {
                    bytes[place] = !bytes[place];
                }
                let is_refused = decoder.push(RobotTime::default(), &bytes).is_err();
                assert_eq!(is_refused, damaged.contains(&at), "{sensor:?} {at}");
            }
            let decoded = 20 - (missing.len() + damaged.len()) as u64;
            let expected = PacketCounts {
                decoded,
                refused,
                lost,
            };
            assert_eq!(
                decoder.counts(),
                expected,
                "without {missing:?}, damaged {damaged:?}"
            );
        }
    }
}

#[test]
fn a_revolution_ends_without_a_mark() {
    let sink = |times_s: &[f64]| {
        let mut assembly = Assembly::default();
        let point = CloudPoint {
            position_m: [1.0, 0.0, 0.0],
            after_s: 0.0,
            intensity: 0.0,
            ring: None,
        };
        for time_s in times_s {
            assembly.point(*time_s, point);
        }
        assembly.end_current();
        let complete = assembly.complete.iter();
        complete.map(|it| it.cloud.points.len()).collect::<Vec<_>>()
    };
    assert_eq!(sink(&[3.0, 3.5, 3.999]), [3]);
    // The motor is at rest; the clock is set ahead, and back.
    assert_eq!(sink(&[3.0, 3.5, 4.0, 4.5, 5.0]), [2, 2, 1]);
    assert_eq!(sink(&[3.0, 3.5, 1e9, 1e9 + 0.1]), [2, 2]);
    assert_eq!(sink(&[3.0, 3.5, 0.1, 0.2]), [2, 2]);
    assert_eq!(sink(&vec![3.0; MAX_POINTS + 5]), [MAX_POINTS, 5]);
}

/// Sensors of all kinds, with packets of each, which need no file.
fn all() -> Vec<(&'static str, Sensor, Vec<Vec<u8>>)> {
    let mut all = Vec::new();
    for (name, model, mode) in [
        ("VLP-16", 0x22, 0x37),
        ("VLP-16, two returns", 0x22, 0x39),
        ("VLP-32C", 0x28, 0x38),
    ] {
        let packet = |at: u16| {
            let mut packet = Vec::new();
            for block in 0..12 {
                let azimuth = (u32::from(at) * 500 + block * 40) % 36_000;
                packet.extend([0xFF, 0xEE]);
                packet.extend((azimuth as u16).to_le_bytes());
                (0..32).for_each(|range: u8| packet.extend([range, 4, 100]));
            }
            packet.extend((u32::from(at) * 1327).to_le_bytes());
            packet.extend([mode, model]);
            packet
        };
        let sensor = Sensor::Velodyne(Box::default());
        all.push((name, sensor, (0..100).map(packet).collect()));
    }
    for (profile, is_legacy, pixel) in [
        ("LEGACY", true, 12),
        ("RNG19_RFL8_SIG16_NIR16", false, 12),
        ("RNG19_RFL8_SIG16_NIR16_DUAL", false, 16),
        ("RNG15_RFL8_NIR8", false, 4),
    ] {
        let metadata = json!({
            "udp_profile_lidar": profile,
            "columns_per_frame": 64,
            "columns_per_packet": 4,
            "pixels_per_column": 4,
            "column_window": [48, 15],
            "beam_altitude_angles": [30, 10, -10, -30],
            "beam_azimuth_angles": [-3, -1, 1, 3],
            "lidar_origin_to_beam_origin_mm": 27.67,
            "lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1],
        });
        let packet = |at: u16| {
            let mut packet = vec![0; if is_legacy { 0 } else { 32 }];
            if !is_legacy {
                packet[2] = (at / 16) as u8;
            }
            for column in 0..4 {
                packet.extend((u64::from(at) * 6_000_000).to_le_bytes());
                packet.extend((at % 16 * 4 + column).to_le_bytes());
                packet.extend(if is_legacy { at / 16 } else { 1 }.to_le_bytes());
                packet.extend(vec![0; if is_legacy { 4 } else { 0 }]);
                packet.extend([200, 10, 0].into_iter().cycle().take(4 * pixel));
                packet.extend(vec![0xFF; if is_legacy { 4 } else { 0 }]);
            }
            packet.extend(vec![0; if is_legacy { 0 } else { 32 }]);
            packet
        };
        let ouster = ouster::Ouster::new(&metadata.to_string()).unwrap();
        let sensor = Sensor::Ouster(Box::new(ouster));
        all.push((profile, sensor, (0..100).map(packet).collect()));
    }
    for data_type in 1..=3_u8 {
        let size = [14, 8, 10][usize::from(data_type) - 1];
        let packet = |number: u16| {
            let points: Vec<Vec<u8>> = (0..96).map(|at| vec![at; size]).collect();
            packet(u64::from(number) * 480_000, number, data_type, &points)
        };
        all.push((
            "Mid-360",
            Sensor::Livox(Box::default()),
            (0..300).map(packet).collect(),
        ));
    }
    all
}

#[test]
fn the_packets_of_this_test_are_decoded() {
    for (name, sensor, packets) in all() {
        let mut decoder = LidarDecoder::new(sensor);
        let mut clouds = 0;
        for bytes in &packets {
            clouds += decoder.push(RobotTime::default(), bytes).unwrap().len();
        }
        assert!(clouds >= 1, "{name}: {clouds}");
        assert_eq!(decoder.counts().decoded, packets.len() as u64, "{name}");
    }
}

fn check(revolutions: &[Revolution]) {
    for Revolution { cloud, .. } in revolutions {
        assert!(cloud.points.len() <= MAX_POINTS);
        for point in &cloud.points {
            assert!(point.position_m.iter().all(|metres| metres.is_finite()));
            assert!((0.0..=1.0).contains(&point.after_s), "{point:?}");
        }
    }
}

proptest! {
    /// Any bytes, of a length that is right or not, in any state.
    #[test]
    fn any_bytes_are_survived(
        which in any::<prop::sample::Index>(),
        changes in prop::collection::vec(
            (any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<u8>()), 0..30),
        cut in prop_oneof![Just(0_usize), 0..1300_usize],
    ) {
        let all = all();
        let (_, sensor, packets) = &all[which.index(all.len())];
        let mut decoder = LidarDecoder::new(sensor.clone());
        for (packet, at, byte) in changes {
            let mut bytes = packet.get(packets).clone();
            *at.get_mut(&mut bytes) = byte;
            bytes.truncate(bytes.len().saturating_sub(cut));
            check(&decoder.push(RobotTime::default(), &bytes).unwrap_or_default());
            ouster::imu(&bytes);
        }
        check(&decoder.finish().into_iter().collect::<Vec<_>>());
    }
}

/// A xorshift generator: the same inputs in each run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }
}

/// Packets of a sensor, in order or not, with bytes changed, cut off or made up.
fn fuzz(name: &str, sensor: &Sensor, packets: &[Vec<u8>], inputs: u64) {
    let mut random = Random(0x0FED_CBA9_8765_4321);
    let mut decoder = LidarDecoder::new(sensor.clone());
    let (mut next, mut clouds, mut decoded) = (0, 0, 0);
    let mut bytes = Vec::new();
    for input in 0..inputs {
        if input % 4096 == 0 {
            decoded += decoder.counts().decoded;
            decoder = LidarDecoder::new(sensor.clone());
        }
        next = match random.below(8) {
            0 => random.below(packets.len()),
            _ => (next + 1) % packets.len(),
        };
        bytes.clone_from(&packets[next]);
        for _ in 0..[0, 1, 4, 40][random.below(4)] {
            let at = random.below(bytes.len());
            bytes[at] = match random.below(4) {
                0 => bytes[at] ^ (1 << random.below(8)),
                1 => 0xFF,
                2 => 0,
                _ => random.below(256) as u8,
            };
        }
        match random.below(32) {
            0 => bytes.truncate(random.below(bytes.len())),
            1 => bytes.push(0),
            2 => bytes.fill_with(|| random.below(256) as u8),
            _ => {}
        }
        if bytes.len() > 28 && matches!(sensor, Sensor::Livox(_)) && random.below(2) == 0 {
            // So that what is behind the checksum is reached.
            bytes[24..28].fill(0);
        }
        let revolutions = decoder
            .push(RobotTime::default(), &bytes)
            .unwrap_or_default();
        check(&revolutions);
        clouds += revolutions.len();
    }
    decoded += decoder.counts().decoded;
    println!("{name}: {inputs} inputs, {decoded} decoded, {clouds} clouds");
}

/// `FUZZ_INPUTS` for each vendor, ten million if not set, divided between its models, profiles and kinds of data.
fn fuzz_all(is_its: impl Fn(&Sensor) -> bool) {
    let inputs = std::env::var("FUZZ_INPUTS").map_or(10_000_000, |text| text.parse().unwrap());
    let its: Vec<_> = all()
        .into_iter()
        .filter(|(_, sensor, _)| is_its(sensor))
        .collect();
    for (name, sensor, packets) in &its {
        fuzz(name, sensor, packets, inputs / its.len() as u64 + 1);
    }
}

#[test]
#[ignore = "takes minutes"]
fn no_packet_of_velodyne_panics_in_release() {
    fuzz_all(|sensor| matches!(sensor, Sensor::Velodyne(_)));
}

#[test]
#[ignore = "takes minutes"]
fn no_packet_of_ouster_panics_in_release() {
    fuzz_all(|sensor| matches!(sensor, Sensor::Ouster(_)));
}

#[test]
#[ignore = "takes minutes"]
fn no_packet_of_livox_panics_in_release() {
    fuzz_all(|sensor| matches!(sensor, Sensor::Livox(_)));
}

#[test]
#[ignore = "takes seconds"]
fn no_packet_of_gyroscopes_panics_in_release() {
    let inputs = std::env::var("FUZZ_INPUTS").map_or(10_000_000, |text| text.parse().unwrap());
    let mut random = Random(0x0FED_CBA9_8765_4321);
    let (mut bytes, mut decoded) = ([0_u8; 49], 0_u64);
    for _ in 0..inputs {
        let at = random.below(bytes.len());
        bytes[at] = random.below(256) as u8;
        let length = [48, 48, 48, random.below(50)][random.below(4)];
        let sample = ouster::imu(&bytes[..length]);
        if let Some((_, sample)) = sample {
            assert!(
                sample
                    .linear_acceleration_mps2
                    .iter()
                    .all(|part| part.is_finite())
            );
            decoded += 1;
        }
    }
    println!("{inputs} inputs, {decoded} decoded");
}
