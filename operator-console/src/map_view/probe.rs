//! The probe: value, source and age of each layer at a point.
//!
//! The robot stamps tiles, not cells: the age is that of the newest change in the tile.

use std::time::Duration;

use eframe::egui::{Color32, Grid, Label, Painter, Pos2, RichText, Stroke, Ui, vec2};
use measurement::time::Monotonic;
use protocol::layer::{LayerId, Quantisation};
use protocol::message::{SensorFault, SensorInfo, SensorKind, SensorStatus};
use protocol::tile::TileKey;

use super::card_frame;
use super::chunks::TILE_CELLS;
use super::view_settings::LayerStack;
use crate::model::{ConsoleModel, MapSync};
use crate::panels::data_age::DataAge;
use crate::panels::data_age::StaleData;
use crate::panels::formatting::{age, count, signed};
use crate::panels::layers::layer_name;

#[derive(Clone, Debug, PartialEq)]
pub struct ProbeData {
    /// m in `odom`.
    pub point_m: [f64; 2],
    /// Topmost first: shown layers, and hidden ones with a value.
    pub cells: Vec<ProbedCell>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ProbedCell {
    pub layer: LayerId,
    /// Hidden layers are not updated.
    pub is_shown: bool,
    /// The value as exported; `None` if unknown.
    pub value: Option<f32>,
    /// Age of the newest change of the tile: the cell may be older.
    pub age: Option<DataAge>,
    pub revision: Option<u64>,
    /// Sensors of the layer and their faults; `None` if the robot names none.
    pub source: Option<String>,
}

impl ProbeData {
    pub fn new(
        model: &ConsoleModel,
        stack: &LayerStack,
        point_m: [f64; 2],
        now: Monotonic,
    ) -> Self {
        let map = model.map();
        let held = stack.layers().iter().rev();
        let cells = held.filter_map(|held| {
            let layer = held.layer;
            let cell_m = map.store().cell_m(layer)?;
            let tile = cell_at(layer, point_m, cell_m).and_then(|(key, _, _)| {
                let stored = map.store().get(key);
                let stored = stored.filter(|stored| stored.cells().is_some());
                stored.map(|stored| (key, stored.revision()))
            });
            let cell = ProbedCell {
                layer,
                is_shown: held.is_shown,
                value: value_at(map, layer, point_m),
                age: tile.map(|(key, _)| DataAge::new(model, key, now)),
                revision: tile.map(|(_, revision)| revision),
                source: source(model, layer, now),
            };
            (cell.is_shown || cell.value.is_some()).then_some(cell)
        });
        Self {
            point_m,
            cells: cells.collect(),
        }
    }

    /// Coordinates. Narrow cards break the line between x and y.
    pub fn place(&self) -> String {
        let [x, y] = self.point_m.map(|m| signed(m, 2));
        format!("x\u{a0}{x}\u{a0}m  y\u{a0}{y}\u{a0}m")
    }
}

impl ProbedCell {
    pub fn text(&self) -> String {
        let Some(value) = self.value else {
            return "unknown".to_owned();
        };
        match self.layer.quantisation() {
            Quantisation::Linear { .. } => match self.layer.unit() {
                Some(unit) => format!("{} {unit}", signed(f64::from(value), 3)),
                None => signed(f64::from(value), 2),
            },
            Quantisation::Classes(classes) => {
                let class = classes
                    .iter()
                    .find(|class| f32::from(class.value).to_bits() == value.to_bits());
                class.map_or_else(
                    || signed(f64::from(value), 0),
                    |class| class.name.to_owned(),
                )
            }
        }
    }

    pub fn reading(&self) -> String {
        let name = match self.layer {
            LayerId::Occupancy => "P(occupied)",
            LayerId::Elevation => "height",
            LayerId::Cost => "slope cost",
            LayerId::Intra => "IntraScan",
            LayerId::Inter => "InterScan",
            LayerId::Depth => "depth",
            LayerId::Obstacle | LayerId::Rigidity | LayerId::Shore => return self.text(),
        };
        format!("{name} {}", self.text())
    }

