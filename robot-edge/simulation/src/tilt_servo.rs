//! A servo that tilts a planar range sensor, and its encoder.

use std::collections::VecDeque;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// A servo that turns its sensor about the sensor's own y axis, to and fro between two angles, positive nose
/// down.
///
/// It accelerates evenly, turns at an even rate, and brakes evenly: the trapezoidal profile that position
/// servos drive between two set points. The sweeps of its sensor lie evenly apart but near the ends, where a
/// sinusoid would crowd most of them; and unlike a triangle's its rate does not jump.
///
/// Once it was turned to an angle it stays there; it turns at the even rate.
#[derive(Clone, Debug, PartialEq)]
pub struct TiltServo {
    /// Its name in `/joint_states`.
    pub joint: &'static str,
    /// Highest that the sensor looks, radians.
    pub min_rad: f64,
    /// Lowest that the sensor looks, radians.
    pub max_rad: f64,
    /// From the least angle to the greatest and back, seconds.
    pub period_s: f64,
    /// Readings of the encoder a second.
    pub encoder_rate_hz: f64,
    /// Resolution of the encoder, radians; above 0.
    pub encoder_step_rad: f64,
    /// The last turns, in the order of their time.
    pub turns: VecDeque<Turn>,
}

/// The servo was turned to an angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    at_s: f64,
    /// Where it was then, radians.
    from_rad: f64,
    goal_rad: f64,
}

/// Turns that are kept, so that its encoder finds where it was a lag ago.
const TURNS: usize = 1024;

/// Share of the way between the two angles, in time, that each of acceleration and braking takes.
const RAMP_SHARE: f64 = 0.2;

impl TiltServo {
    /// Turns to this angle, or as far as it can, from a time on that is not before the last turn's.
    pub(crate) fn turn_to(&mut self, time_s: f64, goal_rad: f64) {
        let goal_rad = goal_rad.clamp(self.min_rad, self.max_rad);
        if self
            .turns
            .back()
            .is_some_and(|turn| turn.goal_rad.to_bits() == goal_rad.to_bits())
        {
            return;
        }
        let from_rad = self.angle_rad(time_s);
        self.turns.push_back(Turn {
            at_s: time_s,
            from_rad,
            goal_rad,
        });
        if self.turns.len() > TURNS {
            self.turns.pop_front();
        }
    }

    /// Where it is, radians; at time 0 it leaves the least angle. It was at work before.
    pub fn angle_rad(&self, time_s: f64) -> f64 {
        if let Some(turn) = self.turns.iter().rev().find(|turn| turn.at_s <= time_s) {
            let way_rad = self.even_rate_radps() * (time_s - turn.at_s);
            return turn.from_rad + (turn.goal_rad - turn.from_rad).clamp(-way_rad, way_rad);
        }
        let phase = (time_s / self.period_s).rem_euclid(1.0);
        // From 0 at the least angle to 1 at the greatest; on the way back time runs backwards.
        let share = 2.0 * phase.min(1.0 - phase);
        self.min_rad + (self.max_rad - self.min_rad) * share_of_way(share)
    }

    /// The turn by [`TiltServo::angle_rad`].
    pub(crate) fn mount_from_sensor(&self, time_s: f64) -> UnitQuaternion<f64> {
        let half = 0.5 * self.angle_rad(time_s);
        let about_y = Quaternion::from_parts(libm::cos(half), Vector3::y() * libm::sin(half));
        UnitQuaternion::new_normalize(about_y)
    }

    /// Its encoder's reading at `time_s`, radians: the angle `lag_s` before, to the encoder's step.
    pub(crate) fn read_rad(&self, time_s: f64, lag_s: f64) -> f64 {
        let steps = self.angle_rad(time_s - lag_s) / self.encoder_step_rad;
        libm::round(steps) * self.encoder_step_rad
    }

    /// The rate between acceleration and braking, rad/s.
    pub fn even_rate_radps(&self) -> f64 {
        2.0 * (self.max_rad - self.min_rad) / (self.period_s * (1.0 - RAMP_SHARE))
    }
}

