//! What truly is along the water, as a world file says.

use nalgebra::Point2;

use crate::vegetation::area::is_inside;

/// How a shore receives a boat [HYB §7, table 8.1].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ShoreClass {
    /// Scattered flexible plants.
    Sparse,
    /// A closed field of flexible plants.
    Dense,
    /// Bushes, trunks, rocks.
    Solid,
}

/// A stretch of shore.
#[derive(Clone, Debug, PartialEq)]
pub struct Shore {
    /// Of the file.
    pub name: String,
    /// What stands there.
    pub class: ShoreClass,
    /// Around all that stands there, metres.
    pub polygon_m: Vec<Point2<f64>>,
}

/// A place where a boat can land.
#[derive(Clone, Debug, PartialEq)]
pub struct Dock {
    /// Of the file.
    pub name: String,
    /// Its outline, metres.
    pub polygon_m: Vec<Point2<f64>>,
}

impl Shore {
    /// Whether a point is in it.
    pub fn contains(&self, at: Point2<f64>) -> bool {
        is_inside(&self.polygon_m, at)
    }
}

impl Dock {
    /// Whether a point is in it.
    pub fn contains(&self, at: Point2<f64>) -> bool {
        is_inside(&self.polygon_m, at)
    }
}
