use std::f64::consts::PI;

use proptest::prelude::*;

use super::*;
use crate::test_decoding::*;

const ONE: Protocol = Protocol::One;
const TWO: Protocol = Protocol::Two;

fn status(id: u8, faults: &[Fault], parameters: &[u8]) -> Status {
    Status {
        id,
        faults: faults.to_vec(),
        parameters: parameters.to_vec(),
    }
}

/// A reply with this error.
fn reply(protocol: Protocol, id: u8, error: u8, parameters: &[u8]) -> Vec<u8> {
    match protocol {
        ONE => protocol.packet(id, error, parameters).unwrap(),
        TWO => {
            let parameters = [&[error], parameters].concat();
            protocol.packet(id, STATUS, &parameters).unwrap()
        }
    }
}

/// `protocol1.md`, sections Instruction Checksum, Error, Ping, Read, Write, Bulk Read.
#[test]
fn bytes_of_the_manual_for_protocol_1() {
    for (request, expected) in [
        (
            ONE.packet(1, WRITE, &[12, 100, 0xAA]),
            "FF FF 01 05 03 0C 64 AA DC",
        ),
        (ONE.ping(1), "FF FF 01 02 01 FB"),
        (ONE.read(1, item(43, 1)), "FF FF 01 04 02 2B 01 CC"),
        (
            ONE.write(BROADCAST, item(3, 1), 1),
            "FF FF FE 04 03 03 01 F6",
        ),
    ] {
        assert_eq!(request, Some(hex(expected)));
    }
    for (bytes, expected) in [
        (
            "FF FF 01 02 24 D8",
            status(1, &[Fault::Overheating, Fault::Overload], &[]),
        ),
        ("FF FF 01 02 00 FC", status(1, &[], &[])),
        ("FF FF 00 02 00 FD", status(0, &[], &[])),
        ("FF FF 01 03 00 20 DB", status(1, &[], &[32])),
        ("FF FF 01 04 00 00 80 7A", status(1, &[], &[0, 0x80])),
        ("FF FF 02 04 00 00 80 79", status(2, &[], &[0, 0x80])),
    ] {
        assert_eq!(
            decode_one(DynamixelDecoder::new(ONE), &hex(bytes)),
            expected
        );
    }
}

