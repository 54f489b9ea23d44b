mod braking;
mod grants;
mod input_hints;
mod key_state;
mod limit_reason;
mod notice;
mod read_only;
mod requested_motion;
mod restarted;
mod stationary_boat;
mod strictest_limit;

use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::message::{
    Answer, Arming, Barrier, BarrierKind, Clamp, CollisionMonitorState, EStopStatus, Info, Pose,
    Refusal, RefusedCount, SpeedLimits, Status, StopReason, TeleopState, TeleopStatus,
};

use super::*;
use crate::model::{ConsoleModel, RequestId};
use crate::teleop_client::{EStopState, Lease, RequestKind, TeleopClientState, TeleopNotification};
use crate::teleop_input::{DriveInput, InputLockReason};
use crate::test_support::{
    at, idle_teleop_client, idle_teleop_status, inject, inject_reply, scout,
};
use crate::theme::Tone;

/// A robot that stands, and of which everything is told at 1 s.
struct Rig {
    teleop: TeleopStatus,
    teleop_client: TeleopClientState,
    is_boat: bool,
    velocity: [f32; 2],
    now: Monotonic,
}

impl Rig {
    fn new() -> Self {
        Self {
            teleop: idle_teleop_status(),
            teleop_client: idle_teleop_client(),
            is_boat: false,
            velocity: [0.0; 2],
            now: at(1_100),
        }
    }

    /// Anna drives forwards, and gets half of what she asks for.
    fn driving() -> Self {
        let mut rig = Self::new();
        rig.teleop_client.lease = Lease::Held(4);
        rig.teleop_client.drive_input.forward = 0.8;
        rig.teleop.state = TeleopState::Driving;
        rig.teleop.lease.holder = Some("anna".parse().unwrap());
        rig.teleop.arming = Arming::Pressed;
        rig.teleop.requested.linear_mps = 0.8;
        rig.teleop.applied.linear_mps = 0.4;
        rig.teleop.clamp = Some(Clamp::CollisionMonitor);
        rig.teleop.age_ms = Some(40);
        rig.teleop.peak_age_ms = Some(90);
        rig.velocity = [0.4, 0.0];
        rig
    }

    fn model(&self) -> ConsoleModel {
        let mut model = scout();
        let info = Info {
            vehicle: "rover".to_owned(),
            source: String::new(),
            footprint_m: [0.6, 0.4],
            limits: [1.0, 5.0],
            is_boat: self.is_boat,
            ..Info::default()
        };
        let [speed_mps, turn_rate_radps] = self.velocity;
        let pose = Pose {
            position_m: [0.0; 3],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            speed_mps,
            turn_rate_radps,
            token: None,
        };
        let status = Status {
            teleop: Some(self.teleop.clone()),
            ..Status::default()
        };
        let now = at(1_000);
        inject_reply(&mut model, RequestId(0), Topic::Info, &info, now);
        inject(&mut model, Topic::Pose, &pose, now);
        inject(&mut model, Topic::Status, &status, now);
        model
    }

    fn data(&self) -> DrivingData {
        DrivingData::new(&self.model(), &self.teleop_client, self.now).unwrap()
    }

    fn row(&self, name: &str) -> Option<(Tone, String)> {
        let rows = self.data().rows.into_iter();
        let mut found = rows.filter(|(_, (of, _))| of == name);
        found.next().map(|(tone, (_, value))| (tone, value))
    }

    /// What a click on the button of this label asks for.
    fn click(&self, label: &str) -> Option<Command> {
        let data = self.data();
        let mut window = Harness::builder()
            .with_size(vec2(320.0, 800.0))
            .build_ui_state(
                move |ui, asked: &mut Option<Command>| {
                    let mut entry = DrivingEntry::default();
                    if let Some(command) = driving_ui(ui, &data, &mut entry) {
                        *asked = Some(command);
                    }
                },
                None,
            );
        window.run_steps(2);
        window.get_by_label(label).click();
        window.run_steps(2);
        window.state().clone()
    }
}

fn lease(request: LeaseRequest) -> Command {
    Command::Drive(Intent::Lease(request))
}

