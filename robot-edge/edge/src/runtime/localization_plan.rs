//! Settings of the registration, from the configuration and the streams.

use crate::config::sensors::MAIN_LASER;
use crate::config::{
    Config, FixesAndAttitude, ImuConfig, RangeSensor, RangeSensorConfig, TiltConfig,
    WheelsAndAttitude, the_gps,
};
use crate::exit::UsageError;
use localization::attitude::AttitudeSettings;
use localization::beam_projection::{BodyBox, SensorSettings};
use localization::dead_reckoning::DeadReckoningSettings;
use localization::dead_reckoning::WheelSettings;
use localization::gnss_positioning::GnssSettings;
use localization::pose_buffer::InterpolationLimits;
use localization::pose_buffer::JumpLimit;
use localization::registration::{
    MountOrigin, PoseOrigin, PoseStreams, RangeSensorSettings, RegistrationSettings,
};
use localization::scan_localization::{MotionPrior, ReceiverSettings, ScanLocalizationSettings};
use localization::scan_matching::slam_settings::SlamSettings;
use localization::tilt::TiltSettings;
use mapping::registered_scan::{ScanKind, SensorId};
use measurement::StreamId;
use measurement::time::RobotDuration;
use nalgebra::Vector3;

/// Decisions before the first measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalizationPlan {
    pub origin: PoseOrigin,
    /// Streams of the sensors that the poses are computed from.
    pub pose_streams: PoseStreams,
    /// The mapped range sensors, in the order of their ids.
    pub sensors: Vec<PlannedSensor>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedSensor {
    pub id: SensorId,
    /// The stream of its scans; `None` accepts every scan.
    pub stream: Option<StreamId>,
    pub mount: MountOrigin,
    /// The stream of its tilt angles, if it is tilted and has no transform.
    pub tilt_stream: Option<StreamId>,
    /// Range from which on there is no return, if neither messages nor configuration give it, metres.
    pub range_max_m: Option<f32>,
}

pub fn range_sensors(config: &Config) -> Result<Vec<RangeSensor<'_>>, UsageError> {
    let sensors = config.range_sensors();
    if sensors.is_empty() {
        return Err(UsageError(format!(
            "vehicle {:?} has no range sensor, so there is nothing to map: name one of kind \"laser_scan\" or \
             \"sonar\", for example in [sensors.{MAIN_LASER}]",
            config.vehicle.name
        )));
    }
    Ok(sensors)
}

/// Margin of the maximum speed before a step of poses is a jump or a wheel counter is broken: stamps jitter, wheels
/// slip, and in a curve a wheel is faster than the vehicle.
const SPEED_MARGIN: f64 = 3.0;

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
        attitude: attitude(config, imu),
        max_gap: seconds(config.localization.max_gap_s),
    })
}

pub fn poses_from_fixes(config: &Config, sensors: &FixesAndAttitude<'_>) -> PoseOrigin {
    let seconds = RobotDuration::from_secs_f64;
    let ((_, gps), (_, imu)) = (sensors.gps, sensors.imu);
    PoseOrigin::Gps(GnssSettings {
        fix_time_offset: seconds(gps.time_offset_s),
        antenna_in_base: gps.mount.base_from_sensor().translation.vector,
        attitude: attitude(config, imu),
        outlier_limit: jump_limit(config),
        max_gap: seconds(config.localization.max_gap_s),
    })
}

pub fn poses_from_attitude(config: &Config, imu: &ImuConfig) -> PoseOrigin {
    PoseOrigin::Attitude(attitude(config, imu))
}

