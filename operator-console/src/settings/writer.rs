//! Writes settings in the background: the window's loop, which drives, never waits for a disk.

use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::locks::lock;
use robot_edge::clock;

use super::repeat_filter::RepeatFilter;
use super::{Settings, file};

/// Between two writes at least.
const PERIOD: Duration = Duration::from_secs(1);

/// Keeps settings in a file. Dropping it writes what is not written yet.
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
    /// The newest settings, until they are written: those before matter no more.
    waiting: Option<Settings>,
    is_closing: bool,
    problem: Option<String>,
}

impl SettingsWriter {
    /// Keeps in `path` what differs from `saved`, which is what that file says.
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

    /// Keeps these, where they are others than before. Returns at once.
    pub fn save(&mut self, settings: Settings) {
        if settings == self.saved {
            return;
        }
        self.saved = settings.clone();
        lock(&self.shared.state).waiting = Some(settings);
        self.shared.changed.notify_one();
    }

    /// Why settings cannot be written, once until it is another reason, or they could be written in between.
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

fn run(shared: &Shared, path: &std::path::Path) {
    let mut state = lock(&shared.state);
    let mut repeat_filter = RepeatFilter::default();
    loop {
        if let Some(settings) = state.waiting.take() {
            drop(state);
            let started = clock::now();
            let written = file::write(path, &settings);
            state = lock(&shared.state);
            let problem = written.err().map(|why| {
                let path = path.display();
                format!("Settings cannot be kept in {path}: {why}")
            });
            if let Some(problem) = repeat_filter.only_new(problem) {
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
