use std::io::Write;

use measurement::MeasurementData;
use proptest::prelude::*;

use super::*;

fn read_all(reader: &mut dyn RecordingReader) -> Vec<Measurement> {
    std::iter::from_fn(|| reader.next_measurement().unwrap()).collect()
}

fn log_of(content: &[u8]) -> (tempfile::NamedTempFile, CarmenReader) {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(content).unwrap();
    let reader = CarmenReader::open(file.path(), Selection::All).unwrap();
    (file, reader)
}

#[test]
fn damage_costs_its_own_line_only() {
    let (_file, mut reader) = log_of(
        b"# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp\n\
          PARAM robot_use_laser on nohost 0\n\
          FLASER 2 1 2 0 0 0 0 0 0 10 h 10\r\n\
          FLASER 2 1 0 0 0 0 0 0 10.2 h 10\n\
          \xff\xfe\n\
          lower case\n\
          \n\
          FLASER 2 1 3 0 0 0 0 0 0 10.4 h 10\n\
          ODOM 0 0 0 0 0 0 10.5 h 0\n\
          NEFF 30\n\
          FLASER 2 1 4 0 0 0 0 0 0 10.6 h 1\n\
          FLASER 2 1 4 0 0 0 0 0",
    );
    let measurements = read_all(&mut reader);
    assert_eq!(measurements.len(), 4);
    assert_eq!(reader.losses().get(DropReason::Damaged), 3);
    assert_eq!(reader.losses().get(DropReason::CutOff), 1);
    assert_eq!(reader.losses().total(), 4);
    assert_eq!(
        reader.loss_notes(),
        [
            "line 4: FLASER: ipc stamp is not a number: \"h\"",
            "line 5: not text",
            "line 6: begins with no message name",
            "line 12: the recording ends inside this line",
        ]
    );
    let counts: Vec<_> = reader
        .streams()
        .iter()
        .map(|s| (s.stream.name.as_str(), s.understood, s.messages))
        .collect();
    assert_eq!(
        counts,
        [
            ("PARAM", false, 1),
            ("FLASER", true, 5),
            ("ODOM", true, 1),
            ("NEFF", false, 1)
        ]
    );
    let position = reader.position();
    assert_eq!(position.bytes_read, position.bytes_total);
}

#[test]
fn streams_keep_clocks_of_their_own() {
    let (_file, mut reader) = log_of(
        b"ODOM 0 0 0 0 0 0 21.0 h 0\n\
          FLASER 2 1 2 0 0 0 0 0 0 21.5 h 1\n\
          ODOM 0 0 0 0 0 0 0 h 0\n\
          FLASER 2 1 2 0 0 0 0 0 0 21.4 h 1\n\
          FLASER 2 1 2 0 0 0 0 0 0 21.3 h 1\n\
          ODOM 0 0 0 0 0 0 22.0 h 0\n",
    );
    let stamps_s: Vec<_> = read_all(&mut reader)
        .iter()
        .map(|m| m.stamp.as_secs_f64())
        .collect();
    assert_eq!(stamps_s, [21.0, 21.5, 21.0, 21.5, 21.5, 22.0]);
    assert_eq!(reader.stamp_repairs(), 3);
    assert_eq!(reader.losses().total(), 0);
    assert_eq!(
        reader.loss_notes(),
        [
            "line 3: the stamp of ODOM goes back by 21 s and is held (later ones only counted)",
            "line 4: the stamp of FLASER goes back by 0.1 s and is held (later ones only counted)",
        ]
    );
}

#[test]
fn a_cut_in_the_last_field_costs_nothing_but_is_counted() {
    let (_file, mut reader) = log_of(b"ODOM 0 0 0 0 0 0 1 h 1\nODOM 0 0 0 0 0 0 2 h 1");
    assert_eq!(read_all(&mut reader).len(), 2);
    assert_eq!(reader.losses().get(DropReason::CutOff), 1);
    assert_eq!(reader.losses().total(), 1);
}

#[test]
fn names_beyond_the_limit_are_garbage() {
    let lines: Vec<_> = (0..1000).map(|i| format!("X{i} 1 2 3")).collect();
    let (_file, mut reader) = log_of(lines.join("\n").as_bytes());
    assert!(read_all(&mut reader).is_empty());
    assert_eq!(reader.streams().len(), MAX_STREAMS);
    assert_eq!(
        reader.losses().get(DropReason::Damaged),
        1000 - MAX_STREAMS as u64
    );
}