/// How scans are matched on the poses of `prior`; `None` if the configuration does not want it.
pub fn match_scans(
    config: &Config,
    sensors: &[PlannedSensor],
    prior: &PoseOrigin,
) -> Result<Option<ScanLocalizationSettings>, UsageError> {
    if !config.localization.source.matches_scans() {
        return Ok(None);
    }
    let of_vehicle = config.range_sensors();
    let wanted = config.localization.scan_sensor.as_deref();
    let is_level = |sensor: &RangeSensor<'_>| {
        let up = sensor.config.mount.base_from_sensor().rotation * Vector3::z();
        up.z.abs() > LEAST_LEVEL
    };
    let is_tilted = |sensor: &RangeSensor<'_>| {
        let is_planar = sensor.config.scan_kind == ScanKind::Beams;
        is_planar && (sensor.config.tilt.is_some() || !is_level(sensor))
    };
    // A lidar before a laser that is tilted, and a level one before both.
    let rank = |sensor: &RangeSensor<'_>| match sensor.config.scan_kind {
        ScanKind::Beams => Some(if is_tilted(sensor) { 2 } else { 0 }),
        ScanKind::Cloud => Some(1),
        _ => None,
    };
    let matched = of_vehicle
        .iter()
        .filter(|sensor| sensors.iter().any(|planned| planned.id == sensor.id))
        .filter(|sensor| wanted.is_none_or(|wanted| sensor.name == wanted))
        .filter_map(|sensor| Some((rank(sensor)?, sensor)))
        .min_by_key(|(rank, _)| *rank);
    let Some((_, matched)) = matched else {
        let names: Vec<_> = of_vehicle.iter().map(|sensor| sensor.name).collect();
        let which = wanted.map_or_else(
            || "none of its range sensors is a planar laser or a lidar".to_owned(),
            |wanted| {
                format!("it has no planar laser and no lidar {wanted:?} (localization.scan_sensor)")
            },
        );
        return Err(UsageError(format!(
            "vehicle {:?}: no scans to match: {which}; its range sensors: {}",
            config.vehicle.name,
            names.join(", ")
        )));
    };
    let motion = match prior {
        PoseOrigin::Static => MotionPrior::None,
        PoseOrigin::Attitude(_) => MotionPrior::Heading,
        _ => MotionPrior::Full,
    };
    let is_tilted = is_tilted(matched);
    if is_tilted && motion != MotionPrior::Full {
        return Err(UsageError(format!(
            "vehicle {:?}: the laser {:?} is tilted, so that its scans determine poses only together with odometry: set \
             localization.source to \"scan+wheels\" or \"scan+gps\"",
            config.vehicle.name, matched.name
        )));
    }
    Ok(Some(ScanLocalizationSettings {
        sensor: matched.id,
        is_tilted,
        prior: motion,
        // Where a tilted laser meets the ground depends on roll and pitch: those of its odometry count, too.
        has_gravity: is_tilted
            || matches!(
                prior,
                PoseOrigin::Wheels(_) | PoseOrigin::Gps(_) | PoseOrigin::Attitude(_)
            ),
        has_height: matches!(prior, PoseOrigin::Gps(_)),
        receiver: the_gps(&config.sensors).map(|(_, gps)| ReceiverSettings {
            time_offset: RobotDuration::from_secs_f64(gps.time_offset_s),
            antenna_in_base: gps.mount.base_from_sensor().translation.vector,
        }),
        slam: SlamSettings::default(),
    }))
}

/// Cosine of the greatest tilt of a laser whose scans are matched in the plane, 3°.
const LEAST_LEVEL: f64 = 0.9986;

fn attitude(config: &Config, imu: &ImuConfig) -> AttitudeSettings {
    let seconds = RobotDuration::from_secs_f64;
    AttitudeSettings {
        time_offset: seconds(imu.time_offset_s),
        base_from_imu: imu.mount.base_from_sensor().rotation,
        smoothing: seconds(config.localization.attitude_smoothing_s),
    }
}

fn jump_limit(config: &Config) -> JumpLimit {
    JumpLimit {
        slack_m: config.localization.jump_m,
        speed_mps: SPEED_MARGIN * config.vehicle.max_speed_mps,
    }
}

pub fn registration_settings(
    config: &Config,
    localization_plan: &LocalizationPlan,
) -> RegistrationSettings {
    let localization = &config.localization;
    let seconds = RobotDuration::from_secs_f64;
    let of_vehicle = config.range_sensors();
    let sensors = localization_plan.sensors.iter().filter_map(|planned| {
        let sensor = of_vehicle.get(usize::from(planned.id.0))?;
        Some(range_sensor(planned, sensor.config))
    });
    let vehicle = &config.vehicle;
    RegistrationSettings {
        origin: localization_plan.origin.clone(),
        pose_streams: localization_plan.pose_streams,
        base_frame: localization.base_frame.as_str().into(),
        limits: InterpolationLimits {
            max_gap: seconds(localization.max_gap_s),
            max_extrapolation: seconds(localization.max_extrapolation_s),
            jump: jump_limit(config),
        },
        pose_history: seconds(localization.buffer_s),
        max_pose_wait: seconds(localization.max_pose_wait_s),
        max_queued: localization.max_waiting_scans,
        sensors: sensors.collect(),
        body: BodyBox {
            length_m: vehicle.length_m,
            width_m: vehicle.width_m,
            offset_m: vehicle.footprint_offset_m,
            lowest_m: vehicle.bottom_z_m,
            highest_m: vehicle.bottom_z_m + vehicle.height_m,
        },
        continuation: None,
    }
}

fn range_sensor(planned: &PlannedSensor, config: &RangeSensorConfig) -> RangeSensorSettings {
    let range_m = |range_m: Option<f64>| range_m.map(|range_m| range_m as f32);
    let tilt = |stream| {
        let tilt = config.tilt.as_ref()?;
        Some(tilt_settings(tilt, stream))
    };
    RangeSensorSettings {
        stream: planned.stream,
        beams: SensorSettings {
            id: planned.id,
            kind: config.scan_kind,
            range_min_m: range_m(config.range_min_m),
            range_max_m: range_m(config.range_max_m).or(planned.range_max_m),
            zero_range: config.zero_range,
            time_offset: RobotDuration::from_secs_f64(config.time_offset_s),
            thin_m: config.thin_m.unwrap_or_default(),
            base_from_sensor: config.mount.base_from_sensor(),
        },
        mount: planned.mount,
        tilt: planned.tilt_stream.and_then(tilt),
    }
}

fn tilt_settings(tilt: &TiltConfig, stream: StreamId) -> TiltSettings {
    TiltSettings {
        joint: tilt.joint.clone(),
        stream: Some(stream),
        scale: tilt.scale,
        offset_rad: tilt.offset_deg.to_radians(),
        time_offset: RobotDuration::from_secs_f64(tilt.time_offset_s),
    }
}
