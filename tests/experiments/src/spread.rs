//! A figure over several seeds.

/// Least, median and greatest of a figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    pub(super) least: f64,
    pub(super) median: f64,
    pub(super) most: f64,
}

impl Spread {
    /// Of at least one figure; of none all are not-a-number.
    pub(super) fn of(figures: impl IntoIterator<Item = f64>) -> Self {
        let mut figures: Vec<f64> = figures.into_iter().collect();
        figures.sort_by(f64::total_cmp);
        let at = |place: usize| figures.get(place).copied().unwrap_or(f64::NAN);
        let last = figures.len().saturating_sub(1);
        Self {
            least: at(0),
            median: 0.5 * (at(last / 2) + at(last.div_ceil(2))),
            most: at(last),
        }
    }

    /// "0.5 … 2 (median 1)" with so many decimals; one number where all are the same.
    pub(super) fn text(&self, decimals: usize, unit: &str) -> String {
        let number = |value: f64| format!("{value:.decimals$}");
        let [least, median, most] = [self.least, self.median, self.most].map(number);
        if least == most {
            format!("{least}{unit}")
        } else {
            format!("{least} … {most}{unit} (median {median})")
        }
    }

    /// Cells of a table: least, median and greatest.
    pub(super) fn cells(&self, decimals: usize) -> [String; 3] {
        [self.least, self.median, self.most].map(|value| format!("{value:.decimals$}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle() {
        let check = |figures: &[f64], least, median, most| {
            let spread = Spread::of(figures.iter().copied());
            let expected = Spread {
                least,
                median,
                most,
            };
            assert_eq!(spread, expected, "{figures:?}");
        };
        check(&[3.0], 3.0, 3.0, 3.0);
        check(&[3.0, 1.0], 1.0, 2.0, 3.0);
        check(&[3.0, 1.0, 1.5], 1.0, 1.5, 3.0);
        assert!(Spread::of([]).median.is_nan());
        assert_eq!(
            Spread::of([1.0, 2.0]).text(1, " m"),
            "1.0 … 2.0 m (median 1.5)"
        );
        assert_eq!(Spread::of([1.0]).text(0, ""), "1");
    }
}
