//! Where the system keeps what people make.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use etcetera::BaseStrategy as _;
use protocol::keys::RobotId;
use robot_edge::clock::wall_clock_label;

/// The folder for pictures; where the system names none, `Pictures` in the home folder.
fn pictures() -> Option<PathBuf> {
    user_folder("XDG_PICTURES_DIR", "Pictures")
}

/// The folder for documents; where the system names none, `Documents` in the home folder.
pub(super) fn documents() -> Option<PathBuf> {
    user_folder("XDG_DOCUMENTS_DIR", "Documents")
}

/// Where a screenshot goes that is taken now. The name has the date, to the second, and the robot.
pub(super) fn screenshot_path(robot: Option<&RobotId>) -> PathBuf {
    let label = wall_clock_label().replace(':', "-").replace('Z', "");
    let robot = robot.map(|robot| format!("-{robot}")).unwrap_or_default();
    pictures()
        .unwrap_or_default()
        .join(format!("foreshore{robot}-{label}.png"))
}

/// Shows a folder in the system's own program for that.
///
/// # Errors
/// Where there is no such program, in words.
pub(super) fn open_folder(folder: &Path) -> Result<(), String> {
    let program = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        "xdg-open"
    };
    let mut child = Command::new(program)
        .arg(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|why| format!("{} cannot be shown: {program}: {why}", folder.display()))?;
    // Until it has ended the system keeps a place for it.
    thread::spawn(move || drop(child.wait()));
    Ok(())
}

/// `user-dirs.dirs` (xdg-user-dirs) names folders as a shell would: `XDG_PICTURES_DIR="$HOME/Bilder"`.
fn user_folder(name: &str, usual: &str) -> Option<PathBuf> {
    let folders = etcetera::choose_base_strategy().ok()?;
    let home = folders.home_dir().to_owned();
    let named = std::env::var_os(name).map(PathBuf::from).or_else(|| {
        let text = std::fs::read_to_string(folders.config_dir().join("user-dirs.dirs")).ok()?;
        let value = text.lines().find_map(|line| {
            let value = line.trim().strip_prefix(name)?.strip_prefix('=')?;
            Some(value.trim().trim_matches('"').to_owned())
        })?;
        Some(match value.strip_prefix("$HOME/") {
            Some(within) => home.join(within),
            None => PathBuf::from(value),
        })
    });
    Some(named.unwrap_or_else(|| home.join(usual)))
}
