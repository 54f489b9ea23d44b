//! Recordings that others made, which tests find outside the project.

use std::path::PathBuf;

use crate::skip::skip;

/// The folder `part` of the shared data; `None`, said aloud, where it is not on this machine.
pub(crate) fn shared_data(part: &str) -> Option<PathBuf> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let root = std::env::var_os("FORESHORE_DATA").map_or_else(|| beside.into(), PathBuf::from);
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
