//! Shores by number where they are, and docking sites by letter, with an arrow that points in.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};

use super::super::camera::Camera;
use super::super::marking::ShoreMark;
use super::shore_labels::{self, Kind, Label};
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
    /// Numbers of shores that have a place, and where, the largest shores first.
    pub(in crate::map_view) numbers: Vec<(String, Pos2)>,
    /// Letters of docking sites that have a place, where, and where to: the best first.
    pub(in crate::map_view) sites: Vec<(String, Pos2, Vec2)>,
    /// Corners of the shore that stands out.
    pub(in crate::map_view) outline: Vec<Pos2>,
    /// The docking site that stands out: along the bank as far as it is wide, with an end on either side towards the
    /// water.
    pub(in crate::map_view) berth: Vec<Pos2>,
    /// What the labels cover, in the order in which they got their places.
    pub(in crate::map_view) labels: Vec<Rect>,
}

impl ShoreMarks {
    /// What `camera` sees of the shores, of which `marked` stands out. The names are those of the docking sites, in
    /// their order. The vehicle is there, metres in `odom`.
    pub(in crate::map_view) fn new(
        (shores, names): (&Shores, &[SiteName]),
        camera: &Camera,
        screen: Rect,
        marked: Option<ShoreMark>,
        vehicle_m: Option<[f64; 2]>,
    ) -> Self {
        let named = labelled((shores, names), marked, vehicle_m);
        let label = |named: &Named| Label {
            at: camera.to_screen(screen, named.center_m.map(f64::from)),
            ..named.label
        };
        let labels: Vec<_> = named.iter().map(label).collect();
        let vehicle = vehicle_m.map(|at_m| camera.to_screen(screen, at_m));
        let placed = shore_labels::placed(&labels, screen, vehicle);
        let covered = placed.iter().map(|(_, place)| *place).collect();
        let places: BTreeMap<_, _> = placed.into_iter().collect();
        let (mut numbers, mut sites) = (Vec::new(), Vec::new());
        for (index, named) in named.into_iter().enumerate() {
            let Some(at) = places.get(&index).map(Rect::center) else {
                continue;
            };
            match named.heading_rad {
                Some(heading_rad) => {
                    sites.push((named.text, at, camera.direction(f64::from(heading_rad))));
                }
                None => numbers.push((named.text, at)),
            }
        }
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
            labels: covered,
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

/// What wants a label.
struct Named {
    text: String,
    /// Metres in `odom`.
    center_m: [f32; 2],
    /// Where into a docking site leads; of a shore nothing.
    heading_rad: Option<f32>,
    /// Its place is not known yet.
    label: Label,
}

/// All of them: docking sites, the best first, then shores, the largest first.
fn labelled(
    (shores, names): (&Shores, &[SiteName]),
    marked: Option<ShoreMark>,
    vehicle_m: Option<[f64; 2]>,
) -> Vec<Named> {
    let label = |kind, text: &str, mark: ShoreMark, away_m: f64| {
        let character = match kind {
            Kind::Shore => FIGURE,
            Kind::Site => LETTER,
        };
        Label {
            kind,
            at: Pos2::ZERO,
            size: vec2(text.len() as f32 * character, LINE) + 2.0 * PADDING,
            away_m,
            is_marked: marked == Some(mark),
        }
    };
    let [clusters_m, sites_m] = shore_labels::away_m(shores, vehicle_m);
    let sites = shores.sites.iter().zip(names).zip(sites_m);
    let sites = sites.map(|((site, name), away_m)| {
        let text = name.to_string();
        Named {
            label: label(Kind::Site, &text, ShoreMark::Site(*name), away_m),
            text,
            center_m: site.center_m,
            heading_rad: Some(site.heading_rad),
        }
    });
    let mut clusters: Vec<_> = shores.clusters.iter().zip(clusters_m).collect();
    clusters.sort_by_key(|(cluster, _)| (Reverse(cluster.voxels), cluster.number));
    let clusters = clusters.into_iter().map(|(cluster, away_m)| {
        let text = cluster.number.to_string();
        Named {
            label: label(Kind::Shore, &text, ShoreMark::Shore(cluster.number), away_m),
            text,
            center_m: cluster.center_m,
            heading_rad: None,
        }
    });
    sites.chain(clusters).collect()
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
mod tests;
