//! A servo that tilts a planar range sensor, and its encoder.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// A servo that turns its sensor about the sensor's own y axis, to and fro between two angles, positive nose
/// down.
///
/// It accelerates evenly, turns at an even rate, and brakes evenly: the trapezoidal profile that position
/// servos drive between two set points. The sweeps of its sensor lie evenly apart but near the ends, where a
/// sinusoid would crowd most of them; and unlike a triangle's its rate does not jump.
#[derive(Clone, Copy, Debug, PartialEq)]
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
}

/// Share of the way between the two angles, in time, that each of acceleration and braking takes.
const RAMP_SHARE: f64 = 0.2;

impl TiltServo {
    /// Where it is, radians; at time 0 it leaves the least angle. It was at work before.
    pub fn angle_rad(&self, time_s: f64) -> f64 {
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
