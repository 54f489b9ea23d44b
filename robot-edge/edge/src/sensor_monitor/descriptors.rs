//! The monitored sensors and their streams.

use protocol::message::{FieldOfView, SensorInfo, SensorKind};

use super::geometry::{DetectedGeometry, sensor_mount};
use crate::config::{
    Config, FixesAndAttitude, ImuConfig, RangeSensorConfig, SensorConfig, WheelsAndAttitude,
    the_imu,
};
use localization::beam_projection::{RangeLimits, ZeroRange};
use localization::registration::{
    MountOrigin, PoseOrigin, RangeSensorSettings, RegistrationSettings,
};
use mapping::registered_scan::{ScanKind, SensorId};
use measurement::mount::Mount;
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
    Scans {
        stream: Option<StreamId>,
        /// Replaces the messages' smallest range, metres.
        range_min_m: Option<f32>,
        /// Replaces the messages' greatest range, metres.
        range_max_m: Option<f32>,
        /// Meaning of a range below the smallest one.
        zero_range: ZeroRange,
    },
    Ranges(Option<StreamId>),
    Clouds(Option<StreamId>),
    Contacts(Option<StreamId>),
    Wheels {
        stream: Option<StreamId>,
        joint: String,
    },
    Tilt {
        stream: Option<StreamId>,
        joint: String,
    },
    Attitudes(Option<StreamId>),
    Fixes(Option<StreamId>),
    Odometry,
    Transforms {
        fixed_frame: FrameId,
    },
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
            (Self::Ranges(stream), MeasurementData::Range(reading)) if is_of(stream) => {
                Some(!reading.range_m.is_nan())
            }
            (Self::Clouds(stream), MeasurementData::Cloud(cloud)) if is_of(stream) => {
                Some(!cloud.points.is_empty())
            }
            (Self::Contacts(stream), MeasurementData::Bool(_)) if is_of(stream) => Some(true),
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
                | Self::Ranges(_)
                | Self::Clouds(_)
                | Self::Contacts(_)
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
                | MeasurementData::Cloud(_)
                | MeasurementData::Range(_)
                | MeasurementData::Bool(_),
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
        SensorConfig::Lidar(_) => SensorKind::Lidar,
        SensorConfig::Sonar(_) => SensorKind::Sonar,
        SensorConfig::WheelEncoders(_) => SensorKind::WheelEncoders,
        SensorConfig::Imu(_) => SensorKind::Attitude,
        SensorConfig::Gps(_) => SensorKind::SatelliteReceiver,
        SensorConfig::Ultrasonic(_) => SensorKind::Ultrasonic,
        SensorConfig::Bumper(_) => SensorKind::Bumper,
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
    let view = config.field_of_view_deg.zip(config.range_max_m);
    let view = view.map(|(angle_deg, greatest_m)| {
        let half_rad = (0.5 * angle_deg.to_radians()) as f32;
        let least_m = config.range_min_m.unwrap_or_default();
        FieldOfView {
            angles_rad: [-half_rad, half_rad],
            range_m: [least_m as f32, greatest_m as f32],
        }
    });
    SensorDescriptor {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount,
            view,
            rate_hz: config.rate_hz.map(|rate_hz| rate_hz as f32),
        },
        own: match settings.beams.kind {
            ScanKind::Beams => MeasurementSelector::Scans {
                stream: settings.stream,
                range_min_m: settings.beams.range_min_m,
                range_max_m: settings.beams.range_max_m,
                zero_range: settings.beams.zero_range,
            },
            ScanKind::Cloud => MeasurementSelector::Clouds(settings.stream),
            ScanKind::Arc => MeasurementSelector::Ranges(settings.stream),
            ScanKind::Contact { .. } => MeasurementSelector::Contacts(settings.stream),
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
    let name = format!("{name} tilt");
    Some(non_ranging(&name, SensorKind::TiltEncoder, None, own))
}

fn pose_sensors(config: &Config, localization: &RegistrationSettings) -> Vec<SensorDescriptor> {
    let streams = &localization.pose_streams;
    let attitude = |(name, imu): (&str, &ImuConfig)| {
        let own = MeasurementSelector::Attitudes(streams.attitude);
        non_ranging(name, SensorKind::Attitude, Some(&imu.mount), own)
    };
    match localization.origin.prior() {
        PoseOrigin::Log | PoseOrigin::Static | PoseOrigin::Scans { .. } => Vec::new(),
        PoseOrigin::Attitude(_) => {
            let imu = the_imu(&config.sensors);
            imu.map(attitude).into_iter().collect()
        }
        PoseOrigin::Tf { fixed_frame } => {
            let fixed_frame = FrameId::clone(fixed_frame);
            let own = MeasurementSelector::Transforms { fixed_frame };
            vec![non_ranging("transforms", SensorKind::Transforms, None, own)]
        }
        PoseOrigin::Odometry => {
            let own = MeasurementSelector::Odometry;
            vec![non_ranging("odometry", SensorKind::Odometry, None, own)]
        }
        PoseOrigin::Wheels(_) => {
            let sensors = WheelsAndAttitude::of(&config.sensors);
            let described = sensors.map(|WheelsAndAttitude { encoders, imu }| {
                let own = MeasurementSelector::Wheels {
                    stream: streams.wheels,
                    joint: encoders.1.left_joint.clone(),
                };
                let wheels = non_ranging(encoders.0, SensorKind::WheelEncoders, None, own);
                vec![wheels, attitude(imu)]
            });
            described.unwrap_or_default()
        }
        PoseOrigin::Gps(_) => {
            let sensors = FixesAndAttitude::of(&config.sensors);
            let described = sensors.map(|FixesAndAttitude { gps, imu }| {
                let (kind, mount) = (SensorKind::SatelliteReceiver, Some(&gps.1.mount));
                let own = MeasurementSelector::Fixes(streams.fixes);
                vec![non_ranging(gps.0, kind, mount, own), attitude(imu)]
            });
            described.unwrap_or_default()
        }
    }
}

fn non_ranging(
    name: &str,
    kind: SensorKind,
    mount: Option<&Mount>,
    own: MeasurementSelector,
) -> SensorDescriptor {
    SensorDescriptor {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount: mount.map(|mount| sensor_mount(&mount.base_from_sensor()).0),
            view: None,
            rate_hz: None,
        },
        own,
        range_sensor: None,
        geometry: DetectedGeometry::nothing(),
    }
}
