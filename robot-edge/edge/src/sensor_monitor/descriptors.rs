//! The monitored sensors and their streams.

use protocol::message::{FieldOfView, SensorInfo, SensorKind, SensorMount};

use super::geometry::{DetectedGeometry, sensor_mount};
use crate::config::{Config, FixesAndAttitude, RangeSensorConfig, SensorConfig, WheelsAndAttitude};
use localization::beam_projection::{RangeLimits, ZeroRange};
use localization::registration::{
    MountOrigin, PoseOrigin, RangeSensorSettings, RegistrationSettings,
};
use mapping::registered_scan::SensorId;
use measurement::{FrameId, Measurement, MeasurementData, StreamId};

#[derive(Clone, Debug)]
pub struct SensorDescriptor {
    pub info: SensorInfo,
    pub own: MeasurementSelector,
    pub(super) range_sensor: Option<SensorId>,
    pub(super) geometry: DetectedGeometry,
}

/// The measurements of one sensor; a `None` stream accepts any.
#[derive(Clone, Debug, PartialEq)]
pub enum MeasurementSelector {
    /// Scans.
    Scans {
        stream: Option<StreamId>,
        /// Replaces the messages' smallest range, metres.
        range_min_m: Option<f32>,
        /// Replaces the messages' greatest range, metres.
        range_max_m: Option<f32>,
        /// Meaning of a range below the smallest one.
        zero_range: ZeroRange,
    },
    /// Angles of wheels.
    Wheels {
        stream: Option<StreamId>,
        joint: String,
    },
    /// Angles of the servo that tilts a range sensor.
    Tilt {
        stream: Option<StreamId>,
        joint: String,
    },
    /// Attitudes.
    Attitudes(Option<StreamId>),
    /// Satellite fixes.
    Fixes(Option<StreamId>),
    /// Odometry messages.
    Odometry,
    /// Transforms in the fixed frame.
    Transforms { fixed_frame: FrameId },
}

impl MeasurementSelector {
    /// Whether a measurement is valid; `None` if it belongs to another sensor.
    pub(super) fn classify(&self, measurement: &Measurement) -> Option<bool> {
        let is_of = |stream: &Option<StreamId>| stream.is_none_or(|own| own == measurement.stream);
        match (self, &measurement.data) {
            (
                Self::Scans {
                    stream,
                    range_min_m,
                    range_max_m,
                    zero_range,
                },
                MeasurementData::Scan { scan, .. },
            ) if is_of(stream) => {
                let rule = RangeLimits {
                    range_min_m: range_min_m.unwrap_or(scan.range_min_m),
                    range_max_m: range_max_m.unwrap_or(scan.range_max_m),
                    zero_range: *zero_range,
                };
                Some(
                    scan.ranges_m
                        .iter()
                        .any(|range_m| rule.classify(*range_m).is_some()),
                )
            }
            (
                Self::Wheels { stream, joint } | Self::Tilt { stream, joint },
                MeasurementData::Joints(joints),
            ) if is_of(stream) => {
                let (_, angle_rad) = joints.iter().find(|(name, _)| name == joint)?;
                Some(angle_rad.is_finite())
            }
            (Self::Attitudes(stream), MeasurementData::Imu(sample)) if is_of(stream) => {
                let orientation = sample.orientation_xyzw;
                Some(orientation.is_some_and(|parts| parts.iter().all(|part| part.is_finite())))
            }
            (Self::Fixes(stream), MeasurementData::Fix(fix)) if is_of(stream) => {
                Some(fix.status >= 0)
            }
            (Self::Odometry, MeasurementData::Odometry { .. }) => Some(true),
            (
                Self::Transforms { fixed_frame },
                MeasurementData::Transform {
                    is_static: false, ..
                },
            ) if measurement.frame == *fixed_frame => Some(true),
            (
                Self::Scans { .. }
                | Self::Wheels { .. }
                | Self::Tilt { .. }
                | Self::Attitudes(_)
                | Self::Fixes(_)
                | Self::Odometry
                | Self::Transforms { .. },
                MeasurementData::Scan { .. }
                | MeasurementData::Transform { .. }
                | MeasurementData::Odometry { .. }
                | MeasurementData::Imu(_)
                | MeasurementData::Joints(_)
                | MeasurementData::Fix(_)
                | MeasurementData::Twist(_)
                | MeasurementData::PointCloud(_),
            ) => None,
        }
    }
}

/// The sensors of the maps: range sensors, then pose sensors.
pub fn descriptors(config: &Config, localization: &RegistrationSettings) -> Vec<SensorDescriptor> {
    let of_vehicle = config.range_sensors();
    let mut descriptors = Vec::new();
    for settings in &localization.sensors {
        if let Some(sensor) = of_vehicle.get(usize::from(settings.beams.id.0)) {
            let kind = config.sensors.get(sensor.name);
            let kind = kind.map_or(SensorKind::PlanarLaser, range_kind);
            descriptors.push(range_sensor(sensor.name, kind, sensor.config, settings));
            descriptors.extend(tilt(sensor.name, settings));
        }
    }
    descriptors.extend(pose_sensors(config, localization));
    descriptors
}

