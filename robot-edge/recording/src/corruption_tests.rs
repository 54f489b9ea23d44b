//! Real recordings, damaged in thousands of ways: too slow for every run.
//!
//! `cargo test --release -p recording -- --ignored --nocapture corruption_tests`

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::shared_data::shared_data;
use super::time_sequencer::{Ordered, TimeSequencer};
use super::{RecordingError, Selection};
use measurement::MeasurementData;
use measurement::drops::{DropCounts, DropReason};

/// What is left of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct ReadResult {
    scans: u64,
    losses: DropCounts,
}

fn read(path: &Path) -> Result<ReadResult, RecordingError> {
    let mut reader = super::open(path, Selection::All)?;
    let mut scans = 0;
    while let Some(measurement) = reader.next_measurement()? {
        scans += u64::from(matches!(measurement.data, MeasurementData::Scan { .. }));
    }
    Ok(ReadResult {
        scans,
        losses: reader.losses().clone(),
    })
}

/// Pseudo-random numbers below `limit`, the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit
    }
}

#[derive(Debug, Default)]
struct Tally {
    variants: u64,
    refused: u64,
    with_losses: u64,
    fewer_scans: u64,
    fewer_scans_uncounted: u64,
    fewest_scans: u64,
    more_scans: u64,
}

impl Tally {
    fn add(&mut self, whole: &ReadResult, result: Result<ReadResult, RecordingError>) {
        self.variants += 1;
        match result {
            Err(_) => self.refused += 1,
            Ok(read) => {
                let is_counted = read
                    .losses
                    .iter()
                    .any(|(reason, count)| count > whole.losses.get(reason));
                self.with_losses += u64::from(is_counted);
                self.fewer_scans += u64::from(read.scans < whole.scans);
                self.fewer_scans_uncounted += u64::from(read.scans < whole.scans && !is_counted);
                self.more_scans += u64::from(read.scans > whole.scans);
                self.fewest_scans = self.fewest_scans.min(read.scans);
            }
        }
    }
}

/// Cuts the file off and changes three bytes of it, each `variants` times.
fn damage(name: &str, variants: u64) {
    // The project's own clip is named by its whole path.
    let Some(data) = shared_data("").or_else(|| name.starts_with('/').then(PathBuf::new)) else {
        return;
    };
    let mut content = Vec::new();
    File::open(data.join(name))
        .unwrap()
        .read_to_end(&mut content)
        .unwrap();
    let length = content.len() as u64;
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(&content).unwrap();
    let whole = read(file.path()).unwrap();
    let mut random = Random(7);
    let start = || Tally {
        fewest_scans: whole.scans,
        ..Tally::default()
    };

    let mut flips = start();
    for _ in 0..variants {
        let places = [(); 3].map(|()| random.below(length));
        for at in places {
            let byte = content[at as usize] ^ (1 + random.below(255)) as u8;
            write_at(file.as_file_mut(), at, byte);
        }
        flips.add(&whole, read(file.path()));
        for at in places {
            write_at(file.as_file_mut(), at, content[at as usize]);
        }
    }
    let mut cuts = start();
    let mut ends: Vec<u64> = (0..variants).map(|_| random.below(length)).collect();
    ends.sort_unstable();
    for end in ends.into_iter().rev() {
        file.as_file_mut().set_len(end).unwrap();
        // A log that is cut between two lines looks complete.
        if name.starts_with("carmen/") && content[..end as usize].ends_with(b"\n") {
            continue;
        }
        cuts.add(&whole, read(file.path()));
    }
    println!(
        "{name}: {whole:?}\n  flips {flips:?}\n  cuts {cuts:?}\n  peak memory {}",
        peak_memory()
    );
    for tally in [flips, cuts] {
        assert_eq!((tally.more_scans, tally.fewer_scans_uncounted), (0, 0));
    }
}

fn write_at(file: &mut File, at: u64, byte: u8) {
    file.seek(SeekFrom::Start(at)).unwrap();
    file.write_all(&[byte]).unwrap();
}

fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    line.unwrap_or("unknown").to_owned()
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_logs_are_survived_in_release() {
    damage("carmen/intel-corrected.log", 1000);
    damage("carmen/aces-corrected.log", 1000);
    damage("carmen/csail-corrected.log", 1000);
    damage("carmen/belgioioso-corrected.log", 1000);
    damage("carmen/infinite-corridor-corrected.log", 1000);
    damage("carmen/aces.clf", 1000);
    damage("carmen/fr-clinic_robotlaser.clf", 1000);
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_bags_are_survived_in_release() {
    damage("rosbag1/urg04lx_handheld.bag", 1000);
    damage("rosbag1/two_lasers.bag", 1000);
    damage("rosbag1/lms1xx_with_tf.bag", 1000);
    damage("rosbag1/damaged_index.bag", 1000);
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_mcaps_are_survived_in_release() {
    damage("mcap/intel_corrected.mcap", 1000);
    damage("mcap/turtlebot_tf_odom.mcap", 1000);
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn the_damaged_clip_is_survived_in_release() {
    damage(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../recordings/rooms.mcap"),
        1000,
    );
}

#[test]
fn stamp_order_keeps_the_scans_of_whole_recordings() {
    let Some(data) = shared_data("") else { return };
    let check = |name: &str, expected_scans: u64, expected_late: u64| {
        let mut reader = super::open(&data.join(name), Selection::All).unwrap();
        let mut order = TimeSequencer::default();
        let (mut scans, mut resets) = (0, 0);
        let mut count = |order: &mut TimeSequencer| {
            while let Some(item) = order.pop() {
                match item {
                    Ordered::Measurement(m) => {
                        scans += u64::from(matches!(m.data, MeasurementData::Scan { .. }));
                    }
                    Ordered::ClockReset { .. } => resets += 1,
                }
            }
        };
        while let Some(measurement) = reader.next_measurement().unwrap() {
            order.push(measurement);
            count(&mut order);
        }
        order.finish();
        count(&mut order);
        let late = order.drops().get(DropReason::Late);
        assert_eq!(
            (scans, late, resets),
            (expected_scans, expected_late, 0),
            "{name}"
        );
    };
    // One pose of AMCL is 5.8 s older than the odometry beside it.
    check("mcap/turtlebot_tf_odom.mcap", 0, 1);
    check("carmen/aces.clf", 7374, 0);
    check("carmen/fr-clinic_robotlaser.clf", 6917, 0);
    check("rosbag1/two_lasers.bag", 661, 0);
    check("rosbag1/lms1xx_with_tf.bag", 89, 0);
    check("rosbag1/damaged_index.bag", 360, 0);
    check("mcap/intel_corrected.mcap", 910, 0);
    check("carmen/intel-corrected.log", 910, 0);
    check("carmen/aces-corrected.log", 440, 0);
    check("carmen/infinite-corridor-corrected.log", 1941, 0);
    check("carmen/csail-corrected.log", 406, 0);
    check("carmen/belgioioso-corrected.log", 395, 0);
}