/// `protocol2.md`, sections Ping, Read, Write, Reg Write, Sync Read, Bulk Read.
#[test]
fn bytes_of_the_manual_for_protocol_2() {
    let to_512 = (512.0 - 2048.0) * X_SERIES.step_rad;
    for (request, expected) in [
        (TWO.ping(1), "FF FF FD 00 01 03 00 01 19 4E"),
        (TWO.ping(BROADCAST), "FF FF FD 00 FE 03 00 01 31 42"),
        (
            X_SERIES.read_position(1),
            "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
        ),
        (
            X_SERIES.write_torque_enable(1),
            "FF FF FD 00 01 06 00 03 40 00 01 DB 66",
        ),
        (
            X_SERIES.write_goal_position(1, to_512),
            "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
        ),
        (
            TWO.packet(1, 4, &[0x68, 0, 0xC8, 0, 0, 0]),
            "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
        ),
        (
            X_SERIES.sync_read_positions(&[1, 2]),
            "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        ),
    ] {
        assert_eq!(request, Some(hex(expected)));
    }
    for (bytes, id, parameters) in [
        (
            "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",
            1,
            &[6, 4, 38][..],
        ),
        ("FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D", 2, &[6, 4, 38]),
        (
            "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0",
            1,
            &[0xA6, 0, 0, 0],
        ),
        (
            "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE",
            2,
            &[0x1F, 8, 0, 0],
        ),
        ("FF FF FD 00 01 04 00 55 00 A1 0C", 1, &[]),
        ("FF FF FD 00 01 06 00 55 00 77 00 C3 69", 1, &[0x77, 0]),
        ("FF FF FD 00 02 05 00 55 00 24 8B A9", 2, &[0x24]),
    ] {
        assert_eq!(
            decode_one(DynamixelDecoder::new(TWO), &hex(bytes)),
            status(id, &[], parameters)
        );
    }
}

#[test]
fn the_replies_of_the_manual_in_si_units() {
    let pinged = status(1, &[], &[6, 4, 38]);
    let identity = Identity {
        model: 1030,
        firmware: 38,
    };
    assert_eq!(pinged.identity(), Some(identity));
    assert_eq!(X_SERIES.position_rad(&pinged), None);
    let positions = [
        (
            X_SERIES,
            &[0xA6, 0, 0, 0][..],
            (166.0 - 2048.0) * PI / 2048.0,
        ),
        (X_SERIES, &[0, 8, 0, 0], 0.0),
        (X_SERIES, &[0, 0xF8, 0xFF, 0xFF], -2.0 * PI),
        (MX_28, &[0, 12], PI / 2.0),
        (MX_28, &[0, 0xF8], -2.0 * PI),
        (AX_12A, &[0, 0], -150_f64.to_radians()),
        (AX_12A, &[0xFF, 3], 150_f64.to_radians()),
    ];
    for (model, parameters, expected_rad) in positions {
        let status = status(1, &[Fault::Overload], parameters);
        let angle_rad = model.position_rad(&status).unwrap();
        assert!((angle_rad - expected_rad).abs() < 1e-9, "{angle_rad}");
        assert_eq!(status.identity(), None);
    }
    for (model, parameters) in [
        (X_SERIES, &[0, 8][..]),
        (MX_28, &[0, 8, 0, 0]),
        (MX_28, &[]),
        (MX_28, &[1, 0x70]),
        (MX_28, &[0xFF, 0x8F]),
        (AX_12A, &[0, 4]),
        (AX_12A, &[0xFF, 0xFF]),
    ] {
        assert_eq!(model.position_rad(&status(1, &[], parameters)), None);
    }
}

/// 300 steps of an MX-28: "about 34.2 rpm"; of an AX-12A: "about 33.3rpm".
#[test]
fn velocities() {
    for (model, parameters, expected_rpm) in [
        (MX_28, &[44, 1][..], Some(34.2)),
        (MX_28, &[44, 5], Some(-34.2)),
        (MX_28, &[0, 4], Some(0.0)),
        (MX_28, &[0, 8], None),
        (MX_28, &[0xFF, 0xFF], None),
        (AX_12A, &[44, 1], Some(33.3)),
        (X_SERIES, &[100, 0, 0, 0], Some(22.9)),
        (X_SERIES, &[0x9C, 0xFF, 0xFF, 0xFF], Some(-22.9)),
        (X_SERIES, &[100, 0], None),
    ] {
        let velocity = model.velocity_radps(&status(1, &[], parameters));
        let rpm = velocity.map(|radps| radps * 30.0 / PI);
        assert_eq!(rpm.is_some(), expected_rpm.is_some(), "{parameters:?}");
        let error = rpm.unwrap_or_default() - expected_rpm.unwrap_or_default();
        assert!(error.abs() < 1e-9, "{rpm:?}");
    }
    assert_eq!(X_SERIES.read_velocity(1), TWO.read(1, item(128, 4)));
}

#[test]
fn goals() {
    // 90° is 3072.
    let goal = MX_28.write_goal_position(3, PI / 2.0);
    assert_eq!(goal, ONE.packet(3, WRITE, &[30, 0, 12]));
    let radps = |rpm: f64| rpm * PI / 30.0;
    for (model, rpm, expected) in [
        (&MX_28, 34.2, ONE.packet(1, WRITE, &[32, 44, 1])),
        (&MX_28, -34.2, ONE.packet(1, WRITE, &[32, 44, 5])),
        (&MX_28, 0.0, ONE.packet(1, WRITE, &[32, 0, 0])),
        (&MX_28, 120.0, None),
        (&AX_12A, 1.0, None),
        (
            &X_SERIES,
            -22.9,
            TWO.packet(1, WRITE, &[104, 0, 0x9C, 0xFF, 0xFF, 0xFF]),
        ),
        (&X_SERIES, -300.0, None),
        (&X_SERIES, f64::NAN, None),
        (&X_SERIES, f64::INFINITY, None),
    ] {
        assert_eq!(model.write_goal_velocity(1, radps(rpm)), expected, "{rpm}");
    }
    for (model, rpm, expected) in [
        (&AX_12A, 11.1, ONE.packet(1, WRITE, &[32, 100, 0])),
        (&MX_28, 0.0, ONE.packet(1, WRITE, &[32, 1, 0])),
        (
            &X_SERIES,
            22.9,
            TWO.packet(1, WRITE, &[112, 0, 100, 0, 0, 0]),
        ),
        (&X_SERIES, 300.0, None),
    ] {
        assert_eq!(
            model.write_profile_velocity(1, radps(rpm)),
            expected,
            "{rpm}"
        );
    }
    let torque = AX_12A.write_torque_enable(1);
    assert_eq!(torque, ONE.packet(1, WRITE, &[24, 1]));
    for (model, angle_rad) in [
        (&AX_12A, 2.7),
        (&AX_12A, -2.7),
        (&MX_28, 50.0),
        (&X_SERIES, 1700.0),
        (&X_SERIES, f64::NAN),
        (&X_SERIES, f64::NEG_INFINITY),
        (&X_SERIES, 1e300),
    ] {
        assert_eq!(model.write_goal_position(1, angle_rad), None);
    }
}

#[test]
fn impossible_requests() {
    let position = X_SERIES.present_position;
    for request in [
        ONE.ping(BROADCAST),
        ONE.ping(255),
        TWO.ping(253),
        TWO.ping(255),
        TWO.read(BROADCAST, position),
        TWO.read(1, item(0, 0)),
        ONE.read(1, item(256, 1)),
        ONE.read(1, item(0, 256)),
        ONE.write(1, item(256, 1), 0),
        TWO.write(1, item(0, 5), 0),
        TWO.sync_read(&[], position),
        TWO.sync_read(&[1, 2, 1], position),
        TWO.sync_read(&[253], position),
        ONE.sync_read(&[1], position),
    ] {
        assert_eq!(request, None);
    }
}

#[test]
fn faults() {
    let both = [Fault::Access, Fault::Hardware];
    for (protocol, error, expected) in [
        (TWO, 0x87, &both[..]),
        (TWO, 0x80, &[Fault::Hardware]),
        (TWO, 1, &[Fault::Result]),
        (TWO, 2, &[Fault::Instruction]),
        (TWO, 3, &[Fault::Checksum]),
        (TWO, 4, &[Fault::Range]),
        (TWO, 5, &[Fault::DataLength]),
        (TWO, 6, &[Fault::DataLimit]),
        (TWO, 8, &[Fault::Unknown(8)]),
        (ONE, 0x01, &[Fault::InputVoltage]),
        (ONE, 0x02, &[Fault::AngleLimit]),
        (ONE, 0x08, &[Fault::Range]),
        (ONE, 0x10, &[Fault::Checksum]),
        (ONE, 0x40, &[Fault::Instruction]),
    ] {
        let reply = decode_one(
            DynamixelDecoder::new(protocol),
            &reply(protocol, 5, error, &[9]),
        );
        assert_eq!(reply, status(5, expected, &[9]));
    }
}

/// By the manual's rule: `FF FF FD` becomes `FF FF FD FD`.
#[test]
fn stuffing() {
    for (body, stuffed) in [
        ("FF FF FD", "FF FF FD FD"),
        ("FF FF FD FD", "FF FF FD FD FD"),
        ("FF FF FF FD 00", "FF FF FF FD FD 00"),
        ("FF FD FF FF", "FF FD FF FF"),
        ("FF FF FD FF FF FD", "FF FF FD FD FF FF FD FD"),
    ] {
        assert_eq!(stuff(&hex(body)), hex(stuffed));
        assert_eq!(unstuff(&hex(stuffed)), hex(body));
        let reply = decode_one(DynamixelDecoder::new(TWO), &reply(TWO, 1, 0, &hex(body)));
        assert_eq!(reply.parameters, hex(body));
    }
}

#[test]
fn bad_packets_are_dropped_and_the_next_is_found() {
    let good = [
        hex("FF FF 01 04 00 00 80 7A"),
        hex("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"),
    ];
    for (protocol, bad, reason, count) in [
        (ONE, hex("00 FF 00 55"), DropReason::Garbage, 4),
        (ONE, hex("FF"), DropReason::Garbage, 1),
        (ONE, hex("FF FF FF"), DropReason::Garbage, 3),
        (ONE, hex("FF FF 01 02 00 FD"), DropReason::Checksum, 1),
        (ONE, hex("FF FF 01 01 FD"), DropReason::Length, 1),
        (ONE, hex("FF FF 01 00 FE"), DropReason::Length, 1),
        (ONE, reply(ONE, 1, 0x80, &[]), DropReason::Field, 1),
        (ONE, hex("FF FF FE 02 05 FA"), DropReason::UnknownKind, 1),
        (ONE, hex("FF FF 01 20 00 01 02"), DropReason::CutOff, 1),
        (ONE, hex("FF FF 01 FF"), DropReason::CutOff, 1),
        (TWO, hex("00 FF FF FD 01 55"), DropReason::Garbage, 6),
        (TWO, hex("FF FF FD"), DropReason::Garbage, 3),
        (
            TWO,
            hex("FF FF FD 00 01 04 00 55 00 A1 0D"),
            DropReason::Checksum,
            1,
        ),
        (
            TWO,
            hex("FF FF FD 00 01 02 00 A1 0D"),
            DropReason::Length,
            1,
        ),
        (
            TWO,
            hex("FF FF FD 00 01 4D 04 55 00"),
            DropReason::Length,
            1,
        ),
        (TWO, hex("FF FF FD 00 FD 03"), DropReason::Field, 1),
        (TWO, hex("FF FF FD 00"), DropReason::Field, 1),
        (
            TWO,
            TWO.packet(BROADCAST, STATUS, &[0]).unwrap(),
            DropReason::Field,
            1,
        ),
        (
            TWO,
            TWO.packet(1, STATUS, &[]).unwrap(),
            DropReason::Length,
            1,
        ),
        // The host's own request, that an adapter returns.
        (
            TWO,
            X_SERIES.sync_read_positions(&[1, 2]).unwrap(),
            DropReason::UnknownKind,
            1,
        ),
        (
            TWO,
            hex("FF FF FD 00 01 4C 04 55 00"),
            DropReason::CutOff,
            1,
        ),
        (TWO, hex("FF FF FD 00 01 09 00"), DropReason::CutOff, 1),
        // The next mark reaches into the sum.
        (TWO, hex("FF FF FD 00 01 05 00"), DropReason::Checksum, 1),
    ] {
        let good = &good[usize::from(protocol == TWO)];
        let expected = decode_one(DynamixelDecoder::new(protocol), good);
        let bytes = [&bad[..], good].concat();
        for length in [1, 5, usize::MAX] {
            let (replies, dropped) = decode_in(DynamixelDecoder::new(protocol), &bytes, &[length]);
            assert_eq!(replies, std::slice::from_ref(&expected), "{bad:x?}");
            assert_eq!(dropped.count(reason), count, "{bad:x?} {dropped:?}");
        }
    }
}

fn any_protocol() -> impl Strategy<Value = Protocol> {
    prop::sample::select(vec![ONE, TWO])
}

/// Bytes of which marks and stuffing are made, and others.
fn any_parameters() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![Just(0xFF), Just(0xFD), Just(0), any::<u8>()];
    prop::collection::vec(byte, 0..12)
}

