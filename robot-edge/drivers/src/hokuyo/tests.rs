use proptest::prelude::*;

use super::*;
use crate::Dropped;
use crate::test_decoding::*;

/// Manual, section 8.12, without the spaces of its typography.
const URG_PARAMETERS: &[u8] =
    b"PP\n00P\nMODL:URG-04LX(Hokuyo Automatic Co., Ltd.);n\nDMIN:20;4\nDMAX:5600;_\n\
    ARES:1024;\\\nAMIN:44;7\nAMAX:725;o\nAFRT:384;6\nSCAN:600;e\n\n";

/// What a UTM-30LX-EW replies, as a comment of a public driver has it.
const UTM_PARAMETERS: &[u8] =
    b"PP\n00P\nMODL:UTM-30LX-EW;I\nDMIN:23;7\nDMAX:60000;J\nARES:1440;^\n\
    AMIN:0;?\nAMAX:1080;Z\nAFRT:540;0\nSCAN:2400;U\n\n";

fn parameters_of(bytes: &[u8]) -> Parameters {
    match decode_one(HokuyoDecoder::default(), bytes) {
        Message::Parameters(parameters) => parameters,
        other => panic!("{other:?}"),
    }
}

/// A line with its sum, counted apart from the code under test.
fn line(content: &str) -> String {
    let sum: u32 = content.bytes().map(u32::from).sum();
    format!("{content}{}\n", char::from((sum % 64 + 48) as u8))
}

fn characters(number: u32, length: u32) -> String {
    let digit = |at| char::from((number / 64_u32.pow(length - 1 - at) % 64 + 48) as u8);
    (0..length).map(digit).collect()
}

fn reply_with(request: &str, status: &str, time_ms: u32, data: &str) -> Vec<u8> {
    let blocks = data.as_bytes().chunks(64);
    let blocks = blocks.map(|block| line(std::str::from_utf8(block).unwrap()));
    let blocks = blocks.collect::<String>();
    let (status, time) = (line(status), line(&characters(time_ms, 4)));
    format!("{request}\n{status}{time}{blocks}\n").into_bytes()
}

#[test]
fn numbers_of_the_manual() {
    for (text, expected) in [("CB", 1234), ("1Dh", 5432), ("m2@0", 16_000_000)] {
        let decoded = number(text.as_bytes(), text.len());
        assert_eq!(decoded.ok(), Some(expected), "{text}");
        assert_eq!(characters(expected, text.len() as u32), text);
    }
    assert!(number(b"C~", 2).is_err());
}

#[test]
fn parameters_are_decoded() {
    let urg = parameters_of(URG_PARAMETERS);
    assert_eq!(
        urg,
        Parameters {
            model: "URG-04LX(Hokuyo Automatic Co., Ltd.)".into(),
            distance_min_mm: 20,
            distance_max_mm: 5600,
            steps_per_turn: 1024,
            first_step: 44,
            last_step: 725,
            front_step: 384,
            turns_per_min: 600,
        }
    );
    let utm = parameters_of(UTM_PARAMETERS);
    assert_eq!((utm.steps(), utm.front_step), (0..=1080, 540));
    assert_eq!((utm.distance_min_mm, utm.distance_max_mm), (23, 60_000));
}

#[test]
fn impossible_parameters_are_dropped() {
    for (key, value) in [
        ("ARES", "0"),
        ("ARES", "4097"),
        ("ARES", "681"),
        ("AMIN", "385"),
        ("AMAX", "383"),
        ("AMAX", "-1"),
        ("AMAX", "70000"),
        ("AFRT", "726"),
        ("SCAN", "0"),
        ("SCAN", "nan"),
        ("DMIN", "5600"),
        ("DMAX", "262144"),
        ("XXXX", "1"),
    ] {
        let text = std::str::from_utf8(URG_PARAMETERS).unwrap();
        let changed = |old: &str| match old.split_once(':') {
            Some((found, _)) if found == key || (key == "XXXX" && found == "MODL") => {
                let content = format!("{key}:{value}");
                line(&content).replace(&content, &format!("{content};"))
            }
            _ => format!("{old}\n"),
        };
        let bytes = text.lines().map(changed).collect::<String>() + "\n";
        let (messages, dropped) =
            decode_in(HokuyoDecoder::default(), bytes.trim_end().as_bytes(), &[9]);
        assert_eq!((messages, dropped), (vec![], Dropped::default()));
        let (messages, dropped) = decode_in(HokuyoDecoder::default(), bytes.as_bytes(), &[9]);
        assert_eq!(messages, [], "{key} {value}");
        assert_eq!(dropped.count(DropReason::Field), 1, "{key} {value}");
    }
}

