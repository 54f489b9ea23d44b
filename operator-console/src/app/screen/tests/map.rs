//! The map, shores on it, and small windows.

use super::*;

#[test]
fn buttons_keys_and_pointer_move_the_map() {
    let mut window = Rig::live().window();
    assert_eq!(
        window.state().screen.map_view().camera_mode(),
        CameraMode::FitMap
    );
    window.get_by_label("Follow").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    assert_eq!(asked, [Command::Look(Look::Follow(true))]);
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
        let asked = std::mem::take(&mut window.state_mut().commands);
        assert_eq!(asked, [Command::Look(look)], "{key:?}");
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
        number,
        class,
        voxels: 1_200,
        rigid_voxels,
        center_m,
        outline: Vec::new(),
    }
}

#[test]
fn click_on_listed_shore_centres_it() {
    // The boat is at (1, −2.5): 5 m from the centre of the reeds, and 2.6 m from their edge at x = 3.6 m.
    let mut reeds = shore(7, ShoreClass::Dense, 492, [4.0, 1.5]);
    reeds.outline = vec![(12, -10), (16, -10), (16, 8), (12, 8)];
    let clusters = vec![shore(12, ShoreClass::Solid, 1_100, [61.0, 77.5]), reeds];
    let site = |x_m, mean_cost| DockingSite {
        center_m: [x_m, -2.5],
        heading_rad: 0.0,
        width_m: 6.25,
        mean_cost,
    };
    let sites = vec![site(13.0, 0.2), site(-19.0, 0.31)];
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
            "Docking site A, cost 0.20, 6.2 m wide, 12 m away",
            "Docking site B, cost 0.31, 6.2 m wide, 20 m away",
            // On the map.
            "Shores 1, 2 …; docking sites A, B …",
            "3 smaller shores are not listed.",
        ],
        &["worse docking sites", "Nothing was heard"],
    );
    window.get_by_label_contains("Docking site B").click();
    window.run_steps(2);
    let asked = std::mem::take(&mut window.state_mut().commands);
    let second = window.state().model.as_ref().unwrap().site_names()[1];
    let mark = Look::Mark(ShoreMark::Site(second), [-19.0, -2.5]);
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
fn map_keeps_half_of_a_small_window_while_driving() {
    for width in [640.0, 700.0, 900.0] {
        let mut rig = Rig::live();
        let mut teleop_client = crate::test_support::idle_teleop_client();
        teleop_client.lease = crate::teleop_client::Lease::Held(4);
        rig.teleop_client = Some(teleop_client);
        let status = Status {
            teleop: Some(crate::test_support::idle_teleop_status()),
            ..Status::default()
        };
        rig.say(Topic::Status, &status);
        let window = rig.window_of([width, 620.0]);
        let map = window.state().screen.map_view().place();
        assert!(map.width() >= 0.45 * width, "{width}: {map}");
        let stop = window.get_by_label("EMERGENCY STOP").rect();
        assert!(stop.left() > map.right() && stop.right() <= width, "{stop}");
        assert!(stop.width() > 250.0, "{stop}");
    }
}

#[test]
fn notice_on_the_map_covers_no_other_element() {
    const SAVED: &str = "Saved as /home/anna/pictures/foreshore-2024-05-01.png";
    let news = |mut rig: Rig, size: [f32; 2]| {
        let note = crate::event_log::Severity::Info;
        rig.log.note(note, "screenshot", SAVED, rig.now, 1);
        rig.window_of(size)
    };
    for size in [[1280.0, 800.0], [1000.0, 640.0], [1920.0, 1080.0]] {
        let window = news(Rig::live(), size);
        let map = window.state().screen.map_view().place();
        let found = window.query_all_by_label(SAVED).map(|text| text.rect());
        let found: Vec<_> = found.filter(|text| map.intersects(*text)).collect();
        let [text] = found[..] else {
            panic!("{size:?}: {found:?}");
        };
        assert!(map.contains_rect(text), "{size:?}: {text} {map}");
        assert!(text.center().y > map.center().y, "{size:?}: {text} {map}");
        let room = window.state().screen.map_view().notice_room().unwrap();
        for taken in room.taken {
            assert!(!taken.intersects(text), "{size:?}: {text} {taken}");
        }
    }
    let window = news(Rig::new(), [1280.0, 800.0]);
    let mut found = window.query_all_by_label(SAVED).map(|text| text.rect());
    let at_edge = |text: egui::Rect| {
        (text.center().x - 640.0).abs() < 2.0 && (750.0..780.0).contains(&text.bottom())
    };
    assert!(found.any(at_edge), "where there is no map");
}

