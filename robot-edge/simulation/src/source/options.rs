//! What differs between runs in the same world.

use std::ops::RangeInclusive;

use crate::laser::LaserErrors;
use crate::wheel_encoders::WheelErrors;
use crate::world::World;

/// What differs between runs in the same world.
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
    /// How long ago the encoders of tilting sensors say it is, in place of the world's, seconds; at most 10.
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
    /// What was given.
    pub value: f64,
    /// What is allowed.
    pub must_be: &'static str,
}

/// How the sensors of a run err.
pub(super) struct Errors {
    pub(super) laser: LaserErrors,
    pub(super) wheels: WheelErrors,
    pub(super) attitude_noise_rad: f64,
    pub(super) joint_lag_s: f64,
    pub(super) fix_noise_m: f64,
    pub(super) laser_covered_s: Option<[f64; 2]>,
}

impl Errors {
    /// Those of the options, and of the world where these say nothing.
    pub(super) fn new(world: &World, options: SimulationOptions) -> Result<Self, OptionError> {
        let defaults = world.laser_errors();
        let errors = Self {
            laser: LaserErrors {
                range_noise_m: options.range_noise_m.unwrap_or(defaults.range_noise_m),
                dropout: options.dropout.unwrap_or(defaults.dropout),
                ..defaults
            },
            wheels: WheelErrors {
                scale_error: options
                    .encoder_error
                    .unwrap_or_else(|| world.encoder_scale_error()),
                slip: options.wheel_slip.unwrap_or(0.0),
            },
            attitude_noise_rad: options
                .attitude_noise_rad
                .unwrap_or_else(|| world.attitude_noise_rad()),
            joint_lag_s: options.joint_lag_s.unwrap_or_else(|| world.joint_lag_s()),
            fix_noise_m: options.fix_noise_m.unwrap_or_else(|| world.fix_noise_m()),
            laser_covered_s: world.laser_covered_s(),
        };
        let not_negative = 0.0..=f64::INFINITY;
        for (option, value, allowed, must_be) in [
            (
                "duration_s",
                options.duration_s.unwrap_or(0.0),
                not_negative.clone(),
                "0 or more",
            ),
            (
                "range_noise_m",
                errors.laser.range_noise_m,
                not_negative,
                "0 or more",
            ),
            (
                "dropout",
                errors.laser.dropout,
                0.0..=1.0,
                "a probability from 0 to 1",
            ),
            (
                "attitude_noise_rad",
                errors.attitude_noise_rad,
                0.0..=std::f64::consts::PI,
                "from 0 to π",
            ),
            (
                "encoder_error",
                errors.wheels.scale_error,
                -0.9..=10.0,
                "from -0.9 to 10",
            ),
            ("wheel_slip", errors.wheels.slip, 0.0..=1.0, "from 0 to 1"),
            (
                "joint_lag_s",
                errors.joint_lag_s,
                0.0..=10.0,
                "from 0 to 10",
            ),
            (
                "fix_noise_m",
                errors.fix_noise_m,
                0.0..=1e6,
                "from 0 to 1000000",
            ),
        ] {
            within(option, value, &allowed, must_be)?;
        }
        Ok(errors)
    }
}

fn within(
    option: &'static str,
    value: f64,
    allowed: &RangeInclusive<f64>,
    must_be: &'static str,
) -> Result<(), OptionError> {
    if allowed.contains(&value) {
        Ok(())
    } else {
        Err(OptionError {
            option,
            value,
            must_be,
        })
    }
}
