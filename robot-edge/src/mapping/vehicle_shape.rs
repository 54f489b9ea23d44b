//! What the vehicle is to what lies around it.

/// Size of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleShape {
    /// From front to back, or bow to stern, metres.
    pub length_m: f64,
    /// Across, metres.
    pub width_m: f64,
    /// From the ground, or from its lowest point, up; metres.
    pub height_m: f64,
    /// Height of its lowest point above its base frame, metres; negative for a hull.
    pub bottom_z_m: f64,
    /// Distance of the axles, metres.
    pub wheelbase_m: f64,
}
