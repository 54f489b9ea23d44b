mod pointer;

use eframe::egui::{Rect, Shape, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use protocol::keys::Topic;
use protocol::message::{Info, LayerInfo, ShoreClass, Shores, ShoresReply};

use super::*;
use crate::command::Look;
use crate::model::{RequestId, ShoreOutlines, SiteNames};
use crate::test_support::{at, inject, inject_reply, scout};

fn cluster(number: u32, voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        number,
        class: ShoreClass::Dense,
        voxels,
        rigid_voxels: voxels / 4,
        center_m,
        outline: Vec::new(),
    }
}

fn site() -> DockingSite {
    DockingSite {
        center_m: [8.0, 0.0],
        heading_rad: 0.0,
        width_m: 4.0,
        mean_cost: 0.2,
    }
}

/// A, B and C for sites that are far from each other.
fn names() -> Vec<SiteName> {
    let far = |x_m| DockingSite {
        center_m: [x_m, 0.0],
        ..site()
    };
    SiteNames::default().name(&[far(0.0), far(100.0), far(200.0)])
}

/// The best docking site is called B, and another one A.
fn data() -> ShoresData {
    let clusters = vec![cluster(1, 40, [30.0, 0.0]), cluster(2, 900, [8.0, 6.0])];
    let shores = Shores::gather(0.3, None, clusters, vec![site()]);
    let vehicle_m = Some([0.0, 0.0]);
    let known = ShoreOutlines::of(&shores);
    let rows = shores.clusters.iter().zip(known.outlines());
    let best = ShoreRow {
        reason: Some(reason(&site(), Some(1.6), known.neighbours()[0])),
        ..site_row(&site(), (names()[1], 1), vehicle_m)
    };
    let wider = DockingSite {
        center_m: [0.0, 20.0],
        width_m: 9.0,
        ..site()
    };
    let wider = site_row(&wider, (names()[0], 2), vehicle_m);
    ShoresData {
        shores: rows.map(|shore| shore_row(shore, vehicle_m)).collect(),
        sites: vec![best, wider],
        notes: Vec::new(),
        marked: None,
        hovered: None,
    }
}

