//! Typed paths: `~` is the home folder, as in a shell; completion offers folders, and files that may be recordings.

use std::fs;
use std::path::{MAIN_SEPARATOR, Path, PathBuf, is_separator};
use std::time::SystemTime;

use recording::Format;

/// Limit of read entries of a folder.
const MAX_LOOKED_AT: usize = 5_000;
/// Limit of offered recordings and of offered folders.
const MAX_OFFERED: usize = 10;
const ENDINGS: [&str; 2] = ["mcap", "bag"];
/// Extensions of CARMEN logs, and of many other files: these are opened.
const LOG_ENDINGS: [&str; 2] = ["log", "clf"];
/// Limit of opened files.
const MAX_OPENED: usize = 50;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Completions {
    /// Recordings, most recently changed first; then folders by name with a trailing separator. A leading `~/` is kept.
    pub(super) offered: Vec<String>,
    /// What else there is, in words.
    pub(super) more: Option<String>,
    /// Longest common beginning of all completions, offered or not.
    pub(super) common: Option<String>,
}

pub(super) fn completions(typed: &str) -> Completions {
    completions_of(typed, home().as_deref())
}

fn completions_of(typed: &str, home: Option<&Path>) -> Completions {
    if typed == "~" && home.is_some() {
        let folder = format!("~{MAIN_SEPARATOR}");
        return Completions {
            offered: vec![folder.clone()],
            more: None,
            common: Some(folder),
        };
    }
    let folder_end = typed.rfind(MAIN_SEPARATOR).map_or(0, |at| at + 1);
    let (folder, beginning) = typed.split_at(folder_end);
    let read_from = match folder {
        "" => Path::new(".").to_owned(),
        _ => within(folder, home),
    };
    let Found {
        recordings,
        folders,
        unknown,
    } = Found::in_folder(&read_from, beginning);
    let [recordings, folders] = [recordings, folders].map(|names| {
        let paths = names.iter().map(|name| format!("{folder}{name}"));
        paths.collect::<Vec<_>>()
    });
    let offered = |paths: &[String]| paths.iter().take(MAX_OFFERED).cloned().collect::<Vec<_>>();
    Completions {
        offered: [offered(&recordings), offered(&folders)].concat(),
        more: more([recordings.len(), folders.len()], unknown),
        common: common_beginning(&[recordings, folders].concat()),
    }
}

struct Found {
    recordings: Vec<String>,
    folders: Vec<String>,
    /// Files above the limit of opened files, which may be recordings.
    unknown: usize,
}

impl Found {
    fn in_folder(folder: &Path, beginning: &str) -> Self {
        let read = fs::read_dir(folder);
        let entries = read.into_iter().flatten().flatten().take(MAX_LOOKED_AT);
        let mut folders = Vec::new();
        let mut files: Vec<(Option<SystemTime>, String)> = Vec::new();
        for entry in entries {
            let Ok(name) = entry.file_name().into_string() else {
                continue;
            };
            let is_hidden = name.starts_with('.') && !beginning.starts_with('.');
            if is_hidden || !name.starts_with(beginning) {
                continue;
            }
            // Follows links.
            let about = fs::metadata(entry.path()).ok();
            if about.as_ref().is_some_and(fs::Metadata::is_dir) {
                folders.push(format!("{name}{MAIN_SEPARATOR}"));
            } else if ends_with(&name, &ENDINGS) || ends_with(&name, &LOG_ENDINGS) {
                let changed = about.and_then(|about| about.modified().ok());
                files.push((changed, name));
            }
        }
        folders.sort();
        files.sort_by(|(changed, name), (other_changed, other)| {
            other_changed.cmp(changed).then_with(|| name.cmp(other))
        });
        let (mut opened, mut unknown) = (0, 0);
        files.retain(|(_, name)| {
            if !ends_with(name, &LOG_ENDINGS) {
                return true;
            }
            if opened == MAX_OPENED {
                unknown += 1;
                return false;
            }
            opened += 1;
            is_recording(&folder.join(name))
        });
        Self {
            recordings: files.into_iter().map(|(_, name)| name).collect(),
            folders,
            unknown,
        }
    }
}

fn more([recordings, folders]: [usize; 2], unknown: usize) -> Option<String> {
    let left_out = |found: usize, kind: &str| {
        let count = found.saturating_sub(MAX_OFFERED);
        (count, format!("more {kind}"))
    };
    let left_out = [
        left_out(recordings, "recording"),
        left_out(folders, "folder"),
        (unknown, "unread log".to_owned()),
    ];
    let left_out = left_out.into_iter().filter(|(count, _)| *count > 0);
    let parts: Vec<_> = left_out
        .map(|(count, what)| match count {
            1 => format!("1 {what}"),
            _ => format!("{count} {what}s"),
        })
        .collect();
    (!parts.is_empty()).then(|| format!("{}: type how a name begins", parts.join(", ")))
}

