use eframe::egui::pos2;
use protocol::message::{ShoreClass, ShoreCluster};

use super::*;
use crate::model::{ShoreOutlines, SiteNames};

fn cluster(number: u32, voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
    ShoreCluster {
        number,
        class: ShoreClass::Sparse,
        voxels,
        rigid_voxels: 0,
        center_m,
        outline: Vec::new(),
    }
}

fn screen() -> Rect {
    Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0))
}

/// A docking site of 2 m at this x, m, that faces east.
fn site(x_m: f32) -> DockingSite {
    DockingSite {
        center_m: [x_m, 0.0],
        heading_rad: 0.0,
        width_m: 2.0,
        mean_cost: 0.2,
    }
}

#[test]
fn labels_are_at_shores_without_overlap() {
    // 40 points a metre: 1 and 2 would overlap, 4 is out of sight. Nobody knows where the vehicle is: the largest comes
    // first, and 1 stands above 2.
    let clusters = vec![
        cluster(1, 10, [1.0, 1.0]),
        cluster(2, 30, [1.1, 1.0]),
        cluster(3, 20, [-3.0, 2.0]),
        cluster(4, 90, [60.0, 0.0]),
    ];
    let site = DockingSite {
        center_m: [-1.0, -2.0],
        heading_rad: std::f32::consts::FRAC_PI_2,
        width_m: 3.0,
        ..site(-1.0)
    };
    // A, then B and C; A is gone.
    let beside = |y_m| DockingSite {
        center_m: [-1.0, y_m],
        ..site
    };
    let mut names = SiteNames::default();
    let gone = names.name(&[beside(30.0)])[0];
    let shores = Shores::gather(0.3, None, clusters, vec![site, beside(-60.0)]);
    let named = names.name(&shores.sites);
    let known = ShoreOutlines::of(&shores);
    let reported = (&shores, &*named, known.outlines());
    let camera = Camera::on(screen());
    let marks_of = |mark| {
        let mark = ShoreMark::Site(mark);
        ShoreMarks::new(reported, &camera, &[mark], None)
    };
    let marks = marks_of(named[0]);
    let numbers: Vec<_> = marks
        .numbers
        .iter()
        .map(|(text, at)| (text.as_str(), [at.x.round(), at.y.round()]))
        .collect();
    let expected = [
        ("2", [244.0, 160.0]),
        ("3", [80.0, 120.0]),
        ("1", [240.0, 138.0]),
    ];
    assert_eq!(numbers, expected);
    let [(letter, at, towards)] = &marks.sites[..] else {
        panic!("{marks:?}");
    };
    assert_eq!((letter.as_str(), *at), ("B", pos2(160.0, 280.0)));
    assert!((*towards - vec2(0.0, -1.0)).length() < 1e-6, "up is north");
    // 3 m wide, across the way in, which is up: the water is below.
    let brackets = marks.brackets.iter().flatten().map(|at| at.round());
    let bracket_line: Vec<_> = brackets.collect();
    let [left, right] = [pos2(100.0, 280.0), pos2(220.0, 280.0)];
    let end = vec2(0.0, END);
    assert_eq!(bracket_line, [left + end, left, right, right + end]);
    assert!(marks.outlines.is_empty(), "it is no shore");
    let of_gone = marks_of(gone).brackets;
    assert!(of_gone.is_empty(), "it is not where another is now");
    // What stands out stays where it is, and the larger one moves.
    let mark = ShoreMark::Shore(1);
    let marks = ShoreMarks::new(reported, &camera, &[mark], None);
    let numbers = marks.numbers.iter();
    let numbers: Vec<_> = numbers.map(|(text, at)| (&**text, at.y.round())).collect();
    assert_eq!(numbers, [("2", 138.0), ("3", 120.0), ("1", 160.0)]);
}

