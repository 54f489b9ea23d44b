//! What the cost map of the yard must say, and a cost map against it.

use std::collections::{BTreeMap, BTreeSet};

use crate::land::{
    Cell, Found, Ground, Hits, LETHAL, LandWorld, MIN_HITS, RAISED_M, REACH, around, columns_of,
};
use crate::outcome::Spread;
use crate::pictures::Picture;
use crate::voxel_views::{Canvas, PIXELS_PER_CELL};

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
        Spread::of(self.errors.iter().copied()).median
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
        return Canvas::new([0, 0], [1, 1], &COLORS, PIXELS_PER_CELL).picture("h2-errors", "");
    };
    let mut canvas = Canvas::new(first, last, &COLORS, PIXELS_PER_CELL);
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

/// The yard with its walls, metres.
const YARD_M: [[f64; 2]; 2] = [[-5.9, -8.9], [37.9, 8.9]];
/// The pit at its rim, metres.
const PIT_M: [[f64; 2]; 2] = [[23.5, -3.5], [26.5, -1.5]];
/// Noise and sway carry hits this far, metres.
const ASIDE_M: f64 = 0.1;
/// Leaves this high above the ground are a canopy, metres.
const CANOPY_M: [f64; 2] = [1.0, 4.0];

/// What things are to the experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Wall,
    Box,
    Trunk,
    LowBranch,
}

impl Kind {
    pub(super) const ALL: [Self; 4] = [Self::Wall, Self::Box, Self::Trunk, Self::LowBranch];

    pub(super) const fn label(self) -> &'static str {
        match self {
            Self::Wall => "columns of walls",
            Self::Box => "columns of boxes",
            Self::Trunk => "columns of trunks and the stump",
            Self::LowBranch => "columns of the low branch",
        }
    }

    fn of(name: &str) -> Option<Self> {
        let ends = |end: &str| name.ends_with(end);
        match name {
            "low branch" => Some(Self::LowBranch),
            _ if ends("wall") => Some(Self::Wall),
            _ if ends("box") => Some(Self::Box),
            _ if ends("trunk") || ends("stump") => Some(Self::Trunk),
            _ => None,
        }
    }
}

/// A thing and the columns that it stands in and makes lethal by the document's formula.
pub(super) struct YardObject {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) columns: BTreeSet<Cell>,
}

/// The truth of the yard, by exact geometry.
pub(super) struct YardTruth<'a> {
    ground: Ground<'a>,
    /// Slope, rise over run, of the cells that lie in the middle of a plane with nothing on it.
    pub(super) planes: BTreeMap<Cell, f64>,
    /// Those of them that leaves hang above.
    pub(super) beneath: BTreeSet<Cell>,
    pub(super) objects: Vec<YardObject>,
    /// Cells that are lethal, or beside one, or where something may be met that gives way.
    pub(super) may_be_lethal: BTreeSet<Cell>,
    /// Places along the pit's rim and the cells beside each.
    pub(super) rim: Vec<BTreeSet<Cell>>,
}

impl<'a> YardTruth<'a> {
    pub(super) fn of(yard: &'a LandWorld) -> anyhow::Result<Self> {
        let ground = Ground::of(yard, YARD_M)?;
        let beside_m = REACH as f64 * yard.cell_m() + ASIDE_M;
        let (mut planes, mut beneath) = (BTreeMap::new(), BTreeSet::new());
        let mut lethal = BTreeSet::new();
        for cell in ground.cells() {
            if let Some(slope) = ground.slope(cell)
                && ground.is_bare(cell, beside_m)
            {
                planes.insert(cell, slope);
                if ground.standing(cell, 0.0, CANOPY_M).is_some() {
                    beneath.insert(cell);
                }
            }
            if !ground.is_bare(cell, ASIDE_M) || ground.is_steep(cell) {
                lethal.insert(cell);
            }
        }
        let objects = yard.world.solids().iter().filter_map(|solid| {
            let kind = Kind::of(&solid.name)?;
            let mut columns = columns_of(yard, &ground, solid);
            columns.retain(|&cell| ground.is_steep(cell));
            Some(YardObject {
                kind,
                columns,
                name: solid.name.clone(),
            })
        });
        Ok(Self {
            objects: objects.collect(),
            planes,
            beneath,
            may_be_lethal: lethal.iter().flat_map(|&cell| around(cell, 1)).collect(),
            rim: rim(yard),
            ground,
        })
    }

    /// Whether any of a column is below the pit's rim, so that it is not taken for it.
    pub(super) fn is_pit(&self, cell: Cell) -> bool {
        let low = self.ground.heights_m(cell).map(|[low, _]| low);
        low.is_some_and(|low| low < -RAISED_M)
    }

    pub(super) fn ground(&self) -> &Ground<'a> {
        &self.ground
    }
}

/// The pit's rim in steps of a cell.
fn rim(yard: &LandWorld) -> Vec<BTreeSet<Cell>> {
    let [[left, bottom], [right, top]] = PIT_M;
    let cell_m = yard.cell_m();
    let along = |from_m: f64, to_m: f64| {
        let steps = libm::round((to_m - from_m) / cell_m) as u32;
        (0..steps).map(move |step| from_m + (f64::from(step) + 0.5) * cell_m)
    };
    let level = along(left, right).flat_map(|x| [[x, bottom], [x, top]]);
    let upright = along(bottom, top).flat_map(|y| [[left, y], [right, y]]);
    let places = level.chain(upright);
    places
        .map(|place| around(yard.cell_at(place), REACH).collect())
        .collect()
}
