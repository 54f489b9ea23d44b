//! Random numbers, one independent stream per purpose.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A stream of random numbers that depends on the seed and its own name only.
///
/// Sensors and purposes each have their own, so that adding a sensor, or switching dropouts off, leaves
/// all other noise as it was.
#[derive(Clone, Debug)]
pub struct NoiseStream {
    bits: ChaCha8Rng,
    second_normal: Option<f64>,
}

impl NoiseStream {
    /// The stream called `purpose` (`laser/range`) of a run with `seed`.
    pub fn new(seed: u64, purpose: &str) -> Self {
        let mut hasher = blake3::Hasher::new_derive_key("foreshore simulation noise stream v1");
        hasher.update(&seed.to_le_bytes());
        hasher.update(purpose.as_bytes());
        Self {
            bits: ChaCha8Rng::from_seed(*hasher.finalize().as_bytes()),
            second_normal: None,
        }
    }

    /// A number in [0, 1), uniform over the multiples of 2⁻⁵³.
    pub fn uniform(&mut self) -> f64 {
        (self.bits.next_u64() >> 11) as f64 * UNIT_STEP
    }

    /// A number of the standard normal distribution (Box and Muller 1958).
    ///
    /// Not `rand_distr`: its ziggurat calls std's `exp` and `ln`, which differ between platforms.
    pub fn normal(&mut self) -> f64 {
        if let Some(value) = self.second_normal.take() {
            return value;
        }
        // In (0, 1], so that the logarithm is finite.
        let radius = libm::sqrt(-2.0 * libm::log(self.uniform() + UNIT_STEP));
        let angle = std::f64::consts::TAU * self.uniform();
        self.second_normal = Some(radius * libm::sin(angle));
        radius * libm::cos(angle)
    }
}

const UNIT_STEP: f64 = 1.0 / (1_u64 << 53) as f64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_normal_moments_and_tails() {
        let mut stream = NoiseStream::new(7, "test");
        let n = 200_000;
        let values: Vec<f64> = (0..n).map(|_| stream.normal()).collect();
        let moment = |k: i32| values.iter().map(|v| v.powi(k)).sum::<f64>() / f64::from(n);
        // Standard errors are 0.0022, 0.0032, 0.0087 and 0.022: the bounds are about 4 of them.
        assert!(moment(1).abs() < 0.009, "{}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.013, "{}", moment(2));
        assert!(moment(3).abs() < 0.035, "{}", moment(3));
        assert!((moment(4) - 3.0).abs() < 0.09, "{}", moment(4));
        let beyond_2 = values.iter().filter(|v| v.abs() > 2.0).count() as f64 / f64::from(n);
        assert!((beyond_2 - 0.0455).abs() < 0.002, "{beyond_2}");
    }

    #[test]
    fn a_stream_is_fixed_by_seed_and_name() {
        // Written down once: what changes them changes every simulated run.
        let mut stream = NoiseStream::new(1, "laser/range");
        let first: Vec<String> = (0..3).map(|_| format!("{:.15}", stream.normal())).collect();
        assert_eq!(first, FIRST_OF_LASER_RANGE);
        assert_ne!(
            NoiseStream::new(1, "laser/dropout").uniform().to_bits(),
            NoiseStream::new(1, "laser/range").uniform().to_bits()
        );
        assert_ne!(
            NoiseStream::new(2, "laser/range").uniform().to_bits(),
            NoiseStream::new(1, "laser/range").uniform().to_bits()
        );
    }

    const FIRST_OF_LASER_RANGE: [&str; 3] = [
        "-1.181319088009710",
        "0.975863939121820",
        "-1.747529697277008",
    ];
}
