//! Files of others with three-dimensional lidars, whole and damaged.

use std::fs;
use std::path::Path;

use etherparse::PacketBuilder;
use measurement::cloud::Cloud;
use measurement::drops::DropReason;
use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData};

use crate::corruption_tests::Random;
use crate::poses::PoseFile;
use crate::shared_data::shared_data;
use crate::{RecordingError, RecordingReader, Selection, open, open_surveyed};

fn all(reader: &mut dyn RecordingReader) -> Vec<Measurement> {
    std::iter::from_fn(|| reader.next_measurement().unwrap()).collect()
}

fn clouds(measurements: &[Measurement]) -> Vec<(RobotTime, &Cloud)> {
    let clouds = measurements
        .iter()
        .filter_map(|measurement| match &measurement.data {
            MeasurementData::Cloud(cloud) => Some((measurement.stamp, cloud)),
            _ => None,
        });
    clouds.collect()
}

#[test]
fn a_rosbag2_of_velodyne_packets_gives_revolutions() {
    let Some(folder) = shared_data("velodyne") else {
        return;
    };
    let path = folder.join("vlp16_packets.db3");
    let mut reader = open(&path, Selection::All).unwrap();
    let measurements = all(&mut *reader);
    let clouds = clouds(&measurements);
    // The messages are not cut where the azimuth is 0: the first and the last are parts.
    let points: Vec<_> = clouds.iter().map(|(_, cloud)| cloud.points.len()).collect();
    assert_eq!(points.len(), 5);
    assert!(
        points[1..4]
            .iter()
            .all(|points| (14_000..16_000).contains(points)),
        "{points:?}"
    );
    let seconds = clouds
        .windows(2)
        .map(|pair| pair[1].0.since(pair[0].0).as_secs_f64());
    assert!(seconds.skip(1).all(|seconds| (seconds - 0.1).abs() < 0.002));
    let last = clouds[2].1.points.last().unwrap();
    assert!((last.after_s - 0.0998).abs() < 0.002, "{last:?}");
    assert_eq!(reader.losses().total(), 0);
    assert_eq!(reader.streams()[0].messages, 4);
    let position = reader.position();
    assert_eq!(position.bytes_read, position.bytes_total);
}

/// The driver of a SICK laser published each scan as a cloud, too.
#[test]
fn clouds_of_a_drivers_scans_are_where_their_beams_end() {
    let Some(folder) = shared_data("rosbag1") else {
        return;
    };
    let mut reader = open(&folder.join("lms1xx_with_tf.bag"), Selection::All).unwrap();
    let measurements = all(&mut *reader);
    let clouds = clouds(&measurements);
    let (mut points, mut farthest_m) = (0, 0.0_f64);
    for measurement in &measurements {
        let MeasurementData::Scan { scan, .. } = &measurement.data else {
            continue;
        };
        let beams = (0..).zip(&scan.ranges_m).map(|(beam, range_m)| {
            let step_rad = f64::from(scan.angle_increment_rad);
            let angle_rad = f64::from(scan.angle_min_rad) + step_rad * f64::from(beam);
            [libm::cos(angle_rad), libm::sin(angle_rad)].map(|share| share * f64::from(*range_m))
        });
        let ends: Vec<_> = beams.collect();
        let of_scan = |(stamp, cloud): &&(RobotTime, &Cloud)| {
            *stamp == measurement.stamp && cloud.points.len() > ends.len() / 2
        };
        let (_, cloud) = clouds.iter().find(of_scan).unwrap();
        points += cloud.points.len();
        for point in &cloud.points {
            let [x_m, y_m, _] = point.position_m.map(f64::from);
            let distances_m = ends
                .iter()
                .map(|end| libm::hypot(x_m - end[0], y_m - end[1]));
            farthest_m = farthest_m.max(distances_m.fold(f64::MAX, f64::min));
        }
    }
    assert_eq!(points, 45_804);
    assert!(farthest_m < 1e-5, "{farthest_m}");
}

