//! Settings of sensors that sweep a plane: lasers and sonars.

use serde::Deserialize;

use localization::beam_projection::ZeroRange;
use measurement::mount::Mount;

/// A planar range sensor.
#[derive(Clone, Debug, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RangeSensorConfig {
    /// Topic or message name; where absent, the only stream whose type fits that no other sensor names.
    pub topic: Option<String>,
    /// Replaces the message's smallest range, metres.
    pub range_min_m: Option<f64>,
    /// Replaces the message's greatest range, metres; ranges at or above it are misses.
    pub range_max_m: Option<f64>,
    /// Added to the stamps to make up for latency, seconds.
    pub time_offset_s: f64,
    /// What a range of zero means.
    pub zero_range: ZeroRange,
    /// Probability that a voxel which one scan hit is occupied; where absent, that of the kind.
    pub p_hit: Option<f64>,
    /// Probability that a voxel which one scan saw through is occupied; where absent, that of the kind.
    pub p_miss: Option<f64>,
    /// Of the beams beside a hit as many must have hit something close to it, or the octree does not take
    /// it; 0 takes every hit. Where absent, that of the kind.
    pub min_neighbours: Option<u32>,
    /// Full angle of a beam's cone, milliradians: in the octree a hit gives way to others whose spot of light was
    /// smaller. 0 takes beams for lines; where absent, that of the kind.
    pub divergence_mrad: Option<f64>,
    /// Where the sensor sits on the vehicle, where no transform of the source says so.
    pub mount: Mount,
    /// The servo that tilts it, if it is tilted and no transform of the source says how far.
    pub tilt: Option<TiltConfig>,
    /// Device, for people and for simulation.
    pub model: Option<String>,
    /// Beams in a sweep, for simulation.
    pub beams: Option<u32>,
    /// Angle from the first beam to the last, degrees, for simulation.
    pub field_of_view_deg: Option<f64>,
    /// Sweeps per second, for simulation.
    pub rate_hz: Option<f64>,
}

/// A servo that turns a sensor about its own y axis, and whose angle comes as `sensor_msgs/JointState`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TiltConfig {
    /// Topic of the angles; where absent, the only stream that has the joint.
    pub topic: Option<String>,
    /// Name of the joint.
    pub joint: String,
    /// The joint's angle times this is the sensor's: −1 where the joint counts nose up as positive.
    pub scale: f64,
    /// The sensor's angle where the joint is at zero, degrees, positive nose down; added to `mount.pitch_deg`.
    pub offset_deg: f64,
    /// Added to the stamps of the angles to make up for the encoder's latency, seconds.
    pub time_offset_s: f64,
}

impl Default for TiltConfig {
    fn default() -> Self {
        Self {
            topic: None,
            joint: "laser_tilt_joint".to_owned(),
            scale: 1.0,
            offset_deg: 0.0,
            time_offset_s: 0.0,
        }
    }
}
