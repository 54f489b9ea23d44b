//! Recordings are dropped on the window.

use std::fs;
use std::path::Path;

use tempfile::tempdir;

use super::controls::Controls;
use super::drag_source::DragSource;
use super::processes::{free_port, program, rooms};
use super::screen::Screen;

#[test]
fn a_dropped_recording_opens_and_other_files_are_refused() {
    let Some(screen) = Screen::open() else {
        return;
    };
    let folder = tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let (recording, notes) = (file("two rooms, 50 % of Größe.mcap"), file("my notes.txt"));
    fs::copy(rooms(), &recording).unwrap();
    fs::write(&notes, "these are notes").unwrap();
    let controls = Controls(file("controls"));
    let mut command = program("operator-console");
    screen.show(&mut command);
    command.arg("--config").arg(file("settings.json"));
    command.arg("--controls").arg(&controls.0);
    // No robot listens there.
    command.arg("--connect");
    command.arg(format!("tcp/127.0.0.1:{}", free_port()));
    let Some((console, window)) = screen.open_console(&mut command) else {
        return;
    };
    controls.beginning("Looking for robots");
    let drag = |files: &[&Path]| DragSource::start(&screen, window, files);

    let held = drag(&[&recording, &notes]);
    controls.named(
        "Label",
        "Drop to open two rooms, 50 % of Größe.mcap, the first of 2 files",
    );
    held.leave();
    controls.without("Drop to open");
    controls.without("Open a recording");

    let held = drag(&[&notes]);
    controls.named("Label", "Drop to open my notes.txt");
    held.drop_files();
    controls.without("Drop to open");
    controls.beginning("Open a recording");
    let refusal = controls.beginning(&format!("{}: not a recording", notes.display()));
    assert!(refusal.words.contains("these are notes"), "{refusal:?}");
    assert!(refusal.words.contains("MCAP"), "{refusal:?}");

    drag(&[&recording]).drop_files();
    controls.beginning("Position in the recording: ");
    controls.without("Open a recording");
    controls.named("Label", "two rooms, 50 % of Größe.mcap");
    controls.named("Button", "Pause");
    controls.beginning("Synchronized");

    // Other files do not close an open recording.
    drag(&[&notes]).drop_files();
    controls.beginning(&format!("{}: not a recording", notes.display()));
    controls.beginning("Position in the recording: ");
    screen.close(window);
    console.ends_well();
}
