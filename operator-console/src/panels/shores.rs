//! Shores and docking sites: what stands along the water, how dense, how far away.

use eframe::egui::accesskit::Role;
use eframe::egui::{
    Align2, FontSelection, Rect, Response, RichText, ScrollArea, Sense, Ui, WidgetInfo, pos2, vec2,
};
use protocol::layer::{LayerId, Swatch};
use protocol::message::{DockingSite, ShoreCluster};
use protocol::shores::DOCKING_SITE_CODE;

use super::legend::{SWATCH, capitalised, paint_swatch};
use super::wording::{count, signed};
use crate::command::Look;
use crate::model::ConsoleModel;

const ROW_HEIGHT: f32 = 24.0;
/// The lists scroll beyond this: eight rows.
const LIST_HEIGHT: f32 = 192.0;
/// Where the columns are, as shares of the width: number, class, share, size, distance. Numbers end there.
const COLUMNS: [f32; 5] = [0.11, 0.14, 0.62, 0.81, 1.0];

/// What the panel shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoresData {
    /// Shores, by number.
    pub shores: Vec<ShoreRow>,
    /// Docking sites, the best first.
    pub sites: Vec<ShoreRow>,
    /// What else there is to say.
    pub notes: Vec<String>,
}

/// A shore or a docking site in one line.
#[derive(Clone, Debug, PartialEq)]
pub struct ShoreRow {
    /// Number of the shore, or rank of the site.
    pub number: String,
    /// Colour, pattern and name of what it is.
    pub class: Swatch,
    /// Share of rigid voxels, or mean slope cost.
    pub share: String,
    /// Voxels, or width.
    pub size: String,
    /// From the vehicle.
    pub distance: String,
    /// The whole row in words.
    pub sentence: String,
    /// Where it is in `odom`, metres.
    pub center_m: [f64; 2],
}

impl ShoresData {
    /// The shores as the robot tells of them; `None` for a robot that does not.
    pub fn new(model: &ConsoleModel) -> Option<Self> {
        if !model.has_shores() {
            return None;
        }
        let vehicle_m = model.vehicle().pose().map(|(pose, _)| {
            let [x, y, _] = pose.position_m;
            [x, y]
        });
        let Some(shores) = model.shores() else {
            return Some(Self {
                shores: Vec::new(),
                sites: Vec::new(),
                notes: vec!["Nothing was heard of shores yet.".to_owned()],
            });
        };
        let mut notes = Vec::new();
        if shores.clusters.is_empty() && shores.sites.is_empty() {
            notes.push("No shore in sight.".to_owned());
        }
        for (left_out, what) in [
            (shores.clusters_left_out, "smaller shores"),
            (shores.sites_left_out, "worse docking sites"),
        ] {
            if left_out > 0 {
                notes.push(format!("{} {what} are not listed.", count(left_out.into())));
            }
        }
        let sites = shores.sites.iter().zip(1..);
        Some(Self {
            shores: shores
                .clusters
                .iter()
                .map(|cluster| shore_row(cluster, vehicle_m))
                .collect(),
            sites: sites
                .map(|(site, rank)| site_row(site, rank, vehicle_m))
                .collect(),
            notes,
        })
    }
}

fn shore_row(cluster: &ShoreCluster, vehicle_m: Option<[f64; 2]>) -> ShoreRow {
    let center_m = cluster.center_m.map(f64::from);
    let distance = distance(center_m, vehicle_m);
    let share = format!("{:.0} %", 100.0 * cluster.ratio());
    let size = count(cluster.voxels.into());
    let (number, class) = (cluster.number, class_swatch(cluster.class.code()));
    ShoreRow {
        sentence: format!(
            "Shore {number}, {}, {share} rigid, {size} voxels, {distance} away",
            class.label
        ),
        number: number.to_string(),
        class,
        share,
        size,
        distance,
        center_m,
    }
}

fn site_row(site: &DockingSite, rank: usize, vehicle_m: Option<[f64; 2]>) -> ShoreRow {
    let center_m = site.center_m.map(f64::from);
    let distance = distance(center_m, vehicle_m);
    let share = format!("{:.2}", site.mean_cost);
    let size = format!("{} m", signed(site.width_m.into(), 1));
    ShoreRow {
        sentence: format!("Docking site {rank}, cost {share}, {size} wide, {distance} away"),
        number: rank.to_string(),
        class: class_swatch(DOCKING_SITE_CODE),
        share,
        size,
        distance,
        center_m,
    }
}

