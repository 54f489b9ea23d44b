//! Paths as people type them: `~` is the home folder, as it is in a shell.

use std::path::{Path, PathBuf, is_separator};

/// The path that was typed: `~`, and `~/` at its beginning, are the home folder, where the system names one.
pub(crate) fn typed_path(typed: &str) -> PathBuf {
    within(typed, home().as_deref())
}

/// The same place from wherever somebody looks: what is relative begins in the folder that the program was started in.
pub(crate) fn absolute(path: PathBuf) -> PathBuf {
    std::path::absolute(&path).unwrap_or(path)
}

/// The home folder, where the system names one.
pub(crate) fn home() -> Option<PathBuf> {
    etcetera::home_dir().ok()
}

/// The same, where `home` is the home folder.
pub(crate) fn within(typed: &str, home: Option<&Path>) -> PathBuf {
    let home_and_rest = home.zip(typed.strip_prefix('~'));
    match home_and_rest {
        Some((home, "")) => home.to_owned(),
        Some((home, rest)) if rest.starts_with(is_separator) => {
            home.join(rest.trim_start_matches(is_separator))
        }
        // `~anna` is another's home in some shells, and a name anywhere else.
        Some(_) | None => PathBuf::from(typed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilde_at_the_beginning_is_the_home_folder() {
        let check = |typed: &str, expected: &str| {
            let home = Path::new("/home/anna");
            assert_eq!(within(typed, Some(home)), Path::new(expected), "{typed}");
        };
        check("~", "/home/anna");
        check("~/", "/home/anna");
        check("~/maps", "/home/anna/maps");
        check("~//maps", "/home/anna/maps");
        check("~/maps/", "/home/anna/maps/");
        check("~maps", "~maps");
        check("./~/maps", "./~/maps");
        check("/maps/~", "/maps/~");
        check("maps", "maps");
        check("", "");
        assert_eq!(within("~/maps", None), Path::new("~/maps"));
    }

    #[test]
    fn what_is_relative_begins_where_the_program_was_started() {
        let here = std::env::current_dir().unwrap();
        assert_eq!(absolute("maps/lake".into()), here.join("maps/lake"));
        assert_eq!(absolute("/maps".into()), Path::new("/maps"));
        assert_eq!(absolute(PathBuf::new()), Path::new(""));
    }
}
