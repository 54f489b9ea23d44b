use std::fmt::Write as _;
use std::fs;

use proptest::prelude::*;

use super::*;
use crate::shared_data::shared_data;
use crate::test_decoding::*;

const ECHO_SOUNDER: Model = Model::EchoSounder852;
const SCANNING: Model = Model::Scanning881A;

/// A reply of the 852 with head 0x11.
fn reply(max_range_m: u8, range_cm: u16, echo: &[u8]) -> Vec<u8> {
    let kind = match echo.len() {
        0 => b'P',
        252 => b'M',
        _ => b'G',
    };
    let packed = [range_cm, echo.len() as u16].map(|value| [value & 0x7F, value >> 7]);
    let packed = packed.concat().into_iter().map(|byte| byte as u8);
    let mut bytes = vec![b'I', kind, b'X', 0x11, 0x41, 0, 0, max_range_m];
    bytes.extend(packed);
    bytes.extend_from_slice(echo);
    bytes.push(TERMINATOR);
    bytes
}

/// 10 m scale, 3.04 m, no echo points.
const PROFILE: [u8; 13] = [
    b'I', b'P', b'X', 0x11, 0x41, 0, 0, 10, 0x30, 0x02, 0, 0, TERMINATOR,
];

#[test]
fn fields_of_a_reply() {
    let shot = decode_one(ImagenexDecoder::new(ECHO_SOUNDER), &PROFILE);
    let expected = Shot {
        head_id: 0x11,
        switches_accepted: true,
        character_overrun: false,
        head_angle_rad: None,
        max_range_m: 10.0,
        range_m: 3.04,
        echo: Vec::new(),
    };
    assert_eq!(shot, expected);
    let mut overrun = PROFILE;
    overrun[4] = 0x81;
    let shot = decode_one(ImagenexDecoder::new(ECHO_SOUNDER), &overrun);
    assert_eq!(
        (shot.switches_accepted, shot.character_overrun),
        (false, true)
    );
}

/// The file has 100 bytes before each shot, with a distorted copy of the header in them, and zeros
/// after it.
#[test]
fn all_shots_of_a_recording() {
    let Some(folder) = shared_data("imagenex") else {
        return;
    };
    let file = fs::read(folder.join("hydroball.852")).unwrap();
    let (shots, dropped) = decode(ImagenexDecoder::new(ECHO_SOUNDER), &file);
    assert_eq!(shots.len(), 177);
    assert_eq!(dropped.count(DropReason::Length), 177);
    assert_eq!(dropped.count(DropReason::Garbage), 177 * (640 - 513 - 1));
    assert_eq!(dropped.iter().count(), 2);
    for length in [1, 7, 640] {
        let in_parts = decode_in(ImagenexDecoder::new(ECHO_SOUNDER), &file, &[length]);
        assert_eq!(in_parts, (shots.clone(), dropped.clone()));
    }
    let bottom = |shot: &&Shot| (7.0..10.0).contains(&shot.range_m);
    assert_eq!(shots.iter().filter(bottom).count(), 176);
    assert!((shots[0].range_m - 4.48).abs() < 1e-9);
    assert!(
        shots
            .iter()
            .all(|shot| (shot.max_range_m - 50.0).abs() < 1e-9 && shot.echo.len() == 500)
    );
}

/// Every value as `tests/python/decode_imagenex.py` has it.
#[test]
fn a_second_decoder_agrees() {
    let Some(folder) = shared_data("imagenex") else {
        return;
    };
    let path = folder.join("hydroball.852");
    let Some(expected) = second_decoder("decode_imagenex.py", &path) else {
        return;
    };
    let mut text = String::new();
    for shot in decode(ImagenexDecoder::new(ECHO_SOUNDER), &fs::read(path).unwrap()).0 {
        assert!(shot.switches_accepted && !shot.character_overrun);
        let range_cm = shot.range_m * 100.0;
        // The status has two more bits that are not decoded: echo sounder, external trigger.
        write!(text, "{} {} ", shot.head_id, 0x45).unwrap();
        write!(text, "{} {range_cm:.0} ", shot.max_range_m).unwrap();
        for strength in shot.echo {
            write!(text, "{strength:02x}").unwrap();
        }
        text.push('\n');
    }
    assert_eq!(text, expected);
}

