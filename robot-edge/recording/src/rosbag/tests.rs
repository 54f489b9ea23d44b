use std::io::Write;

use measurement::MeasurementData;
use measurement::time::RobotTime;
use proptest::prelude::*;

use super::*;
use crate::RecordingReader;
use crate::shared_data::shared_data;
use measurement::Measurement;

fn read_all(reader: &mut dyn RecordingReader) -> Vec<Measurement> {
    std::iter::from_fn(|| reader.next_measurement().unwrap()).collect()
}

fn file_of(content: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(content).unwrap();
    file
}

fn open(content: &[u8]) -> RosbagReader {
    RosbagReader::open(file_of(content).path(), Selection::All).unwrap()
}

/// A `sensor_msgs/LaserScan` as ROS 1 writes it.
fn laser_scan(stamp_s: u32, ranges: &[f32]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in [7, stamp_s, 0, 5] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"laser");
    for number in [-1.5_f32, 1.5, 0.5, 0.001, 0.1, 0.02, 30.0] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend((ranges.len() as u32).to_le_bytes());
    bytes.extend(ranges.iter().flat_map(|range| range.to_le_bytes()));
    bytes.extend(0_u32.to_le_bytes());
    bytes
}

/// A `tf2_msgs/TFMessage` of one transform.
fn tf_message(stamp_s: u32, quaternion_w: f64) -> Vec<u8> {
    let mut bytes = Vec::new();
    for word in [1, 0, stamp_s, 0, 4] {
        bytes.extend(u32::to_le_bytes(word));
    }
    bytes.extend(b"odom");
    bytes.extend(9_u32.to_le_bytes());
    bytes.extend(b"base_link");
    for number in [1.0, 2.0, 0.0, 0.0, 0.0, 0.0, quaternion_w] {
        bytes.extend(f64::to_le_bytes(number));
    }
    bytes
}

fn connections() -> Vec<u8> {
    [
        connection(0, "/scan", "sensor_msgs/LaserScan"),
        connection(1, "/tf", "tf2_msgs/TFMessage"),
        connection(2, "/robot/tf_static", "tf2_msgs/TFMessage"),
        connection(3, "/rosout", "rosgraph_msgs/Log"),
    ]
    .concat()
}

fn scans(times_s: std::ops::Range<u32>) -> Vec<u8> {
    times_s
        .flat_map(|t| message(0, t + 100, &laser_scan(t, &[1.0, 2.0])))
        .collect()
}

fn stamps_s(measurements: &[Measurement]) -> Vec<i64> {
    measurements
        .iter()
        .map(|m| m.stamp.as_nanos() / 1_000_000_000)
        .collect()
}

/// A record out of its header fields and its data.
fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend((name.len() as u32 + 1 + value.len() as u32).to_le_bytes());
        header.extend(name.as_bytes());
        header.push(b'=');
        header.extend(*value);
    }
    let mut record = (header.len() as u32).to_le_bytes().to_vec();
    record.extend(header);
    record.extend((data.len() as u32).to_le_bytes());
    record.extend(data);
    record
}

pub(super) fn message(conn: u32, time_s: u32, data: &[u8]) -> Vec<u8> {
    let time = [time_s.to_le_bytes(), [0; 4]].concat();
    let fields: [(&str, &[u8]); 3] = [("conn", &conn.to_le_bytes()), ("op", &[2]), ("time", &time)];
    record(&fields, data)
}

pub(super) fn connection(conn: u32, topic: &str, type_name: &str) -> Vec<u8> {
    let named = record(
        &[("topic", topic.as_bytes()), ("type", type_name.as_bytes())],
        &[],
    );
    let data = &named[4..named.len() - 4];
    let fields: [(&str, &[u8]); 3] = [
        ("conn", &conn.to_le_bytes()),
        ("op", &[7]),
        ("topic", topic.as_bytes()),
    ];
    record(&fields, data)
}

pub(super) fn index(conn: u32, count: u32) -> Vec<u8> {
    let fields: [(&str, &[u8]); 4] = [
        ("conn", &conn.to_le_bytes()),
        ("count", &count.to_le_bytes()),
        ("op", &[4]),
        ("ver", &1_u32.to_le_bytes()),
    ];
    record(&fields, &vec![0; count as usize * 12])
}