#[test]
fn captures_of_ouster_are_read_with_the_metadata_beside_them() {
    let Some(folder) = shared_data("ouster") else {
        return;
    };
    for (name, revolutions, beams) in [
        ("os0-32_fw2.2.pcap", 1, 32 * 1024),
        ("os1-128_fw2.3_3scans.pcap", 3, 128 * 1024),
    ] {
        let mut reader = open(&folder.join(name), Selection::All).unwrap();
        let measurements = all(&mut *reader);
        let clouds = clouds(&measurements);
        assert_eq!(
            (clouds.len(), reader.losses().total()),
            (revolutions, 0),
            "{name}"
        );
        for (_, cloud) in clouds {
            // Some beams have two returns.
            let found = cloud.points.len() + cloud.without_return as usize;
            assert!(
                (beams..beams + beams / 50).contains(&found),
                "{name}: {found}"
            );
        }
        assert_eq!(&*measurements[0].frame, "os_sensor");
    }
}

#[test]
fn poses_beside_a_capture_are_transforms_at_the_times_of_its_clouds() {
    let Some(folder) = shared_data("ouster") else {
        return;
    };
    let poses = PoseFile::read(&folder.join("os1-128_fw2.3_3scans.poses.txt")).unwrap();
    let path = folder.join("os1-128_fw2.3_3scans.pcap");
    let mut reader = open_surveyed(&path, Selection::All, None, Some(poses)).unwrap();
    let measurements = all(&mut *reader);
    let transforms = measurements
        .iter()
        .filter_map(|measurement| match &measurement.data {
            MeasurementData::Transform {
                child,
                parent_from_child,
                is_static: false,
            } => {
                assert_eq!((&*measurement.frame, &**child), ("odom", "os_sensor"));
                Some((measurement.stamp, parent_from_child.translation.vector))
            }
            _ => None,
        });
    let transforms: Vec<_> = transforms.collect();
    let clouds = clouds(&measurements);
    assert_eq!((transforms.len(), clouds.len()), (4, 3));
    for (transform, cloud) in transforms.iter().zip(&clouds) {
        assert_eq!(transform.0, cloud.0);
    }
    assert!((transforms[1].1.x - 0.245_41).abs() < 1e-5);
    // It goes on as before.
    let [second, third, after] = [1, 2, 3].map(|at| transforms[at].1);
    assert!(((after - third) - (third - second)).norm() < 0.02);
    assert_eq!(reader.streams()[0].stream.name, "/poses");
    assert_eq!(reader.streams()[1].messages, 192);
}

#[test]
fn pose_files_that_lie_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("poses.txt");
    let read = |text: &str| {
        fs::write(&path, text).unwrap();
        PoseFile::read(&path)
    };
    let identity = "1 0 0 0 0 1 0 0 0 0 1 0";
    let tum = "2.5 1 2 3 0 0 0 1";
    assert!(
        matches!(read(&format!("# x\n{tum}\n1.5 0 0 0 0 0 0 1")), Ok(PoseFile::Stamped(poses))
        if poses[0].0 == RobotTime::from_nanos(1_500_000_000) && poses.len() == 2)
    );
    assert!(matches!(read(identity), Ok(PoseFile::ForEachCloud(poses)) if poses.len() == 1));
    for (text, says) in [
        ("", "there are no poses"),
        (&*format!("{identity}\n1 2 3"), "line 2: 3 numbers"),
        (
            &*format!("{identity}\n{tum}"),
            "some lines have 12 numbers, others 8",
        ),
        (
            "1 0 0 0 0 2 0 0 0 0 1 0",
            "line 1: no pose: its matrix is no rotation",
        ),
        (
            "1 0 0 0 0 1 0 0 0 0 -1 0",
            "line 1: no pose: its matrix is no rotation",
        ),
        (
            "1 0 0 NaN 0 1 0 0 0 0 1 0",
            "line 1: no pose: its matrix is no rotation",
        ),
        (
            "1 0 0 0 0 0 0 0",
            "line 1: no pose: its time or quaternion cannot be",
        ),
        ("1 0 0 x", "line 1: invalid float literal"),
    ] {
        let error = read(text).unwrap_err().to_string();
        assert!(error.contains(says), "{text:?}: {error}");
    }
}

