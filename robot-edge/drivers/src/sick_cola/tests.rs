use std::f32::consts::PI;
use std::fs;
use std::path::Path;

use proptest::prelude::*;

use super::telegram::{MAX_CHANNELS, MAX_ENCODERS, MAX_PAYLOAD};
use super::*;
use crate::shared_data::shared_data;
use crate::test_decoding::*;
use crate::{DropReason, Dropped};

fn scan_of(bytes: &[u8]) -> ScanData {
    match decode_one(SickColaDecoder::default(), bytes) {
        Message::Scan(scan) => *scan,
        other => panic!("{other:?}"),
    }
}

fn framed(payload: &[u8]) -> Vec<u8> {
    let sum = payload.iter().fold(0, |sum, byte| sum ^ byte);
    let length = (payload.len() as u32).to_be_bytes();
    [&[2; 4], &length[..], payload, &[sum]].concat()
}

fn text(payload: &str) -> Vec<u8> {
    format!("\x02{payload}\x03").into_bytes()
}

/// Values of a telegram: numbers with their widths in CoLa B, texts.
enum Value {
    Number(usize, u32),
    Text(&'static str),
}

use Value::{Number, Text};

/// A telegram apart from the code under test.
fn telegram(coding: Coding, command: &str, values: &[Value]) -> Vec<u8> {
    let token = |value: &Value| match value {
        Number(_, number) => format!(" {number:X}"),
        Text(text) => format!(" {text}"),
    };
    let bytes = |value: &Value| match value {
        Number(width, number) => number.to_be_bytes()[4 - width..].to_vec(),
        Text(text) => text.as_bytes().to_vec(),
    };
    match coding {
        Coding::A => text(&(command.to_string() + &values.iter().map(token).collect::<String>())),
        Coding::B => {
            let values = values.iter().flat_map(bytes);
            framed(
                &format!("{command} ")
                    .bytes()
                    .chain(values)
                    .collect::<Vec<_>>(),
            )
        }
    }
}

/// A scan of an LMS5xx with scale 2, one encoder, a
/// strength of 8 bits, and the end that an LMS511 sent.
fn lms5xx(distances: &[u16]) -> Vec<Value> {
    let mut values = vec![Number(2, 1), Number(2, 1), Number(4, 0x0137_4C54)];
    values.extend([Number(1, 0), Number(1, 5), Number(2, 0), Number(2, 0x3F0E)]);
    values.extend([Number(4, 0x02BF_460C), Number(4, 0x02BF_E48F)]);
    values.extend([0, 0, 0x3F, 0].map(|byte| Number(1, byte)));
    values.extend([Number(2, 0), Number(4, 2500), Number(4, 0x21C)]);
    values.extend([Number(2, 1), Number(4, 0x12345), Number(2, 0x3E8)]);
    for (width, content, scale) in [(2, "DIST1", 2.0_f32), (1, "RSSI1", 1.0)] {
        values.extend([Number(2, 1), Text(content), Number(4, scale.to_bits())]);
        values.extend([Number(4, 0), Number(4, 0xFFFF_3CB0), Number(2, 1667)]);
        values.push(Number(2, distances.len() as u32));
        let value = |distance: &u16| Number(width, u32::from(*distance) & ((1 << (8 * width)) - 1));
        values.extend(distances.iter().map(value));
    }
    values.extend([0, 0, 0, 1, 0x7B2].map(|number| Number(2, number)));
    values.extend([1, 0x1B, 0x11, 0x33, 0x39].map(|number| Number(1, number)));
    values.extend([Number(4, 0x1D8A8), Number(2, 0)]);
    values
}

/// What a TiM55x sent: lidar-hardware-mock/src/main/java/info/kilchhofer/bfh/lidar/hardware/mock/
/// `HardwareMock.java` of mkilchhofer/robocup-positioning at bc9001c.
const TIM55X: &str = "\x02\
    sSN LMDscandata 1 1 107375C 0 0 E784 E789 3D611E4A 3D612D1F 0 0 1 0 0 5DC 36 0 1 DIST1 3F800000 \
    00000000 FFF92230 2710 10F 1B8 1B3 1B9 1BD 1F9 22B 218 209 1F9 1FB 1F4 1EB 1E0 1D7 1CE 1C6 1BE \
    1B8 1BB 1B6 1B1 193 1A6 201 2B7 2 671 5CE 4FE 0 15A 156 14D 142 149 151 157 15B 1EF 254 6B5 621 \
    5E9 C93 5AE 561 536 506 0 F0 176 191 18C 18B 189 18A 18F 18A 18F 191 18C 18B 187 17E 178 160 143 \
    12F 11B 104 EA CA A9 A6 A2 9F A0 9D 9E 9E 9C 9C 9A 98 98 97 93 93 91 8C 8B 8B 88 8A 83 8B 91 8C \
    89 8C 8D 88 87 8E 5A 0 0 610 5FE 5ED 5DE 5D6 5D1 5C4 5B6 5B6 5AF 5A1 596 595 591 592 589 584 57D \
    57B 579 571 571 56F 56B 577 573 576 56B 56B 56C 56E 577 579 57C 57C 586 58A 58E 595 593 59B 0 \
    301 30A 30A 30E 316 31A 31F 323 32D 32F 335 33E 345 350 358 362 369 36F 6A0 6B6 6D1 723 225 206 \
    22C 235 21C 1E9 1D2 1C0 1B8 16E 10C 6F9 6E3 6D0 6B0 69D 684 678 65F 652 63B 628 617 607 5FC 5EF \
    5DB 5D2 5C6 5C0 58D 575 0 1A E5 E5 E6 E8 E6 E7 E6 EB E2 E3 EC E7 E2 E7 F0 EA E8 E8 E5 E8 EB EE \
    EF EE F1 F0 F4 F4 F0 F4 F5 F9 F9 F8 FC 101 103 106 17D 333 34C 0 5CD 5DC 5E0 5AE 57B 550 54E 58E \
    192 1C6 1F3 1FC 1F2 1A1 1AA 2 AA6 419 418 562 56A 562 548 535 1 RSSI1 3F800000 00000000 FFF92230 \
    2710 10F AA AA AA A3 9A 97 87 8A 8A 8A 8D 8D 8D 90 8D 8D 90 8A 90 8D 93 8D 7D 6A 5E 0 A0 6D 74 0 \
    80 87 9A B9 AA 8A 84 74 67 80 5B 74 31 25 57 64 67 80 0 44 7A 8A 8A 87 87 80 80 7A 7A 77 7A 74 \
    74 77 74 77 6D 74 71 6D 6D 71 6D 6D 77 77 77 7D 80 84 87 8A 8A 90 93 8D 93 93 90 93 93 97 9A A0 \
    A0 A6 A3 9A 93 90 80 74 71 64 61 0 0 B3 B6 BD BD BD BD C0 BD C3 C3 C3 C0 C3 C6 C6 C6 C6 C6 C6 CC \
    CC D3 D3 D9 E6 E6 E6 D9 D9 CF CC CC C9 C9 C3 C9 C9 C6 C6 C0 BD 0 D6 D6 D3 CF D3 CF D3 CF CF C9 \
    CC CC CC CC CC C9 C6 B6 A3 A0 8D 71 71 84 8D 87 84 87 87 8A 87 90 9A 9D A3 A6 A3 A3 A0 A6 AA AD \
    AD AD AD AD B0 B0 AD B3 B0 B0 A0 A0 0 80 93 9A 97 9A 97 9A 9A 9D 97 97 A0 9D 97 9D A0 9D 9A 93 \
    97 93 93 97 93 93 97 97 97 90 90 93 93 97 97 90 8D 8D 8D 87 57 7A 84 0 AA AD A3 90 8D 9D 90 87 \
    80 93 8A 8D 74 44 48 0 48 87 7D 93 A0 A3 A3 A3 0 1 B not defined 0 0 0\x03";

#[test]
fn a_tim55x_in_text() {
    let scan = scan_of(TIM55X.as_bytes());
    assert_eq!(scan.serial_number, 0x0107_375C);
    assert_eq!(scan.status, ScanStatus([0, 0]));
    assert_eq!((scan.telegram_counter, scan.scan_counter), (0xE784, 0xE789));
    let times = (scan.power_up_time_us, scan.transmission_time_us);
    assert_eq!(times, (0x3D61_1E4A, 0x3D61_2D1F));
    assert_eq!(scan.inputs_outputs, [0, 0, 1, 0]);
    assert_eq!(scan.frequency_centihertz, 1500);
    let [distances, strengths] = scan.channels.as_slice() else {
        panic!("{:?}", scan.channels);
    };
    assert_eq!(
        (distances.start_deg_e4, distances.step_deg_e4),
        (-450_000, 10_000)
    );
    let sum = |channel: &Channel| {
        channel
            .values
            .iter()
            .map(|value| u32::from(*value))
            .sum::<u32>()
    };
    assert_eq!((distances.values.len(), sum(distances)), (271, 202_879));
    assert_eq!((strengths.values.len(), sum(strengths)), (271, 40_122));
    let details = scan.details.clone().unwrap();
    assert_eq!(details.name.as_deref(), Some("not defined"));
    assert_eq!(
        (details.comment, details.time, details.position),
        (None, None, None)
    );

    let scan = scan.to_scan(0.05, 10.0).unwrap();
    assert_eq!(scan.ranges_m[..2], [0.44, 0.435]);
    assert_eq!(
        scan.ranges_m
            .iter()
            .filter(|range| range.is_infinite())
            .count(),
        7
    );
    // Two error codes 2, and 26 mm, which is too near.
    assert_eq!(
        scan.ranges_m.iter().filter(|range| range.is_nan()).count(),
        3
    );
    assert!((scan.angle_min_rad + 0.75 * PI).abs() < 1e-6);
    assert!((scan.angle_increment_rad - PI / 180.0).abs() < 1e-8);
    // Measurement frequency 0x36: 5400 beams per second.
    assert!((scan.time_increment_s - 1.0 / 5400.0).abs() < 1e-9);
}

#[test]
fn an_lms5xx_in_both_codings() {
    let distances = [0, 1, 15, 16, 500, 40_000, 0xFFFF, 250];
    let [a, b] = [Coding::A, Coding::B]
        .map(|coding| scan_of(&telegram(coding, "sSN LMDscandata", &lms5xx(&distances))));
    assert_eq!(a, b);
    assert_eq!(a.channel("DIST1").unwrap().values, distances);
    assert_eq!(a.channel("RSSI1").unwrap().values[4], 500 % 256);
    let encoder = Encoder {
        position_ticks: 0x12345,
        speed: 1000,
    };
    assert_eq!(a.encoders, [encoder]);
    assert!(a.status.is_error() && a.status.is_contamination_error());
    assert!(!a.status.is_contamination_warning());
    let time = DeviceTime {
        year: 1970,
        month_to_second: [1, 27, 17, 51, 57],
        microsecond: 121_000,
    };
    assert_eq!(a.details.as_ref().unwrap().time, Some(time));

    let scan = a.to_scan(0.2, 80.0).unwrap();
    let ranges = &scan.ranges_m;
    assert!(ranges[0].is_infinite() && ranges[1].is_nan() && ranges[2].is_nan());
    assert!(ranges[3].is_nan(), "32 mm is nearer than 0.2 m");
    assert_eq!((ranges[4], ranges[7]), (1.0, 0.5));
    assert!(ranges[5].is_infinite() && ranges[6].is_infinite());
    // Codes below 16 are no ranges, whatever the smallest range is.
    let codes = a.to_scan(0.0, 80.0).unwrap().ranges_m;
    assert!(codes[2].is_nan());
    assert_eq!(codes[3..4], [0.032]);
    // -5° of the device; 1667 is a sixth of a degree.
    assert!((scan.angle_min_rad - (-95.0_f32).to_radians()).abs() < 1e-6);
    assert!((scan.angle_increment_rad - PI / 1080.0).abs() < 1e-9);
    assert!((scan.time_increment_s - 1.0 / 54_000.0).abs() < 1e-9);
}

#[test]
fn details_in_both_codings() {
    let head = |channels: bool| {
        let mut values = lms5xx(&[]);
        values.truncate(if channels { values.len() - 12 } else { 18 });
        values
    };
    let mut blocks = vec![Number(2, 1)];
    blocks.extend([1.0_f32, -2.0, 3.5, 0.0, 0.25, 9.0].map(|value| Number(4, value.to_bits())));
    blocks.push(Number(1, 3));
    for (coding, width) in [(Coding::A, 1), (Coding::B, 1), (Coding::B, 2)] {
        let mut values = head(true);
        values.extend(blocks.iter().map(|value| match value {
            Number(width, number) => Number(*width, *number),
            Text(text) => Text(text),
        }));
        for name in ["bow", "a b "] {
            values.extend([Number(2, 1), Number(width, name.len() as u32), Text(name)]);
        }
        values.extend([Number(2, 0), Number(2, 0)]);
        let details = scan_of(&telegram(coding, "sSN LMDscandata", &values)).details;
        let position = Position {
            translation: [1.0, -2.0, 3.5],
            rotation: [0.0, 0.25, 9.0],
            rotation_kind: 3,
        };
        let expected = Details {
            position: Some(position),
            name: Some("bow".into()),
            comment: Some("a b ".into()),
            time: None,
        };
        assert_eq!(details, Some(expected), "{coding:?} {width}");
    }
    // Ranges are kept if what follows them is not as expected.
    let mut values = head(true);
    values.push(Number(2, 0));
    let scan = scan_of(&telegram(Coding::B, "sSN LMDscandata", &values));
    assert_eq!((scan.channels.len(), scan.details), (2, None));
    let (messages, dropped) = decode_in(
        SickColaDecoder::default(),
        &telegram(Coding::B, "sSN LMDscandata", &head(false)),
        &[100],
    );
    assert_eq!((messages.len(), dropped.count(DropReason::Field)), (0, 1));
}

#[test]
fn replies() {
    let sector = Sector {
        resolution_deg_e4: 5000,
        start_deg_e4: -450_000,
        stop_deg_e4: 2_250_000,
    };
    let config = ScanConfig {
        frequency_centihertz: 5000,
        sector,
    };
    let answer = |request, result| Message::Answer { request, result };
    let identity = |device: &str, firmware: &str| Message::Identity {
        device: device.into(),
        firmware: firmware.into(),
    };
    for (payload, expected) in [
        ("sAN SetAccessMode 1", answer("SetAccessMode", Ok(()))),
        ("sAN SetAccessMode 0", answer("SetAccessMode", Err(0))),
        ("sAN LMCstartmeas 0", answer("LMCstartmeas", Ok(()))),
        ("sAN LMCstartmeas 1", answer("LMCstartmeas", Err(1))),
        ("sAN LMCstopmeas 0", answer("LMCstopmeas", Ok(()))),
        ("sAN mEEwriteall 1", answer("mEEwriteall", Ok(()))),
        ("sAN Run 1", answer("Run", Ok(()))),
        // beolabs-io/SICK-Sensor-LMS1XX, comments.
        (
            "sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510",
            answer("mLMPsetscancfg", Ok(())),
        ),
        (
            "sAN mLMPsetscancfg 4 1388 1 1388 FFF92230 225510",
            answer("mLMPsetscancfg", Err(4)),
        ),
        ("sWA LMPoutputRange", answer("LMPoutputRange", Ok(()))),
        ("sEA LMDscandata 1", Message::Subscribed(true)),
        ("sEA LMDscandata 0", Message::Subscribed(false)),
        (
            "sRA DeviceIdent 10 LMS10x_FieldEval 10 V1.36-21.10.2010",
            identity("LMS10x_FieldEval", "V1.36-21.10.2010"),
        ),
        (
            "sRA LMPscancfg 1388 1 1388 FFF92230 225510",
            Message::ScanConfig(config),
        ),
        (
            "sRA LMPscancfg +5000 +1 +5000 -450000 +2250000",
            Message::ScanConfig(config),
        ),
        (
            "sRA LMPoutputRange 1 1388 FFF92230 225510",
            Message::OutputRange(sector),
        ),
        (
            "sRA STlms 7 0 8 00:34:19 A 01.01.1970 0 0 0",
            Message::Status(7),
        ),
        (
            "sRA SCdevicestate 1",
            Message::DeviceState(DeviceState::Ready),
        ),
        ("sFA 1", Message::Error(1)),
        ("sFA A", Message::Error(10)),
    ] {
        assert_eq!(
            decode_one(SickColaDecoder::default(), &text(payload)),
            expected,
            "{payload}"
        );
    }
    // An MRS6124R, log of sick_scan.
    let ident = b"sRA DeviceIdent \x00\x08MRS6124R\x00\x0a1.1.0.565C";
    assert_eq!(
        decode_one(SickColaDecoder::default(), &framed(ident)),
        identity("MRS6124R", "1.1.0.565C")
    );
    // TiM781 manual, table 203, and what an LMS4000 sent.
    for (last, code) in [([0x00, 0x01, 0x75], 1), ([0x00, 0x0A, 0x7E], 10)] {
        let bytes = [&b"\x02\x02\x02\x02\0\0\0\x05sFA"[..], &last].concat();
        assert_eq!(
            decode_one(SickColaDecoder::default(), &bytes),
            Message::Error(code)
        );
    }
    assert!(error_meaning(1).contains("level"));
}

#[test]
fn requests() {
    // LMS4000 manual, tables 13 and 198.
    for (request, a, b) in [
        (
            Request::Subscribe(true),
            &b"\x02sEN LMDscandata 1\x03"[..],
            &b"\x02\x02\x02\x02\0\0\0\x11sEN LMDscandata \x01\x33"[..],
        ),
        (
            Request::ReadDeviceState,
            b"\x02sRN SCdevicestate\x03",
            b"\x02\x02\x02\x02\0\0\0\x11sRN SCdevicestate\x30",
        ),
    ] {
        assert_eq!(request.to_bytes(Coding::A), a);
        assert_eq!(request.to_bytes(Coding::B), b);
    }
    let sector = Sector {
        resolution_deg_e4: 5000,
        start_deg_e4: -450_000,
        stop_deg_e4: 2_250_000,
    };
    let scan_config = ScanConfig {
        frequency_centihertz: 5000,
        sector,
    };
    for (request, payload) in [
        (CLIENT_LOGIN, "sMN SetAccessMode 3 F4724744"),
        (
            Request::SetScanConfig(scan_config),
            "sMN mLMPsetscancfg 1388 1 1388 FFF92230 225510",
        ),
        (
            Request::SetOutputRange(sector),
            "sWN LMPoutputRange 1 1388 FFF92230 225510",
        ),
        (
            Request::SetScanDataConfig(SCAN_DATA_CONFIG),
            "sWN LMDscandatacfg 1 0 1 1 0 0 0 0 0 0 1 1",
        ),
        (Request::StoreSettings, "sMN mEEwriteall"),
        (Request::StopMeasuring, "sMN LMCstopmeas"),
        (Request::ReadScan, "sRN LMDscandata"),
        (Request::ReadStatus, "sRN STlms"),
        (Request::ReadIdentity, "sRN DeviceIdent"),
        (Request::ReadScanConfig, "sRN LMPscancfg"),
    ] {
        assert_eq!(request.to_bytes(Coding::A), text(payload));
    }
}

/// That of the TiM781S capture.
const SCAN_DATA_CONFIG: ScanDataConfig = ScanDataConfig {
    echoes: [1, 0],
    rssi: true,
    rssi_16_bit: true,
    encoders: [0, 0],
    position: false,
    name: false,
    comment: false,
    time: true,
    every: 1,
};

#[test]
fn bad_bytes_are_counted_and_what_follows_is_found() {
    let good = text("sAN Run 1");
    let good_b = framed(b"sAN Run \x01");
    let mut flipped = good_b.clone();
    flipped[12] ^= 1;
    let scan = |values: &[Value]| telegram(Coding::B, "sSN LMDscandata", values);
    let mut not_finite = lms5xx(&[500]);
    let mut too_many = lms5xx(&[500]);
    let scale = not_finite
        .iter()
        .position(|value| matches!(value, Number(4, 0x4000_0000)))
        .unwrap();
    not_finite[scale] = Number(4, f32::NAN.to_bits());
    too_many[scale + 4] = Number(2, 0xFFFF);
    let cases: [(&[u8], DropReason, u64); 15] = [
        (b"xyz", DropReason::Garbage, 3),
        (b"\x02", DropReason::Garbage, 1),
        (b"\x02\x02x", DropReason::Garbage, 3),
        (&flipped, DropReason::Checksum, 1),
        (b"\x02\x02\x02\x02\0\x01\0\0", DropReason::Length, 1),
        (b"\x02\x02\x02\x02\0\0\0\x08xAN Run ", DropReason::Field, 1),
        (&framed(b"sAN"), DropReason::UnknownKind, 1),
        (&framed(b"sAN Run "), DropReason::Field, 1),
        (&framed(b"sAN Run \x01\x01"), DropReason::Field, 1),
        (&text("sEA LMDscandata 2"), DropReason::Field, 1),
        (&text("sEA LMDscandata x"), DropReason::Field, 1),
        (&text("sRA DeviceIdent 7F a 1 b"), DropReason::Field, 1),
        (&text("sRA field010 0"), DropReason::UnknownKind, 1),
        (b"\x02sSN LMDscandata 1 1", DropReason::CutOff, 1),
        (b"\x02sSN LMDscandata 1\r", DropReason::Field, 1),
    ];
    for (bad, reason, count) in cases {
        for follower in [&good, &good_b] {
            // A lone STX before CoLa B is a fifth one.
            if bad.ends_with(&[2]) && follower == &good_b {
                continue;
            }
            let bytes = [&good[..], bad, follower, &good].concat();
            let (messages, dropped) = decode(SickColaDecoder::default(), &bytes);
            assert_eq!(messages.len(), 3, "{bad:?} {dropped:?}");
            assert_eq!(dropped.count(reason), count, "{bad:?} {dropped:?}");
        }
    }
    for bad in [&not_finite, &too_many] {
        let (messages, dropped) = decode(
            SickColaDecoder::default(),
            &[scan(bad), good.clone()].concat(),
        );
        assert_eq!((messages.len(), dropped.count(DropReason::Field)), (1, 1));
    }
    // A binary telegram that another one cuts off.
    let whole = scan(&lms5xx(&[500; 20]));
    let (messages, _) = decode_in(
        SickColaDecoder::default(),
        &[&whole[..60], &whole, &whole, &whole].concat(),
        &[7],
    );
    assert_eq!(messages.len(), 3);
}

#[test]
fn impossible_scans_are_no_scans() {
    let good = scan_of(&telegram(Coding::B, "sSN LMDscandata", &lms5xx(&[500; 3])));
    assert!(good.to_scan(0.1, 50.0).is_some());
    let changes: [fn(&mut ScanData); 8] = [
        |scan| scan.channels.clear(),
        |scan| scan.channels[0].values.clear(),
        |scan| scan.channels[0].step_deg_e4 = 0,
        |scan| scan.channels[0].values.resize(2200, 0),
        |scan| scan.channels[0].start_deg_e4 = i32::MIN,
        |scan| scan.channels[0].scale = -1.0,
        |scan| scan.channels[0].offset = 1e9,
        |scan| scan.frequency_centihertz = 0,
    ];
    for change in changes {
        let mut bad = good.clone();
        change(&mut bad);
        assert_eq!(bad.to_scan(0.1, 50.0), None, "{bad:?}");
    }
    for (min_m, max_m) in [
        (f32::NAN, 1.0),
        (1.0, 1.0),
        (0.0, f32::INFINITY),
        (-1.0, 1.0),
    ] {
        assert_eq!(good.to_scan(min_m, max_m), None);
    }
}

type Telegrams = Vec<Vec<u8>>;

/// Telegrams of a capture: those of the host, those of the device.
fn telegrams(capture: &Path) -> [Telegrams; 2] {
    let packets: serde_json::Value = serde_json::from_slice(&fs::read(capture).unwrap()).unwrap();
    let payload = |packet: &serde_json::Value| {
        hex(packet["_source"]["layers"]["tcp"]["tcp.payload"]
            .as_str()
            .unwrap())
    };
    let is_request = |payload: &Vec<u8>| {
        payload[10] == b'N' && &payload[8..11] != b"sSN" && &payload[8..11] != b"sAN"
    };
    let packets = packets.as_array().unwrap().iter().map(payload);
    let (sent, received) = packets.partition(is_request);
    [sent, received]
}

/// All values of a scan as `tests/python/decode_sick_cola.py` prints them.
fn line(scan: &ScanData) -> String {
    let mut words = vec![
        scan.serial_number,
        scan.status.0[0].into(),
        scan.status.0[1].into(),
        scan.telegram_counter.into(),
        scan.scan_counter.into(),
        scan.power_up_time_us,
        scan.transmission_time_us,
    ];
    words.extend(scan.inputs_outputs.map(u32::from));
    words.push(scan.frequency_centihertz);
    for channel in &scan.channels {
        words.extend(channel.content.bytes().map(u32::from));
        words.extend([channel.scale.to_bits(), channel.offset.to_bits()]);
        words.extend([
            channel.start_deg_e4.cast_unsigned(),
            channel.step_deg_e4.into(),
        ]);
        words.extend(channel.values.iter().map(|value| u32::from(*value)));
    }
    let time = scan.details.as_ref().unwrap().time.unwrap();
    words.push(time.year.into());
    words.extend(time.month_to_second.map(u32::from));
    words.push(time.microsecond);
    let words = words.iter().map(u32::to_string).collect::<Vec<_>>();
    words.join(" ") + "\n"
}

struct Capture {
    scans: Vec<ScanData>,
    others: Vec<Message>,
    unknown: u64,
}

fn replies_of(telegrams: &[Vec<u8>]) -> Capture {
    let (messages, dropped) = decode_in(SickColaDecoder::default(), &telegrams.concat(), &[1460]);
    let unknown = dropped.count(DropReason::UnknownKind);
    assert_eq!(dropped.iter().count(), 1, "{dropped:?}");
    assert_eq!(messages.len() as u64 + unknown, telegrams.len() as u64);
    let mut capture = Capture {
        scans: Vec::new(),
        others: Vec::new(),
        unknown,
    };
    for message in messages {
        match message {
            Message::Scan(scan) => capture.scans.push(*scan),
            other => capture.others.push(other),
        }
    }
    capture
}

fn check_others(others: &[Message], firmware: &str, range: Sector, config: ScanDataConfig) {
    let ok = |request| Message::Answer {
        request,
        result: Ok(()),
    };
    let expected = [
        ok("SetAccessMode"),
        ok("EIHstCola"),
        Message::FirmwareVersion(firmware.into()),
        Message::DeviceState(DeviceState::Busy),
        Message::LocationName("not defined".into()),
        Message::OutputRange(range),
        ok("LMPoutputRange"),
        Message::OutputRange(range),
        ok("LMDscandatacfg"),
        Message::ScanDataConfig(config),
        ok("LMCstartmeas"),
        ok("Run"),
        Message::Subscribed(true),
    ];
    assert_eq!(others, expected);
}

/// The requests of a capture that are asked for here.
fn check_requests(sent: &[Vec<u8>], password_hash: u32, range: Sector, config: ScanDataConfig) {
    let expected = [
        Request::Login {
            level: 3,
            password_hash,
        },
        Request::SetCoding(Coding::B),
        Request::ReadFirmwareVersion,
        Request::ReadDeviceState,
        Request::ReadLocationName,
        Request::ReadOutputRange,
        Request::SetOutputRange(range),
        Request::ReadOutputRange,
        Request::SetScanDataConfig(config),
        Request::ReadScanDataConfig,
        Request::StartMeasuring,
        Request::Run,
        Request::Subscribe(true),
    ];
    let mut rest = sent.iter();
    for request in expected {
        let bytes = request.to_bytes(Coding::B);
        assert!(rest.any(|sent| *sent == bytes), "{request:?}");
    }
}

#[test]
fn capture_of_an_lms111() {
    let Some(folder) = shared_data("sick") else {
        return;
    };
    let path = folder.join("20210302_lms111.pcapng.json");
    let [sent, received] = telegrams(&path);
    let range = Sector {
        resolution_deg_e4: 5000,
        start_deg_e4: -449_997,
        stop_deg_e4: 2_250_000 - 3,
    };
    let config = ScanDataConfig {
        rssi: false,
        rssi_16_bit: false,
        ..SCAN_DATA_CONFIG
    };
    check_requests(&sent, 0xF472_4744, range, config);
    let capture = replies_of(&received);
    check_others(&capture.others, "V1.80.2  ", range, config);
    assert_eq!((capture.scans.len(), capture.unknown), (175, 40));
    let first = &capture.scans[0];
    assert_eq!(first.serial_number, 0x0114_097A);
    assert_eq!(first.channels[0].values[..4], [93, 80, 86, 89]);
    assert_eq!(first.channels[0].values.len(), 541);
    let busy = |scan: &&ScanData| scan.status == ScanStatus([1, 0]);
    assert_eq!(capture.scans.iter().filter(busy).count(), 7);

    let scan = first.to_scan(0.05, 20.0).unwrap();
    assert_eq!(scan.ranges_m[..2], [0.093, 0.08]);
    assert!((scan.angle_min_rad + 0.75 * PI).abs() < 1e-6);
    assert!((scan.angle_increment_rad - PI / 360.0).abs() < 1e-9);
    assert!((scan.time_increment_s - 1.0 / 36_000.0).abs() < 1e-9);

    let lines = capture.scans.iter().map(line).collect::<String>();
    if let Some(expected) = second_decoder("decode_sick_cola.py", &path) {
        assert_eq!(lines, expected);
    }
    // The same scans as text.
    let text = fs::read_to_string(folder.join("20210302_lms111.scandata.txt")).unwrap();
    let (messages, dropped) = decode_in(SickColaDecoder::default(), &hex(&text), &[1000]);
    assert_eq!(dropped, Dropped::default());
    let scans = capture
        .scans
        .into_iter()
        .map(|scan| Message::Scan(Box::new(scan)));
    assert_eq!(messages, scans.collect::<Vec<_>>());
}

#[test]
fn capture_of_a_tim781s() {
    let Some(folder) = shared_data("sick") else {
        return;
    };
    let path = folder.join("20210125-tim781s-scandata.pcapng.json");
    let [sent, received] = telegrams(&path);
    let range = Sector {
        resolution_deg_e4: 3333,
        start_deg_e4: -450_000,
        stop_deg_e4: 2_250_000,
    };
    check_requests(&sent, 0x6FD6_2C05, range, SCAN_DATA_CONFIG);
    let capture = replies_of(&received);
    check_others(&capture.others, "V3.13", range, SCAN_DATA_CONFIG);
    assert_eq!((capture.scans.len(), capture.unknown), (140, 58));
    let first = &capture.scans[0];
    assert_eq!(first.serial_number, 0x0119_FD06);
    assert_eq!(first.channels[0].values[..3], [1356, 1382, 1435]);
    let contents = first
        .channels
        .iter()
        .map(|channel| channel.content.as_str());
    assert_eq!(contents.collect::<Vec<_>>(), ["DIST1", "RSSI1"]);

    let scan = first.to_scan(0.05, 25.0).unwrap();
    assert_eq!((scan.ranges_m[0], scan.ranges_m.len()), (1.356, 811));
    let last_rad = scan.angle_min_rad + 810.0 * scan.angle_increment_rad;
    assert!((last_rad - 0.75 * PI).abs() < 1e-5, "{last_rad}");
    assert!((scan.time_increment_s - 1.0 / 16_200.0).abs() < 1e-9);

    let lines = capture.scans.iter().map(line).collect::<String>();
    if let Some(expected) = second_decoder("decode_sick_cola.py", &path) {
        assert_eq!(lines, expected);
    }
}

fn any_telegrams() -> impl Strategy<Value = Vec<u8>> {
    let coding = prop_oneof![Just(Coding::A), Just(Coding::B)];
    let distances = prop::collection::vec(any::<u16>(), 0..40);
    let scan = (coding, distances)
        .prop_map(|(coding, distances)| telegram(coding, "sSN LMDscandata", &lms5xx(&distances)));
    let reply = prop_oneof![
        Just(text("sAN Run 1")),
        Just(framed(b"sFA\x00\x01")),
        Just(text("sRA LMPscancfg 1388 1 1388 FFF92230 225510")),
        Just(framed(
            b"sRA DeviceIdent \x00\x08MRS6124R\x00\x0a1.1.0.565C"
        )),
    ];
    let telegram = prop_oneof![2 => scan, 1 => reply];
    prop::collection::vec(telegram, 0..8).prop_map(|telegrams| telegrams.concat())
}

fn check(message: &Message) -> Result<(), TestCaseError> {
    let Message::Scan(data) = message else {
        return Ok(());
    };
    prop_assert!(data.channels.len() <= 2 * MAX_CHANNELS);
    prop_assert!(data.encoders.len() <= MAX_ENCODERS);
    for channel in &data.channels {
        prop_assert!(channel.scale.is_finite() && channel.offset.is_finite());
        prop_assert!(channel.values.len() <= MAX_PAYLOAD);
    }
    if let Some(scan) = data.to_scan(0.05, 20.0) {
        prop_assert!(scan.sweep_duration().is_some(), "{scan:?}");
        for range in &scan.ranges_m {
            let is_range = range.is_nan() || *range == f32::INFINITY;
            prop_assert!(is_range || (0.05..20.0).contains(range), "{range}");
        }
    }
    Ok(())
}

proptest! {
    #[test]
    fn damage_neither_panics_nor_gives_senseless_scans(
        telegrams in any_telegrams(),
        damage in damage(b"\x02\x03sAN \x00"),
    ) {
        for message in damage.decode(SickColaDecoder::default, telegrams) {
            check(&message)?;
        }
    }

    #[test]
    fn any_values_give_possible_scans_or_none(values in prop::collection::vec(any::<u8>(), 0..300)) {
        let payload = [&b"sSN LMDscandata "[..], &values].concat();
        let (messages, _) = decode(SickColaDecoder::default(), &framed(&payload));
        for message in &messages {
            check(message)?;
        }
    }
}
