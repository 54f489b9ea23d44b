//! Poses from matched scans: errors against published relations, and maps that are corrected where a loop closes.

use std::thread;

use crate::process::{digest, events, read_json, robot_edge, run};
use crate::shared_data::shared_data;

/// The raw odometry and laser of a log, with a loop of corridors.
#[test]
fn a_log_is_mapped_by_its_scans_within_the_published_error_and_alike_with_two_threads() {
    let Some(logs) = shared_data("carmen") else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let replay = |threads: u32| {
        let (log, out) = (
            logs.join("aces.clf"),
            folder.path().join(threads.to_string()),
        );
        let summary = out.with_extension("json");
        let words = format!(
            "replay --quiet --set localization.source=scan+wheels --set mapping.threads={threads}"
        );
        run(robot_edge(&words)
            .arg(log)
            .args(["--export".as_ref(), out.as_os_str()])
            .args(["--summary".as_ref(), summary.as_os_str()]))
        .succeeds();
        read_json(&summary)
    };
    let [one, two] = thread::scope(|scope| {
        [1, 2]
            .map(|threads| scope.spawn(move || replay(threads)))
            .map(|run| run.join().unwrap())
    });
    assert_eq!(digest(&one), digest(&two));
    let matching = &one["scan_matching"];
    assert_eq!(matching["lost"], 0, "{matching}");
    assert!(matching["closures"].as_u64() > Some(100), "{matching}");
    let closed = events(&one)
        .into_iter()
        .filter(|event| event.contains("a loop was closed"));
    assert!(closed.count() > 0);

    let relations = logs.join("aces.relations");
    let ended = run(robot_edge("evaluate relations")
        .arg(&relations)
        .arg(folder.path().join("1/trajectory.tum")))
    .succeeds();
    let fields: Vec<&str> = ended.stdout.split_whitespace().collect();
    let number = |at: usize| fields[at].trim_end_matches('°').parse::<f64>().unwrap();
    // all: 1279 relations, 0.0358 ± 0.0353 m, 0.380 ± 0.669°
    assert!(number(1) > 1250.0, "{}", ended.stdout);
    assert!(number(3) <= 0.038 && number(7) <= 0.385, "{}", ended.stdout);

    run(robot_edge("evaluate relations").args([&relations, &relations]))
        .refuses(2, &["aces.relations, line 1", "TUM"]);
}
