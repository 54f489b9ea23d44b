//! Whether a range sensor's beams without a return may be believed: its window may be blocked.
//!
//! A planar lidar reports "no return" (+∞, REP-117) in an open field, and the same behind a cover. Two observations tell
//! the cases apart:
//! - the sensor still has returns: of the ground, of a shore, of the vehicle's own body. Without any for
//!   [`RETURN_TIMEOUT`] its misses prove nothing;
//! - misses point at what had returns within the last [`MEMORY`], although the beams still pass there. A cover is fixed to the
//!   sensor, so this is judged for each [`SECTOR_RAD`] of its field of view, and holds until that part has a return again.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Point3, Vector3};

use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use measurement::time::Monotonic;

/// Misses count while the sensor's last return is no older: with a sweep every 200 ms a cover is found within 1 s.
const RETURN_TIMEOUT: Duration = Duration::from_millis(700);
/// Fewer returns in a sweep may be rain, dust or noise.
const MIN_RETURNS: usize = 3;

const MEMORY: Duration = Duration::from_secs(5);
/// Hits are remembered so often …
const MEMORY_PERIOD: Duration = Duration::from_millis(200);
/// … and so many of a sweep, evenly apart.
const MEMORY_BEAMS: usize = 128;

/// The field of view is judged in parts of this width.
const SECTOR_RAD: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// A beam should meet a remembered hit again if it passes so near to it within the plane of the sweep, and …
const TOLERANCE_RAD: f64 = 1.5 * std::f64::consts::PI / 180.0;
/// … so near across it: a laser that tilts passes over the tops of things that it hit just before.
const TOLERANCE_ACROSS_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// Hits beyond this share of the range come and go by themselves.
const NEAR_SHARE: f64 = 0.8;
/// A part is blocked where at least so many remembered hits should be met and are not, …
const MIN_MISSED: u32 = 10;
/// … of so many sweeps, because a single one may have grazed water or a ridge, …
const MIN_REMEMBERED_SWEEPS: u32 = 3;
/// … and it has no return at all, for so long, …
const MISSING_TIME: Duration = Duration::from_millis(600);
/// … and in so many sweeps in a row: a mirror or a pane of glass shows things from few places only.
const MISSING_SWEEPS: u32 = 3;

/// Judges the misses of one range sensor.
#[derive(Clone, Debug, Default)]
pub struct BlockageDetector {
    returned_at: Option<Monotonic>,
    stored_hits: VecDeque<(Monotonic, Point3<f64>)>,
    sectors: Vec<Sector>,
    beam_step_rad: f64,
    /// Whether the newest sweep is young enough after the last return.
    has_returns: bool,
    blockage_counts: BlockageCounts,
}

/// How often what a sensor saw before came into doubt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct BlockageCounts {
    /// A part of its window was found blocked.
    pub(super) blocked: u32,
    /// It had no returns any more, so that its misses prove nothing.
    pub(super) without_returns: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sector {
    /// Remembered hits that this sweep should meet and does not, how many sweeps they are of, and the newest of these.
    missed: u32,
    missed_sweeps: u32,
    missed_at: Option<Monotonic>,
    has_return: bool,
    /// Since when all that should be met was missing in every sweep, and in how many.
    missing: Option<(Monotonic, u32)>,
    is_blocked: bool,
}

impl Sector {
    /// Counts a remembered hit of the sweep at `at` that is not met.
    fn miss(&mut self, at: Monotonic) {
        self.missed += 1;
        self.missed_sweeps += u32::from(self.missed_at.replace(at) != Some(at));
    }

    /// Judges the sweep at `measured_at`, and forgets what was counted for it.
    fn judge(&mut self, measured_at: Monotonic) {
        let is_missing = !self.has_return
            && self.missed >= MIN_MISSED
            && self.missed_sweeps >= MIN_REMEMBERED_SWEEPS;
        self.missing = is_missing.then(|| {
            let (since, sweeps) = self.missing.unwrap_or((measured_at, 0));
            (since, sweeps + 1)
        });
        let is_found = self.missing.is_some_and(|(since, sweeps)| {
            measured_at.since(since) >= MISSING_TIME && sweeps >= MISSING_SWEEPS
        });
        *self = Self {
            missing: self.missing,
            is_blocked: !self.has_return && (self.is_blocked || is_found),
            ..Self::default()
        };
    }
}

impl BlockageDetector {
    /// Takes the newest sweep, measured at `measured_at`.
    pub fn update(&mut self, scan: &RegisteredScan, measured_at: Monotonic) {
        self.beam_step_rad = scan.beam_step_rad;
        let hits = scan.beams.iter().filter(|beam| is_hit(beam));
        if hits.clone().count() + scan.own_body_hits as usize >= MIN_RETURNS {
            self.returned_at = Some(measured_at);
        }
        let had_returns = self.has_returns;
        self.has_returns = self
            .returned_at
            .is_some_and(|returned_at| measured_at.since(returned_at) <= RETURN_TIMEOUT);
        self.blockage_counts.without_returns += u32::from(had_returns && !self.has_returns);
        self.update_sectors(scan, measured_at);
        self.store_hits(hits, measured_at);
    }

    pub(super) const fn blockage_counts(&self) -> BlockageCounts {
        self.blockage_counts
    }

    /// Forgets everything: the poses before cannot be compared with those to come.
    pub fn clear(&mut self) {
        *self = Self {
            blockage_counts: self.blockage_counts,
            ..Self::default()
        };
    }

