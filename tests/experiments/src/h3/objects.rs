//! The meadow's objects, and what maps say of the columns that they are in.

use std::collections::{BTreeMap, BTreeSet};

use crate::land::{Cell, Ground, LETHAL, LandWorld, RIGID, TRAVERSABLE, around, columns_of};
use crate::outcome::{Spread, Table};
use simulation::vegetation::Stem;

/// Where the objects are, metres.
const REGION_M: [[f64; 2]; 2] = [[0.0, -10.0], [34.0, 10.0]];
/// Noise carries hits so far, cells.
const NOISE_CELLS: i64 = 1;
/// Wind moves tops so far, 13 cm about where they lean by 10 cm; cells.
const SWAY_CELLS: i64 = 2;
/// Steps along a stem by which its columns are found, metres.
const STEP_M: f64 = 0.02;

/// What an object is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Class {
    Rock,
    Trunk,
    Grass,
    Twigs,
    /// Farther away than the document's metrics reach: nothing is asked of them.
    FarTwigs,
}

/// What a map says of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    Lethal,
    Traversable,
}

/// The meadow's objects.
pub(crate) struct Objects {
    names: Vec<(String, Class)>,
    /// Number of the object that a column is of.
    owners: BTreeMap<Cell, usize>,
}

/// What a map says of columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Columns {
    pub(crate) rigid: usize,
    pub(crate) traversable: usize,
    /// Lethal, and no metric says whether it gives way.
    pub(crate) unlabelled: usize,
    /// Known and not obstructed.
    pub(crate) passable: usize,
}

impl Class {
    /// Of which something is asked.
    pub(crate) const EVALUATED: [Self; 4] = [Self::Rock, Self::Trunk, Self::Grass, Self::Twigs];
    pub(crate) const ALL: [Self; 5] = [
        Self::Rock,
        Self::Trunk,
        Self::Grass,
        Self::Twigs,
        Self::FarTwigs,
    ];

    pub(crate) const fn label(self) -> &'static str {
        match self {
            Self::Rock => "rocks",
            Self::Trunk => "trunks",
            Self::Grass => "patches of grass",
            Self::Twigs => "patches of twigs",
            Self::FarTwigs => "twigs from afar",
        }
    }

    pub(crate) const fn is_rigid(self) -> bool {
        matches!(self, Self::Rock | Self::Trunk)
    }

    pub(crate) const fn verdict(self) -> Verdict {
        if self.is_rigid() {
            Verdict::Lethal
        } else {
            Verdict::Traversable
        }
    }

    pub(crate) const fn verdict_label(self) -> &'static str {
        match self.verdict() {
            Verdict::Lethal => "lethal",
            Verdict::Traversable => "traversable",
        }
    }

    fn of(name: &str) -> Option<Self> {
        let kinds = [
            ("rock", Self::Rock),
            ("trunk", Self::Trunk),
            ("grass", Self::Grass),
            ("twigs", Self::Twigs),
            ("twigs from afar", Self::FarTwigs),
        ];
        let kind = kinds.into_iter().find(|(end, _)| name.ends_with(end));
        kind.map(|(_, class)| class)
    }
}

impl Columns {
    pub(crate) const fn obstructed(self) -> usize {
        self.rigid + self.traversable + self.unlabelled
    }

    pub(crate) const fn plus(self, other: Self) -> Self {
        Self {
            rigid: self.rigid + other.rigid,
            traversable: self.traversable + other.traversable,
            unlabelled: self.unlabelled + other.unlabelled,
            passable: self.passable + other.passable,
        }
    }

    /// What most of the obstructed columns say; `None` where there are none.
    pub(crate) fn verdict(self) -> Option<Verdict> {
        let lethal = self.rigid + self.unlabelled;
        match lethal.cmp(&self.traversable) {
            std::cmp::Ordering::Greater => Some(Verdict::Lethal),
            std::cmp::Ordering::Less => Some(Verdict::Traversable),
            std::cmp::Ordering::Equal => None,
        }
    }

    pub(crate) fn rigid_share(self) -> f64 {
        self.share(self.rigid)
    }

    pub(crate) fn traversable_share(self) -> f64 {
        self.share(self.traversable)
    }