fn common_beginning(completions: &[String]) -> Option<String> {
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

/// By its first bytes. A pipe is no recording, and reading it would block.
fn is_recording(path: &Path) -> bool {
    path.is_file() && Format::of(path).is_ok()
}

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

fn within(typed: &str, home: Option<&Path>) -> PathBuf {
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
    use std::time::Duration;

    use super::*;

    /// Writes a file with a modification time this many seconds ago.
    fn write(path: &Path, content: &str, age_s: u64) {
        fs::write(path, content).unwrap();
        let file = fs::File::options().append(true).open(path).unwrap();
        let now = file.metadata().unwrap().modified().unwrap();
        file.set_modified(now - Duration::from_secs(age_s)).unwrap();
    }

    #[test]
    fn folders_and_recordings_are_offered() {
        let folder = tempfile::tempdir().unwrap();
        for (age_s, name) in [
            "räume.log",
            "room.txt",
            "rooms.MCAP",
            ".rooms.bag",
            "rooms.log",
            "roof.mcap",
        ]
        .into_iter()
        .enumerate()
        {
            let begins_with = match name {
                "räume.log" => {
                    "# message_name [message contents]\nFLASER 2 0.5 0.6 0 0 0 0 0 0 1.0 a 1.0\n"
                }
                _ => "Nov 22 18:20:42 a machine's own log\n",
            };
            write(&folder.path().join(name), begins_with, age_s as u64);
        }
        fs::create_dir(folder.path().join("rover")).unwrap();
        let root = format!("{}{MAIN_SEPARATOR}", folder.path().display());
        let offered = |typed: &str| {
            let all = completions(&format!("{root}{typed}"));
            assert_eq!(all.more, None);
            let names = all
                .offered
                .iter()
                .map(|path| path.strip_prefix(&root).unwrap().to_owned());
            names.collect::<Vec<_>>()
        };
        let rover = format!("rover{MAIN_SEPARATOR}");
        assert_eq!(
            offered(""),
            ["räume.log", "rooms.MCAP", "roof.mcap", &rover]
        );
        assert_eq!(offered("roo"), ["rooms.MCAP", "roof.mcap"]);
        assert_eq!(offered("."), [".rooms.bag"]);
        assert_eq!(offered("x"), [""; 0]);
        assert_eq!(offered("gone/x"), [""; 0]);
    }

    #[test]
    fn home_paths_keep_their_tilde() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("rooms.mcap"), "").unwrap();
        fs::create_dir(home.path().join("roofs")).unwrap();
        let offered = |typed: &str| completions_of(typed, Some(home.path())).offered;
        let tilde = format!("~{MAIN_SEPARATOR}");
        assert_eq!(offered("~"), std::slice::from_ref(&tilde));
        assert_eq!(
            offered(&format!("{tilde}roo")),
            [
                format!("{tilde}rooms.mcap"),
                format!("{tilde}roofs{MAIN_SEPARATOR}")
            ]
        );
        assert_eq!(offered(&format!("{tilde}x")), [""; 0]);
    }

    #[test]
    fn newest_completions_are_offered_and_rest_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..14_u64 {
            let path = folder.path().join(format!("lake-{number:02}.mcap"));
            write(&path, "", 14 - number);
            if number < 11 {
                fs::create_dir(folder.path().join(format!("maps-{number:02}"))).unwrap();
            }
        }
        for old in ["lamp.bag", "rooms.bag"] {
            write(&folder.path().join(old), "", 1_000);
        }
        let root = format!("{}{MAIN_SEPARATOR}", folder.path().display());
        let all = completions(&root);
        let newest = (4..14).rev();
        let newest = newest.map(|number| format!("{root}lake-{number:02}.mcap"));
        let folders = (0..10).map(|number| format!("{root}maps-{number:02}{MAIN_SEPARATOR}"));
        assert_eq!(all.offered, newest.chain(folders).collect::<Vec<_>>());
        assert_eq!(
            all.more.as_deref(),
            Some("6 more recordings, 1 more folder: type how a name begins")
        );
        // Tab completes no further than all completions agree, offered or not.
        assert_eq!(all.common, Some(root.clone()));
        let some = completions(&format!("{root}l"));
        assert_eq!(some.common, Some(format!("{root}la")));
        assert_eq!(completions(&format!("{root}lake-0")).more, None);
    }

    #[test]
    fn unread_logs_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        for number in 0..MAX_OPENED + 2 {
            write(&folder.path().join(format!("{number}.log")), "text", 0);
        }
        let all = completions(&format!("{}{MAIN_SEPARATOR}", folder.path().display()));
        assert_eq!(all.offered, [""; 0]);
        let more = all.more.unwrap();
        assert_eq!(more, "2 unread logs: type how a name begins");
    }

    #[test]
    fn common_beginning_is_completed() {
        let common = |paths: &[&str]| {
            let paths: Vec<_> = paths.iter().map(|&path| path.to_owned()).collect();
            common_beginning(&paths)
        };
        assert_eq!(common(&[]), None);
        assert_eq!(common(&["ab"]).as_deref(), Some("ab"));
        assert_eq!(common(&["räume", "rätsel", "räder"]).as_deref(), Some("rä"));
        assert_eq!(common(&["a", "b"]).as_deref(), Some(""));
    }

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
