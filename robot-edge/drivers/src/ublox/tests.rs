use proptest::prelude::*;

use super::*;
use crate::test_decoding::*;

/// What a NEO-M8P sent: `osgar/drivers/test_gps.py` of robotika/osgar at b215c69.
const PVT: &str = "b56201075c0000260818e207041a0f3b1df7e9030000f51ae60b0343ea0e4060910894fae01dd2f10400\
    ad4404002700000031000000eeffffff04000000e2ffffff12000000d56592012000000053cc2c00a20000001219263b\
    00000000000000005703";
const RELATIVE_POSITION_0: &str = "b562013c28000000000000260818d90a00004eebffff5dffffff56d0d000f6000000\
    29010000ea0100000f0000002fc6";
/// Version 1, made by Python's struct from the table of the manual: 1234.56 m + 1.2 mm north, −23.45 m −
/// 3.4 mm, 6.78 m + 5.6 mm, heading 91.12345°, accuracies 12, 15, 30 mm and 0.5°, fixed, station 7.
const RELATIVE_POSITION_1: &str = "b562013c400001000700e803000040e20100d7f6ffffa602000056e20100190b8b00\
    000000000cde380078000000960000002c0100008c00000050c300000000000017010000020c";
const ACK: &str = "b5620501020006010f38";

fn decode_ubx(text: &str) -> Message {
    decode_one(UbloxDecoder::default(), &hex(text))
}

fn pvt_of(bytes: &[u8]) -> Pvt {
    match decode_one(UbloxDecoder::default(), bytes) {
        Message::Pvt(pvt) => *pvt,
        other => panic!("{other:?}"),
    }
}

fn relative_position_of(bytes: &[u8]) -> RelativePosition {
    match decode_one(UbloxDecoder::default(), bytes) {
        Message::RelativePosition(position) => position,
        other => panic!("{other:?}"),
    }
}

/// These bytes of the payload changed, with a right checksum.
fn changed(text: &str, changes: &[(usize, u8)]) -> Vec<u8> {
    let mut payload = hex(text)[HEADER..].to_vec();
    payload.truncate(payload.len() - 2);
    for (at, byte) in changes {
        payload[*at] = *byte;
    }
    let bytes = hex(text);
    frame([bytes[2], bytes[3]], &payload)
}

#[track_caller]
fn close<const N: usize>(values: [f64; N], expected: [f64; N]) {
    let is_close = |(value, expected): (&f64, &f64)| (value - expected).abs() < 1e-9;
    assert!(values.iter().zip(&expected).all(is_close), "{values:?}");
}

#[test]
fn a_solution_of_a_real_receiver() {
    let pvt = pvt_of(&hex(PVT));
    let utc = Utc {
        year: 2018,
        month: 4,
        day: 26,
        hour: 15,
        minute: 59,
        second: 29,
        nanosecond: 199_629_557,
        valid: 0xF7,
    };
    assert_eq!((pvt.time_of_week_ms, pvt.utc), (403_187_200, utc));
    assert_eq!((pvt.utc_accuracy_ns, pvt.fix_type), (1001, 3));
    assert!(pvt.is_valid && pvt.is_differential);
    assert_eq!((pvt.carrier, pvt.satellites), (CarrierSolution::Float, 14));
    let position = pvt.position;
    close(
        [position.latitude_deg, position.longitude_deg],
        [50.128_347_6, 14.374_508_8],
    );
    let heights_m = [
        position.height_above_ellipsoid_m,
        position.height_above_sea_m,
    ];
    close(heights_m, [324.05, 279.725]);
    let accuracies_m = [position.horizontal_accuracy_m, position.vertical_accuracy_m];
    close(accuracies_m, [0.039, 0.049]);
    let velocity = pvt.velocity;
    close(velocity.ned_mps, [-0.018, 0.004, -0.03]);
    close(
        [velocity.ground_speed_mps, velocity.speed_accuracy_mps],
        [0.018, 0.032],
    );
    close(
        [
            velocity.heading_of_motion_rad,
            velocity.heading_accuracy_rad,
        ],
        [263.71541, 29.35891].map(f64::to_radians),
    );
    assert_eq!(velocity.heading_of_vehicle_rad, None);
    close([pvt.position_dilution], [1.62]);
    let fix = pvt.fix();
    close([fix.latitude_deg, fix.altitude_m], [50.128_347_6, 324.05]);
    assert_eq!(fix.status, 2);
}

