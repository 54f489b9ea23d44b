//! What an experiment showed, as plain data.

use super::pictures::Picture;

#[derive(Clone, Debug, PartialEq, Default)]
pub struct Outcome {
    /// What was measured and what was asked, the most telling first.
    pub checks: Vec<Check>,
    /// The rest, in the order of the page.
    pub parts: Vec<Part>,
}

/// One figure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Check {
    pub what: String,
    /// With its unit.
    pub measured: String,
    /// Empty where the figure is only shown.
    pub required: String,
    pub verdict: Verdict,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    Passed,
    Failed,
    /// Nothing is asked of the figure.
    Shown,
}

/// A piece of an experiment's page.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// Markdown.
    Text(String),
    Table(Table),
    /// Beside each other.
    Pictures(Vec<Picture>),
}

/// The first column says what a row is about, the others hold figures.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Table {
    pub columns: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// Least, median and greatest of a figure over several seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Spread {
    pub(super) least: f64,
    pub(super) median: f64,
    pub(super) most: f64,
}

impl Outcome {
    /// Whether nothing that is asked for failed.
    pub fn passed(&self) -> bool {
        self.checks
            .iter()
            .all(|check| check.verdict != Verdict::Failed)
    }

    /// The pictures of all parts.
    pub fn pictures(&self) -> impl Iterator<Item = &Picture> {
        self.parts.iter().flat_map(|part| match part {
            Part::Pictures(pictures) => pictures.as_slice(),
            Part::Text(_) | Part::Table(_) => &[],
        })
    }
}

impl Check {
    /// A figure of which something is asked.
    pub fn gate(
        what: impl Into<String>,
        measured: impl Into<String>,
        required: impl Into<String>,
        passed: bool,
    ) -> Self {
        Self {
            what: what.into(),
            measured: measured.into(),
            required: required.into(),
            verdict: if passed {
                Verdict::Passed
            } else {
                Verdict::Failed
            },
        }
    }

    /// A figure that must be at least `least`, with every seed.
    pub(super) fn at_least(
        what: impl Into<String>,
        (measured, decimals, unit): (Spread, usize, &str),
        least: f64,
    ) -> Self {
        let (text, passed) = (measured.text(decimals, unit), measured.least >= least);
        Self::gate(what, text, format!("≥ {least}{unit}"), passed)
    }

    /// A figure that must be at most `most`, with every seed.
    pub(super) fn at_most(
        what: impl Into<String>,
        (measured, decimals, unit): (Spread, usize, &str),
        most: f64,
    ) -> Self {
        let (text, passed) = (measured.text(decimals, unit), measured.most <= most);
        Self::gate(what, text, format!("≤ {most}{unit}"), passed)
    }

    /// A count that must be zero, with every seed.
    pub(super) fn zero(what: impl Into<String>, measured: Spread) -> Self {
        Self::gate(what, measured.text(0, ""), "0", measured.most == 0.0)
    }

    /// A figure of which nothing is asked.
    pub fn shown(what: impl Into<String>, measured: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            measured: measured.into(),
            required: String::new(),
            verdict: Verdict::Shown,
        }
    }

    /// The same figure with nothing asked of it.
    #[must_use]
    pub fn without_gate(self) -> Self {
        Self::shown(self.what, self.measured)
    }
}

impl Part {
    /// Markdown without the blank space around it.
    pub fn text(text: impl AsRef<str>) -> Self {
        Self::Text(text.as_ref().trim().to_owned())
    }
}

impl Table {
    pub fn new(columns: &[&str]) -> Self {
        Self {
            columns: columns.iter().map(|&column| column.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    pub fn push<C: ToString>(&mut self, row: impl IntoIterator<Item = C>) {
        self.rows
            .push(row.into_iter().map(|cell| cell.to_string()).collect());
    }

    /// A row for each figure and its number of decimals.
    pub(super) fn of_spreads<'a>(rows: impl IntoIterator<Item = (&'a str, usize, Spread)>) -> Self {
        let mut table = Self::new(&["", "least", "median", "most"]);
        for (name, decimals, spread) in rows {
            let [least, median, most] = spread.cells(decimals);
            table.push([name.to_owned(), least, median, most]);
        }
        table
    }
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

    /// Of a figure of each drive.
    pub(super) fn over<D>(drives: &[D], figure: impl Fn(&D) -> f64) -> Self {
        Self::of(drives.iter().map(figure))
    }

    /// Of a count of each drive.
    pub(super) fn count<D>(drives: &[D], figure: impl Fn(&D) -> usize) -> Self {
        Self::over(drives, |drive| figure(drive) as f64)
    }

    /// "0.5 … 2 (median 1)" with so many decimals; one number where all are the same.
    pub(super) fn text(&self, decimals: usize, unit: &str) -> String {
        let [least, median, most] = self.cells(decimals);
        if least == most {
            format!("{least}{unit}")
        } else {
            format!("{least} … {most}{unit} (median {median})")
        }
    }

    /// Least, median and greatest with so many decimals.
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

    #[test]
    fn every_seed_is_asked() {
        let spread = Spread::of([1.0, 3.0]);
        for (check, required, verdict) in [
            (
                Check::at_least("a", (spread, 0, " m"), 1.0),
                "≥ 1 m",
                Verdict::Passed,
            ),
            (
                Check::at_least("a", (spread, 0, ""), 1.5),
                "≥ 1.5",
                Verdict::Failed,
            ),
            (
                Check::at_most("a", (spread, 0, " %"), 3.0),
                "≤ 3 %",
                Verdict::Passed,
            ),
            (
                Check::at_most("a", (spread, 0, ""), 2.0),
                "≤ 2",
                Verdict::Failed,
            ),
            (Check::zero("a", spread), "0", Verdict::Failed),
            (Check::zero("a", Spread::of([0.0])), "0", Verdict::Passed),
        ] {
            assert_eq!(
                (check.required.as_str(), check.verdict),
                (required, verdict)
            );
        }
    }
}
