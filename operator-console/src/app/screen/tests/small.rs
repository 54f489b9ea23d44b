//! Small windows, and large type in them.

use super::*;

/// Where this is in the bar at the top.
fn in_bar(window: &Harness<'_, Rig>, label: &str) -> egui::Rect {
    let found = window.query_all_by_label(label).map(|node| node.rect());
    let mut found = found.filter(|rect| rect.bottom() < 44.0);
    found
        .next()
        .unwrap_or_else(|| panic!("{label:?} is not in the bar"))
}

#[test]
fn the_bar_has_the_whole_name_of_the_robot_and_who_drives_it() {
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
fn who_drives_keeps_the_panels_below_a_map_that_is_large_enough() {
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
fn shores_and_legends_can_be_used_in_a_small_window_with_large_type() {
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
        let workspace = window.state_mut().screen.workspace_mut();
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
