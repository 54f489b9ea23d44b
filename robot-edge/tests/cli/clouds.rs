//! Three-dimensional lidars: the same maps from every kind of file.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use etherparse::PacketBuilder;
use measurement::Measurement;
use measurement::time::RobotTime;
use pcap_file::pcap::{PcapPacket, PcapWriter};
use recording::ros::encode;
use recording::{RecordingReader, Selection, StreamSummary, open};
use rusqlite::{Connection, OpenFlags};

use crate::process::{robot_edge, run, summary_of};
use crate::shared_data::shared_data;

const STANDING: &str = "replay --vehicle generic3d --set localization.source=static";

/// The digests of all layers.
fn digests(recording: &Path, options: &[&str]) -> BTreeMap<String, String> {
    let summary = summary_of(robot_edge(STANDING).arg(recording).args(options));
    let layers = summary["layers"].as_object().unwrap().iter();
    let digests = layers.map(|(name, layer)| (name.clone(), layer["digest"].to_string()));
    let digests: BTreeMap<_, _> = digests.collect();
    assert!(digests.len() >= 5, "{digests:?}");
    digests
}

/// All streams and measurements of a recording.
fn contents(path: &Path) -> (Vec<StreamSummary>, Vec<Measurement>) {
    let mut reader: Box<dyn RecordingReader> = open(path, Selection::All).unwrap();
    let all = std::iter::from_fn(|| reader.next_measurement().unwrap()).collect();
    (reader.streams().to_vec(), all)
}

/// Writes a ROS 2 bag as `rosbag2_storage_sqlite3` does.
fn write_db3(path: &Path, topic: (&str, &str), messages: &[(i64, Vec<u8>)]) {
    let file = Connection::open(path).unwrap();
    file.execute_batch(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, \
         serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL); \
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);",
    )
    .unwrap();
    file.execute("INSERT INTO topics VALUES (1, ?1, ?2, 'cdr', '')", topic)
        .unwrap();
    for (time_ns, data) in messages {
        file.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?1, ?2)",
            (time_ns, data),
        )
        .unwrap();
    }
}

#[test]
fn clouds_of_a_bag_an_mcap_and_a_db3_make_the_same_maps() {
    let Some(folder) = shared_data("rosbag1") else {
        return;
    };
    let bag = folder.join("lms1xx_with_tf.bag");
    let made = tempfile::tempdir().unwrap();
    let mcap = made.path().join("clouds.mcap");
    let topic = ["--topic", "lidar=/cloud"];
    let record = [&topic[..], &["--record", mcap.to_str().unwrap()]].concat();
    let of_bag = digests(&bag, &record);
    assert_eq!(digests(&mcap, &topic), of_bag);
    let part = [&topic[..], &["--start", "0.5", "--duration", "1"]].concat();
    let part = summary_of(robot_edge(STANDING).arg(&mcap).args(part));
    assert_eq!(part["scans"]["mapped"], 50, "of 89 in 1.8 s: {part:#}");

    let (streams, measurements) = contents(&mcap);
    let cloud = |measurement: &Measurement| {
        let stream = &streams[usize::from(measurement.stream.0)].stream;
        (stream.name == "/cloud").then(|| {
            let (_, bytes) = encode(measurement, &stream.type_name).unwrap();
            (measurement.stamp.as_nanos(), bytes)
        })
    };
    let messages: Vec<_> = measurements.iter().filter_map(cloud).collect();
    assert_eq!(messages.len(), 89);
    let db3 = made.path().join("clouds.db3");
    write_db3(&db3, ("/cloud", "sensor_msgs/msg/PointCloud2"), &messages);
    assert_eq!(digests(&db3, &[]), of_bag);
}

/// The packets of `vlp16_packets.db3` with their times.
fn packets(folder: &Path) -> Vec<(RobotTime, Vec<u8>)> {
    const PACKET: usize = 1206;
    let path = folder.join("vlp16_packets.db3");
    let file = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY).unwrap();
    let mut rows = file
        .prepare("SELECT data FROM messages ORDER BY id")
        .unwrap();
    let messages = rows.query_map([], |row| row.get::<_, Vec<u8>>(0)).unwrap();
    let mut packets = Vec::new();
    for message in messages {
        let message = message.unwrap();
        let mut at = 0;
        while let Some(mark) = message[at..]
            .windows(2)
            .position(|bytes| bytes == [0xFF, 0xEE])
            && let Some(packet) = message.get(at + mark..at + mark + PACKET)
        {
            // Seconds and nanoseconds are before it.
            let time = &message[at + mark - 8..][..8];
            let word =
                |at: usize| i64::from(u32::from_le_bytes(time[at..at + 4].try_into().unwrap()));
            let stamp = RobotTime::from_nanos(word(0) * 1_000_000_000 + word(4));
            packets.push((stamp, packet.to_vec()));
            at += mark + PACKET;
        }
    }
    packets
}

#[test]
fn packets_of_a_bag_and_of_a_capture_make_the_same_maps() {
    let Some(folder) = shared_data("velodyne") else {
        return;
    };
    let made = tempfile::tempdir().unwrap();
    let capture = made.path().join("packets.pcap");
    let mut writer = PcapWriter::with_header(
        std::fs::File::create(&capture).unwrap(),
        pcap_file::pcap::PcapHeader {
            ts_resolution: pcap_file::TsResolution::NanoSecond,
            ..pcap_file::pcap::PcapHeader::default()
        },
    )
    .unwrap();
    let packets = packets(&folder);
    assert_eq!(packets.len(), 603);
    for (stamp, packet) in packets {
        let ethernet = PacketBuilder::ethernet2([1; 6], [2; 6]);
        let udp = ethernet
            .ipv4([192, 168, 1, 201], [255; 4], 64)
            .udp(2368, 2368);
        let mut frame = Vec::new();
        udp.write(&mut frame, &packet).unwrap();
        let stamp = Duration::from_nanos(stamp.as_nanos() as u64);
        let packet = PcapPacket::new(stamp, frame.len() as u32, &frame);
        writer.write_packet(&packet).unwrap();
    }
    drop(writer);
    let clouds = made.path().join("clouds.mcap");
    let record = ["--record", clouds.to_str().unwrap()];
    let of_bag = digests(&folder.join("vlp16_packets.db3"), &record);
    assert_eq!(digests(&capture, &[]), of_bag);
    assert_eq!(digests(&clouds, &[]), of_bag, "as PointCloud2");
}

#[test]
fn a_capture_with_poses_is_mapped_and_without_says_what_it_needs() {
    let Some(folder) = shared_data("ouster") else {
        return;
    };
    let capture = folder.join("os1-128_fw2.3_3scans.pcap");
    let poses = folder.join("os1-128_fw2.3_3scans.poses.txt");
    let replay = |options: &[&str]| {
        let mut command = robot_edge("replay --vehicle generic3d");
        command.arg(&capture).args(options);
        command
    };
    run(&mut replay(&[])).refuses(2, &["localization.source=static"]);
    let poses = [
        "--poses",
        poses.to_str().unwrap(),
        "--set",
        "sensors.lidar.mount.z_m=1.9",
    ];
    let summary = summary_of(&mut replay(&poses));
    assert_eq!(summary["scans"]["mapped"], 3);
    let cells = |layer: &str| summary["layers"][layer]["cells_known"].as_u64().unwrap();
    assert!(
        cells("elevation") > 15_000 && cells("occupancy") > 200_000,
        "{summary:#}"
    );
    let info = run(robot_edge("info").arg(&capture)).succeeds().stdout;
    assert!(info.contains("--vehicle generic3d"), "{info}");
}