    /// Whether returns are missing in some part of the field of view.
    pub fn is_blocked(&self) -> bool {
        self.sectors.iter().any(|sector| sector.is_blocked)
    }

    /// Whether this beam of the newest sweep belongs to a part that is blocked.
    pub(super) fn is_beam_blocked(&self, beam: &RegisteredBeam) -> bool {
        self.sectors
            .get(sector_of(beam.index, self.beam_step_rad))
            .is_some_and(|sector| sector.is_blocked)
    }

    /// Whether the sensor has shown lately that it gets returns.
    pub(super) const fn has_returns(&self) -> bool {
        self.has_returns
    }

    fn update_sectors(&mut self, scan: &RegisteredScan, measured_at: Monotonic) {
        let last = scan.beams.last().map_or(0, |beam| beam.index);
        let count = sector_of(last, scan.beam_step_rad) + 1;
        if self.sectors.len() < count {
            self.sectors.resize(count, Sector::default());
        }
        for beam in scan.beams.iter().filter(|beam| is_hit(beam)) {
            self.sectors[sector_of(beam.index, scan.beam_step_rad)].has_return = true;
        }
        while let Some(&(at, _)) = self.stored_hits.front()
            && measured_at.since(at) > MEMORY
        {
            self.stored_hits.pop_front();
        }
        // Where every part has a return, nothing that is missed counts.
        let mut parts = self.sectors[..count].iter();
        if !parts.all(|sector| sector.has_return)
            && let Some(scan_plane) = ScanPlane::of(scan)
        {
            for &(at, point) in &self.stored_hits {
                // A hit that a beam of the next sector meets says nothing of this one.
                if let Some((beam, false)) = scan_plane.beams_at(&point) {
                    self.sectors[sector_of(beam, scan.beam_step_rad)].miss(at);
                }
            }
        }
        for sector in &mut self.sectors {
            let was_blocked = sector.is_blocked;
            sector.judge(measured_at);
            self.blockage_counts.blocked += u32::from(sector.is_blocked && !was_blocked);
        }
    }

    fn store_hits<'a>(
        &mut self,
        hits: impl Iterator<Item = &'a RegisteredBeam> + Clone,
        measured_at: Monotonic,
    ) {
        let is_due = self
            .stored_hits
            .back()
            .is_none_or(|&(at, _)| measured_at.since(at) >= MEMORY_PERIOD);
        if is_due {
            let every = hits.clone().count().div_ceil(MEMORY_BEAMS).max(1);
            let points = hits
                .step_by(every)
                .map(|beam| (measured_at, beam.end_in_odom));
            self.stored_hits.extend(points);
        }
    }
}

fn is_hit(beam: &RegisteredBeam) -> bool {
    beam.outcome == BeamOutcome::Hit
}

fn sector_of(index: u32, beam_step_rad: f64) -> usize {
    // A step that is no number casts to part 0.
    (f64::from(index) * beam_step_rad / SECTOR_RAD) as usize
}

/// The plane of a sweep's beams, to find those that pass a point.
struct ScanPlane<'a> {
    beams: &'a [RegisteredBeam],
    step_rad: f64,
    origin: Point3<f64>,
    first: u32,
    /// Along the first beam, a quarter of a turn from it, and across the plane.
    axes: [Vector3<f64>; 3],
    range_max_m: f64,
}

impl<'a> ScanPlane<'a> {
    /// Absent where the beams span no plane, or all have returns.
    fn of(scan: &'a RegisteredScan) -> Option<Self> {
        let direction = |beam: &RegisteredBeam| beam.end_in_odom - beam.origin_in_odom;
        let first = scan.beams.first()?;
        let along = direction(first).try_normalize(1e-9)?;
        let aside = scan.beams.iter().find(|beam| {
            let turned_rad = f64::from(beam.index - first.index) * scan.beam_step_rad;
            (0.5..2.5).contains(&turned_rad)
        })?;
        let across = along.cross(&direction(aside)).try_normalize(1e-9)?;
        let is_miss = |beam: &&RegisteredBeam| beam.outcome == BeamOutcome::Miss;
        let miss = scan.beams.iter().find(is_miss)?;
        Some(Self {
            beams: &scan.beams,
            step_rad: scan.beam_step_rad,
            origin: first.origin_in_odom,
            first: first.index,
            axes: [along, across.cross(&along), across],
            range_max_m: miss.range_m.into(),
        })
    }

    /// The number of the beam that points at a point, and whether one of those beside it has a return; absent where no
    /// beam should meet it.
    fn beams_at(&self, point: &Point3<f64>) -> Option<(u32, bool)> {
        let to = point - self.origin;
        let distance_m = to.norm();
        let [x, y, z] = self.axes.map(|axis| axis.dot(&to));
        if distance_m > NEAR_SHARE * self.range_max_m || z.abs() > TOLERANCE_ACROSS_RAD * distance_m
        {
            return None;
        }
        let angle_rad = libm::atan2(y, x).rem_euclid(std::f64::consts::TAU);
        let index = f64::from(self.first) + angle_rad / self.step_rad;
        let beside = TOLERANCE_RAD / self.step_rad;
        let at = |index: f64| {
            self.beams
                .partition_point(|beam| f64::from(beam.index) < index)
        };
        let beams = self.beams.get(at(index - beside)..at(index + beside))?;
        let middle = beams.get(beams.len() / 2)?.index;
        Some((middle, beams.iter().any(is_hit)))
    }
}
