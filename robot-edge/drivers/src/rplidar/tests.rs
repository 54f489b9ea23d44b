use proptest::prelude::*;

use super::*;
use crate::test_decoding::*;

const SCAN: [u8; 7] = [0xA5, 0x5A, 5, 0, 0, 0x40, 0x81];

fn node_bytes(starts: bool, angle_q6: u16, distance_q2: u16) -> Vec<u8> {
    let angle = (angle_q6 << 1 | 1).to_le_bytes();
    [
        &[if starts { 0x3D } else { 0x3E }],
        &angle[..],
        &distance_q2.to_le_bytes(),
    ]
    .concat()
}

/// Three turns of 360 samples; the flag comes at 358°.
fn turns() -> Vec<u8> {
    let nodes = (0..1080).flat_map(|at: u16| node_bytes(at % 360 == 358, at % 360 * 64, 4000));
    SCAN.into_iter().chain(nodes).collect()
}

/// What a real A1M8 replied, as the assertions of a public Rust program have it.
#[test]
fn dialogue_of_a_real_device() {
    let bytes = [
        &[0xA5, 0x5A, 3, 0, 0, 0, 6, 0, 0, 0][..],
        &[
            0xA5, 0x5A, 0x14, 0, 0, 0, 4, 0x18, 0x1D, 1, 7, 0xD9, 0x8A, 0x99, 0xF6, 0xC9, 0xE5,
        ],
        &[0x9A, 0xD2, 0xC5, 0xE5, 0x9C, 0xF7, 0x25, 0x58, 0x34, 0x12],
        &[0xA5, 0x5A, 8, 0, 0, 0, 0x20, 0x71, 0, 0, 0, 0, 0x7F, 0, 0],
        &[0xA5, 0x5A, 8, 0, 0, 0, 0x20, 0x74, 0, 0, 0, 0, 0x0C, 0, 0],
        &[0xA5, 0x5A, 5, 0, 0, 0, 0x20, 0x75, 0, 0, 0, 0x84],
        &[0xA5, 0x5A, 0x10, 0, 0, 0, 0x20, 0x7F, 0, 0, 0],
        b"Sensitivity\0",
        &[0xA5, 0x5A, 0x84, 0, 0, 0x40, 0x84],
    ]
    .concat();
    let serial = [
        0xD9, 0x8A, 0x99, 0xF6, 0xC9, 0xE5, 0x9A, 0xD2, 0xC5, 0xE5, 0x9C, 0xF7, 0x25, 0x58, 0x34,
        0x12,
    ];
    let expected = vec![
        Message::Health {
            status: 0,
            error_code: 0,
        },
        Message::Info {
            model: 0x18,
            firmware: [1, 29],
            hardware: 7,
            serial,
        },
        Message::Config(Config::SampleDurationS(127e-6)),
        Message::Config(Config::RangeMaxM(12.0)),
        Message::Config(Config::AnswerType(0x84)),
        Message::Config(Config::Name("Sensitivity".into())),
        Message::ScanBegins,
    ];
    for length in [1, 4, usize::MAX] {
        assert_eq!(
            decode_in(RplidarDecoder::default(), &bytes, &[length]),
            (expected.clone(), Dropped::default())
        );
    }
    assert_eq!(
        request_config(ConfigKey::SampleDuration, 3),
        [0xA5, 0x84, 6, 0x71, 0, 0, 0, 3, 0, 0x55]
    );
    assert_eq!(start_express_scan(3), [0xA5, 0x82, 5, 3, 0, 0, 0, 0, 0x21]);
    assert_eq!(set_motor_pwm(660), [0xA5, 0xF0, 2, 0x94, 2, 0xC1]);
}

#[test]
fn nodes_become_sweeps() {
    // 90°, 1000 mm, decoded by hand.
    let expected = Node {
        angle_q6: 90 * 64,
        distance_q2: 4000,
    };
    assert_eq!(node(&[0x3D, 0x01, 0x2D, 0xA0, 0x0F]), Some(expected));
    for bad in [
        [0x3F, 1, 0x2D, 0, 0],
        [0x3C, 1, 0x2D, 0, 0],
        [0x3D, 0, 0x2D, 0, 0],
        [0x3D, 1, 0xFF, 0, 0],
    ] {
        assert_eq!(node(&bad), None);
    }
    let (messages, dropped) = decode_in(RplidarDecoder::default(), &turns(), &[7]);
    assert_eq!(dropped, Dropped::default());
    let [
        Message::ScanBegins,
        Message::Sweep(first),
        Message::Sweep(_),
    ] = &messages[..]
    else {
        panic!("{}", messages.len())
    };
    assert_eq!(
        (first.nodes.len(), first.nodes[0].angle_q6),
        (360, 358 * 64)
    );
    let scan = first.to_scan(500e-6, 0.15, 12.0).unwrap();
    assert_eq!(scan.ranges_m, [1.0; 360]);
    // Clockwise 358° is 2° to the left; the next beam is further right.
    assert!((scan.angle_min_rad - 2_f32.to_radians()).abs() < 1e-6);
    assert!((scan.angle_increment_rad + 1_f32.to_radians()).abs() < 1e-6);
    assert!(scan.sweep_duration().is_some());
}

