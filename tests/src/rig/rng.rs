//! Chance that is the same for the same seed, on every machine.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The distance of two neighbouring draws.
const UNIT_STEP: f64 = 1.0 / (1_u64 << 53) as f64;

/// Draws of one direction of a link.
#[derive(Debug)]
pub(super) struct SeededRng(ChaCha8Rng);

impl SeededRng {
    /// Each `stream` of a `seed` is independent of the others.
    pub(super) fn new(seed: u64, stream: usize) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream as u64);
        Self(random)
    }

    /// Evenly from 0 to just below 1.
    pub(super) fn draw(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * UNIT_STEP
    }
}
