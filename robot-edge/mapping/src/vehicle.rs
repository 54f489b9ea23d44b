//! Dimensions and limits of the vehicle.

use serde::Deserialize;

/// Settings of `[vehicle]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleConfig {
    /// Name in summaries and messages.
    pub name: String,
    /// Extent along x, metres.
    pub length_m: f64,
    /// Extent along y, metres, centred on the base frame.
    pub width_m: f64,
    /// From the base frame's origin forward to the middle of the footprint, metres; positive for a
    /// base frame at the rear axle.
    pub footprint_offset_m: f64,
    /// Extent along z from the ground upwards, metres.
    pub height_m: f64,
    /// Height of its lowest part above the base frame, metres; negative for a hull.
    pub bottom_z_m: f64,
    /// Distance of the axles, metres; default: the length.
    pub wheelbase_m: Option<f64>,
    /// Greatest speed, metres per second.
    pub max_speed_mps: f64,
    /// Greatest turn rate, radians per second.
    pub max_turn_rate_radps: f64,
}

impl Default for VehicleConfig {
    /// Assumed values for an unknown vehicle.
    fn default() -> Self {
        Self {
            name: "generic2d".to_owned(),
            length_m: 0.5,
            width_m: 0.5,
            footprint_offset_m: 0.0,
            height_m: 0.5,
            bottom_z_m: 0.0,
            wheelbase_m: None,
            max_speed_mps: 1.0,
            max_turn_rate_radps: 1.0,
        }
    }
}

impl VehicleConfig {
    /// The part that mapping uses.
    pub fn shape(&self) -> VehicleShape {
        VehicleShape {
            length_m: self.length_m,
            width_m: self.width_m,
            height_m: self.height_m,
            bottom_z_m: self.bottom_z_m,
            wheelbase_m: self.wheelbase_m(),
        }
    }

    /// Distance of the axles, metres; the length if not configured.
    pub fn wheelbase_m(&self) -> f64 {
        self.wheelbase_m.unwrap_or(self.length_m)
    }
}

/// Size of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleShape {
    /// Extent along x, metres.
    pub length_m: f64,
    /// Extent along y, metres.
    pub width_m: f64,
    /// From its lowest point upwards, metres.
    pub height_m: f64,
    /// Height of its lowest point above the base frame, metres; negative for a hull.
    pub bottom_z_m: f64,
    /// Distance of the axles, metres.
    pub wheelbase_m: f64,
}
