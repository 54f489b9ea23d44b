//! A recording that this process maps and shows as a robot, with playback control.
//!
//! It runs the vehicle's mapping code and a network link on this machine.

mod open_dialog;
mod path_completion;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread;

use anyhow::Context as _;
use clap::Parser as _;
use edge::cli::{Cli, Command, Replay, VehicleOptions};
use edge::pacer::Rate;
use edge::replay_control::{ReplayControl, ReplayState, ReplayStatus, TimelineMark};
use edge::runtime::choice::{Choice, ChoiceNeeded};
use eframe::egui::{
    Align2, Area, Context, Frame, HoveredFile, Id, Label, Order, RichText, TextWrapMode,
};
use measurement::time::RobotDuration;
use network::random_id;
use protocol::keys::RobotId;
use recording::Format;

use crate::demo::free_endpoint;
use crate::link::FoundRobot;
use crate::model::ConsoleModel;
use crate::panels::timeline::clock;

pub use open_dialog::OpenDialog;
pub(crate) use path_completion::{absolute, home, typed_path};

const PREFIX: &str = "recording-";
/// Bandwidth for tiles on this machine's loopback.
const BUDGET: &str = "streaming.budget_kbps=200000";

#[derive(Clone, Debug, PartialEq)]
pub struct ToOpen {
    pub path: PathBuf,
    /// Vehicle options for this file, applied each time it is opened.
    pub setup: VehicleOptions,
    pub rate: Rate,
}

/// Why a recording is not shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    pub text: String,
    /// With one of these options it can be shown.
    pub choices: Vec<Choice>,
}

/// An open recording. Dropping it closes it.
pub struct Playback {
    path: PathBuf,
    setup: VehicleOptions,
    robot: FoundRobot,
    control: ReplayControl,
    is_over: Arc<AtomicBool>,
    failed: Receiver<anyhow::Error>,
    failure: Option<Failure>,
    is_failure_reported: bool,
    damage: Damage,
    trail: (u64, Vec<[f64; 2]>),
}

impl Playback {
    /// Opens a recording and starts to map it. Errors behind its first bytes appear later in [`Self::failure`].
    pub fn open(path: &Path, setup: &VehicleOptions, rate: Rate) -> anyhow::Result<Self> {
        Format::of(path)?;
        let endpoint = free_endpoint().context("no port is free for the recording")?;
        let robot: RobotId = name(random_id()?).parse()?;
        let replay = replay(path, setup, &robot, &endpoint)?;
        let control = ReplayControl::new(rate);
        let is_over = Arc::new(AtomicBool::new(false));
        let (sender, failed) = sync_channel(1);
        // Not joined: it may still read a large file.
        let playing = thread::Builder::new().name("playback".to_owned());
        playing.spawn({
            let (control, is_over) = (control.clone(), Arc::clone(&is_over));
            move || {
                if let Err(why) = edge::runtime::play(&replay, &control, &is_over) {
                    // The channel has room for the only failure.
                    drop(sender.try_send(why));
                }
            }
        })?;
        Ok(Self {
            path: path.to_owned(),
            setup: setup.clone(),
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

    pub const fn robot(&self) -> &FoundRobot {
        &self.robot
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn file_name(&self) -> String {
        let name = self.path.file_name().unwrap_or(self.path.as_os_str());
        name.to_string_lossy().into_owned()
    }

    pub fn status(&self) -> ReplayStatus {
        self.control.status()
    }

    pub fn update_damage(&mut self, status: &ReplayStatus) {
        self.damage.update(&status.marks);
    }

    pub fn take_new_damage(&mut self) -> Vec<String> {
        self.damage.take_unreported(|mark| clock(mark.at))
    }

    /// Passes the complete trail to the model, which may have received only parts of it.
    pub fn show_trail(&mut self, model: &mut ConsoleModel) {
        if let Some(trail) = self.control.trail(self.trail.0) {
            self.trail = trail;
        }
        model.show_trail(self.trail.1.iter().copied());
    }

    pub fn execute(&self, command: PlaybackCommand) -> bool {
        command.apply_to(&self.control)
    }

    pub fn failure(&mut self) -> Option<&Failure> {
        if let Ok(why) = self.failed.try_recv() {
            self.failure = Some(failure(&why));
        }
        self.failure.as_ref()
    }

    /// The options with which the recording is opened after a choice.
    pub fn setup_with(&self, choice: usize) -> Option<VehicleOptions> {
        let choices = &self.failure.as_ref()?.choices;
        Some(self.setup.with(choices.get(choice)?))
    }

    pub fn take_failure(&mut self) -> Option<Failure> {
        let failure = self.failure().cloned();
        let is_reported = std::mem::replace(&mut self.is_failure_reported, failure.is_some());
        failure.filter(|_| !is_reported)
    }
}

impl Drop for Playback {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
    }
}

fn failure(why: &anyhow::Error) -> Failure {
    match why.downcast_ref::<ChoiceNeeded>() {
        Some(needed) => Failure {
            text: needed.question.clone(),
            choices: needed.choices.clone(),
        },
        None => Failure {
            text: with_advice(in_words(why)),
            choices: Vec::new(),
        },
    }
}

/// Adds a hint to messages about vehicle options.
fn with_advice(words: String) -> String {
    const OPTIONS: [&str; 3] = ["--set ", "--topic ", "--vehicle "];
    if OPTIONS.iter().any(|option| words.contains(option)) {
        format!("{words} (beside --open; `robot-edge info FILE` says all that it needs)")
    } else {
        words
    }
}

/// An error and its causes without repetitions.
pub(crate) fn in_words(error: &anyhow::Error) -> String {
    let mut words = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !words.contains(&cause) {
            words = format!("{words}: {cause}");
        }
    }
    words
}

/// Whether this is the name of a recording that a console of this machine has open.
pub fn is_recording(robot: &RobotId) -> bool {
    robot.to_string().starts_with(PREFIX)
}

/// Random, so that consoles do not show each other's recordings.
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
    // Set directly: a file name must not be parsed as an option.
    path.clone_into(&mut replay.recording);
    let budget = std::mem::replace(&mut replay.mapping.setup, setup.clone()).settings;
    replay.mapping.setup.settings.splice(..0, budget);
    Ok(replay)
}

/// Kind of timeline marks for unreadable data.
const LOSS: &str = "loss";

#[derive(Debug, Default)]
struct Damage {
    known: Vec<TimelineMark>,
    unreported: Vec<TimelineMark>,
}

impl Damage {
    fn update(&mut self, marks: &[TimelineMark]) {
        let losses = marks.iter().filter(|mark| mark.kind == LOSS);
        if losses.clone().count() == self.known.len() {
            return;
        }
        for mark in losses {
            if !self.known.contains(mark) {
                self.known.push(mark.clone());
                self.unreported.push(mark.clone());
            }
        }
    }

