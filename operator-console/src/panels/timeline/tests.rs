use edge::cli::VehicleOptions;
use edge::pacer::Rate;
use edge::replay_control::{Length, ReplayState, ReplayStatus, TimelineMark};
use eframe::egui::{Modifiers, PointerButton, Pos2, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use super::*;

fn seconds(s: f64) -> RobotDuration {
    RobotDuration::from_secs_f64(s)
}

/// A recording of 116 s at its own speed.
fn status() -> ReplayStatus {
    ReplayStatus {
        state: ReplayState::Playing,
        position: seconds(29.06),
        length: Some(Length {
            duration: seconds(116.0),
            is_estimate: false,
        }),
        has_no_clock: false,
        rate: Rate::Times(1.0),
        rate_reached: Some(1.0),
        is_paused: false,
        is_looping: false,
        is_settled: false,
        marks: vec![
            TimelineMark {
                at: seconds(12.5),
                kind: "ground_plane",
                message: "the ground plane was reset".to_owned(),
            },
            TimelineMark {
                at: seconds(58.0),
                kind: "gap",
                message: "no data for 8 s".to_owned(),
            },
        ],
        restarts: 0,
    }
}

fn data(status: &ReplayStatus) -> TimelineData {
    TimelineData::new("rooms.mcap", status, None)
}

fn words(status: &ReplayStatus) -> String {
    let data = data(status);
    let length = data.length.unwrap_or_else(|| "?".to_owned());
    format!("{} | {} / {length}", data.state, data.position)
}

#[test]
fn replay_states() {
    let check = |change: &dyn Fn(&mut ReplayStatus), expected: &str| {
        let mut status = status();
        change(&mut status);
        assert_eq!(words(&status), expected);
    };
    check(&|_| {}, "Playing | 0:29.0 / 1:56.0");
    check(
        &|s| s.rate_reached = Some(0.95),
        "Playing | 0:29.0 / 1:56.0",
    );
    check(
        &|s| (s.rate, s.rate_reached) = (Rate::Times(10.0), Some(4.26)),
        "Only 4.3× of 10× reached | 0:29.0 / 1:56.0",
    );
    check(
        &|s| (s.rate, s.rate_reached) = (Rate::Max, Some(312.4)),
        "Playing at 312× | 0:29.0 / 1:56.0",
    );
    check(
        &|s| s.has_no_clock = true,
        "Its clock cannot be used: scans are mapped in the order of the file | 0:29.0 / ?",
    );
    check(
        &|s| s.state = ReplayState::Paused,
        "Paused | 0:29.0 / 1:56.0",
    );
    check(
        &|s| {
            let to = seconds(90.0);
            (s.state, s.rate_reached) = (ReplayState::Seeking { to }, Some(120.0));
        },
        "Mapping up to 1:30.0 at 120× | 0:29.0 / 1:56.0",
    );
    check(
        &|s| (s.state, s.position) = (ReplayState::Ended, seconds(116.0)),
        "At the end | 1:56.0 / 1:56.0",
    );
    check(
        &|s| {
            (s.state, s.length) = (ReplayState::Opening, None);
            s.position = RobotDuration::ZERO;
        },
        "Looking through rooms.mcap | 0:00.0 / ?",
    );
    check(
        &|s| {
            s.length = Some(Length {
                duration: seconds(7383.25),
                is_estimate: true,
            });
        },
        "Playing | 0:29.0 / about 2:03:03.2",
    );
}

#[test]
fn marks_show_time_text_and_faults() {
    let marks = data(&status()).marks;
    let shown: Vec<_> = marks.iter().map(|m| (m.is_fault, &*m.words)).collect();
    assert_eq!(
        shown,
        [
            (false, "0:12.5  ground plane: the ground plane was reset"),
            (true, "0:58.0  gap: no data for 8 s"),
        ]
    );
}

struct State {
    data: TimelineData,
    commands: Vec<PlaybackCommand>,
}

fn harness(data: TimelineData) -> Harness<'static, State> {
    let state = State {
        data,
        commands: Vec::new(),
    };
    let mut harness = Harness::builder()
        .with_size(vec2(1100.0, 120.0))
        .build_ui_state(
            |ui, state: &mut State| {
                let command = timeline_ui(ui, &state.data);
                state.commands.extend(command);
            },
            state,
        );
    harness.run();
    harness
}