/// GD of three steps: 5432 mm, error 7, error 0; sums counted by hand.
const THREE_STEPS: &[u8] = b"GD0383038500\n00P\nm2@0?\n1Dh0070004\n\n";

#[test]
fn a_scan_by_hand() {
    let Message::Distances(distances) = decode_one(HokuyoDecoder::default(), THREE_STEPS) else {
        panic!()
    };
    assert_eq!(
        distances,
        Distances {
            start_step: 383,
            end_step: 385,
            cluster: 1,
            step_0_time_ms: 16_000_000,
            encoding: Encoding::Long,
            distances_mm: vec![5432, 7, 0],
        }
    );
    let urg = parameters_of(URG_PARAMETERS);
    let scan = urg.to_scan(&distances).unwrap();
    assert_eq!(scan.ranges_m[..1], [5.432]);
    assert!(scan.ranges_m[1].is_nan() && scan.ranges_m[2].is_nan());
    assert_eq!((scan.range_min_m, scan.range_max_m), (0.02, 5.6));
    assert!((urg.first_beam_delay_s(&distances) - 383.0 / 10_240.0).abs() < 1e-12);
}

/// Angles and times that gbiggs/hokuyoaist prints for a URG-04LX-UG01, its issue 1.
#[test]
fn geometry_of_a_real_sensor() {
    let urg = parameters_of(URG_PARAMETERS);
    let data = characters(1000, 3).repeat(682);
    let bytes = reply_with("MD0044072500000", "99", 4_866_652, &data);
    let Message::Distances(distances) = decode_one(HokuyoDecoder::default(), &bytes) else {
        panic!()
    };
    let scan = urg.to_scan(&distances).unwrap();
    assert_eq!(scan.ranges_m, [1.0; 682]);
    let last_rad = scan.angle_min_rad + 681.0 * scan.angle_increment_rad;
    assert!((scan.angle_min_rad + 2.08621).abs() < 1e-5);
    assert!((last_rad - 2.09235).abs() < 1e-5);
    assert!((scan.angle_increment_rad - 0.006_135_92).abs() < 1e-8);
    assert!((scan.time_increment_s - 0.000_097_656_2).abs() < 1e-10);
    assert!(scan.sweep_duration().is_some());

    let mut beyond = distances.clone();
    beyond.end_step = 726;
    assert_eq!(urg.to_scan(&beyond), None);
    let mut before = distances;
    before.start_step = 43;
    assert_eq!(urg.to_scan(&before), None);
}

#[test]
fn ranges_without_an_echo_are_infinite() {
    let utm = parameters_of(UTM_PARAMETERS);
    let urg = parameters_of(URG_PARAMETERS);
    let sent = [0, 1, 2, 19, 22, 23, 5599, 5600, 59_999, 60_000, 65_533];
    let data: String = sent.iter().map(|mm| characters(*mm, 3)).collect();
    let Message::Distances(distances) = decode_one(
        HokuyoDecoder::default(),
        &reply_with("GD0100011000", "00", 0, &data),
    ) else {
        panic!()
    };
    // E: error. N: no echo. M: measured.
    for (parameters, expected) in [(&utm, "ENEEEMMMMNN"), (&urg, "EEEEMMMNNNN")] {
        let ranges_m = parameters.to_scan(&distances).unwrap().ranges_m;
        let kinds = ranges_m.iter().zip(sent).map(|(range_m, mm)| {
            if range_m.is_nan() {
                'E'
            } else if *range_m == f32::INFINITY {
                'N'
            } else {
                assert!((f64::from(*range_m) - f64::from(mm) / 1000.0).abs() < 1e-5);
                'M'
            }
        });
        assert_eq!(kinds.collect::<String>(), expected, "{}", parameters.model);
    }
}

#[test]
fn two_characters_end_at_4095_mm() {
    let utm = parameters_of(UTM_PARAMETERS);
    let data = [4094, 4095].map(|mm| characters(mm, 2)).concat();
    let Message::Distances(distances) = decode_one(
        HokuyoDecoder::default(),
        &reply_with("GS0000000100", "00", 0, &data),
    ) else {
        panic!()
    };
    let scan = utm.to_scan(&distances).unwrap();
    assert_eq!(scan.ranges_m, [4.094, f32::INFINITY]);
    assert_eq!((scan.range_min_m, scan.range_max_m), (0.023, 4.095));
}