#[test]
fn a_robot_that_nobody_drives_is_offered() {
    let rig = Rig::new();
    let data = rig.data();
    assert_eq!(
        (data.headline.as_str(), data.tone),
        ("Standing", Tone::Waiting)
    );
    assert_eq!(data.driver, "Nobody drives");
    assert_eq!(
        (data.lease, &data.estop),
        (LeaseButtons::Free, &EStopButton::Ready)
    );
    assert!(data.is_at_rest());
    assert_eq!(
        rig.click("Request control"),
        Some(lease(LeaseRequest::Request))
    );
    let step = Command::Drive(Intent::Step(SpeedStep::new(5).unwrap()));
    assert_eq!(rig.click("5"), Some(step));
}

#[test]
fn what_is_asked_for_what_is_applied_and_what_holds_it_back_are_seen() {
    let rig = Rig::driving();
    let data = rig.data();
    assert_eq!((data.headline.as_str(), data.tone), ("Driving", Tone::Good));
    assert_eq!(data.driver, "You drive (anna)");
    assert_eq!(
        data.clamp.as_deref(),
        Some("Limited by the collision monitor")
    );
    let [speed, turning] = data.gauges.as_ref().unwrap();
    assert_eq!(
        (speed.requested, speed.applied, speed.limit),
        (0.8, 0.4, 1.0)
    );
    assert!(speed.is_held_back() && !turning.is_held_back());
    assert_eq!(speed.figures, "0.40 of 0.80 m/s");
    let mut left = Rig::driving();
    left.teleop.requested.angular_radps = 0.5;
    left.teleop.applied.angular_radps = 0.25;
    let [_, turning] = left.data().gauges.unwrap();
    assert_eq!(turning.figures, "14 of 29 °/s left");
    // To the left is on the left.
    assert!(turning.applied < -14.0 && turning.requested < -28.0);
    assert!((turning.limit - 1.5_f32.to_degrees()).abs() < 1e-3);
    let age = Some((Tone::Good, "40 ms, at most 90 ms".to_owned()));
    assert_eq!(rig.row("Command age"), age);
    assert_eq!(rig.row("Keys"), Some((Tone::Good, "Active".to_owned())));
    assert!(!data.is_at_rest());
    assert_eq!(
        rig.click("Release control"),
        Some(lease(LeaseRequest::Release))
    );

    let mut equal = Rig::driving();
    equal.teleop.applied = equal.teleop.requested;
    assert_eq!(equal.data().clamp, None);
    let mut old = Rig::driving();
    old.teleop.peak_age_ms = Some(260);
    assert_eq!(old.row("Command age").unwrap().0, Tone::Warning);
}

#[test]
fn a_lost_link_is_no_pause() {
    for driving in [true, false] {
        let mut rig = if driving { Rig::driving() } else { Rig::new() };
        rig.now = at(1_601);
        let data = rig.data();
        assert_eq!(data.headline, "Link lost for 0.6 s");
        assert_eq!(data.tone, Tone::Warning);
        assert!(data.advice.is_some());
        assert_eq!((data.gauges.as_ref(), data.clamp.as_ref()), (None, None));
        assert_eq!(data.settings, None);
        // The robot gives up the lease of whom it does not hear.
        let driver = if driving {
            "You drove (anna)"
        } else {
            "Nobody drives"
        };
        assert_eq!(data.driver, driver);
        let (_, first) = &data.rows[0];
        assert_eq!(first.1, "as of 0.6 s ago");
        // The emergency stop can be pressed all the same.
        assert_eq!(
            rig.click("EMERGENCY STOP"),
            Some(Command::Drive(Intent::EStop))
        );
    }
}

#[test]
fn whoever_asks_for_the_helm_is_a_question() {
    let mut rig = Rig::driving();
    rig.teleop.lease.waiting = Some("bert".parse().unwrap());
    let bert = || "bert".parse().unwrap();
    assert_eq!(rig.data().handover_request, Some(bert()));
    assert_eq!(
        rig.click("Hand over"),
        Some(lease(LeaseRequest::HandOver(bert())))
    );
    assert_eq!(
        rig.click("Keep control"),
        Some(lease(LeaseRequest::Refuse(bert())))
    );
    rig.teleop_client.lease = Lease::None;
    assert_eq!(rig.data().handover_request, None, "others are not asked");
}

#[test]
fn who_does_not_drive_may_ask_or_take_over() {
    let mut rig = Rig::driving();
    rig.teleop.lease.holder = Some("bert".parse().unwrap());
    rig.teleop_client.lease = Lease::None;
    assert_eq!(rig.data().driver, "bert drives");
    assert_eq!(
        rig.click("Request handover"),
        Some(lease(LeaseRequest::Request))
    );
    assert_eq!(rig.click("Take over"), Some(lease(LeaseRequest::TakeOver)));
    rig.teleop_client.lease = Lease::Waiting {
        after: 3,
        since: at(0),
    };
    assert_eq!(
        rig.click("Cancel request"),
        Some(lease(LeaseRequest::Release))
    );
    rig.teleop_client.lease = Lease::None;
    rig.teleop.lease.holder = Some("anna".parse().unwrap());
    assert_eq!(rig.data().driver, "anna drives, from another console");
}

