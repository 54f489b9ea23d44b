//! A client in another language, written from `protocol/SPEC.md` alone, has the same map.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::Duration;

use tempfile::tempdir;

use super::processes::{Running, edge, free_port};
use crate::skip::skip;

fn client_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("python")
}

fn run(command: &mut Command) -> Option<Output> {
    command
        .output()
        .ok()
        .filter(|output| output.status.success())
}

/// A Python with the client's packages, in a virtual environment that later runs reuse; `None`,
/// and a skipped test, if it cannot be made.
fn python() -> Option<PathBuf> {
    let requirements = client_folder().join("requirements.txt");
    let wanted = blake3::hash(&std::fs::read(&requirements).unwrap()).to_hex();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("python-{}", &wanted[..16]));
    let python = folder.join("bin/python");
    let is_ready = |python: &Path| {
        run(Command::new(python).args(["-c", "import zenoh, zstandard, blake3, cryptography"]))
            .is_some()
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

#[test]
fn the_python_client_agrees_with_the_edge() {
    let Some(python) = python() else { return };
    let folder = client_folder();
    let vectors = Command::new(&python)
        .arg("-B")
        .arg(folder.join("test_vectors.py"))
        .output()
        .unwrap();
    assert!(
        vectors.status.success(),
        "{}",
        String::from_utf8_lossy(&vectors.stderr)
    );

    let exports = tempdir().unwrap();
    let port = free_port();
    let robot = edge(port, "scout", "20", &exports.path().join("edge"));
    sleep(Duration::from_secs(2));
    let mut command = Command::new(&python);
    command.arg("-B").arg(folder.join("foreshore_client.py"));
    command.args([
        "--connect",
        &format!("tcp/127.0.0.1:{port}"),
        "--until-ended",
        "--timeout",
        "60",
    ]);
    command.arg("--compare").arg(exports.path().join("edge"));
    let mut client = Running::start(&mut command, "the Python client");
    let synchronized = client.wait_for_output("synchronized: ");
    println!("{synchronized}");
    assert!(
        synchronized.contains("occupancy 29326 cells known"),
        "{synchronized}"
    );
    // It compares its map with the export of the robot.
    robot.signal("INT");
    robot.ends_well();
    let printed = client.ends_well();
    assert!(
        printed.contains("same as the export: occupancy 29326 cells"),
        "{printed}"
    );
}
