//! Rows below the pointer: they stay where they are, and the one that was clicked stays marked.

use eframe::egui::Color32;

use super::*;

/// A window with the panel, or without it.
struct Rig {
    data: ShoresData,
    is_shown: bool,
    /// What is chosen is filled with it.
    chosen: Color32,
}

/// Shores of these numbers, each three times as many metres along x, from a vehicle at `x_m`.
fn shores(numbers: &[u8], x_m: f64) -> ShoresData {
    let shore = |number: &u8| cluster((*number).into(), 40, [3.0 * f32::from(*number), 0.0]);
    let shores = Shores::gather(0.3, None, numbers.iter().map(shore).collect(), Vec::new());
    let known = ShoreOutlines::of(&shores);
    let rows = shores.clusters.iter().zip(known.outlines());
    let rows = rows.map(|shore| shore_row(shore, Some([x_m, 0.0])));
    ShoresData {
        shores: rows.collect(),
        ..data()
    }
}

fn window(data: ShoresData) -> Harness<'static, Rig> {
    let rig = Rig {
        data,
        is_shown: true,
        chosen: Color32::TRANSPARENT,
    };
    let mut window = Harness::builder()
        .with_size(vec2(290.0, 400.0))
        .build_ui_state(
            |ui, rig: &mut Rig| {
                rig.chosen = ui.visuals().selection.bg_fill;
                if rig.is_shown {
                    _ = shores_ui(ui, &rig.data);
                }
            },
            rig,
        );
    window.run_steps(2);
    window
}

/// The robot tells of other shores, or is elsewhere.
fn hears(window: &mut Harness<'_, Rig>, data: ShoresData) {
    window.state_mut().data = data;
    window.run_steps(2);
}

/// Where the row of a shore is; what it says is what is known now.
fn place(window: &Harness<'_, Rig>, number: u32) -> Rect {
    let rows = &window.state().data.shores;
    let row = rows.iter().find(|row| row.mark == ShoreMark::Shore(number));
    window.get_by_label(&row.unwrap().sentence).rect()
}

/// Numbers of the shores, from above.
fn order(window: &Harness<'_, Rig>) -> Vec<u32> {
    let rows = window.state().data.shores.iter();
    let numbers = rows.filter_map(|row| match row.mark {
        ShoreMark::Shore(number) => Some(number),
        ShoreMark::Site(_) => None,
    });
    let mut numbers: Vec<_> = numbers.collect();
    numbers.sort_by(|a, b| {
        let [a, b] = [a, b].map(|number| place(window, *number).top());
        a.total_cmp(&b)
    });
    numbers
}

#[test]
fn rows_keep_their_order_while_the_pointer_is_among_them() {
    let mut window = window(shores(&[1, 2, 3], 0.0));
    assert_eq!(order(&window), [1, 2, 3]);
    let row = place(&window, 2);
    window.hover_at(row.center());
    // The pointer comes with the pose that would sort them anew: 3 is the nearest now.
    hears(&mut window, shores(&[1, 2, 3], 10.0));
    assert_eq!(order(&window), [1, 2, 3]);
    assert!((place(&window, 2).top() - row.top()).abs() < 0.5);
    // 1 is gone. 5 and 4 are new, 5 m and 2 m away.
    hears(&mut window, shores(&[2, 3, 5, 4], 10.0));
    assert_eq!(order(&window), [2, 3, 4, 5]);
    window.remove_cursor();
    window.run_steps(3);
    assert_eq!(order(&window), [3, 4, 2, 5]);
}

#[test]
fn a_column_that_is_chosen_by_keys_sorts_below_the_pointer() {
    let mut window = window(shores(&[1, 2, 3], 10.0));
    assert_eq!(order(&window), [3, 2, 1]);
    let middle = place(&window, 2).center();
    window.hover_at(middle);
    window.run_steps(2);
    window.get_by_label("Sort shores by no.").click_accesskit();
    window.run_steps(2);
    assert_eq!(order(&window), [1, 2, 3]);
}

#[test]
fn a_list_that_was_hidden_begins_anew_below_the_pointer() {
    let mut window = window(shores(&[1, 2, 3], 0.0));
    let middle = place(&window, 2).center();
    window.hover_at(middle);
    window.run_steps(2);
    window.state_mut().is_shown = false;
    hears(&mut window, shores(&[1, 2, 3], 10.0));
    window.state_mut().is_shown = true;
    window.run_steps(2);
    assert_eq!(order(&window), [3, 2, 1]);
}

/// Rows that look as what is chosen does.
fn chosen(window: &Harness<'_, Rig>) -> Vec<Rect> {
    let fill = window.state().chosen;
    let shapes = window.output().shapes.iter();
    let places = shapes.filter_map(|clipped| {
        if let Shape::Rect(shape) = &clipped.shape {
            (shape.fill == fill).then_some(shape.rect)
        } else {
            None
        }
    });
    places.collect()
}

#[test]
fn the_row_that_was_clicked_stays_marked_wherever_the_pointer_and_the_row_are() {
    let one = Some(ShoreMark::Shore(1));
    let marked = |x_m, hovered| ShoresData {
        marked: one,
        hovered,
        ..shores(&[1, 2, 3], x_m)
    };
    let mut window = window(marked(0.0, None));
    let middle = place(&window, 2).center();
    window.hover_at(middle);
    hears(&mut window, marked(0.0, Some(ShoreMark::Shore(2))));
    window.remove_cursor();
    for x_m in [0.0, 10.0] {
        hears(&mut window, marked(x_m, None));
        window.run_steps(2);
        let rows = chosen(&window);
        let [row] = rows[..] else {
            panic!("{rows:?}");
        };
        let expected = place(&window, 1);
        assert!(row.center().distance(expected.center()) < 1.0, "{row}");
    }
    assert_eq!(order(&window), [3, 2, 1]);
}

#[test]
fn what_is_marked_is_what_a_click_showed_and_not_what_the_hand_is_over() {
    let mut model = scout();
    let layer = LayerInfo {
        layer: LayerId::Shore,
        cell_m: 0.3,
    };
    let info = Info {
        layers: vec![layer],
        ..Info::default()
    };
    inject_reply(&mut model, RequestId(900), Topic::Info, &info, at(0));
    let clusters = vec![cluster(1, 40, [3.0, 0.0]), cluster(2, 40, [6.0, 0.0])];
    let news = ShoresReply {
        revision: 1,
        shores: Some(Shores::gather(0.3, None, clusters, Vec::new())),
    };
    inject(&mut model, Topic::Shores, &news, at(0));
    let [one, two] = [1, 2].map(ShoreMark::Shore);
    let mut view = MapView::default();
    let marks = |view: &MapView| {
        let data = ShoresData::new(&model, view).unwrap();
        (data.marked, data.hovered)
    };
    view.look(Look::Hover(Some(one)));
    assert_eq!(marks(&view), (None, Some(one)));
    view.look(Look::Mark(one, [3.0, 0.0]));
    view.look(Look::Hover(Some(two)));
    assert_eq!(marks(&view), (Some(one), Some(two)));
    view.look(Look::Hover(None));
    assert_eq!(marks(&view), (Some(one), None));
    view.look(Look::Mark(two, [6.0, 0.0]));
    assert_eq!(marks(&view), (Some(two), None));
    view.forget();
    assert_eq!(marks(&view), (None, None));
}
