//! Camera and directions.

use eframe::egui::epaint::PathStroke;
use eframe::egui::{Shape, Stroke};
use protocol::keys::Topic;
use protocol::message::{
    Barrier, BarrierKind, Datum, DockingSite, Pose, ShoreCluster, Shores, ShoresReply, TeleopStatus,
};

use super::*;
use crate::test_support::{
    docking_site, idle_teleop_status, inject, pose_at_rest, shore, status_of,
};
use crate::theme;

/// A shore of 20 × 6 m around (30, 13) and a docking site.
fn shores(datum: Option<Datum>) -> Shores {
    let corners = [(200, 100), (400, 100), (400, 160), (200, 160)];
    let shore = ShoreCluster {
        voxels: 100,
        rigid_voxels: 40,
        outline: corners.to_vec(),
        ..shore(3, [36.0, 13.0])
    };
    let site = DockingSite {
        width_m: 8.0,
        ..docking_site([-19.0, -2.5])
    };
    Shores::gather(0.1, datum, vec![shore], vec![site])
}

fn receive_shores(window: &mut Harness<'_, Rig>, shores: Shores) {
    let news = ShoresReply {
        revision: 1,
        shores: Some(shores),
    };
    let model = &mut window.state_mut().model;
    inject(model, Topic::Shores, &news, at(2_400));
    window.run_steps(2);
}

fn assert_looks_at(window: &Harness<'_, Rig>, point_m: [f64; 2]) {
    let [x_m, y_m] = window.state().view.camera.center_m;
    let away_m = libm::hypot(x_m - point_m[0], y_m - point_m[1]);
    assert!(away_m < 1e-3, "{x_m} {y_m} is not {point_m:?}");
}

#[test]
fn a_selected_shore_is_approached() {
    let mut window = window();
    receive_shores(&mut window, shores(None));
    let shore = Look::Mark(ShoreMark::Shore(3), [36.0, 13.0]);
    let site = ShoreMark::Site(1);
    let site = Look::Mark(site, [-19.0, -2.5]);
    // The map has about 800 × 600 points.
    for (mark, side_m, middle_m) in [(shore, 20.0, [30.0, 13.0]), (site, 8.0, [-19.0, -2.5])] {
        let screen = window.state().view.camera.screen;
        let camera = &mut window.state_mut().view.camera;
        *camera = Camera::on(screen);
        camera.zoom_about(screen.center(), 0.05);
        look(&mut window, mark);
        assert_looks_at(&window, middle_m);
        let view = &window.state().view;
        let part = side_m * view.camera.points_per_m / f64::from(view.camera.screen.height());
        assert!((part - 1.0 / 3.0).abs() < 1e-3, "{mark:?}: {part}");
        assert_eq!(view.camera_mode(), CameraMode::Free);
        // The camera approaches once.
        look(&mut window, Look::At([1.0, 2.0]));
        look(&mut window, Look::Out);
        assert_looks_at(&window, [1.0, 2.0]);
    }
    // A removed shore is only centred.
    let before = window.state().view.camera.points_per_m;
    look(&mut window, Look::Mark(ShoreMark::Shore(9), [4.0, 5.0]));
    assert_looks_at(&window, [4.0, 5.0]);
    let after = window.state().view.camera.points_per_m;
    assert_eq!(after.to_bits(), before.to_bits());
}

/// Marked shores and docking sites: whether the line is closed, and its corners in `odom`, whole metres.
fn standing_out(window: &Harness<'_, Rig>) -> Vec<(bool, Vec<[i32; 2]>)> {
    let stroke = PathStroke::from(Stroke::new(3.0, theme::SELECTION));
    let view = &window.state().view;
    let corner_m = |at: &Pos2| {
        let corner_m = view.camera.to_odom(*at);
        corner_m.map(|metres| metres.round() as i32)
    };
    let shapes = window.output().shapes.iter();
    let lines = shapes.filter_map(|clipped| {
        if let Shape::Path(path) = &clipped.shape {
            let corners_m = || path.points.iter().map(corner_m).collect::<Vec<_>>();
            (path.stroke == stroke).then(|| (path.closed, corners_m()))
        } else {
            None
        }
    });
    lines.collect()
}

