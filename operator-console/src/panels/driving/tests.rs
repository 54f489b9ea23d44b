mod keys;
mod limits;

use std::time::Duration;

use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::message::{
    Answer, Arming, Barrier, BarrierKind, Clamp, CollisionMonitorState, EStopStatus, Event, Info,
    LeaseRequest, MotorHold, Pose, Refusal, RefusedCount, Severity, SpeedLimits, Status,
    StopReason, TeleopState, TeleopStatus, Velocity,
};
use protocol::tile::BootId;
use teleop::Role;

use super::*;
use crate::identity::{OBSERVER_HINT, OPERATOR_HINT};
use crate::model::{ConsoleModel, RequestId};
use crate::teleop_client::{EStopState, Lease, RequestKind, TeleopClientState, TeleopNotification};
use crate::teleop_input::{DriveInput, InputLockReason, SpeedStep};
use crate::test_support::{
    STORED_ESTOP, announce_boot, at, idle_teleop_client, idle_teleop_status, inject, inject_reply,
    pose_at_rest, scout, status_of,
};

const UNLIMITED: SpeedLimits = SpeedLimits {
    forward_mps: f32::INFINITY,
    reverse_mps: f32::INFINITY,
    left_mps: 0.0,
    right_mps: 0.0,
    left_radps: f32::INFINITY,
    right_radps: f32::INFINITY,
};

const fn ahead(forward_mps: f32) -> SpeedLimits {
    SpeedLimits {
        forward_mps,
        ..UNLIMITED
    }
}

fn status(teleop: &TeleopStatus) -> Status {
    status_of(teleop.clone())
}

fn warning(text: &str) -> (Tone, String) {
    (Tone::Warning, text.to_owned())
}

/// A standing robot: pose, info and status are received at 1 s.
struct Rig {
    teleop: TeleopStatus,
    teleop_client: TeleopClientState,
    is_boat: bool,
    /// Recording or simulated world; empty on a real vehicle.
    source: &'static str,
    velocity: [f32; 2],
    now: Monotonic,
}

impl Rig {
    fn new() -> Self {
        Self {
            teleop: idle_teleop_status(),
            teleop_client: idle_teleop_client(),
            is_boat: false,
            source: "",
            velocity: [0.0; 2],
            now: at(1_100),
        }
    }

    /// Anna drives forwards; half of the requested speed is applied.
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
            source: self.source.to_owned(),
            footprint_m: [0.6, 0.4],
            limits: [1.0, 0.0, 5.0],
            is_boat: self.is_boat,
            ..Info::default()
        };
        let [speed_mps, turn_rate_radps] = self.velocity;
        let pose = Pose {
            position_m: [0.0; 3],
            quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            speed_mps,
            lateral_mps: 0.0,
            turn_rate_radps,
            token: None,
        };
        let now = at(1_000);
        inject_reply(&mut model, RequestId(0), Topic::Info, &info, now);
        inject(&mut model, Topic::Pose, &pose, now);
        inject(&mut model, Topic::Status, &status(&self.teleop), now);
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

    fn window(&self, size: [f32; 2]) -> Harness<'static, Option<Command>> {
        let data = self.data();
        let mut window = Harness::builder()
            .with_size(eframe::egui::Vec2::from(size))
            .build_ui_state(
                move |ui, asked: &mut Option<Command>| {
                    let mut entry = DrivingEntry::default();
                    if let Some(command) = driving_ui(ui, &data, &mut entry) {
                        *asked = Some(command);
                    }
                },
                None,
            );
        crate::theme::set(&window.ctx);
        window.run_steps(3);
        window
    }

    fn click(&self, label: &str) -> Option<Command> {
        let mut window = self.window([320.0, 800.0]);
        window.get_by_label(label).click();
        window.run_steps(2);
        window.state().clone()
    }

    #[track_caller]
    fn assert_requests(&self, label: &str, request: LeaseRequest) {
        let expected = Some(Command::Drive(Intent::Lease(request)));
        assert_eq!(self.click(label), expected, "{label}");
    }

    fn request(&mut self, [linear_mps, angular_radps]: [f32; 2]) {
        self.teleop.requested = Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps,
        };
    }

    #[track_caller]
    fn assert_headline(&self, headline: &str, tone: Tone) {
        let data = self.data();
        assert_eq!((data.headline.as_str(), data.tone), (headline, tone));
    }
}

