//! The desktop's folders, file names in them, and its file manager.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, io, thread};

use etcetera::BaseStrategy as _;
use network::clock::wall_clock_label;
use protocol::keys::RobotId;

/// Whether to open folders automatically. Without a desktop `xdg-open` would start a browser.
pub(super) fn has_desktop() -> bool {
    let is_certain = cfg!(any(target_os = "macos", windows));
    is_certain || names_one(env::var_os("XDG_CURRENT_DESKTOP").as_deref())
}

fn names_one(desktop: Option<&OsStr>) -> bool {
    desktop.is_some_and(|name| !name.is_empty())
}

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
        .map_err(|why| words(folder, program, &why))?;
    thread::spawn(move || drop(child.wait()));
    Ok(())
}

fn words(folder: &Path, program: &str, why: &io::Error) -> String {
    let folder = folder.display();
    if why.kind() == io::ErrorKind::NotFound {
        format!("No file manager on this computer. This one is {folder}")
    } else {
        format!("{folder} cannot be opened: {program}: {why}")
    }
}

/// Limit of characters from another file's name.
const MAX_NAME: usize = 50;

fn pictures() -> Option<PathBuf> {
    user_folder("XDG_PICTURES_DIR", "Pictures")
}

pub(super) fn documents() -> Option<PathBuf> {
    user_folder("XDG_DOCUMENTS_DIR", "Documents")
}

pub(super) fn screenshot_path(shown: Option<&str>, is_taken: impl Fn(&Path) -> bool) -> PathBuf {
    let name = stamped_name(shown, &wall_clock_label());
    let folder = pictures().unwrap_or_default();
    free_path(&folder.join(format!("{name}.png")), is_taken)
}

/// What is shown, and the UTC time `label` of RFC 3339 without characters that some file systems forbid.
pub(super) fn stamped_name(shown: Option<&str>, label: &str) -> String {
    let label = label.replace(':', "-").replace('Z', "");
    let shown = shown.map(|shown| format!("-{shown}")).unwrap_or_default();
    format!("foreshore{shown}-{label}")
}

/// `path`, or the first of `path-2`, `path-3` … that is not taken.
fn free_path(path: &Path, is_taken: impl Fn(&Path) -> bool) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let numbered = (2_u32..).map(|number| path.with_file_name(format!("{stem}-{number}.png")));
    let mut all = std::iter::once(path.to_owned()).chain(numbered);
    all.find(|path| !is_taken(path))
        .unwrap_or_else(|| path.to_owned())
}

pub(super) fn name_for_files(robot: &RobotId, recording: Option<&str>) -> String {
    let Some(stem) = recording.and_then(|file| Path::new(file).file_stem()) else {
        return robot.to_string();
    };
    let stem = stem.to_string_lossy();
    // A name has 255 bytes at most, including time and extension.
    stem.chars().take(MAX_NAME).collect()
}

/// Reads `user-dirs.dirs` (xdg-user-dirs) as a shell would: `XDG_PICTURES_DIR="$HOME/Bilder"`.
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
    fn missing_file_manager_shows_the_path() {
        let actual = |kind: io::ErrorKind| words(Path::new("/maps"), "xdg-open", &kind.into());
        assert_eq!(
            actual(io::ErrorKind::NotFound),
            "No file manager on this computer. This one is /maps"
        );
        assert_eq!(
            actual(io::ErrorKind::PermissionDenied),
            "/maps cannot be opened: xdg-open: permission denied"
        );
    }

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
        let path = screenshot_path(Some("rooms"), |_| false);
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(name.starts_with("foreshore-rooms-2"), "{name}");
        assert_eq!(path.extension().unwrap(), "png");
    }

    #[test]
    fn names_have_the_time_in_one_piece() {
        let name = |shown| stamped_name(shown, "2026-11-23T00:51:31Z");
        assert_eq!(name(Some("rooms")), "foreshore-rooms-2026-11-23T00-51-31");
        assert_eq!(name(None), "foreshore-2026-11-23T00-51-31");
    }

    #[test]
    fn pictures_of_one_second_have_numbers() {
        let path = Path::new("/pictures/foreshore-a.b-2026.png");
        let free = |taken: &[&str]| {
            free_path(path, |path| taken.iter().any(|taken| path.ends_with(taken)))
        };
        let [first, second, third] =
            ["", "-2", "-3"].map(|number| format!("foreshore-a.b-2026{number}.png"));
        assert_eq!(free(&[]), path);
        assert_eq!(free(&[&first]), path.with_file_name(&second));
        assert_eq!(free(&[&first, &second]), path.with_file_name(third));
        assert_eq!(free(&[&second]), path);
    }
}
