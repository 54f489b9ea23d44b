//! Shores with numbers, docking sites with letters and an arrow.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};
use protocol::shores::site_letters;

use super::ShoreMark;
use super::camera::Camera;
use super::marks::Mark;
use crate::model::Outline;
use crate::panels::shores::Distance;

const FONT: f32 = 13.0;
const PADDING: Vec2 = vec2(5.0, 2.0);
/// Fixed width per digit and letter of a label, points.
const FIGURE: f32 = 8.0;
const LETTER: f32 = 12.0;
const LINE: f32 = 17.0;
/// From a docking site's label to the tip of its arrow, points.
const ARROW: f32 = 30.0;
const HEAD: f32 = 9.0;
/// Length of the end lines of a marked docking site, points.
const END: f32 = 12.0;
/// Width of the outline of a marked shore, points.
const SELECTION: f32 = 3.0;

type ShoreInputs<'a> = (&'a Shores, &'a [Outline]);

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ShoreMarks {
    /// Placed numbers of shores, largest shores first.
    pub(super) numbers: Vec<(String, Pos2)>,
    /// Placed letters of docking sites with position and direction, best first.
    pub(super) sites: Vec<(String, Pos2, Vec2)>,
    pub(super) outlines: Vec<Vec<Pos2>>,
    /// Marked docking sites: a line along the bank with an end line at both sides.
    pub(super) brackets: Vec<Vec<Pos2>>,
    pub(super) labels: Vec<Rect>,
}

impl ShoreMarks {
    /// `marked`: selected and hovered; `vehicle_m`: position in `odom`, m.
    pub(super) fn new(
        inputs: ShoreInputs<'_>,
        camera: &Camera,
        marked: &[ShoreMark],
        vehicle_m: Option<[f64; 2]>,
    ) -> Self {
        let (shores, _) = inputs;
        let labels = labels(inputs, camera, marked, vehicle_m);
        let vehicle = vehicle_m.map(|at_m| camera.to_screen(at_m));
        let placed = placed(&labels, camera.screen, vehicle);
        let covered = placed.iter().map(|(_, place)| *place).collect();
        let places: BTreeMap<_, _> = placed.into_iter().collect();
        let (mut numbers, mut sites) = (Vec::new(), Vec::new());
        for (index, label) in labels.iter().enumerate() {
            let Some(at) = places.get(&index).map(Rect::center) else {
                continue;
            };
            let text = text(label.mark);
            match label.heading_rad {
                Some(heading_rad) => {
                    sites.push((text, at, camera.direction(f64::from(heading_rad))));
                }
                None => numbers.push((text, at)),
            }
        }
        let (mut outlines, mut brackets) = (Vec::new(), Vec::new());
        for mark in marked {
            let extent = camera.line(&extent_m(shores, *mark));
            if extent.is_empty() {
                continue;
            }
            match mark {
                ShoreMark::Shore(_) => outlines.push(extent),
                ShoreMark::Site(number) => {
                    let site = site_of(shores, *number);
                    let towards = site.map(|site| camera.direction(f64::from(site.heading_rad)));
                    brackets.push(bracket(&extent, towards.unwrap_or_default()));
                }
            }
        }
        Self {
            numbers,
            sites,
            outlines,
            brackets,
            labels: covered,
        }
    }

    /// Draws what is below the vehicle: outlines and arrows.
    pub(super) fn paint_ground(&self, painter: &Painter, ink: Color32, paper: Color32) {
        let outlines = self.outlines.iter().map(|line| (line.clone(), true));
        let brackets = self.brackets.iter().map(|line| (line.clone(), false));
        let lines: Vec<_> = outlines.chain(brackets).collect();
        let mark = Mark::Selection;
        mark.paint_lines(painter, &lines, SELECTION, mark.color());
        for (_, at, towards) in &self.sites {
            paint_arrow(painter, *at, *towards, ink, paper);
        }
    }

