//! Shores with numbers, docking sites with letters and an arrow from the water.

use std::cmp::Reverse;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};
use protocol::shores::site_letters;

use super::ShoreMark;
use super::camera::Camera;
use super::labels::{Area, Label, PlacedLabel, placed};
use super::marks::Mark;
use crate::model::Outline;
use crate::panels::shores::Distance;

const FONT: f32 = 13.0;
const PADDING: Vec2 = vec2(5.0, 2.0);
/// Fixed width per digit and letter of a label, points.
const FIGURE: f32 = 8.0;
const LETTER: f32 = 12.0;
const LINE: f32 = 17.0;
/// Length of a docking site's arrow, points.
const ARROW: f32 = 30.0;
const HEAD: f32 = 9.0;
/// Length of the end lines of a marked docking site, points.
const END: f32 = 12.0;
/// Width of the outline of a marked shore, points.
const SELECTION: f32 = 3.0;

type ShoreInputs<'a> = (&'a Shores, &'a [Outline]);

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct ShoreMarks {
    /// The most important first.
    labels: Vec<(ShoreMark, PlacedLabel)>,
    /// Tail and direction of the arrows of the labelled docking sites; their tips are at the sites.
    arrows: Vec<(Pos2, Vec2)>,
    outlines: Vec<Vec<Pos2>>,
    /// Marked docking sites: a line along the bank with an end line at both sides.
    brackets: Vec<Vec<Pos2>>,
}

impl ShoreMarks {
    /// `marked`: selected and hovered; only they have labels if `labels_all` is not set. `vehicle_m`: position in `odom`,
    /// m. Labels avoid `taken`.
    pub(super) fn new(
        inputs: ShoreInputs<'_>,
        camera: &Camera,
        (marked, labels_all): (&[ShoreMark], bool),
        vehicle_m: Option<[f64; 2]>,
        taken: &[Rect],
    ) -> Self {
        let (shores, _) = inputs;
        let mut named = named(inputs, camera, marked, vehicle_m);
        named.retain(|named| labels_all || named.is_marked);
        let labels: Vec<_> = named.iter().map(|named| named.label.clone()).collect();
        let placed = placed(&labels, camera.screen, taken);
        let placed = named.iter().zip(placed);
        let placed: Vec<_> = placed
            .filter_map(|(named, label)| Some((named, label?)))
            .collect();
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
            arrows: placed.iter().filter_map(|(named, _)| named.arrow).collect(),
            labels: placed
                .into_iter()
                .map(|(named, label)| (named.mark, label))
                .collect(),
            outlines,
            brackets,
        }
    }

    pub(super) fn label_places(&self) -> Vec<Rect> {
        self.labels.iter().map(|(_, label)| label.place).collect()
    }

    /// Draws what is below the vehicle: outlines, arrows and leader lines.
    pub(super) fn paint_ground(&self, painter: &Painter, ink: Color32, paper: Color32) {
        let outlines = self.outlines.iter().map(|line| (line.clone(), true));
        let brackets = self.brackets.iter().map(|line| (line.clone(), false));
        let lines: Vec<_> = outlines.chain(brackets).collect();
        let mark = Mark::Selection;
        mark.paint_lines(painter, &lines, SELECTION, mark.color());
        for (tail, towards) in &self.arrows {
            paint_arrow(painter, *tail, *towards, ink, paper);
        }
        let leaders = || self.labels.iter().filter_map(|(_, label)| label.leader);
        for (width, color) in [(3.0, paper), (1.0, ink)] {
            for leader in leaders() {
                painter.line_segment(leader, Stroke::new(width, color));
            }
        }
    }

    /// Draws the labels above the vehicle: numbers on cards, letters in inverse colours.
    pub(super) fn paint_labels(&self, painter: &Painter, ink: Color32, paper: Color32) {
        for (mark, label) in &self.labels {
            let (ink, paper) = match mark {
                ShoreMark::Shore(_) => (ink, paper),
                ShoreMark::Site(_) => (paper.to_opaque(), ink),
            };
            paint_label(painter, label.place.center(), &text(*mark), ink, paper);
        }
    }
}

/// A shore or docking site in sight.
#[derive(Clone, Debug, PartialEq)]
struct Named {
    mark: ShoreMark,
    label: Label,
    /// Tail and direction; docking sites only.
    arrow: Option<(Pos2, Vec2)>,
    /// Distance from the vehicle, m; infinite if unknown.
    away_m: f64,
    is_marked: bool,
}

