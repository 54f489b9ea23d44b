//! What can be wrong with a configuration, and where.

use std::fmt;
use std::path::PathBuf;

pub use super::schema::Expected;
pub use super::suggestion::Suggestion;

/// Why there is no configuration to work with. All of these are the user's to mend.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Neither a preset nor a file.
    #[error("there is no vehicle `{name}`{} Presets: {}. A vehicle of your own is a file: \
             `robot-edge vehicles generic2d > my.toml` makes one to edit", suggestion.as_ref().map_or(".".to_owned(), |hint| format!(": {hint}")), presets.join(", "))]
    UnknownVehicle {
        /// What was asked for.
        name: String,
        /// The preset nearest to it, where one is close.
        suggestion: Option<Suggestion>,
        /// All presets.
        presets: Vec<&'static str>,
    },
    /// The file cannot be read.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a configuration.
    #[error("{path}: {what}", path = path.display())]
    NotAConfiguration {
        /// The file.
        path: PathBuf,
        /// Why.
        what: String,
    },
    /// The file is not TOML.
    #[error("{origin}: {message}")]
    Syntax {
        /// Where.
        origin: Origin,
        /// What the parser expected.
        message: String,
    },
    /// Settings that do not exist, have the wrong type or a value that is not allowed.
    #[error("{}", lines(.0))]
    Issues(Vec<ConfigIssue>),
}

/// One thing wrong with one setting.
#[derive(Clone, Debug, PartialEq)]
pub struct ConfigIssue {
    /// Where it was set, unless by default.
    pub origin: Option<Origin>,
    /// Path of the key.
    pub key: String,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a setting.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Problem {
    /// There is no such key.
    #[error("unknown key{}", after_colon(suggestion.as_ref()))]
    UnknownKey {
        /// The nearest that there is.
        suggestion: Option<Suggestion>,
    },
    /// The value has the wrong type, or is none of the words.
    #[error("expected {expected}, found {found}")]
    WrongType {
        /// What may stand there.
        expected: Expected,
        /// What stands there.
        found: String,
    },
    /// The value makes no sense, alone or beside others.
    #[error("{value} is not allowed: {why}; allowed: {allowed}")]
    NotAllowed {
        /// The value.
        value: String,
        /// What it would do.
        why: &'static str,
        /// What may stand there.
        allowed: String,
    },
    /// Settings for a sensor that the vehicle does not have.
    #[error("the vehicle has no sensor of this name; it has: {}. To add one, set its `kind` ({})",
            known.join(", "), super::sensors::SensorConfig::KINDS.join(", "))]
    NoSuchSensor {
        /// Sensors that it has.
        known: Vec<String>,
    },
    /// What no other check found.
    #[error("{0}")]
    Other(String),
}

/// Where a setting came from.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Origin {
    /// A file.
    File {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Column in characters, from 1.
        column: usize,
    },
    /// A preset.
    Preset(&'static str),
    /// `--set`.
    Set,
    /// `--topic`.
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
