//! A planar laser or sonar: where its beams point and when, and how its readings err.

mod beam_footprint;

use nalgebra::{Point3, Vector3};

use crate::laser::beam_footprint::BeamFootprint;
use crate::noise::NoiseStream;
use crate::scene::Scene;
use measurement::pose::Pose;
use measurement::scan::Scan;

/// A planar laser as its data sheet and its driver describe it, or a sonar, whose beams of sound are cast like
/// light.
///
/// Beams are cast along exactly the f32 angles and at exactly the f32 times that the scan carries, so
/// that a message describes its sweep without rounding.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanarLaser {
    /// Beams in a sweep.
    pub beams: u32,
    /// Angle of beam 0, radians.
    pub angle_min_rad: f32,
    /// Angle from a beam to the next, radians.
    pub angle_increment_rad: f32,
    /// Time from a beam to the next, seconds; 0 where all leave at once.
    pub time_increment_s: f32,
    /// Sweeps a second.
    pub rate_hz: f64,
    /// Smallest range that it measures, metres.
    pub range_min_m: f32,
    /// Largest range that it measures, metres.
    pub range_max_m: f32,
    /// Full angle of a beam's cone, radians; 0 is a line. It matters where [`LaserErrors::mixed_pixels`]
    /// are on.
    pub beam_divergence_rad: f64,
}

/// How readings err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserErrors {
    /// Standard deviation of a range, metres.
    pub range_noise_m: f64,
    /// Probability that a beam gives no reading at all.
    pub dropout: f64,
    /// Probability that a beam whose footprint straddles an edge gives a range of both sides mixed
    /// instead of the one along its axis; 0 turns mixed pixels off.
    pub mixed_pixels: f64,
}

/// The random numbers of one laser.
#[derive(Clone, Debug)]
pub struct LaserNoise {
    range: NoiseStream,
    dropout: NoiseStream,
    mirror: NoiseStream,
    mixed: NoiseStream,
}

impl LaserNoise {
    /// The streams of the sensor called `sensor`.
    pub fn new(seed: u64, sensor: &str) -> Self {
        let stream = |purpose: &str| NoiseStream::new(seed, &format!("{sensor}/{purpose}"));
        Self {
            range: stream("range"),
            dropout: stream("dropout"),
            mirror: stream("mirror"),
            mixed: stream("mixed"),
        }
    }
}

impl PlanarLaser {
    /// Hokuyo URG-04LX-UG01. Data sheet: 1024 steps a turn, of which 683 over 240°, one turn in 100 ms,
    /// 20 … 5600 mm.
    pub fn urg_04lx_ug01() -> Self {
        let step_rad = std::f64::consts::TAU / 1024.0;
        Self {
            beams: 683,
            angle_min_rad: (-341.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.1_f64 / 1024.0) as f32,
            rate_hz: 10.0,
            range_min_m: 0.02,
            range_max_m: 5.6,
            // Data sheet: a spot of 40 mm at 4 m.
            beam_divergence_rad: 0.01,
        }
    }