#[test]
fn ranges_of_the_echo_sounder() {
    for (range_cm, expected_m) in [
        (0, f64::INFINITY),
        (14, f64::NAN),
        (15, 0.15),
        (1270, 12.7),
        (5000, 50.0),
    ] {
        let shot = decode_one(
            ImagenexDecoder::new(ECHO_SOUNDER),
            &reply(50, range_cm, &[7; 252]),
        );
        // Text: NaN is not equal to itself.
        assert_eq!(format!("{:.3}", shot.range_m), format!("{expected_m:.3}"));
        assert_eq!(shot.echo, [7; 252]);
    }
    let shot = decode_one(ImagenexDecoder::new(ECHO_SOUNDER), &reply(50, 3000, &[]));
    assert_eq!(shot.range_at_m(1450.0), Some(29.0));
    for no_water in [343.0, 5000.0, -1500.0, f64::NAN, f64::INFINITY] {
        assert_eq!(shot.range_at_m(no_water), None);
    }
}

/// Both scales, and the head's position: 0.3·(599 − 600)°, with a step to the other side ahead.
#[test]
fn ranges_and_angles_of_the_scanning_sonar() {
    for (max_range_m, range, expected_m) in [(4, 1000_u16, 2.0), (5, 500, 5.0), (100, 1000, 10.0)] {
        let mut bytes = reply(max_range_m, range, &[]);
        bytes[3] = 0x10;
        bytes[5..7].copy_from_slice(&[0x57, 0x44]);
        let shot = decode_one(ImagenexDecoder::new(SCANNING), &bytes);
        assert!((shot.range_m - expected_m).abs() < 1e-9, "{shot:?}");
        let angle_deg = shot.head_angle_rad.unwrap().to_degrees();
        assert!((angle_deg - -0.3).abs() < 1e-9, "{angle_deg}");
    }
}

#[test]
fn switch_commands() {
    let settings = Settings {
        head_id: 0x11,
        max_range_m: 50,
        min_range_m: 0.3,
        start_gain_db: 20,
        absorption_cdb_per_m: 20,
        pulse_length_us: 150,
        echo: EchoPoints::Points500,
    };
    let command = [
        0xFE, 0x44, 0x11, 50, 0, 0, 0x43, 0, 20, 0, 20, 0, 0, 0, 150, 3, 0, 0, 0, 50, 0, 0, 0, 0,
        0, 0, 0xFD,
    ];
    assert_eq!(request_shot_852(&settings), Some(command));
    let points_and_profile = |echo| {
        let command = request_shot_852(&Settings { echo, ..settings }).unwrap();
        [command[19], command[22]]
    };
    assert_eq!(points_and_profile(EchoPoints::None), [0, 1]);
    assert_eq!(points_and_profile(EchoPoints::Points252), [25, 0]);
    let change = |change: fn(&mut Settings)| {
        let mut settings = settings;
        change(&mut settings);
        request_shot_852(&settings)
    };
    for refused in [
        change(|settings| settings.head_id = 0x10),
        change(|settings| settings.max_range_m = 15),
        change(|settings| settings.min_range_m = 25.1),
        change(|settings| settings.min_range_m = -0.1),
        change(|settings| settings.min_range_m = f64::NAN),
        change(|settings| settings.start_gain_db = 41),
        change(|settings| settings.pulse_length_us = 0),
        change(|settings| settings.pulse_length_us = 253),
        change(|settings| settings.absorption_cdb_per_m = 253),
    ] {
        assert_eq!(refused, None);
    }
}

