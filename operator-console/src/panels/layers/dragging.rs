//! Layers are dragged to another place in their list.

use eframe::egui::accesskit::Role;
use eframe::egui::{DragAndDrop, Rect, Sense, Stroke, Ui, WidgetInfo, pos2, vec2};
use protocol::layer::LayerId;

use crate::map_view::LayerCommand;

const GRIP: [f32; 2] = [12.0, 22.0];
/// Nearer than this to an edge of what can be seen of the list, points, it is scrolled.
const EDGE: f32 = 24.0;
/// How fast, points per second.
const SCROLLING: f32 = 300.0;

/// The line that shows the place is so far from the row beside it, points.
const BESIDE: f32 = 3.0;

/// What is dragged: nothing else in the window is taken for a layer.
struct Dragged(LayerId);

/// Draws what a layer is dragged by. Not for the keyboard, which has buttons that do the same.
pub(super) fn grip_ui(ui: &mut Ui, layer: LayerId, name: &str) {
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

/// Draws where the layer that is dragged would be, and says so when it is let go there. `places`: those of the rows, the
/// uppermost first.
pub(super) fn drop_ui(ui: &Ui, places: &[(LayerId, Rect)]) -> Option<LayerCommand> {
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

/// What lies beyond an edge comes into sight.
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

/// A layer comes into the gap before the row of this number, of rows that show these layers, the uppermost first.
/// `None` where that is where it is.
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
    use super::*;
    use crate::map_view::LayerStack;

    #[test]
    fn it_comes_into_the_gap_where_it_is_let_go() {
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
