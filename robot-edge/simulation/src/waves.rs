//! Waves on deep water.
//!
//! The surface is a sum of sinusoids that each travel at their own speed (linear theory): of angular
//! frequency ω, its wave number k is ω² / g. Nothing breaks, and the bed is taken to lie deeper than half a
//! wavelength: λ = g T² / 2π, 14 m for a period of 3 s.

use nalgebra::{Point2, Vector2};

use crate::attitude_sensor::GRAVITY_MPS2;

/// A train of waves as seamen describe it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveTrain {
    /// Significant height: four standard deviations of the surface, metres.
    pub height_m: f64,
    /// Of its strongest waves, seconds; above 0.
    pub period_s: f64,
    /// Where the waves run to, radians counter-clockwise from the world's x.
    pub heading_rad: f64,
}

/// The surface of the water as it rises and falls about its level. Without waves it is flat.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Waves {
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
    /// Length of its strongest waves, metres.
    pub fn length_m(&self) -> f64 {
        GRAVITY_MPS2 * self.period_s * self.period_s / std::f64::consts::TAU
    }

    /// The largest height at which waves of this period do not break, metres.
    pub fn greatest_height_m(&self) -> f64 {
        STEEPEST * self.length_m()
    }
}

impl Waves {
    /// The sum of `trains`.
    pub fn new(trains: &[WaveTrain]) -> Self {
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
    pub fn height_m(&self, at_m: Point2<f64>, time_s: f64) -> f64 {
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

#[cfg(test)]
mod tests;