#[test]
fn a_cluster_points_at_its_middle() {
    let utm = parameters_of(UTM_PARAMETERS);
    let data = characters(1000, 3).repeat(4);
    // Steps 540…549 by three: the last cluster has one step.
    let Message::Distances(distances) = decode_one(
        HokuyoDecoder::default(),
        &reply_with("MD0540054903100", "99", 0, &data),
    ) else {
        panic!()
    };
    let scan = utm.to_scan(&distances).unwrap();
    let step_rad = TAU / 1440.0;
    assert!((f64::from(scan.angle_min_rad) - step_rad).abs() < 1e-7);
    assert!((f64::from(scan.angle_increment_rad) - 3.0 * step_rad).abs() < 1e-7);
    assert!((f64::from(scan.time_increment_s) - 3.0 / (40.0 * 1440.0)).abs() < 1e-9);
}

#[test]
fn the_first_of_many_echoes_is_decoded() {
    let echoes: Vec<Vec<u32>> = (0..50)
        .map(|step| {
            (0..=step % 3)
                .map(|echo| 1000 * (echo + 1) + step)
                .collect()
        })
        .collect();
    let texts = echoes.iter().map(|of_step| {
        let texts = of_step.iter().map(|mm| characters(*mm, 3));
        texts.collect::<Vec<_>>().join("&")
    });
    let data = texts.collect::<String>();
    let firsts: Vec<u32> = (0..50).map(|step| 1000 + step).collect();
    for (request, status) in [("HD0000004900", "00"), ("ND0000004900000", "99")] {
        let Message::Distances(distances) = decode_one(
            HokuyoDecoder::default(),
            &reply_with(request, status, 5, &data),
        ) else {
            panic!()
        };
        assert_eq!(distances.distances_mm, firsts);
        assert_eq!(distances.encoding, Encoding::MultiEcho);
    }
    // An echo mark that nothing precedes, one that nothing follows, a step too many.
    for data in [format!("&{data}"), format!("{data}&"), format!("{data}012")] {
        let (messages, dropped) = decode_in(
            HokuyoDecoder::default(),
            &reply_with("HD0000004900", "00", 5, &data),
            &[64],
        );
        assert_eq!(messages, []);
        let count = |reason| dropped.count(reason);
        assert_eq!(
            count(DropReason::Length) + count(DropReason::Field),
            1,
            "{data}"
        );
    }
}

#[test]
fn replies_without_data() {
    for (bytes, request, status, is_ok, meaning) in [
        // What drivers of other projects expect from a real URG-04LX.
        (
            &b"SCIP2.0\n0Ee\n\n"[..],
            "SCIP2.0",
            b"0E",
            true,
            "unknown request, or not possible now",
        ),
        (b"BM\n02R\n\n", "BM", b"02", true, "the laser is on"),
        (b"RS\n00P\n\n", "RS", b"00", true, "accepted"),
        // Manual, sections 2 and 8.
        (b"SCIP2.0\n0\n\n", "SCIP2.0", b"00", true, "accepted"),
        (b"BM\n01Q\n\n", "BM", b"01", false, "the laser is faulty"),
        (b"TM0\n02R\n\n", "TM", b"02", true, "the mode is already so"),
        (b"MD0044072500000\n00P\n\n", "MD", b"00", true, "accepted"),
        (
            b"MD0044072500000\n04T\n\n",
            "MD",
            b"04",
            false,
            "invalid arguments",
        ),
        (
            b"MD0044072500000\n21S\n\n",
            "MD",
            b"21",
            false,
            "measuring stopped: the sensor checks an error",
        ),
        (
            b"MD0044072500000\n98a\n\n",
            "MD",
            b"98",
            false,
            "measuring resumes",
        ),
        (
            b"GD0044072500\n10Q\n\n",
            "GD",
            b"10",
            false,
            "the laser is off",
        ),
    ] {
        let shown = String::from_utf8_lossy(bytes);
        let Message::Status {
            request: of,
            status: decoded,
        } = decode_one(HokuyoDecoder::default(), bytes)
        else {
            panic!("{shown}")
        };
        assert_eq!((of, decoded.0), (request, *status), "{shown}");
        assert_eq!(
            (decoded.is_ok(of), decoded.meaning(of)),
            (is_ok, meaning),
            "{shown}"
        );
    }
}

#[test]
fn texts_and_time() {
    let version =
        b"VV\n00P\nVEND:Hokuyo Automatic Co., Ltd.;;\nPROD:UST-10LX;M\nPROT:SCIP 2.2;P\n\n";
    let expected = [
        "VEND:Hokuyo Automatic Co., Ltd.",
        "PROD:UST-10LX",
        "PROT:SCIP 2.2",
    ];
    assert_eq!(
        decode_one(HokuyoDecoder::default(), version),
        Message::Version(expected.map(String::from).to_vec())
    );
    let state = b"II\n00P\nLASR:OFF;7\n\n";
    assert_eq!(
        decode_one(HokuyoDecoder::default(), state),
        Message::State(vec!["LASR:OFF".into()])
    );
    assert_eq!(
        decode_one(HokuyoDecoder::default(), b"TM1\n00P\nm2@0?\n\n"),
        Message::Time(16_000_000)
    );
}