    /// Time of the tile's change, also if the cell is unknown.
    pub fn changed(&self) -> Option<String> {
        self.age.map(DataAge::moment)
    }

    pub fn origin(&self) -> String {
        let stage = match self.layer {
            LayerId::Occupancy => "laser, log-odds",
            LayerId::Elevation => "tilted laser, mean of hits",
            LayerId::Obstacle => "from elevation",
            LayerId::Cost => "voxels, slope around",
            LayerId::Rigidity => "voxels, scatter of beams",
            LayerId::Shore => "voxels, clusters",
            LayerId::Intra => "voxels, width within a scan",
            LayerId::Inter => "voxels, change between scans",
            LayerId::Depth => "sonar, shoalest hit that two pings agree on",
        };
        let parts = [
            self.changed(),
            // An unknown cell has no source.
            self.value
                .map(|_| self.source.clone().unwrap_or_else(|| stage.to_owned())),
            self.revision
                .map(|revision| format!("revision {}", count(revision))),
            (!self.is_shown).then(|| "hidden".to_owned()),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// Value at a point (m in `odom`) as exported; `None` if unknown.
pub(super) fn value_at(map: &MapSync, layer: LayerId, point_m: [f64; 2]) -> Option<f32> {
    let (key, column, row) = cell_at(layer, point_m, map.store().cell_m(layer)?)?;
    let code = map.store().get(key)?.cells()?.get(column, row)?;
    layer.quantisation().decode(code)
}

fn cell_at(layer: LayerId, point_m: [f64; 2], cell_m: f64) -> Option<(TileKey, usize, usize)> {
    let [cx, cy] = point_m.map(|m| (m / cell_m).floor() as i64);
    let key = TileKey::of_cell(layer, cx, cy)?;
    let within = |cell: i64| cell.rem_euclid(TILE_CELLS) as usize;
    Some((key, within(cx), within(cy)))
}

/// Further sensors are counted.
const MAX_NAMED: usize = 2;

/// The sensors of a layer; `None` if the robot names none.
pub(super) fn source(model: &ConsoleModel, layer: LayerId, now: Monotonic) -> Option<String> {
    let statuses = if model.reports_ended() || StaleData::new(model, now).is_some() {
        // The current state is unknown.
        &[]
    } else {
        model.sensor_statuses()
    };
    source_text(layer, model.sensors(), statuses, model.status_delay(now))
}

/// `since_update`: age of `statuses`.
fn source_text(
    layer: LayerId,
    sensors: &[SensorInfo],
    statuses: &[SensorStatus],
    since_update: Duration,
) -> Option<String> {
    let feeding = sensors.iter().filter(|sensor| feeds(sensor.kind, layer));
    let feeding: Vec<_> = feeding.collect();
    let names = feeding.iter().map(|sensor| sensor.name.clone());
    let mut names: Vec<_> = names.take(MAX_NAMED).collect();
    if feeding.len() > MAX_NAMED {
        names.push(format!("{} more", feeding.len() - MAX_NAMED));
    }
    let last = names.pop()?;
    let from = if names.is_empty() {
        format!("from {last}")
    } else {
        format!("from {} and {last}", names.join(", "))
    };
    // Faults are listed for all sensors, also for those that are only counted.
    let faults = feeding.iter().filter_map(|sensor| {
        let status = statuses.iter().find(|status| status.name == sensor.name)?;
        Some(fault_text(status, status.fault?, since_update))
    });
    let faults: Vec<_> = faults.collect();
    Some(if faults.is_empty() {
        from
    } else {
        format!("{from} ({})", faults.join(", "))
    })
}

/// Current fault of a sensor; `since_update`: age of its status.
fn fault_text(status: &SensorStatus, fault: SensorFault, since_update: Duration) -> String {
    let name = &status.name;
    match (fault, status.age_ms) {
        (SensorFault::Silent, Some(ms)) => {
            let since = Duration::from_millis(ms.into()).saturating_add(since_update);
            format!("{name} silent for {}", age(since))
        }
        (SensorFault::Silent, None) => format!("{name} silent from the start"),
        (SensorFault::Clock, _) => format!("{name}'s clock jumped"),
        (SensorFault::AllInvalid, _) => format!("{name} sees nothing now"),
        (SensorFault::Blocked, _) => format!("{name} blocked now"),
        (SensorFault::Slow, _) => format!("{name} slow now"),
    }
}

/// All range sensors feed all layers, except that a sonar has no metrics, that only a sonar measures in water, and
/// that ultrasound feeds obstacles only.
const fn feeds(kind: SensorKind, layer: LayerId) -> bool {
    match kind {
        SensorKind::PlanarLaser | SensorKind::TiltingLaser | SensorKind::Lidar => {
            !matches!(layer, LayerId::Depth)
        }
        SensorKind::Sonar => !matches!(layer, LayerId::Rigidity | LayerId::Intra | LayerId::Inter),
        SensorKind::Ultrasonic => matches!(layer, LayerId::Obstacle),
        _ => false,
    }
}

const INNER: f32 = 8.0;

/// Draws the card. Returns whether "Unpin" was pressed. A narrow card lists shown layers only, and has no sources.
pub(super) fn probe_card_ui(
    ui: &mut Ui,
    data: &ProbeData,
    is_pinned: bool,
    (width, is_narrow): (f32, bool),
) -> bool {
    let mut is_over = false;
    card_frame(ui, INNER).show(ui, |ui| {
        ui.set_max_width(width - 2.0 * INNER);
        ui.spacing_mut().item_spacing.y = 3.0;
        ui.horizontal(|ui| {
            let place = RichText::new(data.place()).strong();
            ui.label(if is_narrow { place.small() } else { place });
            if is_pinned {
                let unpin = ui.small_button("Unpin");
                is_over = unpin
                    .on_hover_text("Read under the pointer (Esc)")
                    .clicked();
            }
        });
        // The grid remembers its column widths by this id.
        let cells = data.cells.iter();
        let cells: Vec<_> = cells.filter(|cell| cell.is_shown || !is_narrow).collect();
        let layers: Vec<_> = cells.iter().map(|cell| cell.layer).collect();
        Grid::new(("probe", layers))
            .num_columns(3)
            .min_row_height(16.0)
            .spacing([10.0, 2.0])
            .show(ui, |ui| {
                let weak = ui.visuals().weak_text_color();
                // Always drawn, so that the height stays constant.
                if !cells.is_empty() {
                    head_ui(ui, weak);
                }
                for cell in cells {
                    let name = RichText::new(layer_name(cell.layer)).small();
                    let mut value = RichText::new(cell.text()).small().strong();
                    if cell.value.is_none() || !cell.is_shown {
                        value = value.color(weak);
                    }
                    ui.label(name);
                    ui.label(value);
                    let origin = if is_narrow {
                        cell.changed().unwrap_or_default()
                    } else {
                        cell.origin()
                    };
                    let origin = RichText::new(origin).small().color(weak);
                    ui.add(Label::new(origin).wrap());
                    ui.end_row();
                }
            });
    });
    is_over
}

fn head_ui(ui: &mut Ui, ink: Color32) {
    ui.small("");
    ui.small("");
    let head = RichText::new("Tile changed").small().color(ink);
    let hint = format!(
        "The newest change of the {TILE_CELLS} × {TILE_CELLS} cells around this one, which may be older itself"
    );
    ui.add(Label::new(head).wrap()).on_hover_text(hint);
    ui.end_row();
}

/// Mark of a pinned point: a cross with a gap in its middle.
pub(super) fn paint_pin(painter: &Painter, at: Pos2) {
    for (width, color) in [(4.0, Color32::WHITE), (2.0, Color32::BLACK)] {
        for [x, y] in [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]] {
            let towards = vec2(x, y);
            let ends = [at + 4.0 * towards, at + 12.0 * towards];
            painter.line_segment(ends, Stroke::new(width, color));
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
