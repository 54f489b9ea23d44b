//! Python with packages of other projects, for clients that are not ours. Tests of other crates include this file.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::skip::skip;

/// The folder of the clients.
pub(crate) fn client_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/python")
}

fn run(command: &mut Command) -> Option<Output> {
    command
        .output()
        .ok()
        .filter(|output| output.status.success())
}

/// A Python with the packages of the file `requirements`, as which it imports `imports`, in a virtual environment that later
/// runs reuse; `None`, and a skipped test, if it cannot be made.
pub(crate) fn python(requirements: &str, imports: &str) -> Option<PathBuf> {
    let requirements = client_folder().join(requirements);
    let wanted = blake3::hash(&fs::read(&requirements).unwrap()).to_hex();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("python-{}", &wanted[..16]));
    let python = folder.join("bin/python");
    let is_ready = |python: &Path| {
        let import = format!("import {imports}");
        run(Command::new(python).args(["-c", &import])).is_some()
    };
    if is_ready(&python) {
        return Some(python);
    }
    let made = run(Command::new("python3").args(["-m", "venv"]).arg(&folder)).and_then(|_| {
        run(Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--requirement"])
            .arg(&requirements))
    });
    if made.is_some() && is_ready(&python) {
        return Some(python);
    }
    let lacks = format!(
        "no virtual environment with the packages of {} can be made",
        requirements.display()
    );
    skip(&lacks, "package python3-venv, and PyPI");
    None
}
