//! Shores with numbers, docking sites with letters and an arrow.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};

use super::ShoreMark;
use super::camera::Camera;
use crate::model::{Outline, SiteName};
use crate::panels::shores::Distance;
use crate::theme;

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

type ShoreInputs<'a> = (&'a Shores, &'a [SiteName], &'a [Outline]);

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
        let (shores, names, _) = inputs;
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
            let extent = camera.line(&extent_m(shores, names, *mark));
            if extent.is_empty() {
                continue;
            }
            match mark {
                ShoreMark::Shore(_) => outlines.push(extent),
                ShoreMark::Site(name) => {
                    let site = site_of(shores, names, *name);
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
        let halo = Stroke::new(6.0, Color32::WHITE);
        let line = Stroke::new(3.0, theme::MARKED);
        // Halos first, so that none covers a line.
        for stroke in [halo, line] {
            for outline in &self.outlines {
                painter.add(Shape::closed_line(outline.clone(), stroke));
            }
            for bracket_line in &self.brackets {
                painter.add(Shape::line(bracket_line.clone(), stroke));
            }
        }
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
    /// Selected or hovered: placed first.
    is_marked: bool,
}

/// Visible labels: docking sites (best first), then shores (largest first). The distance is computed for visible ones
/// only, because there may be hundreds.
fn labels(
    (shores, names, outlines): ShoreInputs<'_>,
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
    let sites = shores.sites.iter().zip(names).filter_map(|(site, name)| {
        let distance = || Distance::of_site(site, vehicle_m).key();
        let (mark, heading_rad) = (ShoreMark::Site(*name), Some(site.heading_rad));
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

/// Shortest offset that moves a label off the vehicle.
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
        ShoreMark::Site(name) => name.to_string(),
    }
}

fn size(mark: ShoreMark) -> Vec2 {
    let character = match mark {
        ShoreMark::Shore(_) => FIGURE,
        ShoreMark::Site(_) => LETTER,
    };
    vec2(text(mark).len() as f32 * character, LINE) + 2.0 * PADDING
}

pub(super) fn is_listed(shores: &Shores, names: &[SiteName], mark: ShoreMark) -> bool {
    match mark {
        ShoreMark::Shore(number) => shores.clusters.iter().any(|shore| shore.number == number),
        ShoreMark::Site(name) => site_of(shores, names, name).is_some(),
    }
}

pub(super) fn extent_m(shores: &Shores, names: &[SiteName], marked: ShoreMark) -> Vec<[f64; 2]> {
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
mod tests;