#[test]
fn an_idle_robot_offers_the_lease() {
    let rig = Rig::new();
    let data = rig.data();
    rig.assert_headline("Standing", Tone::Waiting);
    assert_eq!(data.driver, "Nobody drives");
    assert_eq!(
        (data.lease, &data.estop),
        (LeaseButtons::Free, &EStopButton::Ready)
    );
    assert!(data.is_at_rest());
    let ages = [rig.row("Command age"), rig.row("Age limit")];
    assert_eq!(ages, [None, None], "no commands are sent");
    let names: Vec<_> = data.link.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["Round trip", "Poses", "Status", "Map state"]);
    rig.assert_requests("Request control", LeaseRequest::Request);
    let step = Command::Drive(Intent::Step(SpeedStep::new(5).unwrap()));
    assert_eq!(rig.click("5"), Some(step));
}

#[test]
fn requested_and_applied_speed_and_limit_are_shown() {
    let rig = Rig::driving();
    let data = rig.data();
    rig.assert_headline("Driving", Tone::Good);
    assert_eq!(data.driver, "You drive (anna)");
    assert_eq!(
        data.clamp.as_deref(),
        Some("Limited by the collision monitor")
    );
    let [speed, turning] = &data.gauges.as_ref().unwrap()[..] else {
        panic!("{:?}", data.gauges)
    };
    assert_eq!(
        (speed.requested, speed.applied, speed.limit),
        (0.8, 0.4, 1.0)
    );
    assert!(speed.is_held_back() && !turning.is_held_back());
    assert_eq!(speed.figures, "0.40 of 0.80 m/s");
    let mut left = Rig::driving();
    left.teleop.requested.angular_radps = 0.5;
    left.teleop.applied.angular_radps = 0.25;
    let turning = left.data().gauges.unwrap().remove(1);
    assert_eq!(turning.figures, "14 of 29 °/s left");
    assert!(turning.applied < -14.0 && turning.requested < -28.0);
    assert!((turning.limit - 1.5_f32.to_degrees()).abs() < 1e-3);
    let age = Some((Tone::Good, "40 ms, at most 90 ms".to_owned()));
    assert_eq!(rig.row("Command age"), age);
    assert_eq!(rig.row("Keys"), Some((Tone::Good, "Active".to_owned())));
    assert!(!data.is_at_rest());
    rig.assert_requests("Release control", LeaseRequest::Release);

    let mut equal = Rig::driving();
    equal.teleop.applied = equal.teleop.requested;
    assert_eq!(equal.data().clamp, None);
    let mut old = Rig::driving();
    old.teleop.peak_age_ms = Some(260);
    assert_eq!(old.row("Command age").unwrap().0, Tone::Warning);
}

#[test]
fn a_lost_link_is_shown_and_the_estop_stays_usable() {
    for (driving, ms, lost) in [(true, 1_601, "0.6 s"), (false, 2_501, "1.5 s")] {
        let mut rig = if driving { Rig::driving() } else { Rig::new() };
        rig.now = at(ms - 2);
        assert!(!rig.data().headline.starts_with("Link lost"));
        rig.now = at(ms);
        let data = rig.data();
        rig.assert_headline(&format!("Link lost for {lost}"), Tone::Warning);
        assert!(data.advice.is_some());
        assert_eq!((data.gauges.as_ref(), data.clamp.as_ref()), (None, None));
        assert_eq!(data.settings, None);
        let driver = if driving {
            "You drove (anna)"
        } else {
            "State unknown"
        };
        assert_eq!(data.driver, driver);
        let (_, first) = &data.rows[0];
        assert_eq!(first.1, format!("as of {lost} ago"));
        assert_eq!(data.estop, EStopButton::Ready);
    }
}

#[test]
fn a_handover_request_is_shown_to_the_driver_only() {
    let mut rig = Rig::driving();
    rig.teleop.lease.waiting = Some("bert".parse().unwrap());
    let bert = || "bert".parse().unwrap();
    assert_eq!(rig.data().handover_request, Some(bert()));
    rig.assert_requests("Hand over", LeaseRequest::HandOver(bert()));
    rig.assert_requests("Keep control", LeaseRequest::Refuse(bert()));
    rig.teleop_client.lease = Lease::None;
    assert_eq!(rig.data().handover_request, None);
}

