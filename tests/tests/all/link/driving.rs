//! A simulated robot is driven over real Zenoh sessions, by an operator and by scripts of the console.

use std::fs;
use std::thread::{self, sleep};
use std::time::Duration;

use foreshore_tests::operator::{Input, NEUTRAL, Operator, refused};
use foreshore_tests::rig::relay::Relay;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use protocol::message::{
    Answer, Clamp, EStop, LeaseRequest, Refusal, Reset, Setting, StopReason, TeleopState,
    TeleopStatus,
};
use protocol::signed::SecretKey;
use tempfile::tempdir;

use crate::processes::{Running, free_port, simulate, start, tcp};

fn robot(port: u16) -> Running {
    simulate(&format!("--listen {}", tcp(port)))
}

fn operator(port: u16, name: &str) -> Operator {
    Operator::ready(&tcp(port), "scout", name)
}

#[test]
fn silence_old_commands_and_held_keys_move_nothing() {
    let port = free_port();
    let _edge = robot(port);
    let mut anna = operator(port, "anna");
    anna.take_lease();

    // A key held before the grant moves nothing.
    anna.hold(Input::of(0.0, 0.5), NEUTRAL);
    let held = anna.wait_for_status("held", |teleop| teleop.state == TeleopState::Held);
    assert_eq!(held.lease.holder, Some(anna.name.clone()));
    assert!(held.applied.angular_radps.abs() < 1e-6, "{held:?}");

    anna.hold(Input::NEUTRAL, NEUTRAL);
    let driven = anna.hold(Input::of(0.0, 0.5), Duration::from_millis(1500));
    let status = anna.wait_for_status("driving", |teleop| teleop.applied.angular_radps > 0.45);
    assert_eq!(status.state, TeleopState::Driving);
    assert!(anna.turn_rate_radps() > 0.3, "{}", anna.turn_rate_radps());

    // The operator sends nothing any more.
    let stopped = anna.wait_for_status("stopped", |teleop| {
        teleop.state == TeleopState::Held || teleop.state == TeleopState::Idle
    });
    assert_eq!(stopped.last_stop, Some(StopReason::Age));
    assert!(stopped.applied.angular_radps.abs() < 1e-6, "{stopped:?}");
    assert_eq!(stopped.counters.involuntary_stops, 1);

    // Repeated commands move nothing, nor does the key that is still down.
    let all_refused = |teleop: &TeleopStatus| -> u64 {
        let refused = teleop.counters.refused.iter();
        refused.map(|refused| refused.count).sum()
    };
    let before = all_refused(&anna.wait_for_status("shown", |_| true));
    for _ in 0..20 {
        anna.put(driven.clone());
        // Not so fast that a busy machine drops some.
        sleep(Duration::from_millis(5));
    }
    anna.wait_for_status("refused", |teleop| all_refused(teleop) >= before + 20);
    anna.take_lease();
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(800));
    let locked = anna.wait_for_status("shown", |_| true);
    assert!(locked.applied.angular_radps.abs() < 1e-6, "{locked:?}");
    sleep(Duration::from_millis(300));
    assert!(
        anna.turn_rate_radps().abs() < 0.02,
        "{}",
        anna.turn_rate_radps()
    );

    // Released and pressed again, it turns.
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, -0.5), Duration::from_millis(1200));
    anna.wait_for_status("turning right", |teleop| {
        teleop.applied.angular_radps < -0.3
    });
}

#[test]
fn wheels_are_set_while_it_stands_and_it_goes_sideways_to_a_wall() {
    let port = free_port();
    let _edge = simulate(&format!(
        "--listen {} --set motors.modes.crab=true",
        tcp(port)
    ));
    let mut anna = operator(port, "anna");
    anna.take_lease();
    anna.hold(Input::NEUTRAL, NEUTRAL);
    let hold_until = |anna: &mut Operator, input, is_so: &dyn Fn(&TeleopStatus) -> bool| {
        let seen = (0..400).find_map(|_| {
            anna.hold(input, Duration::from_millis(100));
            anna.teleop().filter(is_so)
        });
        seen.unwrap_or_else(|| panic!("{:?}", anna.teleop()))
    };
    let ahead = Input::of(0.2, 0.0);
    hold_until(&mut anna, ahead, &|it| it.applied.linear_mps > 0.15);
    let sideways = Input {
        lateral_mps: -0.3,
        ..Input::NEUTRAL
    };
    let waits = |it: &TeleopStatus| it.clamp == Some(Clamp::Locomotion);
    let waiting = hold_until(&mut anna, sideways, &waits);
    assert!(waiting.applied.lateral_mps.abs() < 1e-6, "{waiting:?}");
    // It creeps: its laser does not see the ground beside its rear.
    let going = hold_until(&mut anna, sideways, &|it| it.applied.lateral_mps < -0.09);
    assert!(going.applied.angular_radps.abs() < 1e-6, "{going:?}");
    anna.hold(sideways, Duration::from_millis(500));
    assert!(anna.pose().lateral_mps < -0.07, "{:?}", anna.pose());
    let is_before_a_wall = |it: &TeleopStatus| {
        it.clamp == Some(Clamp::CollisionMonitor) && it.applied.lateral_mps.abs() < 0.01
    };
    let stopped = hold_until(&mut anna, sideways, &is_before_a_wall);
    let barrier = stopped.barrier.expect("a wall");
    let pose = anna.pose();
    let [x, y, z, w] = pose.quaternion_xyzw.map(f64::from);
    let odom_from_base = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let [at_x, at_y] =
        [0, 1].map(|axis| f64::from(barrier.position_m[axis]) - pose.position_m[axis]);
    let to = odom_from_base.inverse_transform_vector(&Vector3::new(at_x, at_y, 0.0));
    // Half of its width of 0.381 m, and the margin of 0.1 m.
    assert!((to.y + 0.29).abs() < 0.05, "{to:?}");
}

