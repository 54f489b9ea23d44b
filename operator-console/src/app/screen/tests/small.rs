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
