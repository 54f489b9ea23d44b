//! The collision monitor is off for one driver and one drive.

use std::time::Duration;

use protocol::message::{LeaseRequest, Reset, Setting};
use protocol::signed::Command;

use super::*;

/// A vehicle with a collision monitor, its clock, and what people send it, signed as on a link that is open to all.
struct Vehicle {
    drive_loop: DriveLoop,
    now: Monotonic,
    seq: u64,
}

impl Vehicle {
    fn new() -> Self {
        let now = Monotonic::from_nanos(1_000_000_000);
        let mut drive_loop = monitored(now);
        let (has_passed, stored) = (true, StoredEStop::None);
        drive_loop.step(now, ArbiterInput::SelfTest { has_passed, stored });
        let mut vehicle = Self {
            drive_loop,
            now,
            seq: 0,
        };
        vehicle.passes(20);
        vehicle
    }

    /// Rounds for so long.
    fn passes(&mut self, ms: u64) {
        for _ in 0..ms / 20 {
            self.now = self.now + Duration::from_millis(20);
            self.drive_loop.tick(self.now);
        }
    }

    fn sends<T: Command>(&mut self, name: &str, command: &T) -> Option<Answer> {
        let operator: OperatorName = name.parse().unwrap();
        let token = self.drive_loop.state.tokens().newest().unwrap();
        let report = self
            .drive_loop
            .state
            .report(&self.drive_loop.rules, self.now);
        self.seq += 1;
        let stamp = CommandHeader {
            boot: BootId([1; 16]),
            token: AgeToken {
                n: token.n,
                nonce: token.nonce,
            },
            epoch: report.lease.epoch,
            seq: self.seq,
        };
        let robot = "scout".parse().unwrap();
        let route = Route {
            robot: &robot,
            operator: &operator,
        };
        let key = SecretKey::without_secret(&operator);
        let (sender, answers) = sync_channel(1);
        let incoming = Incoming {
            topic: T::TOPIC,
            bytes: sign(&key, route, &stamp, command).unwrap(),
            operator,
            reply: Some(Box::new(move |answer| sender.send(answer).unwrap())),
        };
        self.drive_loop.receive(incoming, self.now);
        answers.try_recv().ok()
    }

    /// Somebody who may switches the collision monitor off.
    fn without_monitor(&mut self, by: &str) {
        let answer = self.sends(by, &Setting::CollisionMonitor(false));
        assert_eq!(answer, Some(Answer::Done), "{by}");
        self.passes(20);
        let status = self.status();
        assert_eq!(
            (status.settings.collision_monitor, status.collision_monitor),
            (false, CollisionMonitorState::Off)
        );
        drop(self.drive_loop.drive_state.take_events());
    }

    /// Lets go, presses, and drives.
    fn drives(&mut self, name: &str) {
        for linear_mps in [0.0, 0.5] {
            let drive = Drive {
                linear_mps,
                angular_radps: 0.0,
                estop: None,
            };
            for _ in 0..15 {
                self.sends(name, &drive);
                self.passes(20);
            }
        }
        let status = self.status();
        assert!(status.applied.linear_mps > 0.0, "{status:?}");
    }

    fn status(&self) -> TeleopStatus {
        self.drive_loop.drive_state.status().unwrap()
    }

    /// The collision monitor is on again: the status shows it, and one event says why.
    fn is_monitored_again(&mut self, why: &str) {
        self.passes(20);
        let status = self.status();
        assert!(
            status.settings.collision_monitor
                && status.collision_monitor != CollisionMonitorState::Off,
            "{why}: {status:?}"
        );
        let events = self.drive_loop.drive_state.take_events();
        let of_monitor: Vec<_> = events
            .iter()
            .filter(|(kind, _)| kind.starts_with("collision_monitor"))
            .collect();
        let text = format!("the collision monitor is on again: {why}");
        assert_eq!(of_monitor, [&("collision_monitor", text)], "{events:?}");
    }
}

const REQUEST: LeaseRequest = LeaseRequest::Request;

