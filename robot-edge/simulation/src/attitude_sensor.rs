//! An attitude and heading reference system (AHRS): gyroscopes, accelerometers, and the attitude that they
//! and a compass give.

use nalgebra::Vector3;

use crate::attitude::Attitude;
use crate::motion::Motion;
use crate::noise::NoiseStream;
use measurement::ImuSample;

/// An AHRS at `base_link`, its axes those of the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSensor {
    pub rate_hz: f64,
    /// Standard deviation of roll, pitch and yaw, each on its own, unless the world overrides it, radians.
    pub noise_rad: f64,
    /// Full scale of the gyroscopes, rad/s: they read no more.
    pub max_turn_rate_radps: f64,
    pub max_acceleration_mps2: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct AttitudeNoise {
    roll: NoiseStream,
    pitch: NoiseStream,
    yaw: NoiseStream,
}

/// Standard gravity, m/s².
pub(crate) const GRAVITY_MPS2: f64 = 9.80665;

impl AttitudeNoise {
    pub(crate) fn new(seed: u64, sensor: &str) -> Self {
        let stream = |axis: &str| NoiseStream::new(seed, &format!("{sensor}/{axis}"));
        Self {
            roll: stream("roll"),
            pitch: stream("pitch"),
            yaw: stream("yaw"),
        }
    }
}

impl AttitudeSensor {
    /// Xsens `MTi`: 300°/s and 5 g [LOD §5]. 100 Hz and a noise of 0.1° are those of our experiments.
    pub(crate) fn xsens_mti() -> Self {
        Self {
            rate_hz: 100.0,
            noise_rad: 0.1_f64.to_radians(),
            max_turn_rate_radps: 300.0_f64.to_radians(),
            max_acceleration_mps2: 5.0 * GRAVITY_MPS2,
        }
    }

    /// `PhidgetSpatial` 3/3/3 on the boat of the hybrid perception document [HYB §2.2], which gives no numbers.
    /// Full scales of 400°/s and 5 g are those of model 1056; 100 Hz and a noise of 0.1°, of yaw as well, are
    /// those of our experiments.
    pub(crate) fn phidget_spatial() -> Self {
        Self {
            max_turn_rate_radps: 400.0_f64.to_radians(),
            ..Self::xsens_mti()
        }
    }

