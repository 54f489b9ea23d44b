use std::f64::consts::PI;
use std::fs;

use proptest::prelude::*;

use super::*;
use crate::shared_data::shared_data;
use crate::test_decoding::*;

/// Packets of an `MTi-300`: Scottapotamas/xsens-mti, `test/test_xsens_mti_parse_messages.c` at 21350e9.
const QUATERNION_PACKET: &str = "FAFF3626102002468210600401C4FC3E2010103F71CE6CBEA56BCF3C613BD8BD69\
    1D25E020040040000312";
const SHAKEN_PACKET: &str = "FAFF368B102002FB8510600401A498DE2010103F2A1463BED7EFA73CDEE5083F1DCEC9\
    40200CC1F246C3C1ECE076C28F853F40100CBD932CCCBD920A16BE3A6EEC40300C42519464C27B5A5AC1CCC0AE80200C\
    40854D6DC125559EC0908E1F8030103F7FF8983BAA9EE5BC539EC0BBB9060CC0200C3EDC7439BE752B483FAF9A3F3010\
    04000186DEE02004004814018E";
const FORMATS_PACKET: &str = "FAFF36511020023BDD20310CFFF04735FFFDC886073B35C88032180000000100\
    01FFE3E0C4FFFFFFEC2595FFFFFFF464E8FFFFC023183FEAAE0FC0000000BFDBC9A7600000003FF9E2062000000008\
    100441DB8000AC";
const FORMATS_PACKET_2: &str = "FAFF3637102002FE782010103F250C01BBCC0DD7BB22740C3F43AF57C0210C\
    000F6422FFFBD622001C800308120660000000001830130400018D2546";

fn data(packet: &str) -> Data {
    match &decode(XsensDecoder::default(), &hex(packet)).0[..] {
        [Message::Data(data)] => data.clone(),
        other => panic!("{other:?}"),
    }
}

/// A message with payload of any length.
fn framed(identifier: u8, payload: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xFA, 0xFF, identifier, 0xFF];
    frame.extend((payload.len() as u16).to_be_bytes());
    frame.extend(payload);
    frame.push(sum(&frame).wrapping_neg());
    frame
}

/// `PacketCounter`, `1`, `X`, … → numbers of the decoded text.
type GoldenItem = (String, Vec<(String, String)>);

fn golden(text: &str) -> Vec<Vec<GoldenItem>> {
    let mut messages = vec![vec![]];
    for line in text.lines() {
        let last: &mut Vec<GoldenItem> = messages.last_mut().unwrap();
        if line.is_empty() {
            messages.push(vec![]);
        } else if let Some(value) = line.strip_prefix("  ") {
            let (name, value) = match value.split_once(':') {
                Some((name, value))
                    if name.chars().all(char::is_alphanumeric) && !name.starts_with("20") =>
                {
                    (name, value)
                }
                _ => ("", value),
            };
            let entry = (name.to_owned(), value.to_owned());
            last.last_mut().unwrap().1.push(entry);
        } else {
            last.push((line.trim_end_matches(':').to_owned(), vec![]));
        }
    }
    messages.retain(|items| !items.is_empty());
    messages
}

/// An item as the decoded text has it: name and numbers in the units of the manual.
fn described(item: &Item) -> (&'static str, Vec<f64>) {
    let degrees = |angle: &f64| angle.to_degrees();
    match item {
        Item::Utc(utc) => ("UTCTime", utc_numbers(utc)),
        Item::PacketCounter(count) => ("PacketCounter", vec![(*count).into()]),
        Item::SampleTimeFine(time) => ("SampleTimeFine", vec![(*time).into()]),
        Item::EulerRad(EarthFrame::EastNorthUp, angles) => {
            ("EulerAngles", angles.iter().map(degrees).collect())
        }
        Item::DeltaVMps(v) => ("DeltaV", v.to_vec()),
        Item::AccelerationMps2(v) => ("Acceleration", v.to_vec()),
        Item::RateOfTurnRadps(v) => ("RateOfTurn", v.to_vec()),
        Item::DeltaQ(q) => ("DeltaQ", q.to_vec()),
        Item::AltitudeM(altitude) => ("AltitudeEllipsoid", vec![*altitude]),
        Item::LatLonDeg(position) => ("LatLon", position.to_vec()),
        Item::VelocityMps(EarthFrame::EastNorthUp, v) => ("VelocityXYZ", v.to_vec()),
        Item::Status(bits) => ("Status", vec![(*bits).into()]),
        Item::Gnss(pvt) => ("GNSSPVTData", pvt_numbers(pvt)),
        other => panic!("{other:?} is not in the captures"),
    }
}

