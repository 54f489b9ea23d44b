use eframe::egui::{Color32, Rect, Shape, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use protocol::keys::Topic;
use protocol::message::{Info, LayerInfo, ShoreCluster, Shores, ShoresReply};

use super::*;
use crate::command::Look;
use crate::model::{RequestId, ShoreOutlines};
use crate::teleop_client::Lease;
use crate::test_support::{
    at, docking_site, idle_teleop_client, inject, inject_reply, scout, shore,
};

fn cluster(number: u32, voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        voxels,
        rigid_voxels: voxels / 4,
        ..shore(number, center_m)
    }
}

/// B.
fn site() -> DockingSite {
    DockingSite {
        number: 2,
        width_m: 4.0,
        ..docking_site([8.0, 0.0])
    }
}

/// The best docking site is B, the second A.
fn data() -> ShoresData {
    let clusters = vec![cluster(1, 40, [30.0, 0.0]), cluster(2, 900, [8.0, 6.0])];
    let shores = Shores::gather(0.3, None, clusters, vec![site()]);
    let vehicle_m = Some([0.0, 0.0]);
    let known = ShoreOutlines::of(&shores);
    let rows = shores.clusters.iter().zip(known.outlines());
    let best = ShoreRow {
        reason: Some(reason(&site(), Some(1.6), known.neighbours()[0])),
        ..site_row(&site(), 1, vehicle_m)
    };
    let wider = DockingSite {
        number: 1,
        center_m: [0.0, 20.0],
        width_m: 9.0,
        ..site()
    };
    let wider = site_row(&wider, 2, vehicle_m);
    ShoresData {
        shores: rows.map(|shore| shore_row(shore, vehicle_m)).collect(),
        sites: vec![best, wider],
        notes: Vec::new(),
        marked: None,
        hovered: None,
    }
}

#[test]
fn lists_are_sorted_by_the_chosen_column() {
    let mut rows = data().shores;
    let mut order = |by| {
        sort(&mut rows, by);
        rows.iter().map(|row| row.mark).collect::<Vec<_>>()
    };
    let (one, two) = (ShoreMark::Shore(1), ShoreMark::Shore(2));
    assert_eq!(order(SortBy::Distance), [two, one]);
    assert_eq!(order(SortBy::Number), [one, two]);
    assert_eq!(order(SortBy::Size), [two, one]);
    assert_eq!(order(SortBy::Share), [one, two], "the same share");
}

#[test]
fn docking_sites_have_a_reason() {
    assert_eq!(
        data().sites[0].reason.as_deref(),
        Some("2.5 × beam; 6 m to shore 2, dense")
    );
    // The middle of the site is within the curved outline.
    let mut bay = cluster(4, 40, [30.0, 0.0]);
    bay.outline = vec![(0, -9), (100, -9), (100, 9), (0, 9)];
    let shores = Shores::gather(0.3, None, vec![bay], vec![site()]);
    let known = ShoreOutlines::of(&shores);
    let reason = reason(&site(), None, known.neighbours()[0]);
    assert_eq!(reason, "shore 4, dense, around it");
}

#[test]
fn reasons_follow_the_newest_report() {
    let mut model = scout();
    let tells_beam = |model: &mut ConsoleModel, beam_m| {
        let layer = LayerInfo {
            layer: LayerId::Shore,
            cell_m: 0.3,
        };
        let info = Info {
            footprint_m: [3.0, beam_m],
            layers: vec![layer],
            ..Info::default()
        };
        inject_reply(model, RequestId(900), Topic::Info, &info, at(0));
    };
    // The revision is the number of the only shore.
    let report_shores = |model: &mut ConsoleModel, number: u32, center_m| {
        let clusters = vec![cluster(number, 40, center_m)];
        let news = ShoresReply {
            revision: number.into(),
            shores: Some(Shores::gather(0.3, None, clusters, vec![site()])),
        };
        inject(model, Topic::Shores, &news, at(0));
    };
    let reason = |model: &ConsoleModel| {
        let data = ShoresData::new(model, &MapView::default()).unwrap();
        data.sites[0].reason.clone().unwrap()
    };
    tells_beam(&mut model, 1.6);
    report_shores(&mut model, 1, [8.0, 6.0]);
    assert_eq!(reason(&model), "2.5 × beam; 6 m to shore 1, dense");
    report_shores(&mut model, 2, [8.0, 9.0]);
    assert_eq!(reason(&model), "2.5 × beam; 9 m to shore 2, dense");
    tells_beam(&mut model, 2.0);
    assert_eq!(reason(&model), "2.0 × beam; 9 m to shore 2, dense");
}

