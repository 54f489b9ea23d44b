//! The planar pose of the vehicle at the time when it obeys the present command.

use std::time::Duration;

use nalgebra::{Point2, Vector2};

use crate::collision_monitor::UnavailableReason;
use crate::motion::Velocity;
use measurement::pose::{self, Pose};
use measurement::time::Monotonic;

/// The newest pose and velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometrySample {
    /// The newest pose.
    pub odom_from_base: Pose,
    /// The measured velocity at that time.
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

pub(super) const MAX_POSE_AGE: Duration = Duration::from_millis(300);

impl OdometrySample {
    /// The pose `delay` from now, when the vehicle obeys the present command. Commands until now are executed in any
    /// case. At constant speed the distance is `v · age` with the measured `v`.
    ///
    /// The speed is the measured one plus the changes of the `commanded` one, a delay before. A vehicle that `coasts`
    /// does not slow down on command.
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
        // The motion at the measurement follows the command at `obeyed`; the motion until `delay` from now, the ones
        // since.
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
            let ahead = direction(yaw_rad + half);
            let left = Vector2::new(-ahead.y, ahead.x);
            position_in_odom +=
                (ahead * velocity.linear_mps + left * velocity.lateral_mps) * (time_s * chord);
            yaw_rad += turned_rad;
        };
        if coasts || commanded.at(now).is_none() {
            advance(self.measured, (age + delay).as_secs_f64());
        } else {
            for (velocity, time_s) in commanded.between(obeyed, now).filter(|part| part.1 > 0.0) {
                let measured = self.measured;
                let since = Velocity {
                    linear_mps: measured.linear_mps + velocity.linear_mps - then.linear_mps,
                    lateral_mps: measured.lateral_mps + velocity.lateral_mps - then.lateral_mps,
                    angular_radps: measured.angular_radps + velocity.angular_radps
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

const CAPACITY: usize = 64;

/// The last commands, oldest first: those that the vehicle has yet to obey.
#[derive(Clone, Debug)]
pub(super) struct CommandHistory {
    commands: [(Monotonic, Velocity); CAPACITY],
    len: usize,
    /// Commands closer together than this are stored as one.
    spacing: Duration,
}

impl CommandHistory {
    pub(super) fn new(span: Duration) -> Self {
        Self {
            commands: [(Monotonic::default(), Velocity::ZERO); CAPACITY],
            len: 0,
            spacing: span / (CAPACITY as u32 - 2),
        }
    }

    pub(super) fn record(&mut self, from: Monotonic, velocity: Velocity) {
        if let Some((start, newest)) = self.commands[..self.len].last_mut()
            && from.since(*start) < self.spacing
        {
            *newest = velocity;
            return;
        }
        if self.len == CAPACITY {
            self.commands.copy_within(1.., 0);
            self.len -= 1;
        }
        self.commands[self.len] = (from, velocity);
        self.len += 1;
    }

    /// The velocities between two times, in order, each with its duration, seconds. Before the first stored command its
    /// velocity is assumed.
    pub(super) fn between(
        &self,
        from: Monotonic,
        to: Monotonic,
    ) -> impl Iterator<Item = (Velocity, f64)> {
        let commands = &self.commands[..self.len];
        commands
            .iter()
            .enumerate()
            .map(move |(index, &(start, velocity))| {
                let start = if index == 0 { from } else { start.max(from) };
                let end = commands.get(index + 1).map_or(to, |next| next.0.min(to));
                (velocity, end.since(start).as_secs_f64())
            })
    }

    pub(super) fn at(&self, moment: Monotonic) -> Option<Velocity> {
        let commands = &self.commands[..self.len];
        let newest = commands.iter().rev().find(|(start, _)| *start <= moment);
        newest.or(commands.first()).map(|(_, velocity)| *velocity)
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::float_cmp, reason = "these values are exact")]

    use super::*;
    use measurement::pose::planar;

    fn odometry(linear_mps: f64, angular_radps: f64) -> OdometrySample {
        OdometrySample {
            odom_from_base: planar(1.0, 2.0, 0.5),
            measured: Velocity::new(linear_mps, angular_radps),
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
            let velocity = Velocity::new(linear_mps, angular_radps);
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
        // Measured at 1000 ms, where it obeyed the command of 900 ms; slower by a tenth than it should be.
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

    fn going(linear_mps: f64) -> Velocity {
        Velocity::new(linear_mps, 0.0)
    }

    fn gone_m(commanded: &CommandHistory, from: u64, to: u64) -> f64 {
        let parts = commanded.between(at(from), at(to));
        parts
            .map(|(velocity, time_s)| velocity.linear_mps * time_s)
            .sum()
    }

    #[test]
    fn commands_hold_until_the_next() {
        let mut commanded = CommandHistory::new(Duration::from_millis(400));
        assert_eq!(commanded.at(at(100)), None);
        assert_eq!(gone_m(&commanded, 0, 1000), 0.0);
        for (millis, speed) in [(1000, 1.0), (1020, 2.0), (1040, 0.0)] {
            commanded.record(at(millis), going(speed));
        }
        for (millis, speed) in [
            (500, 1.0),
            (1010, 1.0),
            (1020, 2.0),
            (1039, 2.0),
            (2000, 0.0),
        ] {
            assert_eq!(commanded.at(at(millis)), Some(going(speed)), "{millis}");
        }
        assert!((gone_m(&commanded, 990, 1030) - (0.03 + 0.02)).abs() < 1e-12);
        assert!((gone_m(&commanded, 1030, 1100) - 0.02).abs() < 1e-12);
        assert_eq!(gone_m(&commanded, 1050, 1040), 0.0);
    }

    #[test]
    fn it_remembers_its_span_however_fast_commands_come() {
        for millis in [1, 2, 20, 100] {
            let mut commanded = CommandHistory::new(Duration::from_millis(400));
            let count = 5000;
            for n in 0..count {
                commanded.record(at(n * millis), going(if n % 2 == 0 { 1.0 } else { 3.0 }));
            }
            let end = count * millis;
            let gone_m = gone_m(&commanded, end - 400, end);
            assert!(commanded.commands[0].0 <= at(end - 400), "{millis}");
            // The newest of those that are one may stand for all.
            assert!((0.39..=1.21).contains(&gone_m), "{millis}: {gone_m}");
        }
    }
}