#[test]
fn others_can_request_handover_or_take_over() {
    let mut rig = Rig::driving();
    rig.teleop.lease.holder = Some("bert".parse().unwrap());
    rig.teleop_client.lease = Lease::None;
    assert_eq!(rig.data().driver, "bert drives");
    rig.assert_requests("Request handover", LeaseRequest::Request);
    rig.assert_requests("Take over", LeaseRequest::TakeOver);
    rig.teleop_client.lease = Lease::Waiting {
        after: 3,
        since: at(0),
    };
    rig.assert_requests("Cancel request", LeaseRequest::Release);
    rig.teleop_client.lease = Lease::None;
    rig.teleop.lease.holder = Some("anna".parse().unwrap());
    assert_eq!(rig.data().driver, "anna drives, from another console");
}

#[test]
fn estop_button_from_press_to_reset() {
    let mut rig = Rig::driving();
    rig.teleop_client.estop = EStopState::Sending(Duration::from_millis(700));
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
    let stop = Some(warning("emergency stop 3"));
    assert_eq!(rig.row("Last stop"), stop);
    assert_eq!(rig.click("Reset e-stop"), None, "not stored yet");
    rig.teleop.estop = Some(STORED_ESTOP);
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
fn motion_without_command_is_shown() {
    for (state, headline, tone) in [
        (TeleopState::Idle, "Moves by itself", Tone::Waiting),
        (TeleopState::Held, "Moves without command", Tone::Warning),
        (TeleopState::EStop, "Emergency stop", Tone::Warning),
    ] {
        let mut rig = Rig::new();
        rig.teleop.state = state;
        rig.velocity = [-0.55, 0.0];
        let data = rig.data();
        rig.assert_headline(headline, tone);
        let driver = match state {
            TeleopState::EStop => "Moves without command",
            _ => headline,
        };
        assert_eq!(data.driver, driver);
        assert!(data.advice.unwrap().contains("−0.55 m/s"));
        let gauges = data.gauges.unwrap();
        let figures: Vec<_> = gauges.into_iter().map(|gauge| gauge.figures).collect();
        if state == TeleopState::Idle {
            assert_eq!(figures, ["–", "–"]);
        } else {
            assert_eq!(figures, ["0.00 of 0.00 m/s", "0 of 0 °/s"]);
        }
    }
    let mut boat = Rig::new();
    boat.teleop.is_drifting = true;
    boat.velocity = [0.2, 0.0];
    boat.assert_headline("Drifting", Tone::Warning);
    boat.velocity = [1.5, 0.0];
    boat.assert_headline("Moves or drifts", Tone::Warning);
    boat.teleop.state = TeleopState::Held;
    assert_eq!(boat.data().headline, "Drifting");
}

#[test]
fn the_panel_says_what_moves_a_vehicle_without_an_operator() {
    let route = "Follows the simulation's route: 1.62 m/s. No operator drives it.";
    let program = "Its own program moves it, or it rolls: 1.62 m/s. No operator drives it.";
    let adrift =
        "Its own program moves it, or it coasts or drifts: 1.62 m/s. No operator drives it.";
    for (source, is_boat, epoch, headline, tone, advice) in [
        ("lake", true, 0, "Moves by itself", Tone::Waiting, route),
        ("rooms", false, 0, "Moves by itself", Tone::Waiting, route),
        // An operator took it off the route.
        ("lake", true, 1, "Moves or drifts", Tone::Warning, adrift),
        ("rooms", false, 1, "Moves by itself", Tone::Waiting, program),
        ("", true, 0, "Moves or drifts", Tone::Warning, adrift),
        ("", false, 0, "Moves by itself", Tone::Waiting, program),
    ] {
        let mut rig = Rig::new();
        rig.source = source;
        rig.is_boat = is_boat;
        rig.teleop.is_drifting = is_boat;
        rig.teleop.lease.epoch = epoch;
        rig.velocity = [1.62, 0.0];
        rig.assert_headline(headline, tone);
        let data = rig.data();
        assert_eq!(data.driver, headline);
        let shown = data.advice.as_deref();
        assert_eq!(shown, Some(advice), "{source} {is_boat} {epoch}");
    }
}

#[test]
fn a_boat_without_thrust_is_standing_or_drifting() {
    let unheld = "No thrust: wind and current may move it";
    let coasts = "No thrust: it coasts, and wind and current move it";
    for state in [TeleopState::Idle, TeleopState::Held] {
        for (velocity, headline, advice) in [
            ([0.0; 2], "Standing, not held", unheld),
            ([-0.04, 0.01], "Standing, not held", unheld),
            ([0.2, 0.0], "Drifting", coasts),
            ([0.0, 0.1], "Drifting", coasts),
        ] {
            let mut rig = Rig::new();
            rig.teleop.state = state;
            rig.teleop.is_drifting = true;
            rig.is_boat = true;
            rig.velocity = velocity;
            let data = rig.data();
            let shown = (data.headline.as_str(), data.advice.as_deref());
            assert_eq!(shown, (headline, Some(advice)), "{state:?} {velocity:?}");
            assert_eq!(data.tone, Tone::Warning);
        }
    }
}

#[test]
fn keys_without_focus_are_not_ready() {
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
        let elsewhere = Some(warning("No focus: click into the map"));
        assert_eq!(rig.row("Keys"), elsewhere);
    }
}

