//! Recordings that others made, which tests find outside the project.

use std::path::{Path, PathBuf};

use crate::skip::skip;

/// The folder `part` of the shared data; `None`, with a notice, if it is not on this machine.
pub(crate) fn shared_data(part: &str) -> Option<PathBuf> {
    let beside = || {
        let folders = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
        let checkout = folders
            .filter(|folder| folder.join("Cargo.lock").exists())
            .last();
        checkout.map_or_else(PathBuf::new, |folder| folder.join("../shared/data"))
    };
    let root = std::env::var_os("FORESHORE_DATA").map_or_else(beside, PathBuf::from);
    let folder = root.join(part);
    if folder.is_dir() {
        return Some(folder);
    }
    skip(
        &format!("there are no recordings at {}", folder.display()),
        "FORESHORE_DATA says where they are",
    );
    None
}
