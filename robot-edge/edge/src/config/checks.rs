//! Checks of single values, with messages that say what is allowed.

use std::fmt;

use super::error::{ConfigIssue, Problem};
use super::layer::quoted;

/// Longest name of anything, bytes.
const MAX_NAME_BYTES: usize = 255;

/// Which numbers are allowed; never infinity or not-a-number.
#[derive(Clone, Copy)]
pub(super) enum Allowed {
    /// From, to, both included.
    Within(f64, f64),
    /// Above zero, up to this.
    PositiveUpTo(f64),
}

impl Allowed {
    pub(super) fn contains(self, value: f64) -> bool {
        match self {
            Self::Within(least, most) => (least..=most).contains(&value),
            Self::PositiveUpTo(most) => value > 0.0 && value <= most,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(least, most) => write!(f, "{least} to {most}"),
            Self::PositiveUpTo(most) => write!(f, "above 0, up to {most}"),
        }
    }
}

/// Collects faults.
#[derive(Default)]
pub(super) struct Checks(Vec<ConfigIssue>);

impl Checks {
    pub(super) fn into_issues(self) -> Vec<ConfigIssue> {
        self.0
    }

    pub(super) fn issue(&mut self, key: &str, value: String, why: &'static str, allowed: String) {
        self.0.push(ConfigIssue {
            origin: None,
            key: key.to_owned(),
            problem: Problem::NotAllowed {
                value,
                why,
                allowed,
            },
        });
    }

    pub(super) fn number(&mut self, key: &str, value: f64, allowed: Allowed, why: &'static str) {
        if !allowed.contains(value) {
            self.issue(key, as_toml(value), why, allowed.to_string());
        }
    }

    pub(super) fn whole(
        &mut self,
        key: &str,
        value: u64,
        least: u64,
        most: u64,
        why: &'static str,
    ) {
        if !(least..=most).contains(&value) {
            self.issue(key, value.to_string(), why, format!("{least} to {most}"));
        }
    }

    pub(super) fn name(&mut self, key: &str, value: &str, why: &'static str) {
        let is_printable = !value.chars().any(char::is_control);
        if value.trim().is_empty() || value.len() > MAX_NAME_BYTES || !is_printable {
            let allowed = format!("1 to {MAX_NAME_BYTES} printable characters");
            self.issue(key, format!("\"{}\"", quoted(value)), why, allowed);
        }
    }

    pub(super) fn frame(&mut self, key: &str, value: &str) {
        self.name(key, value, "a frame has a name");
        if let Some(bare) = value.strip_prefix('/') {
            let why = "frames have no leading slash in tf2, so it would match none";
            self.issue(
                key,
                format!("\"{}\"", quoted(value)),
                why,
                format!("\"{}\"", quoted(bare)),
            );
        }
    }
}

/// A number as the user would write it (`nan`, not `NaN`).
pub(super) fn as_toml(value: f64) -> String {
    toml::Value::Float(value).to_string()
}