#[test]
fn a_lost_byte_costs_two_samples_and_a_descriptor_inside_is_found() {
    let mut bytes = turns();
    bytes.remove(1002);
    let (messages, dropped) = decode_in(RplidarDecoder::default(), &bytes, &[64]);
    assert_eq!(messages.len(), 3);
    assert_eq!(dropped.count(DropReason::Field), 1);
    let cut = [&turns()[..100], &[0xA5, 0x5A, 3, 0, 0, 0, 6, 0, 0, 0]].concat();
    let (messages, _) = decode_in(RplidarDecoder::default(), &cut, &[3]);
    assert_eq!(
        messages[1..],
        [Message::Health {
            status: 0,
            error_code: 0
        }]
    );
}

/// Values of a public Rust program's test of the SDK's scale.
#[test]
fn a_turn_without_end_is_dropped() {
    let mut decoder = RplidarDecoder::default();
    decoder.push(&SCAN);
    for _ in 0..3 {
        decoder.push(&node_bytes(false, 90 * 64, 4000).repeat(MAX_NODES));
        while decoder.next_message().is_some() {}
        assert!(decoder.nodes.len() <= MAX_NODES);
    }
    assert_eq!(decoder.dropped().count(DropReason::Length), 2);
}

#[test]
fn ultra_distances_are_scaled() {
    for (bits, expected) in [(1000, 1488), (2000, 5760), (1500, 2928), (0, 0)] {
        assert_eq!(scaled(bits).0, expected);
    }
}

fn capsule(answer: Answer, start_q6: u16, fill: &[u8]) -> Vec<u8> {
    let (kind, length, _) = answer.layout();
    assert_ne!(kind, 0x81);
    let content = fill.iter().copied().cycle().take(length - 4);
    let mut bytes: Vec<u8> = start_q6.to_le_bytes().into_iter().chain(content).collect();
    let sum = xor_of(&bytes);
    bytes.splice(0..0, [0xA0 | sum & 0xF, 0x50 | sum >> 4]);
    bytes
}

#[test]
fn capsules_become_sweeps() {
    for (answer, samples) in [
        (Answer::Express, 32),
        (Answer::Ultra, 96),
        (Answer::Dense, 40),
    ] {
        let (kind, length, _) = answer.layout();
        let mut bytes = vec![0xA5, 0x5A, length as u8, 0, 0, 0x40, kind];
        for at in 0..50_u16 {
            bytes.extend(capsule(answer, at * 20 % 360 * 64, &[0]));
        }
        let (messages, dropped) = decode_in(RplidarDecoder::default(), &bytes, &[100]);
        assert_eq!(dropped, Dropped::default());
        let sweeps = messages.iter().filter(|message| match message {
            Message::Sweep(sweep) => {
                assert_eq!(sweep.nodes.len(), 18 * samples);
                true
            }
            _ => false,
        });
        assert_eq!(sweeps.count(), 1, "{answer:?}");
        // A wrong sum: neither that capsule nor the angles round it are believed.
        bytes[7 + 10 * length + 50] ^= 1;
        let (_, dropped) = decode_in(RplidarDecoder::default(), &bytes, &[100]);
        assert_eq!(dropped.count(DropReason::Checksum), 1);
        assert_eq!(dropped.count(DropReason::CutOff), 1);
    }
}

/// The SDK's arithmetic: sums that `tests/python/decode_rplidar.py` prints.
#[test]
fn capsules_are_decoded_as_by_the_vendor() {
    let filling = |seed: u32, length: usize| {
        let next = |seed: &u32| Some(seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let bytes = std::iter::successors(next(&seed), next).map(|seed| (seed >> 24) as u8);
        let head = [0; 4].into_iter();
        head.chain(bytes.take(length - 4)).collect::<Vec<u8>>()
    };
    for (answer, expected) in [
        (Answer::Express, 0x0329_40F3),
        (Answer::Ultra, 0x0DFC_99A8),
        (Answer::Dense, 0x64EC_A449),
    ] {
        let length = answer.layout().1;
        let mut content = Vec::new();
        for seed in 0..100_u16 {
            let start_q6 = (u32::from(seed) * 229 % u32::from(TURN_Q6)) as u16;
            let (previous, next) = (
                filling(seed.into(), length),
                filling(u32::from(seed) + 1, length),
            );
            for node in nodes_of(answer, &previous, &next, start_q6, 1000 + seed) {
                content.extend(node.angle_q6.to_le_bytes());
                content.extend(node.distance_q2.to_le_bytes());
            }
        }
        assert_eq!(crc_of(&content), expected, "{answer:?}");
    }
}

proptest! {
    #[test]
    fn damage_neither_panics_nor_depends_on_the_reads(
        kind in 0..4_usize,
        fill in proptest::collection::vec(any::<u8>(), 1..50),
        damage in damage(b"\xA5\x5A"),
    ) {
        let bytes = match [Answer::Express, Answer::Ultra, Answer::Dense].get(kind) {
            None => turns(),
            Some(answer) => {
                let (data, length, _) = answer.layout();
                let begin = vec![0xA5, 0x5A, length as u8, 0, 0, 0x40, data];
                let capsules = (0..60).flat_map(|at: u16| capsule(*answer, at * 20 % 360 * 64, &fill));
                begin.into_iter().chain(capsules).collect()
            }
        };
        for message in damage.decode(RplidarDecoder::default, bytes) {
            let Message::Sweep(sweep) = message else { continue };
            prop_assert!(sweep.nodes.iter().all(|node| node.angle_q6 < TURN_Q6));
            let scan = sweep.to_scan(250e-6, 0.15, 12.0).unwrap();
            prop_assert!(scan.sweep_duration().is_some());
            let is_range = |range_m: &f32| range_m.is_nan() || *range_m >= 0.15;
            prop_assert!(scan.ranges_m.iter().all(is_range));
        }
    }
}
