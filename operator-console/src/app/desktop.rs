//! The system's own program for folders.

use std::env;
use std::ffi::OsStr;
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;

/// Whether a folder can be shown unasked. Without a desktop `xdg-open` looks for a browser, which nobody wants for a folder.
pub(super) fn has_desktop() -> bool {
    let is_certain = cfg!(any(target_os = "macos", windows));
    is_certain || names_one(env::var_os("XDG_CURRENT_DESKTOP").as_deref())
}

fn names_one(desktop: Option<&OsStr>) -> bool {
    desktop.is_some_and(|name| !name.is_empty())
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
        .map_err(|why| words(folder, program, &why))?;
    // Until it has ended the system keeps a place for it.
    thread::spawn(move || drop(child.wait()));
    Ok(())
}

/// Why `program` does not show a folder, and where that is.
fn words(folder: &Path, program: &str, why: &io::Error) -> String {
    let folder = folder.display();
    if why.kind() == io::ErrorKind::NotFound {
        format!("No file manager on this computer. This one is {folder}")
    } else {
        format!("{folder} cannot be opened: {program}: {why}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn where_nothing_opens_folders_the_path_is_told_and_no_program() {
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
    fn a_desktop_is_there_where_it_has_a_name() {
        assert!(names_one(Some(OsStr::new("ubuntu:GNOME"))));
        assert!(!names_one(Some(OsStr::new(""))));
        assert!(!names_one(None));
    }
}