#[test]
fn an_emergency_stop_is_seen_from_press_to_reset() {
    let mut rig = Rig::driving();
    rig.teleop_client.estop = EStopState::Sending(std::time::Duration::from_millis(700));
    let sending = EStopButton::Sending("Not acknowledged for 0.7 s".to_owned());
    assert_eq!(rig.data().estop, sending);
    rig.teleop_client.estop = EStopState::Quiet;
    rig.teleop.state = TeleopState::EStop;
    rig.velocity = [0.0; 2];
    rig.teleop.estop = Some(EStopStatus {
        number: 3,
        is_stored: false,
    });
    assert_eq!(rig.data().headline, "Emergency stop");
    rig.teleop.last_stop = Some(StopReason::Released);
    let stop = Some((Tone::Warning, "emergency stop 3".to_owned()));
    assert_eq!(rig.row("Last stop"), stop);
    assert_eq!(rig.click("Reset e-stop"), None, "it is not stored yet");
    rig.teleop.estop = Some(EStopStatus {
        number: 3,
        is_stored: true,
    });
    assert_eq!(
        rig.click("Reset e-stop"),
        Some(Command::Drive(Intent::Reset(3)))
    );
    rig.teleop.estop = None;
    rig.teleop_client.estop = EStopState::Refused(Refusal::Role);
    let refused = EStopButton::Refused("the sender's role does not allow it".to_owned());
    assert_eq!(rig.data().estop, refused);
}

#[test]
fn a_vehicle_that_moves_untold_does_not_stand() {
    for (state, headline, tone) in [
        (TeleopState::Idle, "Moving by itself", Tone::Waiting),
        (TeleopState::Held, "Moving without command", Tone::Warning),
        (TeleopState::EStop, "Emergency stop", Tone::Warning),
    ] {
        let mut rig = Rig::new();
        rig.teleop.state = state;
        rig.velocity = [-0.55, 0.0];
        let data = rig.data();
        assert_eq!((data.headline.as_str(), data.tone), (headline, tone));
        assert!(data.advice.unwrap().contains("−0.55 m/s"));
        let figures = data.gauges.unwrap().map(|gauge| gauge.figures);
        if state == TeleopState::Idle {
            assert_eq!(figures, ["–", "–"], "nothing was asked for");
        } else {
            assert_eq!(figures, ["0.00 of 0.00 m/s", "0 of 0 °/s"]);
        }
    }
    let mut boat = Rig::new();
    boat.teleop.is_drifting = true;
    boat.velocity = [0.2, 0.0];
    assert_eq!(boat.data().headline, "Drifting");
    assert_eq!(boat.data().tone, Tone::Warning);
    // No usual current does that.
    boat.velocity = [1.5, 0.0];
    let data = boat.data();
    assert_eq!(
        (data.headline.as_str(), data.tone),
        ("Moving or adrift", Tone::Warning)
    );
    let advice = "Nobody drives it from here: 1.50 m/s";
    assert_eq!(data.advice.as_deref(), Some(advice));
    // Who let go at speed goes on for a while.
    boat.teleop.state = TeleopState::Held;
    assert_eq!(boat.data().headline, "Drifting");
}

#[test]
fn keys_that_go_elsewhere_are_not_said_to_be_ready() {
    for is_boat in [false, true] {
        let mut rig = Rig::driving();
        rig.teleop.state = TeleopState::Held;
        rig.teleop.arming = Arming::Neutral;
        rig.teleop.is_drifting = is_boat;
        rig.teleop_client.drive_input = DriveInput::NEUTRAL;
        rig.velocity = [0.0; 2];
        let ready = Some((Tone::Waiting, "Ready".to_owned()));
        assert_eq!(rig.row("Keys"), ready);
        rig.teleop_client.is_ready = false;
        let advice = Some("Keyboard focus is elsewhere. Click into the map to drive".to_owned());
        assert_eq!(rig.data().advice, advice, "on water: {is_boat}");
        let elsewhere = Some((Tone::Warning, "No focus: click into the map".to_owned()));
        assert_eq!(rig.row("Keys"), elsewhere);
    }
}

