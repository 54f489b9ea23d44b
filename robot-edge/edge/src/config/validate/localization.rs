//! Which values make sense for poses.

use crate::config::checks::{Allowed, Checks, as_toml};
use crate::config::layer::quoted;
use crate::config::{Config, FixesAndAttitude, WheelsAndAttitude};
use localization::{LocalizationConfig, PoseSource};

pub(super) fn localization(checks: &mut Checks, localization: &LocalizationConfig) {
    let key = |name: &str| format!("localization.{name}");
    checks.frame(&key("base_frame"), &localization.base_frame);
    if let Some(fixed_frame) = &localization.fixed_frame {
        checks.frame(&key("fixed_frame"), fixed_frame);
        if *fixed_frame == localization.base_frame {
            let why = "the map would move with the vehicle";
            let allowed = "a frame other than localization.base_frame".to_owned();
            checks.issue(
                &key("fixed_frame"),
                format!("\"{}\"", quoted(fixed_frame)),
                why,
                allowed,
            );
        }
    }
    let pose = "poses farther away than that say nothing about a beam";
    checks.number(
        &key("max_gap_s"),
        localization.max_gap_s,
        Allowed::PositiveUpTo(60.0),
        pose,
    );
    checks.number(
        &key("max_pose_wait_s"),
        localization.max_pose_wait_s,
        Allowed::Within(0.0, 60.0),
        pose,
    );
    checks.number(
        &key("max_extrapolation_s"),
        localization.max_extrapolation_s,
        Allowed::Within(0.0, 60.0),
        pose,
    );
    let memory = "what is kept takes memory";
    checks.number(
        &key("buffer_s"),
        localization.buffer_s,
        Allowed::PositiveUpTo(3600.0),
        memory,
    );
    let least_s = localization.max_gap_s.max(localization.max_pose_wait_s);
    if localization.buffer_s < least_s {
        let why = "poses would be forgotten before the scans that wait for them are placed";
        let allowed = format!("at least max_gap_s and max_pose_wait_s, {least_s}");
        checks.issue(
            &key("buffer_s"),
            as_toml(localization.buffer_s),
            why,
            allowed,
        );
    }
    let waiting = localization.max_waiting_scans as u64;
    checks.whole(&key("max_waiting_scans"), waiting, 1, 100_000, memory);
    checks.number(
        &key("attitude_smoothing_s"),
        localization.attitude_smoothing_s,
        Allowed::Within(0.0, 1.0),
        "the attitude must follow the vehicle; 0 smooths nothing",
    );
    checks.number(
        &key("jump_m"),
        localization.jump_m,
        Allowed::PositiveUpTo(10_000.0),
        "poses farther apart than the vehicle drives are a jump",
    );
}

/// What poses are reckoned from must be there.
pub(super) fn pose_sensors(checks: &mut Checks, config: &Config) {
    let (source, why, kind, found) = match config.localization.source {
        PoseSource::Auto
        | PoseSource::Tf
        | PoseSource::Odometry
        | PoseSource::Log
        | PoseSource::Static => return,
        PoseSource::Wheels => (
            "wheels",
            "poses are reckoned from the wheels and the attitude",
            "wheel_encoders",
            WheelsAndAttitude::of(&config.sensors).map(|_| ()),
        ),
        PoseSource::Gps => (
            "gps",
            "poses are made of the receiver's positions and the attitude",
            "gps",
            FixesAndAttitude::of(&config.sensors).map(|_| ()),
        ),
    };
    if let Err((others, imus)) = found {
        checks.issue(
            "localization.source",
            format!("\"{source}\""),
            why,
            format!(
                "with one sensor of kind \"{kind}\" (there are {others}) and one of kind \"imu\" (there \
                 are {imus})"
            ),
        );
    }
}
