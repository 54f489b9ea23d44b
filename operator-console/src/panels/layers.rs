//! Layers in their order: visibility, opacity, colours and age.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Button, Color32, ComboBox, DragAndDrop, Rect, RichText, Sense, Shape, Slider, Stroke,
    TextStyle, Ui, WidgetInfo, pos2, vec2,
};
use measurement::time::Monotonic;
use protocol::layer::{LayerId, Scheme};

use super::connection::{LinkStatus, SYNCHRONIZED_FOR};
use super::data_age::{DataAge, StaleData};
use super::formatting::{age, count};
use crate::map_view::{LayerCommand, MapView};
use crate::model::{ConsoleModel, LayerSyncState};
use crate::theme::Tone;

/// Below this width a layer has its buttons in a second line, points.
const NARROW: f32 = 210.0;

#[derive(Clone, Debug, PartialEq)]
pub struct LayersData {
    pub rows: Vec<LayerRow>,
    pub note: Option<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct LayerRow {
    pub layer: LayerId,
    pub is_shown: bool,
    pub opacity: f32,
    pub scheme: Scheme,
    pub state: String,
    pub tone: Tone,
    pub over: Option<LayerId>,
    pub under: Option<LayerId>,
    /// Whether its labels are drawn; `None` if it has none.
    pub has_labels: Option<bool>,
}

impl LayersData {
    /// `link`: a robot or a recording.
    pub fn new(model: &ConsoleModel, link: &LinkStatus, view: &MapView, now: Monotonic) -> Self {
        let offered = model.info().map(|info| info.layers.as_slice());
        let offered = offered.unwrap_or_default();
        let is_offered = |layer| offered.iter().any(|offered| offered.layer == layer);
        let stacked = view.stack().layers().iter().rev();
        let stacked: Vec<_> = stacked.filter(|held| is_offered(held.layer)).collect();
        let stale = StaleData::new(model, now);
        let hidden = if link.recording.is_some() {
            "hidden"
        } else {
            "hidden, not received"
        };
        let neighbour = |index: Option<usize>| {
            let held = index.and_then(|index| stacked.get(index));
            held.map(|held| held.layer)
        };
        let rows = stacked.iter().enumerate().map(|(index, held)| {
            let layer = held.layer;
            let step = model.map().layer_states().find(|step| step.layer == layer);
            let (tone, mut state) = if !held.is_shown {
                (Tone::Waiting, hidden.to_owned())
            } else if let Some(stale) = &stale {
                stale_text(*stale)
            } else {
                let overviews = model.map().store().overview_places(layer);
                let tiles = view.tiles(layer).saturating_sub(overviews);
                state_of(step, tiles, link.recording.is_some(), now)
            };
            // Hidden layers are not received, so their tiles are out of date.
            if held.is_shown
                && let Some(newest) = view.newest(layer)
            {
                let age = DataAge::new(model, newest, now);
                state = format!("{state}, newest {}", age.words());
            }
            LayerRow {
                layer,
                is_shown: held.is_shown,
                opacity: held.opacity,
                scheme: held.scheme,
                state,
                tone,
                over: neighbour(index.checked_sub(1)),
                under: neighbour(Some(index + 1)),
                has_labels: (layer == LayerId::Shore).then_some(view.settings().has_labels),
            }
        });
        let rows: Vec<_> = rows.collect();
        Self {
            note: rows.is_empty().then(|| "Not described yet".to_owned()),
            rows,
        }
    }
}

fn stale_text(stale: StaleData) -> (Tone, String) {
    if stale.had_ended {
        return (Tone::Waiting, "as it was at the end of its data".to_owned());
    }
    let words = format!("as it was {} ago", age(stale.silent_for));
    (Tone::Warning, words)
}

fn state_of(
    step: Option<LayerSyncState>,
    tiles: usize,
    is_recording: bool,
    now: Monotonic,
) -> (Tone, String) {
    let extent = match tiles {
        0 => "nothing mapped yet".to_owned(),
        1 => "1 tile".to_owned(),
        _ => format!("{} tiles", count(tiles as u64)),
    };
    let Some(step) = step else {
        return (Tone::Waiting, extent);
    };
    if step.is_equal {
        return (Tone::Good, format!("{extent}, synchronized"));
    }
    let since = step.last_equal.map(|at| now.since(at));
    if let Some(since) = since.filter(|since| step.missing == 0 && *since < SYNCHRONIZED_FOR) {
        let words = format!("{extent}, synchronized {} ago", age(since));
        return (Tone::Good, words);
    }
    if is_recording {
        let comes = match step.missing {
            0 => "being drawn".to_owned(),
            missing => format!("{} to come", count(missing as u64)),
        };
        return (Tone::Waiting, format!("{extent}, {comes}"));
    }
    let lacks = match step.missing {
        0 => "not synchronized".to_owned(),
        missing => format!("{} missing", count(missing as u64)),
    };
    let since = since.map_or_else(String::new, |since| format!(" for {}", age(since)));
    (Tone::Waiting, format!("{extent}, {lacks}{since}"))
}

pub const fn layer_name(layer: LayerId) -> &'static str {
    match layer {
        LayerId::Occupancy => "Occupancy",
        LayerId::Elevation => "Elevation",
        LayerId::Obstacle => "Obstacles",
        LayerId::Cost => "Slope cost",
        LayerId::Rigidity => "Rigidity",
        LayerId::Shore => "Shore",
        LayerId::Intra => "IntraScan",
        LayerId::Inter => "InterScan",
        LayerId::Depth => "Depth",
    }
}