/// Clouds, and losses with their notes.
type Read = (usize, Vec<(DropReason, u64)>, Vec<String>);

/// What a damaged copy of a file gives: its clouds and its losses, or why it cannot be opened.
fn damaged(
    file: &Path,
    metadata: Option<&Path>,
    damage: impl FnOnce(&mut Vec<u8>),
) -> Result<Read, RecordingError> {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join(file.file_name().unwrap());
    let mut bytes = fs::read(file).unwrap();
    damage(&mut bytes);
    fs::write(&copy, bytes).unwrap();
    if let Some(metadata) = metadata {
        fs::copy(metadata, folder.path().join(metadata.file_name().unwrap())).unwrap();
    }
    let mut reader = open(&copy, Selection::All)?;
    let clouds = clouds(&all(&mut *reader)).len();
    Ok((
        clouds,
        reader.losses().iter().collect(),
        reader.loss_notes().to_vec(),
    ))
}

#[test]
fn damaged_files_are_read_as_far_as_they_go() {
    let (Some(ouster), Some(velodyne)) = (shared_data("ouster"), shared_data("velodyne")) else {
        return;
    };
    let capture = ouster.join("os1-128_fw2.3_3scans.pcap");
    let metadata = ouster.join("os1-128_fw2.3.json");
    let half = |bytes: &mut Vec<u8>| bytes.truncate(bytes.len() / 2 + 100);
    let (clouds, losses, notes) = damaged(&capture, Some(&metadata), half).unwrap();
    assert_eq!(
        (clouds, losses),
        (2, vec![(DropReason::CutOff, 1)]),
        "{notes:?}"
    );
    assert!(notes[0].contains("the rest is not read"), "{notes:?}");
    let (clouds, losses, _) = damaged(&capture, None, |_| {}).unwrap();
    assert_eq!(
        (clouds, losses),
        (0, vec![]),
        "without metadata nobody knows the packets"
    );
    let cut = damaged(&capture, None, |bytes| bytes.truncate(10)).unwrap_err();
    assert!(cut.to_string().contains("copy it again"), "{cut}");
    let other = ouster.join("os0-32_fw2.2.json");
    let renamed = tempfile::tempdir().unwrap();
    let wrong = renamed.path().join("os1-128_fw2.3.json");
    fs::copy(other, &wrong).unwrap();
    // Its packets have the same length.
    let (clouds, losses, notes) = damaged(&capture, Some(&wrong), |_| {}).unwrap();
    assert_eq!((clouds, losses), (0, vec![(DropReason::Undecodable, 192)]));
    assert!(notes[0].contains("serial number 122201000998"), "{notes:?}");
    fs::write(
        &wrong,
        "{\"udp_profile_lidar\": \"FUSA_RNG15_RFL8_NIR8_DUAL\"}",
    )
    .unwrap();
    let refused = damaged(&capture, Some(&wrong), |_| {})
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("FUSA_RNG15_RFL8_NIR8_DUAL are not decoded"),
        "{refused}"
    );

    let bag = velodyne.join("vlp16_packets.db3");
    let (clouds, losses, notes) = damaged(&bag, None, half).unwrap();
    assert!(clouds < 5, "{clouds}");
    assert_eq!(losses, [(DropReason::Damaged, 1)], "{notes:?}");
    assert!(notes[0].contains("SQLite says: "), "{notes:?}");
    let header = damaged(&bag, None, |bytes| bytes.truncate(200))
        .unwrap_err()
        .to_string();
    assert!(header.contains("SQLite says: "), "{header}");
    let mark = |bytes: &mut Vec<u8>| {
        let packet = bytes
            .windows(4)
            .position(|at| at == [0xFF, 0xEE, 0xFF, 0xEE]);
        let at =
            packet.unwrap_or_else(|| bytes.windows(2).position(|at| at == [0xFF, 0xEE]).unwrap());
        bytes[at] = 0;
    };
    let (clouds, losses, notes) = damaged(&bag, None, mark).unwrap();
    assert_eq!(
        (clouds, losses),
        (5, vec![(DropReason::Undecodable, 1)]),
        "{notes:?}"
    );
}

