//! View and mount of a range sensor, taken from its first measurements if they are not configured.

use nalgebra::{Point3, Vector3};
use protocol::message::{FieldOfView, SensorInfo, SensorMount};

use localization::beam_projection::SensorSettings;
use mapping::registered_scan::{RegisteredBeam, RegisteredScan};
use measurement::pose::Pose;
use measurement::{Measurement, MeasurementData};

/// Angles between two beams that determine the direction of the sweep, radians.
const MIN_SIDE_ANGLE_RAD: f64 = 0.2;

#[derive(Clone, Debug)]
pub(super) struct DetectedGeometry {
    /// Replace the messages' own ranges, metres.
    range_m: [Option<f32>; 2],
    /// Of the first scan: angle of the first beam, and from each to the next.
    fan: Option<BeamAngles>,
    needs_mount: bool,
    is_upside_down: bool,
    is_non_ranging: bool,
}

#[derive(Clone, Copy, Debug)]
struct BeamAngles {
    first_rad: f64,
    step_rad: f64,
}

impl DetectedGeometry {
    /// A sensor without a view.
    pub(super) const fn nothing() -> Self {
        Self {
            range_m: [None; 2],
            fan: None,
            needs_mount: false,
            is_upside_down: false,
            is_non_ranging: true,
        }
    }

    /// A range sensor. If its mount is in the transform tree, the first registered scan gives it.
    pub(super) const fn of_range_sensor(
        settings: &SensorSettings,
        is_in_tree: bool,
        is_upside_down: bool,
    ) -> Self {
        Self {
            range_m: [settings.range_min_m, settings.range_max_m],
            fan: None,
            needs_mount: is_in_tree,
            is_upside_down,
            is_non_ranging: false,
        }
    }

    /// Processes a measurement. Returns whether `info` changed.
    pub(super) fn measured(&mut self, measurement: &Measurement, info: &mut SensorInfo) -> bool {
        let scan = match &measurement.data {
            MeasurementData::Scan { scan, .. } => scan,
            MeasurementData::Range(reading) => &reading.arc(),
            _ => return false,
        };
        if self.is_non_ranging || self.fan.is_some() || scan.sweep_duration().is_none() {
            return false;
        }
        let fan = BeamAngles {
            first_rad: scan.angle_min_rad.into(),
            step_rad: scan.angle_increment_rad.into(),
        };
        self.fan = Some(fan);
        let last_rad = fan.angle_rad(scan.ranges_m.len().saturating_sub(1) as f64);
        let mut angles_rad = [fan.first_rad, last_rad];
        if self.is_upside_down {
            angles_rad = angles_rad.map(|angle_rad| -angle_rad);
        }
        angles_rad.sort_by(f64::total_cmp);
        let [least_m, greatest_m] = self.range_m;
        let view = FieldOfView {
            angles_rad: angles_rad.map(|angle_rad| angle_rad as f32),
            range_m: [
                least_m.unwrap_or(scan.range_min_m),
                greatest_m.unwrap_or(scan.range_max_m),
            ],
        };
        let is_finite = view
            .angles_rad
            .iter()
            .chain(&view.range_m)
            .all(|n| n.is_finite());
        if !is_finite || info.view == Some(view) {
            return false;
        }
        info.view = Some(view);
        true
    }

    /// Processes a registered scan. Returns whether `info` changed.
    pub(super) fn on_registered_scan(
        &mut self,
        scan: &RegisteredScan,
        info: &mut SensorInfo,
    ) -> bool {
        let Some(fan) = self.fan.filter(|_| self.needs_mount) else {
            return false;
        };
        let from_ahead = |beam: &&RegisteredBeam| fan.angle_rad(beam.index.into()).abs();
        let by_angle =
            |a: &&RegisteredBeam, b: &&RegisteredBeam| from_ahead(a).total_cmp(&from_ahead(b));
        let Some(ahead) = scan.beams.iter().min_by(by_angle) else {
            return false;
        };
        let base_from_odom = scan.odom_from_base.inverse();
        let place = base_from_odom * ahead.origin_in_odom;
        let (ahead_rad, ahead_in_base) = (
            fan.angle_rad(ahead.index.into()),
            bearing_rad(&base_from_odom, ahead),
        );
        let aside = scan.beams.iter().find(|beam| {
            let from_rad = fan.angle_rad(beam.index.into()) - ahead_rad;
            (MIN_SIDE_ANGLE_RAD..1.0).contains(&from_rad.abs())
        });
        // From above, an upside-down sensor sweeps in the other direction.
        let is_mirrored = aside.is_some_and(|beam| {
            let by_fan = fan.angle_rad(beam.index.into()) - ahead_rad;
            let by_place = wrapped_rad(bearing_rad(&base_from_odom, beam) - ahead_in_base);
            by_fan * by_place < 0.0
        });
        let sign = if is_mirrored { -1.0 } else { 1.0 };
        self.needs_mount = false;
        info.mount = Some(SensorMount {
            position_m: <[f64; 3]>::from(place.coords).map(|metres| metres as f32),
            yaw_rad: wrapped_rad(ahead_in_base - sign * ahead_rad) as f32,
        });
        if let Some(view) = info.view.as_mut().filter(|_| is_mirrored) {
            let [low_rad, high_rad] = view.angles_rad;
            view.angles_rad = [-high_rad, -low_rad];
        }
        true
    }
}

impl BeamAngles {
    fn angle_rad(self, index: f64) -> f64 {
        self.first_rad + index * self.step_rad
    }
}

/// Direction of a beam from above, in the vehicle's frame.
fn bearing_rad(base_from_odom: &Pose, beam: &RegisteredBeam) -> f64 {
    let [from, to] = [beam.origin_in_odom, beam.end_in_odom].map(|point| base_from_odom * point);
    libm::atan2(to.y - from.y, to.x - from.x)
}

fn wrapped_rad(angle_rad: f64) -> f64 {
    libm::remainder(angle_rad, std::f64::consts::TAU)
}

/// The published mount, and whether the sensor is upside down.
pub(super) fn sensor_mount(base_from_sensor: &Pose) -> (SensorMount, bool) {
    let place = base_from_sensor * Point3::origin();
    let ahead = base_from_sensor.rotation * Vector3::x();
    let up = base_from_sensor.rotation * Vector3::z();
    let mount = SensorMount {
        position_m: <[f64; 3]>::from(place.coords).map(|metres| metres as f32),
        yaw_rad: libm::atan2(ahead.y, ahead.x) as f32,
    };
    (mount, up.z < 0.0)
}
