use std::fs;

use measurement::{MeasurementData, StreamId};
use serde_json::Value;

use super::*;
use crate::RecordingReader;
use crate::shared_data::shared_data;
use measurement::Measurement;
use measurement::drops::DropCounts;

/// Every message of the file: channel, sequence, log time, publish time, data.
fn messages(path: &Path) -> Vec<(u16, u32, u64, u64, Vec<u8>)> {
    let mut records = McapRecords::open(path).unwrap();
    let mut found = Vec::new();
    while let Some(piece) = records.next().unwrap() {
        let Piece::Record { opcode, body, .. } = piece else {
            panic!("{}: {piece:?}", path.display())
        };
        match opcode {
            op::DATA_END => break,
            op::MESSAGE => {
                let (header, data) = record::message(body).unwrap();
                found.push((
                    header.channel_id,
                    header.sequence,
                    header.log_time,
                    header.publish_time,
                    data.to_vec(),
                ));
            }
            _ => {}
        }
    }
    found
}

/// What the conformance suite's JSON says the messages are.
fn expected_messages(json: &Value) -> Vec<(u16, u32, u64, u64, Vec<u8>)> {
    let records = json["records"].as_array().unwrap();
    let number = |value: &Value| value.as_str().unwrap().parse::<u64>().unwrap();
    records
        .iter()
        .filter(|record| record["type"] == "Message")
        .map(|record| {
            let field = |name: &str| {
                let fields = record["fields"].as_array().unwrap();
                fields.iter().find(|field| field[0] == name).unwrap()[1].clone()
            };
            let data = field("data")
                .as_array()
                .unwrap()
                .iter()
                .map(|byte| number(byte) as u8)
                .collect();
            (
                number(&field("channel_id")) as u16,
                number(&field("sequence")) as u32,
                number(&field("log_time")),
                number(&field("publish_time")),
                data,
            )
        })
        .collect()
}

fn drain(reader: &mut McapReader) -> Vec<Measurement> {
    std::iter::from_fn(|| reader.next_measurement().unwrap()).collect()
}

#[test]
fn every_conformance_file_is_read_as_its_json_says() {
    let Some(folder) = shared_data("mcap/conformance") else {
        return;
    };
    let (mut real, mut pointers) = (0, 0);
    for entry in fs::read_dir(folder).unwrap() {
        let folder = entry.unwrap().path();
        if !folder.is_dir() {
            continue;
        }
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "mcap") {
                continue;
            }
            // Some are stored as a pointer to large file storage, which is text.
            if fs::read(&path).unwrap().starts_with(b"version ") {
                pointers += 1;
                assert!(McapReader::open(&path, Selection::All).is_err());
                continue;
            }
            real += 1;
            let json = fs::read_to_string(path.with_extension("json")).unwrap();
            let expected = expected_messages(&serde_json::from_str(&json).unwrap());
            assert_eq!(messages(&path), expected, "{}", path.display());

            let mut reader = McapReader::open(&path, Selection::All).unwrap();
            assert_eq!(drain(&mut reader), []);
            let counted: u64 = reader.streams().iter().map(|stream| stream.messages).sum();
            assert_eq!(counted, expected.len() as u64, "{}", path.display());
            assert_eq!(
                reader.losses().total(),
                0,
                "{}: {:?}",
                path.display(),
                reader.loss_notes()
            );
        }
    }
    println!("{real} conformance files read, {pointers} pointers refused");
    assert_eq!(real, 154);
}

