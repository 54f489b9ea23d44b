//! What a path that is being typed may become: folders, and files that may be recordings.

use std::fs;
use std::path::{MAIN_SEPARATOR, Path};

use robot_edge::recording::Format;

use crate::typed_path::{home, within};

/// Entries of a folder that are looked at: whoever has more types another letter.
const MAX_LOOKED_AT: usize = 5_000;
/// Completions that are offered.
pub(super) const MAX_OFFERED: usize = 10;
/// How recordings end.
const ENDINGS: [&str; 2] = ["mcap", "bag"];
/// How CARMEN logs end, and much else: these are looked into.
const LOG_ENDINGS: [&str; 2] = ["log", "clf"];
/// So many files are looked into at most.
const MAX_OPENED: usize = 50;

/// Paths that begin with `typed`, by name; folders end with the separator. What begins with `~/` goes on doing so.
pub(super) fn completions(typed: &str) -> Vec<String> {
    completions_of(typed, home().as_deref())
}

fn completions_of(typed: &str, home: Option<&Path>) -> Vec<String> {
    if typed == "~" && home.is_some() {
        return vec![format!("~{MAIN_SEPARATOR}")];
    }
    let folder_end = typed.rfind(MAIN_SEPARATOR).map_or(0, |at| at + 1);
    let (folder, beginning) = typed.split_at(folder_end);
    let read_from = match folder {
        "" => Path::new(".").to_owned(),
        _ => within(folder, home),
    };
    let read = fs::read_dir(&read_from);
    let entries = read.into_iter().flatten().flatten().take(MAX_LOOKED_AT);
    let mut names: Vec<String> = entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let is_hidden = name.starts_with('.') && !beginning.starts_with('.');
            if is_hidden || !name.starts_with(beginning) {
                return None;
            }
            if entry.path().is_dir() {
                Some(format!("{name}{MAIN_SEPARATOR}"))
            } else {
                let may_be_one = ends_with(&name, &ENDINGS) || ends_with(&name, &LOG_ENDINGS);
                may_be_one.then_some(name)
            }
        })
        .collect();
    names.sort();
    let mut opened = 0;
    let is_one = |name: &String| {
        if !ends_with(name, &LOG_ENDINGS) {
            return true;
        }
        opened += 1;
        opened <= MAX_OPENED && is_recording(&read_from.join(name))
    };
    let offered = names.into_iter().filter(is_one).take(MAX_OFFERED);
    offered.map(|name| format!("{folder}{name}")).collect()
}

/// As much as all completions have in common.
pub(super) fn common_beginning(completions: &[String]) -> Option<String> {
    let first = completions.first()?;
    let common = completions.iter().fold(first.len(), |length, other| {
        let pairs = first.char_indices().zip(other.chars());
        let same = pairs.take_while(|((_, a), b)| a == b).last();
        length.min(same.map_or(0, |((at, sign), _)| at + sign.len_utf8()))
    });
    Some(first[..common].to_owned())
}

fn ends_with(name: &str, endings: &[&str]) -> bool {
    let ending = Path::new(name).extension();
    ending.is_some_and(|ending| {
        endings
            .iter()
            .any(|known| ending.eq_ignore_ascii_case(known))
    })
}

/// By its first bytes. A pipe is none, and would be waited for.
fn is_recording(path: &Path) -> bool {
    path.is_file() && Format::of(path).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_recordings_are_offered() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "roof.mcap",
            "rooms.MCAP",
            "room.txt",
            ".rooms.bag",
            "rooms.log",
            "räume.log",
        ] {
            let begins_with = match name {
                "räume.log" => {
                    "# message_name [message contents]\nFLASER 2 0.5 0.6 0 0 0 0 0 0 1.0 a 1.0\n"
                }
                _ => "Nov 22 18:20:42 a machine's own log\n",
            };
            fs::write(folder.path().join(name), begins_with).unwrap();
        }
        fs::create_dir(folder.path().join("rover")).unwrap();
        let root = format!("{}{MAIN_SEPARATOR}", folder.path().display());
        let offered = |typed: &str| {
            let all = completions(&format!("{root}{typed}"));
            let names = all
                .iter()
                .map(|path| path.strip_prefix(&root).unwrap().to_owned());
            names.collect::<Vec<_>>()
        };
        let rover = format!("rover{MAIN_SEPARATOR}");
        assert_eq!(
            offered(""),
            ["roof.mcap", "rooms.MCAP", &rover, "räume.log"]
        );
        assert_eq!(offered("roo"), ["roof.mcap", "rooms.MCAP"]);
        assert_eq!(offered("."), [".rooms.bag"]);
        assert_eq!(offered("x"), [""; 0]);
        assert_eq!(offered("gone/x"), [""; 0]);
    }

    #[test]
    fn paths_in_the_home_folder_are_offered_as_they_are_typed() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("rooms.mcap"), "").unwrap();
        fs::create_dir(home.path().join("roofs")).unwrap();
        let offered = |typed: &str| completions_of(typed, Some(home.path()));
        let tilde = format!("~{MAIN_SEPARATOR}");
        assert_eq!(offered("~"), std::slice::from_ref(&tilde));
        assert_eq!(
            offered(&format!("{tilde}roo")),
            [
                format!("{tilde}roofs{MAIN_SEPARATOR}"),
                format!("{tilde}rooms.mcap")
            ]
        );
        assert_eq!(offered(&format!("{tilde}x")), [""; 0]);
    }

    #[test]
    fn what_all_have_in_common_is_typed_for_you() {
        let common = |paths: &[&str]| {
            let paths: Vec<_> = paths.iter().map(|&path| path.to_owned()).collect();
            common_beginning(&paths)
        };
        assert_eq!(common(&[]), None);
        assert_eq!(common(&["ab"]).as_deref(), Some("ab"));
        assert_eq!(common(&["räume", "rätsel", "räder"]).as_deref(), Some("rä"));
        assert_eq!(common(&["a", "b"]).as_deref(), Some(""));
    }
}
