//! From the configuration to what placing beams needs.

use crate::config::sensors::MAIN_LASER;
use crate::config::{Config, LaserScanConfig, SensorConfig, WheelsAndAttitude};
use crate::exit::UsageError;
use crate::localization::beam_projection::{Footprint, SensorSettings};
use crate::localization::dead_reckoning::DeadReckoningSettings;
use crate::localization::placer::{PlacerSettings, PoseOrigin};
use crate::localization::pose_jump::JumpLimit;
use crate::localization::pose_track::Reach;
use crate::localization::wheel_odometer::WheelSettings;
use crate::robot_time::RobotDuration;

/// The settings of the laser that is mapped.
///
/// # Errors
/// Where the vehicle has none.
pub fn main_laser(config: &Config) -> Result<&LaserScanConfig, UsageError> {
    match config.sensors.get(MAIN_LASER) {
        Some(SensorConfig::LaserScan(laser)) => Ok(laser),
        Some(other @ (SensorConfig::WheelEncoders(_) | SensorConfig::Imu(_))) => {
            Err(UsageError(format!(
                "vehicle {:?}: the sensor named `{MAIN_LASER}` is of kind {:?}, but the main laser has this \
                 name: call the other something else",
                config.vehicle.name,
                other.kind()
            )))
        }
        None => Err(UsageError(format!(
            "vehicle {:?} has no sensor named `{MAIN_LASER}`, so there is nothing to map: name one in \
             [sensors.{MAIN_LASER}]",
            config.vehicle.name
        ))),
    }
}

/// By how much poses may be faster than the vehicle's greatest speed before they are a jump or a wheel's
/// counter is broken: stamps jitter, wheels slip, and a wheel in a curve is faster than the vehicle.
const SPEED_MARGIN: f64 = 3.0;

/// Poses from the configured wheel encoders and attitude sensor.
pub fn poses_from_wheels(config: &Config, sensors: &WheelsAndAttitude<'_>) -> PoseOrigin {
    let seconds = RobotDuration::from_secs_f64;
    let ((_, encoders), (_, imu)) = (sensors.encoders, sensors.imu);
    PoseOrigin::Wheels(DeadReckoningSettings {
        wheels: WheelSettings {
            left_joint: encoders.left_joint.clone(),
            right_joint: encoders.right_joint.clone(),
            radius_m: encoders.wheel_radius_m,
            max_speed_mps: SPEED_MARGIN * config.vehicle.max_speed_mps,
        },
        wheels_time_offset: seconds(encoders.time_offset_s),
        attitude_time_offset: seconds(imu.time_offset_s),
        base_from_imu: imu.mount.base_from_sensor().rotation,
        smoothing: seconds(config.localization.attitude_smoothing_s),
        max_gap: seconds(config.localization.max_gap_s),
    })
}

/// How the main laser's beams are placed.
pub fn placer_settings(
    config: &Config,
    laser: &LaserScanConfig,
    origin: PoseOrigin,
) -> PlacerSettings {
    let localization = &config.localization;
    let seconds = RobotDuration::from_secs_f64;
    PlacerSettings {
        origin,
        base_frame: localization.base_frame.as_str().into(),
        reach: Reach {
            max_gap: seconds(localization.max_gap_s),
            max_extrapolation: seconds(localization.max_extrapolation_s),
            jump: JumpLimit {
                slack_m: localization.jump_m,
                speed_mps: SPEED_MARGIN * config.vehicle.max_speed_mps,
            },
        },
        keep: seconds(localization.buffer_s),
        wait: seconds(localization.wait_s),
        max_waiting: localization.max_waiting_scans,
        sensor: SensorSettings {
            range_min_m: laser.range_min_m.map(|range_m| range_m as f32),
            range_max_m: laser.range_max_m.map(|range_m| range_m as f32),
            zero: laser.zero,
            time_offset: seconds(laser.time_offset_s),
            base_from_sensor: laser.mount.base_from_sensor(),
        },
        footprint: Footprint {
            length_m: config.vehicle.length_m,
            width_m: config.vehicle.width_m,
        },
    }
}