#[test]
fn packets_that_are_missing_or_damaged_in_a_capture_are_counted_once() {
    /// Of its file, and of a record with a packet of 16 columns.
    const RECORD: usize = 16 + 8490;
    const FIRST_COLUMN: usize = 16 + 42 + 32 + 8;
    /// Where the records of three packets begin.
    const AT: [usize; 3] = [144_944, 153_450, 161_956];
    let Some(folder) = shared_data("ouster") else {
        return;
    };
    let capture = folder.join("os1-128_fw2.3_3scans.pcap");
    let metadata = folder.join("os1-128_fw2.3.json");
    let damage = |bytes: &mut Vec<u8>, at: usize| bytes[at + FIRST_COLUMN..][..2].fill(0xFF);
    let read = |change: &dyn Fn(&mut Vec<u8>)| {
        let (clouds, losses, notes) = damaged(&capture, Some(&metadata), change).unwrap();
        assert_eq!(clouds, 3);
        (losses, notes.join("; "))
    };
    let remove =
        |bytes: &mut Vec<u8>, records: usize| drop(bytes.drain(AT[0]..AT[0] + records * RECORD));
    let (losses, notes) = read(&|bytes| remove(bytes, 1));
    assert_eq!(losses, [(DropReason::Lost, 1)]);
    assert!(notes.contains("1 packets before it are missing"), "{notes}");
    assert_eq!(read(&|bytes| remove(bytes, 3)).0, [(DropReason::Lost, 3)]);
    let (losses, notes) = read(&|bytes| damage(bytes, AT[1]));
    assert_eq!(losses, [(DropReason::Undecodable, 1)]);
    assert!(
        notes.contains("/udp_7502: message 19: a packet that is damaged"),
        "{notes}"
    );
    let both = |bytes: &mut Vec<u8>| {
        damage(bytes, AT[2]);
        remove(bytes, 2);
    };
    assert_eq!(
        read(&both).0,
        [(DropReason::Undecodable, 1), (DropReason::Lost, 2)]
    );
}

/// Frames of Ethernet: packets of a VLP-16, one of them in two fragments, and another datagram.
fn frames() -> Vec<Vec<u8>> {
    let packet = |number: u8| {
        let mut packet = Vec::new();
        for block in 0..12_u16 {
            packet.extend([0xFF, 0xEE]);
            packet.extend((u16::from(number) * 480 + 40 * block).to_le_bytes());
            packet.extend([200, 4, 100].repeat(32));
        }
        packet.extend((u32::from(number) * 1327).to_le_bytes());
        packet.extend([0x37, 0x22]);
        packet
    };
    let ethernet = || PacketBuilder::ethernet2([1; 6], [2; 6]);
    let datagram = |port: u16, payload: &[u8]| {
        let mut frame = Vec::new();
        let udp = ethernet()
            .ipv4([10, 0, 0, 1], [10, 0, 0, 2], 64)
            .udp(port, port);
        udp.write(&mut frame, payload).unwrap();
        frame
    };
    let mut frames: Vec<_> = (0..4)
        .map(|number| datagram(2368, &packet(number)))
        .collect();
    frames.push(datagram(7503, &[5; 48]));
    // Behind the headers of Ethernet and IP; 608 bytes in the first fragment.
    let whole = datagram(2368, &packet(4));
    let (head, udp) = whole.split_at(14 + 20);
    for (part, offset) in [(&udp[..608], 0x2000_u16), (&udp[608..], 76)] {
        let mut frame = [head, part].concat();
        frame[16..18].copy_from_slice(&(20 + part.len() as u16).to_be_bytes());
        frame[20..22].copy_from_slice(&offset.to_be_bytes());
        frames.push(frame);
    }
    frames
}

