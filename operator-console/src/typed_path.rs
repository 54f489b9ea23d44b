//! Typed paths: `~` is the home folder, as in a shell.

use std::path::{Path, PathBuf, is_separator};

/// Expands `~` and a leading `~/`, if the system has a home folder.
pub(crate) fn typed_path(typed: &str) -> PathBuf {
    within(typed, home().as_deref())
}

/// Resolves a relative path against the working directory.
pub(crate) fn absolute(path: PathBuf) -> PathBuf {
    std::path::absolute(&path).unwrap_or(path)
}

pub(crate) fn home() -> Option<PathBuf> {
    etcetera::home_dir().ok()
}

pub(crate) fn within(typed: &str, home: Option<&Path>) -> PathBuf {
    let home_and_rest = home.zip(typed.strip_prefix('~'));
    match home_and_rest {
        Some((home, "")) => home.to_owned(),
        Some((home, rest)) if rest.starts_with(is_separator) => {
            home.join(rest.trim_start_matches(is_separator))
        }
        // `~anna` is another user's home in some shells, and a plain name elsewhere.
        Some(_) | None => PathBuf::from(typed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leading_tilde_is_the_home_folder() {
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
}
