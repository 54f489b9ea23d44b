//! What lies straight ahead of the vehicle on the map: the first obstacle, and where the map ends.
//!
//! It answers "what could it hit next" at a glance, also when nobody drives. The collision monitor of the robot knows
//! more, and decides.

use protocol::layer::LayerId;

use super::probe::value_at;
use crate::model::{ConsoleModel, MapSync};

/// How far is looked, m.
const REACH_M: f64 = 20.0;
/// Slower motion counts as standing, m/s: then ahead is where the front points.
const STANDING_MPS: f64 = 0.02;
/// Occupied above this probability.
const OCCUPIED: f32 = 0.65;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ahead {
    /// The first obstacle: its place, m in `odom`, and its distance from the vehicle's edge, m.
    pub obstacle: Option<([f64; 2], f64)>,
    /// Distance before that from which more than half of the vehicle's width is unknown, m.
    pub unknown_from_m: Option<f64>,
}

impl Ahead {
    /// `None` without pose, size or a layer that shows obstacles.
    pub fn new(model: &ConsoleModel) -> Option<Self> {
        let (pose, _) = model.vehicle().pose()?;
        let heading_rad = model.vehicle().heading_rad()?;
        let info = model.info()?;
        let [length_m, width_m] = info.footprint_m.map(f64::from);
        let [speed_mps, lateral_mps] = [pose.speed_mps, pose.lateral_mps].map(f64::from);
        let is_moving = libm::hypot(speed_mps, lateral_mps) >= STANDING_MPS;
        let way_rad = if is_moving {
            libm::atan2(lateral_mps, speed_mps)
        } else {
            0.0
        };
        // The footprint is a rectangle along the heading: its half extents along the way, and across.
        let (sin, cos) = libm::sincos(way_rad);
        let half =
            |along: f64, across: f64| 0.5 * (length_m * along.abs() + width_m * across.abs());
        let (half_length_m, half_width_m) = (half(cos, sin), half(sin, cos));
        let (heading_sin, heading_cos) = libm::sincos(heading_rad);
        let offset_m = f64::from(info.footprint_offset_m);
        let [x_m, y_m, _] = pose.position_m;
        let middle_m = [x_m + offset_m * heading_cos, y_m + offset_m * heading_sin];
        let (sin, cos) = libm::sincos(heading_rad + way_rad);
        let place = |along_m: f64, across_m: f64| {
            [
                middle_m[0] + along_m * cos - across_m * sin,
                middle_m[1] + along_m * sin + across_m * cos,
            ]
        };
        let map = model.map();
        let layers = [LayerId::Obstacle, LayerId::Cost, LayerId::Occupancy];
        let cells = layers.iter().filter_map(|layer| map.store().cell_m(*layer));
        let step_m = 0.5 * cells.min_by(f64::total_cmp)?;
        let steps = |length_m: f64| (length_m / step_m).ceil().clamp(1.0, 1_000.0) as u32;
        let columns = steps(2.0 * half_width_m);
        let mut ahead = Self::default();
        for row in 0..steps(REACH_M) {
            let distance_m = f64::from(row) * step_m;
            let mut unknown = 0;
            for column in 0..=columns {
                let across_m = half_width_m * (2.0 * f64::from(column) / f64::from(columns) - 1.0);
                let point_m = place(half_length_m + distance_m, across_m);
                match is_obstacle(map, point_m) {
                    Some(true) => {
                        ahead.obstacle = Some((point_m, distance_m));
                        return Some(ahead);
                    }
                    Some(false) => {}
                    None => unknown += 1,
                }
            }
            if 2 * unknown > columns {
                ahead.unknown_from_m.get_or_insert(distance_m);
            }
        }
        Some(ahead)
    }

    pub fn text(self) -> String {
        match (self.obstacle, self.unknown_from_m) {
            (Some((_, at_m)), None) => format!("Obstacle {at_m:.1} m ahead"),
            (Some((_, at_m)), Some(from_m)) => {
                format!("Obstacle {at_m:.1} m ahead, not mapped from {from_m:.1} m")
            }
            (None, Some(from_m)) => format!("Not mapped ahead, from {from_m:.1} m"),
            (None, None) => format!("Free for {REACH_M:.0} m ahead"),
        }
    }
}