#[test]
fn the_corrected_intel_log_is_read_whole() {
    let Some(folder) = shared_data("mcap") else {
        return;
    };
    let selection = Selection::Named(vec![
        "/scan".to_owned(),
        "/tf".to_owned(),
        "/tf_static".to_owned(),
    ]);
    let mut reader = McapReader::open(&folder.join("intel_corrected.mcap"), selection).unwrap();
    let (mut scans, mut still, mut moving) = (Vec::new(), 0, 0);
    for measurement in drain(&mut reader) {
        match measurement.data {
            MeasurementData::Scan { scan, .. } => scans.push(scan),
            MeasurementData::Transform { is_static, .. } if is_static => still += 1,
            MeasurementData::Transform { .. } => moving += 1,
            other => panic!("{other:?}"),
        }
    }
    assert_eq!((scans.len(), still, moving), (910, 1, 910));
    let odometry = reader
        .streams()
        .iter()
        .find(|stream| stream.stream.name == "/odom")
        .unwrap();
    assert_eq!((odometry.messages, odometry.understood), (910, true));
    assert_eq!(odometry.stream.type_name, "nav_msgs/Odometry");
    let scan = &scans[0];
    assert_eq!(
        (scan.ranges_m.len(), scan.ranges_m[0], scan.range_max_m),
        (180, 1.09, 80.0)
    );
    assert_eq!(reader.losses().total(), 0);
}

mod damage {
    use proptest::prelude::*;

    use super::*;
    use crate::writer::McapWriter;
    use measurement::scan::Scan;

    /// A file of `scans` scans in several chunks.
    fn recording(folder: &Path, scans: i64) -> (PathBuf, Vec<u8>) {
        let path = folder.join("r.mcap");
        let mut writer = McapWriter::create(&path, Some("pioneer")).unwrap();
        let stream = Stream {
            name: "/scan".into(),
            type_name: "sensor_msgs/LaserScan".into(),
        };
        for i in 0..scans {
            let scan = Scan {
                angle_increment_rad: 0.01,
                range_max_m: 10.0,
                ranges_m: (0..400).map(|beam| (beam * i % 97) as f32 * 0.1).collect(),
                ..Scan::default()
            };
            let measurement = Measurement {
                stamp: RobotTime::from_nanos(1_000_000_000 + i * 100_000_000),
                stream: StreamId(0),
                frame: "laser".into(),
                data: MeasurementData::Scan {
                    scan,
                    own_pose: None,
                },
            };
            writer.write(&stream, &measurement).unwrap();
            if i % 10 == 9 {
                writer.flush().unwrap();
            }
        }
        writer.finish().unwrap();
        let bytes = fs::read(&path).unwrap();
        (path, bytes)
    }

    fn read(path: &Path) -> (Result<usize, String>, DropCounts, Vec<String>) {
        match McapReader::open(path, Selection::All) {
            Err(err) => (Err(err.to_string()), DropCounts::default(), Vec::new()),
            Ok(mut reader) => {
                let scans = drain(&mut reader).len();
                (
                    Ok(scans),
                    reader.losses().clone(),
                    reader.loss_notes().to_vec(),
                )
            }
        }
    }

