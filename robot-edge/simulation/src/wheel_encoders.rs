//! Encoders that count how far the wheels of each side turn.

use crate::chassis::Chassis;
use crate::motion::{Motion, POSTURE_STEP_S};
use crate::noise::NoiseStream;
use measurement::pose::Pose;

use nalgebra::Point3;

/// Two incremental encoders, one a side, on the axles of the wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelEncoders {
    /// Pulses of each channel in a turn of the wheel.
    pub pulses_per_turn: u32,
    pub rate_hz: f64,
}

/// Edges of the two channels in a pulse: quadrature counts them all.
const COUNTS_PER_PULSE: u32 = 4;

#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub(crate) struct WheelErrors {
    /// Share by which all wheels turn too far: 0.048 where 4.2 m are read as 4.4 m [LOD §5.4]. Above −1.
    pub(crate) scale_error: f64,
    /// Random slip of each side: standard deviation after 1 m as a share of that metre. It grows with the
    /// square root of the way.
    pub(crate) slip: f64,
}

/// Turns the wheels along a motion and reads their encoders.
pub(crate) struct WheelTurns {
    chassis: Chassis,
    encoders: WheelEncoders,
    errors: WheelErrors,
    time_s: f64,
    sides: [Side; 2],
}

struct Side {
    /// The ground point midway between them, in the base frame.
    middle_in_base: Point3<f64>,
    middle_in_world: Point3<f64>,
    /// Way along the ground as the wheels turned for it, metres, forwards positive.
    turned_m: f64,
    slip: NoiseStream,
}

impl WheelTurns {
    /// The wheels at the beginning of `motion`, where the encoders read 0.
    pub(crate) fn new(
        chassis: Chassis,
        encoders: WheelEncoders,
        errors: WheelErrors,
        motion: &Motion,
        seed: u64,
    ) -> Self {
        let world_from_base = motion.world_from_base(0.0);
        let side = |name, side: f64| {
            let middle_in_base = Point3::new(0.0, side * 0.5 * chassis.track_m, 0.0);
            Side {
                middle_in_base,
                middle_in_world: world_from_base * middle_in_base,
                turned_m: 0.0,
                slip: NoiseStream::new(seed, &format!("wheels/{name}/slip")),
            }
        };
        Self {
            chassis,
            encoders,
            errors,
            time_s: 0.0,
            sides: [side("left", 1.0), side("right", -1.0)],
        }
    }

    /// What the encoders of the left and the right wheels read at `time_s`, radians; not before the time of
    /// the last reading.
    ///
    /// A side turns by the way of its ground point midway between the axles, in space: along a slope it is
    /// the slope's length. That is v ∓ ω·track/2 of a differential drive.
    pub(crate) fn read(&mut self, motion: &Motion, time_s: f64) -> [f64; 2] {
        let (from_s, duration_s) = (self.time_s, time_s - self.time_s);
        let steps = libm::ceil(duration_s / POSTURE_STEP_S - 1e-6).max(0.0) as u32;
        for step in 1..=steps {
            let share = f64::from(step) / f64::from(steps);
            let world_from_base = motion.world_from_base(from_s + share * duration_s);
            for side in &mut self.sides {
                side.turn(&world_from_base, self.errors);
            }
        }
        self.time_s = time_s.max(from_s);
        let counts_per_turn = f64::from(COUNTS_PER_PULSE * self.encoders.pulses_per_turn);
        let rad_per_count = std::f64::consts::TAU / counts_per_turn;
        self.sides.each_ref().map(|side| {
            let turned_rad = side.turned_m / self.chassis.wheel_radius_m;
            libm::round(turned_rad / rad_per_count) * rad_per_count
        })
    }
}

impl Side {
    fn turn(&mut self, world_from_base: &Pose, errors: WheelErrors) {
        let middle_in_world = world_from_base * self.middle_in_base;
        let moved_m = middle_in_world - self.middle_in_world;
        let forward = world_from_base.rotation * nalgebra::Vector3::x();
        let way_m = libm::copysign(moved_m.norm(), forward.dot(&moved_m));
        self.middle_in_world = middle_in_world;
        let slip_m = errors.slip * libm::sqrt(way_m.abs()) * self.slip.normal();
        self.turned_m += way_m * (1.0 + errors.scale_error) + slip_m;
    }
}

#[cfg(test)]
mod tests;
