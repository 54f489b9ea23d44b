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
    let asked = asked(&mut window);
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
fn emergency_stop_is_whole_in_a_small_window() {
    for width in [640.0, 700.0, 900.0] {
        let mut rig = Rig::drivable();
        rig.teleop_client.as_mut().unwrap().lease = crate::teleop_client::Lease::Held(4);
        let window = rig.window_of([width, 620.0]);
        let map = window.state().screen.map_view().place();
        assert!(map.width() >= 0.45 * width, "{width}: {map}");
        let stop = window.get_by_label("EMERGENCY STOP").rect();
        assert!(stop.left() > map.right() && stop.right() <= width, "{stop}");
        assert!(stop.top() >= 0.0 && stop.bottom() <= 620.0, "{stop}");
        assert!(stop.width() > 250.0, "{stop}");
    }
}
