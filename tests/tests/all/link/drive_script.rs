//! The console drives a simulated robot by a script, over real sessions.

use std::fs;
use std::io;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::thread::{self, sleep};
use std::time::Duration;

use tempfile::tempdir;

use super::processes::{Running, free_port, program, simulate};

fn robot(port: u16) -> Running {
    let listen = format!("tcp/127.0.0.1:{port}");
    let mut command = simulate(&["--robot", "scout", "--listen", &listen]);
    Running::start(&mut command, "edge")
}

/// Starts a console that plays the script for the robot at `port`.
fn starts(port: u16, operator: &str, file: &Path) -> Running {
    let mut command = program("operator-console");
    command
        .args(["--headless", "--robot", "scout", "--operator", operator])
        .arg("--connect")
        .arg(format!("tcp/127.0.0.1:{port}"))
        .args(["drive", "--script"])
        .arg(file);
    Running::start(&mut command, "console")
}

/// Plays the script for the robot at `port`; returns exit code and output.
fn drives(port: u16, operator: &str, script: &str) -> (Option<i32>, String) {
    let folder = tempdir().unwrap();
    let file = folder.path().join("script.txt");
    fs::write(&file, script).unwrap();
    starts(port, operator, &file).end()
}

/// The lines that contain `words`.
fn lines<'a>(printed: &'a str, words: &str) -> Vec<&'a str> {
    printed
        .lines()
        .filter(|line| line.contains(words))
        .collect()
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
    assert_eq!(lines(&printed, "lease held, grant").len(), 2, "{printed}");
    assert_eq!(
        lines(&printed, " Driving, lease of anna").len(),
        3,
        "{printed}"
    );
    assert_eq!(
        lines(&printed, "emergency stop 1 acknowledged").len(),
        1,
        "{printed}"
    );
    assert_eq!(
        lines(&printed, "reset of emergency stop 1: done").len(),
        1,
        "{printed}"
    );
    assert_eq!(lines(&printed, "budget 100: done").len(), 1, "{printed}");
    // Only the hang caused an involuntary stop.
    assert_eq!(lines(&printed, "1 involuntary stops").len(), 1, "{printed}");
}

#[test]
fn a_key_held_before_the_grant_moves_nothing() {
    let port = free_port();
    let _edge = robot(port);
    let script = "\
0.0 press forward
0.0 lease request
0.0 await held
1.5 speed 1
2.0 release forward
2.0 lease release
2.0 await idle
";
    let (code, printed) = drives(port, "anna", script);
    assert_eq!(code, Some(0), "{printed}");
    assert_eq!(lines(&printed, "Driving").len(), 0, "{printed}");
    let accepted: u64 = lines(&printed, "commands accepted")[0]
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    assert!(accepted >= 50, "neutral commands were sent: {printed}");
}

/// The edge hangs for a while and then gets old commands: none moves the vehicle, nor does
/// the key that is still held.
#[test]
fn a_robot_that_hung_obeys_no_old_command() {
    let port = free_port();
    let edge = robot(port);
    let folder = tempdir().unwrap();
    let file = folder.path().join("script.txt");
    let script = "\
0.0 lease request
0.0 await lease
0.4 press left
0.4 await driving
6.0 release left        # the robot hangs and comes back meanwhile
6.5 lease request
6.5 await lease
7.0 press left
7.0 await driving
8.0 release left
8.0 await held
";
    fs::write(&file, script).unwrap();
    let mut console = starts(port, "anna", &file);
    console.wait_for_output(" Driving, lease of anna");
    edge.signal("STOP");
    sleep(Duration::from_millis(1500));
    edge.signal("CONT");
    let (code, printed) = console.end();
    assert_eq!(code, Some(0), "{printed}");
    // `wait_for_output` has read the first.
    assert_eq!(
        lines(&printed, " Driving, lease of anna").len(),
        1,
        "{printed}"
    );
    let stopped = printed.find("applied 0.00 m/s 0.00 rad/s").unwrap();
    assert!(stopped < printed.find(" Driving").unwrap(), "{printed}");
}

#[test]
fn operators_hand_over_and_a_refusal_fails_the_script() {
    let port = free_port();
    let _edge = robot(port);
    let anna = std::thread::spawn(move || {
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
    assert_eq!(lines(&anna, "lease consent bert: done").len(), 1, "{anna}");
    assert_eq!(lines(&anna, "lease lost").len(), 1, "{anna}");
    assert_eq!(
        lines(&bert.1, "lease request: waiting").len(),
        1,
        "{}",
        bert.1
    );
    assert_eq!(lines(&bert.1, "lease held").len(), 1, "{}", bert.1);

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
        assert_eq!(lines(&printed, words).len(), 1, "{words}: {printed}");
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
    assert_eq!(lines(&printed, in_vain).len(), 1, "{printed}");
    assert_eq!(lines(&printed, "emergency stop").len(), 0, "{printed}");
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
    let first = lines(&printed, ", lease of ")[0];
    assert!(first.contains("lease of nobody"), "{printed}");
}

#[test]
fn a_script_error_names_its_line() {
    let (code, printed) = drives(9, "anna", "0.0 lease request\n1.0 honk\n");
    assert_eq!(code, Some(2), "{printed}");
    assert!(
        printed.contains("line 2") && printed.contains("honk"),
        "{printed}"
    );
}

/// A firewall passes the control port and blocks the bulk port.
#[test]
fn a_robot_is_driven_when_its_bulk_port_is_unreachable() {
    let (port, known) = (free_port(), free_port());
    let _edge = robot(port);
    let firewall = TcpListener::bind(("127.0.0.1", known)).unwrap();
    thread::spawn(move || {
        for near in firewall.incoming() {
            let near = near.unwrap();
            // The robot may still be starting.
            let Ok(far) = TcpStream::connect(("127.0.0.1", port)) else {
                continue;
            };
            for (mut from, mut to) in [
                (near.try_clone().unwrap(), far.try_clone().unwrap()),
                (far, near),
            ] {
                thread::spawn(move || drop(io::copy(&mut from, &mut to)));
            }
        }
    });
    let script = "\
0.0 lease request
0.0 await held
0.4 press left
0.4 await driving
1.4 release left
1.4 lease release
1.4 await idle
";
    let (code, printed) = drives(known, "anna", script);
    assert_eq!(code, Some(0), "{printed}");
    assert_eq!(
        lines(&printed, " Driving, lease of anna").len(),
        1,
        "{printed}"
    );
}
