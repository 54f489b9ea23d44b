//! Shores by number where they are, and docking sites by letter, with an arrow that points in.

use std::cmp::Reverse;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};

use super::super::camera::Camera;
use super::super::marking::ShoreMark;
use super::vehicle;
use crate::model::SiteName;
use crate::theme;

const FONT: f32 = 13.0;
const PADDING: Vec2 = vec2(5.0, 2.0);
/// Room for each figure and each capital letter of a label, whatever the font makes of them.
const FIGURE: f32 = 8.0;
const LETTER: f32 = 12.0;
const LINE: f32 = 17.0;
/// From the label of a docking site to the tip of its arrow, points.
const ARROW: f32 = 30.0;
const HEAD: f32 = 9.0;
/// From the ends of a marked docking site towards the water, points.
const END: f32 = 12.0;

/// What is to be drawn, in points.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::map_view) struct ShoreMarks {
    /// Numbers of shores and where, the largest shores first; those that would lie on one another, or on what stands out,
    /// are left out.
    pub(in crate::map_view) numbers: Vec<(String, Pos2)>,
    /// Letters of docking sites, where, and where to: the best first.
    pub(in crate::map_view) sites: Vec<(String, Pos2, Vec2)>,
    /// Corners of the shore that stands out.
    pub(in crate::map_view) outline: Vec<Pos2>,
    /// The docking site that stands out: along the bank as far as it is wide, with an end on either side towards the
    /// water.
    pub(in crate::map_view) berth: Vec<Pos2>,
    /// What the labels cover.
    pub(in crate::map_view) labels: Vec<Rect>,
}

impl ShoreMarks {
    /// What `camera` sees of the shores, of which `marked` stands out. The names are those of the docking sites, in
    /// their order. Labels stand beside the vehicle, where that is on the screen.
    pub(in crate::map_view) fn new(
        (shores, names): (&Shores, &[SiteName]),
        camera: &Camera,
        screen: Rect,
        marked: Option<ShoreMark>,
        vehicle: Option<Pos2>,
    ) -> Self {
        let mut taken: Vec<Rect> = Vec::new();
        let mut place = |text: &str, character: f32, center_m: [f32; 2]| {
            let at = camera.to_screen(screen, center_m.map(f64::from));
            let size = vec2(text.len() as f32 * character, LINE) + 2.0 * PADDING;
            let at = at + aside(at, size, vehicle);
            let rect = Rect::from_center_size(at, size);
            let is_free =
                screen.intersects(rect) && taken.iter().all(|other| !other.intersects(rect));
            is_free.then(|| {
                taken.push(rect);
                at
            })
        };
        // What stands out is labelled whatever else is there.
        let marked_at = match marked {
            Some(ShoreMark::Shore(number)) => {
                let mut clusters = shores.clusters.iter();
                let shore = clusters.find(|shore| shore.number == number);
                shore.and_then(|shore| place(&number.to_string(), FIGURE, shore.center_m))
            }
            Some(ShoreMark::Site(marked)) => {
                let mut named = shores.sites.iter().zip(names);
                let site = named.find(|(_, name)| **name == marked);
                site.and_then(|(site, name)| place(&name.to_string(), LETTER, site.center_m))
            }
            None => None,
        };
        let sites = shores.sites.iter().zip(names).filter_map(|(site, name)| {
            let text = name.to_string();
            let at = if marked == Some(ShoreMark::Site(*name)) {
                marked_at?
            } else {
                place(&text, LETTER, site.center_m)?
            };
            Some((text, at, camera.direction(f64::from(site.heading_rad))))
        });
        let sites = sites.collect();
        let mut clusters: Vec<_> = shores.clusters.iter().collect();
        clusters.sort_by_key(|cluster| (Reverse(cluster.voxels), cluster.number));
        let numbers = clusters.into_iter().filter_map(|cluster| {
            let text = cluster.number.to_string();
            let at = if marked == Some(ShoreMark::Shore(cluster.number)) {
                marked_at?
            } else {
                place(&text, FIGURE, cluster.center_m)?
            };
            Some((text, at))
        });
        let numbers = numbers.collect();
        let extent_m = marked.map(|marked| extent_m(shores, names, marked));
        let extent = extent_m.unwrap_or_default().into_iter();
        let extent: Vec<_> = extent
            .map(|point_m| camera.to_screen(screen, point_m))
            .collect();
        let (outline, berth) = match marked {
            None | Some(ShoreMark::Shore(_)) => (extent, Vec::new()),
            Some(ShoreMark::Site(marked)) => {
                let site = site_of(shores, names, marked);
                let towards = site.map(|site| camera.direction(f64::from(site.heading_rad)));
                (Vec::new(), bracket(&extent, towards.unwrap_or_default()))
            }
        };
        Self {
            numbers,
            sites,
            outline,
            berth,
            labels: taken,
        }
    }

