use std::time::Duration;

use eframe::egui::{Pos2, pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use protocol::keys::Topic;
use protocol::message::{Info, LayerInfo};

use super::*;
use crate::map_view::LayerStack;
use crate::model::RequestId;
use crate::test_support::{at, console, inject_reply};

fn row(layer: LayerId, over: Option<LayerId>, under: Option<LayerId>) -> LayerRow {
    LayerRow {
        layer,
        is_shown: true,
        opacity: 0.5,
        scheme: layer.schemes()[0],
        state: "12 tiles, synchronized".to_owned(),
        tone: Tone::Good,
        over,
        under,
    }
}

struct Window {
    data: LayersData,
    asked: Vec<LayerCommand>,
}

fn window() -> Harness<'static, Window> {
    let (top, low) = (LayerId::Obstacle, LayerId::Elevation);
    window_of(vec![row(top, None, Some(low)), row(low, Some(top), None)])
}

fn window_of(rows: Vec<LayerRow>) -> Harness<'static, Window> {
    let data = LayersData { rows, note: None };
    Harness::builder()
        .with_size(vec2(290.0, 300.0))
        .build_ui_state(
            |ui, window: &mut Window| {
                let asked = layers_ui(ui, &window.data);
                window.asked.extend(asked);
            },
            Window {
                data,
                asked: Vec::new(),
            },
        )
}

#[test]
fn controls_have_names_and_requests() {
    for (label, asked) in [
        ("Elevation", LayerCommand::Show(LayerId::Elevation, false)),
        ("Only Elevation", LayerCommand::Only(LayerId::Elevation)),
        (
            "Raise Elevation",
            LayerCommand::Above(LayerId::Elevation, LayerId::Obstacle),
        ),
        (
            "Lower Obstacles",
            LayerCommand::Below(LayerId::Obstacle, LayerId::Elevation),
        ),
        ("Fit", LayerCommand::Fit(LayerId::Elevation)),
    ] {
        let mut window = window();
        window.get_by_label(label).click();
        window.run_steps(2);
        assert_eq!(window.state().asked, [asked], "{label}");
    }
    let mut window = window();
    for label in ["Raise Obstacles", "Lower Elevation"] {
        window.get_by_label(label).click();
        window.run_steps(2);
    }
    assert_eq!(window.state().asked, [], "there is nothing beyond");
    window.get_by_label("Opacity of Obstacles");
    window
        .get_by_label("Colours of Obstacles: Colour-blind safe")
        .click();
    window.run_steps(3);
    window.get_by_label("Green and red").click();
    window.run_steps(2);
    let scheme = LayerCommand::Scheme(LayerId::Obstacle, Scheme::GreenRed);
    assert_eq!(window.state().asked, [scheme]);
}

#[test]
fn a_layer_is_dragged_under_another() {
    let mut window = window();
    window.run_steps(2);
    let grip = |window: &Harness<'_, Window>, name: &str| {
        window.get_by_label(&format!("Drag {name}")).rect().center()
    };
    let [top, low] = ["Obstacles", "Elevation"].map(|name| grip(&window, name));
    let drag = |window: &mut Harness<'static, Window>, from: Pos2, to: Pos2| {
        window.drag_at(from);
        window.run_steps(1);
        for part in [0.3, 0.7, 1.0] {
            window.hover_at(from.lerp(to, part));
            window.run_steps(1);
        }
        window.drop_at(to);
        window.run_steps(2);
        std::mem::take(&mut window.state_mut().asked)
    };
    let below = low + vec2(0.0, 60.0);
    let under = LayerCommand::Below(LayerId::Obstacle, LayerId::Elevation);
    assert_eq!(drag(&mut window, top, below), [under]);
    let above = top - vec2(0.0, 8.0);
    let over = LayerCommand::Above(LayerId::Elevation, LayerId::Obstacle);
    assert_eq!(drag(&mut window, low, above), [over]);
    assert_eq!(drag(&mut window, low, below), [], "it is there already");
    let elsewhere = pos2(low.x, -20.0);
    assert_eq!(drag(&mut window, low, elsewhere), [], "not in the list");
}

