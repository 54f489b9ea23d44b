use std::time::Duration;

use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};

use super::*;
use crate::teleop_client::EStopState;
use crate::test_support::{at, console, idle_teleop_client};

fn data() -> TopBarData {
    TopBarData {
        name: "scout-1".to_owned(),
        color: None,
        link: (Tone::Good, "Live".to_owned()),
        age: Some("< 0.2 s ago".to_owned()),
        map: (Tone::Good, "Synchronized".to_owned()),
        map_short: "Synchronized",
        driver: Some("Nobody drives".to_owned()),
        estop: Some(EStopButton::Ready),
    }
}

fn bar(width: f32, data: TopBarData, unseen: usize) -> Harness<'static> {
    let mut window = Harness::builder()
        .with_size(vec2(width, 44.0))
        .build_ui(move |ui| {
            ui.horizontal(|ui| {
                _ = right_bar_ui(ui, Some(&data), unseen, |ui| robot_bar_ui(ui, &data));
            });
        });
    crate::theme::set(&window.ctx);
    window.run_steps(3);
    window
}

#[test]
fn a_stop_is_shown_before_the_robot_answers() {
    let model = console("scout", &[]);
    assert!(model.status().is_none());
    let mut teleop_client = idle_teleop_client();
    let estop = |teleop_client: &TeleopClientState| {
        let link = LinkStatus::default();
        TopBarData::new(&model, &link, Some(teleop_client), None, at(0)).estop
    };
    assert_eq!(estop(&teleop_client), None);
    teleop_client.estop = EStopState::Unsendable(Duration::from_secs(3));
    let words = "Not sent for 3.0 s: no robot connected".to_owned();
    assert_eq!(estop(&teleop_client), Some(EStopButton::Sending(words)));
}

#[test]
fn an_observers_stop_is_disabled() {
    let estop = Some(EStopButton::ReadOnly);
    let window = bar(900.0, TopBarData { estop, ..data() }, 0);
    let stop = window.get_by_label("Stop. Observers neither drive nor stop the vehicle");
    assert!(stop.accesskit_node().is_disabled());
    let usual = bar(900.0, data(), 0);
    let pressed = usual.get_by_label("Stop");
    assert!(!pressed.accesskit_node().is_disabled());
    assert_eq!(stop.rect(), pressed.rect());
}

#[test]
fn a_refused_stop_looks_different() {
    let why = "the sender's role does not allow it".to_owned();
    let estop = Some(EStopButton::Refused(why));
    let mut window = bar(900.0, TopBarData { estop, ..data() }, 0);
    assert!(window.query_by_label("Stop").is_none());
    let refused = window.get_by_label("Refused");
    assert!(!refused.accesskit_node().is_disabled());
    let place = refused.rect();
    assert_eq!(place, bar(900.0, data(), 0).get_by_label("Stop").rect());
    window.hover_at(place.center());
    window.run_steps(60);
    let reported = "The robot does not stop for you: the sender's role does not allow it. Press again if you like";
    window.get_by_label(reported);
}

#[test]
fn a_recently_synchronized_map_is_synchronized() {
    let map = (Tone::Good, "Synchronized 0.5 s ago".to_owned());
    let mut window = bar(900.0, TopBarData { map, ..data() }, 0);
    let place = window.get_by_label("Synchronized").rect();
    window.hover_at(place.center());
    window.run_steps(60);
    window.get_by_label("Synchronized 0.5 s ago");
}

#[test]
fn nothing_is_cut_in_a_small_window() {
    let blue = Some(Color32::BLUE);
    for (name, color) in [
        ("two", None),
        ("demo", None),
        ("demo", blue),
        ("scout-1", blue),
    ] {
        let of = || TopBarData {
            name: name.to_owned(),
            color,
            ..data()
        };
        let wide = bar(1120.0, of(), 0);
        let whole = |label| wide.get_by_label(label).rect().width();
        for (width, unseen) in [446.0, 499.0, 563.0]
            .map(|width| [(width, 0), (width, 1)])
            .concat()
        {
            let window = bar(width, of(), unseen);
            let place = |label: &str| window.get_by_label(label).rect();
            let is_whole = |label| (place(label).width() - whole(label)).abs() < 0.5;
            assert!(is_whole(name), "{width} {name}: {}", place(name));
            assert!(is_whole("Nobody drives"), "{width} {name}");
            for label in ["Live", "Synchronized"] {
                let is_mark = place(label).width() < 20.5;
                assert!(is_whole(label) || is_mark, "{width}: {}", place(label));
            }
            let end = if unseen > 0 { "1 alert" } else { "Stop" };
            let parts = [name, "Live", "Nobody drives", "Synchronized", end].map(place);
            for pair in parts.windows(2) {
                assert!(pair[0].right() < pair[1].left(), "{width} {name}: {pair:?}");
            }
        }
    }
}

#[test]
fn a_short_link_state_has_hover_text() {
    let mut window = bar(
        446.0,
        TopBarData {
            driver: Some("You drive (annabelle-1)".to_owned()),
            link: (Tone::Warning, "Silent".to_owned()),
            ..data()
        },
        0,
    );
    let mark = window.get_by_label("Silent").rect();
    assert!(mark.width() < 20.5, "{mark}");
    window.hover_at(mark.center());
    window.run_steps(60);
    assert_eq!(window.get_all_by_label("Silent").count(), 2);
}

const WANTED: Wanted = Wanted {
    name: 450.0,
    link: 60.0,
    ages: Some([90.0, 60.0]),
    driver: 120.0,
    map: 65.0,
    mark: 20.0,
    before_map: 14.0,
    gaps: 26.0,
};

#[test]
fn widths_by_priority() {
    let room = |available| {
        let room = Widths::new(available, WANTED);
        assert!(room.has_link_words && room.has_map, "{available}: {room:?}");
        (room.name, room.age)
    };
    let [long, short] = [Some((90.0, true)), Some((60.0, false))];
    assert_eq!(room(1200.0), (450.0, long));
    assert_eq!(room(1000.0), (400.0, long));
    assert_eq!(room(600.0), (225.0, long));
    assert_eq!(room(475.0), (100.0, long));
    assert_eq!(room(439.0), (LEAST_NAME, long));
    assert_eq!(room(438.0), (93.0, short));
    assert_eq!(room(409.0), (LEAST_NAME, short));
    assert_eq!(room(408.0), (123.0, None));
    assert_eq!(room(349.0), (LEAST_NAME, None));
    assert_eq!(room(348.0), (108.0, None));
    assert_eq!(room(304.0), (LEAST_NAME, None));
}

#[test]
fn other_texts_shrink_before_a_short_name() {
    let room = |available, name| {
        let room = Widths::new(available, Wanted { name, ..WANTED });
        (room.name, room.has_link_words, room.has_map)
    };
    for (available, words, map) in [
        (349.0, true, true),
        (280.0, true, true),
        (279.0, false, true),
        (240.0, false, true),
        (239.0, false, false),
        (206.0, false, false),
        (150.0, false, false),
    ] {
        let expected = (40.0, words, map);
        assert_eq!(room(available, 40.0), expected, "{available}");
    }
    assert_eq!(room(303.0, 450.0), (103.0, false, true));
    assert_eq!(room(100.0, 450.0), (LEAST_NAME, false, false));
}
