mod looking;

use std::time::Duration;

use eframe::egui::{Event, Key, Modifiers, Shape, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable};
use protocol::keys::Topic;
use protocol::message::Localization;
use protocol::tile::TileCells;
use protocol::tile_store::TileStore;

use super::grid::ScaleBar;
use super::probe::tests::{model_of, store};
use super::*;
use crate::test_support::{
    announce_map, at, idle_teleop_status, inject, inject_at, localization, pose_at_rest, push_tile,
    status_of, store_of,
};

pub(super) fn publish(
    store: &mut TileStore,
    layer: LayerId,
    (tx, ty): (i32, i32),
    code: impl Fn(usize, usize) -> u16,
) -> TileKey {
    let key = TileKey { layer, tx, ty };
    drop(store.publish(key, TileCells::from_fn(code)).unwrap());
    key
}

struct Rig {
    view: MapView,
    model: ConsoleModel,
    asked: Vec<Look>,
}

/// A window of 800 × 600 points with a map of every layer.
fn window() -> Harness<'static, Rig> {
    window_of(800.0, 600.0)
}

fn window_of(width: f32, height: f32) -> Harness<'static, Rig> {
    let rig = Rig {
        view: MapView::default(),
        model: model_of(&store()),
        asked: Vec::new(),
    };
    let mut window = Harness::builder()
        .with_size(vec2(width, height))
        .build_ui_state(
            |ui, rig: &mut Rig| {
                rig.view.update(&mut rig.model);
                let asked = rig.view.show(ui, &rig.model, at(2_500));
                rig.asked.extend(asked);
            },
            rig,
        );
    window.run_steps(60);
    window
}

fn click(window: &mut Harness<'_, Rig>, place: Pos2) {
    window.drag_at(place);
    window.run_steps(1);
    window.drop_at(place);
    window.run_steps(1);
}

fn look(window: &mut Harness<'_, Rig>, look: Look) {
    window.state_mut().view.look(look);
    window.run_steps(1);
}

/// The robot sends a tile measured at this stamp.
fn maps(window: &mut Harness<'_, Rig>, robot: &mut TileStore, tx: i32, code: u16, stamp_ns: i64) {
    robot.set_stamp(stamp_ns);
    let key = publish(robot, LayerId::Obstacle, (tx, 9), |_, _| code);
    let model = &mut window.state_mut().model;
    push_tile(model, robot, key, at(2_400));
    window.run_steps(4);
}

#[test]
fn the_newest_tile_of_a_layer_exists() {
    let mut window = window();
    let newest = |window: &Harness<'_, Rig>| {
        let newest = window.state().view.newest(LayerId::Obstacle)?;
        window.state().model.map().ages().age(newest, at(2_500))
    };
    let old = |secs: i64| Some(Duration::from_millis(100 + 1_000 * secs.unsigned_abs()));
    let mut robot = store();
    // The robot's clock is at 0 s: earlier measurements are old.
    robot.set_stamp(0);
    let second_ns = -1_000_000_000;
    robot.erase_layer(LayerId::Obstacle).unwrap();
    let now = at(2_400);
    announce_map(&mut window.state_mut().model, &robot, now);
    window.run_steps(4);
    assert_eq!(newest(&window), None, "the layer was erased");
    maps(&mut window, &mut robot, 0, 1, 9 * second_ns);
    maps(&mut window, &mut robot, 1, 1, 5 * second_ns);
    maps(&mut window, &mut robot, 2, 1, 7 * second_ns);
    assert_eq!(newest(&window), old(5));
    // The newest tile changes again.
    maps(&mut window, &mut robot, 1, 2, 3 * second_ns);
    assert_eq!(newest(&window), old(3));
    // After a seek backwards the tile is older than others.
    maps(&mut window, &mut robot, 1, 1, 8 * second_ns);
    assert_eq!(newest(&window), old(7));
    maps(&mut window, &mut robot, 2, 0, 2 * second_ns);
    assert_eq!(newest(&window), old(8), "it is gone");
}