#[test]
fn a_selected_shore_is_marked_until_it_is_gone() {
    let mut window = window();
    receive_shores(&mut window, shores(None));
    let three = ShoreMark::Shore(3);
    let site = ShoreMark::Site(1);
    let around_three = (true, vec![[20, 10], [40, 10], [40, 16], [20, 16]]);
    assert_eq!(standing_out(&window), []);
    look(&mut window, Look::Hover(Some(three)));
    assert_eq!(standing_out(&window), std::slice::from_ref(&around_three));
    // Hovered and selected.
    look(&mut window, Look::Mark(three, [36.0, 13.0]));
    assert_eq!(standing_out(&window), std::slice::from_ref(&around_three));
    look(&mut window, Look::Hover(Some(site)));
    let both = standing_out(&window);
    let is_shore: Vec<_> = both.iter().map(|(is_shore, _)| *is_shore).collect();
    assert_eq!(is_shore, [true, false]);
    assert_eq!(both[0], around_three);
    look(&mut window, Look::Hover(None));
    assert_eq!(standing_out(&window), [around_three]);
    // After its removal, a shore with the same number is not selected.
    for (revision, shores) in [
        (2, Shores::gather(0.1, None, Vec::new(), Vec::new())),
        (3, shores(None)),
    ] {
        let news = ShoresReply {
            revision,
            shores: Some(shores),
        };
        let model = &mut window.state_mut().model;
        inject(model, Topic::Shores, &news, at(2_400));
        window.run_steps(2);
        assert_eq!(standing_out(&window), [], "{revision}");
        assert_eq!(window.state().view.marked(), None, "{revision}");
    }
    let site = ShoreMark::Site(1);
    look(&mut window, Look::Mark(site, [-19.0, -2.5]));
    let of_site = standing_out(&window);
    let is_shore: Vec<_> = of_site.iter().map(|(is_shore, _)| *is_shore).collect();
    assert_eq!(is_shore, [false]);
}

#[test]
fn the_whole_map_is_beside_all_cards() {
    let check = |window: &Harness<'_, Rig>, cards: usize| {
        let view = &window.state().view;
        assert_eq!(view.camera_mode(), CameraMode::FitMap);
        // Tiles (−1, 0), (0, 0) and (1, −1) of 6.4 m.
        let map = [[-6.4, 6.4], [12.8, 6.4], [12.8, -6.0], [-6.4, -6.0]];
        let map = Rect::from_points(&map.map(|corner_m| view.place_of(corner_m)));
        let screen = view.camera.screen;
        assert!(screen.contains_rect(map), "{screen}: {map}");
        assert_eq!(view.cards().len(), cards, "{screen}");
        for card in view.cards() {
            assert!(!map.intersects(card), "{screen}: {map} {card}");
        }
    };
    for (width, height) in [
        (800.0, 600.0),
        (420.0, 700.0),
        (1200.0, 700.0),
        (280.0, 390.0),
    ] {
        let mut window = window_of(width, height);
        // Buttons, compass, legends and scale bar.
        check(&window, 4);
        window.state_mut().view.pinned_m = Some([3.17, 4.55]);
        window.run_steps(6);
        check(&window, 5);
    }
    let mut window = window();
    let beside = window.state().view.camera.points_per_m;
    look(&mut window, Look::Draw(Overlay::Legend, false));
    window.run_steps(2);
    check(&window, 3);
    assert!(window.state().view.camera.points_per_m > 1.1 * beside);
}

#[test]
fn cards_do_not_cover_the_vehicle() {
    // The probe of all layers at once needs more room than that of any vehicle.
    let mut window = window_of(900.0, 720.0);
    let model = &mut window.state_mut().model;
    inject(model, Topic::Pose, &pose_at_rest(), at(2_400));
    look(&mut window, Look::At([2.0, 0.0]));
    let pointer = window.state().view.place().center() + vec2(0.0, -100.0);
    window.hover_at(pointer);
    window.run_steps(4);
    let before = window.state().view.cards.occluders.len();
    assert_eq!(before, 3, "probe, buttons and compass");
    let [probe, ..] = window.state().view.cards.occluders[..] else {
        panic!("no card");
    };
    let [buttons, compass, legends] =
        ["Grid", "Compass: y up", "Unknown"].map(|name| window.get_by_label(name).rect());
    let [zoom_in, whole_map] = ["+", "Whole map"].map(|name| window.get_by_label(name).rect());
    for covered in [probe, buttons, zoom_in, whole_map, compass, legends] {
        let view = &mut window.state_mut().view;
        let vehicle = view.place_of([0.0, 0.0]);
        view.camera.pan(covered.center() - vehicle);
        window.run_steps(5);
        let view = &window.state().view;
        let vehicle = view.place_of([0.0, 0.0]);
        assert!(
            vehicle.distance(covered.center()) < 0.1,
            "{vehicle} {covered}"
        );
        let cards = view.cards.occluders.iter().copied().chain(view.cards());
        for card in cards.filter(|card| *card != view.scale_bar_room()) {
            assert!(!card.contains(vehicle), "{card} covers {covered}");
        }
        // The buttons fold, the probe moves.
        assert!(window.query_by_label("+").is_some(), "{covered}");
        let is_folded = window.query_by_label("Tools").is_some();
        assert_eq!(
            is_folded,
            [buttons, zoom_in, whole_map].contains(&covered),
            "{covered}"
        );
        assert_eq!(
            view.legends_place().is_none(),
            covered == legends,
            "{covered}"
        );
        assert!(window.query_by_label("Tile changed").is_some(), "{covered}");
    }
}

