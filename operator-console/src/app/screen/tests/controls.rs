//! Robots are found, chosen and changed; names of controls, shortcuts, dialogs, saved choices.

use super::*;
use crate::export::FetchProgress;
use crate::settings::ThemeChoice;

#[test]
fn first_run_page_explains_how_to_connect() {
    let rig = Rig::new();
    check(
        &rig.window(),
        &[
            "Looking for robots",
            "No robot found yet.",
            "operator-console --demo lake",
            "Type an address",
            "Open recording…",
        ],
        &["Live", "Synchronized", "Whole map"],
    );
}

#[test]
fn starting_demo_needs_no_input() {
    let mut rig = Rig::new();
    let robots =
        |failure| RobotsData::new(&[], None, SearchTarget::Demo { failure }, None, at(1_000));
    rig.robots = robots(None);
    check(
        &rig.window(),
        &["Starting the demo…"],
        &["Looking for", "To begin", "--demo"],
    );
    let mut rig = Rig::new();
    rig.robots = robots(Some("the port is taken".to_owned()));
    check(
        &rig.window(),
        &["The demo has ended", "the port is taken", "To begin"],
        &["Starting the demo…"],
    );
}

#[test]
fn fast_typed_address_is_complete() {
    let mut window = Rig::new().window();
    for address in ["tcp/10.0.0.5:7447", "tcp/10.0.0.6:7447"] {
        let enter = [true, false].map(|pressed| egui::Event::Key {
            key: Key::Enter,
            physical_key: None,
            pressed,
            repeat: false,
            modifiers: Modifiers::NONE,
        });
        // All in one frame, as on a slow machine.
        window.key_press_modifiers(Modifiers::COMMAND, Key::L);
        window.event(egui::Event::Text(address.to_owned()));
        for event in enter {
            window.event(event);
        }
        window.run_steps(6);
        let commands = asked(&mut window);
        assert_eq!(commands, [Command::AddAddress(address.to_owned())]);
    }
    // A rejected address stays for correction and is replaced by typing.
    for (typed, refused) in [("nowhere", true), ("tcp/boat:9", false)] {
        window.key_press_modifiers(Modifiers::COMMAND, Key::L);
        window.run_steps(4);
        window.event(egui::Event::Text(typed.to_owned()));
        window.key_press(Key::Enter);
        window.run_steps(4);
        let commands = asked(&mut window);
        assert_eq!(commands.is_empty(), refused, "{commands:?}");
    }
}

fn found(robot: &str) -> FoundRobot {
    FoundRobot {
        robot: robot.parse().unwrap(),
        endpoint: format!("tcp/{robot}:7447"),
    }
}

fn two_robots() -> Rig {
    let seen = ["scout-1", "boat-7"].map(|robot| RobotEntry {
        discovered: DiscoveredRobot {
            found: found(robot),
            seen: at(1_000),
            state: None,
        },
        color: Color32::RED,
        alerts: 0,
        uncommanded_motion: None,
    });
    let current = Some((&name(), LinkState::Live));
    Rig {
        robots: RobotsData::new(&seen, current, SearchTarget::Any, None, at(1_000)),
        ..Rig::live()
    }
}

#[test]
fn the_operator_chooses_robots_addresses_and_layers() {
    let mut window = two_robots().window();
    window.get_by_label("Robots").click();
    window.run_steps(4);
    window.get_by_label("boat-7").click();
    window.run_steps(2);
    window.get_by_label("Elevation").click();
    window.run_steps(2);
    assert_eq!(
        asked(&mut window),
        [
            Command::Connect(found("boat-7")),
            Command::Layer(LayerCommand::Show(LayerId::Elevation, false))
        ]
    );
    // By its number in the list too; the shown robot is not connected again.
    for key in [Key::Num1, Key::Num2] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(1);
    }
    assert_eq!(asked(&mut window), [Command::Connect(found("boat-7"))]);
    window.key_press_modifiers(Modifiers::COMMAND, Key::L);
    window.run_steps(3);
    let entry = window.get_by_role_and_label(Role::TextInput, "Address");
    assert!(entry.is_focused(), "Ctrl+L");
    entry.type_text("10.0.0.5");
    window.run_steps(2);
    window.get_by_label("Add").click();
    window.run_steps(2);
    check(
        &window,
        &["The port is missing: for example 10.0.0.5:7447"],
        &[],
    );
    let entry = window.get_by_role_and_label(Role::TextInput, "Address");
    assert!(entry.is_focused(), "it can be mended");
    entry.type_text(":7447");
    window.run_steps(2);
    window.get_by_label("Add").click();
    window.run_steps(2);
    assert_eq!(
        asked(&mut window),
        [Command::AddAddress("tcp/10.0.0.5:7447".to_owned())]
    );
}

#[test]
fn invalid_address_clears_when_a_robot_is_chosen() {
    const WHY: &str = "The port is missing: for example 10.0.0.5:7447";
    let mut window = two_robots().window();
    window.key_press_modifiers(Modifiers::COMMAND, Key::L);
    window.run_steps(4);
    window.event(egui::Event::Text("10.0.0.5".to_owned()));
    window.key_press(Key::Enter);
    window.run_steps(4);
    let typed = |window: &Harness<'_, Rig>| {
        let entry = window.get_by_role_and_label(Role::TextInput, "Address");
        entry.value().unwrap_or_default()
    };
    check(&window, &[WHY], &[]);
    assert_eq!(typed(&window), "10.0.0.5");
    // The shown robot is not connected again.
    window.key_press_modifiers(Modifiers::COMMAND, Key::Num1);
    window.run_steps(4);
    check(&window, &[WHY], &[]);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Num2);
    window.run_steps(4);
    assert_eq!(window.state().commands.len(), 1);
    check(&window, &[], &[WHY]);
    assert_eq!(typed(&window), "");
}

