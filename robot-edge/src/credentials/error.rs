//! Why credentials cannot be made or used.

use std::io;
use std::path::PathBuf;

/// Why credentials cannot be made or used.
#[derive(Debug, thiserror::Error)]
pub enum CredentialsError {
    /// A file that cannot be read.
    #[error("{path}: cannot be read: {why}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// A file that cannot be written.
    #[error("{path}: cannot be written: {why}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        why: io::Error,
    },
    /// A secret that others can read.
    #[error(
        "{path}: others than its owner may read this secret (mode {mode:03o}). `chmod 600` it; if somebody may have read \
         it, have a new one made",
        path = path.display()
    )]
    Exposed {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A file that does not hold what it should.
    #[error("{path}: {why}", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        why: String,
    },
    /// What was asked for does not fit what is there.
    #[error("{0}")]
    Conflict(String),
    /// No certificate can be made.
    #[error("no certificate can be made: {0}")]
    Make(#[from] rcgen::Error),
    /// No secret can be made.
    #[error("the operating system gives no random numbers: {0}")]
    NoRandomness(#[from] getrandom::Error),
}

impl CredentialsError {
    pub(super) fn content(path: impl Into<PathBuf>, why: impl Into<String>) -> Self {
        Self::Content {
            path: path.into(),
            why: why.into(),
        }
    }
}