#[test]
fn ignored_keys_are_shown_with_the_reason() {
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
    for state in [CollisionMonitorState::Stale, CollisionMonitorState::Silent] {
        rig.teleop.collision_monitor = state;
        let advice = rig.data().advice.unwrap();
        assert!(advice.starts_with("The monitor's data is late, so nothing moves"));
    }
}

#[test]
fn motors_that_obey_no_velocity_are_the_headline_of_a_vehicle_that_stands() {
    let mut rig = Rig::driving();
    rig.teleop.motor_hold = Some(MotorHold::Mode(4));
    assert_eq!(rig.data().headline, "Driving", "it still brakes");
    rig.teleop.state = TeleopState::Held;
    rig.velocity = [0.0; 2];
    let data = rig.data();
    assert_eq!(data.headline, "Cannot be driven");
    let why = "The autopilot is in mode HOLD, not GUIDED";
    assert_eq!(data.advice.unwrap(), why);
}

#[test]
fn refused_commands_and_settings() {
    let mut rig = Rig::new();
    rig.teleop.counters.refused = vec![RefusedCount {
        reason: Refusal::TooOld,
        count: 1_234,
    }];
    let expected = ("1\u{a0}234".to_owned(), "it is too old".to_owned());
    assert_eq!(rig.data().refused, [expected]);
    let mut window = rig.window([320.0, 900.0]);
    window.get_by_label("Settings of the robot").click();
    window.run_steps(30);
    window.get_by_label("Collision monitor").click();
    window.run_steps(2);
    let set = Command::Drive(Intent::Set(Setting::CollisionMonitor(true)));
    assert_eq!(window.state().clone(), Some(set));
}

#[test]
fn notices_are_shown() {
    let mut rig = Rig::driving();
    assert_eq!(rig.data().notice, None);
    for (notice, expected) in [
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
            TeleopNotification::Answered(
                RequestKind::Lease(LeaseRequest::TakeOver),
                Answer::Refused(Refusal::Role),
            ),
            "Lease take-over refused: only supervisors take over",
        ),
        (
            TeleopNotification::RequestTimedOut(RequestKind::Lease(LeaseRequest::Request)),
            "Lease request: no answer",
        ),
    ] {
        rig.teleop_client.notice = Some(notice);
        assert_eq!(rig.data().notice.as_deref(), Some(expected));
    }
}

#[test]
fn estop_reset_stays_visible_in_a_small_scrolled_window() {
    let mut rig = Rig::driving();
    rig.teleop.estop = Some(STORED_ESTOP);
    let mut window = rig.window([320.0, 160.0]);
    window.get_by_label("Emergency stop 3 is active");
    window.hover_at(eframe::egui::pos2(160.0, 120.0));
    window.event(eframe::egui::Event::MouseWheel {
        unit: eframe::egui::MouseWheelUnit::Point,
        delta: vec2(0.0, -1000.0),
        phase: eframe::egui::TouchPhase::Move,
        source: eframe::egui::MouseWheelSource::Unknown,
        modifiers: eframe::egui::Modifiers::NONE,
    });
    window.run_steps(30);
    let button = window.get_by_label("Reset e-stop").rect();
    assert!(button.top() >= 0.0 && button.bottom() <= 80.0, "{button:?}");
    let scrolled = window.get_by_label("Release control").rect();
    assert!(
        scrolled.bottom() < button.bottom(),
        "it did not scroll: {scrolled:?}"
    );
}