#[test]
fn selection_leaves_other_streams_counted() {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(b"ODOM 0 0 0 0 0 0 1 h 0\nFLASER 1 3 0 0 0 0 0 0 1 h 1\n")
        .unwrap();
    let selection = Selection::Named(vec!["FLASER".to_owned()]);
    let mut reader = CarmenReader::open(file.path(), selection).unwrap();
    let measurements = read_all(&mut reader);
    assert_eq!(measurements.len(), 1);
    assert_eq!(measurements[0].stream, StreamId(1));
    assert_eq!(reader.streams()[0].messages, 1);
}

proptest! {
    #[test]
    fn any_bytes_are_survived(content in prop::collection::vec(any::<u8>(), 0..2000)) {
        let (_file, mut reader) = log_of(&content);
        read_all(&mut reader);
        prop_assert_eq!(reader.position().bytes_read, content.len() as u64);
    }

    #[test]
    fn any_damage_to_a_log_is_survived(
        cut in 0_usize..300,
        flips in prop::collection::vec((0_usize..300, any::<u8>()), 0..4),
    ) {
        let mut content = b"ODOM 0 0 0 0 0 0 1.0 h 0\nFLASER 3 1 2 3 0 0 0 0 0 0 1.5 h 1\n".repeat(6);
        for (at, byte) in flips {
            content[at] = byte;
        }
        content.truncate(cut);
        let (_file, mut reader) = log_of(&content);
        for measurement in read_all(&mut reader) {
            if let MeasurementData::Scan { scan, .. } = measurement.data {
                prop_assert!(!scan.ranges_m.is_empty());
            }
        }
    }
}

#[test]
fn long_lines_are_skipped_and_the_next_is_whole() {
    let mut text = b"one\n".to_vec();
    text.extend(vec![b'x'; MAX_LINE_BYTES + 5]);
    text.extend(b"\nthree\nfour");
    let mut lines = BoundedLines::new(&text[..]);
    assert_eq!(lines.next_line().unwrap(), Some(LineEnd::Newline));
    assert_eq!(lines.line(), b"one\n");
    assert_eq!(lines.next_line().unwrap(), Some(LineEnd::TooLong));
    assert!(lines.line().len() <= MAX_LINE_BYTES + 1);
    assert_eq!(lines.next_line().unwrap(), Some(LineEnd::Newline));
    assert_eq!((lines.line(), lines.line_number()), (&b"three\n"[..], 3));
    assert_eq!(lines.next_line().unwrap(), Some(LineEnd::EndOfFile));
    assert_eq!(lines.next_line().unwrap(), None);
    assert_eq!(lines.bytes_read(), text.len() as u64);
}

fn seconds(secs: f64) -> RobotTime {
    RobotTime::from_secs_f64(secs).unwrap()
}

fn check(stamps_s: &[f64], expected_s: &[f64], repaired: usize) {
    let mut repair = StampRepair::default();
    let mut repairs = 0;
    for (&raw, &expected) in stamps_s.iter().zip(expected_s) {
        let (stamp, done) = repair.repair(seconds(raw));
        repairs += usize::from(done != Repair::None);
        let error = stamp.as_secs_f64() - expected;
        assert!(error.abs() < 1e-6, "{raw} became {stamp}, not {expected}");
    }
    assert_eq!(repairs, repaired);
}

#[test]
fn stamps_are_held_and_clock_changes_followed() {
    check(&[10.0, 10.0, 10.5, 1000.0], &[10.0, 10.0, 10.5, 1000.0], 0);
    check(&[10.0, 9.5, 9.9, 10.1], &[10.0, 10.0, 10.0, 10.1], 2);
    check(&[21.0, 0.0, 1.08e-42, 22.7], &[21.0, 21.0, 21.0, 22.7], 2);
    let wrap = 4_294_967_296.0;
    let around_the_wrap = [5.0, wrap - 2.0, wrap - 1.5, 0.5, 1.0];
    check(&around_the_wrap, &[5.0, 5.0, 5.5, 5.5, 6.0], 2);
    let now = 1.018e9;
    check(&[now, 0.0, now, now + 1.0], &[now, now, now, now + 1.0], 2);
}

proptest! {
    #[test]
    fn time_never_goes_back(stamps in prop::collection::vec(any::<i64>(), 0..50)) {
        let mut repair = StampRepair::default();
        let mut last = RobotTime::MIN;
        for nanos in stamps {
            let (stamp, _) = repair.repair(RobotTime::from_nanos(nanos));
            prop_assert!(stamp >= last);
            last = stamp;
        }
    }
}