#[test]
fn hidden_layers_are_not_received() {
    let mut model = console("scout", &LayerId::ALL);
    let layers = vec![LayerInfo {
        layer: LayerId::Cost,
        cell_m: 0.1,
    }];
    let info = Info {
        layers,
        ..Info::default()
    };
    inject_reply(&mut model, RequestId(1), Topic::Info, &info, at(1_000));
    let mut view = MapView::default();
    view.apply(LayerCommand::Show(LayerId::Cost, false), &model);
    for (recording, text) in [
        (None, "hidden, not received"),
        (Some("rooms.mcap"), "hidden"),
    ] {
        let link = LinkStatus {
            recording: recording.map(str::to_owned),
            ..LinkStatus::default()
        };
        let data = LayersData::new(&model, &link, &view, at(1_100));
        let [row] = &data.rows[..] else {
            panic!("{data:?}");
        };
        assert_eq!((row.state.as_str(), row.is_shown), (text, false));
    }
}

#[test]
fn layer_state_shows_missing_tiles() {
    let now = Monotonic::from_nanos(20_000_000_000);
    let step = |is_equal, missing| LayerSyncState {
        layer: LayerId::Cost,
        is_equal,
        last_equal: Some(Monotonic::from_nanos(5_000_000_000)),
        missing,
    };
    let check = |step, tiles, expected: (Tone, &str)| {
        let (tone, state) = state_of(step, tiles, false, now);
        assert_eq!((tone, state.as_str()), expected);
    };
    check(None, 0, (Tone::Waiting, "nothing mapped yet"));
    check(
        Some(step(true, 0)),
        24_649,
        (Tone::Good, "24\u{a0}649 tiles, synchronized"),
    );
    check(
        Some(step(true, 0)),
        0,
        (Tone::Good, "nothing mapped yet, synchronized"),
    );
    check(
        Some(step(false, 12)),
        9,
        (Tone::Waiting, "9 tiles, 12 missing for 15 s"),
    );
    check(
        Some(step(false, 0)),
        9,
        (Tone::Waiting, "9 tiles, not synchronized for 15 s"),
    );
    let lately = |missing| LayerSyncState {
        last_equal: Some(Monotonic::from_nanos(17_000_000_000)),
        ..step(false, missing)
    };
    let in_step = (Tone::Good, "9 tiles, synchronized 3.0 s ago");
    check(Some(lately(0)), 9, in_step);
    let behind = (Tone::Waiting, "9 tiles, 2 missing for 3.0 s");
    check(Some(lately(2)), 9, behind);
    assert_eq!(age(Duration::from_secs(15)), "15 s");
}

#[test]
fn layers_of_a_recording_are_drawn_not_fetched() {
    let text = |missing, is_recording| {
        let step = LayerSyncState {
            layer: LayerId::Occupancy,
            is_equal: false,
            last_equal: Some(at(1_000)),
            missing,
        };
        let reported = state_of(Some(step), 12, is_recording, at(10_000));
        assert_eq!(reported.0, Tone::Waiting);
        reported.1
    };
    assert_eq!(text(0, false), "12 tiles, not synchronized for 9.0 s");
    assert_eq!(text(3, false), "12 tiles, 3 missing for 9.0 s");
    assert_eq!(text(0, true), "12 tiles, being drawn");
    assert_eq!(text(3, true), "12 tiles, 3 to come");
}

#[test]
fn a_dropped_layer_moves_into_the_gap() {
    let stack = LayerStack::default();
    let rows = |stack: &LayerStack| -> Vec<LayerId> {
        let layers = stack.layers().iter().rev();
        layers.map(|held| held.layer).collect()
    };
    let before = rows(&stack);
    for from in 0..before.len() {
        for gap in 0..=before.len() {
            let mut expected = before.clone();
            let layer = expected.remove(from);
            expected.insert(if gap > from { gap - 1 } else { gap }, layer);
            let mut stack = stack.clone();
            if let Some(command) = moved(layer, &before, gap) {
                stack.apply(command);
            }
            assert_eq!(rows(&stack), expected, "from {from} to {gap}");
        }
    }
    assert_eq!(moved(LayerId::Cost, &[LayerId::Shore], 0), None);
}