    #[test]
    fn a_damaged_chunk_is_skipped_counted_and_placed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mut bytes) = recording(folder.path(), 50);
        assert_eq!(read(&path), (Ok(50), DropCounts::default(), vec![]));
        assert_eq!(
            McapReader::open(&path, Selection::All)
                .map(|mut reader| {
                    drain(&mut reader);
                    RecordingReader::vehicle(&reader).map(str::to_owned)
                })
                .unwrap(),
            Some("pioneer".to_owned())
        );
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x55;
        fs::write(&path, &bytes).unwrap();
        let (scans, losses, notes) = read(&path);
        assert_eq!(
            (scans, losses.get(DropReason::Damaged) > 0),
            (Ok(40), true),
            "{notes:?}"
        );
        assert!(
            notes[0].contains("byte ") && notes[0].contains("a chunk is lost"),
            "{notes:?}"
        );
    }

    #[test]
    fn the_summary_names_topics_whose_definitions_are_lost() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mut bytes) = recording(folder.path(), 50);
        let first_chunk = bytes
            .windows(4)
            .position(|window| window == b"zstd")
            .unwrap();
        bytes[first_chunk + 40] ^= 0x55;
        fs::write(&path, &bytes).unwrap();
        let (scans, losses, notes) = read(&path);
        assert_eq!(scans, Ok(40), "{notes:?}");
        assert_eq!(losses.get(DropReason::Damaged), 1, "{notes:?}");
    }

    #[test]
    fn reading_goes_on_behind_a_hole() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mut bytes) = recording(folder.path(), 50);
        let (from, to) = (bytes.len() / 4, bytes.len() / 2);
        bytes[from..to].fill(0xEE);
        fs::write(&path, &bytes).unwrap();
        let (scans, losses, notes) = read(&path);
        let scans = scans.unwrap();
        assert!((20..50).contains(&scans), "{scans} scans, {notes:?}");
        assert!(losses.get(DropReason::Damaged) > 0);
    }

    #[test]
    fn a_length_that_lies_costs_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mut bytes) = recording(folder.path(), 20);
        // The length of the first record behind the magic.
        bytes[9..17].copy_from_slice(&0x0AF4_0000_0000_0000u64.to_le_bytes());
        fs::write(&path, &bytes).unwrap();
        let (scans, losses, notes) = read(&path);
        assert_eq!(scans, Ok(20), "{notes:?}");
        assert_eq!(losses.get(DropReason::Damaged), 1);
    }

    #[test]
    fn what_is_left_of_a_damaged_file_becomes_a_whole_one() {
        let folder = tempfile::tempdir().unwrap();
        let (path, mut bytes) = recording(folder.path(), 50);
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x55;
        bytes.truncate(bytes.len() * 9 / 10);
        fs::write(&path, &bytes).unwrap();
        let saved = folder.path().join("saved.mcap");
        let report = recover::recover(&path, &saved).unwrap();
        assert_eq!(report.messages, read(&path).0.unwrap() as u64);
        assert!(
            report.losses.get(DropReason::Damaged) > 0 && report.losses.get(DropReason::CutOff) > 0
        );
        let (scans, losses, notes) = read(&saved);
        assert_eq!(
            (scans, losses),
            (Ok(report.messages as usize), DropCounts::default()),
            "{notes:?}"
        );
        let mut reader = McapReader::open(&saved, Selection::All).unwrap();
        drain(&mut reader);
        assert_eq!(RecordingReader::vehicle(&reader), Some("pioneer"));
        // Neither the damaged file nor an earlier rescue is overwritten.
        assert!(recover::recover(&path, &path).is_err());
        assert!(recover::recover(&path, &saved).is_err());
        assert_eq!(fs::read(&path).unwrap(), bytes);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn every_cut_is_counted(at in any::<prop::sample::Index>()) {
            let folder = tempfile::tempdir().unwrap();
            let (path, bytes) = recording(folder.path(), 30);
            let at = at.index(bytes.len());
            fs::write(&path, &bytes[..at]).unwrap();
            let (scans, losses, notes) = read(&path);
            if at < MAGIC.len() {
                prop_assert!(scans.is_err());
            } else {
                prop_assert!(losses.total() > 0, "cut at {at} of {}: {notes:?}", bytes.len());
                prop_assert!(scans.unwrap() <= 30);
            }
        }

        #[test]
        fn every_flip_is_detected(at in any::<prop::sample::Index>(), value in 1u8..) {
            let folder = tempfile::tempdir().unwrap();
            let (path, mut bytes) = recording(folder.path(), 30);
            // Behind the data section nothing is read but the end mark.
            let data_end = bytes.windows(9).rposition(|w| w == [0x0F, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
            let at = at.index(data_end);
            bytes[at] ^= value;
            fs::write(&path, &bytes).unwrap();
            let (scans, losses, notes) = read(&path);
            prop_assert!(scans.is_err() || losses.total() > 0, "flip at {at}: {notes:?}");
        }
    }
}