#[test]
fn directions_are_relative_to_x_without_north() {
    let datum = Datum {
        latitude_deg: 47.0,
        longitude_deg: 8.0,
        altitude_m: 400.0,
    };
    for (datum, words) in [
        (None, "Map, measured: 5.00 m  ·  53° left of x"),
        (Some(datum), "Map, measured: 5.00 m  ·  037°"),
    ] {
        let mut window = window();
        receive_shores(&mut window, shores(datum));
        look(&mut window, Look::At([2.0, 3.0]));
        look(&mut window, Look::Measure(true));
        look(&mut window, Look::Point);
        look(&mut window, Look::At([5.0, 7.0]));
        window.get_by_label_contains(words);
    }
}

fn written(window: &Harness<'_, Rig>, first: [&str; 2]) -> Vec<(String, Rect)> {
    let shapes = window.output().shapes.iter();
    let texts = shapes.filter_map(|clipped| {
        if let Shape::Text(text) = &clipped.shape {
            let words = text.galley.text();
            let is_it = first.iter().any(|first| words.starts_with(first));
            is_it.then(|| (words.to_owned(), text.visual_bounding_rect()))
        } else {
            None
        }
    });
    texts.collect()
}

#[test]
fn no_grid_number_is_partly_covered() {
    let mut window = window();
    look(&mut window, Look::Draw(Overlay::Grid, true));
    window.run_steps(2);
    // Moves numbers under scale bar, card and legends.
    let corner = window.state().view.place().left_bottom();
    let numbers = |window: &Harness<'_, Rig>| written(window, ["x ", "y "]).len();
    let mut counts = Vec::new();
    for step in 0..8_u8 {
        let beside = [0.02 * f32::from(step), 0.02 * f32::from(step)];
        look(&mut window, Look::Beside(beside));
        window.hover_at(corner + vec2(550.0, -400.0));
        window.run_steps(3);
        counts.push(numbers(&window));
        let view = &window.state().view;
        let bar = Rect::from_two_pos(corner + vec2(12.0, -12.0), corner + vec2(60.0, -40.0));
        let standing = view
            .cards
            .occluders
            .iter()
            .copied()
            .chain(view.legends_place());
        let standing: Vec<_> = standing.chain([bar]).collect();
        for (number, place) in written(&window, ["x ", "y "]) {
            let other = standing
                .iter()
                .find(|other| other.shrink(5.0).intersects(place));
            assert_eq!(other, None, "{number} at {place}");
        }
    }
    assert!(counts.iter().all(|count| *count >= 3), "{counts:?}");
}

#[test]
fn grid_numbers_of_a_rotated_map_do_not_overlap() {
    let mut window = window();
    look(&mut window, Look::Follow(false));
    look(&mut window, Look::Draw(Overlay::Grid, true));
    for step in 0..32_u8 {
        let up_rad = 0.1 * f64::from(step);
        window.state_mut().view.camera.turn_up(up_rad);
        window.run_steps(2);
        let numbers = written(&window, ["x ", "y "]);
        assert!(numbers.len() >= 3, "{up_rad}: {numbers:?}");
        for (index, (number, place)) in numbers.iter().enumerate() {
            let others = &numbers[index + 1..];
            let other = others.iter().find(|(_, other)| other.intersects(*place));
            assert_eq!(other, None, "{number} at {place}, turned to {up_rad}");
        }
    }
}

