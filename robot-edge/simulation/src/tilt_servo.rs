//! A servo that tilts a planar range sensor up and down, and the encoder that says how far.

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
    /// Smallest difference of angle that the encoder tells, radians; above 0.
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
    pub fn mount_from_sensor(&self, time_s: f64) -> UnitQuaternion<f64> {
        let half = 0.5 * self.angle_rad(time_s);
        let about_y = Quaternion::from_parts(libm::cos(half), Vector3::y() * libm::sin(half));
        UnitQuaternion::new_normalize(about_y)
    }

    /// What its encoder says at `time_s`, radians: where it was `lag_s` before, to the encoder's step.
    pub fn read_rad(&self, time_s: f64, lag_s: f64) -> f64 {
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
mod tests;