#[test]
fn keys_that_are_ignored_are_said_to_be_and_why() {
    let mut rig = Rig::driving();
    rig.teleop.state = TeleopState::Held;
    rig.velocity = [0.0; 2];
    rig.teleop_client.ignored = Some(InputLockReason::Focus);
    let advice = rig.data().advice.unwrap();
    assert_eq!(advice, "Release all keys: the window lost focus");
    rig.teleop_client.ignored = Some(InputLockReason::Stopped);
    let by_itself = "Release all keys: the robot stopped by itself";
    assert_eq!(rig.data().advice.unwrap(), by_itself);
    rig.teleop.last_stop = Some(StopReason::CollisionMonitorStale);
    let advice = rig.data().advice.unwrap();
    assert_eq!(
        advice,
        format!("{by_itself}, the monitor's data came too late")
    );
    rig.teleop.last_stop = Some(StopReason::Released);
    assert_eq!(rig.data().advice.unwrap(), by_itself);
    rig.teleop_client.ignored = None;
    rig.teleop.arming = Arming::Locked;
    assert_eq!(
        rig.data().advice.unwrap(),
        "Release all keys, then press again"
    );
    for guard in [CollisionMonitorState::Stale, CollisionMonitorState::Silent] {
        rig.teleop.collision_monitor = guard;
        let advice = rig.data().advice.unwrap();
        assert!(advice.starts_with("The guard's data is late, so nothing moves"));
    }
}

#[test]
fn the_guard_and_the_last_stop_are_always_seen() {
    let limits = |forward_mps| SpeedLimits {
        forward_mps,
        reverse_mps: f32::INFINITY,
        left_radps: f32::INFINITY,
        right_radps: f32::INFINITY,
    };
    for (guard, tone, words) in [
        (CollisionMonitorState::Off, Tone::Warning, "Off"),
        (
            CollisionMonitorState::Silent,
            Tone::Warning,
            "Silent: nothing moves",
        ),
        (
            CollisionMonitorState::On(limits(0.25)),
            Tone::Good,
            "On, ahead ≤ 0.25 m/s",
        ),
        // As fast as it goes, and none at all.
        (
            CollisionMonitorState::On(limits(1.0)),
            Tone::Good,
            "On, ahead is free",
        ),
        (
            CollisionMonitorState::On(limits(f32::INFINITY)),
            Tone::Good,
            "On, ahead is free",
        ),
        (
            CollisionMonitorState::On(limits(0.0)),
            Tone::Good,
            "On, ahead is blocked",
        ),
        (
            CollisionMonitorState::UnknownSpace(limits(0.25)),
            Tone::Warning,
            "Unknown ground, ahead ≤ 0.25 m/s",
        ),
        // Of another way than that.
        (
            CollisionMonitorState::UnknownSpace(limits(1.0)),
            Tone::Warning,
            "Unknown ground",
        ),
        (
            CollisionMonitorState::Stale,
            Tone::Warning,
            "Its data is late: nothing moves",
        ),
    ] {
        let mut rig = Rig::new();
        rig.teleop.state = TeleopState::Held;
        rig.teleop.collision_monitor = guard;
        rig.teleop.last_stop = Some(StopReason::Age);
        assert_eq!(rig.row("Guard"), Some((tone, words.to_owned())));
        let stop = Some((Tone::Warning, "commands too old".to_owned()));
        assert_eq!(rig.row("Last stop"), stop);
        // Nobody drives: it may go its own way.
        rig.teleop.state = TeleopState::Idle;
        let says = rig.row("Guard").unwrap().1;
        assert_eq!(says, words.trim_end_matches(": nothing moves"));
    }
}

#[test]
fn who_drives_is_told_what_is_in_the_way() {
    for (kind, words) in [
        (BarrierKind::Detected, "detected now (ringed)"),
        (BarrierKind::Mapped, "on the map (ringed)"),
        (BarrierKind::Unknown, "unknown ground (ringed)"),
        (BarrierKind::Shallow, "too shallow (ringed)"),
        (BarrierKind::NoReturn, "no echo (ringed)"),
    ] {
        let mut rig = Rig::driving();
        assert_eq!(rig.row("Obstacle"), Some((Tone::Waiting, "–".to_owned())));
        let position_m = [3.0, 1.0];
        rig.teleop.barrier = Some(Barrier { position_m, kind });
        let expected = Some((Tone::Warning, words.to_owned()));
        assert_eq!(rig.row("Obstacle"), expected);
        rig.teleop_client.lease = Lease::None;
        assert_eq!(rig.row("Obstacle"), None, "somebody else drives");
    }
}