pub const fn scheme_name(scheme: Scheme) -> &'static str {
    match scheme {
        Scheme::Grey => "White to black",
        Scheme::MapServer => "As map_server",
        Scheme::Cividis => "Blue to yellow",
        Scheme::GroundPlane => "Ground plane ± 3 cm",
        Scheme::GroundPlane5 => "Ground plane ± 5 cm",
        Scheme::GroundPlane6 => "Ground plane ± 6 cm",
        Scheme::Magma => "Light to dark",
        Scheme::Deep => "Pale to deep blue",
        Scheme::OkabeIto => "Colour-blind safe",
        Scheme::GreenRed => "Green and red",
    }
}

pub fn layers_ui(ui: &mut Ui, data: &LayersData) -> Option<LayerCommand> {
    let mut command = None;
    let mut places = Vec::with_capacity(data.rows.len());
    for row in &data.rows {
        let shown = ui.push_id(row.layer.name(), |ui| {
            ui.spacing_mut().item_spacing.y = 2.0;
            let asked = head_ui(ui, row);
            let asked = asked.or_else(|| {
                let colors = |ui: &mut Ui| colors_ui(ui, row);
                let shown = row.is_shown.then(|| ui.horizontal_wrapped(colors));
                shown.and_then(|shown| shown.inner)
            });
            state_ui(ui, row);
            command = command.or(asked);
        });
        places.push((row.layer, shown.response.rect));
        ui.add_space(4.0);
    }
    command = command.or(drop_ui(ui, &places));
    if let Some(note) = &data.note {
        ui.label(note);
    }
    command
}

fn head_ui(ui: &mut Ui, row: &LayerRow) -> Option<LayerCommand> {
    if ui.available_width() < NARROW {
        let shown = ui.horizontal(|ui| shown_ui(ui, row)).inner;
        return shown.or(ui.horizontal(|ui| place_ui(ui, row)).inner);
    }
    ui.horizontal(|ui| {
        let shown = shown_ui(ui, row);
        shown.or(place_ui(ui, row))
    })
    .inner
}

fn shown_ui(ui: &mut Ui, row: &LayerRow) -> Option<LayerCommand> {
    let (layer, name) = (row.layer, layer_name(row.layer));
    grip_ui(ui, layer, name);
    let mut is_shown = row.is_shown;
    let check = ui.checkbox(&mut is_shown, name);
    check
        .on_hover_text("Draw this layer and receive it")
        .changed()
        .then_some(LayerCommand::Show(layer, is_shown))
}

fn place_ui(ui: &mut Ui, row: &LayerRow) -> Option<LayerCommand> {
    let (layer, name) = (row.layer, layer_name(row.layer));
    let mut command = None;
    let right = eframe::egui::Layout::right_to_left(eframe::egui::Align::Center);
    ui.with_layout(right, |ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        if let Some(under) = step_ui(ui, row.under, false, name) {
            command = Some(LayerCommand::Below(layer, under));
        }
        if let Some(over) = step_ui(ui, row.over, true, name) {
            command = Some(LayerCommand::Above(layer, over));
        }
        let only = ui.add(Button::new(RichText::new("Only").small()).frame(false));
        only.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Only {name}")));
        if only.on_hover_text("Hide all other layers").clicked() {
            command = Some(LayerCommand::Only(layer));
        }
    });
    command
}

