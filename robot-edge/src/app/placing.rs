//! From the configuration to what placing beams needs.

use crate::config::{Config, LaserScanConfig, SensorConfig, sensors::MAIN_LASER};
use crate::exit::UsageError;
use crate::localization::beam_projection::{Footprint, SensorSettings};
use crate::localization::placer::{PlacerSettings, PoseOrigin};
use crate::localization::pose_track::Reach;
use crate::robot_time::RobotDuration;

/// The settings of the laser that is mapped.
///
/// # Errors
/// Where the vehicle has none.
pub fn main_laser(config: &Config) -> Result<&LaserScanConfig, UsageError> {
    match config.sensors.get(MAIN_LASER) {
        Some(SensorConfig::LaserScan(laser)) => Ok(laser),
        None => Err(UsageError(format!(
            "vehicle {:?} has no sensor named `{MAIN_LASER}`, so there is nothing to map: name one in \
             [sensors.{MAIN_LASER}]",
            config.vehicle.name
        ))),
    }
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