#[test]
fn newest_tile_after_the_data_starts_again() {
    let mut window = window();
    let mut robot = store();
    robot.set_stamp(0);
    robot.erase_layer(LayerId::Obstacle).unwrap();
    announce_map(&mut window.state_mut().model, &robot, at(2_400));
    let second_ns = 1_000_000_000;
    let newest = |window: &mut Harness<'_, Rig>, data_s: i64, ms: u64| {
        let model = &mut window.state_mut().model;
        inject_at(
            model,
            data_s * second_ns,
            Topic::Pose,
            &pose_at_rest(),
            at(ms),
        );
        window.run_steps(2);
        let newest = window.state().view.newest(LayerId::Obstacle)?;
        let age = window.state().model.map().ages().age(newest, at(ms));
        Some((newest.tx, age.map(|age| age.as_secs())))
    };
    // Measured at 60 s, while the clock is at 3 s again.
    maps(&mut window, &mut robot, 0, 1, 60 * second_ns);
    assert_eq!(newest(&mut window, 3, 3_500), Some((0, None)));
    maps(&mut window, &mut robot, 1, 1, second_ns);
    maps(&mut window, &mut robot, 2, 1, 2 * second_ns);
    assert_eq!(newest(&mut window, 4, 4_500), Some((2, Some(3))));
    // It is not known immediately that the tile was measured before.
    robot.set_stamp(70 * second_ns);
    let key = publish(&mut robot, LayerId::Obstacle, (3, 9), |_, _| 1);
    push_tile(&mut window.state_mut().model, &robot, key, at(4_500));
    assert_eq!(newest(&mut window, 4, 4_600), Some((3, Some(0))));
    assert_eq!(newest(&mut window, 4, 5_501), Some((2, Some(4))));
}

#[test]
fn a_click_pins_the_probe_until_escape() {
    let mut window = window();
    let place = window.state().view.place_of([2.0, 3.0]);
    click(&mut window, place);
    let pinned_m = window.state().view.pinned_m().unwrap();
    let distance_m = libm::hypot(pinned_m[0] - 2.0, pinned_m[1] - 3.0);
    assert!(distance_m < 0.05, "{pinned_m:?}");
    window.remove_cursor();
    window.run_steps(2);
    window.get_by_label("x\u{a0}2.00\u{a0}m  y\u{a0}3.00\u{a0}m");
    window.get_by_label("Unpin");
    window.state_mut().view.escape();
    window.run_steps(2);
    assert_eq!(window.state().view.pinned_m(), None);
    assert!(window.query_by_label("Unpin").is_none());
}

#[test]
fn measuring_a_known_distance_on_a_rotated_map() {
    for up_rad in [FRAC_PI_2, 0.4] {
        let mut window = window();
        look(&mut window, Look::Follow(false));
        look(&mut window, Look::Measure(true));
        window.state_mut().view.camera.turn_up(up_rad);
        for point_m in [[-1.0, 1.0], [2.0, 5.0]] {
            let place = window.state().view.place_of(point_m);
            click(&mut window, place);
        }
        let ruler = window.state().view.ruler().unwrap();
        let legs = Ruler::legs(ruler.points_m(), |_| None);
        assert_eq!(legs.len(), 1);
        // A point of the screen is 3 cm.
        assert!((legs[0].length_m - 5.0).abs() < 0.05, "{legs:?}");
        let bearing_deg = legs[0].bearing_deg.unwrap();
        assert!((bearing_deg - 36.9).abs() < 1.0, "{legs:?}");
        assert_eq!(window.state().view.pinned_m(), None, "clicks measure");
        window.state_mut().view.escape();
        assert_eq!(window.state().view.ruler(), None);
    }
}

#[test]
fn keys_probe_and_measure_the_middle() {
    let mut window = window();
    look(&mut window, Look::At([2.0, 3.0]));
    look(&mut window, Look::Point);
    window.run_steps(1);
    assert_eq!(window.state().view.pinned_m(), Some([2.0, 3.0]));
    window.get_by_label("x\u{a0}2.00\u{a0}m  y\u{a0}3.00\u{a0}m");
    look(&mut window, Look::UndoPoint);
    assert_eq!(window.state().view.pinned_m(), None);

    look(&mut window, Look::Measure(true));
    look(&mut window, Look::Point);
    // A segment of length 0 is not shown.
    assert!(window.query_by_label_contains("measured").is_none());
    look(&mut window, Look::At([5.0, 7.0]));
    // The open end is the pointer.
    window.get_by_label_contains("Map, measured: 5.00 m");
    look(&mut window, Look::Point);
    look(&mut window, Look::At([5.0, 9.0]));
    look(&mut window, Look::Point);
    look(&mut window, Look::UndoPoint);
    let points_m = window.state().view.ruler().unwrap().points_m();
    assert_eq!(points_m, [[2.0, 3.0], [5.0, 7.0]]);

    // The pointer replaces the middle of the map.
    for point_m in [[4.0, 8.0], [5.0, 8.0]] {
        let place = window.state().view.place_of(point_m);
        window.hover_at(place);
        window.run_steps(1);
    }
    window.run_steps(1);
    window.get_by_label_contains("total 6.00 m");
}

