//! Which sensors there are to be watched, and which measurements are whose.

use protocol::message::{FieldOfView, SensorInfo, SensorKind, SensorMount};

use super::sight::{Sight, mounted};
use crate::config::{Config, FixesAndAttitude, RangeSensorConfig, SensorConfig, WheelsAndAttitude};
use crate::localization::beam_range::{RangeRule, ZeroRange};
use crate::localization::placer::{MountOrigin, PlacerSettings, PoseOrigin, RangeSensorSettings};
use crate::mapping::posed_scan::SensorId;
use crate::measurement::{FrameId, Measurement, MeasurementData, StreamId};

/// A sensor to be watched.
#[derive(Clone, Debug)]
pub struct Listed {
    /// What is known of it.
    pub info: SensorInfo,
    /// What it measures.
    pub own: Own,
    pub(super) range_sensor: Option<SensorId>,
    pub(super) sight: Sight,
}

/// The measurements of one sensor; where a stream is `None`, those of any.
#[derive(Clone, Debug, PartialEq)]
pub enum Own {
    /// Sweeps.
    Scans {
        /// Of this stream.
        stream: Option<StreamId>,
        /// Replaces the messages' smallest range, metres.
        range_min_m: Option<f32>,
        /// Replaces the messages' greatest range, metres.
        range_max_m: Option<f32>,
        /// What a range below the smallest one means.
        zero: ZeroRange,
    },
    /// Angles of wheels.
    Wheels {
        /// Of this stream.
        stream: Option<StreamId>,
        /// One of the joints.
        joint: String,
    },
    /// Angles of the servo that tilts a range sensor.
    Tilt {
        /// Of this stream.
        stream: Option<StreamId>,
        /// The joint.
        joint: String,
    },
    /// Attitudes.
    Attitudes(Option<StreamId>),
    /// Satellite fixes.
    Fixes(Option<StreamId>),
    /// Odometry messages.
    Odometry,
    /// Transforms in the frame of the map.
    Transforms {
        /// That frame.
        fixed_frame: FrameId,
    },
}

impl Own {
    /// Whether a measurement says anything; `None` where it is another's.
    pub(super) fn judge(&self, measurement: &Measurement) -> Option<bool> {
        let is_of = |stream: &Option<StreamId>| stream.is_none_or(|own| own == measurement.stream);
        match (self, &measurement.data) {
            (
                Self::Scans {
                    stream,
                    range_min_m,
                    range_max_m,
                    zero,
                },
                MeasurementData::Scan { scan, .. },
            ) if is_of(stream) => {
                let rule = RangeRule {
                    range_min_m: range_min_m.unwrap_or(scan.range_min_m),
                    range_max_m: range_max_m.unwrap_or(scan.range_max_m),
                    zero: *zero,
                };
                Some(
                    scan.ranges_m
                        .iter()
                        .any(|range_m| rule.judge(*range_m).is_some()),
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

/// The sensors that maps are made of: those that see, then those that say where the vehicle is.
pub fn listed(config: &Config, placing: &PlacerSettings) -> Vec<Listed> {
    let of_vehicle = config.range_sensors();
    let mut listed = Vec::new();
    for settings in &placing.sensors {
        if let Some(sensor) = of_vehicle.get(usize::from(settings.beams.id.0)) {
            let kind = config.sensors.get(sensor.name);
            let kind = kind.map_or(SensorKind::PlanarLaser, range_kind);
            listed.push(range_sensor(sensor.name, kind, sensor.config, settings));
            listed.extend(tilt(sensor.name, settings));
        }
    }
    listed.extend(pose_sensors(config, placing));
    listed
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
) -> Listed {
    let (mount, is_upside_down) = mounted(&settings.beams.base_from_sensor);
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
    Listed {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount,
            view,
            rate_hz: config.rate_hz.map(|rate_hz| rate_hz as f32),
        },
        own: Own::Scans {
            stream: settings.stream,
            range_min_m: settings.beams.range_min_m,
            range_max_m: settings.beams.range_max_m,
            zero: settings.beams.zero,
        },
        range_sensor: Some(settings.beams.id),
        sight: Sight::of_range_sensor(
            &settings.beams,
            settings.mount == MountOrigin::Tree,
            is_upside_down,
        ),
    }
}

fn tilt(name: &str, settings: &RangeSensorSettings) -> Option<Listed> {
    let tilt = settings.tilt.as_ref()?;
    let own = Own::Tilt {
        stream: tilt.stream,
        joint: tilt.joint.clone(),
    };
    Some(blind(
        &format!("{name} tilt"),
        SensorKind::TiltEncoder,
        None,
        own,
    ))
}

fn pose_sensors(config: &Config, placing: &PlacerSettings) -> Vec<Listed> {
    let streams = &placing.pose_streams;
    let place = |base_from_sensor| Some(mounted(&base_from_sensor).0);
    match &placing.origin {
        PoseOrigin::Log | PoseOrigin::Static => Vec::new(),
        PoseOrigin::Tf { fixed_frame } => {
            let fixed_frame = FrameId::clone(fixed_frame);
            vec![blind(
                "transforms",
                SensorKind::Transforms,
                None,
                Own::Transforms { fixed_frame },
            )]
        }
        PoseOrigin::Odometry => {
            vec![blind("odometry", SensorKind::Odometry, None, Own::Odometry)]
        }
        PoseOrigin::Wheels(_) => WheelsAndAttitude::of(&config.sensors)
            .map(|WheelsAndAttitude { encoders, imu }| {
                let wheels = Own::Wheels {
                    stream: streams.wheels,
                    joint: encoders.1.left_joint.clone(),
                };
                vec![
                    blind(encoders.0, SensorKind::WheelEncoders, None, wheels),
                    blind(
                        imu.0,
                        SensorKind::Attitude,
                        place(imu.1.mount.base_from_sensor()),
                        Own::Attitudes(streams.attitude),
                    ),
                ]
            })
            .unwrap_or_default(),
        PoseOrigin::Gps(_) => FixesAndAttitude::of(&config.sensors)
            .map(|FixesAndAttitude { gps, imu }| {
                vec![
                    blind(
                        gps.0,
                        SensorKind::SatelliteReceiver,
                        place(gps.1.mount.base_from_sensor()),
                        Own::Fixes(streams.fixes),
                    ),
                    blind(
                        imu.0,
                        SensorKind::Attitude,
                        place(imu.1.mount.base_from_sensor()),
                        Own::Attitudes(streams.attitude),
                    ),
                ]
            })
            .unwrap_or_default(),
    }
}

/// A sensor that sweeps nothing.
fn blind(name: &str, kind: SensorKind, mount: Option<SensorMount>, own: Own) -> Listed {
    Listed {
        info: SensorInfo {
            name: name.to_owned(),
            kind,
            mount,
            view: None,
            rate_hz: None,
        },
        own,
        range_sensor: None,
        sight: Sight::nothing(),
    }
}
