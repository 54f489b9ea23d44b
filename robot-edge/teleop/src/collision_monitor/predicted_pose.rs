//! Where the vehicle will be when it obeys what it is told now, seen from above.

use std::time::Duration;

use nalgebra::{Point2, Vector2};

use super::command_history::CommandHistory;
use super::unavailable::UnavailableReason;
use crate::velocity::Velocity;
use measurement::pose::{self, Pose};
use measurement::time::Monotonic;

/// What is known of where the vehicle is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometrySample {
    /// The newest pose.
    pub odom_from_base: Pose,
    /// How fast it was then, as its sensors tell.
    pub measured: Velocity,
    /// When that was, on this machine's clock.
    pub measured_at: Monotonic,
}

/// A pose in the plane, soon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PredictedPose {
    position_in_odom: Point2<f64>,
    /// Of the base frame's x axis.
    ahead: Vector2<f64>,
}

/// Oldest pose from which the present one is reckoned.
pub(super) const MAX_POSE_AGE: Duration = Duration::from_millis(300);

impl OdometrySample {
    /// Where the vehicle will be `delay` from now, when it obeys what it is told now: what it was told until now, it does
    /// whatever comes. At constant speed that is the `v · age` of the design, with measured `v`.
    ///
    /// Its speed is the measured one, and changes as what it was `commanded` did, a delay before. What `coasts` does not slow
    /// down when it is told to.
    ///
    /// # Errors
    /// What it lacks: a number is not finite, or the pose is too old.
    pub(super) fn predicted_pose(
        &self,
        commanded: &CommandHistory,
        (delay, coasts): (Duration, bool),
        now: Monotonic,
    ) -> Result<PredictedPose, UnavailableReason> {
        let age = now.since(self.measured_at);
        let at = self.odom_from_base.translation.vector;
        let mut yaw_rad = pose::yaw_rad(&self.odom_from_base);
        if age > MAX_POSE_AGE {
            return Err(UnavailableReason::PoseTooOld(Some(age)));
        }
        let is_finite = self.measured.is_finite()
            && at.x.is_finite()
            && at.y.is_finite()
            && yaw_rad.is_finite();
        if !is_finite {
            return Err(UnavailableReason::NotFinite);
        }
        // What it did when it was measured, it was told then; what it will do until `delay` from now, it was told since.
        let obeyed = before(self.measured_at, delay);
        let then = commanded.at(obeyed).unwrap_or(Velocity::ZERO);
        let mut position_in_odom = Point2::from(at.xy());
        let mut advance = |velocity: Velocity, time_s: f64| {
            let turned_rad = velocity.angular_radps * time_s;
            let half = 0.5 * turned_rad;
            // The chord of the arc, and its direction.
            let chord = if half.abs() < 1e-6 {
                1.0
            } else {
                libm::sin(half) / half
            };
            position_in_odom += direction(yaw_rad + half) * (velocity.linear_mps * time_s * chord);
            yaw_rad += turned_rad;
        };
        if coasts || commanded.at(now).is_none() {
            advance(self.measured, (age + delay).as_secs_f64());
        } else {
            for (velocity, time_s) in commanded.between(obeyed, now).filter(|part| part.1 > 0.0) {
                let since = Velocity {
                    linear_mps: self.measured.linear_mps + velocity.linear_mps - then.linear_mps,
                    angular_radps: self.measured.angular_radps + velocity.angular_radps
                        - then.angular_radps,
                };
                advance(since, time_s);
            }
        }
        Ok(PredictedPose {
            position_in_odom,
            ahead: direction(yaw_rad),
        })
    }
}

/// The moment a time before another; the clock's start where that is later.
fn before(moment: Monotonic, time: Duration) -> Monotonic {
    let since_start = moment.since(Monotonic::default()).saturating_sub(time);
    Monotonic::default() + since_start
}

fn direction(angle_rad: f64) -> Vector2<f64> {
    Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad))
}

impl PredictedPose {
    pub(super) fn position_in_odom(&self) -> Point2<f64> {
        self.position_in_odom
    }

    /// A point of `odom` in the base frame, metres.
    pub(super) fn to_base(self, point_in_odom: Point2<f64>) -> [f64; 2] {
        let to = point_in_odom - self.position_in_odom;
        [
            self.ahead.x * to.x + self.ahead.y * to.y,
            self.ahead.x * to.y - self.ahead.y * to.x,
        ]
    }

