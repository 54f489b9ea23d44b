//! The contents of `--summary FILE.json`. Field names are a contract with scripts.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::Path;
use std::time::Duration;

use hdrhistogram::{CreationError, Histogram};
use serde::Serialize;

use measurement::drops::DropCounts;

#[derive(Clone, Debug, PartialEq, Default, Serialize)]
pub struct Summary {
    /// Name of the recording or of the simulated world.
    pub recording: String,
    /// `vehicle.name`.
    pub vehicle: String,
    /// Time of the data that was mapped, across clock resets, seconds.
    pub duration_s: f64,
    pub wall_s: f64,
    /// [`Self::duration_s`] / [`Self::wall_s`]; `null` if no time passed.
    pub realtime_factor: Option<f64>,
    pub scans: Scans,
    pub beams: Beams,
    /// Losses of the source by reason: messages and records, including scans, and invalid wheel angles and
    /// attitudes.
    #[serde(serialize_with = "by_reason")]
    pub losses: DropCounts,
    pub stages: BTreeMap<String, StageTimes>,
    pub layers: BTreeMap<String, LayerFigures>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxels: Option<Voxels>,
    pub tiles: Tiles,
    /// Where scans are matched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scan_matching: Option<ScanMatching>,
    /// Peak memory of the process, bytes; `null` if the system does not report it.
    pub peak_rss_bytes: Option<u64>,
    pub events: Vec<Event>,
}

#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Scans {
    #[serde(rename = "in")]
    pub came_in: u64,
    pub mapped: u64,
    #[serde(serialize_with = "by_reason")]
    pub dropped: DropCounts,
}

#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Beams {
    #[serde(rename = "in")]
    pub came_in: u64,
    pub hits: u64,
    /// Beams without a return.
    pub misses: u64,
    #[serde(serialize_with = "by_reason")]
    pub dropped: DropCounts,
}

#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize)]
pub struct LayerFigures {
    pub cells_known: u64,
    /// Cells by class.
    pub counts: BTreeMap<String, u64>,
    /// BLAKE3 of the cells in a defined order, hexadecimal.
    pub digest: String,
    /// Memory of the layer.
    pub bytes: u64,
}

#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Voxels {
    /// Voxels that are more likely occupied than not.
    pub occupied: u64,
    /// Voxels that are known and not occupied.
    pub free: u64,
    /// Memory of all of them.
    pub bytes: u64,
    /// Bricks that went to disk to keep the memory limit; many came back.
    pub disk_bricks: usize,
    /// Bricks that became one voxel each to keep it.
    pub coarse_bricks: usize,
    /// Bricks that were evicted to keep it.
    pub evicted_bricks: usize,
    /// BLAKE3 of the known voxels in a defined order, hexadecimal.
    pub digest: String,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Tiles {
    /// All versions of all tiles.
    pub published: u64,
    /// Encoded size.
    pub bytes: u64,
    /// Size before encoding.
    pub raw_bytes: u64,
}

/// How sure the poses of matched scans are.
#[derive(Clone, Debug, PartialEq, Default, Serialize)]
pub struct ScanMatching {
    /// Scans whose pose the map determines.
    pub determined: u64,
    /// Scans whose pose the map does not determine along one direction.
    pub uncertain_along: u64,
    /// Scans that do not fit the map: their poses are those of odometry.
    pub odometry_only: u64,
    /// Scans whose pose is not known.
    pub lost: u64,
    #[serde(serialize_with = "by_reason")]
    pub dropped: DropCounts,
    pub closures: u64,
    /// Closures that later evidence contradicted.
    pub closures_removed: u64,
    /// Positions on Earth in the map.
    pub positions: u64,
    /// Of these, those that the map contradicts.
    pub positions_contradicted: u64,
    /// The vehicle was not found in the map that it was to go on in: the map is of this run alone.
    pub is_searching: bool,
    /// Of the last scan: covariance of x, y (m²) and yaw (rad²) relative to its submap, in the frame of the vehicle, row by row.
    pub last_covariance: Option<[[f64; 3]; 3]>,
    /// Of the last scan: distance of its points from the surfaces of the map, root mean square, metres.
    pub last_residual_m: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Default, Serialize)]