/// Share of the angle after a share of the time from one end to the other.
fn share_of_way(time: f64) -> f64 {
    let even_rate = 1.0 / (1.0 - RAMP_SHARE);
    let ramp = |time: f64| 0.5 * even_rate / RAMP_SHARE * time * time;
    if time < RAMP_SHARE {
        ramp(time)
    } else if time <= 1.0 - RAMP_SHARE {
        even_rate * (time - 0.5 * RAMP_SHARE)
    } else {
        1.0 - ramp(1.0 - time)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// 0 … 20° in 5 s and back: 5°/s where the rate is even.
    fn servo() -> TiltServo {
        TiltServo {
            joint: "joint",
            min_rad: 0.0,
            max_rad: 20.0_f64.to_radians(),
            period_s: 10.0,
            encoder_rate_hz: 50.0,
            encoder_step_rad: 0.1_f64.to_radians(),
            turns: VecDeque::new(),
        }
    }

    #[test]
    fn it_swings_between_its_angles_with_rounded_ends() {
        let check = |time_s: f64, expected_deg: f64| {
            let angle_deg = servo().angle_rad(time_s).to_degrees();
            assert!(
                (angle_deg - expected_deg).abs() < 1e-9,
                "{time_s} {angle_deg}"
            );
        };
        check(0.0, 0.0);
        // 5°/s² for 1 s, 5°/s for 3 s.
        check(0.5, 0.625);
        check(1.0, 2.5);
        check(2.5, 10.0);
        check(3.5, 15.0);
        check(4.0, 17.5);
        check(5.0, 20.0);
        check(5.5, 19.375);
        check(7.5, 10.0);
        check(10.0, 0.0);
        check(23.5, 15.0);
        check(-0.5, 0.625);
        assert!((servo().even_rate_radps().to_degrees() - 5.0).abs() < 1e-12);
    }

    #[test]
    fn positive_angles_are_nose_down() {
        let ahead = servo().mount_from_sensor(5.0) * Vector3::x();
        assert!((ahead.z + libm::sin(servo().max_rad)).abs() < 1e-15);
        let left = servo().mount_from_sensor(5.0) * Vector3::y();
        assert!((left - Vector3::y()).norm() < 1e-15);
    }

    #[test]
    fn it_turns_to_an_angle_at_its_even_rate_and_stays() {
        let mut servo = servo();
        servo.turn_to(2.5, 14.0_f64.to_radians());
        servo.turn_to(3.1, 30.0_f64.to_radians());
        servo.turn_to(6.0, 15.0_f64.to_radians());
        for (time_s, expected_deg) in [
            (1.0, 2.5),
            (2.5, 10.0),
            (2.9, 12.0),
            (3.1, 13.0),
            (4.1, 18.0),
            (5.0, 20.0),
            (6.4, 18.0),
            (7.0, 15.0),
            (60.0, 15.0),
        ] {
            let angle_deg = servo.angle_rad(time_s).to_degrees();
            assert!(
                (angle_deg - expected_deg).abs() < 1e-9,
                "{time_s} {angle_deg}"
            );
        }
    }

    #[test]
    fn the_encoder_says_where_it_was_in_steps() {
        let read_deg = |time_s, lag_s| servo().read_rad(time_s, lag_s).to_degrees();
        assert!((read_deg(2.513, 0.0) - 10.1).abs() < 1e-9);
        // 5°/s × 0.2 s.
        assert!((read_deg(2.5, 0.2) - 9.0).abs() < 1e-9);
        assert!((read_deg(7.5, 0.2) - 11.0).abs() < 1e-9);
        assert!((read_deg(0.0, 0.5) - 0.6).abs() < 1e-9);
    }

    proptest! {
        #[test]
        fn it_never_leaves_its_angles_nor_jumps(
            time_s in -100.0..1e5_f64, min_rad in -1.0..0.5_f64, span_rad in 0.01..1.0_f64
        ) {
            let servo = TiltServo { min_rad, max_rad: min_rad + span_rad, ..servo() };
            let angle_rad = servo.angle_rad(time_s);
            prop_assert!((min_rad..=min_rad + span_rad + 1e-12).contains(&angle_rad));
            let step_rad = (servo.angle_rad(time_s + 0.001) - angle_rad).abs();
            prop_assert!(step_rad <= 0.001 * servo.even_rate_radps() + 1e-9);
        }
    }
}