    pub(crate) fn unlabelled_share(self) -> f64 {
        self.share(self.unlabelled)
    }

    /// An empty table for [`Self::row`].
    pub(crate) fn table(first: &str) -> Table {
        Table::new(&[
            first,
            "obstructed columns",
            "rigid, %",
            "traversable, %",
            "lethal, no metric, %",
            "passable columns",
        ])
    }

    /// The middle ones of several drives.
    pub(crate) fn row(name: &str, drives: &[Self]) -> [String; 6] {
        let median = |figure: &dyn Fn(Self) -> f64| {
            let spread = Spread::over(drives, |columns| figure(*columns));
            format!("{:.0}", spread.median)
        };
        [
            name.to_owned(),
            median(&|all| all.obstructed() as f64),
            median(&|all| 100.0 * all.rigid_share()),
            median(&|all| 100.0 * all.traversable_share()),
            median(&|all| 100.0 * all.unlabelled_share()),
            median(&|all| all.passable as f64),
        ]
    }

    fn share(self, part: usize) -> f64 {
        part as f64 / self.obstructed().max(1) as f64
    }
}

impl Objects {
    pub(crate) fn of(meadow: &LandWorld) -> anyhow::Result<Self> {
        let ground = Ground::of(meadow, REGION_M)?;
        let mut objects = Self {
            names: Vec::new(),
            owners: BTreeMap::new(),
        };
        for solid in meadow.world.solids() {
            if let Some(class) = Class::of(&solid.name) {
                let columns = columns_of(meadow, &ground, solid);
                objects.add(&solid.name, class, &columns, NOISE_CELLS);
            }
        }
        let growth = meadow.world.scene().growth();
        let vegetation = &growth
            .ok_or_else(|| meadow.unsuitable("has no plants"))?
            .vegetation;
        for patch in vegetation.patches() {
            if let Some(class) = Class::of(&patch.name) {
                let stems = vegetation.stems().get(patch.stems.clone());
                let columns = stems
                    .into_iter()
                    .flatten()
                    .flat_map(|stem| of_stem(meadow, stem));
                objects.add(&patch.name, class, &columns.collect(), SWAY_CELLS);
            }
        }
        Ok(objects)
    }

    /// The objects of a class, in the world's order.
    pub(crate) fn names(&self, class: Class) -> impl Iterator<Item = &str> {
        let of_class = self.names.iter().filter(move |(_, of)| *of == class);
        of_class.map(|(name, _)| name.as_str())
    }

    /// What the published costs and codes of rigidity say of every object's columns.
    pub(crate) fn columns(
        &self,
        costs: &BTreeMap<Cell, f32>,
        rigidity: &BTreeMap<Cell, u16>,
    ) -> BTreeMap<String, Columns> {
        let mut all = vec![Columns::default(); self.names.len()];
        for (cell, &owner) in &self.owners {
            let (Some(columns), Some(cost)) = (all.get_mut(owner), costs.get(cell)) else {
                continue;
            };
            let label = rigidity.get(cell).copied();
            if label == Some(RIGID) {
                columns.rigid += 1;
            } else if label == Some(TRAVERSABLE) {
                columns.traversable += 1;
            } else if *cost >= LETHAL {
                columns.unlabelled += 1;
            } else {
                columns.passable += 1;
            }
        }
        let names = self.names.iter().map(|(name, _)| name.clone());
        names.zip(all).collect()
    }

    /// Solids come first: a column is theirs rather than a plant's.
    fn add(&mut self, name: &str, class: Class, columns: &BTreeSet<Cell>, reach: i64) {
        let number = self.names.len();
        self.names.push((name.to_owned(), class));
        for cell in columns.iter().flat_map(|&cell| around(cell, reach)) {
            self.owners.entry(cell).or_insert(number);
        }
    }
}

/// The columns that a stem passes without wind.
fn of_stem(meadow: &LandWorld, stem: &Stem) -> impl Iterator<Item = Cell> {
    let along = stem.top_m - stem.foot_m;
    let steps = libm::ceil(along.norm() / STEP_M).max(1.0) as u32;
    (0..=steps).map(move |step| {
        let at = stem.foot_m + along * (f64::from(step) / f64::from(steps));
        meadow.cell_at([at.x, at.y])
    })
}