#[test]
fn shore_numbers_are_above_the_vehicle() {
    let mut window = window();
    for overlay in [Overlay::Legend, Overlay::Compass] {
        look(&mut window, Look::Draw(overlay, false));
    }
    receive_shores(&mut window, shores(None));
    let pose = Pose {
        position_m: [36.0, 13.0, 0.0],
        ..pose_at_rest()
    };
    let model = &mut window.state_mut().model;
    inject(model, Topic::Pose, &pose, at(2_400));
    look(&mut window, Look::At([36.0, 13.0]));
    window.run_steps(2);
    let shapes = &window.output().shapes;
    let vehicle = shapes.iter().rposition(
        |clipped| matches!(&clipped.shape, Shape::Path(path) if path.fill == theme::VEHICLE),
    );
    let number = shapes.iter().position(
        |clipped| matches!(&clipped.shape, Shape::Text(text) if text.galley.text() == "3"),
    );
    let (vehicle, number) = (vehicle.unwrap(), number.unwrap());
    assert!(number > vehicle, "{number} is below {vehicle}");
}

#[test]
fn the_limiting_obstacle_has_a_ring() {
    let mut window = window();
    look(&mut window, Look::At([30.0, 10.0]));
    let model = &mut window.state_mut().model;
    inject(model, Topic::Pose, &pose_at_rest(), at(2_400));
    let rings = |window: &Harness<'_, Rig>| -> Vec<[i32; 2]> {
        let view = &window.state().view;
        let shapes = window.output().shapes.iter();
        let rings = shapes.filter_map(|clipped| {
            let Shape::Circle(ring) = &clipped.shape else {
                return None;
            };
            let place_m = view.camera.to_odom(ring.center);
            // Not the smaller one of the legend.
            let is_it = ring.stroke.color == theme::MONITOR && ring.radius > 9.0;
            is_it.then(|| place_m.map(|metres| metres.round() as i32))
        });
        rings.collect()
    };
    for (barrier_m, expected) in [
        (None, vec![]),
        (Some([32.0, 9.0]), vec![[32, 9]]),
        // Outside the shown part.
        (Some([3_200.0, 9.0]), vec![]),
    ] {
        let teleop = TeleopStatus {
            barrier: barrier_m.map(|position_m| Barrier {
                position_m,
                kind: BarrierKind::Unknown,
            }),
            ..idle_teleop_status()
        };
        let status = status_of(teleop);
        let model = &mut window.state_mut().model;
        inject(model, Topic::Status, &status, at(2_400));
        window.run_steps(2);
        assert_eq!(rings(&window), expected, "{barrier_m:?}");
    }
}

#[test]
fn ruler_labels_do_not_cover_shore_numbers() {
    let mut window = window();
    receive_shores(&mut window, shores(None));
    look(&mut window, Look::At([36.0, 13.0]));
    look(&mut window, Look::Measure(true));
    let place = |window: &Harness<'_, Rig>, first: &str| {
        let texts = written(window, [first, first]);
        let found = texts
            .iter()
            .find(|(words, _)| words.len() == 1 || first == "total");
        found.map(|(_, place)| *place).expect("it is there")
    };
    // The total would be placed below the end of the line, over the number.
    let number = place(&window, "3").center();
    let view = &mut window.state_mut().view;
    let end_m = view.camera.to_odom(number - vec2(0.0, 24.0));
    for point_m in [[30.0, 20.0], [36.0, 20.0], end_m] {
        view.point(point_m);
    }
    window.run_steps(2);
    let total = place(&window, "total");
    let number = place(&window, "3");
    assert!(!total.intersects(number.expand(5.0)), "{total} {number}");
    assert!(
        total.distance_to_pos(number.center()) < 100.0,
        "beside it: {total} {number}"
    );
}

#[test]
fn no_probe_below_buttons_and_legends() {
    let mut window = window();
    let is_read = |window: &mut Harness<'_, Rig>, place: Pos2| {
        window.hover_at(place);
        window.run_steps(3);
        window.query_by_label_contains("m  y\u{a0}").is_some()
    };
    let legends = window.state().view.legends_place().unwrap();
    let beside = legends.left_center() - vec2(100.0, 0.0);
    for label in ["Grid", "Compass: y up"] {
        let place = window.get_by_label(label).rect().center();
        assert!(!is_read(&mut window, place), "{label}");
        assert!(is_read(&mut window, beside));
    }
    assert!(!is_read(&mut window, legends.center()), "legends");
    click(&mut window, legends.center());
    assert_eq!(window.state().view.pinned_m(), None);
}
