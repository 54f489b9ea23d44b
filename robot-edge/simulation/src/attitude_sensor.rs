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
    /// Readings a second.
    pub rate_hz: f64,
    /// Standard deviation of roll, pitch and yaw, each on its own, unless the world says otherwise, radians.
    pub noise_rad: f64,
    /// Full scale of the gyroscopes, rad/s: they read no more.
    pub max_turn_rate_radps: f64,
    /// Full scale of the accelerometers, m/s².
    pub max_acceleration_mps2: f64,
}

/// The random numbers of one AHRS.
#[derive(Clone, Debug)]
pub struct AttitudeNoise {
    roll: NoiseStream,
    pitch: NoiseStream,
    yaw: NoiseStream,
}

/// Standard gravity, m/s².
pub const GRAVITY_MPS2: f64 = 9.80665;

impl AttitudeNoise {
    /// The streams of the sensor called `sensor`.
    pub fn new(seed: u64, sensor: &str) -> Self {
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
    pub fn xsens_mti() -> Self {
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
    pub fn phidget_spatial() -> Self {
        Self {
            max_turn_rate_radps: 400.0_f64.to_radians(),
            ..Self::xsens_mti()
        }
    }

    /// Time from a reading to the next, seconds.
    pub fn period_s(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// What it reads at `time_s`: the true attitude in the world with noise on roll, pitch and yaw, and turn
    /// rate and specific force without.
    ///
    /// Both are means over one period to either side, which is what an accelerometer makes of a path whose
    /// speed changes at once.
    pub fn sample(
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
mod tests;
