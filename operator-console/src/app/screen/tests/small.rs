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
        rig.helm.as_mut().unwrap().lease = crate::helm::Lease::Held(4);
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