    /// Damage that was not reported yet: position and kind.
    fn take_unreported(&mut self, clock: impl Fn(&TimelineMark) -> String) -> Vec<String> {
        let unreported = std::mem::take(&mut self.unreported);
        let words = |mark: &TimelineMark| format!("damaged at {}: {}", clock(mark), mark.message);
        unreported.iter().map(words).collect()
    }
}

pub fn drop_hint_ui(ctx: &Context) {
    let Some(words) = ctx.input(|input| words(&input.raw.hovered_files)) else {
        return;
    };
    let width = 520.0_f32.min(ctx.content_rect().width() - 40.0);
    Area::new(Id::unique("drop hint"))
        .order(Order::Tooltip)
        .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
        .interactable(false)
        .show(ctx, |ui| {
            Frame::popup(ui.style()).inner_margin(20).show(ui, |ui| {
                ui.set_max_width(width);
                let label = Label::new(RichText::new(words).heading());
                ui.add(label.wrap_mode(TextWrapMode::Wrap));
            });
        });
}

/// Only the first of several files is opened.
fn words(files: &[HoveredFile]) -> Option<String> {
    let path = files.first()?.path.as_deref();
    let name = path.and_then(Path::file_name);
    let name = name.map_or_else(|| "it".into(), |name| name.to_string_lossy());
    Some(match files.len() {
        1 => format!("Drop to open {name}"),
        count => format!("Drop to open {name}, the first of {count} files"),
    })
}

pub const RATES: [Rate; 7] = [
    Rate::Times(0.25),
    Rate::Times(0.5),
    Rate::Times(1.0),
    Rate::Times(2.0),
    Rate::Times(5.0),
    Rate::Times(10.0),
    Rate::Max,
];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaybackCommand {
    Play,
    Pause,
    PlayOrPause,
    SetRate(Rate),
    Slower,
    Faster,
    SetLooping(bool),
    ToggleLooping,
    Seek(RobotDuration),
    Step(RobotDuration),
    /// Opens the recording again with the nth choice of its [`Failure`].
    Choose(usize),
    Close,
}

impl PlaybackCommand {
    pub(super) fn apply_to(self, control: &ReplayControl) -> bool {
        match self {
            Self::Play => control.play(),
            Self::Pause => control.pause(),
            Self::PlayOrPause => {
                if is_playing(&control.status()) {
                    control.pause();
                } else {
                    control.play();
                }
            }
            Self::SetRate(rate) => control.set_rate(rate),
            Self::Slower => control.set_rate(neighbour(control.status().rate, false)),
            Self::Faster => control.set_rate(neighbour(control.status().rate, true)),
            Self::SetLooping(is_looping) => control.set_looping(is_looping),
            Self::ToggleLooping => control.set_looping(!control.status().is_looping),
            Self::Seek(to) => control.seek(to),
            Self::Step(by) => control.step(by),
            Self::Choose(_) | Self::Close => return false,
        }
        true
    }
}

pub fn is_playing(status: &ReplayStatus) -> bool {
    !status.is_paused && status.state != ReplayState::Ended
}

fn neighbour(rate: Rate, is_faster: bool) -> Rate {
    let speed = |rate: Rate| match rate {
        Rate::Times(times) => times,
        Rate::Max => f64::INFINITY,
    };
    let next = if is_faster {
        RATES.into_iter().find(|other| speed(*other) > speed(rate))
    } else {
        let mut slower = RATES.into_iter().rev();
        slower.find(|other| speed(*other) < speed(rate))
    };
    next.unwrap_or(rate)
}

#[cfg(test)]
mod tests {
    use edge::config::Override;
    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use measurement::time::RobotDuration;

