use network::clock;
use std::sync::mpsc::sync_channel;

use nalgebra::Point3;
use protocol::keys::OperatorTopic::{Drive as ByDrive, EStop as ByEStop};
use protocol::message::{
    AgeToken, BarrierKind, CollisionMonitorState, EStop, Refusal as No, TeleopStatus,
};
use protocol::signed::{CommandHeader, SecretKey, sign};

use super::*;
use crate::driving::monitor_input::monitor_input;
use crate::driving::motors::SimulatedMotors;
use mapping::obstacle::ObstacleConfig;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId};
use mapping::vehicle::VehicleConfig;
use measurement::pose::planar;
use measurement::time::RobotTime;
use network::credentials::OperatorList;
use teleop::TeleopConfig;
use teleop::collision_monitor::{CollisionMonitorConfig, CollisionMonitorRules};
use teleop::{Caller, LeaseVerb};

fn monitor_rules() -> CollisionMonitorRules {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let obstacle = ObstacleConfig::default();
    CollisionMonitorRules::new(
        &CollisionMonitorConfig::default(),
        &teleop,
        &vehicle,
        &obstacle,
    )
    .unwrap()
}

/// A vehicle whose collision monitor has no input yet.
fn monitored(now: Monotonic) -> DriveLoop {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let mut drive_loop = DriveLoop::new(
        ("scout".parse().unwrap(), BootId([1; 16])),
        Rules::new(&teleop, &vehicle, &teleop::LocomotionConfig::default()).unwrap(),
        Operators::open(),
        Motors::Simulated(SimulatedMotors::default()),
        Arc::new(SharedDriveState::default()),
        now,
    );
    drive_loop.monitor_runner = Some(monitor_input(monitor_rules(), 1, None).2);
    drive_loop.runtime_settings.collision_monitor = true;
    drive_loop
}

fn stops(
    drive_loop: &mut DriveLoop,
    reason: StopReason,
    now: Monotonic,
) -> Vec<(&'static str, String)> {
    let to = Mode::Stopping { reason, since: now };
    let from = Mode::Driving;
    drive_loop.on_arbiter_event(ArbiterEvent::ModeChanged { from, to }, now);
    drive_loop
        .drive_state
        .publish_events(&mut drive_loop.drive_events);
    drive_loop.drive_state.take_events()
}

#[test]
fn a_stop_by_the_monitor_reports_the_cause() {
    let now = clock::now();
    let mut drive_loop = monitored(now);
    drive_loop.tick(now);
    drop(drive_loop.drive_state.take_events());
    let says = "stopping: the collision monitor could not judge, it had no pose yet";
    let events = stops(&mut drive_loop, StopReason::CollisionMonitorStale, now);
    assert_eq!(events, [("involuntary_stop", says.to_owned())]);
    assert_eq!(
        drive_loop.runtime_settings.last_stop,
        Some(StopReason::CollisionMonitorStale)
    );
    // Other stops do not speak of the collision monitor.
    let events = stops(&mut drive_loop, StopReason::Age, now);
    assert_eq!(events.len(), 1);
    assert!(!events[0].1.contains("monitor"), "{events:?}");
    // Nor is anything made up where there is none.
    drive_loop.monitor_runner = None;
    let events = stops(&mut drive_loop, StopReason::CollisionMonitorStale, now);
    assert!(events[0].1.ends_with("it did not respond"), "{events:?}");
}

/// What a laser sees all around a vehicle at (2, 1): a wall 0.6 m ahead, and nothing else within 5 m.
fn scan_of_a_wall() -> RegisteredScan {
    let origin_in_odom = Point3::new(2.0, 1.0, 0.2);
    let beams = (0_u32..720).map(|index| {
        let angle = f64::from(index) * std::f64::consts::TAU / 720.0;
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let to_wall_m = if cos > 0.0 { 0.6 / cos } else { f64::INFINITY };
        let range_m = to_wall_m.min(5.0);
        RegisteredBeam {
            origin_in_odom,
            end_in_odom: origin_in_odom + nalgebra::Vector3::new(cos, sin, 0.0) * range_m,
            outcome: if to_wall_m < 5.0 {
                BeamOutcome::Hit
            } else {
                BeamOutcome::Miss
            },
            index,
            range_m: range_m as f32,
        }
    });
    RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: std::f64::consts::TAU / 720.0,
        kind: ScanKind::Beams,
        own_body_hits: 0,
        odom_from_base: planar(2.0, 1.0, 0.0),
        beams: beams.collect(),
    }
}

