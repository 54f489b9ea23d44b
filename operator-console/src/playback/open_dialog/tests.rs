use std::fs;
use std::sync::Arc;
use std::time::Duration;

use eframe::egui::{DroppedFile, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

use super::*;

struct State {
    dialog: OpenDialog,
    opened: Vec<PathBuf>,
}

fn harness(dialog: OpenDialog) -> Harness<'static, State> {
    let state = State {
        dialog,
        opened: Vec::new(),
    };
    Harness::builder()
        .with_size(vec2(700.0, 500.0))
        .build_ui_state(
            |ui, state: &mut State| {
                let ctx = ui.ctx().clone();
                state.opened.extend(state.dialog.show(&ctx));
            },
            state,
        )
}

#[test]
fn a_recording_is_found_by_its_beginning() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["rooms.mcap", "roof.mcap"] {
        fs::write(folder.path().join(name), "").unwrap();
    }
    let mut harness = harness(OpenDialog::default());
    harness.run();
    assert!(harness.query_by_label("Open a recording").is_none());
    harness.state_mut().dialog.open(None);
    harness.run_steps(3);
    let typed = format!("{}/roo", folder.path().display());
    harness.event(eframe::egui::Event::Text(typed.clone()));
    harness.run_steps(3);
    let offered = harness.state().dialog.completions.offered.clone();
    assert_eq!(
        offered,
        [format!("{typed}f.mcap"), format!("{typed}ms.mcap")]
    );
    harness.event(eframe::egui::Event::Text("m".to_owned()));
    harness.run_steps(3);
    harness.key_press(Key::Tab);
    harness.run_steps(3);
    assert_eq!(harness.state().dialog.path, format!("{typed}ms.mcap"));
    harness.event(eframe::egui::Event::Text("x".to_owned()));
    harness.run_steps(3);
    assert_eq!(harness.state().dialog.path, format!("{typed}ms.mcapx"));
    harness.key_press(Key::Backspace);
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    assert_eq!(
        harness.state().opened,
        [PathBuf::from(format!("{typed}ms.mcap"))]
    );
}

#[test]
fn the_newest_of_many_recordings_is_there_and_what_is_not_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    for number in 0..12_u64 {
        let path = folder.path().join(format!("lake-{number:02}.mcap"));
        fs::write(&path, "").unwrap();
        let file = fs::File::options().append(true).open(&path).unwrap();
        let now = file.metadata().unwrap().modified().unwrap();
        let age = Duration::from_secs(100 - number);
        file.set_modified(now - age).unwrap();
    }
    let mut harness = harness(OpenDialog::default());
    let open = &mut harness.state_mut().dialog;
    open.open(Some(folder.path().to_owned()));
    harness.run_steps(3);
    harness.get_by_label_contains("lake-11.mcap");
    assert!(harness.query_by_label_contains("lake-00.mcap").is_none());
    harness.get_by_label("2 more recordings: type how a name begins");
}

#[test]
fn the_recordings_of_a_folder_are_offered_and_any_other_path_is_typed_over_it() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("rooms.mcap");
    fs::write(&recording, "").unwrap();
    fs::write(folder.path().join("sea.mcap"), "").unwrap();
    let typed = as_typed(folder.path(), home().as_deref()).unwrap();
    let mut harness = harness(OpenDialog::default());
    let open = |harness: &mut Harness<'static, State>, folder: PathBuf| {
        harness.state_mut().dialog.close();
        harness.run_steps(2);
        harness.state_mut().dialog.open(Some(folder));
        harness.run_steps(3);
    };
    open(&mut harness, folder.path().to_owned());
    assert_eq!(harness.state().dialog.path, typed);
    let mut offered = harness.state().dialog.completions.offered.clone();
    offered.sort();
    assert_eq!(
        offered,
        ["rooms", "sea"].map(|name| format!("{typed}{name}.mcap"))
    );
    // There is a folder, and not yet a recording.
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    assert!(harness.state().opened.is_empty());
    harness.event(eframe::egui::Event::Text("ro".to_owned()));
    harness.run_steps(3);
    assert_eq!(harness.state().dialog.path, format!("{typed}ro"));

    open(&mut harness, folder.path().to_owned());
    harness.event(eframe::egui::Event::Text("/x".to_owned()));
    harness.run_steps(3);
    assert_eq!(harness.state().dialog.path, "/x");
    open(&mut harness, folder.path().join("gone"));
    assert_eq!(harness.state().dialog.path, "/x");

    open(&mut harness, folder.path().to_owned());
    harness.get_by_label(&format!("{typed}rooms.mcap")).click();
    harness.run_steps(3);
    assert_eq!(harness.state().opened, [recording]);
}

#[test]
fn return_opens_the_only_recording_that_is_offered() {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("rooms.mcap");
    fs::write(&recording, "").unwrap();
    let mut harness = harness(OpenDialog::default());
    let dialog = &mut harness.state_mut().dialog;
    dialog.open(Some(folder.path().to_owned()));
    harness.run_steps(3);
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    assert_eq!(harness.state().opened, [recording]);
}

#[test]
fn a_folder_is_shown_as_it_would_be_typed() {
    let check = |folder: &str, expected: &str| {
        let home = Some(Path::new("/home/anna"));
        let shown = as_typed(Path::new(folder), home).unwrap();
        assert_eq!(Path::new(&shown), Path::new(expected), "{folder}");
        assert!(is_folder(&shown), "{shown}");
    };
    check("/home/anna/maps", "~/maps/");
    check("/home/anna/maps/", "~/maps/");
    check("/home/anna", "~/");
    check("/home/annabel/maps", "/home/annabel/maps/");
    check("/", "/");
}

#[test]
fn a_recording_in_the_home_folder_is_opened_there() {
    let mut dialog = OpenDialog::default();
    dialog.refuse("~/no such day.mcap".to_owned(), "gone".to_owned());
    let mut harness = harness(dialog);
    harness.run_steps(3);
    harness.key_press(Key::Enter);
    harness.run_steps(3);
    let home = crate::typed_path::home().unwrap();
    assert_eq!(harness.state().opened, [home.join("no such day.mcap")]);
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        Err("nobody reads it here".to_owned())
    }
}

#[test]
fn a_recording_that_is_dropped_on_the_window_is_opened() {
    for is_open in [false, true] {
        let mut dialog = OpenDialog::default();
        if is_open {
            dialog.open(None);
        }
        let mut harness = harness(dialog);
        harness.run_steps(2);
        let file = Dropped(PathBuf::from("rooms.mcap"));
        harness.input_mut().dropped_files.push(Arc::new(file));
        harness.run_steps(2);
        assert_eq!(harness.state().opened, [PathBuf::from("rooms.mcap")]);
    }
}

#[test]
fn what_could_not_be_opened_is_said_and_asked_for_again() {
    let mut dialog = OpenDialog::default();
    dialog.refuse(
        "notes.txt".to_owned(),
        "notes.txt: not a recording".to_owned(),
    );
    let mut harness = harness(dialog);
    harness.run_steps(3);
    harness.get_by_label("notes.txt: not a recording");
    harness.get_by_label("Cancel").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Open a recording").is_none());
    assert!(harness.state().opened.is_empty());
}