#[test]
fn buttons_and_compass_requests() {
    for (label, asked) in [
        ("Compass: y up", Look::Up(Orientation::RobotUp)),
        ("Robot up", Look::Up(Orientation::RobotUp)),
        ("Grid", Look::Draw(Overlay::Grid, true)),
        ("Measure", Look::Measure(true)),
        ("Whole map", Look::Whole),
    ] {
        let mut window = window();
        window.get_by_label(label).click();
        window.run_steps(2);
        assert_eq!(window.state().asked, [asked], "{label}");
    }
}

#[test]
fn wheel_zooms_about_the_pointer_and_drag_pans() {
    let mut window = window();
    let place = pos2(300.0, 200.0);
    window.hover_at(place);
    window.run_steps(1);
    let view = &window.state().view;
    let (held_m, before) = (view.camera.to_odom(place), view.camera.points_per_m);
    window.event(Event::MouseWheel {
        unit: eframe::egui::MouseWheelUnit::Line,
        delta: vec2(0.0, 3.0),
        phase: eframe::egui::TouchPhase::Move,
        source: eframe::egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    });
    window.run_steps(20);
    let view = &window.state().view;
    assert!(view.camera.points_per_m > 1.1 * before);
    assert!(view.place_of(held_m).distance(place) < 0.5);
    assert_eq!(view.camera_mode(), CameraMode::Free);
}

/// A drag says where the vehicle is and where ahead is; one that is too short says nothing, and without the tool the map moves.
#[test]
fn a_drag_sets_the_pose_where_the_robot_searches_for_itself() {
    let mut window = window();
    assert!(window.query_by_label("Set pose").is_none());
    let model = &mut window.state_mut().model;
    let searching = Localization {
        is_searching: true,
        ..localization()
    };
    inject(model, Topic::Localization, &searching, at(2_000));
    let status = status_of(idle_teleop_status());
    inject(model, Topic::Status, &status, at(2_000));
    window.run_steps(1);
    window.get_by_label("Set pose").click();
    window.run_steps(2);
    let set_pose = Look::SetPose(Some(PosePurpose::Locate));
    assert_eq!(window.state().asked, [set_pose]);
    look(&mut window, Look::Follow(false));
    look(&mut window, set_pose);
    let before = window.state().view.place_of([0.0, 0.0]);
    for (ahead_m, said) in [([2.05, 3.0], None), ([2.0, 6.0], Some([2000, 3000, 1571]))] {
        let [from, to] = [[2.0, 3.0], ahead_m].map(|m| window.state().view.place_of(m));
        window.drag_at(from);
        window.run_steps(1);
        for step in 1..=4 {
            window.hover_at(from.lerp(to, 0.25 * step as f32));
            window.run_steps(1);
        }
        window.drop_at(to);
        window.run_steps(1);
        let pose = window.state_mut().view.take_said_pose();
        let pose = pose.map(|(_, pose)| [pose.x_mm, pose.y_mm, pose.yaw_mrad]);
        let is_near = |(a, b): (i32, i32)| (a - b).abs() < 60;
        let both = pose.zip(said);
        assert_eq!(pose.is_some(), said.is_some(), "{pose:?}");
        assert!(
            both.is_none_or(|(a, b)| a.into_iter().zip(b).all(is_near)),
            "{pose:?}"
        );
    }
    assert_eq!(window.state().view.place_of([0.0, 0.0]), before);
    inject(
        &mut window.state_mut().model,
        Topic::Localization,
        &localization(),
        at(2_400),
    );
    window.run_steps(2);
    assert!(window.query_by_label("Set pose").is_none());
}