/// A button that exchanges a layer with its neighbour. Returns the neighbour if it is clicked.
fn step_ui(ui: &mut Ui, neighbour: Option<LayerId>, is_up: bool, name: &str) -> Option<LayerId> {
    let sense = if neighbour.is_some() {
        Sense::click()
    } else {
        Sense::hover()
    };
    let (rect, response) = ui.allocate_exact_size(vec2(22.0, 22.0), sense);
    let word = if is_up { "Raise" } else { "Lower" };
    let label = format!("{word} {name}");
    response.widget_info(|| WidgetInfo::labeled(Role::Button, neighbour.is_some(), &label));
    let visuals = ui.style().interact(&response);
    let (fill, ink) = if neighbour.is_some() {
        (visuals.weak_bg_fill, visuals.text_color())
    } else {
        (
            Color32::TRANSPARENT,
            ui.visuals().gray_out(visuals.text_color()),
        )
    };
    ui.painter().rect_filled(rect.shrink(1.0), 3.0, fill);
    let towards = if is_up { -4.0 } else { 4.0 };
    let corners = [(0.0, towards), (5.0, -towards), (-5.0, -towards)]
        .map(|(x, y)| rect.center() + vec2(x, y));
    let corners = corners.to_vec();
    ui.painter()
        .add(Shape::convex_polygon(corners, ink, Stroke::NONE));
    neighbour.filter(|_| response.on_hover_text(&label).clicked())
}

fn colors_ui(ui: &mut Ui, row: &LayerRow) -> Option<LayerCommand> {
    let (layer, name) = (row.layer, layer_name(row.layer));
    let mut command = None;
    ui.spacing_mut().slider_width = 72.0;
    let mut opacity = row.opacity;
    let slider = ui.add(
        Slider::new(&mut opacity, 0.0..=1.0)
            .step_by(0.05)
            .show_value(false),
    );
    let percent = 100.0 * row.opacity;
    slider.widget_info(|| {
        WidgetInfo::slider(true, f64::from(row.opacity), format!("Opacity of {name}"))
    });
    if slider
        .on_hover_text(format!("Opacity: {percent:.0} %"))
        .changed()
    {
        command = Some(LayerCommand::Opacity(layer, opacity));
    }
    if let Some(mut has_labels) = row.has_labels {
        let check = ui.checkbox(&mut has_labels, RichText::new("Labels").small());
        let hint = "Draw the numbers of shores and the letters of docking sites";
        if check.on_hover_text(hint).changed() {
            command = Some(LayerCommand::Labels(has_labels));
        }
    }
    if let [only] = layer.schemes() {
        ui.label(RichText::new(scheme_name(*only)).small());
        return command;
    }
    let combo = ComboBox::from_id_salt("colours")
        .selected_text(RichText::new(scheme_name(row.scheme)).small())
        .width(116.0)
        .show_ui(ui, |ui| {
            for scheme in layer.schemes() {
                let is_it = *scheme == row.scheme;
                if ui.selectable_label(is_it, scheme_name(*scheme)).clicked() && !is_it {
                    command = Some(LayerCommand::Scheme(layer, *scheme));
                }
            }
        });
    let label = format!("Colours of {name}: {}", scheme_name(row.scheme));
    combo
        .response
        .widget_info(|| WidgetInfo::labeled(Role::ComboBox, true, &label));
    combo.response.on_hover_text("Colours of this layer");
    if row.scheme.is_fitted() {
        let fit = ui.button("Fit");
        if fit
            .on_hover_text("Spread the colours over the values of the map")
            .clicked()
        {
            command = Some(LayerCommand::Fit(layer));
        }
    }
    command
}

fn state_ui(ui: &mut Ui, row: &LayerRow) {
    let color = match (row.is_shown, row.tone) {
        (true, Tone::Warning) => row.tone.color(ui.visuals()),
        (true | false, Tone::Good | Tone::Waiting) | (false, Tone::Warning) => {
            ui.visuals().weak_text_color()
        }
    };
    ui.scope(|ui| {
        // Usual texts have up to two lines: nothing below moves.
        ui.set_min_height(2.0 * ui.text_style_height(&TextStyle::Small));
        ui.label(RichText::new(&row.state).small().color(color));
    });
}