/// The vehicle is commanded to stop, and still moves at this time, ms.
fn moves_while_held(model: &mut ConsoleModel, ms: u64) {
    let pose = Pose {
        speed_mps: 0.4,
        ..pose_at_rest()
    };
    let mut teleop = idle_teleop_status();
    teleop.state = TeleopState::Held;
    inject(model, Topic::Pose, &pose, at(ms));
    inject(model, Topic::Status, &status(&teleop), at(ms));
}

#[test]
fn motion_within_the_braking_time_is_stopping() {
    let mut model = Rig::driving().model();
    let headline = |model: &ConsoleModel, ms| {
        let data = DrivingData::new(model, &idle_teleop_client(), at(ms)).unwrap();
        (data.headline, data.tone)
    };
    moves_while_held(&mut model, 1_200);
    let stopping = ("Stopping".to_owned(), Tone::Waiting);
    assert_eq!(headline(&model, 1_300), stopping);
    moves_while_held(&mut model, 2_300);
    let unexpected_motion = ("Moves without command".to_owned(), Tone::Warning);
    assert_eq!(headline(&model, 2_300), unexpected_motion);
}

#[test]
fn ended_data_is_not_a_lost_link() {
    let mut model = Rig::new().model();
    let status = Status {
        has_ended: true,
        teleop: Some(idle_teleop_status()),
        ..Status::default()
    };
    inject(&mut model, Topic::Status, &status, at(1_200));
    let data = DrivingData::new(&model, &idle_teleop_client(), at(9_000)).unwrap();
    let headline = (data.headline.as_str(), data.tone);
    assert_eq!(headline, ("Its data has ended", Tone::Waiting));
    let advice = data.advice.unwrap();
    assert!(
        advice.contains("for 8.0 s: robot-edge has closed"),
        "{advice}"
    );
}

/// Driver and lease buttons for a reported grant to `anna`.
fn granted(lease: Lease, last_grant: Option<u64>, epoch: u64) -> (String, LeaseButtons) {
    let mut rig = Rig::driving();
    rig.teleop_client.lease = lease;
    rig.teleop_client.last_grant = last_grant;
    rig.teleop.lease.epoch = epoch;
    let data = rig.data();
    (data.driver, data.lease)
}

#[test]
fn a_released_grant_is_not_of_another_console() {
    let mine = (String::from("You drive (anna)"), LeaseButtons::Quiet);
    assert_eq!(granted(Lease::None, Some(4), 4), mine);
    let others = "anna drives, from another console".to_owned();
    let others = (others, LeaseButtons::HeldByOther);
    assert_eq!(granted(Lease::None, Some(4), 5), others);
    assert_eq!(granted(Lease::None, None, 4), others);
    let mut free = Rig::new();
    free.teleop_client.last_grant = Some(4);
    free.teleop.lease.epoch = 4;
    let data = free.data();
    assert_eq!(
        (data.driver.as_str(), data.lease),
        ("Nobody drives", LeaseButtons::Free)
    );
}

#[test]
fn a_requested_grant_is_not_of_another_console() {
    let waiting = Lease::Waiting {
        after: 4,
        since: at(0),
    };
    assert_eq!(granted(waiting, None, 5).0, "You drive (anna)");
    let others = "anna drives, from another console";
    assert_eq!(granted(waiting, None, 4).0, others);
    let mut rig = Rig::driving();
    rig.teleop_client.lease = Lease::None;
    rig.teleop_client.is_asking = true;
    assert_eq!(rig.data().driver, "anna drives");
}

/// Notice of a lost lease after these events (kind and message, oldest first).
fn lost_lease(events: &[(&str, &str)]) -> Option<String> {
    let mut rig = Rig::new();
    rig.teleop_client.notice = Some(TeleopNotification::LeaseLost);
    let mut model = rig.model();
    for (kind, message) in events {
        let event = Event {
            kind: (*kind).to_owned(),
            severity: Severity::Info,
            message: (*message).to_owned(),
        };
        inject(&mut model, Topic::Event, &event, at(1_000));
    }
    DrivingData::new(&model, &rig.teleop_client, rig.now)
        .unwrap()
        .notice
}

