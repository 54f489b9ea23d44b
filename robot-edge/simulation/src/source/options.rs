//! Options of a simulated run.

use std::f64::consts::PI;
use std::ops::RangeInclusive;

use crate::laser::LaserErrors;
use crate::wheel_encoders::WheelErrors;
use crate::world::World;

/// Options of a simulated run.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SimulationOptions {
    /// Chooses the noise.
    pub seed: u64,
    /// Ends the run before the path does, seconds; also the run of a vehicle that is driven, which else does not
    /// end.
    pub duration_s: Option<f64>,
    /// Standard deviation of ranges in place of the world's, metres.
    pub range_noise_m: Option<f64>,
    /// Probability of a dropout in place of the world's.
    pub dropout: Option<f64>,
    /// Standard deviation of the AHRS's roll, pitch and yaw in place of the world's, radians; at most π.
    pub attitude_noise_rad: Option<f64>,
    /// Share by which the wheel encoders read too far in place of the world's: 0.048 where 4.2 m are read as
    /// 4.4 m, 0.07 where 20 m are read as 21.4 m [LOD §5.4]. From −0.9 to 10.
    pub encoder_error: Option<f64>,
    /// Random slip of the wheels of each side, 0 where it is not given: standard deviation after 1 m as a
    /// share of that metre, growing with the square root of the way; at most 1.
    pub wheel_slip: Option<f64>,
    /// Lag of the encoders of tilting sensors in place of the world's, seconds; at most 10.
    pub joint_lag_s: Option<f64>,
    /// Standard deviation of the satellite receiver to the east and to the north in place of the world's,
    /// metres.
    pub fix_noise_m: Option<f64>,
}

/// An option that makes no sense.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{option}` is {value}, it must be {must_be}")]
pub struct OptionError {
    /// Name of the option.
    pub option: &'static str,
    /// The given value.
    pub value: f64,
    /// The allowed range.
    pub must_be: &'static str,
}

/// How the sensors of a run err.
#[derive(Clone, Copy)]
pub(crate) struct SensorErrors {
    pub(crate) laser: LaserErrors,
    pub(crate) wheels: WheelErrors,
    pub(crate) attitude_noise_rad: f64,
    pub(crate) joint_lag_s: f64,
    pub(crate) fix_noise_m: f64,
    /// Time span in which the main laser's window is covered: no beam has an echo.
    pub(crate) laser_covered_s: Option<[f64; 2]>,
}

impl SensorErrors {
    /// Those of the options, else those of the world.
    pub(super) fn new(world: &World, options: SimulationOptions) -> Result<Self, OptionError> {
        let world = world.errors();
        let errors = Self {
            laser: LaserErrors {
                range_noise_m: options.range_noise_m.unwrap_or(world.laser.range_noise_m),
                dropout: options.dropout.unwrap_or(world.laser.dropout),
                ..world.laser
            },
            wheels: WheelErrors {
                scale_error: options.encoder_error.unwrap_or(world.wheels.scale_error),
                slip: options.wheel_slip.unwrap_or(world.wheels.slip),
            },
            attitude_noise_rad: options
                .attitude_noise_rad
                .unwrap_or(world.attitude_noise_rad),
            joint_lag_s: options.joint_lag_s.unwrap_or(world.joint_lag_s),
            fix_noise_m: options.fix_noise_m.unwrap_or(world.fix_noise_m),
            ..world
        };
        let values = [
            options.duration_s.unwrap_or(0.0),
            errors.laser.range_noise_m,
            errors.laser.dropout,
            errors.attitude_noise_rad,
            errors.wheels.scale_error,
            errors.wheels.slip,
            errors.joint_lag_s,
            errors.fix_noise_m,
        ];
        for ((option, allowed, must_be), value) in ALLOWED.into_iter().zip(values) {
            if !allowed.contains(&value) {
                return Err(OptionError {
                    option,
                    value,
                    must_be,
                });
            }
        }
        Ok(errors)
    }
}

const ALLOWED: [(&str, RangeInclusive<f64>, &str); 8] = [
    ("duration_s", 0.0..=f64::INFINITY, "0 or more"),
    ("range_noise_m", 0.0..=f64::INFINITY, "0 or more"),
    ("dropout", 0.0..=1.0, "a probability from 0 to 1"),
    ("attitude_noise_rad", 0.0..=PI, "from 0 to π"),
    ("encoder_error", -0.9..=10.0, "from -0.9 to 10"),
    ("wheel_slip", 0.0..=1.0, "from 0 to 1"),
    ("joint_lag_s", 0.0..=10.0, "from 0 to 10"),
    ("fix_noise_m", 0.0..=1e6, "from 0 to 1000000"),
];
