//! Poses from matched scans: errors against published relations, and maps that are corrected where a loop closes.

use std::{fs, thread};

use crate::process::{digest, events, read_json, robot_edge, run, summary_of};
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
    let covariances =
        fs::read_to_string(folder.path().join("1/trajectory_covariance.txt")).unwrap();
    let matched = ["determined", "uncertain_along", "odometry_only", "lost"]
        .map(|key| matching[key].as_u64().unwrap());
    assert_eq!(
        covariances.lines().count() as u64,
        matched.iter().sum::<u64>()
    );
    let numbers = covariances.lines().last().unwrap().split(' ');
    let numbers: Vec<f64> = numbers.map(|number| number.parse().unwrap()).collect();
    assert_eq!(numbers.len(), 7);
    assert!(
        numbers[1] > 0.0 && numbers[4] > 0.0 && numbers[6] > 0.0,
        "{numbers:?}"
    );
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

/// A run in the rooms, and another that goes on in its map from the same place, of which it knows nothing.
#[test]
fn a_saved_map_is_gone_on_in_and_a_damaged_one_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
    let simulate = |more: &str| {
        robot_edge(&format!(
            "simulate rooms --rate max --set localization.source=scan+wheels {more}"
        ))
    };
    let first = summary_of(simulate("--duration 60").arg("--save-map").arg(&one));
    let again = run(simulate("--duration 1 --quiet").arg("--save-map").arg(&one));
    again.refuses(2, &["one", "exists already"]);

    let on = summary_of(
        simulate("--duration 25 --seed 2")
            .arg("--map")
            .arg(&one)
            .arg("--save-map")
            .arg(&two),
    );
    assert_eq!(on["scan_matching"]["is_searching"], false);
    let joined = |summary| {
        events(summary)
            .iter()
            .any(|event| event.contains("an older map was joined"))
    };
    assert!(joined(&on), "{:?}", events(&on));
    // What the second run did not see is there.
    let known =
        |summary: &serde_json::Value| summary["layers"]["occupancy"]["cells_known"].as_u64();
    assert!(
        known(&on) >= known(&first),
        "{:?} {:?}",
        known(&on),
        known(&first)
    );
    let third = summary_of(
        simulate("--duration 25 --seed 3 --near 0,0,0")
            .arg("--map")
            .arg(&two),
    );
    assert!(joined(&third), "{:?}", events(&third));

    for (file, says) in [
        ("map.bin", "damaged"),
        ("scans.bin", "are not those of the map"),
    ] {
        let path = one.join(file);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, &bytes).unwrap();
        run(simulate("--duration 1 --quiet").arg("--map").arg(&one)).refuses(2, &[file, says]);
        bytes[middle] ^= 1;
        fs::write(&path, &bytes).unwrap();
    }
    let elsewhere = folder.path().join("none");
    run(simulate("--duration 1 --quiet")
        .arg("--map")
        .arg(&elsewhere))
    .refuses(2, &["no map can be read here"]);
    let by_tf = run(robot_edge("simulate rooms --rate max --duration 1 --quiet --map").arg(&two));
    by_tf.refuses(2, &["--map and --save-map need poses from matched scans"]);
    run(&mut simulate("--quiet --near 1,2 --map x")).refuses(2, &["12.5,-3,90"]);
}