/// What is in sight. Order: marked ones, the nearest shore and the nearest docking site, then by distance, then the best
/// docking sites and the largest shores.
fn named(
    (shores, outlines): ShoreInputs<'_>,
    camera: &Camera,
    marked: &[ShoreMark],
    vehicle_m: Option<[f64; 2]>,
) -> Vec<Named> {
    let sites = shores.sites.iter().map(|site| {
        let towards = camera.direction(f64::from(site.heading_rad));
        let tail = camera.to_screen(site.center_m.map(f64::from)) - towards * ARROW;
        let mark = ShoreMark::Site(site.number);
        let size = size(mark);
        let reach = 0.5 * towards.abs().dot(size) + 1.0;
        let [left, right] = ends_m(site).map(|end_m| camera.to_screen(end_m));
        let label = Label {
            size,
            named: Area::new(vec![right, left, tail]),
            // The arrow leads from its label to the site.
            preferred: Some(Rect::from_center_size(tail - towards * reach, size)),
            is_important: false,
        };
        let away_m = Distance::of_site(site, vehicle_m).key();
        (mark, label, Some((tail, towards)), away_m)
    });
    let mut clusters: Vec<_> = shores.clusters.iter().zip(outlines).collect();
    clusters.sort_by_key(|(cluster, _)| (Reverse(cluster.voxels), cluster.number));
    let clusters = clusters.into_iter().map(|(cluster, outline)| {
        let mark = ShoreMark::Shore(cluster.number);
        let label = Label {
            size: size(mark),
            named: Area::new(camera.line(outline.corners_m())),
            preferred: None,
            is_important: false,
        };
        (
            mark,
            label,
            None,
            Distance::of_shore(outline, vehicle_m).key(),
        )
    });
    let all = sites.chain(clusters);
    let in_sight = all.filter(|(_, label, ..)| label.named.bounds().intersects(camera.screen));
    let mut named: Vec<_> = in_sight
        .map(|(mark, label, arrow, away_m)| Named {
            mark,
            label,
            arrow,
            away_m,
            is_marked: marked.contains(&mark),
        })
        .collect();
    named.sort_by(|a, b| a.away_m.total_cmp(&b.away_m));
    for is_site in [false, true] {
        let mut of_kind = named
            .iter_mut()
            .filter(|named| named.arrow.is_some() == is_site);
        if let Some(nearest) = of_kind.next() {
            nearest.label.is_important = true;
        }
    }
    for named in &mut named {
        named.label.is_important |= named.is_marked;
    }
    named.sort_by_key(|named| (!named.is_marked, !named.label.is_important));
    named
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

fn paint_arrow(painter: &Painter, tail: Pos2, towards: Vec2, ink: Color32, paper: Color32) {
    let tip = tail + towards * ARROW;
    let neck = tip - towards * HEAD;
    let side = vec2(-towards.y, towards.x) * 0.6 * HEAD;
    let head = vec![tip, neck + side, neck - side];
    painter.line_segment([tail, neck], Stroke::new(5.0, paper));
    painter.add(Shape::closed_line(head.clone(), Stroke::new(3.0, paper)));
    painter.line_segment([tail, neck], Stroke::new(2.0, ink));
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

    /// 40 points a metre, the origin in the middle.
    fn screen() -> Rect {
        Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0))
    }

    /// A docking site of 2 m at this x, m, that faces east.
    fn site((number, x_m): (u32, f32)) -> DockingSite {
        DockingSite {
            number,
            ..docking_site([x_m, 0.0])
        }
    }

    fn marks_of(shores: &Shores, marked: &[ShoreMark], vehicle_m: Option<[f64; 2]>) -> ShoreMarks {
        let known = ShoreOutlines::of(shores);
        let inputs = (shores, known.outlines());
        ShoreMarks::new(
            inputs,
            &Camera::on(screen()),
            (marked, true),
            vehicle_m,
            &[],
        )
    }

    fn texts(marks: &ShoreMarks) -> Vec<String> {
        marks.labels.iter().map(|(mark, _)| text(*mark)).collect()
    }

    #[test]
    fn arrow_leads_from_the_letter_to_the_site() {
        let site = DockingSite {
            center_m: [-1.0, -2.0],
            heading_rad: std::f32::consts::FRAC_PI_2,
            width_m: 3.0,
            ..site((2, -1.0))
        };
        let shores = Shores::gather(0.3, None, Vec::new(), vec![site]);
        let marks = marks_of(&shores, &[ShoreMark::Site(2)], None);
        let at = pos2(160.0, 280.0);
        let [(tail, towards)] = marks.arrows[..] else {
            panic!("{marks:?}");
        };
        assert!((towards - vec2(0.0, -1.0)).length() < 1e-6, "up is north");
        assert!((tail - at - vec2(0.0, ARROW)).length() < 1e-3, "{tail}");
        let [(ShoreMark::Site(2), label)] = &marks.labels[..] else {
            panic!("{marks:?}");
        };
        assert_eq!(label.leader, None);
        assert!((label.place.center().x - tail.x).abs() < 1e-3, "{label:?}");
        assert!((label.place.top() - tail.y - 1.0).abs() < 1e-3, "{label:?}");
        // 3 m wide, across the way in, which is up: the water is below.
        let brackets = marks.brackets.iter().flatten().map(|at| at.round());
        let bracket_line: Vec<_> = brackets.collect();
        let [left, right] = [pos2(100.0, 280.0), pos2(220.0, 280.0)];
        let end = vec2(0.0, END);
        assert_eq!(bracket_line, [left + end, left, right, right + end]);
        assert!(marks.outlines.is_empty(), "it is no shore");
        let of_gone = marks_of(&shores, &[ShoreMark::Site(1)], None).brackets;
        assert!(of_gone.is_empty(), "it is not where another is now");
    }

    #[test]
    fn nearest_shore_and_site_are_always_labelled() {
        // All of them are within a label's size, the farther the larger and the better.
        let clusters = (1..=99_u8).map(|n| {
            let away_m = 1.0 + 0.01 * f32::from(n);
            cluster(n.into(), 100 * u32::from(n), [away_m, 0.0])
        });
        // Its middle is farther away than all others, and its edge is nearer: 0.3 m and 0.9 m are 1 and 3 cells.
        let mut reeds = cluster(100, 1, [2.4, 0.0]);
        reeds.outline = vec![(1, -1), (3, -1), (3, 1), (1, 1)];
        let clusters = clusters.chain([reeds]).collect();
        let sites = (1..).zip([1.38, 1.36, 1.2]).map(site).collect();
        let shores = Shores::gather(0.3, None, clusters, sites);
        let texts = texts(&marks_of(&shores, &[], Some([0.0, 0.0])));
        assert_eq!(texts[..2], ["100", "C"], "{texts:?}");
        assert!(!texts.contains(&"99".to_owned()), "the farthest: {texts:?}");
    }

    #[test]
    fn marked_then_nearest_then_best_and_largest_come_first() {
        let clusters = vec![
            cluster(1, 10, [3.0, 1.0]),
            cluster(2, 30, [1.0, 1.0]),
            cluster(3, 20, [2.0, 2.0]),
            // Nearest, but out of sight.
            cluster(4, 90, [0.0, 60.0]),
        ];
        let sites = [(1, -4.0), (2, 2.0)].map(site).to_vec();
        let shores = Shores::gather(0.3, None, clusters, sites);
        let order = |marked: &[ShoreMark], vehicle_m| texts(&marks_of(&shores, marked, vehicle_m));
        let at_2 = Some([1.0, 1.5]);
        assert_eq!(order(&[], at_2), ["2", "B", "3", "1", "A"]);
        assert_eq!(
            order(&[ShoreMark::Shore(1)], at_2),
            ["1", "2", "B", "3", "A"]
        );
        // The vehicle's position is unknown: the best site and the largest shore.
        assert_eq!(order(&[], None), ["A", "2", "B", "3", "1"]);
    }

    #[test]
    fn labels_of_unmarked_shores_can_be_switched_off() {
        let clusters = vec![cluster(1, 10, [1.0, 1.0]), cluster(2, 30, [-1.0, 1.0])];
        let shores = Shores::gather(0.3, None, clusters, vec![site((1, 2.0))]);
        let known = ShoreOutlines::of(&shores);
        let labelled = |marked: &[ShoreMark], labels_all| {
            let inputs = (&shores, known.outlines());
            let camera = Camera::on(screen());
            let marks = ShoreMarks::new(inputs, &camera, (marked, labels_all), None, &[]);
            assert_eq!(marks.arrows.len(), usize::from(labels_all));
            texts(&marks)
        };
        assert_eq!(labelled(&[], true), ["A", "2", "1"]);
        assert!(labelled(&[], false).is_empty());
        assert_eq!(labelled(&[ShoreMark::Shore(1)], false), ["1"]);
    }

    #[test]
    fn a_shore_that_is_partly_in_sight_has_a_label() {
        // From 8 m to 20 m in x: the screen ends at 5 m; and one that reaches from 3 m on.
        let reaching = |number, low: i32| ShoreCluster {
            outline: vec![(low, 0), (200, 0), (200, 20), (low, 20)],
            ..cluster(number, 10, [15.0, 1.0])
        };
        let clusters = vec![reaching(1, 80), reaching(2, 30)];
        let shores = Shores::gather(0.1, None, clusters, Vec::new());
        let marks = marks_of(&shores, &[], None);
        assert_eq!(texts(&marks), ["2"]);
        assert!(screen().contains_rect(marks.label_places()[0]), "{marks:?}");
    }
}
