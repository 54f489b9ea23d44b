//! The settings file: location, reading, and atomic writing in the background.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use etcetera::BaseStrategy as _;
use network::clock;
use serde_json::Value;

use super::{Settings, VERSION};
use crate::lock;

/// A settings file has some kilobytes.
const MAX_BYTES: u64 = 1 << 20;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ConfigPath {
    /// Settings are neither read nor written.
    #[default]
    None,
    File(PathBuf),
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Read {
    pub settings: Settings,
    pub complaint: Option<String>,
}

pub fn default_file() -> Option<PathBuf> {
    let folders = etcetera::choose_base_strategy().ok()?;
    Some(folders.config_dir().join("foreshore").join("console.json"))
}

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

/// `None` if there is no file.
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
    let version = version.ok_or("it does not say its version")?;
    if version > u64::from(VERSION) {
        return Err(format!(
            "it was written by a newer version of this program (format {version}, known is {VERSION})"
        ));
    }
    let mut settings: Settings =
        serde_json::from_value(value).map_err(|error| error.to_string())?;
    settings.version = VERSION;
    let mended = settings.repair();
    Ok(Some((settings, mended)))
}

/// Writes a temporary file and renames it, so that the file is always complete, also after a crash.
pub(super) fn write(path: &Path, settings: &Settings) -> io::Result<()> {
    // The parent of a bare name is empty.
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut bytes = serde_json::to_vec_pretty(settings)?;
    bytes.push(b'\n');
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    // Two consoles may write at once.
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
    // The rename is durable when the folder is synced.
    File::open(folder)?.sync_all()
}

fn aside(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let label = clock::wall_clock_label().replace(':', "");
    path.with_file_name(format!("{stem}.unusable-{label}.json"))
}

const PERIOD: Duration = Duration::from_secs(1);

/// Writes settings in a thread. Dropping it writes what is pending.
pub struct SettingsWriter {
    shared: Arc<Shared>,
    saved: Settings,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// The newest settings that are not written yet.
    waiting: Option<Settings>,
    is_closing: bool,
    problem: Option<String>,
}

impl SettingsWriter {
    /// Saves to `path` what differs from `saved`, its present content.
    pub fn start(path: PathBuf, saved: Settings) -> Self {
        let shared = Arc::new(Shared::default());
        let thread = thread::spawn({
            let shared = Arc::clone(&shared);
            move || run(&shared, &path)
        });
        Self {
            shared,
            saved,
            thread: Some(thread),
        }
    }

    /// Saves the settings if they changed. Does not block.
    pub fn save(&mut self, settings: Settings) {
        if settings == self.saved {
            return;
        }
        self.saved = settings.clone();
        lock(&self.shared.state).waiting = Some(settings);
        self.shared.changed.notify_one();
    }

    pub fn take_problem(&self) -> Option<String> {
        lock(&self.shared.state).problem.take()
    }
}

impl Drop for SettingsWriter {
    fn drop(&mut self) {
        lock(&self.shared.state).is_closing = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that writes settings failed");
        }
    }
}

fn run(shared: &Shared, path: &Path) {
    let mut state = lock(&shared.state);
    // Only a new problem is reported.
    let mut last_problem = None;
    loop {
        if let Some(settings) = state.waiting.take() {
            drop(state);
            let started = clock::now();
            let written = write(path, &settings);
            state = lock(&shared.state);
            let problem = written.err().map(|why| {
                let path = path.display();
                format!("Settings cannot be saved to {path}: {why}")
            });
            let is_new = problem != last_problem;
            last_problem.clone_from(&problem);
            if let Some(problem) = problem.filter(|_| is_new) {
                tracing::warn!("{problem}");
                state.problem = Some(problem);
            }
            while !state.is_closing {
                let rest = PERIOD.saturating_sub(clock::elapsed(started));
                if rest.is_zero() {
                    break;
                }
                (state, _) = shared
                    .changed
                    .wait_timeout(state, rest)
                    .unwrap_or_else(PoisonError::into_inner);
            }
        } else if state.is_closing {
            return;
        } else {
            state = shared
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }
}
