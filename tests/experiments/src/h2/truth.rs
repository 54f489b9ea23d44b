//! What the cost map of the yard must say.

use std::collections::{BTreeMap, BTreeSet};

use crate::ExperimentError;
use crate::land::columns::{RAISED_M, columns_of};
use crate::land::ground::{Ground, REACH};
use crate::land::{Cell, LandWorld, around};

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
    pub(super) fn of(yard: &'a LandWorld) -> Result<Self, ExperimentError> {
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
            if !ground.is_bare(cell, ASIDE_M)
                || ground
                    .steepest(cell)
                    .is_some_and(|steepest| steepest >= 1.0)
            {
                lethal.insert(cell);
            }
        }
        let objects = yard.world.solids().iter().filter_map(|solid| {
            let kind = Kind::of(&solid.name)?;
            let is_steep = |cell: &Cell| {
                ground
                    .steepest(*cell)
                    .is_some_and(|steepest| steepest >= 1.0)
            };
            let mut columns = columns_of(yard, &ground, solid);
            columns.retain(is_steep);
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
