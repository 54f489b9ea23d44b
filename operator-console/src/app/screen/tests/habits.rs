//! Names of controls, shortcuts, dialogs, saved choices.

use super::*;
use crate::export::Fetching;
use crate::settings::ThemeChoice;

/// Names of all controls for a screen reader, and the controls without a name.
fn controls(window: &Harness<'_, Rig>) -> (Vec<String>, Vec<String>) {
    let mut named = Vec::new();
    let mut unnamed = Vec::new();
    let mut waiting = vec![window.root()];
    while let Some(node) = waiting.pop() {
        waiting.extend(node.children());
        let node = node.accesskit_node();
        let is_control = matches!(
            node.role(),
            Role::Button
                | Role::CheckBox
                | Role::ComboBox
                | Role::Link
                | Role::RadioButton
                | Role::Slider
                | Role::SpinButton
                | Role::TextInput
        );
        if !is_control {
            continue;
        }
        match node.label().or_else(|| node.value()) {
            Some(label) if !label.trim().is_empty() => named.push(label),
            Some(_) | None => unnamed.push(format!("{:?} at {:?}", node.role(), node.raw_bounds())),
        }
    }
    (named, unnamed)
}

#[test]
fn every_control_has_a_name() {
    for rig in [Rig::new(), Rig::live(), Rig::on_water(None)] {
        let mut window = rig.window();
        for panel in PanelId::ALL {
            window.state_mut().screen.workspace.set_wanted(panel, true);
            window.run_steps(2);
            let (named, unnamed) = controls(&window);
            assert_eq!(unnamed, [""; 0], "{panel:?}");
            assert!(named.len() >= 5, "{named:?}");
        }
    }
}

#[test]
fn keys_open_and_close_dialogs() {
    let mut window = Rig::live().window();
    for (modifiers, key, says) in [
        (
            Modifiers::NONE,
            Key::F1,
            "Driving, while you hold the lease",
        ),
        (Modifiers::COMMAND, Key::E, "Trajectory"),
    ] {
        check(&window, &[], &[says]);
        window.key_press_modifiers(modifiers, key);
        window.run_steps(4);
        check(&window, &[says], &[]);
        let (_, unnamed) = controls(&window);
        assert_eq!(unnamed, [""; 0], "{says}");
        window.key_press(Key::Escape);
        window.run_steps(4);
        check(&window, &[], &[says]);
    }
    let scale = |window: &Harness<'_, Rig>| window.state().screen.appearance().scale_percent;
    for (key, percent) in [
        (Key::Plus, 110),
        (Key::Plus, 120),
        (Key::Minus, 110),
        (Key::Num0, 100),
    ] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(2);
        assert_eq!(scale(&window), percent);
    }
    assert_eq!(asked(&mut window), []);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.key_press_modifiers(Modifiers::ALT, Key::Num2);
    window.key_press(Key::ArrowLeft);
    // Text typed after it would go to its dialog.
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run_steps(2);
    assert_eq!(
        asked(&mut window),
        [
            Command::Screenshot,
            Command::Layer(LayerCommand::Show(LayerId::Elevation, false)),
            Command::Look(Look::Beside([-0.1, 0.0])),
            Command::AskForRecording,
        ]
    );
}

/// With a dark or a light system theme the first press changes the theme.
#[test]
fn theme_key_always_changes_the_theme() {
    for system in [egui::Theme::Dark, egui::Theme::Light] {
        let mut window = Rig::live().window();
        window.state().screen.appearance().apply(&window.ctx);
        window.input_mut().system_theme = Some(system);
        window.run_steps(2);
        let seen = |window: &Harness<'_, Rig>| {
            let chosen = window.state().screen.appearance().theme;
            (chosen, window.ctx.theme())
        };
        assert_eq!(seen(&window), (ThemeChoice::System, system));
        let [dark, light] = [
            (ThemeChoice::Dark, egui::Theme::Dark),
            (ThemeChoice::Light, egui::Theme::Light),
        ];
        let expected = match system {
            egui::Theme::Dark => [light, dark, light],
            egui::Theme::Light => [dark, light, dark],
        };
        for expected in expected {
            let modifiers = Modifiers::COMMAND | Modifiers::SHIFT;
            window.key_press_modifiers(modifiers, Key::D);
            window.run_steps(2);
            assert_eq!(seen(&window), expected, "{system:?}");
        }
    }
}

/// Whether an entry of the View menu is enabled, and whether it is ticked.
fn entry(window: &Harness<'_, Rig>, panel: PanelId) -> [bool; 2] {
    let entry = window.get_by_role_and_label(Role::CheckBox, panel.title());
    let entry = entry.accesskit_node();
    let is_ticked = entry.toggled() == Some(egui::accesskit::Toggled::True);
    [!entry.is_disabled(), is_ticked]
}

fn with_view_menu(rig: Rig, size: [f32; 2]) -> Harness<'static, Rig> {
    let mut window = rig.window_of(size);
    window.get_by_label("View").click();
    window.run_steps(4);
    window
}

/// Anna drives.
fn driven() -> Rig {
    let mut rig = Rig::drivable();
    rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
    rig
}

const LARGE: [f32; 2] = [1280.0, 800.0];

