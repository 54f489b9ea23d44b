//! Published recordings, whole and damaged in thousands of ways; the latter is too slow for every run:
//!
//! `cargo test --release -p recording -- --ignored --nocapture corruption_tests`

use std::collections::BTreeMap;
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
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, limit: u64) -> u64 {
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

fn damage_published(folder: &str) {
    for published in PUBLISHED {
        if published.name.starts_with(folder) {
            damage(published.name, 1000);
        }
    }
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_logs_are_survived_in_release() {
    damage_published("carmen/");
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_bags_are_survived_in_release() {
    damage_published("rosbag1/");
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn damaged_mcaps_are_survived_in_release() {
    damage_published("mcap/");
}

#[test]
#[ignore = "minutes: thousands of damaged files"]
fn the_damaged_clip_is_survived_in_release() {
    damage(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../recordings/rooms.mcap"),
        1000,
    );
}

/// A recording that others published, and what comes out of it.
struct Published {
    name: &'static str,
    /// Streams of scans: number of scans, least and greatest number of beams.
    scans: &'static [(&'static str, usize, [usize; 2])],
    /// Stamps, counted by another program: half the `ODOM` lines of corrected logs have none.
    repaired: u64,
    late: u64,
    damaged: u64,
}

const fn published(
    name: &'static str,
    scans: &'static [(&'static str, usize, [usize; 2])],
    [repaired, late, damaged]: [u64; 3],
) -> Published {
    Published {
        name,
        scans,
        repaired,
        late,
        damaged,
    }
}

const PUBLISHED: [Published; 13] = [
    published(
        "carmen/intel-corrected.log",
        &[("FLASER", 910, [180, 180])],
        [2516, 0, 0],
    ),
    published(
        "carmen/aces-corrected.log",
        &[("FLASER", 440, [180, 180])],
        [440, 0, 0],
    ),
    published(
        "carmen/csail-corrected.log",
        &[("FLASER", 406, [361, 361])],
        [812, 0, 0],
    ),
    published(
        "carmen/belgioioso-corrected.log",
        &[("FLASER", 395, [361, 361])],
        [790, 0, 0],
    ),
    published(
        "carmen/infinite-corridor-corrected.log",
        &[("FLASER", 1941, [180, 180])],
        [3923, 0, 0],
    ),
    published(
        "carmen/aces.clf",
        &[("FLASER", 7374, [180, 180])],
        [0, 0, 0],
    ),
    published(
        "carmen/fr-clinic_robotlaser.clf",
        &[("ROBOTLASER1", 6917, [180, 181])],
        [0, 0, 0],
    ),
    published(
        "rosbag1/urg04lx_handheld.bag",
        &[("/scan", 360, [681, 681])],
        [0, 0, 0],
    ),
    published(
        "rosbag1/two_lasers.bag",
        &[
            ("/front_scan", 331, [726, 726]),
            ("/rear_scan", 330, [726, 726]),
        ],
        [0, 0, 0],
    ),
    published(
        "rosbag1/lms1xx_with_tf.bag",
        &[("/sick_lms_1xx/scan", 89, [541, 541])],
        [0, 0, 0],
    ),
    // The indexes behind its two chunks claim 20 bytes an entry and have 12.
    published(
        "rosbag1/damaged_index.bag",
        &[("/scan", 360, [681, 681])],
        [0, 0, 2],
    ),
    published(
        "mcap/intel_corrected.mcap",
        &[("/scan", 910, [180, 180])],
        [0, 0, 0],
    ),
    // One pose of AMCL is 5.8 s older than the odometry beside it.
    published("mcap/turtlebot_tf_odom.mcap", &[], [0, 1, 0]),
];

#[test]
fn every_scan_of_the_published_recordings_comes_out_in_order() {
    let Some(data) = shared_data("") else { return };
    for expected in PUBLISHED {
        let (name, is_log) = (expected.name, expected.name.starts_with("carmen/"));
        let mut reader = super::open(&data.join(name), Selection::All).unwrap();
        let mut order = TimeSequencer::default();
        let mut last_stamps = BTreeMap::new();
        let (mut beams, mut in_order) = (BTreeMap::<_, Vec<usize>>::new(), 0);
        let mut count = |order: &mut TimeSequencer| {
            while let Some(item) = order.pop() {
                match item {
                    Ordered::Measurement(m) => {
                        in_order += usize::from(matches!(m.data, MeasurementData::Scan { .. }));
                    }
                    Ordered::ClockReset { .. } => panic!("{name}: its clock is reset"),
                }
            }
        };
        while let Some(measurement) = reader.next_measurement().unwrap() {
            if let MeasurementData::Scan { scan, own_pose } = &measurement.data {
                assert_eq!(own_pose.is_some(), is_log, "{name}");
                let stream = &reader.streams()[usize::from(measurement.stream.0)].stream;
                let beams = beams.entry(stream.name.clone()).or_default();
                beams.push(scan.ranges_m.len());
            }
            let last = last_stamps.insert(measurement.stream, measurement.stamp);
            let is_ordered = last.is_none_or(|last| last <= measurement.stamp);
            assert!(is_ordered || !is_log, "{name}");
            order.push(measurement);
            count(&mut order);
        }
        order.finish();
        count(&mut order);
        let found: Vec<_> = beams
            .iter()
            .map(|(stream, beams)| {
                let [least, most] = [beams.iter().min(), beams.iter().max()].map(Option::unwrap);
                (stream.as_str(), beams.len(), [*least, *most])
            })
            .collect();
        assert_eq!(found, expected.scans, "{name}");
        let scans: usize = expected.scans.iter().map(|(_, scans, _)| scans).sum();
        assert_eq!(in_order, scans, "{name}");
        assert_eq!(reader.stamp_repairs(), expected.repaired, "{name}");
        assert_eq!(order.drops().get(DropReason::Late), expected.late, "{name}");
        let (losses, notes) = (reader.losses(), reader.loss_notes());
        let damaged = [DropReason::Damaged, DropReason::CutOff].map(|reason| losses.get(reason));
        assert_eq!(damaged, [expected.damaged, 0], "{name}: {notes:?}");
        assert!(!is_log || losses.total() == 0, "{name}: {notes:?}");
    }
}