/// The holder asks for this; the status after the round.
fn asks(drive_loop: &mut DriveLoop, linear_mps: f64, seq: u64, now: Monotonic) -> TeleopStatus {
    let command = DriveCommand {
        operator: OperatorId(0),
        epoch: 1,
        seq,
        token: drive_loop.state.tokens().newest().unwrap(),
        requested: Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps: 0.0,
        },
        estop: false,
        docking: None,
        goal: None,
    };
    let role = Role::Operator;
    drive_loop.step(now, ArbiterInput::Command { role, command });
    drive_loop.tick(now);
    drive_loop.drive_state.status().unwrap()
}

#[test]
fn the_barrier_is_in_the_status_while_the_monitor_is_on() {
    let now = clock::now();
    let mut drive_loop = monitored(now);
    let (mut sensor_input, _map, monitor_runner) = monitor_input(monitor_rules(), 1, None);
    let scan = scan_of_a_wall();
    sensor_input.update_odometry(scan.stamp, &scan.odom_from_base, Velocity::ZERO, now);
    sensor_input.add_scan(&scan, now);
    drive_loop.monitor_runner = Some(monitor_runner);
    let (has_passed, stored) = (true, StoredEStop::None);
    drive_loop.step(now, ArbiterInput::SelfTest { has_passed, stored });
    drive_loop.tick(now);
    let lease = ArbiterInput::Lease {
        caller: Caller {
            operator: OperatorId(0),
            role: Role::Operator,
            request: RequestId(1),
        },
        token: drive_loop.state.tokens().newest().unwrap(),
        verb: LeaseVerb::Request,
    };
    drive_loop.step(now, lease);

    assert_eq!(asks(&mut drive_loop, 0.5, 1, now).barrier, None);
    let status = asks(&mut drive_loop, 1.0, 2, now);
    assert!(
        matches!(status.collision_monitor, CollisionMonitorState::On(_)),
        "{status:?}"
    );
    let barrier = status.barrier.unwrap();
    let [x, y] = barrier.position_m;
    assert_eq!(barrier.kind, BarrierKind::Detected);
    assert!(
        (x - 2.6).abs() < 1e-3 && (y - 1.0).abs() < 1e-3,
        "{barrier:?}"
    );
    // Switched off, it bounds nothing.
    drive_loop.runtime_settings.collision_monitor = false;
    let status = asks(&mut drive_loop, 1.0, 3, now);
    assert_eq!(
        (status.collision_monitor, status.barrier),
        (CollisionMonitorState::Off, None)
    );
}

/// An emergency stop of an observer comes within the drive command and as a request, in either order: whichever is
/// heard first, the other is refused for the role too, not answered as what is over already.
#[test]
fn an_emergency_stop_of_an_observer_is_refused_each_time() {
    let now = clock::now();
    let eve = SecretKey::from_seed(&[5; 32]);
    let key = eve.public().to_pem().unwrap();
    let list = format!(
        "version = 1\n[[person]]\nname = \"eve\"\nrole = \"observer\"\nkey = \"\"\"\n{key}\"\"\"\n"
    );
    let mut drive_loop = monitored(now);
    drive_loop.operators = Operators::listed(&OperatorList::parse(&list).unwrap());
    drive_loop.tick(now);
    let name: OperatorName = "eve".parse().unwrap();
    let mut seq = 0;
    let mut hears = |topic, press| {
        seq += 1;
        let stamp = CommandHeader {
            boot: BootId([1; 16]),
            token: AgeToken { n: 0, nonce: 0 },
            epoch: 0,
            seq,
        };
        let estop = EStop { press };
        let drive = Drive {
            linear_mps: 0.0,
            lateral_mps: 0.0,
            angular_radps: 0.0,
            estop: Some(estop),
            docking: None,
            goal: None,
        };
        let robot = "scout".parse().unwrap();
        let route = Route {
            robot: &robot,
            operator: &name,
        };
        let bytes = if topic == ByDrive {
            sign(&eve, route, &stamp, &drive)
        } else {
            sign(&eve, route, &stamp, &estop)
        };
        let (sender, answers) = sync_channel(1);
        let reply: Option<Reply> = (topic == ByEStop).then(|| {
            let reply: Reply = Box::new(move |answer| sender.send(answer).unwrap());
            reply
        });
        let (bytes, operator) = (bytes.unwrap(), name.clone());
        drive_loop.receive(
            Incoming {
                topic,
                operator,
                bytes,
                reply,
            },
            now,
        );
        assert_eq!(
            drive_loop.state.mode(),
            Mode::SafeBoot,
            "nothing was stopped"
        );
        answers.try_recv().ok()
    };
    for press in [1, 2] {
        assert_eq!(hears(ByDrive, press), None);
        for _ in 0..2 {
            assert_eq!(hears(ByEStop, press), Some(Answer::Refused(No::Role)));
        }
    }
}

mod monitor_reenabled {
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
                    lateral_mps: 0.0,
                    angular_radps: 0.0,
                    estop: None,
                    docking: None,
                    goal: None,
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
}
