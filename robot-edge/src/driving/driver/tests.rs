use std::sync::mpsc::sync_channel;

use nalgebra::Point3;
use protocol::keys::OperatorTopic::{Drive as ByDrive, EStop as ByEStop};
use protocol::message::{AgeToken, BarrierKind, EStop, Guard, Refusal as No, TeleopStatus};
use protocol::signed::{SecretKey, Stamp, sign};

use super::*;
use crate::config::VehicleConfig;
use crate::credentials::OperatorList;
use crate::driving::lookout::lookout;
use crate::driving::motors::SimulatedMotors;
use crate::mapping::elevation_config::ObstacleConfig;
use crate::mapping::posed_scan::{BeamOutcome, PosedBeam, PosedScan, SensorId};
use crate::pose::planar;
use crate::robot_time::RobotTime;
use crate::teleop::config::TeleopConfig;
use crate::teleop::guard::{GuardConfig, GuardRules};
use crate::teleop::{Caller, LeaseVerb};

fn guard_rules() -> GuardRules {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let obstacle = ObstacleConfig::default();
    GuardRules::new(&GuardConfig::default(), &teleop, &vehicle, &obstacle).unwrap()
}

/// A vehicle whose guard was told nothing yet.
fn guarded(now: Monotonic) -> Driver {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let mut driver = Driver::new(
        ("scout".parse().unwrap(), BootId([1; 16])),
        Rules::new(&teleop, &vehicle).unwrap(),
        Operators::open(),
        Motors::Simulated(SimulatedMotors::default()),
        Arc::new(Board::default()),
        now,
    );
    driver.sight = Some(lookout(guard_rules(), 1, None).2);
    driver.switches.guard = true;
    driver
}

fn stops(driver: &mut Driver, reason: StopReason, now: Monotonic) -> Vec<(&'static str, String)> {
    let to = Mode::Stopping { reason, since: now };
    let from = Mode::Driving;
    driver.tell(Happening::Mode { from, to }, now);
    driver.board.tell(&mut driver.notices);
    driver.board.take_events()
}

#[test]
fn a_stop_for_want_of_a_guard_says_what_the_guard_lacked() {
    let now = Monotonic::now();
    let mut driver = guarded(now);
    driver.tick(now);
    drop(driver.board.take_events());
    let says = "stopping: the collision guard could not judge, it had no pose yet";
    let told = stops(&mut driver, StopReason::GuardStale, now);
    assert_eq!(told, [("involuntary_stop", says.to_owned())]);
    assert_eq!(driver.switches.last_stop, Some(StopReason::GuardStale));
    // Other stops do not speak of the guard.
    let told = stops(&mut driver, StopReason::Age, now);
    assert_eq!(told.len(), 1);
    assert!(!told[0].1.contains("guard"), "{told:?}");
    // Nor is anything made up where there is none.
    driver.sight = None;
    let told = stops(&mut driver, StopReason::GuardStale, now);
    assert!(told[0].1.ends_with("it said nothing"), "{told:?}");
}