const GRIP: [f32; 2] = [12.0, 22.0];
const EDGE: f32 = 24.0;
const SCROLLING: f32 = 300.0;

const BESIDE: f32 = 3.0;

struct Dragged(LayerId);

/// Drag handle; the buttons do the same for the keyboard.
fn grip_ui(ui: &mut Ui, layer: LayerId, name: &str) {
    let (rect, grip) = ui.allocate_exact_size(GRIP.into(), Sense::DRAG);
    grip.dnd_set_drag_payload(Dragged(layer));
    grip.widget_info(|| WidgetInfo::labeled(Role::Unknown, true, format!("Drag {name}")));
    let is_looked_at = grip.hovered() || grip.dragged();
    let ink = if is_looked_at {
        ui.visuals().text_color()
    } else {
        ui.visuals().weak_text_color()
    };
    for x in [-2.5, 2.5] {
        for y in [-5.0, 0.0, 5.0] {
            let dot = rect.center() + vec2(x, y);
            ui.painter().circle_filled(dot, 1.5, ink);
        }
    }
    grip.on_hover_text("Drag it over or under others");
}

/// Draws the drop marker, and returns the command when the layer is dropped. `places`: rows from the top.
fn drop_ui(ui: &Ui, places: &[(LayerId, Rect)]) -> Option<LayerCommand> {
    let dragged = DragAndDrop::payload::<Dragged>(ui.ctx())?.0;
    let pointer = ui.ctx().pointer_interact_pos()?;
    let seen = ui.clip_rect();
    if !seen.contains(pointer) {
        return None;
    }
    scroll(ui, seen, pointer.y);
    let above = places.iter().filter(|(_, at)| at.center().y < pointer.y);
    let gap = above.count();
    let layers: Vec<_> = places.iter().map(|(layer, _)| *layer).collect();
    let command = moved(dragged, &layers, gap)?;
    let y = match (gap.checked_sub(1), places.get(gap)) {
        (Some(over), Some((_, under))) => 0.5 * (places[over].1.bottom() + under.top()),
        (None, Some((_, under))) => under.top() - BESIDE,
        (Some(over), None) => places[over].1.bottom() + BESIDE,
        (None, None) => return None,
    };
    let rows = places.iter().map(|(_, at)| *at);
    let list = rows.fold(Rect::NOTHING, Rect::union);
    let ends = [pos2(list.left(), y), pos2(list.right(), y)];
    let stroke = Stroke::new(3.0, ui.visuals().selection.stroke.color);
    ui.painter().line_segment(ends, stroke);
    let is_let_go = ui.input(|input| input.pointer.any_released());
    is_let_go.then_some(command)
}

fn scroll(ui: &Ui, seen: Rect, y: f32) {
    let towards = if y < seen.top() + EDGE {
        1.0
    } else if y > seen.bottom() - EDGE {
        -1.0
    } else {
        return;
    };
    let time_s = ui.input(|input| input.stable_dt).min(0.1);
    ui.scroll_with_delta(vec2(0.0, towards * SCROLLING * time_s));
    ui.ctx().request_repaint();
}

/// Command that moves a layer to the gap before row `gap`; `None` if it is there already.
fn moved(dragged: LayerId, layers: &[LayerId], gap: usize) -> Option<LayerCommand> {
    let at = layers.iter().position(|layer| *layer == dragged)?;
    if gap == at || gap == at + 1 {
        return None;
    }
    match layers.get(gap) {
        Some(under) => Some(LayerCommand::Above(dragged, *under)),
        None => layers
            .last()
            .map(|lowest| LayerCommand::Below(dragged, *lowest)),
    }
}

#[cfg(test)]
mod tests {

    use eframe::egui::{Pos2, pos2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;
    use crate::map_view::LayerStack;

    use crate::test_support::{at, console, describe_layers};

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
            has_labels: (layer == LayerId::Shore).then_some(true),
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
    fn labels_of_shores_can_be_switched_off() {
        let mut window = window_of(vec![row(LayerId::Shore, None, None)]);
        window.get_by_label("Labels").click();
        window.run_steps(2);
        assert_eq!(window.state().asked, [LayerCommand::Labels(false)]);
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
        describe_layers(&mut model, &[LayerId::Cost], at(1_000));
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
}
