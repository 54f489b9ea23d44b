//! The same input gives the same map, however fast, with however many threads, however often.

use crate::process::{digest, robot_edge, rooms, summary_of};

fn digest_with(options: &str) -> String {
    let summary = summary_of(
        robot_edge("replay")
            .arg(rooms())
            .args(options.split_whitespace()),
    );
    assert_eq!(
        summary["scans"]["dropped"],
        serde_json::json!({}),
        "{options}"
    );
    digest(&summary).to_owned()
}

/// All of `options` give one digest, which is returned.
#[track_caller]
fn one_digest(options: &[&str]) -> String {
    let digests: Vec<_> = options.iter().map(|options| digest_with(options)).collect();
    for (options, digest) in options.iter().zip(&digests) {
        assert_eq!(*digest, digests[0], "{options}");
    }
    digests.into_iter().next().unwrap()
}

#[test]
fn threads_and_repetition_change_nothing() {
    one_digest(&[
        "",
        "--rate max",
        "--set mapping.threads=1",
        "--set mapping.threads=2",
        "--set mapping.threads=2",
    ]);
}

#[test]
fn ten_times_the_speed_changes_nothing() {
    one_digest(&[
        "--duration 20",
        "--rate 10 --duration 20",
        "--rate 10 --duration 20 --set mapping.threads=2",
    ]);
}

#[test]
fn real_time_changes_nothing() {
    let three = one_digest(&[
        "--duration 3",
        "--rate 1 --duration 3",
        "--rate 1 --duration 3 --set mapping.threads=2",
    ]);
    assert_ne!(three, digest_with("--duration 20"));
}

#[test]
fn settings_that_matter_change_the_map() {
    let usual = digest_with("");
    assert_ne!(usual, digest_with("--set mapping.occupancy.cell_m=0.05"));
    assert_ne!(usual, digest_with("--set mapping.occupancy.p_free=0.4"));
    assert_ne!(usual, digest_with("--set mapping.occupancy.miss=free"));
}
