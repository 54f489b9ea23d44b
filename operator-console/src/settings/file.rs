//! The settings file: found, read, and written so that it is whole whatever happens.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use etcetera::BaseStrategy as _;
use robot_edge::clock;
use serde_json::Value;

use super::{Settings, VERSION};

/// A settings file is some kilobytes; a greater one is not ours.
const MAX_BYTES: u64 = 1 << 20;

/// Where settings are kept.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ConfigPath {
    /// Nowhere: nothing is read, nothing is written.
    #[default]
    None,
    /// In this file.
    File(PathBuf),
}

/// What a file said.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Read {
    /// The settings.
    pub settings: Settings,
    /// What of the file could not be used and where it is now, in words.
    pub complaint: Option<String>,
}

/// The operator's settings file: `foreshore/console.json` in the folder that the system has for such files.
pub fn default_file() -> Option<PathBuf> {
    let folders = etcetera::choose_base_strategy().ok()?;
    Some(folders.config_dir().join("foreshore").join("console.json"))
}

/// Reads settings. What cannot be read is moved aside, so that it is not lost, and defaults are used.
pub fn read(path: &Path) -> Read {
    let why = match parse(path) {
        Ok(None) => return Read::default(),
        Ok(Some((settings, mended))) => {
            let complaint = (!mended.is_empty()).then(|| {
                let mended = mended.join("; ");
                format!("{}: {mended}. Defaults are used instead.", path.display())
            });
            return Read {
                settings,
                complaint,
            };
        }
        Err(why) => why,
    };
    let aside = aside(path);
    let moved = match fs::rename(path, &aside) {
        Ok(()) => format!("It is kept as {}.", aside.display()),
        Err(error) => format!("It cannot be moved aside ({error}) and will be replaced."),
    };
    Read {
        settings: Settings::default(),
        complaint: Some(format!(
            "The settings of {} cannot be used: {why}. {moved} Defaults are used.",
            path.display()
        )),
    }
}

/// `None` where there is no file.
fn parse(path: &Path) -> Result<Option<(Settings, Vec<String>)>, String> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error.to_string()),
    };
    let mut bytes = Vec::new();
    file.take(MAX_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(format!("it is longer than {MAX_BYTES} bytes"));
    }
    let value: Value = serde_json::from_slice(&bytes).map_err(|error| error.to_string())?;
    let version = value.get("version").and_then(Value::as_u64);
    match version {
        Some(version) if version > u64::from(VERSION) => {
            return Err(format!(
                "it was written by a newer version of this program (format {version}, known is {VERSION})"
            ));
        }
        Some(_) => {}
        None => return Err("it does not say its version".to_owned()),
    }
    let mut settings: Settings =
        serde_json::from_value(value).map_err(|error| error.to_string())?;
    settings.version = VERSION;
    let mended = settings.repair();
    Ok(Some((settings, mended)))
}

/// Writes settings beside the file, onto the disk, and then in its place: whenever the program or the computer stops, the
/// file is the old one or the new one.
///
/// # Errors
/// Where the file system refuses.
pub(super) fn write(path: &Path, settings: &Settings) -> io::Result<()> {
    // Of a bare name the parent is empty, and no folder that could be opened.
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut bytes = serde_json::to_vec_pretty(settings)?;
    bytes.push(b'\n');
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // Two consoles may write at once; each has its own.
    let temporary = folder.join(format!(".{name}.{}", std::process::id()));
    let written = (|| {
        let mut file = File::create(&temporary)?;
        file.write_all(&bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    })();
    if written.is_err() {
        drop(fs::remove_file(&temporary));
    }
    written?;
    // The new name is on the disk when its folder is.
    File::open(folder)?.sync_all()
}

fn aside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let label = clock::wall_clock_label().replace(':', "");
    path.with_file_name(format!("{stem}.unusable-{label}.json"))
}
