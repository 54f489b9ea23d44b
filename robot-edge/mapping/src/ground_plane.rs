//! The plane that heights refer to, and when it is taken anew ([LOD §4.6, §5.3]; `algorithms.md` §1).

use nalgebra::{Point3, Vector3};

use super::elevation_config::GroundConfig;
use measurement::pose::{self, Pose};
use measurement::time::RobotTime;

/// The ground as the vehicle stood on it: a plane fixed in `odom`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    origin_in_odom: Point3<f64>,
    normal_in_odom: Vector3<f64>,
}

impl GroundPlane {
    /// The x-y plane of the vehicle's frame.
    pub fn under(odom_from_base: &Pose) -> Self {
        Self {
            origin_in_odom: Point3::from(odom_from_base.translation.vector),
            normal_in_odom: odom_from_base.rotation * Vector3::z(),
        }
    }

    /// How high a point is above it, metres; below it negative.
    ///
    /// For a point that a beam hit this is `H = cos ρ · (R_ref − R_real)` of [LOD §4.2], without keeping a
    /// plane of reference ranges: `z = h − R_real · cos ρ` and `h = R_ref · cos ρ`.
    pub fn height_m(&self, point_in_odom: &Point3<f64>) -> f64 {
        self.normal_in_odom
            .dot(&(point_in_odom - self.origin_in_odom))
    }
}

/// Decides when the ground has changed its orientation.
///
/// [LOD §5.3] takes the plane anew where pitch differs from that of the last time by more than ε and from
/// that of the last scan by less than η. Taken literally this happens one scan after a bump, with the
/// vehicle on top of it. So here every change from scan to scan must have stayed below η, and the pitch within half
/// of ε of itself, while the vehicle drove a wheelbase: no object that is shorter can do it, nor standing still on one.
#[derive(Clone, Debug)]
pub struct GroundTracker {
    epsilon_rad: f64,
    /// η as a rate: the document's is per scan, at 25 Hz.
    eta_radps: f64,
    wheelbase_m: f64,
    plane: Option<AveragedPlane>,
    last: Option<Sample>,
    /// How far the vehicle has driven with a steady pitch, and what that was where it began to be.
    steady_m: f64,
    steady_pitch_rad: f64,
}

/// A plane and the attitudes that it is the mean of.
#[derive(Clone, Copy, Debug)]
struct AveragedPlane {
    plane: GroundPlane,
    pitch_rad: f64,
    scans: u32,
}

/// A plane is the mean of so many attitudes after it was taken: 0.1° of noise in a single one would be 7 cm
/// at the end of a street.
const AVERAGED_SCANS: u32 = 50;

impl AveragedPlane {
    fn new(odom_from_base: &Pose, pitch_rad: f64) -> Self {
        Self {
            plane: GroundPlane::under(odom_from_base),
            pitch_rad,
            scans: 1,
        }
    }

    /// Takes in one more attitude of a vehicle that still stands on the plane.
    fn average_in(&mut self, odom_from_base: &Pose, pitch_rad: f64) {
        if self.scans < AVERAGED_SCANS {
            self.scans += 1;
            let share = 1.0 / f64::from(self.scans);
            let up = odom_from_base.rotation * Vector3::z();
            let mean = self.plane.normal_in_odom.lerp(&up, share);
            self.plane.normal_in_odom = mean / libm::sqrt(mean.norm_squared());
            self.pitch_rad += (pitch_rad - self.pitch_rad) * share;
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    stamp: RobotTime,
    position: Point3<f64>,
    pitch_rad: f64,
}

/// The ground plane was reset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlaneReset {
    /// When.
    pub stamp: RobotTime,
    /// Pitch when it was taken before, radians, positive nose down.
    pub pitch_before_rad: f64,
    /// Pitch now.
    pub pitch_rad: f64,
    /// How far the vehicle had driven with a steady pitch, metres.
    pub steady_m: f64,
}

impl std::fmt::Display for GroundPlaneReset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the ground plane was reset and the elevation and obstacle maps erased: pitch went from {:.1}° \
             to {:.1}° and stayed there for {:.2} m",
            tenths(self.pitch_before_rad),
            tenths(self.pitch_rad),
            self.steady_m
        )
    }
}

/// Degrees, rounded so that none is "-0.0".
fn tenths(angle_rad: f64) -> f64 {
    libm::round(10.0 * angle_rad.to_degrees()) / 10.0 + 0.0
}

/// The document's scan rate, to which its η refers.
const DOCUMENT_RATE_HZ: f64 = 25.0;

impl GroundTracker {
    /// For a vehicle with axles `wheelbase_m` apart.
    pub fn new(config: &GroundConfig, wheelbase_m: f64) -> Self {
        Self {
            epsilon_rad: config.epsilon_deg.to_radians(),
            eta_radps: config.eta_deg.to_radians() * DOCUMENT_RATE_HZ,
            wheelbase_m,
            plane: None,
            last: None,
            steady_m: 0.0,
            steady_pitch_rad: 0.0,
        }
    }

    /// Takes the vehicle's pose at a scan; returns the plane that the scan's heights refer to, and the
    /// change where it was taken anew. The first pose gives the first plane, which is no change.
    pub fn update(
        &mut self,
        stamp: RobotTime,
        odom_from_base: &Pose,
    ) -> (GroundPlane, Option<GroundPlaneReset>) {
        let now = Sample {
            stamp,
            position: Point3::from(odom_from_base.translation.vector),
            pitch_rad: pose::pitch_rad(odom_from_base),
        };
        self.follow_pitch(now);
        let taken = AveragedPlane::new(odom_from_base, now.pitch_rad);
        let Some(before) = &mut self.plane else {
            self.plane = Some(taken);
            return (taken.plane, None);
        };
        let is_tilted = (now.pitch_rad - before.pitch_rad).abs() > self.epsilon_rad;
        if !is_tilted {
            before.average_in(odom_from_base, now.pitch_rad);
        }
        let before = *before;
        if !is_tilted || self.steady_m < self.wheelbase_m {
            return (before.plane, None);
        }
        self.plane = Some(taken);
        let change = GroundPlaneReset {
            stamp,
            pitch_before_rad: before.pitch_rad,
            pitch_rad: now.pitch_rad,
            steady_m: self.steady_m,
        };
        (taken.plane, Some(change))
    }

    /// The plane; `None` before the first pose.
    pub fn plane(&self) -> Option<GroundPlane> {
        self.plane.map(|taken| taken.plane)
    }

    /// Forgets the plane: the next pose gives a new one.
    pub fn reset(&mut self) {
        self.plane = None;
        self.last = None;
        self.steady_m = 0.0;
    }

    fn follow_pitch(&mut self, now: Sample) {
        let Some(before) = self.last.replace(now) else {
            return;
        };
        let elapsed_s = now.stamp.since(before.stamp).as_secs_f64();
        let change_rad = (now.pitch_rad - before.pitch_rad).abs();
        // Onto a ramp the pitch may well change by less than η in every scan: it must also stay where it is.
        let drift_rad = (now.pitch_rad - self.steady_pitch_rad).abs();
        if change_rad <= self.eta_radps * elapsed_s && drift_rad <= 0.5 * self.epsilon_rad {
            self.steady_m += (now.position - before.position).norm();
        } else {
            self.steady_m = 0.0;
            self.steady_pitch_rad = now.pitch_rad;
        }
    }
}

#[cfg(test)]
mod tests;
