//! `experiments`: a page with pictures, and exit codes.

use std::fs;

use crate::process::{robot_edge, run};

#[test]
fn a_page_is_written_with_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let ended = run(robot_edge("experiments l1 L1").arg("--out").arg(&out)).succeeds();
    let page = out.join("experiments.md");
    assert_eq!(ended.stdout, format!("{}\n", page.display()));
    assert!(ended.stderr.starts_with("L1 pass ("), "{}", ended.stderr);
    assert_eq!(ended.stderr.lines().count(), 1);
    let text = fs::read_to_string(page).unwrap();
    assert_eq!(
        text.matches("\n## ").count(),
        1,
        "asked for twice, shown once"
    );
    for line in text.lines().filter(|line| line.contains("](experiments/")) {
        for link in line.split("](").skip(1) {
            let (file, _) = link.split_once(')').unwrap();
            assert!(out.join(file).is_file(), "{file}");
        }
    }
    assert!(text.contains("](experiments/l1-agreement.png)"));
}

#[test]
fn what_is_no_experiment_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("report");
    let ended = run(robot_edge("experiments E99").arg("--out").arg(&out));
    ended.refuses(2, &["`E99`", "H6, L1, L2"]);
    assert!(!out.exists());
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    run(robot_edge("experiments L1").arg("--out").arg(&file)).refuses(1, &["file"]);
}
