//! What the map says at a point: every layer's value, where it comes from, and how old the newest of its tile is.
//!
//! A robot stamps tiles, not cells: a cell that was seen long ago has the age of whatever changed last beside it.

use measurement::time::Monotonic;
use protocol::layer::{LayerId, Quantisation};
use protocol::tile::TileKey;

use super::chunks::TILE_CELLS;
use super::layer_stack::LayerStack;
use super::probe_source;
use crate::model::{ConsoleModel, MapSync};
use crate::panels::data_age::DataAge;
use crate::panels::formatting::{count, signed};

/// One point of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeData {
    /// Where, metres in `odom`.
    pub point_m: [f64; 2],
    /// What is there, the uppermost layer first: every layer that is shown, and those that are not but were received.
    pub cells: Vec<ProbedCell>,
}

/// What one layer says.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbedCell {
    /// Which layer.
    pub layer: LayerId,
    /// Whether it is drawn. What is not drawn is not kept up to date either.
    pub is_shown: bool,
    /// The cell's value as exports have it; `None` where it is unknown.
    pub value: Option<f32>,
    /// How old the newest change of its tile is: no cell of that is newer, most may be older. `None` where there is no
    /// tile.
    pub age: Option<DataAge>,
    /// The revision of the tile around it; `None` where there is none.
    pub revision: Option<u64>,
    /// The sensors that it comes from, and what is wrong with them now; `None` where the robot names none.
    pub source: Option<String>,
}

impl ProbeData {
    /// Reads the map at a point.
    pub fn new(
        model: &ConsoleModel,
        stack: &LayerStack,
        point_m: [f64; 2],
        now: Monotonic,
    ) -> Self {
        let map = model.map();
        let held = stack.layers().iter().rev();
        let cells = held.filter_map(|held| {
            let cell_m = map.store().cell_m(held.layer)?;
            let cell = ProbedCell::new(model, held.layer, cell_m, point_m, now);
            let cell = ProbedCell {
                is_shown: held.is_shown,
                source: probe_source::source(model, held.layer, now),
                ..cell
            };
            (cell.is_shown || cell.value.is_some()).then_some(cell)
        });
        Self {
            point_m,
            cells: cells.collect(),
        }
    }

    /// Where it is. In a narrow card a line ends between x and y, not within them.
    pub fn place(&self) -> String {
        let [x, y] = self.point_m.map(|m| signed(m, 2));
        format!("x\u{a0}{x}\u{a0}m  y\u{a0}{y}\u{a0}m")
    }
}

impl ProbedCell {
    fn new(
        model: &ConsoleModel,
        layer: LayerId,
        cell_m: f64,
        point_m: [f64; 2],
        now: Monotonic,
    ) -> Self {
        let map = model.map();
        let tile = cell_at(layer, point_m, cell_m).and_then(|(key, _, _)| {
            let stored = map.store().get(key);
            let stored = stored.filter(|stored| stored.cells().is_some());
            stored.map(|stored| (key, stored.revision()))
        });
        Self {
            layer,
            is_shown: true,
            value: value_at(map, layer, point_m),
            age: tile.map(|(key, _)| DataAge::new(model, key, now)),
            revision: tile.map(|(_, revision)| revision),
            source: None,
        }
    }

    /// The value with its unit, or the class by name.
    pub fn text(&self) -> String {
        let Some(value) = self.value else {
            return "unknown".to_owned();
        };
        match self.layer.quantisation() {
            Quantisation::Linear { .. } => {
                let decimals = if self.layer.unit().is_some() { 3 } else { 2 };
                let number = signed(f64::from(value), decimals);
                match self.layer.unit() {
                    Some(unit) => format!("{number} {unit}"),
                    None => number,
                }
            }
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

    /// What the value is of, and the value.
    pub fn reading(&self) -> String {
        let name = match self.layer {
            LayerId::Occupancy => "P(occupied)",
            LayerId::Elevation => "height",
            LayerId::Cost => "slope cost",
            LayerId::Obstacle | LayerId::Rigidity | LayerId::Shore => return self.text(),
        };
        format!("{name} {}", self.text())
    }

    /// When its tile changed, in words that follow that: also where the cell is unknown. `None` where there is no tile.
    pub fn changed(&self) -> Option<String> {
        self.age.map(DataAge::moment)
    }

    /// When its tile changed, and what it comes from: sensors, else the stage of the mapping; and which revision of its
    /// tile.
    pub fn origin(&self) -> String {
        let stage = match self.layer {
            LayerId::Occupancy => "laser, log-odds",
            LayerId::Elevation => "tilted laser, mean of hits",
            LayerId::Obstacle => "from elevation",
            LayerId::Cost => "voxels, slope around",
            LayerId::Rigidity => "voxels, scatter of beams",
            LayerId::Shore => "voxels, clusters",
        };
        let parts = [
            self.changed(),
            // Where nothing is known, it comes from nothing.
            self.value
                .map(|_| self.source.clone().unwrap_or_else(|| stage.to_owned())),
            self.revision
                .map(|revision| format!("revision {}", count(revision))),
            (!self.is_shown).then(|| "hidden".to_owned()),
        ];
        parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// The value of a layer at a point (metres in `odom`), as exports have it; `None` where it is unknown.
pub(super) fn value_at(map: &MapSync, layer: LayerId, point_m: [f64; 2]) -> Option<f32> {
    let (key, column, row) = cell_at(layer, point_m, map.store().cell_m(layer)?)?;
    let code = map.store().get(key)?.cells()?.get(column, row)?;
    layer.quantisation().decode(code)
}

/// The tile, column and row that hold a point.
fn cell_at(layer: LayerId, point_m: [f64; 2], cell_m: f64) -> Option<(TileKey, usize, usize)> {
    let [cx, cy] = point_m.map(|m| (m / cell_m).floor() as i64);
    let key = TileKey::of_cell(layer, cx, cy)?;
    let within = |cell: i64| cell.rem_euclid(TILE_CELLS) as usize;
    Some((key, within(cx), within(cy)))
}

#[cfg(test)]
pub(super) mod tests;