/// A click is a goal that looks away from the vehicle, a drag one with its own heading. The button says why there is none.
#[test]
fn a_goal_is_clicked_where_a_planner_is_and_this_console_drives() {
    let mut window = window();
    assert!(window.query_by_label("Goal").is_none());
    for offer in [GoalOffer::NoPlanner, GoalOffer::NotDriving] {
        window.state_mut().view.set_goal_offer(offer);
        window.run_steps(1);
        assert!(window.get_by_label("Goal").accesskit_node().is_disabled());
    }
    window.state_mut().view.set_goal_offer(GoalOffer::Available);
    window.run_steps(1);
    window.get_by_label("Goal").click();
    window.run_steps(2);
    let tool = Look::SetPose(Some(PosePurpose::Goal));
    assert_eq!(window.state().asked, [tool]);
    look(&mut window, Look::Follow(false));
    look(&mut window, tool);
    let model = &mut window.state_mut().model;
    inject(model, Topic::Pose, &pose_at_rest(), at(2_000));
    window.run_steps(1);
    // Left of the vehicle, which looks along x.
    let goal_m = [0.0, 3.0];
    let at = window.state().view.place_of(goal_m);
    window.hover_at(at);
    window.run_steps(1);
    window.drag_at(at);
    window.run_steps(1);
    window.drop_at(at);
    window.run_steps(2);
    let (purpose, pose) = window.state_mut().view.take_said_pose().unwrap();
    let off = [
        f64::from(pose.x_mm) / 1000.0 - goal_m[0],
        f64::from(pose.y_mm) / 1000.0 - goal_m[1],
        f64::from(pose.yaw_mrad) / 1000.0 - FRAC_PI_2,
    ];
    assert_eq!(purpose, PosePurpose::Goal);
    assert!(off.iter().all(|off| off.abs() < 0.05), "{pose:?}");
    // Somebody else drives now.
    window
        .state_mut()
        .view
        .set_goal_offer(GoalOffer::NotDriving);
    let state = window.state_mut();
    state.view.update(&mut state.model);
    window.run_steps(1);
    assert!(window.state().view.pose_tool.is_none());
}

#[test]
fn settings_are_restored_and_show_a_layer_of_any_robot() {
    let mut window = window();
    let view = &mut window.state_mut().view;
    view.look(Look::Draw(Overlay::Grid, true));
    view.look(Look::Follow(false));
    let model = model_of(&store());
    view.apply(LayerCommand::Only(LayerId::Shore), &model);
    let kept = view.settings().clone();
    assert_eq!(kept.camera_mode, CameraMode::Free);

    let mut next = MapView::default();
    next.restore(kept);
    assert_eq!(next.camera_mode(), CameraMode::FitMap);
    assert!(next.settings().has(Overlay::Grid));
    assert_eq!(next.shown_layers(), [LayerId::Shore].into());

    // A robot that maps only costs.
    let mut model = model_of(&store_of(&[LayerId::Cost]));
    next.forget();
    next.update(&mut model);
    assert!(next.shown_layers().contains(&LayerId::Cost));
    next.apply(LayerCommand::Only(LayerId::Cost), &model);
    let shown = [LayerId::Cost, LayerId::Shore];
    assert_eq!(next.shown_layers(), shown.into(), "Shore is another's");
    next.apply(LayerCommand::Show(LayerId::Cost, false), &model);
    next.update(&mut model);
    assert!(!next.shown_layers().contains(&LayerId::Cost), "as chosen");
}

#[test]
fn a_new_view_draws_all_tiles_of_the_model() {
    let mut window = window();
    let tiles = window.state().view.tiles(LayerId::Elevation);
    assert_eq!(tiles, 3);
    // No tile changes any more.
    window.state_mut().view.forget();
    assert_eq!(window.state().view.tiles(LayerId::Elevation), 0);
    window.run_steps(2);
    assert_eq!(window.state().view.tiles(LayerId::Elevation), tiles);
}

#[test]
fn an_unchanged_map_requests_no_repaint() {
    let mut window = window();
    window.run_steps(5);
    assert!(!window.state().view.is_behind);
    let outputs = &window.output().viewport_output;
    let delay = outputs.values().map(|output| output.repaint_delay).min();
    assert!(delay.unwrap() >= Duration::from_secs(1), "{delay:?}");
    assert!(window.output().textures_delta.set.is_empty());
}

