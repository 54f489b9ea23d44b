//! Rows under the pointer keep their positions, and a selected row stays marked.

use eframe::egui::Color32;

use super::*;

/// A window with or without the panel.
struct Rig {
    data: ShoresData,
    is_shown: bool,
    /// Fill colour of selected rows.
    chosen: Color32,
}

/// Shores with these numbers, each at three times as many metres along x, with the vehicle at `x_m`.
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

/// New shores or another vehicle position.
fn receive_shores(window: &mut Harness<'_, Rig>, data: ShoresData) {
    window.state_mut().data = data;
    window.run_steps(2);
}

/// Position of a row.
fn place(window: &Harness<'_, Rig>, number: u32) -> Rect {
    let rows = &window.state().data.shores;
    let row = rows.iter().find(|row| row.mark == ShoreMark::Shore(number));
    window.get_by_label(&row.unwrap().sentence).rect()
}

/// Numbers from the top.
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
fn rows_keep_their_order_under_the_pointer() {
    let mut window = window(shores(&[1, 2, 3], 0.0));
    assert_eq!(order(&window), [1, 2, 3]);
    let row = place(&window, 2);
    window.hover_at(row.center());
    // The pointer arrives with the pose that changes the order: 3 is nearest now.
    receive_shores(&mut window, shores(&[1, 2, 3], 10.0));
    assert_eq!(order(&window), [1, 2, 3]);
    assert!((place(&window, 2).top() - row.top()).abs() < 0.5);
    // 1 is removed; 5 and 4 are new, at 5 m and 2 m.
    receive_shores(&mut window, shores(&[2, 3, 5, 4], 10.0));
    assert_eq!(order(&window), [2, 3, 4, 5]);
    window.remove_cursor();
    window.run_steps(3);
    assert_eq!(order(&window), [3, 4, 2, 5]);
}

#[test]
fn sorting_by_keys_ignores_the_pointer() {
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
fn a_hidden_list_is_sorted_again() {
    let mut window = window(shores(&[1, 2, 3], 0.0));
    let middle = place(&window, 2).center();
    window.hover_at(middle);
    window.run_steps(2);
    window.state_mut().is_shown = false;
    receive_shores(&mut window, shores(&[1, 2, 3], 10.0));
    window.state_mut().is_shown = true;
    window.run_steps(2);
    assert_eq!(order(&window), [3, 2, 1]);
}

/// Rows with the fill colour of selected rows.
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
fn a_clicked_row_stays_marked() {
    let one = Some(ShoreMark::Shore(1));
    let marked = |x_m, hovered| ShoresData {
        marked: one,
        hovered,
        ..shores(&[1, 2, 3], x_m)
    };
    let mut window = window(marked(0.0, None));
    let middle = place(&window, 2).center();
    window.hover_at(middle);
    receive_shores(&mut window, marked(0.0, Some(ShoreMark::Shore(2))));
    window.remove_cursor();
    for x_m in [0.0, 10.0] {
        receive_shores(&mut window, marked(x_m, None));
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
fn selected_and_hovered_rows_differ() {
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