#[test]
fn scroll_bar_covers_no_driving_value() {
    let mut rig = Rig::drivable();
    rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
    let window = rig.window_of([640.0, 420.0]);
    let map = window.state().screen.map_view().place();
    let stop = window.get_by_label("EMERGENCY STOP").rect();
    let bars = window.query_all_by_role(Role::ScrollBar);
    let mut bars = bars.map(|bar| bar.rect());
    let bar = bars.find(|bar| bar.left() > map.right());
    let bar = bar.expect("it scrolls");
    let labels = window.query_all_by_role(Role::Label);
    let labels = labels.map(|label| label.rect());
    let below = labels.filter(|label| label.left() > map.right() && label.top() > stop.bottom());
    let rights: Vec<_> = below.map(|label| label.right()).collect();
    assert!(rights.len() > 8, "{rights:?}");
    let greatest = rights.iter().copied().fold(0.0, f32::max);
    // Values are right-aligned in the available width.
    assert!(greatest <= bar.left() && greatest > bar.left() - 20.0);
}

#[test]
fn no_hint_covers_the_panel_while_driving() {
    let mut window = Rig::drivable().window();
    let drive = window
        .get_by_role_and_label(Role::Button, "Request control")
        .rect()
        .center();
    window.hover_at(drive);
    window.run_steps(8);
    check(&window, &["Request the control lease (Ctrl+G)"], &[]);
    // By key or click, the pointer stays in place.
    let teleop_client = window.state_mut().teleop_client.as_mut();
    teleop_client.unwrap().lease = crate::teleop_client::Lease::Held(4);
    window.run_steps(8);
    check(&window, &["Ctrl+G"], &["(Ctrl+G)"]);
    let back = window.get_by_label("Release control").rect().center();
    window.hover_at(back);
    window.run_steps(8);
    check(&window, &["Ctrl+G"], &["(Ctrl+G)", "others may drive"]);
}

/// Position in the top bar.
fn in_bar(window: &Harness<'_, Rig>, label: &str) -> egui::Rect {
    let found = window.query_all_by_label(label).map(|node| node.rect());
    let mut found = found.filter(|rect| rect.bottom() < 44.0);
    found
        .next()
        .unwrap_or_else(|| panic!("{label:?} is not in the bar"))
}

#[test]
fn top_bar_shows_whole_names() {
    let wide = Rig::drivable().window();
    // 700 × 620 at 120 %, 110 % and 100 %.
    for size in [[583.0, 517.0], [636.0, 564.0], [700.0, 620.0]] {
        let window = Rig::drivable().window_of(size);
        for label in [name().as_str(), "Nobody drives"] {
            let [whole, place] = [&wide, &window].map(|window| in_bar(window, label));
            let missing = whole.width() - place.width();
            assert!(missing.abs() < 0.5, "{size:?} {label}: {place} of {whole}");
            assert!(
                place.right() < in_bar(&window, "Stop").left(),
                "{size:?} {label}"
            );
        }
    }
}

#[test]
fn panels_stay_below_a_large_enough_map_while_driving() {
    // 1280 × 800 at 120 %, and at 150 %.
    for (size, has_room) in [([1067.0, 667.0], true), ([853.0, 533.0], false)] {
        let mut rig = Rig::drivable();
        rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
        let window = rig.window_of(size);
        let link = window.query_by_label("Receiving").is_some();
        assert_eq!(link, has_room, "{size:?}");
        let [map, whole] = [
            window.state().screen.map_view().place().size(),
            Vec2::from(size),
        ];
        assert!(map.x >= 0.4 * whole.x && map.y >= 0.4 * whole.y, "{map}");
    }
}

#[test]
fn shores_and_legends_work_in_a_small_window() {
    let shore = |number: u32, x_m: f32| ShoreCluster {
        number,
        class: ShoreClass::Sparse,
        voxels: 1_200,
        rigid_voxels: 300,
        center_m: [x_m, -2.5],
        outline: Vec::new(),
    };
    let clusters = (7..=12_u8).map(|n| shore(n.into(), 3.0 * f32::from(n)));
    let shores = Shores::gather(0.3, None, clusters.collect(), Vec::new());
    for is_drivable in [false, true] {
        let mut rig = Rig::on_water(Some(shores.clone()));
        if is_drivable {
            rig.teleop_client = Some(crate::test_support::idle_teleop_client());
            let status = Status {
                teleop: Some(crate::test_support::idle_teleop_status()),
                ..Status::default()
            };
            rig.say(Topic::Status, &status);
        }
        // 640 × 480 at 120 %.
        let mut window = rig.window_of([533.0, 400.0]);
        let workspace = &mut window.state_mut().screen.workspace;
        workspace.set_wanted(PanelId::Shores, true);
        window.run_steps(4);
        let map = window.state().screen.map_view().place();
        for label in ["Sort shores by away", "Shore 7, sparse"] {
            let place = window.get_by_label_contains(label).rect();
            assert!(place.right() <= map.left(), "{label}: {place} {map}");
        }
        let legend = window.get_by_label("Legend: Shore").rect();
        assert!(map.contains_rect(legend), "{legend} {map}");
        for label in ["Compass: y up", "+", "Tools"] {
            let other = window.get_by_label(label).rect();
            assert!(!other.intersects(legend), "{label}: {other} {legend}");
        }
    }
}
