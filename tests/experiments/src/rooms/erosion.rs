//! Why some cells with a surface in them are not occupied in the end.

use std::collections::HashMap;

use mapping::grid::CellIndex;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use nalgebra::Point2;
use protocol::export::Trinary;
use simulation::World;
use simulation::truth::outline::Outline;

use super::agreement::{Expected, Truth};
use super::run;
use crate::ExperimentError;

/// The cells that the truth asks to be occupied and that are not.
pub(crate) struct Erosion {
    /// They were occupied at the end of some second, and later scans undid it.
    pub(crate) undone: usize,
    /// They never were.
    pub(crate) never: usize,
    /// Of the beams that undid it, crossing such a cell without a hit in it after it was last occupied: angle
    /// to the nearest surface, degrees, ascending; nowhere but in an empty world not-a-number.
    pub(crate) angles_deg: Vec<f64>,
}

impl Erosion {
    /// Of one run through `world`.
    pub(crate) fn of(world: &World, truth: &Truth, seed: u64) -> Result<Self, ExperimentError> {
        let mut run = run(world, seed, &[])?;
        let (mut scans, mut last_occupied) = (Vec::new(), HashMap::new());
        for second in 1..=run.duration_s() as u32 {
            run.advance_with(f64::from(second), |_, scan| scans.push(scan.clone()))?;
            let store = run.store();
            let occupied = truth
                .known_cells(&store)
                .filter(|cell| cell.map == Trinary::Occupied);
            last_occupied.extend(occupied.map(|cell| (cell.index, scans.len())));
        }
        let pipeline = run.finish()?;
        let store = pipeline.publisher().store();
        let (undone, never): (Vec<_>, Vec<_>) = truth
            .known_cells(&store)
            .filter(|cell| cell.expected == Expected::Occupied && cell.map != Trinary::Occupied)
            .map(|cell| (cell.index, last_occupied.get(&cell.index)))
            .partition(|(_, last)| last.is_some());
        let height_m = world
            .simulated_vehicle()
            .laser
            .base_from_mount
            .translation
            .z;
        let outline = Outline::at_height(world.solids(), height_m);
        let mut angles_deg: Vec<f64> = undone
            .iter()
            .flat_map(|&(index, last)| {
                let cell = Square::new(truth, index);
                let since = last.and_then(|&scan| scans.get(scan..)).unwrap_or_default();
                since
                    .iter()
                    .flat_map(move |scan| cell.crossed_without_a_hit(scan))
            })
            .map(|(beam, centre_m)| angle_to_surface_deg(&outline, beam, centre_m))
            .collect();
        angles_deg.sort_by(f64::total_cmp);
        Ok(Self {
            undone: undone.len(),
            never: never.len(),
            angles_deg,
        })
    }

    /// The angle below which this share of the beams is, degrees.
    pub(crate) fn quantile_deg(&self, share: f64) -> f64 {
        let place = self.angles_deg.len().saturating_sub(1) as f64 * share;
        self.angles_deg
            .get(place as usize)
            .copied()
            .unwrap_or(f64::NAN)
    }
}

/// A cell as a place.
#[derive(Clone, Copy)]
struct Square {
    index: [i64; 2],
    centre_m: Point2<f64>,
    side_m: f64,
}

impl Square {
    fn new(truth: &Truth, index: [i64; 2]) -> Self {
        Self {
            index,
            centre_m: truth.centre_m(index).into(),
            side_m: truth.grid().cell_m(),
        }
    }

    /// The beams of a scan that cross the cell, none if one ends in it.
    fn crossed_without_a_hit(self, scan: &RegisteredScan) -> Vec<(&RegisteredBeam, Point2<f64>)> {
        let mut crossing = Vec::new();
        for beam in scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit)
        {
            let end = CellIndex::containing(beam.end_in_odom.xy(), self.side_m);
            if [i64::from(end.x), i64::from(end.y)] == self.index {
                return Vec::new();
            }
            if self.is_crossed(beam) {
                crossing.push((beam, self.centre_m));
            }
        }
        crossing
    }

    /// Clips the beam to the square (Liang and Barsky).
    fn is_crossed(self, beam: &RegisteredBeam) -> bool {
        let (start, along) = (
            beam.origin_in_odom.xy(),
            (beam.end_in_odom - beam.origin_in_odom).xy(),
        );
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let [a, b] = [-0.5, 0.5]
                .map(|edge| (self.centre_m[axis] + edge * self.side_m - start[axis]) / along[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter < leave
    }
}

fn angle_to_surface_deg(outline: &Outline, beam: &RegisteredBeam, point_m: Point2<f64>) -> f64 {
    let distance_m = |&[a, b]: &[Point2<f64>; 2]| {
        let along = b - a;
        let t = ((point_m - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (point_m - (a + along * t)).norm()
    };
    let nearest = outline
        .segments()
        .iter()
        .min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
    let Some([a, b]) = nearest else {
        return f64::NAN;
    };
    let beam = (beam.end_in_odom - beam.origin_in_odom).xy().normalize();
    let surface = (b - a).normalize();
    libm::asin(beam.perp(&surface).abs()).to_degrees()
}