fn utc_numbers(utc: &Utc) -> Vec<f64> {
    let Utc {
        year,
        month,
        day,
        hour,
        minute,
        second,
        nanosecond,
        ..
    } = *utc;
    let date = [year, month.into(), day.into(), hour.into(), minute.into()].map(f64::from);
    let seconds = f64::from(second) + f64::from(nanosecond) * 1e-9;
    date.into_iter().chain([seconds]).collect()
}

fn pvt_numbers(pvt: &GnssPvt) -> Vec<f64> {
    let (at, velocity, utc) = (&pvt.position, &pvt.velocity, &pvt.utc);
    let mut numbers = vec![
        pvt.time_of_week_ms.into(),
        utc.year.into(),
        utc.month.into(),
        utc.day.into(),
        utc.hour.into(),
        utc.minute.into(),
        utc.second.into(),
        utc.valid.into(),
        pvt.utc_accuracy_ns.into(),
        utc.nanosecond.into(),
        pvt.fix_type.into(),
        pvt.flags.into(),
        pvt.satellites.into(),
        0.0, // reserved
        at.longitude_deg * 1e7,
        at.latitude_deg * 1e7,
        at.height_above_ellipsoid_m * 1e3,
        at.height_above_sea_m * 1e3,
        at.horizontal_accuracy_m * 1e3,
        at.vertical_accuracy_m * 1e3,
    ];
    numbers.extend(velocity.ned_mps.map(|speed| speed * 1e3));
    numbers.extend([
        velocity.ground_speed_mps * 1e3,
        velocity.heading_of_motion_rad.to_degrees() * 1e5,
        velocity.speed_accuracy_mps * 1e3,
        velocity.heading_accuracy_rad.to_degrees() * 1e5,
        // Not valid in the captures: the field is not compared.
        velocity
            .heading_of_vehicle_rad
            .map_or(131_072.0, |_| f64::NAN),
    ]);
    numbers.extend(pvt.dilution.map(|dilution| dilution * 100.0));
    numbers
}

#[test]
fn every_field_of_the_captures_is_as_their_decoded_text_has_it() {
    let Some(folder) = shared_data("xsens") else {
        return;
    };
    let mut values = 0;
    for capture in ["1", "2", "3"] {
        let folder = folder.join(capture);
        let (messages, dropped) = decode(
            XsensDecoder::default(),
            &fs::read(folder.join("output.bin")).unwrap(),
        );
        assert_eq!((messages.len(), dropped), (100, Dropped::default()));
        let texts = golden(&fs::read_to_string(folder.join("output.golden")).unwrap());
        assert_eq!(texts.len(), 100);
        for (message, text) in messages.iter().zip(texts) {
            let Message::Data(data) = message else {
                panic!("{message:?}")
            };
            assert_eq!(data.items.len(), text.len());
            for (item, (label, expected)) in data.items.iter().zip(text) {
                let (name, numbers) = described(item);
                let base = label.split('(').next().unwrap();
                assert_eq!(name, base.trim_end_matches("Byte").trim_end_matches("Word"));
                let expected: Vec<f64> = match base {
                    "UTCTime" => expected[0]
                        .1
                        .trim_end_matches('Z')
                        .split(['-', 'T', ':'])
                        .map(|n| n.parse().unwrap())
                        .collect(),
                    "StatusByte" | "StatusWord" => {
                        vec![u32::from_str_radix(&expected[0].1, 2).unwrap().into()]
                    }
                    _ => expected.iter().map(|(_, n)| n.parse().unwrap()).collect(),
                };
                assert_eq!(numbers.len(), expected.len(), "{label}");
                for (number, expected) in numbers.iter().zip(expected) {
                    let error = (number - expected).abs();
                    assert!(
                        error <= 1e-15 * expected.abs().max(1e-9)
                            || error < 1e-6 && name == "GNSSPVTData"
                            || error < 1e-12 && name != "DeltaV",
                        "{label}: {number} {expected}"
                    );
                    values += 1;
                }
            }
        }
    }
    assert_eq!(values, 9_135);
}