#[test]
fn the_status_of_a_fix() {
    // Bytes 20, 21, 78: kind of fix, flags, invalid position.
    for (fix_type, flags, invalid, status) in [
        (0, 0x00, 0, -1),
        (3, 0x00, 0, -1),
        (1, 0x01, 0, -1),
        (5, 0x01, 0, -1),
        (3, 0x01, 1, -1),
        (2, 0x01, 0, 0),
        (3, 0x01, 0, 0),
        (4, 0x03, 0, 1),
        (3, 0x43, 0, 2),
        (3, 0x83, 0, 2),
    ] {
        let pvt = pvt_of(&changed(PVT, &[(20, fix_type), (21, flags), (78, invalid)]));
        assert_eq!(pvt.fix().status, status, "{fix_type} {flags:x} {invalid}");
    }
    let pvt = pvt_of(&changed(
        PVT,
        &[(21, 0x23), (84, 0x40), (85, 0x54), (86, 0x89)],
    ));
    close(
        [pvt.velocity.heading_of_vehicle_rad.unwrap()],
        [90_f64.to_radians()],
    );
}

#[test]
fn relative_positions() {
    let position = relative_position_of(&hex(RELATIVE_POSITION_0));
    close(position.ned_m.unwrap(), [27.7786, -52.9848, -1.6348]);
    close(position.ned_accuracy_m, [0.0246, 0.0297, 0.049]);
    assert_eq!(position.heading_and_accuracy_rad, None);
    assert_eq!(position.carrier, CarrierSolution::Float);

    let position = relative_position_of(&hex(RELATIVE_POSITION_1));
    assert_eq!((position.base_station, position.time_of_week_ms), (7, 1000));
    close(position.ned_m.unwrap(), [1234.5612, -23.4534, 6.7856]);
    close(position.ned_accuracy_m, [0.012, 0.015, 0.03]);
    close(
        position.heading_and_accuracy_rad.unwrap(),
        [91.12345, 0.5].map(f64::to_radians),
    );
    assert_eq!(position.carrier, CarrierSolution::Fixed);
    assert!(!position.is_base_moving);

    // Flags: no fix, relative position not valid, a direction alone; a moving base.
    for flags in [[0x04, 0x00], [0x01, 0x00], [0x05, 0x02]] {
        let changes = [(60, flags[0]), (61, flags[1])];
        let position = relative_position_of(&changed(RELATIVE_POSITION_1, &changes));
        assert_eq!(position.ned_m, None);
        assert_eq!(position.heading_and_accuracy_rad, None);
    }
    assert!(relative_position_of(&changed(RELATIVE_POSITION_1, &[(60, 0x25)])).is_base_moving);
}

/// Of semuconsulting/pyubx2, `tests/test_parse.py` at 1b5ee71, and by hand.
#[test]
fn replies() {
    for (text, request, is_accepted) in [
        (ACK, [0x06, 0x01], true),
        ("b5620501 0200 068a 98c1", CFG_VALSET, true),
        ("b5620500 0200 068a 97bc", CFG_VALSET, false),
    ] {
        let expected = Message::Reply {
            request,
            is_accepted,
        };
        assert_eq!(decode_ubx(text), expected);
    }
}

/// Frames that public drivers send, of which receivers are known to accept the second and third
/// (`PyGPSClient` made the first).
#[test]
fn settings() {
    let pulse_period_us = Setting {
        key: 0x4005_0004,
        value: 100_000,
    };
    for (setting, expected) in [
        (
            pulse_period_us,
            "b562068a0c0000010000 04000540 a0860100 0dbb",
        ),
        (
            Setting::pvt_output(Port::Uart1, 1),
            "b562068a090000010000 07009120 01 5348",
        ),
        (
            Setting::pvt_output(Port::Usb, 0),
            "b562068a090000010000 09009120 00 5451",
        ),
        (
            Setting::nmea_output(Port::Uart1, false),
            "b562068a090000010000 02007410 00 20b7",
        ),
        (
            Setting::measurement_period_ms(200),
            "b562068a0a0000010000 01002130 c800 b581",
        ),
    ] {
        assert_eq!(
            configure(&[setting], false),
            Some(hex(expected)),
            "{setting:?}"
        );
    }
    let two = [
        Setting::relative_position_output(Port::Uart2, 5),
        Setting::rtcm_input(Port::Usb, true),
    ];
    let payload = hex("00070000 8f009120 05 04007710 01");
    assert_eq!(configure(&two, true).unwrap()[HEADER..20], payload);
}

