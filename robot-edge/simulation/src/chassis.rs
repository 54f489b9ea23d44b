//! Posture of a four-wheeled vehicle on uneven ground.

use measurement::pose::Pose;
use nalgebra::{Point2, Point3, Translation3, Vector2};

use crate::attitude::Attitude;
use crate::path::PlanarPose;
use crate::wheel_encoders::WheelEncoders;

/// Four wheels at the corners of a rectangle about `base_link`, which lies on the ground plane midway
/// between the axles; the wheels of a side turn together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    pub wheelbase_m: f64,
    pub track_m: f64,
    pub wheel_radius_m: f64,
    pub encoders: Option<WheelEncoders>,
}

/// Height and tilt of a vehicle: what the ground adds to its pose in the plane.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct Posture {
    pub(crate) z_m: f64,
    /// Radians, positive nose down.
    pub(crate) pitch_rad: f64,
    /// Radians, positive right side down.
    pub(crate) roll_rad: f64,
}

impl Posture {
    pub(crate) fn world_from_base(&self, at: PlanarPose) -> Pose {
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

    #[must_use]
    pub(crate) fn towards(&self, next: &Self, share: f64) -> Self {
        let between = |from: f64, to: f64| from + share * (to - from);
        Self {
            z_m: between(self.z_m, next.z_m),
            pitch_rad: between(self.pitch_rad, next.pitch_rad),
            roll_rad: between(self.roll_rad, next.roll_rad),
        }
    }

    fn distance(&self, other: &Self) -> f64 {
        (self.z_m - other.z_m)
            .abs()
            .max((self.pitch_rad - other.pitch_rad).abs())
            .max((self.roll_rad - other.roll_rad).abs())
    }
}

/// Convergence limit of the posture, metres and radians.
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
    pub(crate) fn settle(
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

/// The lower half of a wheel, a disc without width in a given pose.
struct Rim {
    world_from_base: Pose,
    /// Foot of the wheel in the base frame.
    wheel_m: Point2<f64>,
    radius_m: f64,
}

/// The rim above one place of the ground, metres.
#[derive(Clone, Copy)]
struct Sample {
    /// Along the wheel from below its axle.
    along: f64,
    rim: f64,
    /// Height of the ground below; −∞ where there is something else.
    ground: f64,
}

/// Places in which the rim is looked at; what is narrower than their distance may slip through between two.
const INTERVALS: u32 = 32;

const TOLERANCE_M: f64 = 1e-5;

/// Halvings of an interval: 2⁻¹⁰ of 8 mm places the edge of a kerb to 8 µm.
const MAX_HALVINGS: u32 = 10;

impl Rim {
    fn new(world_from_base: Pose, wheel_m: Point2<f64>, radius_m: f64) -> Self {
        Self {
            world_from_base,
            wheel_m,
            radius_m,
        }
    }

    /// How far the wheel has to rise to rest on the ground, metres; `None` where no ground is below it.
    ///
    /// Exact to 0.01 mm on ground that does not change direction between two places of the rim: intervals
    /// that could hold a higher contact than the highest found are halved until they cannot.
    fn lift_m(&self, ground_below: &impl Fn(Point3<f64>) -> Option<f64>) -> Option<f64> {
        let step_m = 2.0 * self.radius_m / f64::from(INTERVALS);
        let samples: Vec<Sample> = (0..=INTERVALS)
            .map(|place| {
                let along_m = (f64::from(place) - f64::from(INTERVALS / 2)) * step_m;
                self.sample(along_m, ground_below)
            })
            .collect();
        let highest_m = samples
            .iter()
            .map(Sample::lift_m)
            .fold(f64::NEG_INFINITY, f64::max);
        let lift_m = samples.windows(2).fold(highest_m, |lift_m, pair| {
            if let &[before, after] = pair {
                self.refined(before, after, lift_m, MAX_HALVINGS, ground_below)
            } else {
                lift_m
            }
        });
        lift_m.is_finite().then_some(lift_m)
    }

    /// The larger of `lift_m` and the lift between two samples.
    fn refined(
        &self,
        before: Sample,
        after: Sample,
        lift_m: f64,
        halvings: u32,
        ground_below: &impl Fn(Point3<f64>) -> Option<f64>,
    ) -> f64 {
        let width_m = after.along - before.along;
        // Between its ends the rim, an arc, hangs lower by no more than this.
        let sag_m = 0.125 * width_m * width_m / self.radius_m;
        let bound_m = before.ground.max(after.ground) - (before.rim.min(after.rim) - sag_m);
        if halvings == 0 || bound_m <= lift_m + TOLERANCE_M {
            return lift_m;
        }
        let middle = self.sample(before.along + 0.5 * width_m, ground_below);
        let lift_m = lift_m.max(middle.lift_m());
        let lift_m = self.refined(before, middle, lift_m, halvings - 1, ground_below);
        self.refined(middle, after, lift_m, halvings - 1, ground_below)
    }

    fn sample(&self, along_m: f64, ground_below: &impl Fn(Point3<f64>) -> Option<f64>) -> Sample {
        let below_axle_m = libm::sqrt((self.radius_m * self.radius_m - along_m * along_m).max(0.0));
        let rim = self.world_from_base
            * Point3::new(
                self.wheel_m.x + along_m,
                self.wheel_m.y,
                self.radius_m - below_axle_m,
            );
        let foot_z_m = (self.world_from_base * Point3::new(self.wheel_m.x, self.wheel_m.y, 0.0)).z;
        let top = Point3::new(rim.x, rim.y, foot_z_m + 2.0 * self.radius_m);
        Sample {
            along: along_m,
            rim: rim.z,
            ground: ground_below(top).unwrap_or(f64::NEG_INFINITY),
        }
    }
}

impl Sample {
    fn lift_m(&self) -> f64 {
        self.ground - self.rim
    }
}

#[cfg(test)]
mod tests;