#[test]
fn an_emergency_stop_holds_until_it_is_reset() {
    let port = free_port();
    let _edge = robot(port);
    let (mut anna, mut bert) = (operator(port, "anna"), operator(port, "bert"));
    anna.take_lease();
    assert_eq!(bert.ask(&LeaseRequest::Request), Answer::Waiting);
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, 0.5), Duration::from_secs(1));

    // The emergency stop needs no lease.
    let stopped = bert.ask(&EStop { press: 77 });
    let Answer::EStopped(number) = stopped else {
        panic!("{stopped:?}")
    };
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(400));
    anna.hold(Input::NEUTRAL, NEUTRAL);
    anna.hold(Input::of(0.0, 0.5), Duration::from_millis(400));
    let status = anna.wait_for_status("stopped", |teleop| teleop.state == TeleopState::EStop);
    assert!(status.applied.angular_radps.abs() < 1e-6, "{status:?}");

    assert_eq!(
        bert.ask(&Reset { estop: number + 1 }),
        Answer::Refused(Refusal::OtherEStop)
    );
    assert_eq!(bert.ask(&Reset { estop: number }), Answer::Done);
    anna.wait_for_status("idle", |teleop| teleop.state == TeleopState::Idle);
    // A late repetition of the press is refused.
    assert_eq!(
        bert.ask(&EStop { press: 77 }),
        Answer::Refused(Refusal::NoEStop)
    );
    assert_eq!(bert.ask(&Setting::BudgetKbps(64)), Answer::Done);
    anna.wait_for_status("set", |teleop| teleop.settings.budget_kbps == 64);
}

#[test]
fn a_signature_of_another_operator_moves_nothing() {
    let port = free_port();
    let _edge = robot(port);
    let (mut anna, mut mallory) = (operator(port, "anna"), operator(port, "anna"));
    mallory.key = SecretKey::from_seed(&[9; 32]);
    anna.take_lease();
    assert_eq!(
        mallory.ask(&LeaseRequest::Release),
        Answer::Refused(Refusal::Signature)
    );
    (mallory.epoch, mallory.seq) = (anna.epoch, 1000);
    mallory.hold(Input::NEUTRAL, Duration::from_millis(300));
    mallory.hold(Input::of(0.0, 0.5), Duration::from_millis(300));
    let status = anna.wait_for_status("refused", |teleop| {
        refused(teleop, Refusal::Signature) >= 10
    });
    assert!(status.applied.angular_radps.abs() < 1e-6, "{status:?}");
    assert_eq!(status.counters.accepted, 0);
}

/// Plays the script for the robot at `port`; returns exit code and output.
fn drives(port: u16, operator: &str, script: &str) -> (Option<i32>, String) {
    let folder = tempdir().unwrap();
    let file = folder.path().join("script.txt");
    fs::write(&file, script).unwrap();
    let console = start(&format!(
        "operator-console --headless --robot scout --operator {operator} --connect {} drive --script {}",
        tcp(port),
        file.display()
    ));
    console.end()
}

/// Number of lines that contain `words`.
fn count(printed: &str, words: &str) -> usize {
    printed.lines().filter(|line| line.contains(words)).count()
}

#[test]
fn a_script_error_ends_the_program_before_anything_is_sent() {
    let (code, printed) = drives(9, "anna", "0.0 lease request\n1.0 honk\n");
    assert_eq!(code, Some(2), "{printed}");
    assert!(printed.contains("line 2"), "{printed}");
    assert!(printed.contains("honk"), "{printed}");
}