#[test]
fn the_probe_card_has_one_title_for_ages() {
    // The map in a window of 640 × 480 points, and a large one.
    for width in [280.0, 800.0] {
        let mut window = window_of(width, 390.0);
        let mut pin = |point_m| {
            window.state_mut().view.pinned_m = Some(point_m);
            window.run_steps(4);
            let heads = window.query_all_by_label("Tile changed");
            let heads: Vec<_> = heads.map(|head| head.rect()).collect();
            let ages = window.query_all_by_label_contains(" s ago");
            let ages: Vec<_> = ages.map(|age| age.rect()).collect();
            (heads, ages, window.state().view.camera.screen)
        };
        // Known cells and unknown cells of the same tiles.
        for point_m in [[3.17, 4.55], [3.17, 0.15]] {
            let (heads, ages, screen) = pin(point_m);
            let [head] = heads[..] else {
                panic!("{width}: {heads:?}");
            };
            assert!(screen.contains_rect(head), "{width}: {head}");
            assert!(ages.len() > 3, "{width}: {ages:?}");
            for age in ages {
                assert!((age.left() - head.left()).abs() < 1.0, "{head} {age}");
                assert!(age.top() >= head.bottom(), "{width}: {head} {age}");
            }
        }
        let (heads, ages, _) = pin([2.0, -50.0]);
        assert_eq!((heads.len(), ages), (1, Vec::new()), "there is no tile");
    }
}

#[test]
fn the_probe_card_of_a_small_map_does_not_cover_the_point() {
    let mut window = window_of(280.0, 390.0);
    let model = model_of(&store());
    let view = &mut window.state_mut().view;
    view.apply(LayerCommand::Only(LayerId::Elevation), &model);
    window.run_steps(2);
    let card = |window: &Harness<'_, Rig>| {
        let text = window.get_by_label_contains("m  y\u{a0}").rect();
        let view = &window.state().view;
        let mut cards = view.cards.occluders.iter();
        *cards.find(|card| card.contains_rect(text)).unwrap()
    };
    let screen = window.state().view.camera.screen;
    let mut tops = Vec::new();
    for step in 1..12_u8 {
        let place = pos2(
            screen.left() + 60.0,
            screen.top() + 380.0 * f32::from(step) / 12.0,
        );
        window.hover_at(place);
        window.run_steps(4);
        let card = card(&window);
        assert!(!card.contains(place), "{card} {place}");
        assert!(screen.contains_rect(card.shrink(1.0)), "{card}");
        let compass = window.get_by_label("Compass: y up").rect();
        assert!(!card.intersects(compass), "{card} {compass}");
        tops.push(card.top().round() as i32);
    }
    assert!(
        tops.first() > tops.iter().min(),
        "below, then above: {tops:?}"
    );
    tops.sort_unstable();
    tops.dedup();
    assert_eq!(tops.len(), 2, "one of two places: {tops:?}");
}

fn under_legends(window: &Harness<'_, Rig>) -> f32 {
    let view = &window.state().view;
    let place = view.legends.place.unwrap();
    place.area() / view.place().area()
}

#[test]
fn a_button_opens_more_legends_on_small_maps() {
    for (width, height, most) in [
        (215.0, 390.0, 0.19),
        (260.0, 300.0, 0.21),
        (500.0, 400.0, 0.21),
    ] {
        let mut window = window_of(width, height);
        let share = under_legends(&window);
        assert!(share < most, "{width} × {height}: {share}");
        let button = window.get_by_label_contains("more legend");
        button.focus();
        window.run_steps(2);
        assert!(window.get_by_label_contains("more legend").is_focused());
        window.key_press(Key::Enter);
        window.run_steps(4);
        window.get_by_label("Fewer legends");
        let opened = under_legends(&window);
        assert!(opened > share, "{width} × {height}: {opened}");
        let place = window.state().view.legends.place.unwrap();
        assert!(window.state().view.place().contains_rect(place), "{place}");
        window.get_by_label("Fewer legends").click();
        window.run_steps(4);
        window.get_by_label_contains("more legend");
        let closed = under_legends(&window);
        assert!((closed - share).abs() < 0.01, "{closed} {share}");
    }
    let mut tiny = window_of(190.0, 150.0);
    assert!(under_legends(&tiny) < 0.1);
    tiny.get_by_label_contains("Legends: ").click();
    tiny.run_steps(4);
    tiny.get_by_label("Fewer legends");
    assert!(under_legends(&tiny) > 0.25, "{}", under_legends(&tiny));
    let large = window_of(1400.0, 1000.0);
    assert!(large.query_by_label_contains("more legend").is_none());
    assert!(large.query_by_label_contains("Legends: ").is_none());
}

