//! A console on a virtual screen, with a home folder of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use tempfile::{TempDir, tempdir};

use crate::link::controls::{Control, Controls};
use crate::link::processes::{Running, program};
use crate::link::screen::Screen;

/// Folder for pictures of the steps; `docs/day` renews those of the documentation.
const PICTURES: &str = "FORESHORE_DAY_PICTURES";

pub(super) struct Desktop {
    pub(super) screen: Screen,
    pub(super) controls: Controls,
    pub(super) home: TempDir,
    arguments: Vec<String>,
    console: Option<Running>,
    pictures: PathBuf,
}

impl Desktop {
    /// `None`, and a skipped test, if no window can be opened.
    pub(super) fn new(arguments: &[&str], last: &str) -> Option<Self> {
        let screen = Screen::open()?;
        let home = tempdir().unwrap();
        let named = std::env::var_os(PICTURES).map(PathBuf::from);
        let pictures = named.unwrap_or_else(|| std::env::temp_dir().join("foreshore_day"));
        fs::create_dir_all(&pictures).unwrap();
        let mut desktop = Self {
            screen,
            controls: Controls(home.path().join("controls")),
            home,
            arguments: arguments.iter().map(|&word| word.to_owned()).collect(),
            console: None,
            pictures,
        };
        desktop.start(last).then_some(desktop)
    }

    /// Starts the console with one more argument; false, and a skipped test, if no window can be opened.
    pub(super) fn start(&mut self, last: &str) -> bool {
        let mut command = program("operator-console");
        command.arg("--controls").arg(&self.controls.0);
        let home = self.home.path();
        for (name, folder) in [
            ("HOME", ""),
            ("XDG_CONFIG_HOME", "config"),
            ("XDG_DATA_HOME", "data"),
            ("XDG_DOCUMENTS_DIR", "documents"),
            ("XDG_PICTURES_DIR", "pictures"),
        ] {
            command.env(name, home.join(folder));
        }
        // A file manager would cover the window.
        command.env_remove("XDG_CURRENT_DESKTOP");
        command.args(&self.arguments).arg(last);
        let opened = self.screen.open_console(&mut command);
        self.console = opened.map(|(console, _window)| console);
        self.console.is_some()
    }

    /// Waits until the console has ended without an error.
    pub(super) fn wait_for_exit(&mut self) {
        let console = self.console.take().expect("a console");
        console.ends_well();
        fs::remove_file(&self.controls.0).unwrap();
    }

    /// Clicks the control of this role and text.
    pub(super) fn click(&self, role: &str, words: &str) {
        self.screen.click(self.controls.named(role, words).middle());
    }

    /// Repeats `act` until a control's text begins with `wanted`: a new window may miss the first keys, and the pointer may
    /// miss a control that moves.
    pub(super) fn retry_until_shown(&self, wanted: &str, act: impl Fn()) -> Control {
        let find = || {
            let all = self.controls.all();
            all.into_iter()
                .find(|control| control.words.starts_with(wanted))
        };
        for _attempt in 0..5 {
            act();
            let started = clock::now();
            while clock::elapsed(started) < Duration::from_secs(3) {
                if let Some(control) = find() {
                    return control;
                }
                sleep(Duration::from_millis(20));
            }
        }
        self.controls.beginning(wanted)
    }

    pub(super) fn map(&self) -> Control {
        self.controls.wait_for("the map", |all| {
            let mut all = all.iter();
            all.find(|control| control.role == "Canvas").cloned()
        })
    }

    /// Saves a picture of the screen.
    pub(super) fn picture(&self, name: &str) {
        // Animations have ended.
        sleep(Duration::from_millis(500));
        self.screen
            .picture(&self.pictures.join(format!("{name}.png")));
    }

    /// The only file below the home folder whose path ends so.
    pub(super) fn find(&self, end: &str) -> PathBuf {
        fn within(folder: &Path, end: &str, found: &mut Vec<PathBuf>) {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.to_string_lossy().ends_with(end) {
                    found.push(path);
                } else if path.is_dir() {
                    within(&path, end, found);
                }
            }
        }
        let mut found = Vec::new();
        within(self.home.path(), end, &mut found);
        assert_eq!(found.len(), 1, "{end}: {found:?}");
        found.remove(0)
    }
}

/// Waits until the last action is drawn.
pub(super) fn settle() {
    sleep(Duration::from_millis(400));
}