#[test]
fn who_drives_is_told_when_each_side_was_looked_at() {
    let mut rig = Rig::driving();
    rig.teleop.ground_age_ms = [Some(40), Some(2_900), Some(61_000), None];
    let words = "ahead now, left 2 s, behind 61 s, right never".to_owned();
    let limits = SpeedLimits {
        forward_mps: 1.0,
        reverse_mps: 1.0,
        left_radps: 1.0,
        right_radps: 1.0,
    };
    for (guard, row) in [
        (CollisionMonitorState::Off, None),
        (
            CollisionMonitorState::UnknownSpace(limits),
            Some((Tone::Good, words)),
        ),
    ] {
        rig.teleop.collision_monitor = guard;
        assert_eq!(rig.row("Last observed"), row, "{guard:?}");
    }
}

#[test]
fn what_was_refused_is_counted_by_reason_and_settings_are_asked_for() {
    let mut rig = Rig::new();
    rig.teleop.counters.refused = vec![RefusedCount {
        reason: Refusal::TooOld,
        count: 1_234,
    }];
    let expected = ("1\u{a0}234".to_owned(), "it is too old".to_owned());
    assert_eq!(rig.data().refused, [expected]);
    let data = rig.data();
    let mut window = Harness::builder()
        .with_size(vec2(320.0, 900.0))
        .build_ui_state(
            move |ui, asked: &mut Option<Command>| {
                let mut entry = DrivingEntry::default();
                if let Some(command) = driving_ui(ui, &data, &mut entry) {
                    *asked = Some(command);
                }
            },
            None,
        );
    window.run_steps(2);
    window.get_by_label("Settings of the robot").click();
    window.run_steps(30);
    window.get_by_label("Collision monitor").click();
    window.run_steps(2);
    let set = Command::Drive(Intent::Set(Setting::CollisionMonitor(true)));
    assert_eq!(window.state().clone(), Some(set));
}

#[test]
fn what_was_not_expected_is_said() {
    let mut rig = Rig::driving();
    assert_eq!(rig.data().notice, None);
    for (note, says) in [
        (TeleopNotification::LeaseLost, "Lease lost"),
        (
            TeleopNotification::EStopNotInForce,
            "The emergency stop is not active: it was refused, or reset since",
        ),
        (
            TeleopNotification::LeaseEndedByReset,
            "The reset ended driving: press Request control again",
        ),
        (
            TeleopNotification::Answered(RequestKind::Reset(3), Answer::Refused(Refusal::Role)),
            "Reset of emergency stop 3 refused: the sender's role does not allow it",
        ),
        (
            TeleopNotification::Answered(
                RequestKind::Lease(LeaseRequest::Request),
                Answer::Refused(Refusal::Signature),
            ),
            "Lease request refused: your name and key are not on this vehicle's list of operators",
        ),
        (
            TeleopNotification::RequestTimedOut(RequestKind::Lease(LeaseRequest::Request)),
            "Lease request: no answer",
        ),
    ] {
        rig.teleop_client.notice = Some(note);
        assert_eq!(rig.data().notice.as_deref(), Some(says));
    }
}

#[test]
fn the_emergency_stop_is_in_sight_however_small_the_window_is() {
    let data = Rig::driving().data();
    let mut window = Harness::builder()
        .with_size(vec2(320.0, 160.0))
        .build_ui(move |ui| {
            driving_ui(ui, &data, &mut DrivingEntry::default());
        });
    window.run_steps(2);
    window.hover_at(eframe::egui::pos2(160.0, 120.0));
    window.event(eframe::egui::Event::MouseWheel {
        unit: eframe::egui::MouseWheelUnit::Point,
        delta: vec2(0.0, -1000.0),
        phase: eframe::egui::TouchPhase::Move,
        source: eframe::egui::MouseWheelSource::Unknown,
        modifiers: eframe::egui::Modifiers::NONE,
    });
    window.run_steps(30);
    let button = window.get_by_label("EMERGENCY STOP").rect();
    assert!(button.top() >= 0.0 && button.bottom() <= 80.0, "{button:?}");
    let scrolled = window.get_by_label("Release control").rect();
    assert!(
        scrolled.bottom() < button.bottom(),
        "it did not scroll: {scrolled:?}"
    );
}