#[test]
fn unavailable_panel_is_disabled_with_a_reason() {
    let check = |rig: Rig, size, panel: PanelId, why: &str| {
        let mut window = with_view_menu(rig, size);
        assert_eq!(entry(&window, panel), [false, false], "{panel:?}");
        let place = window.get_by_role_and_label(Role::CheckBox, panel.title());
        let place = place.rect().center();
        window.hover_at(place);
        window.run_steps(8);
        check(&window, &[why], &[]);
    };
    let mut without_motors = Rig::live();
    without_motors.say(Topic::Status, &Status::default());
    let no_motors = "This robot cannot be driven from here";
    check(without_motors, LARGE, PanelId::Driving, no_motors);
    let no_data = "No data about it yet";
    check(Rig::live(), LARGE, PanelId::Driving, no_data);
    let no_shores = "This robot maps no shores";
    check(Rig::live(), LARGE, PanelId::Shores, no_shores);
    check(Rig::new(), LARGE, PanelId::Link, "No robot is shown");
    let recording = || {
        let mut rig = Rig::live();
        rig.link.recording = Some("rooms.mcap".to_owned());
        rig
    };
    let no_drive = "A recording cannot be driven";
    check(recording(), LARGE, PanelId::Driving, no_drive);
    let without_shores = "This recording is mapped without shores";
    check(recording(), LARGE, PanelId::Shores, without_shores);
    let no_room = "Hidden in a small window while you drive";
    check(driven(), [700.0, 620.0], PanelId::Robots, no_room);
}

#[test]
fn view_menu_ticks_open_panels() {
    let check = |rig: Rig, panels: &[PanelId]| {
        let window = with_view_menu(rig, LARGE);
        for panel in panels {
            assert_eq!(entry(&window, *panel), [true, true], "{panel:?}");
        }
    };
    check(Rig::new(), &[PanelId::Robots]);
    check(Rig::on_water(None), &[PanelId::Shores]);
    check(driven(), &[PanelId::Driving, PanelId::Robots]);
    let mut window = with_view_menu(Rig::live(), LARGE);
    let losses = PanelId::Losses;
    window
        .get_by_role_and_label(Role::CheckBox, losses.title())
        .click();
    window.run_steps(4);
    window.get_by_label("View").click();
    window.run_steps(4);
    assert_eq!(entry(&window, losses), [true, false]);
}

#[test]
fn an_export_is_chosen_part_by_part() {
    let mut window = Rig::live().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    let folder = window.get_by_role_and_label(Role::TextInput, "Folder");
    assert!(folder.value().unwrap().contains("foreshore-scout-1-"));
    window
        .get_by_role_and_label(Role::CheckBox, "Trajectory")
        .click();
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "Export").click();
    window.run_steps(2);
    let asked = asked(&mut window);
    let [Command::Export(request)] = &asked[..] else {
        panic!("{asked:?}");
    };
    let parts = [LAYER, LayerId::Elevation].map(ExportPart::Layer);
    assert_eq!(request.parts, parts.into());
    assert!(request.opens_folder);
    // Its folder is named after a robot that is no longer shown.
    assert_eq!(window.query_all_by_label("Folder").count(), 1);
    window.state_mut().screen.forget_robot();
    window.run_steps(2);
    assert_eq!(window.query_all_by_label("Folder").count(), 0);
}

#[test]
fn export_to_home_folder_keeps_unticked_parts() {
    let mut window = Rig::live().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    window
        .get_by_role_and_label(Role::CheckBox, "Open the folder when all is in it")
        .click();
    window.run_steps(2);
    window
        .get_by_role_and_label(Role::TextInput, "Folder")
        .focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(egui::Event::Text("~/maps ".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    let asked = asked(&mut window);
    let [Command::Export(request)] = &asked[..] else {
        panic!("{asked:?}");
    };
    assert_eq!(
        request.folder,
        crate::typed_path::home().unwrap().join("maps")
    );
    assert!(!request.opens_folder);
    let mut settings = Settings::default();
    window.state().screen.keep(&mut settings);
    assert!(!settings.opens_exports);
    let mut again = Settings::default();
    Screen::of(&settings).keep(&mut again);
    assert!(!again.opens_exports);
}

#[test]
fn export_dialog_shows_progress_and_result() {
    let mut window = Rig::live().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.key_press(Key::Backspace);
    window.run_steps(2);
    check(&window, &["Name a folder"], &["The export continues"]);
    window.event(egui::Event::Text("maps".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(2);
    let asked = asked(&mut window);
    let [Command::Export(request)] = &asked[..] else {
        panic!("{asked:?}");
    };
    let folder = std::env::current_dir().unwrap().join("maps");
    assert_eq!(request.folder, folder);

    let mut progress = ExportProgress {
        folder,
        parts: [0, 3],
        current: Some(ExportPart::Voxels),
        fetching: Some(Fetching::Requested),
        ..ExportProgress::default()
    };
    window.state_mut().export = Some(progress.clone());
    window.run_steps(2);
    check(
        &window,
        &["The export continues when this is closed"],
        &["Name a folder"],
    );
    assert!(window.query_by_role(Role::ProgressIndicator).is_some());

    progress.ended = Some(Err("maps is a file".to_owned()));
    window.state_mut().export = Some(progress.clone());
    window.run_steps(2);
    let whole = ["Nothing was exported", "maps is a file"];
    check(&window, &whole, &["The export continues", "Open folder"]);
    progress.files = 2;
    window.state_mut().export = Some(progress);
    window.run_steps(2);
    check(&window, &["Not all was exported", "Open folder"], &[]);
}

#[test]
fn the_layout_is_kept_and_found_again() {
    let mut window = Rig::live().window();
    window.get_by_label("Events").click();
    window.run_steps(2);
    let mut settings = Settings::default();
    window.state().screen.keep(&mut settings);
    let text = serde_json::to_string(&settings).unwrap();
    let mut rig = Rig::live();
    rig.screen = Screen::of(&serde_json::from_str(&text).unwrap());
    check(&rig.window(), &["Filter"], &["Round trip, ms"]);
}
