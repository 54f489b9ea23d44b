//! What the map says under the cursor, and how old that is.

use std::time::Duration;

use protocol::layer::{LayerId, Quantisation};
use protocol::tile::TileKey;
use robot_edge::clock::Monotonic;

use super::chunks::TILE_CELLS;
use crate::model::MapSync;
use crate::panels::wording::{age, signed};

/// One point of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct ProbeData {
    /// Where, metres in `odom`.
    pub point_m: [f64; 2],
    /// What is there, with its unit.
    pub value: String,
    /// Since the cells around it last changed; `None` where nothing is known.
    pub age: Option<Duration>,
}

impl ProbeData {
    /// Reads `layer` at a point.
    pub fn new(map: &MapSync, layer: LayerId, point_m: [f64; 2], now: Monotonic) -> Self {
        let key = map
            .store()
            .cell_m(layer)
            .and_then(|cell_m| cell_at(layer, point_m, cell_m));
        let Some((key, column, row)) = key else {
            return Self {
                point_m,
                value: "nothing is known here".to_owned(),
                age: None,
            };
        };
        let cells = map.store().get(key).and_then(|stored| stored.cells());
        let code = cells.and_then(|cells| cells.get(column, row));
        Self {
            point_m,
            value: code
                .and_then(|code| value(layer, code))
                .unwrap_or_else(|| "unknown".to_owned()),
            age: cells
                .and_then(|_known| map.changed_at(key))
                .map(|at| now.since(at)),
        }
    }

    /// In one line.
    pub fn line(&self) -> String {
        let [x, y] = self.point_m.map(|m| signed(m, 2));
        let age = match self.age {
            Some(since) => format!("  ·  changed {} ago", age(since)),
            None => String::new(),
        };
        format!("x {x} m  y {y} m  ·  {}{age}", self.value)
    }
}

/// The tile, column and row that hold a point.
fn cell_at(layer: LayerId, point_m: [f64; 2], cell_m: f64) -> Option<(TileKey, usize, usize)> {
    let [cx, cy] = point_m.map(|m| (m / cell_m).floor() as i64);
    let key = TileKey::of_cell(layer, cx, cy)?;
    let within = |cell: i64| cell.rem_euclid(TILE_CELLS) as usize;
    Some((key, within(cx), within(cy)))
}

/// The value of a code as it is shown; `None` for unknown.
fn value(layer: LayerId, code: u16) -> Option<String> {
    let value = layer.quantisation().decode(code)?;
    Some(match layer.quantisation() {
        Quantisation::Linear { .. } => {
            let name = match layer {
                LayerId::Occupancy => "P(occupied)",
                LayerId::Elevation => "height",
                LayerId::Cost => "slope cost",
                LayerId::Obstacle | LayerId::Rigidity | LayerId::Shore => layer.name(),
            };
            let decimals = if layer.unit().is_some() { 3 } else { 2 };
            let number = signed(f64::from(value), decimals);
            match layer.unit() {
                Some(unit) => format!("{name} {number} {unit}"),
                None => format!("{name} {number}"),
            }
        }
        Quantisation::Classes(classes) => classes[usize::from(code) - 1].name.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_in_the_cells_that_cover_them() {
        let check = |point_m, expected| {
            let (key, column, row) = cell_at(LayerId::Cost, point_m, 0.1).unwrap();
            assert_eq!((key.tx, key.ty, column, row), expected);
        };
        check([0.05, 6.45], (0, 1, 0, 0));
        check([-0.01, -6.41], (-1, -2, 63, 63));
        check([-6.35, 0.11], (-1, 0, 0, 1));
        for far in [f64::MAX, f64::INFINITY] {
            assert_eq!(cell_at(LayerId::Cost, [far, 0.0], 0.1), None);
        }
    }

    #[test]
    fn values_have_units_or_names() {
        let check = |layer: LayerId, number: f32, expected: &str| {
            let code = layer.quantisation().encode(number);
            assert_eq!(value(layer, code).as_deref(), Some(expected));
        };
        check(LayerId::Elevation, -0.125, "height −0.125 m");
        check(LayerId::Occupancy, 0.9, "P(occupied) 0.90");
        check(LayerId::Cost, 0.5, "slope cost 0.50");
        check(LayerId::Obstacle, 1.0, "obstacle");
        check(LayerId::Shore, 4.0, "docking site");
        assert_eq!(value(LayerId::Shore, 0), None);
    }

    #[test]
    fn the_line_says_where_what_and_when() {
        let probe = ProbeData {
            point_m: [1.234, -5.0],
            value: "obstacle".to_owned(),
            age: Some(Duration::from_millis(3_240)),
        };
        assert_eq!(
            probe.line(),
            "x 1.23 m  y −5.00 m  ·  obstacle  ·  changed 3.2 s ago"
        );
    }
}
