//! `--open`: a recording that this process maps and shows like any robot, wound and paced from the window.
//!
//! The mapping code is the vehicle's own, and so is the way to the screen: a link, over this machine's own network.

mod command;
mod damage;
mod drop_hint;
mod open_dialog;
mod path_completion;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use anyhow::Context as _;
use clap::Parser as _;
use protocol::keys::RobotId;
use recording::Format;
use robot_edge::cli::{Cli, Command, Replay, VehicleOptions};
use robot_edge::link::random_id;
use robot_edge::pacer::Rate;
use robot_edge::replay_control::{ReplayControl, ReplayStatus};

use crate::demo::free_endpoint;
use crate::link::FoundRobot;
use crate::model::ConsoleModel;
use crate::panels::timeline::clock;

use damage::Damage;

pub use command::{PlaybackCommand, RATES, is_playing};
pub use drop_hint::drop_hint_ui;
pub use open_dialog::OpenDialog;

/// How the robots begin that are recordings.
const PREFIX: &str = "recording-";
/// Tiles' share of a link that never leaves this machine, kilobits per second.
const BUDGET: &str = "streaming.budget_kbps=200000";

/// A recording to show from the start on.
#[derive(Clone, Debug, PartialEq)]
pub struct ToOpen {
    /// The file.
    pub path: PathBuf,
    /// For which vehicle it is mapped, each time that it is opened.
    pub setup: VehicleOptions,
    /// How fast.
    pub rate: Rate,
}

/// A recording that is open. Dropping it closes it.
pub struct Playback {
    path: PathBuf,
    robot: FoundRobot,
    control: ReplayControl,
    is_over: Arc<AtomicBool>,
    failed: Receiver<anyhow::Error>,
    failure: Option<String>,
    is_failure_reported: bool,
    damage: Damage,
    /// Where the vehicle was, and the version of that.
    trail: (u64, Vec<[f64; 2]>),
}

impl Playback {
    /// Opens a recording and begins to map it for this vehicle, at this rate. What is wrong behind its first bytes is said later, by
    /// [`Self::failure`].
    ///
    /// # Errors
    /// Where the file cannot be read or is no recording, or no port of this machine is free.
    pub fn open(path: &Path, setup: &VehicleOptions, rate: Rate) -> anyhow::Result<Self> {
        Format::of(path)?;
        let endpoint = free_endpoint().context("no port is free for the recording")?;
        let robot: RobotId = name(random_id()?).parse()?;
        let replay = replay(path, setup, &robot, &endpoint)?;
        let control = ReplayControl::new(rate);
        let is_over = Arc::new(AtomicBool::new(false));
        let (sender, failed) = sync_channel(1);
        // Nobody waits for its end: it may be looking through a large file, and leaves nothing behind.
        let playing = thread::Builder::new().name("playback".to_owned());
        playing.spawn({
            let (control, is_over) = (control.clone(), Arc::clone(&is_over));
            move || {
                if let Err(why) = robot_edge::app::play(&replay, &control, &is_over) {
                    // The channel has room for the one failure there can be.
                    drop(sender.try_send(why));
                }
            }
        })?;
        Ok(Self {
            path: path.to_owned(),
            robot: FoundRobot { robot, endpoint },
            control,
            is_over,
            failed,
            failure: None,
            is_failure_reported: false,
            damage: Damage::default(),
            trail: (0, Vec::new()),
        })
    }

    /// Where what is mapped can be seen: a robot of its own.
    pub const fn robot(&self) -> &FoundRobot {
        &self.robot
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's name.
    pub fn file_name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        name.to_string_lossy().into_owned()
    }

    /// How it is going.
    pub fn status(&self) -> ReplayStatus {
        self.control.status()
    }

    /// Looks for what could not be read, in what it was seen to do.
    pub fn update_damage(&mut self, status: &ReplayStatus) {
        self.damage.update(&status.marks);
    }

    /// What of that nobody was told yet, in words.
    pub fn take_new_damage(&mut self) -> Vec<String> {
        self.damage.take_unreported(|mark| clock(mark.at))
    }

    /// Shows the way of the vehicle in the model of it, which may have heard only now and then where it was.
    pub fn show_trail(&mut self, model: &mut ConsoleModel) {
        if let Some(trail) = self.control.trail(self.trail.0) {
            self.trail = trail;
        }
        model.show_trail(self.trail.1.iter().copied());
    }

    /// Does what was asked for; whether it stays open.
    pub fn execute(&self, command: PlaybackCommand) -> bool {
        command.apply_to(&self.control)
    }