    pub(crate) fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// What it reads at `time_s`: the true attitude in the world with noise on roll, pitch and yaw, and turn
    /// rate and specific force without.
    ///
    /// Both are means over one period to either side, which is what an accelerometer makes of a path whose
    /// speed changes at once.
    pub(crate) fn sample(
        &self,
        motion: &Motion,
        time_s: f64,
        noise_rad: f64,
        noise: &mut AttitudeNoise,
    ) -> ImuSample {
        let period_s = self.period_s();
        let [before, now, after] =
            [-period_s, 0.0, period_s].map(|offset_s| motion.world_from_base(time_s + offset_s));
        let turned = before.rotation.inverse() * after.rotation;
        let turn_rate_radps = turned.scaled_axis() / (2.0 * period_s);
        let accelerated_mps2 = (after.translation.vector - 2.0 * now.translation.vector
            + before.translation.vector)
            / (period_s * period_s);
        let specific_force_mps2 =
            now.rotation.inverse() * (accelerated_mps2 + GRAVITY_MPS2 * Vector3::z());

        let truth = Attitude::of(&now.rotation);
        let read = Attitude {
            roll_rad: truth.roll_rad + noise_rad * noise.roll.normal(),
            pitch_rad: truth.pitch_rad + noise_rad * noise.pitch.normal(),
            yaw_rad: truth.yaw_rad + noise_rad * noise.yaw.normal(),
        };
        let orientation = read.rotation();
        let within = |values: Vector3<f64>, most: f64| values.map(|value| value.clamp(-most, most));
        ImuSample {
            orientation_xyzw: Some(orientation.coords.into()),
            angular_velocity_radps: within(turn_rate_radps, self.max_turn_rate_radps).into(),
            linear_acceleration_mps2: within(specific_force_mps2, self.max_acceleration_mps2)
                .into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Quaternion, UnitQuaternion};

    use super::*;
    use crate::fixtures::{check, motion, path, slope};

    /// Holos drives 4 m at 0.5 m/s, and 2 m to the left along an arc of 1 m, on ground that falls to the front.
    fn drive(pitch_deg: f64) -> Motion {
        let waypoints = [[4.0, 0.0, 1.0], [4.0, 2.0, 0.0]];
        motion("holos", path(&waypoints), &[slope(pitch_deg)])
    }

    fn attitude(sample: &ImuSample) -> Attitude {
        let [x, y, z, w] = sample.orientation_xyzw.unwrap();
        Attitude::of(&UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)))
    }

    fn sample(motion: &Motion, time_s: f64) -> ImuSample {
        let noise = &mut AttitudeNoise::new(1, "ahrs");
        AttitudeSensor::xsens_mti().sample(motion, time_s, 0.0, noise)
    }

    #[test]
    fn on_level_ground_it_feels_gravity_and_its_turns() {
        let motion = drive(0.0);
        let straight = sample(&motion, 2.0);
        check(straight.angular_velocity_radps, [0.0; 3], 1e-4);
        check(
            straight.linear_acceleration_mps2,
            [0.0, 0.0, GRAVITY_MPS2],
            1e-4,
        );
        // On the arc from 6 s on: 0.5 rad/s, and v²/r to the left.
        let turning = sample(&motion, 7.0);
        check(turning.angular_velocity_radps, [0.0, 0.0, 0.5], 1e-4);
        check(
            turning.linear_acceleration_mps2,
            [0.0, 0.25, GRAVITY_MPS2],
            1e-4,
        );
        assert!((attitude(&turning).yaw_rad - 0.5).abs() < 1e-9);
    }

    #[test]
    fn on_a_slope_gravity_points_to_its_foot() {
        let up_rad = 10.0_f64.to_radians();
        let motion = drive(-10.0);
        let climbing = sample(&motion, 2.0);
        assert!((attitude(&climbing).pitch_rad + up_rad).abs() < 1e-5);
        let (sine, cosine) = (libm::sin(up_rad), libm::cos(up_rad));
        check(
            climbing.linear_acceleration_mps2,
            [GRAVITY_MPS2 * sine, 0.0, GRAVITY_MPS2 * cosine],
            1e-4,
        );
    }

    #[test]
    fn a_speed_that_changes_at_once_is_its_change_within_a_period() {
        let motion = drive(0.0);
        let [start, ..] = sample(&motion, 0.0).linear_acceleration_mps2;
        // 0.5 m/s in 10 ms is more than the accelerometer reads.
        assert!((start - 5.0 * GRAVITY_MPS2).abs() < 1e-9, "{start}");
        check(
            sample(&motion, -1.0).linear_acceleration_mps2,
            [0.0, 0.0, GRAVITY_MPS2],
            1e-4,
        );
    }

    #[test]
    fn noise_has_its_size_on_each_angle_and_is_independent() {
        let motion = drive(0.0);
        let (sensor, noise_rad) = (AttitudeSensor::xsens_mti(), 0.1_f64.to_radians());
        let mut noise = AttitudeNoise::new(1, "ahrs");
        let n = 20_000;
        let errors: Vec<[f64; 3]> = (0..n)
            .map(|_| {
                let read = attitude(&sensor.sample(&motion, 2.0, noise_rad, &mut noise));
                [read.roll_rad, read.pitch_rad, read.yaw_rad].map(|rad| rad / noise_rad)
            })
            .collect();
        let mean_of =
            |f: &dyn Fn(&[f64; 3]) -> f64| errors.iter().map(f).sum::<f64>() / f64::from(n);
        for a in 0..3 {
            // Four standard errors: 4/√20000, and √2 of that for a variance.
            assert!(mean_of(&|e| e[a]).abs() < 0.029);
            assert!((mean_of(&|e| e[a] * e[a]) - 1.0).abs() < 0.04);
            for b in 0..a {
                assert!(mean_of(&|e| e[a] * e[b]).abs() < 0.029);
            }
        }
    }

    #[test]
    fn noise_leaves_rates_and_forces_alone() {
        let motion = drive(0.0);
        let sensor = AttitudeSensor::xsens_mti();
        let noisy = sensor.sample(&motion, 7.0, 0.01, &mut AttitudeNoise::new(1, "ahrs"));
        let exact = sample(&motion, 7.0);
        assert_ne!(noisy.orientation_xyzw, exact.orientation_xyzw);
        let with_exact_attitude = ImuSample {
            orientation_xyzw: exact.orientation_xyzw,
            ..noisy
        };
        assert_eq!(with_exact_attitude, exact);
    }
}
