//! Other operators request the lease, flood the link or send garbage while one drives.

use std::thread::{scope, sleep};
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator, PERIOD, connected, refused};
use network::clock::{self, sleep_until};
use protocol::keys::{OperatorTopic, Topic, operator_key};
use protocol::message::{Answer, Drive, EStop, LeaseRequest, Refusal, TeleopState};
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::robot::{CIRCLE, Lateness, NAME, Robot, drove, while_driving};
use crate::rng::SeededRng;

const ATTACK: Duration = Duration::from_secs(3);

/// Commands per second of a flood, and of each burst.
const FLOOD_PER_S: u32 = 10_000;
const AT_ONCE: u32 = 20;

#[test]
fn a_second_operator_moves_nothing_before_the_grant() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    let mut bert = robot.operator("bert");
    let other_way = Input::of(-0.2, -1.0);
    let drive = while_driving(&mut anna, || {
        bert.epoch = 1;
        bert.hold(Input::NEUTRAL, NEUTRAL);
        bert.hold(other_way, NEUTRAL);
        assert_eq!(bert.ask(&LeaseRequest::Request), Answer::Waiting);
        bert.hold(other_way, NEUTRAL);
    });
    drove("a second operator", &robot.log(), drive);
    assert!(refused(&bert.wait_for_new_status(), Refusal::NotHolder) > 40);

    // Handed over while it drives: first it must stop.
    anna.start_driving(CIRCLE);
    anna.hold(CIRCLE, NEUTRAL);
    let consent = LeaseRequest::HandOver("bert".parse().unwrap());
    assert_eq!(anna.ask(&consent), Answer::Done);
    bert.start_driving(other_way);
    let anna_epoch = anna.epoch;
    anna.hold(CIRCLE, NEUTRAL);
    let log = robot.log();
    let first = log.rounds.iter().position(|round| round.epoch > anna_epoch);
    assert!(
        log.rounds[first.unwrap()].is_stopped(),
        "it did not stop before"
    );

    // Taken over while it drives, likewise.
    bert.start_driving(other_way);
    let mut carla = robot.operator("carla");
    carla.ask(&LeaseRequest::TakeOver);
    carla.start_driving(CIRCLE);
    let log = robot.log();
    let first = log
        .rounds
        .iter()
        .position(|round| round.epoch >= carla.epoch);
    assert!(
        log.rounds[first.unwrap()].is_stopped(),
        "it did not stop before"
    );
    robot.verdict(&[&anna.journal, &bert.journal, &carla.journal]);
}

/// Puts messages at [`FLOOD_PER_S`] for [`ATTACK`].
fn flood(session: &Session, key: &str, mut message: impl FnMut() -> Vec<u8>) {
    let publisher = session
        .declare_publisher(key.to_owned())
        .congestion_control(CongestionControl::Drop)
        .wait()
        .unwrap();
    let (started, mut next) = (clock::now(), clock::now());
    let mut sent = 0;
    while clock::elapsed(started) < ATTACK {
        let message = message();
        for _ in 0..AT_ONCE {
            publisher.put(message.clone()).wait().unwrap();
            sent += 1;
        }
        next = next + Duration::from_secs(1) * AT_ONCE / FLOOD_PER_S;
        sleep_until(next, || false);
    }
    let per_s = f64::from(sent) / clock::elapsed(started).as_secs_f64();
    println!("{key}: {per_s:.0} messages/s");
}

/// The rounds of a drive without an attack.
fn quiet(robot: &Robot, driver: &mut Operator) -> Lateness {
    let drive = while_driving(driver, || sleep(ATTACK));
    Lateness::of("no flood", &robot.log(), drive)
}

/// Drives during two floods; returns the share of driving and the delays of rounds.
fn drive_through_floods() -> [(f64, Lateness); 2] {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    let mut bert = robot.operator("bert");
    let key = |name: &str| format!("foreshore/{NAME}/op/{name}/drive");
    let full_speed = Drive {
        linear_mps: 1.0,
        lateral_mps: 0.0,
        angular_radps: 3.0,
        estop: None,
        docking: None,
        goal: None,
    };
    let session = connected(&robot.endpoint, None);
    let quiet = quiet(&robot, &mut anna);
    let judged = |what: &str, drive| {
        let log = robot.log();
        let late = Lateness::of(what, &log, drive);
        late.is_no_worse_than(&quiet);
        (drove(what, &log, drive), late)
    };

    bert.epoch = 1;
    let drive = while_driving(&mut anna, || {
        flood(&session, &key("bert"), || bert.signed(&full_speed));
    });
    let valid = judged("valid commands", drive);

    let mut rng = SeededRng::new(5);
    let drive = while_driving(&mut anna, || {
        flood(&session, &key("carla"), || rng.bytes(170));
    });
    let garbage = judged("garbage", drive);

    anna.start_driving(CIRCLE);
    let status = anna.wait_for_new_status();
    println!("{:?}", status.counters);
    assert!(refused(&status, Refusal::TooMany) > 1000, "{status:?}");
    robot.verdict(&[&anna.journal, &bert.journal]);
    [valid, garbage]
}