#[test]
fn impossible_settings() {
    let setting = |key, value| Setting { key, value };
    let good = setting(0x2091_0007, 255);
    assert!(configure(&[good; 64], false).is_some());
    assert!(configure(&[setting(0x5036_0001, u64::MAX)], false).is_some());
    for settings in [
        vec![],
        vec![good; 65],
        vec![good, setting(0x2091_0007, 256)],
        vec![setting(0x1074_0002, 2)],
        vec![setting(0x3021_0001, 0x1_0000)],
        vec![setting(0x4005_0004, 1 << 32)],
        vec![setting(0x0000_0001, 0)],
        vec![setting(0x6000_0001, 0)],
    ] {
        assert_eq!(configure(&settings, false), None, "{settings:?}");
    }
}

#[test]
fn bad_frames_are_dropped_and_the_next_is_found() {
    let mut wrong_sum = hex(PVT);
    wrong_sum[50] ^= 1;
    let cases = [
        (b"$GNGGA,,*00\r\n\xB5".to_vec(), DropReason::Garbage, 14),
        (wrong_sum, DropReason::Checksum, 1),
        (frame([0x01, 0x03], &[0; 16]), DropReason::UnknownKind, 1),
        (frame(NAV_PVT, &[0; 84]), DropReason::Length, 1),
        (frame(NAV_RELPOSNED, &[0; 48]), DropReason::Length, 1),
        (frame(ACK_ACK, &[0]), DropReason::Length, 1),
        (vec![0xB5, 0x62, 1, 2, 0xFF, 0xFF], DropReason::Length, 1),
        (hex(PVT)[..40].to_vec(), DropReason::Checksum, 1),
        (
            frame([1, 2], &[0; 8000])[..20].to_vec(),
            DropReason::CutOff,
            1,
        ),
        // Month 13, hour 24, latitude over 90°, carrier solution 3, version.
        (changed(PVT, &[(6, 13)]), DropReason::Field, 1),
        (changed(PVT, &[(8, 24)]), DropReason::Field, 1),
        (changed(PVT, &[(31, 0x40)]), DropReason::Field, 1),
        (changed(PVT, &[(21, 0xC1)]), DropReason::Field, 1),
        (
            changed(RELATIVE_POSITION_1, &[(60, 0x1D)]),
            DropReason::Field,
            1,
        ),
        (
            changed(RELATIVE_POSITION_1, &[(0, 0)]),
            DropReason::Field,
            1,
        ),
    ];
    let expected = [decode_ubx(PVT), decode_ubx(ACK)];
    for (bad, reason, count) in cases {
        let bytes = [&bad[..], &hex(PVT), &hex(ACK)].concat();
        for length in [1, 7, usize::MAX] {
            let (messages, dropped) = decode_in(UbloxDecoder::default(), &bytes, &[length]);
            assert_eq!(messages, expected, "{bad:x?}");
            assert_eq!(dropped.count(reason), count, "{bad:x?} {dropped:?}");
        }
    }
}

fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let payload = prop::collection::vec(any::<u8>(), 92);
    let any_pvt = payload.prop_map(|payload| frame(NAV_PVT, &payload));
    let golden = [PVT, RELATIVE_POSITION_0, RELATIVE_POSITION_1, ACK];
    prop_oneof![prop::sample::select(golden.map(hex).to_vec()), any_pvt]
}

proptest! {
    #[test]
    fn damage_neither_panics_nor_gives_senseless_values(
        frames in prop::collection::vec(any_frame(), 0..8),
        damage in damage(b"\xB5\x62\x01\x07\x3C\x00"),
    ) {
        for message in damage.decode(UbloxDecoder::default, frames.concat()) {
            match message {
                Message::Pvt(pvt) => {
                    let fix = pvt.fix();
                    prop_assert!(is_on_earth(fix.latitude_deg, fix.longitude_deg));
                    prop_assert!((-1..=2).contains(&fix.status));
                }
                Message::RelativePosition(position) => {
                    let limit_m = f64::from(i32::MAX) * 0.01 + 0.1;
                    let is_finite = |ned_m: [f64; 3]| ned_m.iter().all(|m| m.abs() <= limit_m);
                    prop_assert!(position.ned_m.is_none_or(is_finite));
                }
                Message::Reply { .. } => {}
            }
        }
    }
}