pub struct Event {
    /// Time of the data, seconds; `null` if unknown.
    pub stamp_s: Option<f64>,
    pub kind: String,
    pub message: String,
}

impl Summary {
    pub fn set_times(&mut self, duration_s: f64, wall_s: f64) {
        self.duration_s = duration_s;
        self.wall_s = wall_s;
        self.realtime_factor = Some(duration_s / wall_s).filter(|factor| factor.is_finite());
    }

    /// Writes the summary under a temporary name and renames it, so that `path` is always complete. Writes to
    /// special files (`/dev/stdout`) directly.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        if fs::metadata(path).is_ok_and(|metadata| !metadata.is_file()) {
            return self.write_to(File::options().write(true).open(path)?);
        }
        let name = path.file_name().ok_or(io::ErrorKind::InvalidInput)?;
        let mut temporary = name.to_owned();
        temporary.push(format!(".{}.tmp", std::process::id()));
        let temporary = path.with_file_name(temporary);
        let written = File::create(&temporary)
            .and_then(|file| self.write_to(file))
            .and_then(|()| fs::rename(&temporary, path));
        if written.is_err() {
            // The first error is returned.
            drop(fs::remove_file(&temporary));
        }
        written
    }

    fn write_to(&self, file: File) -> io::Result<()> {
        let mut out = BufWriter::new(file);
        serde_json::to_writer_pretty(&mut out, self)?;
        out.write_all(b"\n")?;
        out.flush()
    }
}

/// Peak memory of this process, bytes; `None` if the system does not report it.
pub fn peak_rss_bytes() -> Option<u64> {
    peak_rss_in(&fs::read_to_string("/proc/self/status").ok()?)
}

/// `VmHWM` of proc(5)'s `status`, which is in units of 1024 bytes.
fn peak_rss_in(status: &str) -> Option<u64> {
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

fn by_reason<S: serde::Serializer>(drops: &DropCounts, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(drops.iter().map(|(reason, n)| (reason.as_str(), n)))
}

/// Longest time that the percentiles resolve, nanoseconds.
const LONGEST_NS: u64 = 60_000_000_000;
/// Percentiles are within 1 %.
const SIGNIFICANT_DIGITS: u8 = 2;

/// Processing times of one stage: a histogram of 32 kB at most.
#[derive(Clone, Debug)]
pub struct StageTimer {
    histogram: Histogram<u64>,
    max: Duration,
}

/// Processing times, microseconds; zero if the stage never ran.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize)]
pub struct StageTimes {
    pub p50_us: f64,
    pub p99_us: f64,
    /// Longest, exact.
    pub max_us: f64,
}

impl StageTimer {
    #[expect(
        clippy::expect_used,
        reason = "constant bounds, which a test constructs"
    )]
    pub fn new() -> Self {
        Self {
            histogram: bounded().expect("bounds are in order"),
            max: Duration::ZERO,
        }
    }

    pub fn record(&mut self, time: Duration) {
        let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.histogram.saturating_record(nanos);
        self.max = self.max.max(time);
    }

    pub fn runs(&self) -> u64 {
        self.histogram.len()
    }

    pub fn times(&self) -> StageTimes {
        let max_us = self.max.as_secs_f64() * 1e6;
        // The upper end of a bucket can exceed the longest time in it.
        let quantile_us = |q| (self.histogram.value_at_quantile(q) as f64 / 1e3).min(max_us);
        StageTimes {
            p50_us: quantile_us(0.5),
            p99_us: quantile_us(0.99),
            max_us,
        }
    }
}

impl Default for StageTimer {
    fn default() -> Self {
        Self::new()
    }
}

