//! The lower half of a wheel's rim on the ground.

use nalgebra::{Point2, Point3};

use measurement::pose::Pose;

/// The lower half of a wheel, a disc without width in a given pose.
pub(super) struct Rim {
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
    /// Height of the rim.
    rim: f64,
    /// Height of the ground below; −∞ where there is something else.
    ground: f64,
}

/// Places in which the rim is looked at; what is narrower than their distance may slip through between two.
const INTERVALS: u32 = 32;

/// The lift is exact to this, metres.
const TOLERANCE_M: f64 = 1e-5;

/// Halvings of an interval: 2⁻¹⁰ of 8 mm places the edge of a kerb to 8 µm.
const MAX_HALVINGS: u32 = 10;

impl Rim {
    pub(super) fn new(world_from_base: Pose, wheel_m: Point2<f64>, radius_m: f64) -> Self {
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
    pub(super) fn lift_m(&self, ground_below: &impl Fn(Point3<f64>) -> Option<f64>) -> Option<f64> {
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
