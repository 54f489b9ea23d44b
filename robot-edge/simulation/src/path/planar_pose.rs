//! Where a vehicle is in the plane.

use nalgebra::Point2;

use measurement::pose::{self, Pose};

/// A pose in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanarPose {
    /// Metres, in the world.
    pub position_m: Point2<f64>,
    /// Radians, counter-clockwise from x.
    pub yaw_rad: f64,
}

impl PlanarPose {
    /// The same pose in space, level at z = 0.
    pub fn level(&self) -> Pose {
        pose::planar(self.position_m.x, self.position_m.y, self.yaw_rad)
    }

    /// The pose a share of the way from here to `next`; 0 is here, 1 is there.
    #[must_use]
    pub fn towards(&self, next: &Self, share: f64) -> Self {
        Self {
            position_m: self.position_m + (next.position_m - self.position_m) * share,
            yaw_rad: self.yaw_rad + (next.yaw_rad - self.yaw_rad) * share,
        }
    }
}
