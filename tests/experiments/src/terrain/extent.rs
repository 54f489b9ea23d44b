//! Where solids are, and where a map shows them.

use std::collections::BTreeMap;

use super::{Cell, TerrainWorld};
use mapping::elevation::CellClass;
use simulation::solid::{Shape, Solid};
use simulation::truth::GroundPlane;

/// How far in front of a surface a map may show it, metres: noise, and half a cell.
const BEFORE_M: f64 = 0.15;

/// Least and greatest coordinate of a solid along an axis of the world, metres.
pub(crate) fn extent_m(solid: &Solid, axis: usize) -> [f64; 2] {
    let centre_m = solid.world_from_solid.translation.vector[axis];
    let half_m = match solid.shape {
        Shape::Box { size_m } => {
            let rotation = solid.world_from_solid.rotation.to_rotation_matrix();
            (0..3)
                .map(|along| 0.5 * (rotation[(axis, along)] * size_m[along]).abs())
                .sum()
        }
        Shape::Cylinder { radius_m, .. } | Shape::Sphere { radius_m } => radius_m,
        Shape::Plane | Shape::Mesh(_) => f64::INFINITY,
    };
    [centre_m - half_m, centre_m + half_m]
}

/// Middle of the first obstacle cell along x that shows the front of a solid at most `late_m` behind where it
/// is, metres.
pub(crate) fn front_m(
    world: &TerrainWorld,
    map: &BTreeMap<Cell, CellClass>,
    solid: &Solid,
    late_m: f64,
) -> Option<f64> {
    let front_m = extent_m(solid, 0)[0];
    let [right_m, left_m] = extent_m(solid, 1);
    let first = world.cell_at([front_m - BEFORE_M, right_m]);
    let last = world.cell_at([front_m + late_m, left_m]);
    let mut columns = first[0]..=last[0];
    let column = columns
        .find(|&x| (first[1]..=last[1]).any(|y| map.get(&[x, y]) == Some(&CellClass::Obstacle)));
    column.map(|x| world.centre_m([x, 0])[0])
}

/// For every column of cells, the row of the first obstacle cell along y (`sign` 1) or against it (−1) that
/// shows a wall along x whose face is at `face_m`; columns where something else stands before the wall are
/// left out.
pub(crate) fn faces(
    world: &TerrainWorld,
    map: &BTreeMap<Cell, CellClass>,
    plane: &GroundPlane,
    face_m: f64,
    sign: i64,
) -> BTreeMap<i64, i64> {
    let face = world.cell_at([0.0, face_m])[1];
    let is_bare = |x: i64| {
        let before = (1..=FACE_CELLS).map(|n| [x, face - sign * n]);
        before
            .filter_map(|cell| world.verdict(cell, plane))
            .all(|verdict| !verdict.is_obstacle)
    };
    let mut faces: BTreeMap<i64, i64> = BTreeMap::new();
    for (&[x, y], class) in map {
        let is_near = (y - face).abs() <= FACE_CELLS;
        if is_near && *class == CellClass::Obstacle && is_bare(x) {
            let nearest = faces.entry(x).or_insert(y);
            if (y - *nearest) * sign < 0 {
                *nearest = y;
            }
        }
    }
    faces
}

/// How far from its true place a wall is looked for, cells.
const FACE_CELLS: i64 = 2;