#[test]
fn a_narrow_map_has_one_legend() {
    window_of(294.0, 1_200.0).get_by_label_contains("5 more legends");
    let wide = window_of(900.0, 1_200.0);
    assert!(wide.query_by_label_contains("more legend").is_none());
}

#[test]
fn a_narrow_map_has_the_button_beside_the_title() {
    // The map in a window of 700 × 620 points.
    let mut window = window_of(294.0, 406.0);
    crate::theme::set(&window.ctx);
    window.run_steps(4);
    let share = under_legends(&window);
    assert!(share < 0.13, "{share}");
    for (name, is_there) in [
        ("Sparse", true),
        ("Docking site", true),
        ("Obstacle", false),
        ("Unknown", false),
    ] {
        let found = window.query_by_label(name).is_some();
        assert_eq!(found, is_there, "{name}");
    }
    let button = window.get_by_label_contains("5 more legends: ");
    let button = button.rect();
    let title = window.get_by_label("Shore").rect();
    let card = window.state().view.legends.place.unwrap();
    assert!(card.contains_rect(button), "{card} {button}");
    assert!(button.y_range().contains(title.center().y), "{title}");
    assert!(title.right() <= button.left(), "{title} {button}");
    // The button also works after a click into the card.
    for label in ["more legend", "Fewer legends", "more legend"] {
        window.get_by_label_contains(label).click();
        window.run_steps(4);
        let card = window.state().view.legends.place.unwrap();
        click(&mut window, card.center_bottom() - vec2(0.0, 20.0));
        window.run_steps(2);
    }
    window.get_by_label("Fewer legends");
}

/// Margins of the test window and of the scale bar's card, points.
const AROUND: f32 = 16.0;
const PADDING: f32 = 16.0;

fn scale_bar(view: &MapView) -> ScaleBar {
    let room = view.place().width() - super::legend_card::width(view.place()) - 3.0 * CARD_MARGIN;
    ScaleBar::new(view.camera.points_per_m, room)
}

#[test]
fn legends_do_not_cover_the_scale_bar() {
    // The map in windows of 500 to 730 points.
    for width in [204.0, 215.0, 253.0, 294.0] {
        let mut window = window_of(width + AROUND, 300.0 + AROUND);
        crate::theme::set(&window.ctx);
        // Obstacles over heights have the longest texts.
        let stack = &mut window.state_mut().view.settings.stack;
        stack.apply(LayerCommand::Show(LayerId::Shore, false));
        window.run_steps(4);
        for is_opened in [false, true] {
            window.get_by_label("Free: clear over the known");
            let view = &window.state().view;
            let legends = view.legends.place.unwrap();
            let bar = view.place().left() + CARD_MARGIN + PADDING + scale_bar(view).length;
            assert!(bar < legends.left() + 0.5, "{width}: {bar} {legends}");
            if !is_opened {
                window.get_by_label_contains("more legend").click();
                window.run_steps(4);
            }
        }
    }
}

#[test]
fn opened_legends_hide_the_scale_bar_completely() {
    let mut window = window_of(160.0 + AROUND, 134.0 + AROUND);
    crate::theme::set(&window.ctx);
    look(&mut window, Look::Follow(false));
    let screen = window.state().view.camera.screen;
    let camera = &mut window.state_mut().view.camera;
    // The bar has 47 points.
    camera.zoom_about(screen.center(), 4.7 / camera.points_per_m);
    let has_bar = |window: &Harness<'_, Rig>| {
        let label = scale_bar(&window.state().view).label;
        assert_eq!(label, "10 m");
        let mut shapes = window.output().shapes.iter();
        shapes.any(
            |clipped| matches!(&clipped.shape, Shape::Text(text) if text.galley.text() == label),
        )
    };
    window.run_steps(4);
    assert!(has_bar(&window));
    for (label, has) in [("Legends: ", false), ("Fewer legends", true)] {
        window.get_by_label_contains(label).focus();
        window.run_steps(2);
        window.key_press(Key::Enter);
        window.run_steps(4);
        assert_eq!(has_bar(&window), has, "{label}");
    }
}