fn any_reply() -> impl Strategy<Value = (u8, u8, Vec<u8>)> {
    (0..=252_u8, 0..=0x7F_u8, any_parameters())
}

proptest! {
    #[test]
    fn any_split_gives_the_same_replies(
        protocol in any_protocol(),
        sent in prop::collection::vec(any_reply(), 1..10),
        lengths in read_lengths(),
    ) {
        // A reply of protocol 1.0 that has another one in its data is not told from one cut off.
        let sent: Vec<_> = sent
            .into_iter()
            .filter(|(.., parameters)| protocol == TWO || !parameters.windows(2).any(|two| two == MARK_1))
            .collect();
        let packet = |(id, error, parameters): &(u8, u8, Vec<u8>)| reply(protocol, *id, *error, parameters);
        let bytes: Vec<u8> = sent.iter().flat_map(packet).collect();
        let (replies, dropped) = decode_in(DynamixelDecoder::new(protocol), &bytes, &lengths);
        prop_assert_eq!(dropped, Dropped::default());
        prop_assert_eq!(replies.len(), sent.len());
        for (reply, (id, _, parameters)) in replies.iter().zip(&sent) {
            prop_assert_eq!((reply.id, &reply.parameters), (*id, parameters));
        }
    }

    #[test]
    fn damage_neither_panics_nor_gives_senseless_values(
        protocol in any_protocol(),
        sent in prop::collection::vec(any_reply(), 1..10),
        damage in damage(b"\xFF\xFD\x00\x55"),
    ) {
        let packet = |(id, error, parameters): (u8, u8, Vec<u8>)| reply(protocol, id, error, &parameters);
        let bytes = sent.into_iter().flat_map(packet).collect();
        for reply in damage.decode(|| DynamixelDecoder::new(protocol), bytes) {
            prop_assert!(reply.id < BROADCAST);
            for model in [AX_12A, MX_28, X_SERIES] {
                prop_assert!(model.position_rad(&reply).is_none_or(f64::is_finite));
                prop_assert!(model.velocity_radps(&reply).is_none_or(f64::is_finite));
            }
            let angle_rad = AX_12A.position_rad(&reply).unwrap_or_default();
            prop_assert!(angle_rad.abs() <= 150.1_f64.to_radians());
        }
    }

    #[test]
    fn angles_come_back_within_half_a_step(angle_rad in -2.6..2.6_f64) {
        for model in [AX_12A, MX_28, X_SERIES] {
            let request = model.write_goal_position(1, angle_rad).unwrap();
            let length = usize::from(model.goal_position.length);
            let sum = if model.protocol == ONE { 1 } else { 2 };
            let value = &request[request.len() - sum - length..request.len() - sum];
            let returned_rad = model.position_rad(&status(1, &[], value)).unwrap();
            prop_assert!((returned_rad - angle_rad).abs() <= model.step_rad / 2.0 + 1e-9);
        }
    }
}