/// A chunk that holds `records`, packed as `compression` says.
pub(super) fn chunk(compression: &str, records: &[u8]) -> Vec<u8> {
    let packed = match compression {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        // As ROS does it: independent blocks, a checksum of the content.
        "lz4" => {
            let frame = lz4_flex::frame::FrameInfo::new()
                .block_size(lz4_flex::frame::BlockSize::Max64KB)
                .block_mode(lz4_flex::frame::BlockMode::Independent)
                .content_checksum(true);
            let mut encoder = lz4_flex::frame::FrameEncoder::with_frame_info(frame, Vec::new());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        _ => records.to_vec(),
    };
    let fields: [(&str, &[u8]); 3] = [
        ("compression", compression.as_bytes()),
        ("op", &[5]),
        ("size", &(records.len() as u32).to_le_bytes()),
    ];
    record(&fields, &packed)
}

/// A whole bag out of chunks and what else follows the header, without an index.
pub(super) fn bag(parts: &[Vec<u8>]) -> Vec<u8> {
    let fields: [(&str, &[u8]); 4] = [
        ("chunk_count", &[0; 4]),
        ("conn_count", &[0; 4]),
        ("index_pos", &[0; 8]),
        ("op", &[3]),
    ];
    [
        b"#ROSBAG V2.0\n".to_vec(),
        record(&fields, &[b' '; 50]),
        parts.concat(),
    ]
    .concat()
}

#[test]
fn messages_become_measurements() {
    let records = [
        connections(),
        message(3, 100, b"hello"),
        message(1, 101, &tf_message(0, 1.0)),
        message(0, 102, &laser_scan(2, &[1.5, 2.5])),
        message(1, 103, &tf_message(0, 1.0)),
        message(2, 104, &tf_message(1, 1.0)),
        message(1, 105, &tf_message(3, 0.0)),
        message(0, 106, b"short"),
    ]
    .concat();
    for compression in ["none", "bz2", "lz4"] {
        let mut reader = open(&bag(&[chunk(compression, &records), index(0, 2)]));
        let measurements = read_all(&mut reader);
        // Without a header stamp: the time of recording, then the newest header stamp.
        assert_eq!(stamps_s(&measurements), [101, 2, 2, 1], "{compression}");
        let MeasurementData::Scan { scan, own_pose } = &measurements[1].data else {
            panic!("{measurements:?}");
        };
        assert_eq!((&scan.ranges_m[..], *own_pose), (&[1.5, 2.5][..], None));
        assert_eq!(&*measurements[1].frame, "laser");
        let statics: Vec<_> = measurements
            .iter()
            .map(|m| {
                matches!(
                    &m.data,
                    MeasurementData::Transform {
                        is_static: true,
                        ..
                    }
                )
            })
            .collect();
        assert_eq!(statics, [false, false, false, true]);
        let topics: Vec<_> = reader
            .streams()
            .iter()
            .map(|s| (s.stream.name.as_str(), s.understood, s.messages))
            .collect();
        assert_eq!(
            topics,
            [
                ("/scan", true, 2),
                ("/tf", true, 3),
                ("/robot/tf_static", true, 1),
                ("/rosout", false, 1)
            ]
        );
        assert_eq!(reader.streams()[1].last, RobotTime::from_secs_f64(105.0));
        assert_eq!(reader.losses().get(DropReason::BadPose), 1);
        assert_eq!(reader.losses().get(DropReason::Undecodable), 1);
        assert_eq!(reader.losses().total(), 2, "{:?}", reader.loss_notes());
        let position = RecordingReader::position(&reader);
        assert_eq!(position.bytes_read, position.bytes_total);
    }
}

#[test]
fn two_publishers_of_a_topic_are_one_stream() {
    let records = [
        connection(0, "/scan", "sensor_msgs/LaserScan"),
        connection(1, "/scan", "sensor_msgs/LaserScan"),
        message(0, 1, &laser_scan(1, &[1.0])),
        message(1, 2, &laser_scan(2, &[1.0])),
    ]
    .concat();
    let mut reader = open(&bag(&[chunk("none", &records)]));
    assert_eq!(stamps_s(&read_all(&mut reader)), [1, 2]);
    assert_eq!(reader.streams().len(), 1);
}

#[test]
fn a_damaged_chunk_costs_itself_only() {
    for compression in ["bz2", "lz4"] {
        let mut middle = chunk(compression, &scans(4..7));
        let at = middle.len() - 12;
        middle[at] ^= 0xff;
        let parts = [
            chunk("none", &[connections(), scans(1..4)].concat()),
            middle,
            index(0, 3),
            chunk(compression, &scans(7..10)),
        ];
        let mut reader = open(&bag(&parts));
        let measurements = read_all(&mut reader);
        assert_eq!(stamps_s(&measurements), [1, 2, 3, 7, 8, 9]);
        assert_eq!(reader.losses().get(DropReason::Damaged), 1);
        let at = bag(&parts[..1]).len();
        assert_eq!(
            reader.loss_notes(),
            [format!("byte {at}: a chunk that cannot be decompressed")]
        );
    }
}

#[test]
fn a_bag_that_was_never_closed_is_read() {
    // While a chunk is being recorded its lengths are 0, and its records follow.
    let mut unfinished = chunk("none", &[]);
    unfinished.extend(scans(3..5));
    let parts = [
        chunk("none", &[connections(), scans(1..3)].concat()),
        unfinished,
    ];
    let mut reader = open(&bag(&parts));
    assert_eq!(stamps_s(&read_all(&mut reader)), [1, 2, 3, 4]);
    assert_eq!(reader.losses().total(), 0);
}

#[test]
fn a_cut_costs_what_is_behind_it() {
    for compression in ["none", "bz2", "lz4"] {
        let whole = bag(&[
            chunk("none", &[connections(), scans(1..3)].concat()),
            chunk(compression, &scans(3..6)),
        ]);
        let mut reader = open(&whole[..whole.len() - 20]);
        let stamps = stamps_s(&read_all(&mut reader));
        assert!(
            stamps.starts_with(&[1, 2]) && stamps.len() < 5,
            "{stamps:?}"
        );
        assert_eq!(reader.losses().total(), 1, "{:?}", reader.loss_notes());
        assert_eq!(reader.losses().get(DropReason::CutOff), 1);
    }
}

#[test]
fn selection_leaves_other_topics_counted() {
    let file = file_of(&bag(&[chunk(
        "none",
        &[connections(), scans(1..3), message(1, 9, b"?")].concat(),
    )]));
    let selection = Selection::Named(vec!["/tf".to_owned()]);
    let mut reader = RosbagReader::open(file.path(), selection).unwrap();
    assert!(read_all(&mut reader).is_empty());
    assert_eq!(reader.streams()[0].messages, 2);
    assert_eq!(reader.losses().get(DropReason::Undecodable), 1);
}

#[test]
fn what_is_no_bag_of_version_2_is_refused() {
    let refusal = |content: &[u8]| {
        let file = file_of(content);
        let error = RosbagReader::open(file.path(), Selection::All).unwrap_err();
        error
            .to_string()
            .replace(&file.path().display().to_string(), "F")
    };
    assert!(
        refusal(b"#ROSRECORD V1.2\nrest").starts_with("F: ROS bag version 1.2 is not supported: "),
    );
    assert!(refusal(b"#ROSBAG V3.0\nrest").contains("version 3.0"));
    assert!(refusal(b"#ROSBAG V2").contains("damaged at byte 10: the file ends in its first line"));
    assert!(refusal(b"FLASER").contains("not a recording"));
}

#[test]
fn a_published_bag_of_version_1_is_refused() {
    let Some(data) = shared_data("rosbag1") else {
        return;
    };
    let error = RosbagReader::open(&data.join("version_1.2.bag"), Selection::All).unwrap_err();
    assert!(
        matches!(error, RecordingError::UnsupportedVersion { .. }),
        "{error}"
    );
}

proptest! {
    #[test]
    fn any_bytes_behind_the_first_line_are_survived(
        content in prop::collection::vec(any::<u8>(), 0..3000)
    ) {
        let mut reader = open(&[MAGIC, &content].concat());
        prop_assert!(read_all(&mut reader).is_empty());
        prop_assert_eq!(reader.losses().total() > 0, !content.is_empty());
    }

    #[test]
    fn any_damage_is_survived(
        compression in prop::sample::select(vec!["none", "bz2", "lz4"]),
        cut in 13_usize..2000,
        flips in prop::collection::vec((13_usize..2000, any::<u8>()), 0..4),
    ) {
        let mut content = bag(&[
            chunk("none", &[connections(), scans(1..4)].concat()),
            index(0, 3),
            chunk(compression, &scans(4..8)),
            index(0, 4),
        ]);
        for (at, byte) in flips {
            if let Some(hit) = content.get_mut(at) {
                *hit = byte;
            }
        }
        content.truncate(cut);
        let mut reader = open(&content);
        prop_assert!(read_all(&mut reader).len() <= 40);
    }
}
