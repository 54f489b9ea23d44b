//! A cost map of the yard against its truth.

use std::collections::BTreeMap;

use super::truth::{Kind, YardTruth};
use crate::land::Cell;
use crate::land::columns::Hits;
use crate::pictures::Picture;
use crate::voxel_views::Canvas;

/// A cost map's value of everything that cannot be driven on.
const LETHAL: f32 = 1.0;
/// Hits in a column by which the laser has met what stands there.
const MIN_HITS: u32 = 3;
/// Columns beside a place at the pit's rim in which the laser met lower ground, for it to have seen below it.
const MIN_COLUMNS_BELOW: usize = 3;

/// Swept cells of planes.
#[derive(Clone, Debug, Default)]
pub(super) struct Plane {
    pub(super) swept: usize,
    pub(super) right: usize,
    pub(super) lethal: usize,
    /// Of which the map says nothing.
    pub(super) unknown: usize,
    /// Cost less the true one.
    errors: Vec<f64>,
}

/// Columns of things.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Found {
    pub(super) seen: usize,
    pub(super) lethal: usize,
}

/// What came out of one drive.
#[derive(Debug, Default)]
pub(super) struct Evaluation {
    pub(super) planes: Plane,
    /// Beneath the canopy.
    pub(super) beneath: Plane,
    /// By the slope in tenths of a degree.
    pub(super) by_slope: BTreeMap<u32, Plane>,
    pub(super) objects: BTreeMap<String, Found>,
    kinds: BTreeMap<Kind, Found>,
    /// Places along the pit's rim where the laser saw below it, and the others.
    pub(super) rim: Found,
    pub(super) rim_unseen: Found,
    pub(super) false_lethal_swept: usize,
    pub(super) false_lethal_unswept: usize,
}

/// What a cell of a plane turned out to be.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Right,
    Wrong,
    Lethal,
    Unknown,
}

fn verdict(cost: Option<f32>, slope: f64) -> Verdict {
    match cost {
        None => Verdict::Unknown,
        Some(cost) if cost >= LETHAL => Verdict::Lethal,
        Some(cost) if (f64::from(cost) - slope).abs() <= (0.1 * slope).max(0.05) => Verdict::Right,
        Some(_) => Verdict::Wrong,
    }
}

impl Plane {
    fn add(&mut self, cost: Option<f32>, slope: f64) {
        let verdict = verdict(cost, slope);
        self.swept += 1;
        self.right += usize::from(verdict == Verdict::Right);
        self.lethal += usize::from(verdict == Verdict::Lethal);
        self.unknown += usize::from(verdict == Verdict::Unknown);
        self.errors.extend(cost.map(|cost| f64::from(cost) - slope));
    }

    pub(super) fn right_share(&self) -> f64 {
        self.right as f64 / self.swept.max(1) as f64
    }

    pub(super) fn median_error(&self) -> f64 {
        crate::spread::Spread::of(self.errors.iter().copied()).median
    }
}

impl Found {
    fn add(&mut self, is_lethal: bool) {
        self.seen += 1;
        self.lethal += usize::from(is_lethal);
    }

    pub(super) fn found_share(self) -> f64 {
        self.lethal as f64 / self.seen.max(1) as f64
    }
}

impl Evaluation {
    pub(super) fn of(truth: &YardTruth<'_>, hits: &Hits, costs: &BTreeMap<Cell, f32>) -> Self {
        let mut evaluation = Self::default();
        let swept = |cell: Cell| hits.get(cell).ground > 0;
        for (&cell, &slope) in truth.planes.iter().filter(|(cell, _)| swept(**cell)) {
            let cost = costs.get(&cell).copied();
            evaluation.planes.add(cost, slope);
            let tenths = libm::round(10.0 * libm::atan(slope).to_degrees()) as u32;
            evaluation
                .by_slope
                .entry(tenths)
                .or_default()
                .add(cost, slope);
            if truth.beneath.contains(&cell) {
                evaluation.beneath.add(cost, slope);
            }
        }
        let is_lethal = |cell: &Cell| costs.get(cell).is_some_and(|cost| *cost >= LETHAL);
        for object in &truth.objects {
            let of_object = evaluation.objects.entry(object.name.clone()).or_default();
            let of_kind = evaluation.kinds.entry(object.kind).or_default();
            let hit = object
                .columns
                .iter()
                .filter(|cell| hits.get(**cell).raised >= MIN_HITS);
            for cell in hit {
                of_object.add(is_lethal(cell));
                of_kind.add(is_lethal(cell));
            }
        }
        for beside in &truth.rim {
            let sees_into = |cell: &&Cell| swept(**cell) && truth.is_pit(**cell);
            let lethal = beside.iter().any(is_lethal);
            if beside.iter().filter(sees_into).count() >= MIN_COLUMNS_BELOW {
                evaluation.rim.add(lethal);
            } else {
                evaluation.rim_unseen.add(lethal);
            }
        }
        let known = truth.ground().cells().filter(|cell| is_lethal(cell));
        for cell in known.filter(|cell| !truth.may_be_lethal.contains(cell)) {
            if swept(cell) {
                evaluation.false_lethal_swept += 1;
            } else {
                evaluation.false_lethal_unswept += 1;
            }
        }
        evaluation
    }

    pub(super) fn of_kind(&self, kind: Kind) -> Found {
        self.kinds.get(&kind).copied().unwrap_or_default()
    }
}

/// Cells of planes that are right and wrong, and lethal cells where nothing is.
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
        let is_lethal = cost.is_some_and(|cost| cost >= LETHAL);
        let shade = match truth.planes.get(&cell) {
            Some(&slope) if hits.get(cell).ground > 0 => match verdict(cost, slope) {
                Verdict::Right => 1,
                Verdict::Wrong => 3,
                Verdict::Lethal => 4,
                Verdict::Unknown => 0,
            },
            _ if is_lethal && truth.may_be_lethal.contains(&cell) => 2,
            _ if is_lethal => 5,
            _ => 0,
        };
        canvas.set(cell, shade);
    }
    canvas.picture(
        "h2-errors",
        "swept cells of planes: right light blue, wrong orange, lethal red; other lethal cells: black where something is, blue where nothing is",
    )
}
