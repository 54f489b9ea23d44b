//! An operator's desk: a screen, the console on it as its users start it, and a folder that is their home.

use std::fs;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use robot_edge::clock;
use tempfile::{TempDir, tempdir};

use crate::link::controls::{Control, Controls};
use crate::link::processes::{Running, program};
use crate::link::screen::{Screen, skip_without_window};

/// Where pictures of the steps go; kept as documentation where it is `docs/day`.
const PICTURES: &str = "FORESHORE_DAY_PICTURES";

pub(super) struct Desktop {
    pub(super) screen: Screen,
    pub(super) controls: Controls,
    pub(super) home: TempDir,
    arguments: Vec<String>,
    console: Option<(Running, u32)>,
    pictures: PathBuf,
}

impl Desktop {
    /// `None`, said aloud, where no window can be opened here.
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

    /// Starts the console with one argument more; false, said aloud, where it can open no window.
    pub(super) fn start(&mut self, last: &str) -> bool {
        let mut command = program("operator-console");
        self.screen.show(&mut command);
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
        // A folder that is shown would lie over the window.
        command.env_remove("XDG_CURRENT_DESKTOP");
        let mut console = Running::start(command.args(&self.arguments).arg(last), "the window");
        let window = self.screen.window("Foreshore", || !console.is_running());
        let Some(window) = window else {
            let (_, said) = console.end();
            skip_without_window(&said);
            return false;
        };
        self.screen.focus(window);
        self.console = Some((console, window));
        true
    }

    /// Waits until the console has ended, which must be well.
    pub(super) fn wait_for_exit(&mut self) {
        let (console, _) = self.console.take().expect("a console");
        console.ends_well();
        fs::remove_file(&self.controls.0).unwrap();
    }

    /// Clicks a button or anything else that is pressed.
    pub(super) fn click(&self, role: &str, words: &str) {
        self.screen.click(self.controls.named(role, words).middle());
    }

    /// Does something until something is seen that begins so: a window that was just opened may miss the first keys, and
    /// what moves is missed by the pointer. Anybody would do it again.
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

    /// The map.
    pub(super) fn map(&self) -> Control {
        self.controls.wait_for("the map", |all| {
            let mut all = all.iter();
            all.find(|control| control.role == "Canvas").cloned()
        })
    }

    /// Keeps what the screen looks like now.
    pub(super) fn picture(&self, name: &str) {
        // What was clicked last is drawn, and what came up slowly has come.
        sleep(Duration::from_millis(500));
        self.screen
            .picture(&self.pictures.join(format!("{name}.png")));
    }

    /// The one file or folder of that name's end, somewhere in the operator's home.
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

/// As a hand does between two things: what was done is drawn meanwhile.
pub(super) fn settle() {
    sleep(Duration::from_millis(400));
}
