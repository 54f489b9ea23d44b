//! A scan whose beams have been placed in `odom`.

use nalgebra::Point3;

use measurement::pose::Pose;
use measurement::time::RobotTime;

/// What came back along a beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeamOutcome {
    /// Something was hit at the beam's end.
    Hit,
    /// Nothing was hit up to the beam's end, the sensor's greatest range.
    Miss,
}

/// One beam, placed with the sensor's pose at the beam's own time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisteredBeam {
    /// Where the sensor was, metres in `odom`.
    pub origin_in_odom: Point3<f64>,
    /// The hit, or the point at the greatest range, metres in `odom`.
    pub end_in_odom: Point3<f64>,
    /// Hit or miss.
    pub outcome: BeamOutcome,
    /// Its number in the sweep, from 0: beams that were left out leave gaps.
    pub index: u32,
    /// As it was measured, metres; of a miss the greatest range.
    pub range_m: f32,
}

/// A range sensor of the vehicle: its place among them, in the order of their names in the configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SensorId(pub u8);

/// The valid beams of one scan, in beam order.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisteredScan {
    /// When beam 0 was measured, the sensor's time offset applied.
    pub stamp: RobotTime,
    /// Which sensor measured it.
    pub sensor: SensorId,
    /// Angle between neighbouring beams, radians, positive.
    pub beam_step_rad: f64,
    /// Where the vehicle was at that time.
    pub odom_from_base: Pose,
    /// Beams that hit the vehicle itself; they are left out of `beams`.
    pub own_body_hits: u32,
    /// Hits and misses; invalid beams are left out (and counted where they were left out).
    pub beams: Vec<RegisteredBeam>,
}
