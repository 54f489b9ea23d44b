//! Wheels and body: how a vehicle on four wheels stands on uneven ground.

mod rim;

use nalgebra::{Point2, Point3, Translation3, Vector2};

use crate::attitude::Attitude;
use crate::chassis::rim::Rim;
use crate::path::PlanarPose;
use crate::wheel_encoders::WheelEncoders;
use measurement::pose::Pose;

/// Four wheels at the corners of a rectangle about `base_link`, which lies on the ground plane midway
/// between the axles; the wheels of a side turn together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// From the rear axle to the front axle, metres.
    pub wheelbase_m: f64,
    /// From the middle of the left wheels to the middle of the right wheels, metres.
    pub track_m: f64,
    /// Radius of the wheels, metres.
    pub wheel_radius_m: f64,
    /// Encoders that count the turns of the left and the right wheels, where there are any.
    pub encoders: Option<WheelEncoders>,
}

/// Height and tilt of a vehicle: what the ground adds to its pose in the plane.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Posture {
    /// Height of `base_link`, metres.
    pub z_m: f64,
    /// Radians, positive nose down.
    pub pitch_rad: f64,
    /// Radians, positive right side down.
    pub roll_rad: f64,
}

impl Posture {
    /// The pose of a vehicle that stands so at `at`.
    pub fn world_from_base(&self, at: PlanarPose) -> Pose {
        let attitude = Attitude {
            roll_rad: self.roll_rad,
            pitch_rad: self.pitch_rad,
            yaw_rad: at.yaw_rad,
        };
        Pose::from_parts(
            Translation3::new(at.position_m.x, at.position_m.y, self.z_m),
            attitude.rotation(),
        )
    }

    /// The posture a share of the way from here to `next`; 0 is here, 1 is there.
    #[must_use]
    pub fn towards(&self, next: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            z_m: between(self.z_m, next.z_m),
            pitch_rad: between(self.pitch_rad, next.pitch_rad),
            roll_rad: between(self.roll_rad, next.roll_rad),
        }
    }

    /// Largest of the differences, metres or radians.
    fn distance(&self, other: &Self) -> f64 {
        (self.z_m - other.z_m)
            .abs()
            .max((self.pitch_rad - other.pitch_rad).abs())
            .max((self.roll_rad - other.roll_rad).abs())
    }
}

/// Where a settling vehicle is taken to have settled, metres and radians.
const SETTLED: f64 = 1e-7;

const MAX_PASSES: usize = 12;

/// A vehicle that would fall over an edge hangs there at this tilt instead.
const MAX_TILT_RAD: f64 = 1.1;

impl Chassis {
    /// How the vehicle stands at `at`, where it stood as `last` shortly before.
    ///
    /// Each wheel is a rigid disc that rests on the highest ground under its rim, so that it climbs a kerb
    /// smoothly; the body is the least-squares plane through the four wheels, as on a chassis that gives.
    /// `ground_below` is the height of the first surface below a point, metres, or `None` where the point is
    /// inside something: such a thing is higher than the wheels and is not driven over. A wheel with nothing
    /// but such things around it stays level with the vehicle.
    pub fn settle(
        &self,
        at: PlanarPose,
        last: Posture,
        ground_below: &impl Fn(Point3<f64>) -> Option<f64>,
    ) -> Posture {
        let mut posture = last;
        for _ in 0..MAX_PASSES {
            let before = posture;
            posture = self.fitted(at, before, ground_below);
            if posture.distance(&before) < SETTLED {
                break;
            }
        }
        posture
    }

    /// The body through the wheels where they touch the ground in the attitude of `posture`.
    fn fitted(
        &self,
        at: PlanarPose,
        posture: Posture,
        ground_below: &impl Fn(Point3<f64>) -> Option<f64>,
    ) -> Posture {
        let world_from_base = posture.world_from_base(at);
        let [front_left, front_right, rear_left, rear_right] = self.wheels_m().map(|wheel_m| {
            let rim = Rim::new(world_from_base, wheel_m, self.wheel_radius_m);
            rim.lift_m(ground_below).unwrap_or(0.0)
        });
        let front_m = 0.5 * (front_left + front_right - rear_left - rear_right);
        let left_m = 0.5 * (front_left - front_right + rear_left - rear_right);
        // Newton's step on a plane; on steps of level ground its error shrinks by the sine squared.
        let level = libm::cos(posture.pitch_rad);
        let pitch_rad = posture.pitch_rad - front_m / self.wheelbase_m * level;
        let roll_rad =
            posture.roll_rad + left_m / self.track_m * level * libm::cos(posture.roll_rad);
        Posture {
            z_m: posture.z_m + 0.25 * (front_left + front_right + rear_left + rear_right),
            pitch_rad: pitch_rad.clamp(-MAX_TILT_RAD, MAX_TILT_RAD),
            roll_rad: roll_rad.clamp(-MAX_TILT_RAD, MAX_TILT_RAD),
        }
    }

    /// Front left, front right, rear left, rear right, metres in the base frame.
    fn wheels_m(&self) -> [Point2<f64>; 4] {
        [(0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)].map(|(along, across)| {
            Point2::from(Vector2::new(
                along * self.wheelbase_m,
                across * self.track_m,
            ))
        })
    }
}

#[cfg(test)]
mod tests;
