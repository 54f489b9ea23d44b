//! `recover`: what a cut-off recording still holds goes into a whole one.

use std::fs;

use crate::process::{digest, events, robot_edge, rooms, run, summary_of};

#[test]
fn a_cut_recording_is_salvaged_and_maps_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (cut, saved) = (
        folder.path().join("cut.mcap"),
        folder.path().join("saved.mcap"),
    );
    let whole = fs::read(rooms()).unwrap();
    fs::write(&cut, &whole[..1_500_000]).unwrap();

    let of_cut = summary_of(robot_edge("replay").arg(&cut));
    assert_eq!(of_cut["scans"]["mapped"], 542);
    assert!(
        events(&of_cut).contains(&"loss: the recording lost 1 × cut_off".to_owned()),
        "{:?}",
        events(&of_cut)
    );

    let recovered = run(robot_edge("recover").arg(&cut).arg(&saved)).succeeds();
    assert_eq!(
        recovered
            .stdout
            .replace(&folder.path().display().to_string(), ""),
        "byte 1302902: the file ends in the middle of a record\n\
         /saved.mcap: 5963 messages saved, lost: 1 × cut_off\n"
    );
    assert!(
        fs::read(&cut).unwrap() == whole[..1_500_000],
        "the damaged file was changed"
    );

    let of_saved = summary_of(robot_edge("replay").arg(&saved));
    assert_eq!(digest(&of_saved), digest(&of_cut));
    assert_eq!(of_saved["vehicle"], "pioneer");
    assert!(
        events(&of_saved)
            .iter()
            .all(|event| event.starts_with("setup: "))
    );
}

#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let precious = folder.path().join("precious.mcap");
    fs::write(&precious, "precious").unwrap();
    run(robot_edge("recover").arg(rooms()).arg(&precious))
        .refuses(2, &["precious.mcap", "exists already", "another name"]);
    assert_eq!(fs::read(&precious).unwrap(), b"precious");

    let same = folder.path().join("same.mcap");
    fs::copy(rooms(), &same).unwrap();
    run(robot_edge("recover").arg(&same).arg(&same)).refuses(2, &["exists already"]);
    assert!(fs::read(&same).unwrap() == fs::read(rooms()).unwrap());
}

#[test]
fn what_cannot_be_salvaged_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let recover = |from: &str| {
        let ended = run(robot_edge("recover")
            .arg(place(from))
            .arg(place("out.mcap")));
        assert!(!place("out.mcap").exists(), "{ended:?}");
        ended
    };
    recover("missing.mcap").refuses(3, &["missing.mcap", "No such file"]);
    fs::write(place("text.mcap"), "no recording at all").unwrap();
    recover("text.mcap").refuses(3, &["not a recording this program reads"]);
    fs::write(place("empty.mcap"), "").unwrap();
    recover("empty.mcap").refuses(3, &["it is empty"]);
    fs::write(place("a.bag"), "#ROSBAG V2.0\n").unwrap();
    recover("a.bag").refuses(
        2,
        &[
            "ROS 1 bag",
            "recover writes MCAP from MCAP",
            "replay",
            "--record",
            "--set localization.source=static",
        ],
    );
    // What it proposes to write is MCAP by its name too.
    let as_mcap = format!("--record {} writes", place("saved.mcap").display());
    run(robot_edge("recover")
        .arg(place("a.bag"))
        .arg(place("saved.bag")))
    .refuses(2, &[as_mcap.as_str()]);
    run(robot_edge("recover")
        .arg(rooms())
        .arg(place("no/such/out.mcap")))
    .refuses(
        1,
        &["out.mcap", "cannot write what was saved", "No such file"],
    );
}