#[test]
fn lists_are_sorted_by_what_is_asked_for() {
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
fn a_docking_site_says_why_it_fits() {
    assert_eq!(
        data().sites[0].reason.as_deref(),
        Some("2.5 × beam; 6 m to shore 2, dense")
    );
    // The middle of the site is within the outline of what bends around it.
    let mut bay = cluster(4, 40, [30.0, 0.0]);
    bay.outline = vec![(0, -9), (100, -9), (100, 9), (0, 9)];
    let shores = Shores::gather(0.3, None, vec![bay], vec![site()]);
    let known = ShoreOutlines::of(&shores);
    let reason = reason(&site(), None, known.neighbours()[0]);
    assert_eq!(reason, "shore 4, dense, around it");
}

#[test]
fn reasons_are_of_the_newest_report_and_of_the_vehicle_as_it_is() {
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
    let tells_of = |model: &mut ConsoleModel, number: u32, center_m| {
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
    tells_of(&mut model, 1, [8.0, 6.0]);
    assert_eq!(reason(&model), "2.5 × beam; 6 m to shore 1, dense");
    tells_of(&mut model, 2, [8.0, 9.0]);
    assert_eq!(reason(&model), "2.5 × beam; 9 m to shore 2, dense");
    tells_beam(&mut model, 2.0);
    assert_eq!(reason(&model), "2.0 × beam; 9 m to shore 2, dense");
}

#[test]
fn the_title_says_from_where_to_where_a_distance_is() {
    let mut window = panel(240.0);
    for (list, end) in [
        ("shores", "the nearest edge of the shore's outline"),
        ("docking sites", "the middle of the docking site"),
    ] {
        let title = format!("Sort {list} by away");
        let place = window.get_by_label(&title).rect().center();
        window.hover_at(place);
        window.run_steps(60);
        let words = format!("from the middle of the vehicle to {end}");
        window.get_by_label_contains(&words);
    }
}

#[test]
fn a_row_marks_on_hover_and_shows_on_click() {
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
    // Who obeys hears no more of it.
    window.state_mut().0.hovered = Some(mark);
    window.run_steps(2);
    assert_eq!(window.state().1, []);
    window.remove_cursor();
    window.run_steps(2);
    assert_eq!(window.state().1.last(), Some(&Look::Hover(None)));
    window.state_mut().0.hovered = None;
    window.get_by_label_contains("Docking site B").click();
    window.run_steps(2);
    let shown = Look::Mark(ShoreMark::Site(names()[1]), [8.0, 0.0]);
    assert!(window.state().1.contains(&shown));
    window.get_by_label("Sort shores by no.").click();
    window.run_steps(2);
    let first = window.get_by_label_contains("Shore 1, dense").rect();
    let second = window.get_by_label_contains("Shore 2, dense").rect();
    assert!(first.top() < second.top());
}

#[test]
fn headings_say_what_numbers_and_letters_are_and_which_is_the_first() {
    let mut window = Harness::builder()
        .with_size(vec2(290.0, 300.0))
        .build_ui_state(|ui, data| _ = shores_ui(ui, data), data());
    let top = |window: &Harness<'_, ShoresData>, label| window.get_by_label(label).rect().top();
    let (best, wider) = (
        "Docking site B, cost 0.20, 4.0 m wide, 8.0 m away",
        "Docking site A, cost 0.20, 9.0 m wide, 20 m away",
    );
    let heading = top(
        &window,
        "Docking sites, called by letter, the gentlest first by steps of 0.05, then the widest",
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

/// A panel of this width on the left of a window, and no more of it.
fn panel(width: f32) -> Harness<'static> {
    panel_of(width, data())
}

fn panel_of(width: f32, data: ShoresData) -> Harness<'static> {
    let mut window = Harness::builder()
        .with_size(vec2(width + 460.0, 500.0))
        .build_ui(move |ui| {
            ui.set_max_width(width);
            _ = shores_ui(ui, &data);
        });
    window.run_steps(2);
    window
}

/// As many shores, 3 m from each other.
fn data_of(count: u8) -> ShoresData {
    let shore = |number: u8| cluster(number.into(), 40, [3.0 * f32::from(number), 0.0]);
    let shores = Shores::gather(0.3, None, (1..=count).map(shore).collect(), Vec::new());
    let known = ShoreOutlines::of(&shores);
    let rows = shores.clusters.iter().zip(known.outlines());
    let rows = rows.map(|shore| shore_row(shore, Some([0.0, 0.0])));
    ShoresData {
        shores: rows.collect(),
        ..data()
    }
}

#[test]
fn a_list_that_scrolls_leaves_room_for_its_bar() {
    let right = |count: u8| {
        let window = panel_of(260.0, data_of(count));
        window
            .get_by_label_contains("Shore 1, dense")
            .rect()
            .right()
    };
    // The bar of the panel lies beside all rows, and that of the list beside those that scroll.
    let [few, many] = [2, 12].map(right);
    assert!((few - 256.0).abs() < 0.5, "{few}");
    assert!((many - 244.0).abs() < 0.5, "{many}");
}

#[test]
fn a_narrow_panel_shows_rows_whole_and_wraps_what_is_below_them() {
    let heights = [175.0, 213.0, 260.0, 400.0].map(|width| {
        let window = panel(width);
        let [shore, site] = ["Shore 2, dense", "Docking site B"]
            .map(|label| window.get_by_label_contains(label).rect());
        assert!(
            shore.right() <= width + 8.0 && site.right() <= width + 8.0,
            "{width}: {shore} {site}"
        );
        [shore.height(), site.height()].map(|height| height.round() as i32)
    });
    let [lowest, .., wide] = heights;
    // The class of a shore has a line of its own in a narrow panel, and a long reason has two.
    assert!(lowest[0] > wide[0] + 10, "{heights:?}");
    assert!(lowest[1] > wide[1] + 10, "{heights:?}");
    assert_eq!(wide[0], 24, "{heights:?}");
    // A panel as wide as it is at first shows its insides so wide: rows of one line.
    assert_eq!(heights[2][0], 24, "{heights:?}");
    assert!(heights[1][0] > 34, "{heights:?}");
}

#[test]
fn rows_of_a_list_that_scrolls_are_as_high_as_what_is_left_beside_its_bar_asks_for() {
    let height = |width: f32, count: u8| {
        let window = panel_of(width, data_of(count));
        let row = window.get_by_label_contains("Shore 1, dense").rect();
        row.height()
    };
    // The bar is 12 points wide: the same rows without it are so much narrower.
    let mut heights = Vec::new();
    for width in [
        210.0, 218.0, 226.0, 234.0, 242.0, 250.0, 258.0, 266.0, 274.0,
    ] {
        let (many, few) = (height(width, 12), height(width - 12.0, 2));
        assert!((many - few).abs() < 0.5, "{width}: {many} {few}");
        heights.push(many);
    }
    assert!(heights[0] > heights[8] + 10.0, "{heights:?}");
}

#[test]
fn what_is_told_of_a_row_covers_no_row() {
    let mut window = panel(240.0);
    let rows = [
        "Shore 2, dense",
        "Shore 1, dense",
        "Docking site B",
        "Docking site A",
    ];
    let rows = rows.map(|label| window.get_by_label_contains(label).rect());
    window.hover_at(rows[0].center());
    window.run_steps(60);
    let hint = window.get_by_label_contains("Click to show it").rect();
    for row in rows {
        assert!(hint.left() >= row.right(), "{hint} {row}");
    }
}

/// What is painted that begins so, and where.
fn painted(window: &Harness<'_>, first: &str) -> Vec<Rect> {
    let shapes = window.output().shapes.iter();
    let places = shapes.filter_map(|clipped| {
        if let Shape::Text(text) = &clipped.shape {
            let is_it = text.galley.text().starts_with(first);
            is_it.then(|| text.visual_bounding_rect())
        } else {
            None
        }
    });
    places.collect()
}

#[test]
fn a_very_narrow_panel_keeps_how_far_away_a_shore_is() {
    /// What a window of 640 × 480 points at 120 % leaves the panel, and where its inside begins.
    const WIDTH: f32 = 132.0;
    const LEFT: f32 = 8.0;
    let window = panel_of(WIDTH, data_of(12));
    for label in ["Sort shores by away", "Sort docking sites by away"] {
        let title = window.get_by_label(label).rect();
        assert!(title.right() <= LEFT + WIDTH, "{label}: {title}");
    }
    for label in ["Sort shores by rigid", "Sort docking sites by cost"] {
        assert!(window.query_by_label(label).is_none(), "{label}");
    }
    for words in [
        "6.0 m",
        "20 m",
        "Away",
        "Shores, called by number",
        "Dense, 25 % rigid, 40 voxels",
        "Cost 0.20, 4.0 m wide; 2.5 × beam",
    ] {
        let places = painted(&window, words);
        assert!(!places.is_empty(), "{words}");
        for place in places {
            let is_inside = place.left() >= LEFT && place.right() <= LEFT + WIDTH;
            assert!(is_inside, "{words}: {place}");
        }
    }
}

#[test]
fn why_numbers_change_is_said_in_the_panel_as_in_the_handbook() {
    const NUMBERS: &str = "Numbers change while the robot learns: what has merged keeps the number of the larger part, \
                           a part that comes off gets a new number, and no number is given twice.";
    let handbook = include_str!("../../../../docs/console.md");
    let handbook = handbook.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(handbook.contains(NUMBERS));
    let mut window = panel(240.0);
    let heading = window.get_by_label_contains("Shores, called by number");
    let place = heading.rect().center();
    window.hover_at(place);
    window.run_steps(60);
    window.get_by_label_contains(NUMBERS);
}
