//! What the surface in a cell is to a vehicle on a ground plane [LOD §4.3].

use nalgebra::{Point3, Vector3};

/// The plane that a vehicle takes for the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// A point on it, in the world, metres.
    pub point_m: Point3<f64>,
    /// Unit vector, up.
    pub normal: Vector3<f64>,
}

/// Heights beyond which a surface is an obstacle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// `H_pos` of the document, metres above the ground plane.
    pub above_m: f64,
    /// `H_neg` of the document, metres above the ground plane: it is negative.
    pub below_m: f64,
}

/// What a cell is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Whether any of its surface lies beyond a threshold.
    pub is_obstacle: bool,
    /// How far the height that decides this is from the threshold, metres: of an obstacle the farthest
    /// beyond one, of a free cell the nearest to one.
    pub margin_m: f64,
    /// Share of the cell's area, as seen from above, that lies beyond a threshold, 0 … 1. Of an upright
    /// wall that only grazes the cell it is small, though the laser sees it whole.
    pub share_beyond: f64,
    /// Least height above the ground plane, metres.
    pub lowest_m: f64,
    /// Greatest height above the ground plane, metres.
    pub highest_m: f64,
}

impl GroundPlane {
    /// The level plane at a height.
    pub fn level(z_m: f64) -> Self {
        Self {
            point_m: Point3::new(0.0, 0.0, z_m),
            normal: Vector3::z(),
        }
    }

    /// How far a point is above it, metres.
    pub fn height_m(&self, point_m: Point3<f64>) -> f64 {
        self.normal.dot(&(point_m - self.point_m))
    }
}

impl Verdict {
    /// The verdict on heights above the ground plane: extremes are those of all, shares those of `samples`
    /// among `shares`. `None` of no heights.
    pub(super) fn of(
        corners: &[f64],
        samples: &[f64],
        shares: usize,
        thresholds: Thresholds,
    ) -> Option<Self> {
        let all = || corners.iter().chain(samples).copied();
        let lowest_m = all().min_by(f64::total_cmp)?;
        let highest_m = all().max_by(f64::total_cmp)?;
        let Thresholds { above_m, below_m } = thresholds;
        let beyond_m = (highest_m - above_m).max(below_m - lowest_m);
        let beyond = samples
            .iter()
            .filter(|height_m| **height_m > above_m || **height_m < below_m)
            .count();
        Some(Self {
            is_obstacle: beyond_m > 0.0,
            margin_m: beyond_m.abs(),
            share_beyond: beyond as f64 / shares.max(1) as f64,
            lowest_m,
            highest_m,
        })
    }
}