const fn range_kind(config: &SensorConfig) -> SensorKind {
    match config {
        SensorConfig::LaserScan(range) if range.tilt.is_some() => SensorKind::TiltingLaser,
        SensorConfig::LaserScan(_) => SensorKind::PlanarLaser,
        SensorConfig::Sonar(_) => SensorKind::Sonar,
        SensorConfig::WheelEncoders(_) => SensorKind::WheelEncoders,
        SensorConfig::Imu(_) => SensorKind::Attitude,
        SensorConfig::Gps(_) => SensorKind::SatelliteReceiver,
    }
}

fn range_sensor(
    name: &str,
    kind: SensorKind,
    config: &RangeSensorConfig,
    settings: &RangeSensorSettings,
) -> SensorDescriptor {
    let (mount, is_upside_down) = sensor_mount(&settings.beams.base_from_sensor);
    let mount = match settings.mount {
        MountOrigin::Configured => Some(mount),
        MountOrigin::Tree => None,
    };
    let range_m = [config.range_min_m.unwrap_or_default()]
        .into_iter()
        .chain(config.range_max_m)
        .map(|metres| metres as f32);
    let range_m: Vec<f32> = range_m.collect();
    let view = match (config.field_of_view_deg, &range_m[..]) {
        (Some(angle_deg), &[least_m, greatest_m]) => {
            let half_rad = (0.5 * angle_deg.to_radians()) as f32;
            Some(FieldOfView {
                angles_rad: [-half_rad, half_rad],
                range_m: [least_m, greatest_m],
            })
        }
        (Some(_) | None, _) => None,
    };
    SensorDescriptor {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount,
            view,
            rate_hz: config.rate_hz.map(|rate_hz| rate_hz as f32),
        },
        own: MeasurementSelector::Scans {
            stream: settings.stream,
            range_min_m: settings.beams.range_min_m,
            range_max_m: settings.beams.range_max_m,
            zero_range: settings.beams.zero_range,
        },
        range_sensor: Some(settings.beams.id),
        geometry: DetectedGeometry::of_range_sensor(
            &settings.beams,
            settings.mount == MountOrigin::Tree,
            is_upside_down,
        ),
    }
}

fn tilt(name: &str, settings: &RangeSensorSettings) -> Option<SensorDescriptor> {
    let tilt = settings.tilt.as_ref()?;
    let own = MeasurementSelector::Tilt {
        stream: tilt.stream,
        joint: tilt.joint.clone(),
    };
    Some(non_ranging(
        &format!("{name} tilt"),
        SensorKind::TiltEncoder,
        None,
        own,
    ))
}

fn pose_sensors(config: &Config, localization: &RegistrationSettings) -> Vec<SensorDescriptor> {
    let streams = &localization.pose_streams;
    let place = |base_from_sensor| Some(sensor_mount(&base_from_sensor).0);
    match &localization.origin {
        PoseOrigin::Log | PoseOrigin::Static => Vec::new(),
        PoseOrigin::Tf { fixed_frame } => {
            let fixed_frame = FrameId::clone(fixed_frame);
            vec![non_ranging(
                "transforms",
                SensorKind::Transforms,
                None,
                MeasurementSelector::Transforms { fixed_frame },
            )]
        }
        PoseOrigin::Odometry => {
            vec![non_ranging(
                "odometry",
                SensorKind::Odometry,
                None,
                MeasurementSelector::Odometry,
            )]
        }
        PoseOrigin::Wheels(_) => WheelsAndAttitude::of(&config.sensors)
            .map(|WheelsAndAttitude { encoders, imu }| {
                let wheels = MeasurementSelector::Wheels {
                    stream: streams.wheels,
                    joint: encoders.1.left_joint.clone(),
                };
                vec![
                    non_ranging(encoders.0, SensorKind::WheelEncoders, None, wheels),
                    non_ranging(
                        imu.0,
                        SensorKind::Attitude,
                        place(imu.1.mount.base_from_sensor()),
                        MeasurementSelector::Attitudes(streams.attitude),
                    ),
                ]
            })
            .unwrap_or_default(),
        PoseOrigin::Gps(_) => FixesAndAttitude::of(&config.sensors)
            .map(|FixesAndAttitude { gps, imu }| {
                vec![
                    non_ranging(
                        gps.0,
                        SensorKind::SatelliteReceiver,
                        place(gps.1.mount.base_from_sensor()),
                        MeasurementSelector::Fixes(streams.fixes),
                    ),
                    non_ranging(
                        imu.0,
                        SensorKind::Attitude,
                        place(imu.1.mount.base_from_sensor()),
                        MeasurementSelector::Attitudes(streams.attitude),
                    ),
                ]
            })
            .unwrap_or_default(),
    }
}

/// A sensor without a view.
fn non_ranging(
    name: &str,
    kind: SensorKind,
    mount: Option<SensorMount>,
    own: MeasurementSelector,
) -> SensorDescriptor {
    SensorDescriptor {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount,
            view: None,
            rate_hz: None,
        },
        own,
        range_sensor: None,
        geometry: DetectedGeometry::nothing(),
    }
}
