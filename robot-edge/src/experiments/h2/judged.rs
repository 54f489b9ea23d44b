//! A cost map of the yard against its truth.

use std::collections::BTreeMap;

use super::truth::{Kind, YardTruth};
use crate::experiments::land::Cell;
use crate::experiments::land::columns::Hits;
use crate::experiments::pictures::Picture;
use crate::experiments::voxel_views::Canvas;

/// A cost map's value of everything that cannot be driven on.
const FATAL: f32 = 1.0;
/// Hits in a column by which the laser has met what stands there.
const MET: u32 = 3;
/// Columns beside a place at the pit's rim in which the laser met lower ground, for it to have seen below it.
const MET_COLUMNS: usize = 3;

/// Swept cells of planes.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    pub(super) swept: usize,
    pub(super) right: usize,
    pub(super) fatal: usize,
    /// Of which the map says nothing.
    pub(super) unknown: usize,
    /// Cost less the true one.
    errors: Vec<f64>,
}

/// Columns of things.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub(super) seen: usize,
    pub(super) fatal: usize,
}

/// What came out of one drive.
#[derive(Debug, Default)]
pub(super) struct Judged {
    pub(super) planes: Plane,
    /// Beneath the canopy.
    pub(super) beneath: Plane,
    /// By the slope in tenths of a degree.
    pub(super) by_slope: BTreeMap<u32, Plane>,
    pub(super) things: BTreeMap<String, Found>,
    kinds: BTreeMap<Kind, Found>,
    /// Places along the pit's rim where the laser saw below it, and the others.
    pub(super) rim: Found,
    pub(super) rim_unseen: Found,
    pub(super) false_fatal_swept: usize,
    pub(super) false_fatal_unswept: usize,
}

/// What a cell of a plane turned out to be.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Right,
    Wrong,
    Fatal,
    Unknown,
}

fn verdict(cost: Option<f32>, slope: f64) -> Verdict {
    match cost {
        None => Verdict::Unknown,
        Some(cost) if cost >= FATAL => Verdict::Fatal,
        Some(cost) if (f64::from(cost) - slope).abs() <= (0.1 * slope).max(0.05) => Verdict::Right,
        Some(_) => Verdict::Wrong,
    }
}

impl Plane {
    fn add(&mut self, cost: Option<f32>, slope: f64) {
        let verdict = verdict(cost, slope);
        self.swept += 1;
        self.right += usize::from(verdict == Verdict::Right);
        self.fatal += usize::from(verdict == Verdict::Fatal);
        self.unknown += usize::from(verdict == Verdict::Unknown);
        self.errors.extend(cost.map(|cost| f64::from(cost) - slope));
    }

    pub(super) fn right_share(&self) -> f64 {
        self.right as f64 / self.swept.max(1) as f64
    }

    pub(super) fn median_error(&self) -> f64 {
        crate::experiments::spread::Spread::of(self.errors.iter().copied()).median
    }
}

impl Found {
    fn add(&mut self, is_fatal: bool) {
        self.seen += 1;
        self.fatal += usize::from(is_fatal);
    }

    pub(super) fn found_share(self) -> f64 {
        self.fatal as f64 / self.seen.max(1) as f64
    }
}

impl Judged {
    pub(super) fn of(truth: &YardTruth<'_>, hits: &Hits, costs: &BTreeMap<Cell, f32>) -> Self {
        let mut judged = Self::default();
        let swept = |cell: Cell| hits.get(cell).ground > 0;
        for (&cell, &slope) in truth.planes.iter().filter(|(cell, _)| swept(**cell)) {
            let cost = costs.get(&cell).copied();
            judged.planes.add(cost, slope);
            let tenths = libm::round(10.0 * libm::atan(slope).to_degrees()) as u32;
            judged.by_slope.entry(tenths).or_default().add(cost, slope);
            if truth.beneath.contains(&cell) {
                judged.beneath.add(cost, slope);
            }
        }
        let is_fatal = |cell: &Cell| costs.get(cell).is_some_and(|cost| *cost >= FATAL);
        for thing in &truth.things {
            let of_thing = judged.things.entry(thing.name.clone()).or_default();
            let of_kind = judged.kinds.entry(thing.kind).or_default();
            let met = thing
                .columns
                .iter()
                .filter(|cell| hits.get(**cell).raised >= MET);
            for cell in met {
                of_thing.add(is_fatal(cell));
                of_kind.add(is_fatal(cell));
            }
        }
        for beside in &truth.rim {
            let sees_into = |cell: &&Cell| swept(**cell) && truth.is_pit(**cell);
            let fatal = beside.iter().any(is_fatal);
            if beside.iter().filter(sees_into).count() >= MET_COLUMNS {
                judged.rim.add(fatal);
            } else {
                judged.rim_unseen.add(fatal);
            }
        }
        let known = truth.ground().cells().filter(|cell| is_fatal(cell));
        for cell in known.filter(|cell| !truth.may_be_fatal.contains(cell)) {
            if swept(cell) {
                judged.false_fatal_swept += 1;
            } else {
                judged.false_fatal_unswept += 1;
            }
        }
        judged
    }

    pub(super) fn of_kind(&self, kind: Kind) -> Found {
        self.kinds.get(&kind).copied().unwrap_or_default()
    }
}

/// Cells of planes that are right and wrong, and fatal cells where nothing is.
pub(super) fn errors(truth: &YardTruth<'_>, hits: &Hits, costs: &BTreeMap<Cell, f32>) -> Picture {
    const COLORS: [[u8; 3]; 6] = [
        [255, 255, 255],
        [190, 215, 235],
        [40, 40, 40],
        [230, 159, 0],
        [213, 94, 0],
        [0, 114, 178],
    ];
    let cells: Vec<Cell> = truth.ground().cells().collect();
    let (Some(&first), Some(&last)) = (cells.first(), cells.last()) else {
        return Canvas::new([0, 0], [1, 1], &COLORS).picture("h2-errors", "");
    };
    let mut canvas = Canvas::new(first, last, &COLORS);
    for cell in cells {
        let cost = costs.get(&cell).copied();
        let is_fatal = cost.is_some_and(|cost| cost >= FATAL);
        let shade = match truth.planes.get(&cell) {
            Some(&slope) if hits.get(cell).ground > 0 => match verdict(cost, slope) {
                Verdict::Right => 1,
                Verdict::Wrong => 3,
                Verdict::Fatal => 4,
                Verdict::Unknown => 0,
            },
            _ if is_fatal && truth.may_be_fatal.contains(&cell) => 2,
            _ if is_fatal => 5,
            _ => 0,
        };
        canvas.set(cell, shade);
    }
    canvas.picture(
        "h2-errors",
        "swept cells of planes: right light blue, wrong orange, fatal red; other fatal cells: black where something is, blue where nothing is",
    )
}