#[test]
fn bad_replies_are_dropped_and_the_next_is_found() {
    let changed = |at: usize, byte| {
        let mut bytes = PROFILE;
        bytes[at] = byte;
        bytes.to_vec()
    };
    let whole = reply(50, 900, &[9; 500]);
    for (bad, reason, count) in [
        (b"III IM IMI".to_vec(), DropReason::Garbage, 10),
        (changed(2, b'Y'), DropReason::Garbage, 13),
        (changed(3, 0x10), DropReason::UnknownKind, 1),
        (changed(10, 1), DropReason::Length, 1),
        (changed(11, 0x80), DropReason::Length, 1),
        (changed(1, b'M'), DropReason::Length, 1),
        // Not a range of the device, a range beyond it, the highest bit set.
        (changed(7, 11), DropReason::Field, 1),
        (changed(9, 8), DropReason::Field, 1),
        (changed(8, 0xB0), DropReason::Field, 1),
        (changed(12, 0), DropReason::CutOff, 1),
        // Cut off in the mark, in the header and in the echo; bytes lost from the echo.
        (PROFILE[..2].to_vec(), DropReason::Garbage, 2),
        (PROFILE[..9].to_vec(), DropReason::Length, 1),
        (whole[..11].to_vec(), DropReason::Length, 1),
        (whole[..12].to_vec(), DropReason::CutOff, 1),
        (whole[..300].to_vec(), DropReason::CutOff, 1),
        (
            [&whole[..100], &whole[103..]].concat(),
            DropReason::CutOff,
            1,
        ),
    ] {
        let bytes = [&bad[..], &PROFILE].concat();
        for length in [1, 5, usize::MAX] {
            let (shots, dropped) = decode_in(ImagenexDecoder::new(ECHO_SOUNDER), &bytes, &[length]);
            assert_eq!(shots.len(), 1, "{bad:?}");
            assert_eq!(dropped.count(reason), count, "{bad:?} {dropped:?}");
        }
    }
    let mut scanning = PROFILE;
    scanning[3] = 0x10;
    // 1201 steps, the highest bit, no range.
    for change in [[0x31, 0x09, 10], [0x80, 0, 10], [0, 0x80, 10], [0, 0, 0]] {
        [scanning[5], scanning[6], scanning[7]] = change;
        let (shots, dropped) = decode(ImagenexDecoder::new(SCANNING), &scanning);
        assert_eq!((shots.len(), dropped.count(DropReason::Field)), (0, 1));
    }
}

fn any_reply() -> impl Strategy<Value = Vec<u8>> {
    let echo = prop_oneof![Just(0_usize), Just(252), Just(500)]
        .prop_flat_map(|points| prop::collection::vec(any::<u8>(), points));
    let max_range_m = prop::sample::select(vec![5_u8, 10, 20, 30, 40, 50]);
    let ranges = max_range_m.prop_flat_map(|scale| (Just(scale), 0..=u16::from(scale) * 100));
    (ranges, echo).prop_map(|((scale, range_cm), echo)| reply(scale, range_cm, &echo))
}

proptest! {
    #[test]
    fn any_split_gives_the_same_shots(
        replies in prop::collection::vec(any_reply(), 1..6),
        lengths in read_lengths(),
    ) {
        let (shots, dropped) = decode_in(ImagenexDecoder::new(ECHO_SOUNDER), &replies.concat(), &lengths);
        prop_assert_eq!(shots.len(), replies.len());
        prop_assert_eq!(dropped, Dropped::default());
        for (shot, reply) in shots.iter().zip(&replies) {
            prop_assert_eq!(&shot.echo, &reply[12..reply.len() - 1]);
        }
    }

    #[test]
    fn damage_neither_panics_nor_gives_senseless_shots(
        model in prop::sample::select(vec![ECHO_SOUNDER, SCANNING]),
        replies in prop::collection::vec(any_reply(), 1..6),
        damage in damage(b"IMGPX\x10\x11\x0a\x00\xfc\xff"),
    ) {
        for shot in damage.decode(|| ImagenexDecoder::new(model), replies.concat()) {
            let is_range = shot.range_m.is_nan()
                || shot.range_m == f64::INFINITY
                || (MIN_RANGE_M..=shot.max_range_m).contains(&shot.range_m);
            prop_assert!(is_range, "{shot:?}");
            prop_assert!(matches!(shot.echo.len(), 0 | 252 | 500));
            let angle_rad = shot.head_angle_rad.unwrap_or_default();
            prop_assert!(angle_rad.abs() <= std::f64::consts::PI + 1e-9);
        }
    }
}
