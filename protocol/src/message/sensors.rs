//! What a robot measures with, and how each of its sensors is doing.

use serde::{Deserialize, Serialize};

/// Sensors that a robot tells of at most.
pub const MAX_SENSORS: usize = 16;

/// One sensor of [`Info`](super::Info).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorInfo {
    /// Its name in the vehicle's configuration.
    pub name: String,
    /// What it is.
    pub kind: SensorKind,
    /// Where it sits, of a sensor that sees; of a tilting one, while it does not tilt.
    pub mount: Option<SensorMount>,
    /// What it sees of the plane that it sweeps; `None` of sensors that sweep none, and as long as nobody knows.
    pub view: Option<FieldOfView>,
    /// How often it is meant to measure, 1/s.
    pub rate_hz: Option<f32>,
}

/// What a sensor is. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SensorKind {
    /// A laser that sweeps a plane of the vehicle.
    PlanarLaser,
    /// A laser that sweeps a plane, which a servo tilts.
    TiltingLaser,
    /// A sonar that sweeps a plane.
    Sonar,
    /// Encoders on wheels.
    WheelEncoders,
    /// An attitude sensor.
    Attitude,
    /// A satellite receiver.
    SatelliteReceiver,
    /// The vehicle's own word of where it is.
    Odometry,
    /// Transforms that say where the vehicle is.
    Transforms,
    /// The encoder of a servo that tilts another sensor.
    TiltEncoder,
}

/// Where a sensor sits in `base_link`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorMount {
    /// Forward, left and up, metres.
    pub position_m: [f32; 3],
    /// Where its x axis points, seen from above: counter-clockwise from x of `base_link`.
    pub yaw_rad: f32,
}

/// The sector that a sensor sweeps, seen from above, about its x axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldOfView {
    /// From the lowest to the greatest angle, counter-clockwise.
    pub angles_rad: [f32; 2],
    /// The least and the greatest range that it measures, metres.
    pub range_m: [f32; 2],
}

/// How one sensor is doing, in [`Status`](super::Status).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorStatus {
    /// Its name, as in [`SensorInfo`].
    pub name: String,
    /// Messages that were taken since the boot.
    pub messages: u64,
    /// Messages per second over the last 5 s, of a recording's time where one is replayed.
    pub rate_hz: f32,
    /// Since the last message, of the same time; `None` before the first.
    pub age_ms: Option<u32>,
    /// What it measured and could not be used, since the boot.
    pub dropped: u64,
    /// What is wrong with it: of several, the first of this list.
    pub fault: Option<SensorFault>,
}

/// What is wrong with a sensor. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SensorFault {
    /// Nothing came for 1 s, or for five of its periods where these are longer; at first, for 3 s.
    Silent,
    /// Its stamps jumped against the time in which they came, within the last 5 s.
    Clock,
    /// Nothing in its messages of the last second, or of its last three periods, was a measurement: it is covered or
    /// broken, or a receiver has no fix.
    AllInvalid,
    /// Less than half of its rate.
    Slow,
    /// Beams without an echo point at what had echoes within the last 5 s: its window seems to be blocked.
    Blocked,
}

impl SensorKind {
    /// Every kind, by number.
    pub const ALL: [Self; 9] = [
        Self::PlanarLaser,
        Self::TiltingLaser,
        Self::Sonar,
        Self::WheelEncoders,
        Self::Attitude,
        Self::SatelliteReceiver,
        Self::Odometry,
        Self::Transforms,
        Self::TiltEncoder,
    ];
}

impl SensorFault {
    /// Every fault, by number.
    pub const ALL: [Self; 5] = [
        Self::Silent,
        Self::Clock,
        Self::AllInvalid,
        Self::Slow,
        Self::Blocked,
    ];
}