#[test]
fn the_monitor_is_on_after_each_grant_of_the_lease() {
    let granted = |epoch| Some(Answer::Granted(epoch));
    let mut vehicle = Vehicle::new();
    assert_eq!(vehicle.sends("anna", &REQUEST), granted(1));
    vehicle.without_monitor("anna");
    vehicle.drives("anna");
    // She is cut off: the vehicle stops, and the lease ends.
    vehicle.passes(6000);
    assert_eq!(vehicle.status().lease.holder, None);
    assert_eq!(vehicle.sends("bert", &REQUEST), granted(2));
    vehicle.is_monitored_again("bert has the lease from now on");

    vehicle.without_monitor("bert");
    assert_eq!(vehicle.sends("cleo", &REQUEST), Some(Answer::Waiting));
    vehicle.passes(20);
    assert!(
        !vehicle.status().settings.collision_monitor,
        "Bert drives still"
    );
    let consent = LeaseRequest::HandOver("cleo".parse().unwrap());
    vehicle.sends("bert", &consent);
    vehicle.is_monitored_again("cleo has the lease from now on");

    vehicle.without_monitor("cleo");
    vehicle.sends("dora", &LeaseRequest::TakeOver);
    vehicle.is_monitored_again("dora has the lease from now on");
    // A console that was restarted asks anew, and is granted anew.
    vehicle.without_monitor("dora");
    assert_eq!(vehicle.sends("dora", &REQUEST), granted(5));
    vehicle.is_monitored_again("dora has the lease from now on");
}

#[test]
fn the_monitor_is_on_after_each_emergency_stop_and_reset() {
    let mut vehicle = Vehicle::new();
    vehicle.sends("anna", &REQUEST);
    vehicle.without_monitor("anna");
    vehicle.sends("bert", &EStop { press: 1 });
    vehicle.is_monitored_again("an emergency stop");
    vehicle.without_monitor("anna");
    let done = vehicle.sends("anna", &Reset { estop: 1 });
    assert_eq!(done, Some(Answer::Done));
    vehicle.is_monitored_again("a reset");

    vehicle.without_monitor("anna");
    vehicle
        .drive_loop
        .execute_local(LocalCommand::Stop, vehicle.now);
    vehicle.is_monitored_again("an emergency stop");
    vehicle.without_monitor("anna");
    vehicle
        .drive_loop
        .execute_local(LocalCommand::Reset, vehicle.now);
    vehicle.is_monitored_again("a reset");

    vehicle.without_monitor("anna");
    vehicle
        .drive_loop
        .step(vehicle.now, ArbiterInput::ActuatorFault);
    vehicle
        .drive_loop
        .execute_local(LocalCommand::Reset, vehicle.now);
    vehicle.is_monitored_again("a reset");
}

#[test]
fn a_short_stop_by_age_is_no_grant_and_leaves_the_monitor_as_it_was() {
    let mut vehicle = Vehicle::new();
    vehicle.sends("anna", &REQUEST);
    vehicle.without_monitor("anna");
    vehicle.drives("anna");
    vehicle.passes(1200);
    let status = vehicle.status();
    assert_eq!(
        vehicle.drive_loop.runtime_settings.last_stop,
        Some(StopReason::Age)
    );
    assert_eq!(status.lease.holder, Some("anna".parse().unwrap()));
    assert!(!status.settings.collision_monitor);
}

#[test]
fn where_there_is_no_monitor_none_is_said_to_be_on() {
    let mut vehicle = Vehicle::new();
    (
        vehicle.drive_loop.monitor_runner,
        vehicle.drive_loop.runtime_settings.collision_monitor,
    ) = (None, false);
    vehicle.sends("anna", &REQUEST);
    vehicle
        .drive_loop
        .execute_local(LocalCommand::Stop, vehicle.now);
    vehicle.passes(20);
    assert!(!vehicle.status().settings.collision_monitor);
    let events = vehicle.drive_loop.drive_state.take_events();
    let speaks = events.iter().any(|(_, text)| text.contains("monitor"));
    assert!(!speaks, "{events:?}");
}