#[test]
fn rows_react_to_hover_and_click() {
    let mut window = Harness::builder()
        .with_size(vec2(290.0, 300.0))
        .build_ui_state(
            |ui, (data, asked): &mut (ShoresData, Vec<Look>)| asked.extend(shores_ui(ui, data)),
            (data(), Vec::new()),
        );
    let row = window.get_by_label_contains("Shore 2, dense").rect();
    window.hover_at(row.center());
    window.run_steps(2);
    let mark = ShoreMark::Shore(2);
    let asked = std::mem::take(&mut window.state_mut().1);
    assert_eq!(asked.last(), Some(&Look::Hover(Some(mark))));
    // The hover is requested once.
    window.state_mut().0.hovered = Some(mark);
    window.run_steps(2);
    assert_eq!(window.state().1, []);
    window.remove_cursor();
    window.run_steps(2);
    assert_eq!(window.state().1.last(), Some(&Look::Hover(None)));
    window.state_mut().0.hovered = None;
    window.get_by_label_contains("Docking site B").click();
    window.run_steps(2);
    let shown = Look::Mark(ShoreMark::Site(2), [8.0, 0.0]);
    assert!(window.state().1.contains(&shown));
    window.get_by_label("Sort shores by no.").click();
    window.run_steps(2);
    let first = window.get_by_label_contains("Shore 1, dense").rect();
    let second = window.get_by_label_contains("Shore 2, dense").rect();
    assert!(first.top() < second.top());
}

#[test]
fn headings_explain_names_and_order() {
    let mut window = Harness::builder()
        .with_size(vec2(290.0, 300.0))
        .build_ui_state(|ui, data| _ = shores_ui(ui, data), data());
    let top = |window: &Harness<'_, ShoresData>, label| window.get_by_label(label).rect().top();
    let (best, wider) = (
        "Docking site B, gentle slope, price 0.20, 4.0 m wide, 8.0 m away",
        "Docking site A, gentle slope, price 0.20, 9.0 m wide, 20 m away",
    );
    let heading = top(
        &window,
        "Docking sites, called by letter, the least price first by steps of 0.05, then the widest",
    );
    assert!(top(&window, "Shores, called by number, the nearest first") < heading);
    assert!(heading < top(&window, best));
    assert!(top(&window, best) < top(&window, wider), "by rank");
    window.get_by_label("Sort docking sites by width").click();
    window.run_steps(2);
    assert!(top(&window, wider) < top(&window, best));
    assert!(
        window
            .query_by_label("Docking sites, called by letter")
            .is_some()
    );
    window.get_by_label("Sort docking sites by rank").click();
    window.run_steps(2);
    assert!(top(&window, best) < top(&window, wider));
}

#[test]
fn docs_explain_changing_numbers() {
    const NUMBERS: &str = "Numbers change while the robot learns: a merged cluster keeps the number of its larger part, \
                           a separated part gets a new number, and no number is used twice.";
    let handbook = include_str!("../../../../docs/console.md");
    let handbook = handbook.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(handbook.contains(NUMBERS));
    let data = data();
    let mut window = Harness::builder()
        .with_size(vec2(700.0, 500.0))
        .build_ui(move |ui| {
            ui.set_max_width(240.0);
            _ = shores_ui(ui, &data);
        });
    window.run_steps(2);
    let heading = window.get_by_label_contains("Shores, called by number");
    let place = heading.rect().center();
    window.hover_at(place);
    window.run_steps(60);
    window.get_by_label_contains(NUMBERS);
}