#[test]
fn the_captures_give_attitude_rates_and_position() {
    let Some(folder) = shared_data("xsens") else {
        return;
    };
    for (capture, fixes) in [("1", 76), ("2", 88), ("3", 74)] {
        let (messages, _) = decode(
            XsensDecoder::default(),
            &fs::read(folder.join(capture).join("output.bin")).unwrap(),
        );
        let data = messages.iter().map(|message| match message {
            Message::Data(data) => data,
            other => panic!("{other:?}"),
        });
        let imu: Vec<ImuSample> = data.clone().filter_map(Data::imu).collect();
        assert_eq!(imu.len(), 96);
        // The filter is not valid in any of them.
        assert!(imu.iter().all(|imu| imu.orientation_xyzw.is_none()));
        // Nevertheless roll and pitch are right: at rest they turn the measured force upwards.
        let mut attitudes = 0;
        for data in data.clone().skip(4) {
            let (mut attitude, mut force) = (None, None);
            for item in &data.items {
                match *item {
                    Item::EulerRad(frame, angles) => {
                        attitude = enu_attitude(frame, quaternion(angles));
                    }
                    Item::AccelerationMps2(vector) => force = Some(vector),
                    _ => {}
                }
            }
            if let (Some(attitude), Some(force)) = (attitude, force) {
                let up = turned(attitude, force);
                assert!(
                    up[2] > 9.7 && up[0].abs() < 0.4 && up[1].abs() < 0.4,
                    "{up:?}"
                );
                attitudes += 1;
            }
        }
        assert!(attitudes >= 91, "{attitudes}");
        let fix: Vec<GeodeticFix> = data.clone().filter_map(Data::fix).collect();
        assert_eq!(fix.len(), fixes);
        for fix in fix {
            assert!(
                (fix.latitude_deg - 57.6794).abs() < 1e-3 && fix.status == 0,
                "{fix:?}"
            );
            assert!((fix.longitude_deg - 11.8826).abs() < 1e-3 && fix.altitude_m > 50.0);
        }
        let receiver = data
            .flat_map(|data| &data.items)
            .find_map(|item| match item {
                Item::Gnss(pvt) => Some(pvt.fix()),
                _ => None,
            });
        assert!((receiver.unwrap().latitude_deg - 57.679445).abs() < 1e-4);
        assert_eq!(receiver.unwrap().status, 0);
    }
}

#[test]
fn output_configurations_of_the_captures_are_parsed_and_made() {
    let Some(folder) = shared_data("xsens") else {
        return;
    };
    for capture in ["1", "2", "3"] {
        let payload = fs::read(folder.join(capture).join("outputconfig.bin")).unwrap();
        let (messages, _) = decode(
            XsensDecoder::default(),
            &request(OUTPUT_CONFIGURATION + 1, &payload),
        );
        let [Message::OutputConfiguration(settings)] = &messages[..] else {
            panic!("{messages:?}")
        };
        assert_eq!(settings.len(), 13);
        assert_eq!(
            settings[0],
            OutputSetting {
                data_id: data_id::PACKET_COUNTER,
                rate_hz: 0xFFFF
            }
        );
        assert_eq!(
            settings[12],
            OutputSetting {
                data_id: data_id::GNSS_PVT_DATA,
                rate_hz: 4
            }
        );
        assert_eq!(
            set_output_configuration(settings),
            Some(request(OUTPUT_CONFIGURATION, &payload))
        );
    }
}

