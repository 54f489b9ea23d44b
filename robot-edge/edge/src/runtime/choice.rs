//! Questions about a recording that only a person can answer.

use crate::cli::VehicleOptions;
use crate::config::Override;

/// The recording can be mapped after a choice. The message is for the command line; a window shows the question and a
/// button for each choice.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct ChoiceNeeded {
    pub message: String,
    pub question: String,
    pub choices: Vec<Choice>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    pub label: String,
    /// Options beside those given before.
    pub setup: VehicleOptions,
}

impl Choice {
    /// A choice by one option, `--topic` or `--set`, up to and with its equals sign; `None` if it cannot be given as an
    /// option.
    pub(super) fn new(label: String, option: &str, value: &str) -> Option<Self> {
        let mut setup = VehicleOptions::default();
        if let Some(role) = option.strip_prefix("--topic ") {
            setup
                .topics
                .push(Override::topic(&format!("{role}{value}")).ok()?);
        } else {
            let setting = option.strip_prefix("--set ").unwrap_or(option);
            setup
                .settings
                .push(format!("{setting}{value}").parse().ok()?);
        }
        Some(Self { label, setup })
    }
}

impl VehicleOptions {
    /// These options and those of a choice.
    #[must_use]
    pub fn with(&self, choice: &Choice) -> Self {
        let mut setup = self.clone();
        setup.settings.extend(choice.setup.settings.iter().cloned());
        setup.topics.extend(choice.setup.topics.iter().cloned());
        setup
    }
}