#[test]
fn another_robot_begins_with_an_empty_map() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    let mut window = rig.window();
    check(&window, &["1 tile, "], &[]);
    let is_fitted = |window: &Harness<'_, Rig>| {
        window.state().screen.map_view().camera_mode() == CameraMode::FitMap
    };
    window
        .state_mut()
        .screen
        .map_view_mut()
        .look(Look::Follow(false));
    assert!(!is_fitted(&window));
    let next = Rig::with_robot();
    window.state_mut().model = next.model;
    window.state_mut().screen.map_view_mut().forget();
    window.run_steps(2);
    check(&window, &["Waiting", "Not described yet"], &["1 tile"]);
    assert!(is_fitted(&window));
    // After its animations only the ages wake the window.
    window.run_steps(60);
    let delay = window
        .output()
        .viewport_output
        .values()
        .map(|output| output.repaint_delay);
    assert!(delay.min().unwrap() >= Duration::from_millis(100));
}

#[derive(Default)]
struct Controls {
    named: Vec<String>,
    unnamed: Vec<String>,
    /// Disabled ones show the reason instead.
    without_tooltip: Vec<String>,
}

/// Hover texts are the descriptions of the controls.
fn controls(window: &Harness<'_, Rig>) -> Controls {
    let mut controls = Controls::default();
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
        let label = node.label().or_else(|| node.value());
        let label = label.filter(|label| !label.trim().is_empty());
        let place = format!("{:?} at {:?}", node.role(), node.raw_bounds());
        // The crosses of tabs and dialogs are their libraries'. After "Request control" the pointer rests on "Release
        // control".
        let is_exempt = label
            .as_ref()
            .is_some_and(|label| ["Close", "Close window", "Release control"].contains(&&**label));
        if !is_exempt && !node.is_disabled() && node.description().is_none() {
            controls.without_tooltip.push(format!("{label:?}, {place}"));
        }
        match label {
            Some(label) => controls.named.push(label),
            None => controls.unnamed.push(place),
        }
    }
    controls
}

#[test]
fn every_control_has_a_name() {
    let rigs: [fn() -> Rig; 3] = [Rig::new, Rig::live, || Rig::on_water(None)];
    for rig in rigs {
        let rig = rig();
        let mut window = rig.window();
        for panel in PanelId::ALL {
            window.state_mut().screen.workspace.set_wanted(panel, true);
            window.run_steps(2);
            let Controls { named, unnamed, .. } = controls(&window);
            assert_eq!(unnamed, [""; 0], "{panel:?}");
            assert!(named.len() >= 5, "{named:?}");
        }
    }
}

#[test]
fn every_control_has_a_tooltip() {
    let shores = || {
        let clusters = vec![crate::test_support::shore(1, [4.0, 1.5])];
        let sites = vec![crate::test_support::docking_site([13.0, -2.5])];
        Shores::gather(0.3, None, clusters, sites)
    };
    let recording = || {
        let mut rig = Rig::live();
        rig.link.recording = Some("rooms.mcap".to_owned());
        rig
    };
    let held_by_other = || {
        let mut rig = Rig::drivable();
        let mut teleop = crate::test_support::idle_teleop_status();
        teleop.lease.holder = Some("bert".parse().unwrap());
        rig.say(Topic::Status, &status_of(teleop));
        rig
    };
    let rigs: [&dyn Fn() -> Rig; 7] = [
        &Rig::new,
        &two_robots,
        &Rig::drivable,
        &held_by_other,
        &driven,
        &|| Rig::on_water(Some(shores())),
        &recording,
    ];
    let mut without_tooltip = std::collections::BTreeSet::new();
    for rig in rigs {
        let mut window = rig().window();
        for panel in PanelId::ALL {
            window.state_mut().screen.workspace.set_wanted(panel, true);
            window.run_steps(2);
            if let Some(settings) = window.query_by_label("Settings of the robot") {
                settings.click();
                window.run_steps(4);
            }
            without_tooltip.extend(controls(&window).without_tooltip);
        }
        for menu in ["File", "View", "Help"] {
            window.get_by_label(menu).click();
            window.run_steps(3);
            without_tooltip.extend(controls(&window).without_tooltip);
            window.key_press(Key::Escape);
            window.run_steps(2);
        }
        window.key_press_modifiers(Modifiers::COMMAND, Key::E);
        window.run_steps(4);
        without_tooltip.extend(controls(&window).without_tooltip);
    }
    let without_tooltip: Vec<_> = without_tooltip.into_iter().collect();
    assert_eq!(without_tooltip, [""; 0], "{without_tooltip:#?}");
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
        assert_eq!(controls(&window).unnamed, [""; 0], "{says}");
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
        crate::playback::home().unwrap().join("maps")
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
        fetching: Some(FetchProgress::Requested),
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
    check(&rig.window(), &["Filter"], &["No alerts."]);
}