fn bounded() -> Result<Histogram<u64>, CreationError> {
    Histogram::new_with_bounds(1, LONGEST_NS, SIGNIFICANT_DIGITS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::drops::DropReason;
    use serde_json::json;

    fn summary() -> Summary {
        let mut summary = Summary {
            recording: "intel.log".to_owned(),
            vehicle: "generic2d".to_owned(),
            peak_rss_bytes: Some(4096),
            ..Summary::default()
        };
        summary.set_times(30.0, 0.5);
        summary.scans.came_in = 910;
        summary.scans.mapped = 907;
        summary.scans.dropped.add_many(DropReason::PoseGap, 3);
        summary.beams.dropped.add(DropReason::InvalidRange);
        let times = StageTimes {
            p50_us: 1.0,
            p99_us: 2.0,
            max_us: 3.5,
        };
        summary.stages.insert("integrate".to_owned(), times);
        let layer = LayerFigures {
            cells_known: 2,
            counts: BTreeMap::from([("occupied".to_owned(), 2)]),
            digest: "ab".to_owned(),
            bytes: 64,
        };
        summary.layers.insert("occupancy".to_owned(), layer);
        summary.events.push(Event {
            stamp_s: None,
            kind: "vehicle".to_owned(),
            message: "one planar laser: generic2d".to_owned(),
        });
        summary
    }

    #[test]
    fn names_are_those_of_the_contract() {
        let expected = json!({
            "recording": "intel.log",
            "vehicle": "generic2d",
            "duration_s": 30.0,
            "wall_s": 0.5,
            "realtime_factor": 60.0,
            "scans": {"in": 910, "mapped": 907, "dropped": {"pose_gap": 3}},
            "beams": {"in": 0, "hits": 0, "misses": 0, "dropped": {"invalid_range": 1}},
            "losses": {},
            "stages": {"integrate": {"p50_us": 1.0, "p99_us": 2.0, "max_us": 3.5}},
            "layers": {"occupancy":
                {"cells_known": 2, "counts": {"occupied": 2}, "digest": "ab", "bytes": 64}},
            "tiles": {"published": 0, "bytes": 0, "raw_bytes": 0},
            "peak_rss_bytes": 4096,
            "events": [{"stamp_s": null, "kind": "vehicle", "message": "one planar laser: generic2d"}],
        });
        assert_eq!(serde_json::to_value(summary()).unwrap(), expected);
    }

    #[test]
    fn no_time_has_no_factor() {
        let mut summary = Summary::default();
        summary.set_times(0.0, 0.0);
        assert_eq!(summary.realtime_factor, None);
    }

    #[test]
    fn the_file_appears_whole_or_not_at_all() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("s.json");
        fs::write(&path, "old").unwrap();
        summary().write(&path).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let read: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(read["scans"]["in"], 910);
        assert!(text.ends_with("}\n"));
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);

        let nowhere = directory.path().join("no/such/s.json");
        assert_eq!(
            summary().write(&nowhere).unwrap_err().kind(),
            io::ErrorKind::NotFound
        );
        assert!(summary().write(Path::new("/dev/null")).is_ok());
        assert!(
            summary().write(directory.path()).is_err(),
            "a directory is not a file"
        );
    }

    #[test]
    fn peak_memory_is_read_from_the_status_of_the_process() {
        assert_eq!(
            peak_rss_in("Name:\tx\nVmHWM:\t   12345 kB\nVmRSS:\t 1 kB\n"),
            Some(12_641_280)
        );
        for status in [
            "",
            "VmHWM:\t",
            "VmHWM: 1 MB",
            "VmHWM: 99999999999999999999 kB",
        ] {
            assert_eq!(peak_rss_in(status), None, "{status}");
        }
        #[cfg(target_os = "linux")]
        assert!(peak_rss_bytes().unwrap() > 1 << 20);
    }
}

#[cfg(test)]
mod stage_timer_tests {
    use super::*;

    #[test]
    fn percentiles_are_within_one_percent() {
        let mut timer = StageTimer::new();
        for micros in 1..=10_000 {
            timer.record(Duration::from_micros(micros));
        }
        let times = timer.times();
        assert!((times.p50_us / 5_000.0 - 1.0).abs() < 0.01, "{times:?}");
        assert!((times.p99_us / 9_900.0 - 1.0).abs() < 0.01, "{times:?}");
        assert!((times.max_us - 10_000.0).abs() < 1e-9, "{times:?}");
        assert_eq!(timer.runs(), 10_000);
    }

    #[test]
    fn no_runs_and_endless_runs_are_harmless() {
        let mut timer = StageTimer::new();
        assert_eq!(timer.times(), StageTimes::default());
        timer.record(Duration::ZERO);
        assert_eq!(timer.times(), StageTimes::default());
        timer.record(Duration::MAX);
        assert!(timer.times().max_us > 1e24);
        assert!(timer.histogram.distinct_values() * size_of::<u64>() < 32_000);
    }
}
