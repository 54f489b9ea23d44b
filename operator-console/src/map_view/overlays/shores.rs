//! Shores with numbers, docking sites with letters and an arrow.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use eframe::egui::{
    Align2, Color32, FontId, Painter, Pos2, Rect, Shape, Stroke, StrokeKind, Vec2, vec2,
};
use protocol::message::{DockingSite, Shores};

use super::super::ShoreMark;
use super::super::camera::Camera;
use super::shore_labels::{self, Kind, Label};
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

/// Shores, names of docking sites, outlines of shores.
type ShoreInputs<'a> = (&'a Shores, &'a [SiteName], &'a [Outline]);

/// Marks in screen points.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::map_view) struct ShoreMarks {
    /// Placed numbers of shores, largest shores first.
    pub(in crate::map_view) numbers: Vec<(String, Pos2)>,
    /// Placed letters of docking sites with position and direction, best first.
    pub(in crate::map_view) sites: Vec<(String, Pos2, Vec2)>,
    /// Outlines of marked shores.
    pub(in crate::map_view) outlines: Vec<Vec<Pos2>>,
    /// Marked docking sites: a line along the bank with an end line at both sides.
    pub(in crate::map_view) brackets: Vec<Vec<Pos2>>,
    /// Areas of the labels in the order of placement.
    pub(in crate::map_view) labels: Vec<Rect>,
}

impl ShoreMarks {
    /// `marked`: selected and hovered; `vehicle_m`: position in `odom`, m.
    pub(in crate::map_view) fn new(
        inputs: ShoreInputs<'_>,
        camera: &Camera,
        screen: Rect,
        marked: &[ShoreMark],
        vehicle_m: Option<[f64; 2]>,
    ) -> Self {
        let (shores, names, _) = inputs;
        let named = labelled(inputs, (camera, screen), marked, vehicle_m);
        let labels: Vec<_> = named.iter().map(|named| named.label).collect();
        let vehicle = vehicle_m.map(|at_m| camera.to_screen(screen, at_m));
        let placed = shore_labels::placed(&labels, screen, vehicle);
        let covered = placed.iter().map(|(_, place)| *place).collect();
        let places: BTreeMap<_, _> = placed.into_iter().collect();
        let (mut numbers, mut sites) = (Vec::new(), Vec::new());
        for (index, named) in named.iter().enumerate() {
            let Some(at) = places.get(&index).map(Rect::center) else {
                continue;
            };
            match named.heading_rad {
                Some(heading_rad) => {
                    let towards = camera.direction(f64::from(heading_rad));
                    sites.push((text(named.mark), at, towards));
                }
                None => numbers.push((text(named.mark), at)),
            }
        }
        let (mut outlines, mut brackets) = (Vec::new(), Vec::new());
        for mark in marked {
            let extent = extent_m(shores, names, *mark).into_iter();
            let extent: Vec<_> = extent
                .map(|point_m| camera.to_screen(screen, point_m))
                .collect();
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
    pub(in crate::map_view) fn paint_ground(
        &self,
        painter: &Painter,
        ink: Color32,
        paper: Color32,
    ) {
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

struct LabelledShore {
    mark: ShoreMark,
    /// Direction of a docking site.
    heading_rad: Option<f32>,
    label: Label,
}

/// Visible labels: docking sites (best first), then shores (largest first). The distance is computed for visible ones
/// only, because there may be hundreds.
fn labelled(
    (shores, names, outlines): ShoreInputs<'_>,
    (camera, screen): (&Camera, Rect),
    marked: &[ShoreMark],
    vehicle_m: Option<[f64; 2]>,
) -> Vec<LabelledShore> {
    let vehicle = vehicle_m.map(|at_m| camera.to_screen(screen, at_m));
    let seen = |mark: ShoreMark, center_m: [f32; 2]| {
        let at = camera.to_screen(screen, center_m.map(f64::from));
        let place = (at, size(mark));
        shore_labels::is_in_sight(place, screen, vehicle).then_some(place)
    };
    let sites = shores.sites.iter().zip(names);
    let sites = sites.filter_map(|(site, name)| {
        let mark = ShoreMark::Site(*name);
        let (at, size) = seen(mark, site.center_m)?;
        let label = Label {
            kind: Kind::Site,
            at,
            size,
            away_m: Distance::of_site(site, vehicle_m).key(),
            is_marked: marked.contains(&mark),
        };
        Some(LabelledShore {
            mark,
            heading_rad: Some(site.heading_rad),
            label,
        })
    });
    let clusters = shores.clusters.iter().zip(outlines);
    let clusters = clusters.filter_map(|(cluster, outline)| {
        let mark = ShoreMark::Shore(cluster.number);
        let (at, size) = seen(mark, cluster.center_m)?;
        let label = Label {
            kind: Kind::Shore,
            at,
            size,
            away_m: Distance::of_shore(outline, vehicle_m).key(),
            is_marked: marked.contains(&mark),
        };
        let named = LabelledShore {
            mark,
            heading_rad: None,
            label,
        };
        Some(((Reverse(cluster.voxels), cluster.number), named))
    });
    let mut clusters: Vec<_> = clusters.collect();
    clusters.sort_by_key(|(size, _)| *size);
    let clusters = clusters.into_iter().map(|(_, named)| named);
    sites.chain(clusters).collect()
}

fn text(mark: ShoreMark) -> String {
    match mark {
        ShoreMark::Shore(number) => number.to_string(),
        ShoreMark::Site(name) => name.to_string(),
    }
}

/// Size of a label, points. It does not need the text.
fn size(mark: ShoreMark) -> Vec2 {
    let width = match mark {
        ShoreMark::Shore(number) => figures(number) as f32 * FIGURE,
        ShoreMark::Site(name) => name.letters() as f32 * LETTER,
    };
    vec2(width, LINE) + 2.0 * PADDING
}

fn figures(number: u32) -> u32 {
    number.checked_ilog10().unwrap_or_default() + 1
}

pub(in crate::map_view) fn is_listed(shores: &Shores, names: &[SiteName], mark: ShoreMark) -> bool {
    match mark {
        ShoreMark::Shore(number) => shores.clusters.iter().any(|shore| shore.number == number),
        ShoreMark::Site(name) => site_of(shores, names, name).is_some(),
    }
}

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

/// Arrow with a halo.
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