fn outlines(center_m: [f32; 2], outline: &[(i32, i32)]) -> ShoreOutlines {
    let shore = ShoreCluster {
        outline: outline.to_vec(),
        ..shore(1, center_m)
    };
    ShoreOutlines::of(&Shores::gather(0.5, None, vec![shore], Vec::new()))
}

#[test]
fn distance_to_the_nearest_edge() {
    let reeds = outlines([9.0, 2.0], &[(10, 0), (26, 0), (26, 8), (10, 8)]);
    let outline = &reeds.outlines()[0];
    for (vehicle_m, expected) in [
        ([4.0, 2.0], Distance::Metres(1.0)),
        ([15.0, 3.9], Distance::Metres(2.0)),
        ([9.0, 6.5], Distance::Metres(2.5)),
        ([2.0, -4.0], Distance::Metres(5.0)),
        ([9.0, 2.0], Distance::Around),
        ([5.1, 0.1], Distance::Around),
    ] {
        let found = Distance::of_shore(outline, Some(vehicle_m));
        assert_eq!(found, expected, "{vehicle_m:?}");
    }
    assert_eq!(Distance::of_shore(outline, None), Distance::Unknown);
}

#[test]
fn a_shore_without_outline_uses_its_middle() {
    let point = outlines([3.0, 4.0], &[]);
    assert_eq!(
        Distance::of_shore(&point.outlines()[0], Some([0.0, 0.0])),
        Distance::Metres(5.0)
    );
}

#[test]
fn distance_texts() {
    let check = |away: Distance, column: &str, words: &str| {
        assert_eq!((&*away.column(), &*away.words()), (column, words));
    };
    check(Distance::Metres(9.94), "9.9 m", "9.9 m away");
    check(Distance::Metres(9.96), "10 m", "10 m away");
    check(Distance::Around, "around", "around the vehicle");
    check(Distance::Unknown, "–", "distance unknown");
}

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

fn place(window: &Harness<'_, Rig>, number: u32) -> Rect {
    let rows = &window.state().data.shores;
    let row = rows.iter().find(|row| row.mark == ShoreMark::Shore(number));
    window.get_by_label(&row.unwrap().sentence).rect()
}

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

#[test]
fn who_drives_can_choose_marked_vegetation_and_end_it() {
    let mut model = scout();
    let reeds = DockingSite {
        vegetation: Some(ShoreClass::Dense),
        price: 1.5,
        ..site()
    };
    let slope = DockingSite {
        number: 3,
        ..site()
    };
    let news = ShoresReply {
        revision: 1,
        shores: Some(Shores::gather(0.3, None, Vec::new(), vec![reeds, slope])),
    };
    inject(&mut model, Topic::Shores, &news, at(0));
    let choice = DockingChoice {
        site: 2,
        vegetation: ShoreClass::Dense,
    };
    let mut client = idle_teleop_client();
    let offer = |marked: u32, client: &TeleopClientState| {
        let mut view = MapView::default();
        view.look(Look::Mark(ShoreMark::Site(marked), [0.0; 2]));
        DockingOffer::new(&model, &view, Some(client))
    };
    assert_eq!(offer(2, &client), None, "without the lease");
    client.lease = Lease::Held(1);
    assert_eq!(offer(3, &client), None, "a slope needs no choice");
    let clicked = |label: &str, offer: Option<DockingOffer>| {
        let mut window = Harness::builder().build_ui_state(
            |ui, (offer, asked): &mut (DockingOffer, Vec<Intent>)| {
                asked.extend(docking_ui(ui, *offer));
            },
            (offer.unwrap(), Vec::new()),
        );
        window.get_by_label(label).click();
        window.run_steps(2);
        std::mem::take(&mut window.state_mut().1)
    };
    let asked = clicked("Dock at B, dense", offer(2, &client));
    assert_eq!(asked, [Intent::Dock(Some(choice))]);
    client.docking = Some(choice);
    let asked = clicked("End docking at B", offer(3, &client));
    assert_eq!(asked, [Intent::Dock(None)]);
}