#[test]
fn items_of_published_packets_are_decoded() {
    let close = |a: &[f64], b: &[f64]| {
        assert_eq!(a.len(), b.len());
        for (a, b) in a.iter().zip(b) {
            assert!((a - b).abs() < 5e-7 * b.abs().max(1.0), "{a} {b}");
        }
    };
    let shaken = data(SHAKEN_PACKET);
    let [
        Item::PacketCounter(64389),
        Item::SampleTimeFine(27_564_254),
        Item::Quaternion(EarthFrame::EastNorthUp, attitude),
        Item::AccelerationMps2(force),
        Item::DeltaVMps(delta_v),
        Item::FreeAccelerationMps2(free),
        Item::RateOfTurnRadps(rates),
        Item::DeltaQ(delta_q),
        Item::MagneticField(field),
        Item::PressurePa(100_062),
        Item::Status(0b0000_0000_0100_1000_0001_0100_0000_0001),
    ] = &shaken.items[..]
    else {
        panic!("{shaken:?}")
    };
    close(attitude, &[0.66437358, -0.42175028, 0.02720882, 0.61643654]);
    close(force, &[-30.28455162, -29.60960007, -71.76024628]);
    close(delta_v, &[-0.07186279, -0.07130830, -0.18206376]);
    close(free, &[52.39491272, -62.83823395, -25.59408188]);
    close(rates, &[4.16570139, -10.33340263, -4.51734877]);
    close(delta_q, &[0.99988699, 0.00520693, -0.01291627, -0.00564647]);
    close(field, &[0.43057421, -0.23942292, 1.37189472]);
    assert_eq!(
        shaken.imu().unwrap().orientation_xyzw,
        None,
        "the filter is not valid"
    );

    let formats = data(FORMATS_PACKET);
    let [
        Item::PacketCounter(15325),
        Item::EulerRad(EarthFrame::EastNorthUp, angles),
        Item::DeltaQ(delta_q),
        Item::MagneticField(field),
        Item::TemperatureC(27.4375),
    ] = &formats.items[..]
    else {
        panic!("{formats:?}")
    };
    close(
        &angles.map(f64::to_degrees),
        &[-0.9826155, -0.1385441, 115.7006302],
    );
    let exact = [
        1.000000000233,
        -0.000429107808,
        -0.000302935718,
        -0.000177090988,
    ];
    assert!(
        delta_q
            .iter()
            .zip(exact)
            .all(|(a, b)| (a - b).abs() < 5e-13)
    );
    let exact = [0.833747744560242, -0.434182971715927, 1.617681622505188];
    assert!(field.iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-15));

    let formats = data(FORMATS_PACKET_2);
    let [
        Item::PacketCounter(65144),
        Item::Quaternion(..),
        Item::MagneticField(field),
        Item::TemperatureC(24.375),
        Item::PressurePa(101_669),
    ] = &formats.items[..]
    else {
        panic!("{formats:?}")
    };
    close(field, &[0.9619465, -0.2602215, 1.7812529]);
    assert_eq!(formats.imu(), None, "without rates and forces");
}

#[test]
fn requests_and_replies_are_those_of_the_vendors_program() {
    // docs/mtmanager_packets.md: bytes that the program wrote and received.
    assert_eq!(go_to_config(), hex("FAFF3000D1"));
    assert_eq!(go_to_measurement(), hex("FAFF1000F1"));
    assert_eq!(request_device_id(), hex("FAFF000001"));
    let written = "1020FFFF1060FFFF2010019040200190401001904030019080200190803001 90C0200064 0810000A\
        30100032E020FFFF";
    let entry = |&[a, b, c, d]: &[u8; 4]| OutputSetting {
        data_id: u16::from_be_bytes([a, b]),
        rate_hz: u16::from_be_bytes([c, d]),
    };
    let written_bytes = hex(written);
    let entries: Vec<OutputSetting> = written_bytes.as_chunks().0.iter().map(entry).collect();
    let expected = [hex("FAFFC030"), hex(written), vec![0x99]].concat();
    assert_eq!(set_output_configuration(&entries), Some(expected));
    assert_eq!(set_output_configuration(&[entries[0]; 33]), None);
    for (reply, expected) in [
        ("FAFF3100D0", Message::Configuring),
        ("FAFF1100F0", Message::Measuring),
        ("FAFF3E00C3", Message::WakeUp),
        // einride/xsens-go message_test.go at 1deccedc
        ("FAFF420104BA", Message::Error(4)),
        ("FAFF0104037003F88E", Message::DeviceId(0x0370_03F8)),
        (
            "FAFFC1081020FFFF1060FFFF9C",
            Message::OutputConfiguration(
                [data_id::PACKET_COUNTER, data_id::SAMPLE_TIME_FINE]
                    .map(|data_id| OutputSetting {
                        data_id,
                        rate_hz: 0xFFFF,
                    })
                    .to_vec(),
            ),
        ),
    ] {
        assert_eq!(
            decode(XsensDecoder::default(), &hex(reply)),
            (vec![expected], Dropped::default()),
            "{reply}"
        );
    }
    assert_eq!(error_meaning(4), "invalid message");
}

