//! What can be wrong with a configuration, and where.

use std::fmt;
use std::path::PathBuf;

pub use super::schema::Expected;

#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("there is no vehicle `{name}`{} Presets: {}. A vehicle of your own is a file: \
             `robot-edge vehicles generic2d > my.toml` makes one to edit", suggestion.as_ref().map_or(".".to_owned(), |hint| format!(": {hint}")), presets.join(", "))]
    UnknownVehicle {
        name: String,
        suggestion: Option<Suggestion>,
        presets: Vec<&'static str>,
    },
    #[error("{path}: {source}", path = path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    #[error("{path}: {what}", path = path.display())]
    NotAConfiguration { path: PathBuf, what: String },
    #[error("{origin}: {message}")]
    Syntax { origin: Origin, message: String },
    #[error("{}", lines(.0))]
    Issues(Vec<ConfigIssue>),
}

#[derive(Clone, Debug, PartialEq)]
pub struct ConfigIssue {
    /// Where it was set, unless by default.
    pub origin: Option<Origin>,
    pub key: String,
    pub problem: Problem,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    #[error("unknown key{}", after_colon(suggestion.as_ref()))]
    UnknownKey { suggestion: Option<Suggestion> },
    #[error("expected {expected}, found {found}")]
    WrongType { expected: Expected, found: String },
    #[error("{value} is not allowed: {why}; allowed: {allowed}")]
    NotAllowed {
        value: String,
        why: &'static str,
        allowed: String,
    },
    #[error("the vehicle has no sensor of this name; it has: {}. To add one, set its `kind` ({})",
            known.join(", "), super::sensors::SensorConfig::KINDS.join(", "))]
    NoSuchSensor { known: Vec<String> },
    #[error("{0}")]
    Other(String),
}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    File {
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
    },
    Preset(&'static str),
    Set,
    Topic,
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { path, line, column } => write!(f, "{}:{line}:{column}", path.display()),
            Self::Preset(name) => write!(f, "preset {name}"),
            Self::Set => f.write_str("--set"),
            Self::Topic => f.write_str("--topic"),
        }
    }
}

impl fmt::Display for ConfigIssue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(origin) = &self.origin {
            write!(f, "{origin}: ")?;
        }
        write!(f, "`{}`: {}", self.key, self.problem)
    }
}

fn after_colon(hint: Option<&Suggestion>) -> String {
    hint.map(|hint| format!(": {hint}")).unwrap_or_default()
}

fn lines(issues: &[ConfigIssue]) -> String {
    let lines: Vec<String> = issues.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

impl From<teleop::SettingError> for ConfigIssue {
    fn from(error: teleop::SettingError) -> Self {
        Self {
            origin: None,
            key: error.key,
            problem: Problem::NotAllowed {
                value: error.value,
                why: error.why,
                allowed: error.allowed,
            },
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Suggestion {
    pub name: String,
    /// Near enough to be what was meant.
    pub is_close: bool,
}

impl fmt::Display for Suggestion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_close {
            write!(f, "did you mean `{}`?", self.name)
        } else {
            write!(f, "the nearest that exists is `{}`", self.name)
        }
    }
}

/// The longest part of what was typed that is compared: distances take memory and time.
const MAX_COMPARED_CHARS: usize = 80;

/// The nearest of `names` to `typed`, by Damerau-Levenshtein distance without regard to case.
///
/// Of a dotted name its last parts count too, so that `cell_m` finds `mapping.occupancy.cell_m`.
pub(super) fn suggest<'a>(
    typed: &str,
    names: impl IntoIterator<Item = &'a str>,
) -> Option<Suggestion> {
    let typed: String = typed
        .chars()
        .take(MAX_COMPARED_CHARS)
        .collect::<String>()
        .to_lowercase();
    let typed_parts = typed.split('.').count();
    let distance = |name: &str| {
        let whole = strsim::damerau_levenshtein(&typed, name);
        let parts = name.split('.').count();
        if parts <= typed_parts {
            return whole;
        }
        let tail: Vec<&str> = name.split('.').skip(parts - typed_parts).collect();
        whole.min(strsim::damerau_levenshtein(&typed, &tail.join(".")) + 1)
    };
    let (distance, name) = names
        .into_iter()
        .map(|name| (distance(name), name))
        .min_by_key(|&(distance, _)| distance)?;
    Some(Suggestion {
        name: name.to_owned(),
        is_close: distance <= (typed.chars().count() / 3).max(2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(typed: &str, expected: &str, is_close: bool) {
        let names = [
            "mapping.occupancy.cell_m",
            "mapping.occupancy.p_free",
            "vehicle.name",
        ];
        let hint = suggest(typed, names).unwrap();
        assert_eq!(
            (hint.name.as_str(), hint.is_close),
            (expected, is_close),
            "{typed}"
        );
    }

    #[test]
    fn slips_of_every_kind_find_the_key() {
        check("mapping.occupancy.cell", "mapping.occupancy.cell_m", true);
        check("mapping.ocupancy.cell_m", "mapping.occupancy.cell_m", true);
        check("Mapping.Occupancy.Cell_M", "mapping.occupancy.cell_m", true);
        check("mapping.occupancy.clel_m", "mapping.occupancy.cell_m", true);
        check("cell_m", "mapping.occupancy.cell_m", true);
        check("occupancy.p_fre", "mapping.occupancy.p_free", true);
        check("nmae", "vehicle.name", true);
    }

    #[test]
    fn what_is_far_from_all_is_said_to_be() {
        check("xyzzy", "vehicle.name", false);
        assert_eq!(suggest("x", []), None);
    }
}