/// What a laser sees all around a vehicle at (2, 1): a wall 0.6 m ahead, and nothing else within 5 m.
fn scan_of_a_wall() -> PosedScan {
    let origin_in_odom = Point3::new(2.0, 1.0, 0.2);
    let beams = (0_u32..720).map(|index| {
        let angle = f64::from(index) * std::f64::consts::TAU / 720.0;
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        let to_wall_m = if cos > 0.0 { 0.6 / cos } else { f64::INFINITY };
        let range_m = to_wall_m.min(5.0);
        PosedBeam {
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
    PosedScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(0),
        beam_step_rad: std::f64::consts::TAU / 720.0,
        own_body_hits: 0,
        odom_from_base: planar(2.0, 1.0, 0.0),
        beams: beams.collect(),
    }
}

/// The holder asks for this; the status after the round.
fn asks(driver: &mut Driver, linear_mps: f64, seq: u64, now: Monotonic) -> TeleopStatus {
    let command = DriveCommand {
        operator: OperatorId(0),
        epoch: 1,
        seq,
        token: driver.state.tokens().newest().unwrap(),
        requested: Velocity {
            linear_mps,
            angular_radps: 0.0,
        },
        estop: false,
    };
    let role = Role::Operator;
    driver.step(now, Event::Command { role, command });
    driver.tick(now);
    driver.board.status().unwrap()
}

#[test]
fn what_bounds_the_motion_that_is_asked_for_is_in_the_status_while_the_guard_is_on() {
    let now = Monotonic::now();
    let mut driver = guarded(now);
    let (mut tells, _map, sight) = lookout(guard_rules(), 1, None);
    let scan = scan_of_a_wall();
    tells.moved(scan.stamp, &scan.odom_from_base, Velocity::ZERO, now);
    tells.see(&scan, now);
    driver.sight = Some(sight);
    let (has_passed, stored) = (true, StoredEStop::None);
    driver.step(now, Event::SelfTest { has_passed, stored });
    driver.tick(now);
    let lease = Event::Lease {
        caller: Caller {
            operator: OperatorId(0),
            role: Role::Operator,
            request: RequestId(1),
        },
        token: driver.state.tokens().newest().unwrap(),
        verb: LeaseVerb::Request,
    };
    driver.step(now, lease);

    assert_eq!(asks(&mut driver, 0.5, 1, now).barrier, None);
    let status = asks(&mut driver, 1.0, 2, now);
    assert!(matches!(status.guard, Guard::On(_)), "{status:?}");
    let barrier = status.barrier.unwrap();
    let [x, y] = barrier.position_m;
    assert_eq!(barrier.kind, BarrierKind::Seen);
    assert!(
        (x - 2.6).abs() < 1e-3 && (y - 1.0).abs() < 1e-3,
        "{barrier:?}"
    );
    // Switched off, it bounds nothing.
    driver.switches.guard = false;
    let status = asks(&mut driver, 1.0, 3, now);
    assert_eq!((status.guard, status.barrier), (Guard::Off, None));
}

/// An emergency stop of an observer comes within the drive command and as a request, in either order: whichever is heard
/// first, the other is refused for the role too, not answered as what is over already.
#[test]
fn a_press_of_whoever_may_not_stop_the_vehicle_is_refused_for_that_by_whichever_way_it_comes() {
    let now = Monotonic::now();
    let eve = SecretKey::from_seed(&[5; 32]);
    let key = eve.public().to_pem().unwrap();
    let list = format!(
        "version = 1\n[[person]]\nname = \"eve\"\nrole = \"observer\"\nkey = \"\"\"\n{key}\"\"\"\n"
    );
    let mut driver = guarded(now);
    driver.operators = Operators::listed(&OperatorList::parse(&list).unwrap());
    driver.tick(now);
    let name: OperatorName = "eve".parse().unwrap();
    let mut seq = 0;
    let mut hears = |topic, press| {
        seq += 1;
        let stamp = Stamp {
            boot: BootId([1; 16]),
            token: AgeToken { n: 0, nonce: 0 },
            epoch: 0,
            seq,
        };
        let estop = EStop { press };
        let drive = Drive {
            linear_mps: 0.0,
            angular_radps: 0.0,
            estop: Some(estop),
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
        driver.receive(
            Incoming {
                topic,
                operator,
                bytes,
                reply,
            },
            now,
        );
        assert_eq!(driver.state.mode(), Mode::SafeBoot, "nothing was stopped");
        answers.try_recv().ok()
    };
    for press in [1, 2] {
        assert_eq!(hears(ByDrive, press), None);
        for _ in 0..2 {
            assert_eq!(hears(ByEStop, press), Some(Answer::Refused(No::Role)));
        }
    }
}

mod guard_again;