/// The vector, turned by the quaternion (x, y, z, w).
fn turned([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let once = cross([x, y, z], v);
    let twice = cross([x, y, z], once);
    std::array::from_fn(|i| v[i] + 2.0 * (w * once[i] + twice[i]))
}

#[test]
#[expect(clippy::float_cmp, reason = "the numbers are exact")]
fn attitudes_of_all_earth_frames_agree_in_enu() {
    // The sensor's x points north and its z up, in each frame.
    for (frame, yaw, roll) in [
        (EarthFrame::EastNorthUp, PI / 2.0, 0.0),
        (EarthFrame::NorthWestUp, 0.0, 0.0),
        (EarthFrame::NorthEastDown, 0.0, PI),
    ] {
        let attitude = enu_attitude(frame, quaternion([roll, 0.0, yaw])).unwrap();
        let expected = [
            ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
            ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
        ];
        for (axis, enu) in expected {
            let axis = turned(attitude, axis);
            assert!(
                (0..3).all(|i| (axis[i] - enu[i]).abs() < 1e-12),
                "{frame:?} {axis:?}"
            );
        }
    }
    assert_eq!(
        EarthFrame::NorthEastDown.to_enu([1.0, 2.0, 3.0]),
        [2.0, 1.0, -3.0]
    );
    assert_eq!(
        EarthFrame::NorthWestUp.to_enu([1.0, 2.0, 3.0]),
        [-2.0, 1.0, 3.0]
    );
    assert_eq!(
        enu_attitude(EarthFrame::EastNorthUp, [0.5; 4]).unwrap(),
        [0.5; 4]
    );
    assert_eq!(enu_attitude(EarthFrame::EastNorthUp, [0.6; 4]), None);
    // Roll, pitch, yaw in this order about fixed axes: x goes to -z by a pitch of 90°, whatever the roll.
    let [w, x, y, z] = quaternion([1.0, PI / 2.0, 0.0]);
    let nose = turned([x, y, z, w], [1.0, 0.0, 0.0]);
    assert!((nose[2] + 1.0).abs() < 1e-12, "{nose:?}");
}

#[test]
fn items_with_a_coordinate_system_keep_it() {
    for (id, frame) in [
        (0xD010_u16, EarthFrame::EastNorthUp),
        (0xD014, EarthFrame::NorthEastDown),
        (0xD018, EarthFrame::NorthWestUp),
    ] {
        let content = [1.0_f32, 2.0, 3.0].map(f32::to_be_bytes).concat();
        assert_eq!(
            item(id, &content),
            Ok(Item::VelocityMps(frame, [1.0, 2.0, 3.0]))
        );
    }
    assert_eq!(item(0xD01C, &[0; 12]), Err(DropReason::Field));
}

#[test]
fn bad_input_is_counted_and_the_next_message_is_found() {
    let good = hex(QUATERNION_PACKET);
    let mut broken = good.clone();
    broken[10] ^= 1;
    let header_before = [&good[..20], &good].concat();
    let item_too_long = request(MT_DATA2, &[0x10, 0x20, 3, 0, 0]);
    let nan = [&[0x08, 0x10, 4][..], &f32::NAN.to_be_bytes()].concat();
    let off_earth = [
        &[0x50, 0x40, 8][..],
        &[91.0_f32, 0.0].map(f32::to_be_bytes).concat(),
    ]
    .concat();
    let no_date = hex("10100C 00000000 07E3 0D 01 00 00 00 07");
    let short_item = request(MT_DATA2, &[0x10, 0x20, 1, 0]);
    let cases: Vec<Case<'_>> = vec![
        (
            "garbage",
            vec![1, 2, 0xFA, 3],
            &[(DropReason::Garbage, 4)],
            0,
        ),
        ("preamble twice", vec![0xFA], &[(DropReason::Garbage, 1)], 0),
        (
            "flipped bit",
            broken,
            &[(DropReason::Garbage, 42), (DropReason::Checksum, 1)],
            0,
        ),
        (
            "cut off",
            header_before[..20].to_vec(),
            &[(DropReason::Garbage, 19), (DropReason::Checksum, 1)],
            0,
        ),
        (
            "too long",
            hex("FAFF36FF0801"),
            &[(DropReason::Garbage, 5), (DropReason::Length, 1)],
            0,
        ),
        (
            "item beyond the end",
            item_too_long,
            &[(DropReason::Garbage, 9), (DropReason::Length, 1)],
            0,
        ),
        (
            "unknown message",
            hex("FAFF8F0072"),
            &[(DropReason::UnknownKind, 1)],
            0,
        ),
        (
            "reply of wrong length",
            framed(0x31, &[0]),
            &[(DropReason::Garbage, 7), (DropReason::Length, 1)],
            0,
        ),
        (
            "not a number",
            request(MT_DATA2, &nan),
            &[(DropReason::Field, 1)],
            1,
        ),
        (
            "off the Earth",
            request(MT_DATA2, &off_earth),
            &[(DropReason::Field, 1)],
            1,
        ),
        (
            "month 13",
            request(MT_DATA2, &no_date),
            &[(DropReason::Field, 1)],
            1,
        ),
        ("short item", short_item, &[(DropReason::Length, 1)], 1),
        (
            "unknown item",
            request(MT_DATA2, &[0x99, 0x90, 0]),
            &[(DropReason::UnknownKind, 1)],
            1,
        ),
    ];
    for (name, before, drops, empty) in cases {
        let (messages, dropped) = decode(XsensDecoder::default(), &[&before[..], &good].concat());
        assert_eq!(dropped.iter().collect::<Vec<_>>(), drops, "{name}");
        assert_eq!(messages.len(), empty + 1, "{name}");
        assert_eq!(
            messages[..empty],
            vec![Message::Data(Data::default()); empty],
            "{name}"
        );
        assert_eq!(
            messages.last(),
            decode(XsensDecoder::default(), &good).0.first(),
            "{name}"
        );
    }
}

