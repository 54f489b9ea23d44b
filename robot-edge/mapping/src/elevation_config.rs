//! Settings of `[mapping.elevation]`, `[mapping.obstacle]` and `[mapping.ground]`.
//!
//! \[LOD\] is *LADAR mapping and obstacle detection*.

use serde::Deserialize;

/// The rolling elevation map.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ElevationConfig {
    /// Whether elevation and obstacles are mapped.
    pub enabled: bool,
    /// Side of a cell, metres; of the obstacle map too.
    pub cell_m: f64,
    /// Cells along an edge of the window, which is centred on the vehicle.
    pub cells: u32,
    /// How long an obstacle seen in only a few scans is remembered, seconds.
    pub forget_s: f64,
}

/// The obstacle map.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObstacleConfig {
    /// Which cells are obstacles.
    pub rule: ObstacleRule,
    /// Heights above this are obstacles, metres (\[LOD\] ch. 5: 0.10).
    pub h_pos_m: f64,
    /// Depths below the ground greater than this are obstacles, metres (\[LOD\] ch. 5: 0.10).
    pub h_neg_m: f64,
    /// Cells along an edge of its window, at most those of the elevation map.
    pub cells: u32,
}

/// Which cells are obstacles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObstacleRule {
    /// Those whose mean height is beyond a threshold (\[LOD\] §4.3).
    Mean,
    /// Those with at least 2 points and 5 % of their recent points beyond a threshold: a mean hides a pole
    /// or a kerb that fills half of its cell.
    Points,
}

/// The ground plane that heights refer to.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroundConfig {
    /// The plane is taken anew when pitch differs from that of the last time by more than this, degrees
    /// (\[LOD\] §5.3: 0.5; 0.7 and 0.9 in two experiments) …
    pub epsilon_deg: f64,
    /// … and from scan to scan changed by less than this at 25 Hz, degrees (\[LOD\] §5.3: 0.1), over a
    /// wheelbase.
    pub eta_deg: f64,
    /// What the thresholds of the obstacle map refer to.
    pub reference: GroundReference,
    /// Steepest ground that is no obstacle where `reference` is `local`, degrees.
    pub max_slope_deg: f64,
    /// Whether the vehicle's pitch and roll are taken into account; `false` only shows what happens without.
    pub compensation: bool,
}

/// What the thresholds of the obstacle map refer to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundReference {
    /// The plane that the vehicle stood on when it was last taken (\[LOD\]).
    Plane,
    /// The ground around each cell, so that a gentle gradient is no obstacle and a kerb is.
    Local,
}

impl Default for ElevationConfig {
    /// 20 × 20 m (\[LOD\] table 5.1).
    fn default() -> Self {
        Self {
            enabled: false,
            cell_m: 0.2,
            cells: 101,
            forget_s: 10.0,
        }
    }
}

impl Default for ObstacleConfig {
    fn default() -> Self {
        Self {
            rule: ObstacleRule::Points,
            h_pos_m: 0.1,
            h_neg_m: 0.1,
            cells: 101,
        }
    }
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self {
            epsilon_deg: 0.5,
            eta_deg: 0.1,
            reference: GroundReference::Plane,
            max_slope_deg: 8.0,
            compensation: true,
        }
    }
}