#[test]
fn a_script_drives_stops_and_emergency_stops() {
    let port = free_port();
    let _edge = robot(port);
    let script = "\
0.0 lease request
0.0 await held
# Held before the grant: it moves nothing until it is pressed again.
0.4 press left
0.4 await driving
1.2 focus off           # the window loses the keyboard
1.2 await held
1.4 focus on
1.8 press right
1.8 await driving
2.4 freeze 1.5          # the program hangs with the key down
2.5 await held
3.2 release all
3.6 press left
3.6 await driving
4.0 estop
4.0 await estop
4.2 release all
4.2 reset
4.2 await idle
4.4 budget 100
5.0 lease request
5.0 await held
5.2 lease release
5.2 await idle
";
    let (code, printed) = drives(port, "anna", script);
    assert_eq!(code, Some(0), "{printed}");
    for (words, times) in [
        ("lease held, grant", 2),
        (" Driving, lease of anna", 3),
        ("emergency stop 1 acknowledged", 1),
        ("reset of emergency stop 1: done", 1),
        ("budget 100: done", 1),
        // Only the hang caused an involuntary stop.
        ("1 involuntary stops", 1),
    ] {
        assert_eq!(count(&printed, words), times, "{words}: {printed}");
    }
}

#[test]
fn operators_hand_over_and_a_refusal_fails_the_script() {
    let port = free_port();
    let _edge = robot(port);
    let anna = thread::spawn(move || {
        drives(
            port,
            "anna",
            "0.0 lease request\n0.0 await lease\n3.0 lease consent bert\n6.0 focus on\n",
        )
    });
    let bert = drives(
        port,
        "bert",
        "1.0 lease request\n1.0 await lease 20\n2.0 lease release\n2.0 await idle\n",
    );
    let (anna_code, anna) = anna.join().unwrap();
    assert_eq!(
        (anna_code, bert.0),
        (Some(0), Some(0)),
        "{anna}\n{}",
        bert.1
    );
    assert_eq!(count(&anna, "lease consent bert: done"), 1, "{anna}");
    assert_eq!(count(&anna, "lease lost"), 1, "{anna}");
    assert_eq!(count(&bert.1, "lease request: waiting"), 1, "{}", bert.1);
    assert_eq!(count(&bert.1, "lease held"), 1, "{}", bert.1);

    let (code, printed) = drives(
        port,
        "anna",
        "0 reset\n0 lease consent bert\n1 estop\n1 await held 1",
    );
    assert_eq!(code, Some(1), "{printed}");
    for words in [
        "line 1: there is no emergency stop",
        "lease consent bert refused",
        "emergency stop 1 acknowledged",
        "line 4: waited in vain for held",
    ] {
        assert_eq!(count(&printed, words), 1, "{printed}");
    }
    assert!(
        !printed.contains("left out"),
        "no line was left out: {printed}"
    );
}

/// Later lines rely on the state that was not reached.
#[test]
fn a_timed_out_await_ends_the_script() {
    let port = free_port();
    let _edge = robot(port);
    let script = "\
0.0 lease request
0.0 await lease
0.4 press left
0.4 await driving
0.6 await fault 0.5
0.6 estop
0.6 await estop
";
    let (code, printed) = drives(port, "anna", script);
    assert_eq!(code, Some(1), "{printed}");
    let in_vain = "line 5: waited in vain for fault; the rest is left out";
    assert_eq!(count(&printed, in_vain), 1, "{printed}");
    assert_eq!(count(&printed, "emergency stop"), 0, "{printed}");
}

/// A script that ends while driving releases the lease, so the next need not wait until it expires.
#[test]
fn a_script_that_ends_releases_the_lease() {
    let port = free_port();
    let _edge = robot(port);
    let (code, printed) = drives(
        port,
        "anna",
        "0 lease request\n0 await lease\n0.4 press left\n0.4 await driving\n",
    );
    assert_eq!(code, Some(0), "{printed}");
    // Time to receive a status, less than the lease lasts.
    let (code, printed) = drives(port, "bert", "0.5 lease request\n0.5 await lease 20\n");
    assert_eq!(code, Some(0), "{printed}");
    let first = printed.lines().find(|line| line.contains(", lease of "));
    assert!(first.unwrap().contains("lease of nobody"), "{printed}");
}

/// A firewall passes the control port and blocks the bulk port.
#[test]
fn a_robot_is_driven_when_its_bulk_port_is_unreachable() {
    let port = free_port();
    let _edge = robot(port);
    let firewall = Relay::start(0, ([127, 0, 0, 1], port).into()).unwrap();
    let script = "\
0.0 lease request
0.0 await held
0.4 press left
0.4 await driving
1.4 release left
1.4 lease release
1.4 await idle
";
    let (code, printed) = drives(firewall.port(), "anna", script);
    assert_eq!(code, Some(0), "{printed}");
    assert_eq!(count(&printed, " Driving, lease of anna"), 1, "{printed}");
}
