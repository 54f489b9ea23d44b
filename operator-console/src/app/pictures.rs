//! Where the system keeps what people make.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

use etcetera::BaseStrategy as _;
use protocol::keys::RobotId;
use robot_edge::clock::wall_clock_label;

/// Characters that files take over of another's name, at most.
const MAX_NAME: usize = 50;

/// The folder for pictures; where the system names none, `Pictures` in the home folder.
fn pictures() -> Option<PathBuf> {
    user_folder("XDG_PICTURES_DIR", "Pictures")
}

/// The folder for documents; where the system names none, `Documents` in the home folder.
pub(super) fn documents() -> Option<PathBuf> {
    user_folder("XDG_DOCUMENTS_DIR", "Documents")
}

/// Where a screenshot goes that is taken now. The name has the date, to the second, and what is shown.
pub(super) fn screenshot_path(shown: Option<&str>) -> PathBuf {
    let label = wall_clock_label().replace(':', "-").replace('Z', "");
    let shown = shown.map(|shown| format!("-{shown}")).unwrap_or_default();
    pictures()
        .unwrap_or_default()
        .join(format!("foreshore{shown}-{label}.png"))
}

/// What files are named after: the robot, or the recording without the ending of its file.
pub(super) fn name_for_files(robot: &RobotId, recording: Option<&str>) -> String {
    let Some(stem) = recording.and_then(|file| Path::new(file).file_stem()) else {
        return robot.to_string();
    };
    let stem = stem.to_string_lossy();
    // Date and ending have to fit into a name of 255 bytes as well.
    stem.chars().take(MAX_NAME).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_after_what_is_shown() {
        let robot = "recording-0a1b2c".parse().unwrap();
        let check = |recording, expected: &str| {
            assert_eq!(name_for_files(&robot, recording), expected);
        };
        check(None, "recording-0a1b2c");
        check(Some("rooms.mcap"), "rooms");
        check(Some("a day in May.2.bag"), "a day in May.2");
        check(Some(".log"), ".log");
        let long = "ü".repeat(200) + ".log";
        assert_eq!(name_for_files(&robot, Some(&long)), "ü".repeat(MAX_NAME));
        let path = screenshot_path(Some("rooms"));
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(name.starts_with("foreshore-rooms-2"), "{name}");
        assert_eq!(path.extension().unwrap(), "png");
    }
}
