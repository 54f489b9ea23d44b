//! The map, shores on it, live and old data, and small windows.

use super::*;
use crate::model::LastContact;
use crate::test_support::{self, docking_site};

#[test]
fn buttons_keys_and_pointer_move_the_map() {
    let mut window = Rig::live().window();
    assert_eq!(
        window.state().screen.map_view().camera_mode(),
        CameraMode::FitMap
    );
    window.get_by_label("Follow").click();
    window.run_steps(2);
    assert_eq!(asked(&mut window), [Command::Look(Look::Follow(true))]);
    window
        .state_mut()
        .screen
        .map_view_mut()
        .look(Look::Follow(true));
    window.run_steps(2);
    let seen = |window: &Harness<'_, Rig>| window.state().screen.map_view().visible_m();
    let [low_x, low_y, high_x, high_y] = seen(&window);
    assert!((0.5 * (low_x + high_x) - 1.0).abs() < 1e-6);
    assert!((0.5 * (low_y + high_y) + 2.5).abs() < 1e-6);

    let middle = window.state().screen.map_view().place().center();
    let beside = middle + vec2(100.0, 0.0);
    window.drag_at(middle);
    window.run_steps(1);
    window.hover_at(beside);
    window.run_steps(1);
    window.drop_at(beside);
    window.run_steps(1);
    assert_eq!(
        window.state().screen.map_view().camera_mode(),
        CameraMode::Free
    );
    assert!(seen(&window)[0] < low_x - 0.5, "{:?}", seen(&window));

    for (key, look) in [
        (Key::F, Look::Whole),
        (Key::V, Look::Follow(true)),
        (Key::Plus, Look::In),
        (Key::Minus, Look::Out),
        (Key::N, Look::Up(Orientation::RobotUp)),
        (Key::G, Look::Draw(Overlay::Grid, true)),
        (Key::L, Look::Draw(Overlay::Legend, false)),
        (Key::M, Look::Measure(true)),
        (Key::C, Look::Point),
        (Key::Backspace, Look::UndoPoint),
    ] {
        window.key_press(key);
        window.run_steps(1);
        assert_eq!(asked(&mut window), [Command::Look(look)], "{key:?}");
    }
}

#[test]
fn probe_shows_values_under_the_pointer() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 226);
    rig.push(key);
    let mut window = rig.window();
    check(&window, &[], &["laser, log-odds"]);
    let [low_x, _, high_x, _] = window.state().screen.map_view().visible_m();
    window.state_mut().now = at(4_000);
    let on_the_tile = window.state().screen.map_view().place_of([3.2, 3.2]);
    window.hover_at(on_the_tile);
    window.run_steps(4);
    check(
        &window,
        &["Tile changed", "3.0 s ago, laser, log-odds"],
        &[],
    );
    check(&window, &["0.90"], &[]);
    assert!(low_x < 0.0 && high_x > 6.4);
    window.remove_cursor();
    window.run_steps(1);
    check(&window, &[], &["laser, log-odds", "Tile changed"]);
}

fn shore(number: u32, class: ShoreClass, rigid_voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        class,
        voxels: 1_200,
        rigid_voxels,
        ..test_support::shore(number, center_m)
    }
}