#[test]
fn controls_have_names_and_commands() {
    let step = |s: f64| PlaybackCommand::Step(seconds(s));
    for (label, expected) in [
        ("Pause", PlaybackCommand::Pause),
        ("−10 s", step(-10.0)),
        ("−1 s", step(-1.0)),
        ("+1 s", step(1.0)),
        ("+10 s", step(10.0)),
        ("Loop", PlaybackCommand::SetLooping(true)),
        ("Close recording", PlaybackCommand::Close),
    ] {
        let mut harness = harness(data(&status()));
        harness.get_by_label(label).click();
        harness.run();
        assert_eq!(harness.state().commands, [expected], "{label}");
    }
    let mut paused = status();
    (paused.state, paused.is_paused) = (ReplayState::Paused, true);
    let mut harness = harness(data(&paused));
    harness.get_by_label("0:29.0 / 1:56.0");
    harness.get_by_label("Play").click();
    harness.run();
    assert_eq!(harness.state().commands, [PlaybackCommand::Play]);
}

#[test]
fn speeds_are_chosen_from_a_list() {
    let mut harness = harness(data(&status()));
    harness.get_by_value("Speed 1×").click();
    harness.run();
    harness.get_by_label("5×").click();
    harness.run();
    let five = PlaybackCommand::SetRate(Rate::Times(5.0));
    assert_eq!(harness.state().commands, [five]);
}

/// Middle, left and right end of the bar.
fn bar(harness: &Harness<'_, State>) -> (Pos2, f32, f32) {
    let bar = harness.get_by_label_contains("Position in the recording");
    let rect = bar.rect();
    (rect.center(), rect.left() + 8.0, rect.right() - 8.0)
}

#[test]
fn click_and_drag_on_the_bar_seek() {
    let mut harness = harness(data(&status()));
    let (middle, left, right) = bar(&harness);
    let press = |harness: &mut Harness<'_, State>, pos: Pos2, pressed: bool| {
        harness.event(eframe::egui::Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        });
    };
    let move_to = |harness: &mut Harness<'_, State>, x: f32| {
        harness.event(eframe::egui::Event::PointerMoved(pos2(x, middle.y)));
        harness.step();
    };
    move_to(&mut harness, middle.x);
    press(&mut harness, middle, true);
    harness.step();
    press(&mut harness, middle, false);
    harness.step();
    let half = PlaybackCommand::Seek(seconds(58.0));
    assert_eq!(harness.state().commands, [half]);

    harness.state_mut().commands.clear();
    press(&mut harness, middle, true);
    harness.step();
    let quarter = left + 0.25 * (right - left);
    for x in [middle.x - 30.0, quarter, quarter, left - 50.0] {
        move_to(&mut harness, x);
    }
    press(&mut harness, pos2(left - 50.0, middle.y), false);
    harness.step();
    let seeks: Vec<u64> = harness
        .state()
        .commands
        .iter()
        .map(|command| {
            let PlaybackCommand::Seek(to) = command else {
                panic!("{command:?}");
            };
            (to.as_secs_f64() * 10.0).round() as u64
        })
        .collect();
    assert_eq!(seeks.last(), Some(&0), "not before the start: {seeks:?}");
    let quarters = seeks.iter().filter(|tenths| **tenths == 290).count();
    assert_eq!(quarters, 1, "a resting pointer does not seek: {seeks:?}");
}

#[test]
fn no_seek_before_the_recording_is_open() {
    let mut opening = status();
    (opening.state, opening.length) = (ReplayState::Opening, None);
    let mut harness = harness(data(&opening));
    harness.get_by_label("Looking through rooms.mcap");
    harness.get_by_label("+1 s").click();
    harness
        .get_by_label_contains("Position in the recording")
        .click();
    harness.run();
    assert_eq!(harness.state().commands, []);
}

#[test]
fn a_failure_replaces_the_timeline() {
    let why = "rooms.mcap: damaged at byte 8: nothing can be read";
    let failure = Failure {
        text: why.to_owned(),
        choices: Vec::new(),
    };
    let mut harness = harness(TimelineData::new("rooms.mcap", &status(), Some(&failure)));
    harness.get_by_label("rooms.mcap cannot be shown");
    harness.get_by_label(why);
    assert!(harness.query_by_label("Pause").is_none());
    harness.get_by_label("Close recording").click();
    harness.run();
    assert_eq!(harness.state().commands, [PlaybackCommand::Close]);
}

#[test]
fn a_choice_has_buttons() {
    let choice = |label: &str| Choice {
        label: label.to_owned(),
        setup: VehicleOptions::default(),
    };
    let failure = Failure {
        text: "Which topic is the laser?".to_owned(),
        choices: vec![choice("/front"), choice("/rear")],
    };
    let mut harness = harness(TimelineData::new("rooms.mcap", &status(), Some(&failure)));
    harness.get_by_label("rooms.mcap needs a choice");
    harness.get_by_label("Which topic is the laser?");
    harness.get_by_label("/rear").click();
    harness.run();
    assert_eq!(harness.state().commands, [PlaybackCommand::Choose(1)]);
}
