//! Waves on deep water, and a hull on them.
//!
//! The surface is a sum of sinusoids that each travel at their own speed (linear theory): of angular
//! frequency ω, its wave number k is ω² / g. Nothing breaks, and the bed is taken to lie deeper than half a
//! wavelength: λ = g T² / 2π, 14 m for a period of 3 s.

use nalgebra::{Point2, Vector2};

use crate::attitude_sensor::GRAVITY_MPS2;
use crate::chassis::Posture;
use crate::path::PlanarPose;

/// A train of waves as seamen describe it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WaveTrain {
    /// Significant height: four standard deviations of the surface, metres.
    pub(crate) height_m: f64,
    /// Of its strongest waves, seconds; above 0.
    pub(crate) period_s: f64,
    /// Where the waves run to, radians counter-clockwise from the world's x.
    pub(crate) heading_rad: f64,
}

/// The surface of the water as it rises and falls about its level. Without waves it is flat.
#[derive(Clone, Debug, PartialEq, Default)]
pub(crate) struct Waves {
    components: Vec<Sinusoid>,
}

/// One wave: a·cos(k·x − ω·t + φ).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sinusoid {
    amplitude_m: f64,
    wave_number_radpm: Vector2<f64>,
    frequency_radps: f64,
    phase_rad: f64,
}

/// How a train divides into sinusoids: share of its energy, frequency as a multiple of its own, and heading
/// off its own in radians. A narrow spectrum of short-crested waves, symmetric about the train; not one that
/// was measured.
const SPECTRUM: [(f64, f64, f64); 5] = [
    (0.1, 0.8, 0.2),
    (0.2, 0.9, -0.1),
    (0.4, 1.0, 0.0),
    (0.2, 1.1, 0.1),
    (0.1, 1.2, -0.2),
];

/// The golden angle: phases at its multiples never agree.
const PHASE_STEP_RAD: f64 = 2.399_963_229_728_653;

/// Waves steeper than this share of their length break.
const STEEPEST: f64 = 1.0 / 7.0;

impl WaveTrain {
    pub(crate) fn length_m(&self) -> f64 {
        GRAVITY_MPS2 * self.period_s * self.period_s / std::f64::consts::TAU
    }

    /// The largest height at which waves of this period do not break, metres.
    pub(crate) fn greatest_height_m(&self) -> f64 {
        STEEPEST * self.length_m()
    }
}

impl Waves {
    pub(crate) fn new(trains: &[WaveTrain]) -> Self {
        let of_train = |train: &WaveTrain| {
            let train = *train;
            SPECTRUM.map(|(energy, frequency, heading_rad)| {
                let frequency_radps = frequency * std::f64::consts::TAU / train.period_s;
                let heading_rad = train.heading_rad + heading_rad;
                let wave_number_radpm = frequency_radps * frequency_radps / GRAVITY_MPS2;
                Sinusoid {
                    // Variance (H/4)² of the whole, a²/2 of a sinusoid.
                    amplitude_m: 0.25 * train.height_m * libm::sqrt(2.0 * energy),
                    wave_number_radpm: Vector2::new(libm::cos(heading_rad), libm::sin(heading_rad))
                        * wave_number_radpm,
                    frequency_radps,
                    phase_rad: 0.0,
                }
            })
        };
        let mut components: Vec<Sinusoid> = trains.iter().flat_map(of_train).collect();
        for (number, component) in components.iter_mut().enumerate() {
            component.phase_rad = number as f64 * PHASE_STEP_RAD;
        }
        Self { components }
    }

    /// Height of the surface above the water's level, metres.
    pub(crate) fn height_m(&self, at_m: Point2<f64>, time_s: f64) -> f64 {
        self.components
            .iter()
            .map(|wave| {
                let phase_rad = wave.wave_number_radpm.dot(&at_m.coords)
                    - wave.frequency_radps * time_s
                    + wave.phase_rad;
                wave.amplitude_m * libm::cos(phase_rad)
            })
            .sum()
    }
}

/// A hull about `base_link`, which lies amidships at the waterline of the boat at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hull {
    pub length_m: f64,
    /// From starboard to port, metres; of a catamaran over both hulls.
    pub width_m: f64,
}

impl Hull {
    /// How the boat lies at `at`, on waves about `water_level_m`.
    ///
    /// It follows the surface under its bow, stern and sides: it heaves with their mean, and pitches and rolls
    /// with the slopes between them, so that waves shorter than the hull hardly move it. It has no inertia of
    /// its own, hence no resonance; and it is neither set nor slowed by waves.
    pub(crate) fn afloat(
        &self,
        at: PlanarPose,
        waves: &Waves,
        water_level_m: f64,
        time_s: f64,
    ) -> Posture {
        let ahead = Vector2::new(libm::cos(at.yaw_rad), libm::sin(at.yaw_rad));
        let to_bow_m = ahead * (0.5 * self.length_m);
        let to_port_m = Vector2::new(-ahead.y, ahead.x) * (0.5 * self.width_m);
        let [bow_m, stern_m, port_m, starboard_m] = [to_bow_m, -to_bow_m, to_port_m, -to_port_m]
            .map(|to_m| waves.height_m(Point2::from(at.position_m.coords + to_m), time_s));
        Posture {
            z_m: water_level_m + 0.25 * (bow_m + stern_m + port_m + starboard_m),
            pitch_rad: libm::atan2(stern_m - bow_m, self.length_m),
            roll_rad: libm::atan2(port_m - starboard_m, self.width_m),
        }
    }
}

#[cfg(test)]
mod tests;