#[test]
fn bad_replies_are_dropped_and_the_next_is_found() {
    let long_text = format!("II\n00P\n{}\n\n", line(&"x".repeat(MAX_TEXT_LINE + 1)));
    let many_texts = format!("II\n00P\n{}\n", line("A:1;").repeat(MAX_TEXT_LINES + 1));
    for (bad, reason, count) in [
        (&b"hello\n\n"[..], DropReason::Garbage, 7),
        (b"RP LIDAR System.\r\n", DropReason::Garbage, 18),
        // A wrong sum of the status, of the time, of data, of a text.
        (b"QT\n00Q\n\n", DropReason::Checksum, 1),
        (
            b"GD0383038500\n00P\nm2@0@\n1Dh0070004\n\n",
            DropReason::Checksum,
            1,
        ),
        (
            b"GD0383038500\n00P\nm2@0?\n1Di0070004\n\n",
            DropReason::Checksum,
            1,
        ),
        (b"II\n00P\nLASR:ON;7\n\n", DropReason::Checksum, 1),
        // Too short a status, no status, a distance too few, one too many.
        (b"QT\n0`\n\n", DropReason::Length, 1),
        (b"QT\n\n\n", DropReason::Length, 1),
        (
            b"GD0383038600\n00P\nm2@0?\n1Dh0070004\n\n",
            DropReason::Length,
            1,
        ),
        (
            b"GD0383038400\n00P\nm2@0?\n1Dh0070004\n\n",
            DropReason::Length,
            1,
        ),
        (
            b"GD0000409600\n00P\nm2@0?\n1Dh0070004\n\n",
            DropReason::Length,
            1,
        ),
        (
            b"GD0385038300\n00P\nm2@0?\n1Dh0070004\n\n",
            DropReason::Length,
            1,
        ),
        (b"TM1\n00P\nm2@0?\nm2@0?\n\n", DropReason::Length, 1),
        (long_text.as_bytes(), DropReason::Length, 1),
        (many_texts.as_bytes(), DropReason::Length, 1),
        // Data after a status that has none, a character that is none.
        (
            b"GD0383038500\n99b\nm2@0?\n1Dh0070004\n\n",
            DropReason::Field,
            1,
        ),
        (b"QT\n00P\nm2@0?\n\n", DropReason::Field, 1),
        (b"TM1\n00P\nm2@!0\n\n", DropReason::Field, 1),
        // Cut off in the request, before the status, in the data.
        (b"GD03830", DropReason::Garbage, 7),
        (b"GD0383038500\n", DropReason::CutOff, 1),
        (b"GD0383038500\n00P\nm2@0?\n1Dh0", DropReason::CutOff, 1),
    ] {
        let bytes = [bad, THREE_STEPS].concat();
        for length in [1, 7, usize::MAX] {
            let (messages, dropped) = decode_in(HokuyoDecoder::default(), &bytes, &[length]);
            let shown = String::from_utf8_lossy(bad);
            assert_eq!(
                messages,
                [decode_one(HokuyoDecoder::default(), THREE_STEPS)],
                "{shown}"
            );
            assert_eq!(dropped.count(reason), count, "{shown} {dropped:?}");
        }
    }
}

#[test]
fn requests() {
    let shown = |request: Option<Vec<u8>>| request.map(|bytes| String::from_utf8(bytes).unwrap());
    // Manual, section 8.1: steps 10 to 750.
    assert_eq!(
        shown(request_scans(Encoding::Long, 10..=750, 1, 0)).as_deref(),
        Some("MD0010075001000\n")
    );
    assert_eq!(
        shown(request_scans(Encoding::MultiEcho, 0..=1080, 0, 9)).as_deref(),
        Some("ND0000108000900\n")
    );
    assert_eq!(
        shown(request_scan(Encoding::Short, 44..=725, 99)).as_deref(),
        Some("GS0044072599\n")
    );
    #[expect(clippy::reversed_empty_ranges, reason = "what is refused")]
    let reversed = 2..=1;
    for refused in [
        request_scan(Encoding::Long, reversed, 1),
        request_scan(Encoding::Long, 0..=MAX_STEPS, 1),
        request_scan(Encoding::Long, 0..=1, 100),
        request_scans(Encoding::Long, 0..=1, 1, 10),
    ] {
        assert_eq!(refused, None);
    }
    // A request is what its reply begins with.
    for request in [
        request::SCIP2,
        request::LASER_ON,
        request::LASER_OFF,
        request::RESET,
        request::TIME_MODE_ON,
        request::TIME,
        request::TIME_MODE_OFF,
        request::PARAMETERS,
        request::VERSION,
        request::STATE,
    ] {
        assert!(matches!(echo(request), Echo::Complete(..)));
    }
}