    /// A point of the base frame in `odom`, metres.
    pub(super) fn to_odom(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (at, ahead) = (self.position_in_odom, self.ahead);
        [
            at.x + ahead.x * x - ahead.y * y,
            at.y + ahead.y * x + ahead.x * y,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::pose::planar;

    fn odometry(linear_mps: f64, angular_radps: f64) -> OdometrySample {
        OdometrySample {
            odom_from_base: planar(1.0, 2.0, 0.5),
            measured: Velocity {
                linear_mps,
                angular_radps,
            },
            measured_at: Monotonic::from_nanos(1_000_000_000),
        }
    }

    const DELAY: Duration = Duration::from_millis(100);

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    fn commanded(commands: &[(u64, f64, f64)]) -> CommandHistory {
        let mut commanded = CommandHistory::new(Duration::from_millis(400));
        for &(millis, linear_mps, angular_radps) in commands {
            let velocity = Velocity {
                linear_mps,
                angular_radps,
            };
            commanded.record(at(millis), velocity);
        }
        commanded
    }

    #[test]
    fn it_is_where_its_arc_leads() {
        for (commanded, coasts) in [
            (commanded(&[]), false),
            (commanded(&[(0, 2.0, -3.0)]), false),
            (commanded(&[(0, 0.0, 0.0)]), true),
        ] {
            let placed = odometry(2.0, -3.0)
                .predicted_pose(&commanded, (DELAY, coasts), at(1200))
                .unwrap();
            let mut stepped = planar(1.0, 2.0, 0.5);
            for _ in 0..30_000 {
                stepped *= planar(2.0e-5, 0.0, -3.0e-5);
            }
            let position = stepped.translation.vector.xy();
            assert!((placed.position_in_odom.coords - position).norm() < 1e-4);
            let ahead = stepped * nalgebra::Point3::new(1.0, 0.25, 0.0);
            let [x, y] = placed.to_base(ahead.xy());
            assert!((x - 1.0).abs() < 1e-4 && (y - 0.25).abs() < 1e-4, "{x} {y}");
        }
    }

    #[test]
    fn it_obeys_late() {
        // Measured at 1000 ms, where it obeyed what it was told at 900 ms; slower by a tenth than it should be.
        let commanded = commanded(&[(800, 1.0, 0.0), (950, 0.5, 0.0), (1020, 0.0, 0.0)]);
        let placed = odometry(0.9, 0.0)
            .predicted_pose(&commanded, (DELAY, false), at(1040))
            .unwrap();
        let gone = placed.position_in_odom - Point2::new(1.0, 2.0);
        let gone_m = 0.9 * 0.05 + 0.4 * 0.07 - 0.1 * 0.02;
        assert!((gone.norm() - gone_m).abs() < 1e-12, "{gone}");
    }

    #[test]
    fn a_point_in_the_base_frame_is_where_it_was_in_odom() {
        let odometry = OdometrySample {
            odom_from_base: planar(1.0, 2.0, std::f64::consts::FRAC_PI_2),
            ..odometry(0.0, 0.0)
        };
        let placed = odometry
            .predicted_pose(&commanded(&[]), (DELAY, false), at(1000))
            .unwrap();
        // It looks along y: 3 m ahead and half a metre to the left.
        let [x, y] = placed.to_odom([3.0, 0.5]);
        assert!(
            (x - 0.5).abs() < 1e-12 && (y - 5.0).abs() < 1e-12,
            "{x} {y}"
        );
        let [x, y] = placed.to_base(Point2::new(x, y));
        assert!(
            (x - 3.0).abs() < 1e-12 && (y - 0.5).abs() < 1e-12,
            "{x} {y}"
        );
    }

    #[test]
    fn what_is_old_or_no_number_is_not_known() {
        let still = odometry(0.0, 0.0);
        let unavailable_reason = |odometry: OdometrySample, nanos| {
            let now = Monotonic::from_nanos(nanos);
            odometry
                .predicted_pose(&commanded(&[]), (DELAY, false), now)
                .err()
        };
        assert_eq!(
            (
                unavailable_reason(still, 0),
                unavailable_reason(still, 1_300_000_000)
            ),
            (None, None)
        );
        let old = UnavailableReason::PoseTooOld(Some(Duration::from_nanos(300_000_001)));
        assert_eq!(unavailable_reason(still, 1_300_000_001), Some(old));
        let not_finite = odometry(f64::NAN, 0.0);
        assert_eq!(
            unavailable_reason(not_finite, 1_000_000_000),
            Some(UnavailableReason::NotFinite)
        );
        let mut lost = still;
        lost.odom_from_base.translation.vector.x = f64::INFINITY;
        assert_eq!(
            unavailable_reason(lost, 1_000_000_000),
            Some(UnavailableReason::NotFinite)
        );
    }
}
