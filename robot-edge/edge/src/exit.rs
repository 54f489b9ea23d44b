//! The exit codes of the program.

use std::error::Error;
use std::process::ExitCode;

use crate::config::ConfigError;
use crate::runtime::choice::ChoiceNeeded;
use network::LinkError;
use network::credentials::CredentialsError;
use recording::RecordingError;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    Done = 0,
    Failed = 1,
    Usage = 2,
    Unreadable = 3,
    /// Ctrl-C.
    Interrupted = 130,
}

/// The arguments are wrong; the text says what to do.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("interrupted")]
pub struct Interrupted;

impl Exit {
    /// The exit code of `error`: that of the outermost known cause.
    pub fn of(error: &(dyn Error + 'static)) -> Self {
        let mut cause = Some(error);
        while let Some(error) = cause {
            if error.is::<UsageError>()
                || error.is::<ChoiceNeeded>()
                || error.is::<ConfigError>()
                || error.is::<CredentialsError>()
                || error.is::<clap::Error>()
            {
                return Self::Usage;
            }
            #[cfg(feature = "simulation")]
            if error.is::<simulation::WorldError>() {
                return Self::Usage;
            }
            if let Some(
                LinkError::Endpoint(_)
                | LinkError::Protocol { .. }
                | LinkError::Credentials(_)
                | LinkError::Config { .. },
            ) = error.downcast_ref()
            {
                return Self::Usage;
            }
            if error.is::<RecordingError>() {
                return Self::Unreadable;
            }
            if error.is::<Interrupted>() {
                return Self::Interrupted;
            }
            cause = error.source();
        }
        Self::Failed
    }

    pub const fn code(self) -> u8 {
        self as u8
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit.code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    fn check(error: &anyhow::Error, expected: u8) {
        assert_eq!(Exit::of(error.as_ref()).code(), expected, "{error:#}");
    }

    #[test]
    fn errors_keep_their_code_under_context() {
        let unreadable = || RecordingError::UnknownFormat {
            path: "a.bag".into(),
            begins_with: "PK".to_owned(),
        };
        let misconfigured = crate::config::load("no such vehicle", &[]).unwrap_err();
        check(&anyhow::anyhow!("the disk is full"), 1);
        check(&misconfigured.into(), 2);
        check(&UsageError("no topic fits".to_owned()).into(), 2);
        check(&unreadable().into(), 3);
        check(
            &anyhow::Error::from(unreadable()).context("while replaying"),
            3,
        );
        check(
            &Err::<(), _>(Interrupted)
                .context("while replaying")
                .unwrap_err(),
            130,
        );
    }
}