#[test]
fn click_on_listed_shore_centres_it() {
    // The boat is at (1, −2.5): 5 m from the centre of the reeds, and 2.6 m from their edge at x = 3.6 m.
    let mut reeds = shore(7, ShoreClass::Dense, 492, [4.0, 1.5]);
    reeds.outline = vec![(12, -10), (16, -10), (16, 8), (12, 8)];
    let clusters = vec![shore(12, ShoreClass::Solid, 1_100, [61.0, 77.5]), reeds];
    let site = |number, x_m, price| DockingSite {
        number,
        width_m: 6.25,
        vegetation: None,
        price,
        approach_m: [0.0; 2],
        ..docking_site([x_m, -2.5])
    };
    let sites = vec![site(1, 13.0, 0.2), site(2, -19.0, 0.31)];
    let mut shores = Shores::gather(0.3, None, clusters, sites);
    shores.clusters_left_out = 3;
    let mut window = Rig::on_water(Some(shores)).window();
    window.get_by_label("Shores").click();
    window.run_steps(4);
    check(
        &window,
        &[
            "Shores",
            "Shore 7, dense, 41 % rigid, 1\u{a0}200 voxels, 2.6 m away",
            "Shore 12, solid, 92 % rigid, 1\u{a0}200 voxels, 100 m away",
            "Docking site A, gentle slope, price 0.20, 6.2 m wide, 12 m away",
            "Docking site B, gentle slope, price 0.31, 6.2 m wide, 20 m away",
            // On the map.
            "Shores 1, 2 …; docking sites A, B …",
            "3 smaller shores are not listed.",
        ],
        &["worse docking sites", "Nothing was heard"],
    );
    window.get_by_label_contains("Docking site B").click();
    window.run_steps(2);
    let asked = asked(&mut window);
    let mark = Look::Mark(ShoreMark::Site(2), [-19.0, -2.5]);
    assert!(asked.contains(&Command::Look(mark)), "{asked:?}");
    let map_view = window.state_mut().screen.map_view_mut();
    map_view.look(mark);
    window.run_steps(1);
    let map_view = window.state().screen.map_view();
    let [low_x, low_y, high_x, high_y] = map_view.visible_m();
    assert_eq!(map_view.camera_mode(), CameraMode::Free);
    assert!((0.5 * (low_x + high_x) + 19.0).abs() < 1e-3);
    assert!((0.5 * (low_y + high_y) + 2.5).abs() < 1e-3);
}

#[test]
fn unknown_shores_are_shown_as_unknown() {
    let shores = |shores| {
        let mut window = Rig::on_water(shores).window();
        window.get_by_label("Shores").click();
        window.run_steps(4);
        window
    };
    check(
        &shores(None),
        &["No shore data yet."],
        &["No shore detected."],
    );
    check(
        &shores(Some(Shores::default())),
        &["No shore detected."],
        &["No shore data yet."],
    );
    check(&Rig::live().window(), &["Live"], &["Shores"]);
}

#[test]
fn panels_stay_beside_a_large_enough_map_while_driving() {
    // 1280 × 800 at 120 %, and at 150 %.
    for (size, has_room) in [([1067.0, 667.0], true), ([853.0, 533.0], false)] {
        let mut rig = Rig::drivable();
        rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
        let window = rig.window_of(size);
        let events = window.query_by_label("Events").is_some();
        assert_eq!(events, has_room, "{size:?}");
        let [map, whole] = [
            window.state().screen.map_view().place().size(),
            Vec2::from(size),
        ];
        assert!(map.x >= 0.4 * whole.x && map.y >= 0.4 * whole.y, "{map}");
    }
}

#[test]
fn emergency_stop_is_whole_in_a_small_window() {
    for width in [640.0, 700.0, 900.0] {
        let mut rig = Rig::drivable();
        rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
        let window = rig.window_of([width, 620.0]);
        let map = window.state().screen.map_view().place();
        assert!(map.width() >= 0.45 * width, "{width}: {map}");
        let stop = window.get_by_label("EMERGENCY STOP").rect();
        assert!(
            stop.bottom() <= map.top() && stop.right() <= width,
            "{stop}"
        );
        assert!(stop.top() >= 0.0 && stop.left() >= 0.0, "{stop}");
        assert!(stop.width() >= 96.0 && stop.height() >= 32.0, "{stop}");
    }
}

#[test]
fn silent_new_robot_is_waiting() {
    let mut rig = Rig::with_robot();
    check(
        &rig.window(),
        &["scout-1", "Waiting", "Connecting to scout-1.", "No map yet"],
        &["Live", "Link lost"],
    );
    rig = Rig::with_robot();
    rig.link.is_connected = true;
    check(
        &rig.window(),
        &["Connected. Waiting for data of scout-1."],
        &["Live"],
    );
    rig = Rig::with_robot();
    rig.link.problem = Some("nothing listens at tcp/10.0.0.5:7447".to_owned());
    check(
        &rig.window(),
        &["nothing listens at tcp/10.0.0.5:7447"],
        &[],
    );
}