    /// SICK LMS111 as the elevation document sets it up [LOD §5]: 120° of its 270°, which the document
    /// counts from 30° to 150° with 90° straight ahead, in steps of 0.25° at 25 Hz. Data sheet: 0.5 … 20 m
    /// and 15 mrad; its mirror turns once a scan, so 1440 steps take 40 ms.
    pub fn lms111() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 481,
            angle_min_rad: (-240.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.04_f64 / 1440.0) as f32,
            rate_hz: 25.0,
            range_min_m: 0.5,
            range_max_m: 20.0,
            beam_divergence_rad: 0.015,
        }
    }

    /// SICK LMS111 over its whole field of view of 270°, as on the land robot of the hybrid perception document
    /// [HYB §2.1], whose 1040 readings are a misprint: steps of 0.25° make 1081 beams.
    pub fn lms111_270_deg() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 1081,
            angle_min_rad: (-540.0 * step_rad) as f32,
            ..Self::lms111()
        }
    }

    /// SICK LD-LRS2100 as the boat of that document sets it up [HYB §2.2]: 1440 beams over 360°, beginning
    /// astern, every 200 ms, to 250 m. Least range (0.5 m, as the preset has it) and divergence (3.5 mrad) are
    /// not the document's.
    pub fn ld_lrs2100() -> Self {
        let step_rad = 0.25_f64.to_radians();
        Self {
            beams: 1440,
            angle_min_rad: (-720.0 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: (0.2_f64 / 1440.0) as f32,
            rate_hz: 5.0,
            range_min_m: 0.5,
            range_max_m: 250.0,
            beam_divergence_rad: 0.0035,
        }
    }

    /// Imagenex 837B Delta T as the boat of that document sets it up [HYB §2.2]: 240 ranges "equally spaced on
    /// a 120° interval", here the middles of its 240 parts, all of one ping, ten times a second, to 300 m. The
    /// least range (0.5 m) and a beam 3° wide are assumed. The time that sound takes, 0.4 s from 300 m and
    /// back, is not simulated: a reading is of the moment of its stamp, as its driver's would be after
    /// correction.
    pub fn delta_t_837b() -> Self {
        let step_rad = 0.5_f64.to_radians();
        Self {
            beams: 240,
            angle_min_rad: (-119.5 * step_rad) as f32,
            angle_increment_rad: step_rad as f32,
            time_increment_s: 0.0,
            rate_hz: 10.0,
            range_min_m: 0.5,
            range_max_m: 300.0,
            beam_divergence_rad: 3.0_f64.to_radians(),
        }
    }

    /// Time from beam 0 to the last beam, seconds.
    pub fn sweep_duration_s(&self) -> f64 {
        f64::from(self.beams.saturating_sub(1)) * f64::from(self.time_increment_s)
    }

    /// One sweep whose beam 0 leaves at `start_s`, seconds since the beginning. `world_from_laser` gives
    /// its own pose, mount and all, at a time in seconds after beam 0.
    ///
    /// Readings follow REP-117: nothing within range is +∞, too near is −∞, and a dropout is
    /// not-a-number, as `urg_node` gives for the URG's error codes. Every beam draws the same number of
    /// random numbers whatever it meets, so that the noise of a beam does not depend on the world.
    pub fn sweep(
        &self,
        scene: &Scene,
        errors: LaserErrors,
        noise: &mut LaserNoise,
        start_s: f64,
        world_from_laser: impl Fn(f64) -> Pose,
    ) -> Scan {
        let ranges_m = (0..self.beams)
            .map(|beam| {
                let after_s = f64::from(beam) * f64::from(self.time_increment_s);
                let world_from_laser = world_from_laser(after_s);
                let range_error_m = errors.range_noise_m * noise.range.normal();
                let surface_chance = noise.mirror.uniform();
                let mixed_chance = noise.mixed.uniform();
                if noise.dropout.uniform() < errors.dropout {
                    return f32::NAN;
                }
                let footprint = BeamFootprint {
                    scene,
                    origin: Point3::from(world_from_laser.translation.vector),
                    axis: world_from_laser.rotation * self.direction(beam),
                    divergence_rad: self.beam_divergence_rad,
                    max_m: f64::from(self.range_max_m),
                    time_s: start_s + after_s,
                    surface_chance,
                };
                footprint
                    .path_m(errors.mixed_pixels, mixed_chance)
                    .map_or(f32::INFINITY, |path_m| self.reading(path_m + range_error_m))
            })
            .collect();
        Scan {
            angle_min_rad: self.angle_min_rad,
            angle_increment_rad: self.angle_increment_rad,
            time_increment_s: self.time_increment_s,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            ranges_m,
        }
    }

    /// Unit vector of a beam in the laser's frame.
    pub(super) fn direction(&self, beam: u32) -> Vector3<f64> {
        let angle_rad =
            f64::from(self.angle_min_rad) + f64::from(beam) * f64::from(self.angle_increment_rad);
        Vector3::new(libm::cos(angle_rad), libm::sin(angle_rad), 0.0)
    }

    pub(super) fn reading(&self, range_m: f64) -> f32 {
        let range_m = range_m as f32;
        if range_m < self.range_min_m {
            f32::NEG_INFINITY
        } else if range_m < self.range_max_m {
            range_m
        } else {
            f32::INFINITY
        }
    }
}

#[cfg(test)]
mod tests;