    /// Draws the labels above the vehicle: numbers on cards, letters in inverse colours.
    pub(super) fn paint_labels(&self, painter: &Painter, ink: Color32, paper: Color32) {
        for (text, at) in &self.numbers {
            paint_label(painter, *at, text, ink, paper);
        }
        for (text, at, _) in &self.sites {
            paint_label(painter, *at, text, paper.to_opaque(), ink);
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Label {
    mark: ShoreMark,
    heading_rad: Option<f32>,
    at: Pos2,
    size: Vec2,
    /// Distance from the vehicle, m; infinite if unknown.
    away_m: f64,
    is_marked: bool,
}

/// Visible labels: docking sites, the best first, then shores, the largest first.
fn labels(
    (shores, outlines): ShoreInputs<'_>,
    camera: &Camera,
    marked: &[ShoreMark],
    vehicle_m: Option<[f64; 2]>,
) -> Vec<Label> {
    let vehicle = vehicle_m.map(|at_m| camera.to_screen(at_m));
    let label = |mark: ShoreMark, center_m: [f32; 2], heading_rad, distance: &dyn Fn() -> f64| {
        let at = camera.to_screen(center_m.map(f64::from));
        let size = size(mark);
        is_in_sight((at, size), camera.screen, vehicle).then(|| Label {
            mark,
            heading_rad,
            at,
            size,
            away_m: distance(),
            is_marked: marked.contains(&mark),
        })
    };
    let sites = shores.sites.iter().filter_map(|site| {
        let distance = || Distance::of_site(site, vehicle_m).key();
        let (mark, heading_rad) = (ShoreMark::Site(site.number), Some(site.heading_rad));
        label(mark, site.center_m, heading_rad, &distance)
    });
    let mut clusters: Vec<_> = shores.clusters.iter().zip(outlines).collect();
    clusters.sort_by_key(|(cluster, _)| (Reverse(cluster.voxels), cluster.number));
    let clusters = clusters.into_iter().filter_map(|(cluster, outline)| {
        let distance = || Distance::of_shore(outline, vehicle_m).key();
        let mark = ShoreMark::Shore(cluster.number);
        label(mark, cluster.center_m, None, &distance)
    });
    sites.chain(clusters).collect()
}

/// Between a moved label and the one it avoids, points.
const APART: f32 = 1.0;
/// Candidate positions in label sizes: in place, above, below, left, right.
const PLACES: [Vec2; 5] = [
    Vec2::ZERO,
    vec2(0.0, -1.0),
    vec2(0.0, 1.0),
    vec2(-1.0, 0.0),
    vec2(1.0, 0.0),
];

/// Whether a label at its preferred position is visible. Others are not placed.
fn is_in_sight((at, size): (Pos2, Vec2), screen: Rect, vehicle: Option<Pos2>) -> bool {
    screen.intersects(preferred_rect(at, size, vehicle))
}

fn preferred_rect(at: Pos2, size: Vec2, vehicle: Option<Pos2>) -> Rect {
    Rect::from_center_size(at + vehicle_clearance(at, size, vehicle), size)
}

/// Indices and positions of the placed labels. Order: marked ones, the nearest shore and the nearest docking site,
/// then by distance. A label that would overlap moves by at most its own size, or is omitted. No label covers the
/// vehicle.
fn placed(labels: &[Label], screen: Rect, vehicle: Option<Pos2>) -> Vec<(usize, Rect)> {
    let seen = labels.iter().enumerate();
    let mut seen: Vec<_> = seen
        .filter(|(_, label)| is_in_sight((label.at, label.size), screen, vehicle))
        .collect();
    seen.sort_by(|(_, a), (_, b)| a.away_m.total_cmp(&b.away_m));
    let nearest = [false, true].map(|is_site| {
        let mut of_kind = seen
            .iter()
            .filter(|(_, label)| label.heading_rad.is_some() == is_site);
        of_kind.next().map(|(index, _)| *index)
    });
    seen.sort_by_key(|(index, label)| (!label.is_marked, !nearest.contains(&Some(*index))));
    let mut taken: Vec<(usize, Rect)> = Vec::new();
    for (index, label) in seen {
        let mut places = PLACES.iter().map(|place| {
            let at = label.at + *place * (label.size + Vec2::splat(APART));
            preferred_rect(at, label.size, vehicle)
        });
        let free = places.find(|place| {
            let mut others = taken.iter().map(|(_, other)| other);
            screen.intersects(*place) && others.all(|other| !other.intersects(*place))
        });
        taken.extend(free.map(|place| (index, place)));
    }
    taken
}

fn vehicle_clearance(at: Pos2, size: Vec2, vehicle: Option<Pos2>) -> Vec2 {
    let Some(vehicle_at) = vehicle else {
        return Vec2::ZERO;
    };
    let way = at - vehicle_at;
    let lacks = 0.5 * (size + Vec2::splat(super::vehicle::ARROW)) - way.abs();
    if lacks.min_elem() <= 0.0 {
        Vec2::ZERO
    } else if lacks.x < lacks.y {
        vec2(lacks.x.copysign(way.x), 0.0)
    } else {
        vec2(0.0, lacks.y.copysign(way.y))
    }
}

fn text(mark: ShoreMark) -> String {
    match mark {
        ShoreMark::Shore(number) => number.to_string(),
        ShoreMark::Site(number) => site_letters(number),
    }
}

fn size(mark: ShoreMark) -> Vec2 {
    let character = match mark {
        ShoreMark::Shore(_) => FIGURE,
        ShoreMark::Site(_) => LETTER,
    };
    vec2(text(mark).len() as f32 * character, LINE) + 2.0 * PADDING
}

pub(super) fn is_listed(shores: &Shores, mark: ShoreMark) -> bool {
    match mark {
        ShoreMark::Shore(number) => shores.clusters.iter().any(|shore| shore.number == number),
        ShoreMark::Site(number) => site_of(shores, number).is_some(),
    }
}

pub(super) fn extent_m(shores: &Shores, marked: ShoreMark) -> Vec<[f64; 2]> {
    match marked {
        ShoreMark::Shore(number) => {
            let shore = shores.clusters.iter().find(|shore| shore.number == number);
            let corners_m = shore.map(|shore| shore.corners_m(shores.cell_m).collect());
            corners_m.unwrap_or_default()
        }
        ShoreMark::Site(number) => {
            let site = site_of(shores, number);
            site.map(ends_m).into_iter().flatten().collect()
        }
    }
}

fn site_of(shores: &Shores, number: u32) -> Option<&DockingSite> {
    shores.sites.iter().find(|site| site.number == number)
}

/// Ends of a docking site along the bank, m in `odom`.
fn ends_m(site: &DockingSite) -> [[f64; 2]; 2] {
    let [x, y] = site.center_m.map(f64::from);
    let (sin, cos) = libm::sincos(f64::from(site.heading_rad));
    let half_m = 0.5 * f64::from(site.width_m);
    [half_m, -half_m].map(|left_m| [x - left_m * sin, y + left_m * cos])
}

/// Line between two ends, with end lines against `towards`.
fn bracket(ends: &[Pos2], towards: Vec2) -> Vec<Pos2> {
    let [left, right] = *ends else {
        return Vec::new();
    };
    let to_water = -END * towards;
    vec![left + to_water, left, right, right + to_water]
}

fn paint_label(painter: &Painter, at: Pos2, text: &str, ink: Color32, paper: Color32) {
    let text = painter.layout_no_wrap(text.to_owned(), FontId::proportional(FONT), ink);
    let place = Align2::CENTER_CENTER.anchor_size(at, text.size());
    let card = place.expand2(PADDING);
    painter.rect_filled(card, 4.0, paper);
    painter.rect_stroke(card, 4.0, Stroke::new(1.0, ink), StrokeKind::Inside);
    painter.galley(place.min, text, ink);
}

fn paint_arrow(painter: &Painter, at: Pos2, towards: Vec2, ink: Color32, paper: Color32) {
    let tip = at + towards * ARROW;
    let neck = tip - towards * HEAD;
    let side = vec2(-towards.y, towards.x) * 0.6 * HEAD;
    let head = vec![tip, neck + side, neck - side];
    painter.line_segment([at, neck], Stroke::new(5.0, paper));
    painter.add(Shape::closed_line(head.clone(), Stroke::new(3.0, paper)));
    painter.line_segment([at, neck], Stroke::new(2.0, ink));
    painter.add(Shape::convex_polygon(head, ink, Stroke::NONE));
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;
    use protocol::message::{ShoreClass, ShoreCluster};

    use super::*;
    use crate::model::ShoreOutlines;
    use crate::test_support::{docking_site, shore};

    fn cluster(number: u32, voxels: u32, center_m: [f32; 2]) -> ShoreCluster {
        ShoreCluster {
            class: ShoreClass::Sparse,
            voxels,
            ..shore(number, center_m)
        }
    }

    fn screen() -> Rect {
        Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0))
    }

    /// A docking site of 2 m at this x, m, that faces east.
    fn site(x_m: f32) -> DockingSite {
        docking_site([x_m, 0.0])
    }

    fn numbered_site((number, x_m): (u32, f32)) -> DockingSite {
        DockingSite {
            number,
            ..site(x_m)
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
            number: 2,
            ..site(-1.0)
        };
        // B and C; A is gone.
        let beside = DockingSite {
            center_m: [-1.0, -60.0],
            number: 3,
            ..site
        };
        let shores = Shores::gather(0.3, None, clusters, vec![site, beside]);
        let known = ShoreOutlines::of(&shores);
        let reported = (&shores, known.outlines());
        let camera = Camera::on(screen());
        let marks_of = |mark| {
            let mark = ShoreMark::Site(mark);
            ShoreMarks::new(reported, &camera, &[mark], None)
        };
        let marks = marks_of(2);
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
        let of_gone = marks_of(1).brackets;
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
        let sites = (1..).zip([1.38, 1.36, 1.2]).map(numbered_site).collect();
        let shores = Shores::gather(0.3, None, clusters, sites);
        let known = ShoreOutlines::of(&shores);
        let marks = ShoreMarks::new(
            (&shores, known.outlines()),
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
        assert_eq!(letter, "C");
        // Those beside them are labelled as far as there is room.
        assert_eq!(marks.labels.len(), 4, "{marks:?}");
    }

    #[test]
    fn labels_move_off_the_vehicle() {
        let shores = Shores::gather(0.3, None, vec![cluster(1, 10, [1.0, 1.0])], Vec::new());
        let known = ShoreOutlines::of(&shores);
        let reported = (&shores, known.outlines());
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
        let marked = ShoreMark::Site(1);
        let sites = [(2, 3.0), (1, -3.0)].map(numbered_site).to_vec();
        let shores = Shores::gather(0.3, None, Vec::new(), sites);
        let known = ShoreOutlines::of(&shores);
        let reported = (&shores, known.outlines());
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
        let sites = [(1, -13.0), (2, -9.0)].map(|(number, x)| DockingSite {
            center_m: [x_m(x), 2.0],
            ..numbered_site((number, 0.0))
        });
        let sites = sites.to_vec();
        let shores = Shores::gather(0.3, None, clusters, sites);
        let known = ShoreOutlines::of(&shores);
        let reported = (&shores, known.outlines());
        let camera = Camera::on(screen());
        let seen = |vehicle_m| {
            let named = labels(reported, &camera, &[], vehicle_m);
            named.iter().map(|named| named.mark).collect::<Vec<_>>()
        };
        let (near, [three, ten, one]) = (ShoreMark::Site(2), [3, 10, 1].map(ShoreMark::Shore));
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
        let site = ShoreMark::Site(1);
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
}
