//! Log-odds in 16 bits, where a Bayesian update is a saturating sum.

/// L = ln(p / (1 − p)) in steps of 1/4096, so that p = 0.02 … 0.98 (|L| ≤ 3.9) fits an i16.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LogOdds(i16);

/// Steps per unit of L. The coarsest step in probability is then 1/16,384 at p = 0.5.
const STEPS: f64 = 4096.0;

impl LogOdds {
    /// Marks a cell that no scan has touched. No probability encodes to it.
    pub const UNKNOWN: Self = Self(i16::MIN);

    /// From a probability, clamped to what 16 bits hold (p = 0.0003 … 0.9997).
    pub fn from_probability(p: f64) -> Self {
        let steps = libm::round(libm::log(p / (1.0 - p)) * STEPS);
        Self(steps.clamp(f64::from(-i16::MAX), f64::from(i16::MAX)) as i16)
    }

    /// Back to a probability; `None` where unknown.
    pub fn probability(self) -> Option<f64> {
        (self != Self::UNKNOWN).then(|| 1.0 / (1.0 + libm::exp(f64::from(-self.0) / STEPS)))
    }

    /// From steps of 1/4096.
    pub const fn from_steps(steps: i16) -> Self {
        Self(steps)
    }

    /// Steps of 1/4096.
    pub const fn steps(self) -> i16 {
        self.0
    }
}

/// The sum that replaces the document's update rule, with its clamps.
///
/// With prior p₀ = 0.5 the rule `p = [1 + (1−p_z)/p_z · (1−p)/p · p₀/(1−p₀)]⁻¹` is `L ← L + l_z`.
#[derive(Clone, Copy, Debug)]
pub struct LogOddsUpdate {
    free: i16,
    occupied: i16,
    min: i16,
    max: i16,
}

/// What one scan said of a cell.
pub mod mark {
    /// Nothing.
    pub const NONE: u8 = 0;
    /// A beam crossed it.
    pub const FREE: u8 = 1;
    /// A beam ended in it.
    pub const OCCUPIED: u8 = 2;
}

impl LogOddsUpdate {
    /// From the inverse sensor model and the clamps, all probabilities.
    pub fn new(p_free: f64, p_occupied: f64, p_min: f64, p_max: f64) -> Self {
        let steps = |p| LogOdds::from_probability(p).steps();
        Self {
            free: steps(p_free),
            occupied: steps(p_occupied),
            min: steps(p_min),
            max: steps(p_max),
        }
    }

    /// Updates each cell by its mark. Branch-free, so that the compiler makes vectors of it.
    #[inline]
    pub fn apply(&self, cells: &mut [i16], marks: &[u8]) {
        const UNKNOWN: i16 = i16::MIN;
        // Taken out, or the compiler chooses between two places in memory, cell by cell.
        let Self {
            free,
            occupied,
            min,
            max,
        } = *self;
        for (cell, &mark) in cells.iter_mut().zip(marks) {
            let before = if *cell == UNKNOWN { 0 } else { *cell };
            let evidence = if mark == mark::OCCUPIED {
                occupied
            } else {
                free
            };
            let after = before.saturating_add(evidence).clamp(min, max);
            *cell = if mark == mark::NONE { *cell } else { after };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rule as [LRF] §3 prints it.
    fn bayes(p_z: f64, p: f64, p0: f64) -> f64 {
        1.0 / (1.0 + (1.0 - p_z) / p_z * (1.0 - p) / p * p0 / (1.0 - p0))
    }

    #[test]
    fn the_sum_is_the_documents_rule() {
        let update = LogOddsUpdate::new(0.3, 0.6, 0.02, 0.98);
        let mut cells = [i16::MIN];
        let mut p = 0.5;
        for mark in [2, 2, 1, 2, 1, 1, 1, 2, 2, 2, 2] {
            update.apply(&mut cells, &[mark]);
            p = bayes(if mark == 2 { 0.6 } else { 0.3 }, p, 0.5);
            let got = LogOdds::from_steps(cells[0]).probability().unwrap();
            assert!((got - p).abs() < 5e-4, "{got} instead of {p}");
        }
    }

    #[test]
    fn cells_are_clamped_and_unmarked_cells_stay() {
        let update = LogOddsUpdate::new(0.3, 0.6, 0.02, 0.98);
        let mut cells = [i16::MIN, 17, i16::MIN, i16::MIN];
        for _ in 0..100 {
            update.apply(&mut cells, &[0, 0, 1, 2]);
        }
        let p = |i: usize| LogOdds::from_steps(cells[i]).probability();
        assert_eq!((p(0), cells[1]), (None, 17));
        assert!((p(2).unwrap() - 0.02).abs() < 1e-4);
        assert!((p(3).unwrap() - 0.98).abs() < 1e-4);
    }
}
