//! A scan with its beams in `odom`.

use measurement::pose::Pose;
use measurement::time::RobotTime;
use nalgebra::Point3;

/// Hit or miss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeamOutcome {
    /// The beam hit something at its end.
    Hit,
    /// No hit up to the beam's end, the sensor's greatest range.
    Miss,
}

/// One beam, placed with the sensor's pose at its own time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisteredBeam {
    /// Position of the sensor, metres in `odom`.
    pub origin_in_odom: Point3<f64>,
    /// The hit, or the point at the greatest range, metres in `odom`.
    pub end_in_odom: Point3<f64>,
    /// Hit or miss.
    pub outcome: BeamOutcome,
    /// Index in the sweep, from 0; omitted beams leave gaps.
    pub index: u32,
    /// Measured range, metres; of a miss the greatest range.
    pub range_m: f32,
}

/// What a scan shows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ScanKind {
    /// Each beam ends at a hit, and what it crosses is free.
    #[default]
    Beams,
    /// The same of a three-dimensional lidar: rings of beams, one after the other, with unused indices between them.
    Cloud,
    /// The nearest echo of a cone lies anywhere on the arc of the hits; nothing is known to be free.
    Arc,
    /// A pressed bumper touches something anywhere along its width; without hits it is released.
    Contact {
        /// Width of the bumper, metres.
        width_m: f32,
    },
}

/// Index of a range sensor, in the order of their names in the configuration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SensorId(pub u8);

/// The valid beams of one scan, in beam order.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisteredScan {
    /// Time of beam 0, with the sensor's time offset.
    pub stamp: RobotTime,
    /// The sensor.
    pub sensor: SensorId,
    /// What its beams show.
    pub kind: ScanKind,
    /// Angle between neighbouring beams, radians, positive.
    pub beam_step_rad: f64,
    /// Pose of the vehicle at that time.
    pub odom_from_base: Pose,
    /// Omitted beams that hit the vehicle itself.
    pub own_body_hits: u32,
    /// Hits and misses.
    pub beams: Vec<RegisteredBeam>,
}