    /// Draws what lies below the vehicle: what stands out, and the arrows of docking sites.
    pub(in crate::map_view) fn paint_ground(
        &self,
        painter: &Painter,
        ink: Color32,
        paper: Color32,
    ) {
        let halo = Stroke::new(6.0, Color32::WHITE);
        let line = Stroke::new(3.0, theme::MARKED);
        if !self.outline.is_empty() {
            painter.add(Shape::closed_line(self.outline.clone(), halo));
            painter.add(Shape::closed_line(self.outline.clone(), line));
        }
        if !self.berth.is_empty() {
            painter.add(Shape::line(self.berth.clone(), halo));
            painter.add(Shape::line(self.berth.clone(), line));
        }
        for (_, at, towards) in &self.sites {
            paint_arrow(painter, *at, *towards, ink, paper);
        }
    }

    /// Draws the labels, which nobody could read below a scan or the way of the vehicle: numbers on cards, letters in
    /// inverse colours, so that neither is taken for the other.
    pub(in crate::map_view) fn paint_labels(
        &self,
        painter: &Painter,
        ink: Color32,
        paper: Color32,
    ) {
        for (text, at) in &self.numbers {
            paint_label(painter, *at, text, ink, paper);
        }
        for (text, at, _) in &self.sites {
            paint_label(painter, *at, text, paper.to_opaque(), ink);
        }
    }
}

/// Where what is marked reaches to, metres in `odom`: corners of a shore, ends of a docking site; none where it is
/// gone.
pub(in crate::map_view) fn extent_m(
    shores: &Shores,
    names: &[SiteName],
    marked: ShoreMark,
) -> Vec<[f64; 2]> {
    match marked {
        ShoreMark::Shore(number) => {
            let shore = shores.clusters.iter().find(|shore| shore.number == number);
            let corners_m = shore.map(|shore| shore.corners_m(shores.cell_m).collect());
            corners_m.unwrap_or_default()
        }
        ShoreMark::Site(marked) => {
            let site = site_of(shores, names, marked);
            site.map(ends_m).into_iter().flatten().collect()
        }
    }
}

fn site_of<'a>(
    shores: &'a Shores,
    names: &[SiteName],
    marked: SiteName,
) -> Option<&'a DockingSite> {
    let mut named = shores.sites.iter().zip(names);
    named
        .find(|(_, name)| **name == marked)
        .map(|(site, _)| site)
}

/// The ends of a docking site along the bank, metres in `odom`. How far in it reaches is not told.
fn ends_m(site: &DockingSite) -> [[f64; 2]; 2] {
    let [x, y] = site.center_m.map(f64::from);
    let (sin, cos) = libm::sincos(f64::from(site.heading_rad));
    let half_m = 0.5 * f64::from(site.width_m);
    [half_m, -half_m].map(|left_m| [x - left_m * sin, y + left_m * cos])
}

/// A line between two points with an end on either side against `towards`; nothing where there are not two.
fn bracket(ends: &[Pos2], towards: Vec2) -> Vec<Pos2> {
    let [left, right] = *ends else {
        return Vec::new();
    };
    let to_water = -END * towards;
    vec![left + to_water, left, right, right + to_water]
}

/// How far a label of this size that would lie on the vehicle moves to lie beside it: the shortest way to a side, or
/// up or down.
fn aside(at: Pos2, size: Vec2, vehicle: Option<Pos2>) -> Vec2 {
    let Some(vehicle_at) = vehicle else {
        return Vec2::ZERO;
    };
    let way = at - vehicle_at;
    let lacks = 0.5 * (size + Vec2::splat(vehicle::ARROW)) - way.abs();
    if lacks.min_elem() <= 0.0 {
        Vec2::ZERO
    } else if lacks.x < lacks.y {
        vec2(lacks.x.copysign(way.x), 0.0)
    } else {
        vec2(0.0, lacks.y.copysign(way.y))
    }
}

fn paint_label(painter: &Painter, at: Pos2, text: &str, ink: Color32, paper: Color32) {
    let text = painter.layout_no_wrap(text.to_owned(), FontId::proportional(FONT), ink);
    let place = Align2::CENTER_CENTER.anchor_size(at, text.size());
    let card = place.expand2(PADDING);
    painter.rect_filled(card, 4.0, paper);
    painter.rect_stroke(card, 4.0, Stroke::new(1.0, ink), StrokeKind::Inside);
    painter.galley(place.min, text, ink);
}

/// An arrow from `at` on, with a halo that stands out on any map.
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
        // 40 points a metre: 1 and 2 would overlap, 4 is out of sight.
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
        assert_eq!(numbers, [("2", [244.0, 160.0]), ("3", [80.0, 120.0])]);
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
        // What was left out for a larger one is there while it stands out.
        let mark = Some(ShoreMark::Shore(1));
        let marks = ShoreMarks::new((&shores, &named), &camera, screen, mark, None);
        let numbers: Vec<_> = marks.numbers.iter().map(|(text, _)| &**text).collect();
        assert_eq!(numbers, ["3", "1"]);
    }

    #[test]
    fn a_label_stands_beside_the_vehicle_and_nowhere_else_otherwise() {
        let screen = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 400.0));
        let shores = Shores::gather(0.3, None, vec![cluster(1, 10, [1.0, 1.0])], Vec::new());
        let label_at = |vehicle_at: Pos2| {
            let vehicle = Some(vehicle_at);
            let marks = ShoreMarks::new((&shores, &[]), &Camera::default(), screen, None, vehicle);
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
}