/// `None` where no layer knows the point.
fn is_obstacle(map: &MapSync, point_m: [f64; 2]) -> Option<bool> {
    let lethal = [
        (LayerId::Obstacle, 1.0),
        (LayerId::Cost, 1.0),
        (LayerId::Occupancy, OCCUPIED),
    ];
    let known = lethal
        .iter()
        .filter_map(|&(layer, least)| Some(value_at(map, layer, point_m)? >= least));
    known.max()
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::layer::UNKNOWN;
    use protocol::message::Pose;

    use super::super::probe::tests::model_of;
    use super::super::tests::publish;
    use super::*;
    use crate::test_support::{at, inject, pose_at_rest, store_of};

    const FREE: u16 = 1;
    const OBSTACLE: u16 = 2;

    /// A vehicle of 1 × 1 m at (1.0, 3.2) along x, in cells of 0.1 m whose code is given by column and row; tiles have
    /// 64 × 64 cells.
    fn ahead(pose: Pose, code: impl Fn(usize, usize) -> u16 + Copy) -> Option<Ahead> {
        let mut store = store_of(&[LayerId::Obstacle]);
        publish(&mut store, LayerId::Obstacle, (0, 0), code);
        for tile in 1..5 {
            publish(&mut store, LayerId::Obstacle, (tile, 0), |_, _| FREE);
        }
        let mut model = model_of(&store);
        let pose = Pose {
            position_m: [1.0, 3.2, 0.0],
            ..pose
        };
        inject(&mut model, Topic::Pose, &pose, at(2_000));
        Ahead::new(&model)
    }

    fn moving(speed_mps: f32, lateral_mps: f32) -> Pose {
        Pose {
            speed_mps,
            lateral_mps,
            ..pose_at_rest()
        }
    }

    #[test]
    fn the_first_obstacle_on_the_way_counts() {
        // One cell 1.6 m before the front, at the side, and one behind.
        let code = |column: usize, row: usize| match (column, row) {
            (31, 36) | (2, 30) => OBSTACLE,
            _ => FREE,
        };
        let texts = [(0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3)].map(|(x, y)| {
            let found = ahead(moving(x, y), code).unwrap();
            (
                found.text(),
                found.obstacle.map(|([x, _], _)| (x * 10.0).floor()),
            )
        });
        let first = ("Obstacle 1.6 m ahead".to_owned(), Some(31.0));
        assert_eq!(texts[..2], [first.clone(), first]);
        assert_eq!(texts[2].0, "Obstacle 0.2 m ahead", "backwards");
        assert_eq!(texts[3].0, "Not mapped ahead, from 2.7 m", "to the left");
        let beside = |column: usize, row: usize| {
            if column == 31 && !(26..38).contains(&row) {
                OBSTACLE
            } else {
                FREE
            }
        };
        assert_eq!(
            ahead(moving(0.3, 0.0), beside).unwrap().text(),
            "Free for 20 m ahead"
        );
    }

    #[test]
    fn where_the_map_ends_is_said_and_what_lies_behind() {
        let strip = |obstacle: u16| {
            move |column: usize, _: usize| match column {
                20..30 => UNKNOWN,
                40 => obstacle,
                _ => FREE,
            }
        };
        let text = |code: u16| ahead(moving(0.3, 0.0), strip(code)).unwrap().text();
        assert_eq!(
            text(OBSTACLE),
            "Obstacle 2.5 m ahead, not mapped from 0.5 m"
        );
        assert_eq!(text(FREE), "Not mapped ahead, from 0.5 m");
        // Single unknown cells are no end of the map.
        let sieve = |column: usize, row: usize| {
            if (column + row).is_multiple_of(3) {
                UNKNOWN
            } else {
                FREE
            }
        };
        assert_eq!(
            ahead(moving(0.3, 0.0), sieve).unwrap().text(),
            "Free for 20 m ahead"
        );
    }
}
