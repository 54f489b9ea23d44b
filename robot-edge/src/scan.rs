//! One sweep of a planar range sensor.

/// One sweep: the f32 fields of `sensor_msgs/LaserScan`, which every reader and driver fills exactly.
///
/// Beam `i` points at `angle_min_rad + i·angle_increment_rad` in the sensor's x-y plane (x forward, y
/// left, counter-clockwise positive) and was measured `i·time_increment_s` after the measurement's stamp.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Scan {
    /// Angle of beam 0, radians.
    pub angle_min_rad: f32,
    /// Angle from a beam to the next, radians, negative for a clockwise sensor.
    pub angle_increment_rad: f32,
    /// Time from a beam to the next, seconds.
    pub time_increment_s: f32,
    /// Smallest range that is a measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or above this are misses, metres.
    pub range_max_m: f32,
    /// Ranges in beam order, metres.
    pub ranges_m: Vec<f32>,
}