/// The same frames as both kinds of capture.
fn small_captures() -> [Vec<u8>; 2] {
    let words = |words: &[u32]| {
        words
            .iter()
            .flat_map(|word| word.to_le_bytes())
            .collect::<Vec<_>>()
    };
    let mut pcap = words(&[0xA1B2_C3D4, 0x0004_0002, 0, 0, 65_535, 1]);
    let mut pcapng = words(&[0x0A0D_0D0A, 28, 0x1A2B_3C4D, 1, u32::MAX, u32::MAX, 28]);
    pcapng.extend(words(&[1, 20, 1, 0, 20]));
    for (frame, at) in frames().iter().zip(0..) {
        let length = frame.len() as u32;
        pcap.extend(words(&[1, at * 1327, length, length]));
        pcap.extend(frame);
        let padded = length.next_multiple_of(4);
        pcapng.extend(words(&[6, 32 + padded, 0, 0, at * 1327, length, length]));
        pcapng.extend(frame);
        pcapng.extend(vec![0; (padded - length) as usize]);
        pcapng.extend(words(&[32 + padded]));
    }
    [pcap, pcapng]
}

/// Points in clouds, and losses.
fn points_of(path: &Path) -> Result<(usize, u64), RecordingError> {
    let mut reader = open(path, Selection::All)?;
    let mut points = 0;
    while let Some(measurement) = reader.next_measurement()? {
        if let MeasurementData::Cloud(cloud) = measurement.data {
            points += cloud.points.len();
        }
    }
    Ok((points, reader.losses().total()))
}

#[test]
fn both_kinds_of_capture_and_fragments_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for capture in small_captures() {
        let path = folder.path().join("capture");
        fs::write(&path, capture).unwrap();
        assert_eq!(points_of(&path).unwrap(), (5 * 12 * 32, 0));
    }
}

/// `FUZZ_INPUTS` for each kind, five million if not set: each is a file, best in memory (`TMPDIR`). Each reader has a buffer of 8 MB, which
/// `malloc` clears where it has been used before: most of the time, unless `MALLOC_MMAP_THRESHOLD_=131072` has it mapped anew.
#[test]
#[ignore = "minutes: damaged captures"]
fn damaged_captures_are_survived_in_release() {
    let inputs = std::env::var("FUZZ_INPUTS").map_or(5_000_000, |text| text.parse().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("capture");
    let mut random = Random(1);
    for capture in small_captures() {
        let (mut refused, mut with_losses, mut points) = (0, 0, 0);
        for _ in 0..inputs {
            let mut bytes = capture.clone();
            for _ in 0..=random.below(8) {
                let at = random.below(bytes.len() as u64) as usize;
                // Headers are few bytes of many.
                let at = if random.below(2) == 0 { at } else { at % 200 };
                bytes[at] = [0, 1, 0xFF, random.below(256) as u8][random.below(4) as usize];
            }
            if random.below(8) == 0 {
                bytes.truncate(random.below(bytes.len() as u64) as usize);
            }
            fs::write(&path, &bytes).unwrap();
            match points_of(&path) {
                Ok((found, losses)) => {
                    assert!(found <= 5 * 12 * 32, "{found}");
                    points += found;
                    with_losses += u64::from(losses > 0);
                }
                Err(_) => refused += 1,
            }
        }
        println!("{inputs} inputs: {refused} refused, {with_losses} with losses, {points} points");
    }
}