#[test]
fn synchronized_robot_is_shown_with_values() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    rig.announce();
    rig.outgoing();
    let status = Status {
        scans_in: 1_200,
        scans_mapped: 1_190,
        drops: vec![DropCount {
            name: "no_pose".to_owned(),
            count: 10,
        }],
        ..Status::default()
    };
    rig.say(Topic::Status, &status);
    let event = Event {
        kind: "pose_jump".to_owned(),
        severity: Severity::Warning,
        message: "The pose jumped 3 m".to_owned(),
    };
    rig.say(Topic::Event, &event);
    let mut window = rig.window();
    check(
        &window,
        &[
            "Live",
            "Synchronized",
            "rover",
            "world rooms",
            "x\u{a0}1.00  y\u{a0}−2.50\u{a0}m",
            "0.55 m/s",
            "1\u{a0}190 of 1\u{a0}200 mapped",
            "1 tile, ",
            "Probability of being occupied",
            "Occupancy",
            "Elevation",
        ],
        &["Link lost", "Silent", "missing"],
    );
    window.get_by_label("Link").click();
    window.run_steps(4);
    check(&window, &["< 0.2 s ago"], &[]);
    window.get_by_label("Losses").click();
    window.run_steps(4);
    check(&window, &["no pose"], &["The pose jumped 3 m"]);
    window.get_by_label("Events").click();
    window.run_steps(4);
    check(
        &window,
        &["scout-1: pose jump", "The pose jumped 3 m"],
        &["no pose"],
    );
    window.get_by_label("1 alert").click();
    window.run_steps(4);
    check(
        &window,
        &["0.0 s ago, over", "Acknowledge"],
        &["scout-1: pose jump"],
    );
}

#[test]
fn map_behind_shows_missing_tiles() {
    let mut rig = Rig::live();
    rig.outgoing();
    let keys = [rig.put(0, 0, 251), rig.put(1, 0, 1), rig.put(-1, 0, 1)];
    rig.announce();
    for ms in (1_000..9_000).step_by(500) {
        rig.now = at(ms);
        rig.announce();
        let list = rig
            .outgoing()
            .into_iter()
            .find_map(|outgoing| match outgoing {
                Outgoing::Get { request, key, .. } if key.ends_with("/digests") => Some(request),
                Outgoing::Get { .. } | Outgoing::Put { .. } => None,
            });
        if let Some(request) = list {
            let tiles = keys.map(|key| {
                let stored = rig.store.get(key).unwrap();
                TileSummary {
                    tx: key.tx,
                    ty: key.ty,
                    revision: stored.revision(),
                    digest: stored.digest(),
                }
            });
            let digests = Digests {
                epoch: 0,
                head_revision: 3,
                tiles: tiles.to_vec(),
                more: 0,
            };
            rig.answer(request, Topic::Digests(LAYER), &digests);
            break;
        }
    }
    check(
        &rig.window(),
        &["Live", "3 tiles missing"],
        &["Synchronized"],
    );
}

#[test]
fn silent_robot_is_never_shown_as_live() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    rig.announce();
    rig.outgoing();
    rig.now = at(13_000);
    check(
        &rig.window(),
        &[
            "Silent",
            "Link lost: no data for 12 s",
            "What is shown is old.",
            "Was synchronized at last contact",
            "As of 12 s ago",
            "newest 12 s old",
            "scout-1 does not answer.",
        ],
        &["Live"],
    );
}

#[test]
fn synchronized_map_shows_loss_of_link() {
    for (heard_ms, says) in [
        (2_000, "Was synchronized 1.0 s before the link was lost"),
        (7_000, "Was not synchronized at last contact"),
    ] {
        let mut rig = Rig::live();
        let key = rig.put(0, 0, 251);
        rig.push(key);
        rig.announce();
        rig.outgoing();
        rig.now = at(heard_ms);
        rig.put(0, 1, 251);
        rig.announce();
        rig.outgoing();
        rig.now = at(heard_ms + 9_000);
        check(&rig.window(), &["Silent", says], &["Was synchronized at"]);
    }
}

#[test]
fn old_position_is_marked_although_link_is_live() {
    let mut rig = Rig::live();
    rig.now = at(6_000);
    rig.announce();
    check(
        &rig.window(),
        &["Live", "Position is 5.0 s old"],
        &["Link lost"],
    );
}

