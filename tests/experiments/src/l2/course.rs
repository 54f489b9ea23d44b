//! The errors that a mirror causes, over a drive.

use nalgebra::Point2;
use protocol::export::Trinary;
use protocol::tile_store::TileStore;

use crate::ExperimentError;
use crate::rooms::agreement::{Expected, Truth};
use crate::rooms::{self, mirror_of};
use simulation::World;
use simulation::truth::outline::Outline;

/// Time of the data between two counts, seconds.
const PERIOD_S: f64 = 5.0;

/// Errors at one time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Errors {
    /// Cells that are occupied where the truth asks for free.
    pub(super) ghosts: u64,
    /// Cells of the mirror that are free.
    pub(super) holes: u64,
}

/// The errors of one run, every [`PERIOD_S`] of data and at the end.
pub(super) struct Course {
    /// When, seconds after the start, and what.
    samples: Vec<(f64, Errors)>,
}

impl Course {
    /// Drives through `world`.
    fn of(world: &World, truth: &Truth, seed: u64) -> Result<Self, ExperimentError> {
        let mirror = mirror_of(world);
        let mut run = rooms::run(world, seed, &[])?;
        let end_s = run.duration_s();
        let counts = (end_s / PERIOD_S) as u32;
        let mut samples = Vec::new();
        for at_s in (1..=counts).map(|count| f64::from(count) * PERIOD_S) {
            run.advance_to(at_s)?;
            samples.push((at_s, errors(&run.store(), truth, &mirror)));
        }
        let pipeline = run.finish()?;
        samples.push((end_s, errors(&pipeline.publisher().store(), truth, &mirror)));
        Ok(Self { samples })
    }

    /// When most ghosts were there for the first time, and how many.
    pub(super) fn most_ghosts(&self) -> (f64, u64) {
        let ghosts = self
            .samples
            .iter()
            .map(|&(at_s, errors)| (at_s, errors.ghosts));
        ghosts
            .rev()
            .max_by_key(|&(_, ghosts)| ghosts)
            .unwrap_or_default()
    }

    /// Most free cells of the mirror at any one time.
    pub(super) fn most_holes(&self) -> u64 {
        let holes = self.samples.iter().map(|sample| sample.1.holes);
        holes.max().unwrap_or_default()
    }

    /// The errors at the latest count up to a time.
    pub(super) fn at(&self, at_s: f64) -> Errors {
        let behind = self.samples.iter().rev().find(|sample| sample.0 <= at_s);
        behind.map(|sample| sample.1).unwrap_or_default()
    }

    /// When the drive ends, seconds.
    pub(super) fn end_s(&self) -> f64 {
        self.samples.last().map_or(0.0, |sample| sample.0)
    }

    /// The errors of the finished map.
    pub(super) fn end(&self) -> Errors {
        self.at(f64::INFINITY)
    }
}

fn errors(store: &TileStore, truth: &Truth, mirror: &Outline) -> Errors {
    let mut errors = Errors::default();
    for cell in truth.known_cells(store) {
        match (cell.expected, cell.map) {
            (Expected::Free, Trinary::Occupied) => errors.ghosts += 1,
            (Expected::Occupied, Trinary::Free) => {
                let centre_m = Point2::from(truth.centre_m(cell.index));
                let on_mirror =
                    mirror.contains(centre_m) || mirror.distance_m(centre_m) <= truth.near_m();
                errors.holes += u64::from(on_mirror);
            }
            (Expected::Free | Expected::Occupied | Expected::Unobservable | Expected::Edge, _) => {}
        }
    }
    errors
}

/// The same drive three times: past the mirror, past a mirror that scatters light, and, without what other
/// rooms show, only to and fro before the mirror.
pub(super) struct Drives {
    pub(super) mirror: Course,
    pub(super) scattering: Course,
    pub(super) one_room: Course,
}

impl Drives {
    pub(super) fn of(truth: &Truth, seed: u64) -> Result<Self, ExperimentError> {
        Ok(Self {
            mirror: Course::of(&rooms::rooms()?, truth, seed)?,
            scattering: Course::of(&rooms::without_reflections()?, truth, seed)?,
            one_room: Course::of(&rooms::seen_from_one()?, truth, seed)?,
        })
    }
}
