use eframe::egui::pos2;
use protocol::message::{ShoreClass, ShoreCluster};

use super::*;
use crate::model::SiteNames;

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

#[test]
fn labels_are_where_shores_are_and_never_on_one_another() {
    let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
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
        mean_cost: 0.2,
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
    let camera = Camera::default();
    let marks_of = |mark| {
        ShoreMarks::new(
            (&shores, &named),
            &camera,
            screen,
            Some(ShoreMark::Site(mark)),
            None,
        )
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
    let berth = marks.berth.iter().map(|at| at.round());
    let berth: Vec<_> = berth.collect();
    let [left, right] = [pos2(100.0, 280.0), pos2(220.0, 280.0)];
    let end = vec2(0.0, END);
    assert_eq!(berth, [left + end, left, right, right + end]);
    assert_eq!(marks.outline, [], "it is no shore");
    assert_eq!(marks_of(gone).berth, [], "it is not where another is now");
    // What stands out stays where it is, and the larger one moves.
    let mark = Some(ShoreMark::Shore(1));
    let marks = ShoreMarks::new((&shores, &named), &camera, screen, mark, None);
    let numbers = marks.numbers.iter();
    let numbers: Vec<_> = numbers.map(|(text, at)| (&**text, at.y.round())).collect();
    assert_eq!(numbers, [("2", 138.0), ("3", 120.0), ("1", 160.0)]);
}

#[test]
fn the_nearest_shore_and_the_nearest_site_are_labelled_however_many_there_are() {
    let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
    // All of them are within a label's size, the farther the larger and the better.
    let clusters = (1..=20_u8).map(|n| {
        let away_m = 1.0 + 0.01 * f32::from(n);
        cluster(n.into(), 100 * u32::from(n), [away_m, 0.0])
    });
    // Its middle is farther away than all others, and its edge is nearer: 0.3 m and 0.9 m are 1 and 3 cells.
    let mut reeds = cluster(21, 1, [1.4, 0.0]);
    reeds.outline = vec![(1, -1), (3, -1), (3, 1), (1, 1)];
    let clusters = clusters.chain([reeds]).collect();
    let site = |x_m, mean_cost| DockingSite {
        center_m: [x_m, 0.0],
        heading_rad: 0.0,
        width_m: 2.0,
        mean_cost,
    };
    let sites = vec![site(1.38, 0.1), site(1.36, 0.2), site(1.2, 0.3)];
    let names: Vec<_> =
        SiteNames::default().name(&[site(0.0, 0.1), site(50.0, 0.1), site(99.0, 0.1)]);
    let shores = Shores::gather(0.3, None, clusters, sites);
    let marks = ShoreMarks::new(
        (&shores, &names),
        &Camera::default(),
        screen,
        None,
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
fn a_label_stands_beside_the_vehicle_and_nowhere_else_otherwise() {
    let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
    let shores = Shores::gather(0.3, None, vec![cluster(1, 10, [1.0, 1.0])], Vec::new());
    let label_at = |vehicle_at: Pos2| {
        let camera = Camera::default();
        let vehicle_m = Some(camera.to_odom(screen, vehicle_at));
        let marks = ShoreMarks::new((&shores, &[]), &camera, screen, None, vehicle_m);
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
fn what_is_marked_stands_out_whatever_its_rank() {
    let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
    let site = |x_m, mean_cost| DockingSite {
        center_m: [x_m, 0.0],
        heading_rad: 0.0,
        width_m: 2.0,
        mean_cost,
    };
    let mut names = SiteNames::default();
    let marked = ShoreMark::Site(names.name(&[site(-3.0, 0.2), site(3.0, 0.3)])[0]);
    let sites = vec![site(3.0, 0.1), site(-3.0, 0.2)];
    let named = names.name(&sites);
    let shores = Shores::gather(0.3, None, Vec::new(), sites);
    let (named, camera) = ((&shores, &*named), Camera::default());
    let marks = ShoreMarks::new(named, &camera, screen, Some(marked), None);
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
    let middle = marks.berth[1] + 0.5 * (marks.berth[2] - marks.berth[1]);
    assert!((middle - left).length() < 1e-3, "{middle:?}");
}