#[test]
fn a_recording_has_keys_a_name_and_no_link() {
    let mut rig = Rig::live();
    rig.link.recording = Some("rooms.mcap".to_owned());
    let mut window = rig.window();
    window.get_by_label("Link").click();
    window.run_steps(4);
    check(
        &window,
        &["rooms.mcap", "a recording has no link"],
        &["scout-1", "Round trip", "Last message"],
    );
    let step = |s: i64| PlaybackCommand::Step(RobotDuration::from_millis(1000 * s));
    for (modifiers, key, expected) in [
        (Modifiers::NONE, Key::P, PlaybackCommand::PlayOrPause),
        (Modifiers::NONE, Key::Comma, step(-1)),
        (Modifiers::NONE, Key::Period, step(1)),
        (Modifiers::SHIFT, Key::Comma, step(-10)),
        (Modifiers::SHIFT, Key::Period, step(10)),
        (Modifiers::NONE, Key::OpenBracket, PlaybackCommand::Slower),
        (Modifiers::NONE, Key::CloseBracket, PlaybackCommand::Faster),
        (Modifiers::NONE, Key::R, PlaybackCommand::ToggleLooping),
    ] {
        window.key_press_modifiers(modifiers, key);
        window.run_steps(1);
        let commands = asked(&mut window);
        assert_eq!(commands, [Command::Playback(expected)], "{key:?}");
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(4);
    let folder = window.get_by_role_and_label(Role::TextInput, "Folder");
    assert!(folder.value().unwrap().contains("foreshore-rooms-2"));
    // The keyboard focus leaves in a frame in which text may have been typed.
    let press = |key| egui::Event::Key {
        key,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers: Modifiers::NONE,
    };
    let pressed = [Key::P, Key::Escape, Key::R].map(press);
    window.input_mut().events.extend(pressed);
    window.run_steps(4);
    assert_eq!(window.state().commands, []);
}

#[test]
fn earlier_contact_makes_silence_visible() {
    let rig_at = |now_ms| {
        let mut rig = Rig::with_robot();
        rig.model.as_mut().unwrap().set_last_contact(LastContact {
            last: at(4_000),
            expected_from: at(20_000),
            had_ended: false,
        });
        rig.now = at(now_ms);
        rig.window()
    };
    let calm = rig_at(19_000);
    check(&calm, &["Waiting", "15 s ago"], &["Link lost", "Silent"]);
    let missed = rig_at(20_000);
    let says = [
        "Silent",
        "Link lost: no data for 16 s",
        "16 s ago",
        "Its map is fetched on reconnection",
        "1 alert",
    ];
    check(&missed, &says, &["Waiting", "No map yet", "No alerts"]);
}

#[test]
fn an_old_map_is_veiled() {
    for (ms, is_old) in [(1_000, false), (13_000, true)] {
        let mut rig = Rig::live();
        rig.now = at(ms);
        let window = rig.window();
        let map = window.state().screen.map_view().place();
        let mut shapes = window.output().shapes.iter();
        let is_veiled = shapes.any(|clipped| {
            matches!(&clipped.shape, egui::Shape::Rect(veil)
                if veil.fill == crate::theme::STALE_OVERLAY
                    && veil.rect.contains_rect(map.shrink(1.0)))
        });
        assert_eq!(is_veiled, is_old, "{ms}");
    }
}

#[test]
fn link_lost_banner_moves_no_map_and_hides_no_button() {
    let mut rig = Rig::live();
    let key = rig.put(0, 0, 251);
    rig.push(key);
    rig.announce();
    let mut window = rig.window();
    let ground = |window: &Harness<'_, Rig>| {
        let map_view = window.state().screen.map_view();
        (map_view.place(), map_view.visible_m())
    };
    let before = ground(&window);
    let (map, _) = before;
    window.state_mut().now = at(13_000);
    window.run_steps(4);
    assert_eq!(ground(&window), before);
    let words = window.query_all_by_label_contains("What is shown is old.");
    let mut words = words.map(|words| words.rect());
    let banner = words.find(|words| map.contains_rect(*words)).unwrap();
    for label in ["+", "−", "Whole map", "Follow", "Measure"] {
        let button = window.get_by_label(label).rect();
        assert!(button.top() > banner.bottom(), "{label}: {button} {banner}");
        assert!(map.contains_rect(button), "{label}: {button}");
    }
}