/// A class as the legend of the layer shows it.
fn class_swatch(code: u16) -> Swatch {
    let palette = LayerId::Shore.default_palette();
    let class = LayerId::Shore.classes().get(usize::from(code) - 1);
    Swatch {
        color: palette.color(code),
        pattern: palette.pattern(code),
        mark: palette.mark_color(code),
        label: class.map(|class| class.name.to_owned()).unwrap_or_default(),
    }
}

fn distance([x, y]: [f64; 2], vehicle_m: Option<[f64; 2]>) -> String {
    let Some([vehicle_x, vehicle_y]) = vehicle_m else {
        return "–".to_owned();
    };
    let distance_m = libm::hypot(x - vehicle_x, y - vehicle_y);
    let decimals = usize::from(distance_m < 9.95);
    format!("{distance_m:.decimals$} m")
}

/// Draws the panel; where to look when a row was clicked.
pub fn shores_ui(ui: &mut Ui, data: &ShoresData) -> Option<Look> {
    for note in &data.notes {
        ui.label(RichText::new(note).small());
    }
    let shores = list_ui(
        ui,
        "shores",
        ["No.", "Class", "Rigid", "Voxels", "Away"],
        &data.shores,
    );
    let sites = list_ui(
        ui,
        "docking sites",
        ["Rank", "", "Cost", "Width", "Away"],
        &data.sites,
    );
    shores.or(sites)
}

fn list_ui(ui: &mut Ui, id: &str, titles: [&str; 5], rows: &[ShoreRow]) -> Option<Look> {
    if rows.is_empty() {
        return None;
    }
    let (rect, _) = ui.allocate_exact_size(vec2(ui.available_width(), 16.0), Sense::hover());
    paint_columns(ui, rect, titles, true);
    let mut look = None;
    ui.scope(|ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        ScrollArea::vertical()
            .id_salt(id)
            .max_height(LIST_HEIGHT)
            .auto_shrink([false, true])
            .show_rows(ui, ROW_HEIGHT, rows.len(), |ui, shown| {
                for row in &rows[shown] {
                    if row_ui(ui, row).clicked() {
                        look = Some(Look::At(row.center_m));
                    }
                }
            });
    });
    look
}

fn row_ui(ui: &mut Ui, row: &ShoreRow) -> Response {
    let size = vec2(ui.available_width(), ROW_HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click());
    let info = || WidgetInfo::labeled(Role::Button, true, &row.sentence);
    response.widget_info(info);
    if response.hovered() || response.has_focus() {
        let fill = ui.visuals().widgets.hovered.weak_bg_fill;
        ui.painter().rect_filled(rect, 3.0, fill);
    }
    let at = pos2(column_x(rect, 1), rect.center().y - 0.5 * SWATCH.y);
    paint_swatch(ui, Rect::from_min_size(at, SWATCH), &row.class);
    let class = capitalised(&row.class.label);
    let ShoreRow {
        number,
        share,
        size,
        distance,
        ..
    } = row;
    paint_columns(ui, rect, [number, &class, share, size, distance], false);
    response.on_hover_text("Show it in the middle of the map")
}

fn column_x(rect: Rect, column: usize) -> f32 {
    rect.left() + COLUMNS[column] * rect.width()
}

fn paint_columns(ui: &Ui, rect: Rect, texts: [&str; 5], is_title: bool) {
    let color = if is_title {
        ui.visuals().weak_text_color()
    } else {
        ui.visuals().text_color()
    };
    let mut font = FontSelection::Default.resolve(ui.style());
    font.size = 13.0;
    for (column, text) in texts.into_iter().enumerate() {
        let (x, align) = if column == 1 {
            (column_x(rect, column) + SWATCH.x + 6.0, Align2::LEFT_CENTER)
        } else {
            (column_x(rect, column), Align2::RIGHT_CENTER)
        };
        ui.painter()
            .text(pos2(x, rect.center().y), align, text, font.clone(), color);
    }
}