#[test]
fn nearest_shore_and_site_are_always_labelled() {
    // All of them are within a label's size, the farther the larger and the better.
    let clusters = (1..=20_u8).map(|n| {
        let away_m = 1.0 + 0.01 * f32::from(n);
        cluster(n.into(), 100 * u32::from(n), [away_m, 0.0])
    });
    // Its middle is farther away than all others, and its edge is nearer: 0.3 m and 0.9 m are 1 and 3 cells.
    let mut reeds = cluster(21, 1, [1.4, 0.0]);
    reeds.outline = vec![(1, -1), (3, -1), (3, 1), (1, 1)];
    let clusters = clusters.chain([reeds]).collect();
    let sites = [1.38, 1.36, 1.2].map(site).to_vec();
    let names = SiteNames::default().name(&[0.0, 50.0, 99.0].map(site));
    let shores = Shores::gather(0.3, None, clusters, sites);
    let known = ShoreOutlines::of(&shores);
    let marks = ShoreMarks::new(
        (&shores, &names, known.outlines()),
        &Camera::on(screen()),
        &[],
        Some([0.0, 0.0]),
    );
    let has_number = |wanted: &str| marks.numbers.iter().any(|(text, _)| text == wanted);
    assert!(has_number("21"), "{marks:?}");
    assert!(!has_number("20"), "the farthest shore: {marks:?}");
    let [(letter, _, _)] = &marks.sites[..] else {
        panic!("{marks:?}");
    };
    assert_eq!(*letter, names[2].to_string());
    // Those beside them are labelled as far as there is room.
    assert_eq!(marks.labels.len(), 4, "{marks:?}");
}

#[test]
fn labels_move_off_the_vehicle() {
    let shores = Shores::gather(0.3, None, vec![cluster(1, 10, [1.0, 1.0])], Vec::new());
    let known = ShoreOutlines::of(&shores);
    let reported = (&shores, &[][..], known.outlines());
    let label_at = |vehicle_at: Pos2| {
        let camera = Camera::on(screen());
        let vehicle_m = Some(camera.to_odom(vehicle_at));
        let marks = ShoreMarks::new(reported, &camera, &[], vehicle_m);
        marks.numbers[0].1
    };
    // The label is 18 × 21 points, the vehicle 20 × 20.
    for (vehicle_at, expected) in [
        (pos2(300.0, 160.0), pos2(240.0, 160.0)),
        (pos2(240.0, 160.0), pos2(259.0, 160.0)),
        (pos2(245.0, 160.0), pos2(226.0, 160.0)),
        (pos2(242.0, 170.0), pos2(240.0, 149.5)),
    ] {
        let found = label_at(vehicle_at);
        assert!(found.distance(expected) < 1e-3, "{vehicle_at}: {found}");
    }
}

#[test]
fn marked_shores_are_always_drawn() {
    let mut names = SiteNames::default();
    let marked = ShoreMark::Site(names.name(&[-3.0, 3.0].map(site))[0]);
    let sites = [3.0, -3.0].map(site).to_vec();
    let named = names.name(&sites);
    let shores = Shores::gather(0.3, None, Vec::new(), sites);
    let known = ShoreOutlines::of(&shores);
    let reported = (&shores, &*named, known.outlines());
    let camera = Camera::on(screen());
    let marks = ShoreMarks::new(reported, &camera, &[marked], None);
    let labels: Vec<_> = marks
        .sites
        .iter()
        .map(|(text, at, _)| (text.as_str(), *at))
        .collect();
    let (left, right) = (pos2(80.0, 200.0), pos2(320.0, 200.0));
    assert_eq!(labels, [("B", right), ("A", left)]);
    // What stands out is placed before the others.
    let covered: Vec<_> = marks.labels.iter().map(Rect::center).collect();
    assert_eq!(covered, [left, right]);
    let bracket_line = &marks.brackets[0];
    let middle = bracket_line[1] + 0.5 * (bracket_line[2] - bracket_line[1]);
    assert!((middle - left).length() < 1e-3, "{middle:?}");
}

