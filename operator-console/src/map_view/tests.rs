mod legends;
mod looking;

use std::time::Duration;

use eframe::egui::{Event, Key, Modifiers, pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

use super::probe::tests::{model_of, store};
use super::*;
use crate::test_support::{BOOT, announce_map, at, inject_at, pose_at_rest, push_tile};
use protocol::keys::Topic;
use protocol::tile::TileCells;
use protocol::tile_store::{LayerGrid, TileStore};

/// A store with cells of 10 cm of these layers.
pub(super) fn store_of(layers: &[LayerId]) -> TileStore {
    let mut store = TileStore::new(BOOT, 100);
    for layer in layers {
        let (layer, cell_m) = (*layer, 0.1);
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
    }
    store
}

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
    assert!(window.state().view.is_up_to_date());
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
        let mut cards = view.occluders.iter();
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
    tops.dedup();
    assert_eq!(tops.len(), 2, "below, then above: {tops:?}");
}