    use super::*;

    #[test]
    fn invalid_file_is_rejected_with_message() {
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
        // The window's own value comes first, so that options can override it.
        let [budget, rest @ ..] = &replay.mapping.setup.overrides()[..] else {
            panic!("nothing is set");
        };
        assert_eq!(*budget, BUDGET.parse().unwrap());
        assert_eq!(rest, setup.overrides());
    }

    #[test]
    fn message_names_helpful_options() {
        let says = "several topics carry scans. Choose one, for example --topic laser=/rear_scan";
        let words = with_advice(says.to_owned());
        assert!(
            words.starts_with(says) && words.contains("beside --open; `robot-edge info FILE` says"),
            "{words}"
        );
        assert_eq!(with_advice("it is empty".to_owned()), "it is empty");
    }

    #[test]
    fn each_damage_is_reported_once() {
        let mark = |s: i64, kind| TimelineMark {
            at: RobotDuration::from_millis(1000 * s),
            kind,
            message: format!("byte {s}"),
        };
        let mut damage = Damage::default();
        let mut reported = |marks: &[TimelineMark]| {
            damage.update(marks);
            damage.take_unreported(|mark| format!("{} s", mark.at.as_secs_f64()))
        };
        assert_eq!(reported(&[mark(3, "gap")]), [""; 0]);
        assert_eq!(
            reported(&[mark(3, "gap"), mark(9, LOSS)]),
            ["damaged at 9 s: byte 9"]
        );
        // Marks are in the order of the data, not of their arrival.
        let all = [mark(3, "gap"), mark(5, LOSS), mark(9, LOSS)];
        assert_eq!(reported(&all), ["damaged at 5 s: byte 5"]);
        assert_eq!(reported(&all), [""; 0]);
    }

    fn held(path: &str) -> HoveredFile {
        HoveredFile {
            path: Some(path.into()),
            ..HoveredFile::default()
        }
    }

    #[test]
    fn dragged_file_is_named() {
        let mut harness = Harness::builder()
            .with_size(vec2(700.0, 500.0))
            .build_ui(|ui| drop_hint_ui(ui.ctx()));
        harness.run();
        assert!(harness.query_by_label_contains("Drop").is_none());
        harness.input_mut().hovered_files = vec![held("/home/anna/rooms.mcap")];
        harness.run_steps(2);
        harness.get_by_label("Drop to open rooms.mcap");
        let files = ["/a/yard.bag", "/a/rooms.mcap"].map(held);
        harness.input_mut().hovered_files = files.to_vec();
        harness.run_steps(2);
        harness.get_by_label("Drop to open yard.bag, the first of 2 files");
        harness.input_mut().hovered_files.clear();
        harness.run_steps(2);
        assert!(harness.query_by_label_contains("Drop").is_none());
    }

    #[test]
    fn a_file_without_a_name_can_be_dropped_too() {
        assert_eq!(words(&[]), None);
        let nameless = [HoveredFile::default()];
        assert_eq!(words(&nameless).as_deref(), Some("Drop to open it"));
    }

    #[test]
    fn toggle_plays_pauses_and_restarts() {
        let control = ReplayControl::new(Rate::Times(1.0));
        for is_paused in [true, false, true] {
            assert!(PlaybackCommand::PlayOrPause.apply_to(&control));
            assert_eq!(control.status().is_paused, is_paused);
        }
        let ended = ReplayStatus {
            state: ReplayState::Ended,
            is_paused: false,
            ..control.status()
        };
        assert!(!is_playing(&ended), "it is played from the beginning");
    }

    #[test]
    fn rate_and_loop_commands_are_relative() {
        let control = ReplayControl::new(Rate::Times(1.0));
        for (command, rate) in [
            (PlaybackCommand::Faster, 2.0),
            (PlaybackCommand::Faster, 5.0),
            (PlaybackCommand::Slower, 2.0),
        ] {
            assert!(command.apply_to(&control));
            assert_eq!(control.status().rate, Rate::Times(rate));
        }
        for is_looping in [true, false] {
            assert!(PlaybackCommand::ToggleLooping.apply_to(&control));
            assert_eq!(control.status().is_looping, is_looping);
        }
        assert!(!PlaybackCommand::Close.apply_to(&control));
    }

    #[test]
    fn speeds_have_neighbours() {
        let chain = |is_faster: bool, mut rate: Rate| {
            for _ in 0..10 {
                rate = neighbour(rate, is_faster);
            }
            rate
        };
        assert_eq!(chain(true, RATES[0]), Rate::Max);
        assert_eq!(chain(false, Rate::Max), RATES[0]);
        assert_eq!(neighbour(Rate::Times(3.0), true), Rate::Times(5.0));
        assert_eq!(neighbour(Rate::Times(3.0), false), Rate::Times(2.0));
    }
}