#[test]
fn floods_move_nothing_and_delay_no_round() {
    drive_through_floods();
}

#[test]
#[ignore = "fifteen seconds: measures, and needs an idle machine"]
fn floods_neither_stop_the_vehicle_nor_delay_a_round() {
    for (share, late) in drive_through_floods() {
        assert!(share > 0.99, "{share}");
        late.is_none();
    }
}

/// Without keys, a flood in the driver's own name uses up the driver's rate. It
/// stops the vehicle and moves nothing.
#[test]
fn an_emergency_stop_gets_through_a_flood_in_the_drivers_name() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    let mut bert = robot.operator("bert");
    let session = connected(&robot.endpoint, None);
    let key = format!("foreshore/{NAME}/op/anna/drive");
    let mut rng = SeededRng::new(6);
    let quiet = quiet(&robot, &mut anna);
    let drive = while_driving(&mut anna, || {
        scope(|scope| {
            scope.spawn(|| flood(&session, &key, || rng.bytes(170)));
            sleep(ATTACK / 2);
            let stopped = bert.ask(&EStop { press: 77 });
            assert!(matches!(stopped, Answer::EStopped(_)), "{stopped:?}");
        });
    });
    let late = Lateness::of("garbage in the driver's name", &robot.log(), drive);
    late.is_no_worse_than(&quiet);
    let status = bert.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    println!("{:?}", status.counters);
    let log = robot.log();
    let last = log.rounds.last().unwrap();
    assert!(last.is_stopped() && last.mode == "estop", "{last:?}");
    robot.verdict(&[&anna.journal, &bert.journal]);
}

/// Keys that operators use, and similar ones.
fn keys() -> Vec<String> {
    let mut keys = vec![
        format!("foreshore/{NAME}/op/anna"),
        format!("foreshore/{NAME}/op/anna/drive/drive"),
        format!("foreshore/{NAME}/op/anna/fly"),
        format!("foreshore/{NAME}/op/Ännä/drive"),
        format!("foreshore/{NAME}/op/{}/drive", "a".repeat(5000)),
        format!("foreshore/other/op/anna/drive"),
        Topic::Pose.key(&NAME.parse().unwrap()),
        Topic::Status.key(&NAME.parse().unwrap()),
    ];
    for name in ["anna", "bert", "carla"] {
        let name = name.parse().unwrap();
        let robot = NAME.parse().unwrap();
        keys.extend(OperatorTopic::ALL.map(|topic| operator_key(&robot, &name, topic)));
    }
    keys
}

#[test]
fn garbage_of_every_kind_on_every_key_moves_nothing() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    let session = connected(&robot.endpoint, None);
    let mut rng = SeededRng::new(7);
    let before = robot.edge.memory();
    while_driving(&mut anna, || {
        for length in [0, 1, 2, 113, 114, 115, 123, 124, 256, 257, 5000, 100_000] {
            for key in keys() {
                let garbage = rng.bytes(length);
                session.put(&key, garbage.clone()).wait().unwrap();
                let query = session.get(&key).payload(garbage);
                drop(query.timeout(Duration::from_millis(100)).wait().unwrap());
            }
            sleep(PERIOD);
        }
    });
    let after = robot.edge.memory();
    assert!(
        after < before + 20_000_000,
        "{before} bytes grew to {after}"
    );
    anna.start_driving(CIRCLE);
    robot.verdict(&[&anna.journal]);
}

/// Each byte of a newly signed command is changed; some are truncated.
#[test]
fn tampered_commands_move_nothing() {
    let robot = Robot::start();
    let mut anna = robot.operator("anna");
    // The same name and key, so that only the signature protects the motors.
    let mut model = robot.operator("anna");
    let mut rng = SeededRng::new(8);
    let full_speed = Drive {
        linear_mps: 1.0,
        lateral_mps: 0.0,
        angular_radps: 3.0,
        estop: None,
        docking: None,
        goal: None,
    };
    anna.start_driving(CIRCLE);
    (model.epoch, model.seq) = (anna.epoch, 1_000_000);
    let before = anna.wait_for_new_status();
    let length = model.signed(&full_speed).len();
    let drive = while_driving(&mut anna, || {
        // Within the rate that the vehicle accepts from one name.
        for at in 0..length {
            let mut changed = model.signed(&full_speed);
            changed[at] ^= 1 << (rng.next() % 8);
            model.put(changed);
            sleep(2 * PERIOD);
        }
        for at in [0, 1, 2, 50, 113, 114, length - 1] {
            let mut cut = model.signed(&full_speed);
            cut.truncate(at);
            model.put(cut);
            sleep(2 * PERIOD);
        }
    });
    drove("tampering", &robot.log(), drive);
    let after = anna.wait_for_new_status();
    for reason in [
        Refusal::Signature,
        Refusal::Malformed,
        Refusal::OtherBoot,
        Refusal::OtherEpoch,
    ] {
        let [before, after] = [&before, &after].map(|status| refused(status, reason));
        println!("{reason:?}: {}", after - before);
        assert!(after > before, "{reason:?}");
    }
    robot.verdict(&[&anna.journal]);
}