#[test]
fn opened_legends_scroll_by_keys() {
    const SCROLLED: &str = "Legends; Page Up and Page Down scroll them";
    let mut window = window_of(260.0, 300.0);
    assert!(window.query_by_label(SCROLLED).is_none(), "closed");
    window.get_by_label_contains("more legend").focus();
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(4);
    let first = window.get_by_label("Obstacle").rect().top();
    let top = |window: &Harness<'_, Rig>| window.get_by_label("Obstacle").rect().top();
    // Keys scroll while the button has the focus.
    window.key_press(Key::PageDown);
    window.run_steps(4);
    let second = top(&window);
    assert!(second < first - 40.0, "{second} {first}");
    window.key_press(Key::PageUp);
    window.run_steps(4);
    assert!((top(&window) - first).abs() < 1.0);
    window.get_by_label(SCROLLED).focus();
    window.run_steps(2);
    window.key_press(Key::PageDown);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0);
    window.key_press(Key::ArrowUp);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0, "arrows drive");
    window.ctx.memory_mut(|memory| {
        if let Some(focused) = memory.focused() {
            memory.surrender_focus(focused);
        }
    });
    window.run_steps(2);
    window.key_press(Key::PageUp);
    window.run_steps(4);
    assert!((top(&window) - second).abs() < 1.0);
    let mut roomy = window_of(500.0, 800.0);
    if let Some(button) = roomy.query_by_label_contains("more legend") {
        button.click();
    }
    roomy.run_steps(4);
    assert!(roomy.query_by_label(SCROLLED).is_none());
}

/// Whether legends or their button overlap buttons or compass.
fn lie_on_others(window: &Harness<'_, Rig>) -> bool {
    let view = &window.state().view;
    let legends = view.legends.place.unwrap();
    let compass = window.get_by_label("Compass: y up").rect();
    assert!(view.place().contains_rect(legends), "{legends}");
    legends.intersects(compass) || legends.intersects(view.cards.buttons)
}

#[test]
fn legends_do_not_cover_compass_or_buttons() {
    // Among others, the map in a window of 640 × 480 points at 120 %, with and without the driving panel.
    for (width, height, is_button_alone) in [
        (211.0, 168.0, true),
        (250.0, 168.0, true),
        (211.0, 134.0, true),
        (180.0, 120.0, true),
        (211.0, 300.0, false),
    ] {
        for uppermost in [LayerId::Shore, LayerId::Cost] {
            let size = format!("{width} × {height}, {uppermost}");
            let mut window = window_of(width + AROUND, height + AROUND);
            crate::theme::set(&window.ctx);
            if uppermost == LayerId::Cost {
                let stack = &mut window.state_mut().view.settings.stack;
                stack.apply(LayerCommand::Above(LayerId::Cost, LayerId::Shore));
            }
            window.run_steps(4);
            let alone = window.query_by_label_contains("Legends: ").is_some();
            assert_eq!(alone, is_button_alone, "{size}");
            assert!(!lie_on_others(&window), "{size}");
            window.get_by_label_contains("egends: ").click();
            window.run_steps(4);
            assert!(!lie_on_others(&window), "{size}, opened");
        }
    }
}

#[test]
fn a_long_title_is_below_the_button() {
    let mut window = window_of(211.0 + AROUND, 300.0 + AROUND);
    crate::theme::set(&window.ctx);
    let stack = &mut window.state_mut().view.settings.stack;
    stack.apply(LayerCommand::Above(LayerId::Cost, LayerId::Shore));
    window.run_steps(4);
    let title = window.get_by_label("Slope cost").rect();
    let button = window.get_by_label_contains("more legends: ").rect();
    assert!(title.height() < 20.0, "one line: {title}");
    assert!(title.top() >= button.bottom(), "{title} {button}");
}
