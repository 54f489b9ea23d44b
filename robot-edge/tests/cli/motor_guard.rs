//! The hidden command that owns the motors, as the program that is shipped.

use std::process::Stdio;

use crate::process::{Ended, robot_edge};

const CONFIG: &str = r#"{"port":"/dev/nonexistent","left_channel":"one","drive":{"track_width_m":0.5,"full_speed_mps":1.0}}"#;

#[test]
fn it_tells_what_it_knows_and_ends_when_its_pipe_closes() {
    let mut guard = robot_edge("motor-guard");
    let ended = guard.arg(CONFIG).stdin(Stdio::null()).output().unwrap();
    assert!(ended.status.success());
    // Frames of 88 bytes, the first of which begins like this.
    assert_eq!(ended.stdout.get(..4), Some([0xF5, b'M', 1, 2].as_slice()));
    assert_eq!(ended.stdout.len() % 88, 0);
    assert!(
        ended.stderr.is_empty(),
        "a terminal that is stopped would stop it"
    );
}

#[test]
fn a_configuration_that_is_none_is_refused_as_wrong_usage() {
    let ended = robot_edge("motor-guard {\"port\":1}").output().unwrap();
    let ended = Ended::from(ended);
    assert_eq!(ended.code, Some(2));
    assert!(ended.stderr.contains("motor guard: "), "{}", ended.stderr);
}

#[test]
fn it_is_not_offered() {
    let help = Ended::from(robot_edge("--help").output().unwrap());
    assert!(!help.stdout.contains("motor-guard"));
}
