//! Settings of `[mapping.cost]`, `[mapping.metrics]`, `[mapping.rigidity]` and `[mapping.shore]`.
//!
//! \[HYB\] is *Hybrid 3D perception on land and water*.

use serde::Deserialize;

/// The slope cost map, made of a box of the octree around the vehicle.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CostConfig {
    /// Whether it is mapped; it needs the octree.
    pub enabled: bool,
    /// Side of the box, metres (\[HYB\] §5.1: 40 on land, 160 on water).
    pub box_m: f64,
    /// How far the box reaches below and above the vehicle, metres.
    pub box_half_height_m: f64,
    /// The slope that is lethal, degrees (45 on land, 30 for docking).
    pub critical_slope_deg: f64,
    /// What the vehicle moves on.
    pub surface: Surface,
    /// Time of the data between updates, seconds.
    pub period_s: f64,
}

/// What a vehicle moves on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// Ground that beams hit.
    Land,
    /// Water, which returns nothing.
    Water,
}

/// The metrics of beams within a scan and from scan to scan.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MetricsConfig {
    /// Beams longer than this have none, metres: their neighbours are too far apart.
    pub max_range_m: f64,
    /// Greatest deviation of a range difference from its segment's mean, metres (\[HYB\] §6.1: 0.09 introbot,
    /// 0.45 riverwatch).
    pub intra_sigma_m: f64,
    /// Width of a segment whose value is 1, metres.
    pub intra_width_m: f64,
    /// Range difference from scan to scan whose value is 1, metres.
    pub inter_full_m: f64,
    /// Weight of the newest value in a voxel's moving average.
    pub weight: f64,
}

/// What could be pushed through on land.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigidityConfig {
    /// Whether it is mapped; it needs the cost map.
    pub enabled: bool,
    /// Rigid above this `IntraScan` (\[HYB\] §7.1: 0.04).
    pub intra_threshold: f64,
    /// Rigid below this `InterScan` (\[HYB\] §7.1: 0.39).
    pub inter_threshold: f64,
    /// Cost of a column that is obstructed but traversable.
    pub traversable_vegetation_cost: f64,
}

/// Shores and what grows there.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShoreConfig {
    /// Whether it is mapped; it needs the cost map.
    pub enabled: bool,
    /// Rigid above this `IntraScan` (\[HYB\] §7.2: 0.20).
    pub intra_threshold: f64,
    /// Rigid below this `InterScan` (\[HYB\] §7.2: 0.39).
    pub inter_threshold: f64,
    /// Voxels whose centres are no farther apart belong to one cluster, metres (\[HYB\] §7.2: 3).
    pub cluster_m: f64,
    /// Share of rigid voxels below which a cluster is Sparse (\[HYB\] §7.2: 0.25).
    pub sparse_below: f64,
    /// Share of rigid voxels above which a cluster is Solid (\[HYB\] §7.2: 0.68).
    pub solid_above: f64,
    /// Time of the data between clusterings, seconds.
    pub period_s: f64,
}

impl Default for CostConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            box_m: 40.0,
            box_half_height_m: 4.0,
            critical_slope_deg: 45.0,
            surface: Surface::Land,
            period_s: 0.2,
        }
    }
}

impl Default for MetricsConfig {
    fn default() -> Self {
        Self {
            max_range_m: 20.0,
            intra_sigma_m: 0.09,
            intra_width_m: 0.55,
            inter_full_m: 0.255,
            weight: 0.3,
        }
    }
}

impl Default for RigidityConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            intra_threshold: 0.04,
            inter_threshold: 0.39,
            traversable_vegetation_cost: 0.7,
        }
    }
}

impl Default for ShoreConfig {
    fn default() -> Self {
        Self {
            enabled: false,
            intra_threshold: 0.20,
            inter_threshold: 0.39,
            cluster_m: 3.0,
            sparse_below: 0.25,
            solid_above: 0.68,
            period_s: 1.0,
        }
    }
}