    /// Why nothing more comes, in words.
    pub fn failure(&mut self) -> Option<&str> {
        if let Ok(why) = self.failed.try_recv() {
            self.failure = Some(with_advice(in_words(&why)));
        }
        self.failure.as_deref()
    }

    /// The same, once.
    pub fn take_failure(&mut self) -> Option<String> {
        let failure = self.failure().map(str::to_owned);
        let is_told = std::mem::replace(&mut self.is_failure_reported, failure.is_some());
        failure.filter(|_| !is_told)
    }
}

impl Drop for Playback {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

/// Where options help, where they go.
fn with_advice(words: String) -> String {
    const OPTIONS: [&str; 3] = ["--set ", "--topic ", "--vehicle "];
    if OPTIONS.iter().any(|option| words.contains(option)) {
        format!("{words} (beside --open; `robot-edge info FILE` says all that it needs)")
    } else {
        words
    }
}

/// An error and its causes, as far as its own words do not hold them.
pub(crate) fn in_words(error: &anyhow::Error) -> String {
    let mut words = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !words.contains(&cause) {
            words = format!("{words}: {cause}");
        }
    }
    words
}

/// Whether this is the name of a recording that some console of this machine has open, and of no robot.
pub fn is_recording(robot: &RobotId) -> bool {
    robot.to_string().starts_with(PREFIX)
}

/// Another for each, so that no two consoles of a network show each other's recordings.
fn name(random: [u8; 16]) -> String {
    let [a, b, c, ..] = random;
    format!("{PREFIX}{a:02x}{b:02x}{c:02x}")
}

fn replay(
    path: &Path,
    setup: &VehicleOptions,
    robot: &RobotId,
    endpoint: &str,
) -> anyhow::Result<Replay> {
    let robot = robot.to_string();
    let line = ["robot-edge", "replay", "-", "--robot", &robot];
    let line = line.into_iter().chain(["--listen", endpoint]);
    let cli = Cli::try_parse_from(line.chain(["--set", BUDGET]))?;
    let Command::Replay(mut replay) = cli.command else {
        return Err(anyhow::anyhow!("this is no replay: {:?}", cli.command));
    };
    // Apart, since no name of a file is an option here.
    path.clone_into(&mut replay.recording);
    let budget = std::mem::replace(&mut replay.mapping.setup, setup.clone()).settings;
    replay.mapping.setup.settings.splice(..0, budget);
    Ok(replay)
}

#[cfg(test)]
mod tests {
    use robot_edge::config::Override;

    use super::*;

    #[test]
    fn what_is_no_recording_is_refused_at_once_and_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let text = folder.path().join("notes.txt");
        std::fs::write(&text, "these are notes").unwrap();
        for (path, says) in [
            (text.as_path(), "not a recording this program reads"),
            (folder.path(), "this is a folder"),
            (&folder.path().join("gone.mcap"), "gone.mcap"),
        ] {
            let setup = VehicleOptions::default();
            let why = Playback::open(path, &setup, Rate::Max)
                .map(drop)
                .unwrap_err();
            let words = in_words(&why);
            assert!(words.contains(says), "{words}");
            assert!(words.matches("os error").count() <= 1, "{words}");
        }
    }

    #[test]
    fn any_file_name_and_a_robot_of_its_own() {
        let robot: RobotId = name([7; 16]).parse().unwrap();
        let endpoint = "tcp/127.0.0.1:7000";
        let setup = VehicleOptions {
            settings: vec!["localization.source=static".parse().unwrap()],
            topics: vec![Override::topic("laser=/rear_scan").unwrap()],
            ..VehicleOptions::default()
        };
        let replay = replay(Path::new("--help"), &setup, &robot, endpoint).unwrap();
        assert!(is_recording(&robot));
        assert_eq!(replay.recording, Path::new("--help"));
        assert_eq!(replay.mapping.robot, Some(robot));
        assert_eq!(replay.mapping.network.listen, [endpoint]);
        // What the window needs comes first: whoever opens it may say otherwise.
        let [budget, rest @ ..] = &replay.mapping.setup.overrides()[..] else {
            panic!("nothing is set");
        };
        assert_eq!(*budget, BUDGET.parse().unwrap());
        assert_eq!(rest, setup.overrides());
    }

    #[test]
    fn where_options_help_it_is_said_where_they_go() {
        let says = "several topics carry scans. Choose one, for example --topic laser=/rear_scan";
        let words = with_advice(says.to_owned());
        assert!(
            words.starts_with(says) && words.contains("beside --open; `robot-edge info FILE` says"),
            "{words}"
        );
        assert_eq!(with_advice("it is empty".to_owned()), "it is empty");
    }
}