#[test]
fn an_extended_length_is_read() {
    let item = hex("1020020007");
    let (messages, _) = decode(
        XsensDecoder::default(),
        &framed(MT_DATA2, &item.repeat(300)),
    );
    let items = vec![Item::PacketCounter(7); 300];
    assert_eq!(messages, [Message::Data(Data { items })]);
    // The full length of the manual, and one byte more.
    assert!(
        decode(
            XsensDecoder::default(),
            &framed(MT_DATA2, &[item.repeat(409), vec![0x99, 0x90, 0]].concat())
        )
        .0
        .len()
            == 1
    );
    assert!(
        decode(
            XsensDecoder::default(),
            &framed(MT_DATA2, &[0x99, 0x90, 0].repeat(683))
        )
        .0
        .is_empty()
    );
}

/// Name, bytes before the good message, drops, messages without items.
type Case<'a> = (&'a str, Vec<u8>, &'a [(DropReason, u64)], usize);

fn published_packets() -> impl Strategy<Value = Vec<u8>> {
    let packets = [
        QUATERNION_PACKET,
        SHAKEN_PACKET,
        FORMATS_PACKET,
        FORMATS_PACKET_2,
        "FAFF3100D0",
    ];
    let packet = prop::sample::select(packets.map(hex).to_vec());
    prop::collection::vec(packet, 0..12).prop_map(|packets| packets.concat())
}

fn assert_invariants(message: &Message) {
    let Message::Data(data) = message else { return };
    if let Some(imu) = data.imu() {
        let numbers = imu
            .angular_velocity_radps
            .into_iter()
            .chain(imu.linear_acceleration_mps2);
        assert!(numbers.into_iter().all(f64::is_finite));
        if let Some(q) = imu.orientation_xyzw {
            let norm: f64 = q.iter().map(|part| part * part).sum();
            assert!((norm - 1.0).abs() < 1e-9, "{q:?}");
        }
    }
    if let Some(fix) = data.fix() {
        assert!(fix.latitude_deg.abs() <= 90.0 && fix.longitude_deg.abs() <= 180.0);
        assert!(fix.altitude_m.is_finite());
    }
}

proptest! {
    #[test]
    fn damage_neither_panics_nor_gives_senseless_values(
        bytes in published_packets(),
        damage in damage(b"\xFA\xFF\x36"),
    ) {
        let messages = damage.decode(XsensDecoder::default, bytes);
        messages.iter().for_each(assert_invariants);
    }

    #[test]
    fn any_payload_is_survived(identifier: u8, payload in prop::collection::vec(any::<u8>(), 0..300)) {
        let (messages, _) = decode(XsensDecoder::default(), &framed(identifier, &payload));
        messages.iter().for_each(assert_invariants);
    }

    #[test]
    fn any_item_is_survived(
        id in prop::sample::select(vec![0x0810_u16, 0x1010, 0x2010, 0x2030, 0x4020, 0x5020, 0x5040, 0x7010, 0x8020, 0xC020, 0xD010, 0xE010]),
        low in 0..16_u16,
        content in prop::collection::vec(any::<u8>(), 0..100),
        good in any::<bool>(),
    ) {
        let length = match (id, good) { (0x7010, true) => 94, (0x1010, true) => 12, _ => content.len() };
        let mut content = content;
        content.resize(length, 0);
        let item = [&(id | low).to_be_bytes()[..], &[length as u8], &content].concat();
        let (messages, _) = decode(XsensDecoder::default(), &framed(MT_DATA2, &item));
        prop_assert_eq!(messages.len(), 1);
        messages.iter().for_each(assert_invariants);
    }
}