#[test]
fn invisible_labels_are_skipped() {
    // 40 points a metre: the middles are at these places in x, and each label of one figure reaches 9 points to either side,
    // each of two 13.
    let x_m = |x: f32| (x - 200.0) / 40.0;
    let at = |number, voxels, x| cluster(number, voxels, [x_m(x), 0.0]);
    let clusters = vec![
        at(1, 10, 404.0),
        at(2, 90, 412.0),
        at(3, 50, 100.0),
        at(10, 20, 412.0),
    ];
    // A label of one letter reaches 11 points to either side.
    let sites = [-13.0, -9.0].map(|x| DockingSite {
        center_m: [x_m(x), 2.0],
        ..site(0.0)
    });
    let sites = sites.to_vec();
    let names = SiteNames::default().name(&sites);
    let shores = Shores::gather(0.3, None, clusters, sites);
    let known = ShoreOutlines::of(&shores);
    let reported = (&shores, &*names, known.outlines());
    let camera = Camera::on(screen());
    let seen = |vehicle_m| {
        let named = labels(reported, &camera, &[], vehicle_m);
        named.iter().map(|named| named.mark).collect::<Vec<_>>()
    };
    let (near, [three, ten, one]) = (ShoreMark::Site(names[1]), [3, 10, 1].map(ShoreMark::Shore));
    assert_eq!(seen(None), [near, three, ten, one]);
    // The vehicle is at 418, on the label of 2 that would be out of sight: beside it is the screen.
    let vehicle_m = Some([f64::from(x_m(418.0)), 0.0]);
    let two = ShoreMark::Shore(2);
    assert_eq!(seen(vehicle_m), [near, two, three, ten, one]);
    let marks = ShoreMarks::new(reported, &camera, &[], vehicle_m);
    let numbers: Vec<_> = marks.numbers.iter().map(|(text, _)| &**text).collect();
    assert!(numbers.contains(&"3"), "{numbers:?}");
}

const SHORE: ShoreMark = ShoreMark::Shore(0);
const SIZE: Vec2 = vec2(20.0, 20.0);

fn label(mark: ShoreMark, x: f32, away_m: f64) -> Label {
    Label {
        mark,
        heading_rad: matches!(mark, ShoreMark::Site(_)).then_some(0.0),
        at: pos2(x, 100.0),
        size: SIZE,
        away_m,
        is_marked: false,
    }
}

fn wide_screen() -> Rect {
    Rect::from_min_size(Pos2::ZERO, vec2(400.0, 200.0))
}

fn order(labels: &[Label]) -> Vec<usize> {
    let placed = placed(labels, wide_screen(), None);
    placed.into_iter().map(|(index, _)| index).collect()
}

#[test]
fn marked_then_nearest_labels_are_placed_first() {
    let site = ShoreMark::Site(SiteNames::default().name(&[site(0.0)])[0]);
    let mut labels = vec![
        label(site, 50.0, 90.0),
        label(site, 100.0, 40.0),
        label(SHORE, 150.0, 30.0),
        label(SHORE, 200.0, 5.0),
        label(SHORE, 250.0, 70.0),
        // Nearest, but out of sight.
        label(SHORE, 900.0, 1.0),
    ];
    assert_eq!(order(&labels), [3, 1, 2, 4, 0]);
    labels[4].is_marked = true;
    assert_eq!(order(&labels), [4, 3, 1, 2, 0]);
    // The vehicle's position is unknown.
    for label in &mut labels {
        label.away_m = f64::INFINITY;
    }
    assert_eq!(order(&labels), [4, 0, 2, 1, 3]);
}

#[test]
fn overlapping_labels_move_or_are_omitted() {
    let labels: Vec<_> = (0..6_u8)
        .map(|n| label(SHORE, 100.0, f64::from(n)))
        .collect();
    let placed = placed(&labels, wide_screen(), None);
    let middles: Vec<_> = placed
        .iter()
        .map(|(index, place)| (*index, place.center()))
        .collect();
    let expected = [
        (0, pos2(100.0, 100.0)),
        (1, pos2(100.0, 79.0)),
        (2, pos2(100.0, 121.0)),
        (3, pos2(79.0, 100.0)),
        (4, pos2(121.0, 100.0)),
    ];
    assert_eq!(middles, expected, "the farthest has no place");
}

#[test]
fn a_moved_label_does_not_cover_the_vehicle() {
    let labels = [label(SHORE, 100.0, 1.0), label(SHORE, 100.0, 2.0)];
    // Above both labels.
    let vehicle = pos2(100.0, 75.0);
    let placed = placed(&labels, wide_screen(), Some(vehicle));
    assert_eq!(placed.len(), 2);
    let mark = Rect::from_center_size(vehicle, Vec2::splat(super::super::vehicle::ARROW));
    for (_, place) in placed {
        assert!(!mark.shrink(0.01).intersects(place), "{place}");
    }
}