#[test]
fn a_lost_lease_shows_the_reason_if_known() {
    const GRANTED: (&str, &str) = ("lease_granted", "anna drives: asked and the lease was free");
    const REVOKED: (&str, &str) = (
        "lease_ended",
        "anna no longer drives: the leave to drive was taken away",
    );
    let idle = ("teleop_state", "nobody drives");
    let of_others = ("lease_ended", "annabel no longer drives: no command came");
    let why = "Lease lost: the leave to drive was taken away";
    for (events, expected) in [
        (vec![GRANTED, REVOKED, idle, of_others], why),
        (vec![REVOKED, GRANTED], "Lease lost"),
        (vec![of_others], "Lease lost"),
    ] {
        assert_eq!(lost_lease(&events).as_deref(), Some(expected), "{events:?}");
    }
}

#[test]
fn an_observer_can_press_nothing() {
    let mut rig = Rig::new();
    rig.teleop_client.role = Some(Role::Observer);
    rig.teleop_client.notice = Some(TeleopNotification::ObserverOnly);
    let data = rig.data();
    assert_eq!(
        (data.lease, &data.estop),
        (LeaseButtons::ReadOnly, &EStopButton::ReadOnly)
    );
    assert_eq!(data.notice, None);
    assert!(data.is_at_rest());
    let label = format!("Request control. {OBSERVER_HINT}");
    assert_eq!(rig.click(&label), None);
    assert_eq!(rig.click(OBSERVER_HINT), None);

    rig.teleop.estop = Some(STORED_ESTOP);
    let in_force = EStopButton::InForce {
        number: 3,
        is_stored: true,
    };
    assert_eq!(rig.data().estop, in_force);
    assert_eq!(rig.click("Reset e-stop"), None);
    rig.teleop_client.role = Some(Role::Operator);
    let reset = Some(Command::Drive(Intent::Reset(3)));
    assert_eq!(rig.click("Reset e-stop"), reset);
}

#[test]
fn only_supervisors_can_take_over() {
    let mut rig = Rig::driving();
    rig.teleop.lease.holder = Some("bert".parse().unwrap());
    rig.teleop_client.lease = Lease::None;
    rig.teleop_client.role = Some(Role::Operator);
    assert_eq!(rig.data().lease, LeaseButtons::HeldByOther);
    assert_eq!(rig.click(&format!("Take over. {OPERATOR_HINT}")), None);
    rig.assert_requests("Request handover", LeaseRequest::Request);
    for role in [None, Some(Role::Supervisor)] {
        rig.teleop_client.role = role;
        rig.assert_requests("Take over", LeaseRequest::TakeOver);
    }
}

#[test]
fn speed_steps_explain_their_speed() {
    let mut rig = Rig::new();
    for (limits, step, text) in [
        ([1.2, 0.0, 1.5], "1", "1: 20 % of its top speed, 0.24 m/s"),
        ([1.2, 0.0, 1.5], "3", "3: 60 % of its top speed, 0.72 m/s"),
        ([1.2, 0.0, 1.5], "5", "5: 100 % of its top speed, 1.20 m/s"),
        ([0.0; 3], "3", "3: 60 % of its top speed"),
    ] {
        rig.teleop_client.limits = limits;
        let mut window = rig.window([560.0, 800.0]);
        let place = window.get_by_label(step).rect();
        window.hover_at(place.center());
        window.run_steps(60);
        window.get_by_label(text);
    }
}

#[test]
fn a_restarted_robot_is_waiting_for_status() {
    let rig = Rig::driving();
    let mut model = rig.model();
    let shown = |model: &ConsoleModel, ms| {
        let data = DrivingData::new(model, &rig.teleop_client, at(ms)).unwrap();
        (data.tone, data.headline)
    };
    announce_boot(&mut model, BootId([7; 16]), at(1_050));
    assert_eq!(shown(&model, 1_100).1, "Driving");
    let lost = (Tone::Warning, "Link lost for 4.0 s".to_owned());
    assert_eq!(shown(&model, 5_000), lost);
    announce_boot(&mut model, BootId([8; 16]), at(5_000));
    let waiting = (Tone::Waiting, "Waiting for status".to_owned());
    assert_eq!(shown(&model, 5_000), waiting);
    let data = DrivingData::new(&model, &rig.teleop_client, at(5_000)).unwrap();
    assert_eq!((data.gauges, data.settings), (None, None),);
    assert_eq!(data.driver, "You drove (anna)");
    assert_eq!(data.rows[0].1.1, "as of 4.0 s ago");
    assert_eq!(shown(&model, 7_000).0, Tone::Warning);
    assert!(model.awaits_status());
}
