//! What an experiment showed, as plain data.

use super::pictures::Picture;

/// What an experiment showed.
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
    /// What is measured.
    pub what: String,
    /// What came out, with its unit.
    pub measured: String,
    /// What must come out; empty where it is only shown.
    pub required: String,
    /// Whether it did.
    pub verdict: Verdict,
}

/// Whether a figure is what it must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It is.
    Passed,
    /// It is not.
    Failed,
    /// Nothing is asked of it.
    Shown,
}

/// A piece of an experiment's page.
#[derive(Clone, Debug, PartialEq)]
pub enum Part {
    /// Markdown.
    Text(String),
    /// Figures.
    Table(Table),
    /// Pictures beside each other.
    Pictures(Vec<Picture>),
}

/// A table: the first column says what a row is about, the others hold figures.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct Table {
    /// Headings.
    pub columns: Vec<String>,
    /// As many cells each as there are headings.
    pub rows: Vec<Vec<String>>,
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
    /// An empty table.
    pub fn new(columns: &[&str]) -> Self {
        Self {
            columns: columns.iter().map(|&column| column.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row.
    pub fn push<C: ToString>(&mut self, row: impl IntoIterator<Item = C>) {
        self.rows
            .push(row.into_iter().map(|cell| cell.to_string()).collect());
    }
}
