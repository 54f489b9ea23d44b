//! Robots are found, chosen and changed.

use super::*;

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

/// `scout-1`, which is shown, and `boat-7`.
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