#[test]
fn time_continues_after_24_bits() {
    let mut time = SensorTime::default();
    let wrap = 1_i64 << 24;
    for (sent_ms, expected_ms) in [
        (0xFF_FFF0, wrap - 16),
        (0xFF_FFFF, wrap - 1),
        (0x00_0009, wrap + 9),
        // An older message.
        (0xFF_FFFE, wrap - 2),
        (0x70_0000, wrap + 0x70_0000),
        (0xE0_0000, wrap + 0xE0_0000),
        (0x00_0000, 2 * wrap),
    ] {
        assert_eq!(time.continued_ms(sent_ms), expected_ms, "{sent_ms:x}");
    }
}

fn any_reply() -> impl Strategy<Value = (Vec<u8>, Message)> {
    let scan = (
        0..2000_u16,
        1..300_u16,
        0..5_u16,
        0..1_u32 << 24,
        0..3_usize,
    );
    let scan = scan.prop_flat_map(|(start, steps, cluster, time_ms, kind)| {
        let count = usize::from((steps - 1) / cluster.max(1)) + 1;
        let most: u32 = if kind == 0 { 1 << 12 } else { 1 << 18 };
        let echoes = proptest::collection::vec(0..most, 1..=if kind == 2 { 3 } else { 1 });
        proptest::collection::vec(echoes, count).prop_map(move |echoes| {
            let (width, encoding) = [
                (2, Encoding::Short),
                (3, Encoding::Long),
                (3, Encoding::MultiEcho),
            ][kind];
            let texts = echoes.iter().map(|of_step| {
                let texts = of_step.iter().map(|mm| characters(*mm, width));
                texts.collect::<Vec<_>>().join("&")
            });
            let data = texts.collect::<String>();
            let end = start + steps - 1;
            let name = ["MS", "MD", "ND"][kind];
            let request = format!("{name}{start:04}{end:04}{cluster:02}000");
            let distances = Distances {
                start_step: start,
                end_step: end,
                cluster: cluster.max(1),
                step_0_time_ms: time_ms,
                encoding,
                distances_mm: echoes.iter().map(|of_step| of_step[0]).collect(),
            };
            let bytes = reply_with(&request, "99", time_ms, &data);
            (bytes, Message::Distances(distances))
        })
    });
    let others = [
        URG_PARAMETERS,
        UTM_PARAMETERS,
        b"BM\n00P\n\n",
        b"SCIP2.0\n0\n\n",
    ];
    let others = others.map(|bytes| (bytes.to_vec(), decode_one(HokuyoDecoder::default(), bytes)));
    prop_oneof![scan, proptest::sample::select(others.to_vec())]
}

proptest! {
    #[test]
    fn any_split_gives_the_same_messages(
        replies in proptest::collection::vec(any_reply(), 1..5),
        lengths in read_lengths(),
    ) {
        let bytes: Vec<u8> = replies.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let expected: Vec<Message> = replies.into_iter().map(|(_, message)| message).collect();
        prop_assert_eq!(decode_in(HokuyoDecoder::default(), &bytes, &lengths), (expected, Dropped::default()));
    }

    #[test]
    fn damage_neither_panics_nor_gives_senseless_messages(
        replies in proptest::collection::vec(any_reply(), 1..4),
        damage in damage(b"MDGSPB019\n;&"),
    ) {
        let bytes: Vec<u8> = replies.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let urg = parameters_of(URG_PARAMETERS);
        for message in damage.decode(HokuyoDecoder::default, bytes) {
            let Message::Distances(distances) = message else { continue };
            let count = usize::from((distances.end_step - distances.start_step) / distances.cluster) + 1;
            prop_assert_eq!(distances.distances_mm.len(), count);
            prop_assert!(distances.step_0_time_ms < 1 << 24);
            let Some(scan) = urg.to_scan(&distances) else { continue };
            let is_range = |range_m: &f32| {
                range_m.is_nan() || *range_m == f32::INFINITY || (0.02..5.6).contains(range_m)
            };
            prop_assert!(scan.ranges_m.iter().all(is_range));
            prop_assert!(scan.sweep_duration().is_some());
        }
    }
}
