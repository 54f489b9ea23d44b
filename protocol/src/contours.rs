//! Depth contours: lines of equal depth through the layer [`Depth`](LayerId::Depth), by marching
//! squares between the centres of cells.
//!
//! A corner is the mean of the known cells among its 3 × 3, so that the noise of single cells draws
//! no islands. There is no line where a corner is unknown.

use std::collections::{BTreeMap, BTreeSet};

use crate::layer::LayerId;
use crate::mosaic::Raster;
use crate::tile::{SIDE, TILE_SIDE, TileCells};

/// Depths of the lines, metres: spaced by 0.5, 1, 2, 5, … the deeper the wider, as on charts.
pub const CONTOUR_DEPTHS_M: [f32; 20] = [
    0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 75.0,
    100.0, 150.0, 200.0,
];

/// A piece of a line between two edges of a square of cell centres, with the deeper water on its
/// left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContourPiece {
    /// Metres.
    pub depth_m: f32,
    /// In cells: the centre of cell (x, y) is at (x + 0.5, y + 0.5).
    pub ends: [[f64; 2]; 2],
    level: usize,
    edges: [Edge; 2],
}

/// The side of a square from the centre of a cell towards x or y: y, x, and whether towards y.
type Edge = (i64, i64, bool);

/// A line of equal depth.
#[derive(Clone, Debug, PartialEq)]
pub struct Contour {
    /// Metres.
    pub depth_m: f32,
    /// In cells, as [`ContourPiece::ends`]; the first again at the end of a closed line.
    pub points: Vec<[f64; 2]>,
}

/// Corners along a side of the window: those of a tile and the next ones.
const CORNERS: usize = TILE_SIDE + 1;

/// Lines in the squares whose lowest corner is in tile `(tx, ty)`; `cells` gives a tile of the layer
/// or `None`, for this one and its neighbours.
pub fn contours_of_tile<'a>(
    (tx, ty): (i32, i32),
    cells: impl Fn((i32, i32)) -> Option<&'a TileCells>,
) -> Vec<ContourPiece> {
    let corners = corners((tx, ty), cells);
    let first = [tx, ty].map(|tile| i64::from(tile) * SIDE);
    let mut pieces = Vec::new();
    for (row, lowest_y) in (first[1]..).enumerate().take(TILE_SIDE) {
        for (column, lowest_x) in (first[0]..).enumerate().take(TILE_SIDE) {
            let at = row * CORNERS + column;
            // Counter-clockwise.
            let square = [at, at + 1, at + CORNERS + 1, at + CORNERS].map(|at| corners[at]);
            add_pieces([lowest_x, lowest_y], square, &mut pieces);
        }
    }
    pieces
}

/// Depths at the corners, rows of growing y; NaN if unknown.
fn corners<'a>(
    (tx, ty): (i32, i32),
    cells: impl Fn((i32, i32)) -> Option<&'a TileCells>,
) -> Vec<f32> {
    const REACH: usize = 1;
    const WINDOW: usize = CORNERS + 2 * REACH;
    let quantisation = LayerId::Depth.quantisation();
    // Tile before, at or after this one, and place in it.
    let around = |at: usize| {
        let at = at + TILE_SIDE - REACH;
        (at / TILE_SIDE, at % TILE_SIDE)
    };
    let beside = |tile: i32, offset: i32| tile.checked_add(offset);
    let tiles: [[Option<&TileCells>; 3]; 3] = [-1, 0, 1]
        .map(|dy| [-1, 0, 1].map(|dx| beside(tx, dx).zip(beside(ty, dy)).and_then(&cells)));
    let mut window = vec![f32::NAN; WINDOW * WINDOW];
    for (row, values) in window.chunks_exact_mut(WINDOW).enumerate() {
        let (tile_row, y) = around(row);
        for (column, value) in values.iter_mut().enumerate() {
            let (tile_column, x) = around(column);
            let tile = tiles[tile_row][tile_column];
            let code = tile.and_then(|cells| cells.get(x, y));
            *value = code
                .and_then(|code| quantisation.decode(code))
                .unwrap_or(f32::NAN);
        }
    }
    let corner = |(row, column): (usize, usize)| {
        if window[(row + REACH) * WINDOW + column + REACH].is_nan() {
            return f32::NAN;
        }
        let near = (row..=row + 2 * REACH)
            .flat_map(|row| &window[row * WINDOW + column..][..=2 * REACH])
            .filter(|value| !value.is_nan());
        let (sum, count) = near.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        sum / count
    };
    let places = (0..CORNERS).flat_map(|row| (0..CORNERS).map(move |column| (row, column)));
    places.map(corner).collect()
}

/// Corners of the edges of a square, both counter-clockwise; of each edge the one of least x and y first.
const CORNERS_OF_EDGE: [[usize; 2]; 4] = [[0, 1], [1, 2], [3, 2], [0, 3]];

fn add_pieces([x, y]: [i64; 2], square: [f32; 4], pieces: &mut Vec<ContourPiece>) {
    let least = square.into_iter().fold(f32::INFINITY, f32::min);
    let greatest = square.into_iter().fold(f32::NEG_INFINITY, f32::max);
    if square.iter().any(|depth| depth.is_nan()) {
        return;
    }
    let edges: [Edge; 4] = [
        (y, x, false),
        (y, x + 1, true),
        (y + 1, x, false),
        (y, x, true),
    ];
    for (level, &depth_m) in CONTOUR_DEPTHS_M.iter().enumerate() {
        if depth_m <= least || depth_m > greatest {
            continue;
        }
        let is_deep = square.map(|depth| depth >= depth_m);
        let next = |corner: usize| (corner + 1) % 4;
        let before = |corner: usize| (corner + 3) % 4;
        let leaves = |edge: usize| is_deep[edge] && !is_deep[next(edge)];
        let enters = |edge: usize| !is_deep[edge] && is_deep[next(edge)];
        let is_saddle = (0..4).filter(|&edge| leaves(edge)).count() == 2;
        let is_middle_deep = square.iter().sum::<f32>() / 4.0 >= depth_m;
        for from in (0..4).filter(|&edge| leaves(edge)) {
            let to = match (is_saddle, is_middle_deep) {
                (true, true) => Some(next(from)),
                (true, false) => Some(before(from)),
                (false, _) => (0..4).find(|&edge| enters(edge)),
            };
            let Some(to) = to else { continue };
            // From the corner of least x and y, so that two squares with a common edge find the same bits.
            let point = |edge: usize| {
                let (y, x, is_upwards) = edges[edge];
                let [a, b] = CORNERS_OF_EDGE[edge].map(|corner| square[corner]);
                let part = f64::from((depth_m - a) / (b - a));
                let [along_x, along_y] = if is_upwards { [0.0, part] } else { [part, 0.0] };
                [x as f64 + 0.5 + along_x, y as f64 + 0.5 + along_y]
            };
            pieces.push(ContourPiece {
                depth_m,
                ends: [from, to].map(point),
                level,
                edges: [from, to].map(|edge| edges[edge]),
            });
        }
    }
}

/// All lines of a raster, by rising depth.
pub fn contours(raster: &Raster) -> Vec<Contour> {
    let tiles = raster.tile_places();
    join_contours(tiles.flat_map(|at| contours_of_tile(at, |tile| raster.tile(tile))))
}

/// Joins pieces to lines, by rising depth.
fn join_contours(pieces: impl IntoIterator<Item = ContourPiece>) -> Vec<Contour> {
    // An edge has at most one piece of a level that begins there, and one that ends there.
    let mut by_start: BTreeMap<(usize, Edge), ContourPiece> = BTreeMap::new();
    let mut ends = BTreeSet::new();
    for piece in pieces {
        ends.insert((piece.level, piece.edges[1]));
        by_start.insert((piece.level, piece.edges[0]), piece);
    }
    // Open lines from their beginnings, then closed ones from anywhere.
    let open = by_start.keys().filter(|start| !ends.contains(*start));
    let starts: Vec<_> = open.chain(by_start.keys()).copied().collect();
    let mut contours = Vec::new();
    for mut at in starts {
        let level = at.0;
        let mut points = Vec::new();
        while let Some(piece) = by_start.remove(&at) {
            if points.is_empty() {
                points.push(piece.ends[0]);
            }
            points.push(piece.ends[1]);
            at = (level, piece.edges[1]);
        }
        if !points.is_empty() {
            contours.push((level, points));
        }
    }
    contours.sort_by_key(|(level, _)| *level);
    let contours = contours.into_iter().map(|(level, points)| Contour {
        depth_m: CONTOUR_DEPTHS_M[level],
        points,
    });
    contours.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lines of 3 × 3 tiles around the origin's.
    fn contours(depth_m: impl Fn(f64, f64) -> f64) -> Vec<Contour> {
        let places = (-1..=1).flat_map(|ty| (-1..=1).map(move |tx| (tx, ty)));
        let tiles: BTreeMap<(i32, i32), TileCells> = places
            .map(|(tx, ty)| {
                let cells = TileCells::from_fn(|x, y| {
                    let centre = |tile: i32, n: usize| f64::from(tile) * 64.0 + n as f64 + 0.5;
                    let depth_m = depth_m(centre(tx, x), centre(ty, y));
                    LayerId::Depth.quantisation().encode(depth_m as f32)
                });
                ((tx, ty), cells)
            })
            .collect();
        let pieces = tiles
            .keys()
            .flat_map(|&at| contours_of_tile(at, |tile| tiles.get(&tile)));
        join_contours(pieces)
    }

    #[test]
    fn a_round_hole_has_round_lines_across_tiles() {
        let contours = contours(|x, y| 7.0 - 0.1 * libm::hypot(x - 32.0, y - 31.0));
        let depths: Vec<_> = contours.iter().map(|contour| contour.depth_m).collect();
        assert_eq!(depths, CONTOUR_DEPTHS_M[..8]);
        for contour in contours {
            assert_eq!(contour.points.first(), contour.points.last());
            let radius = f64::from(70.0 - 10.0 * contour.depth_m);
            let mut area = 0.0;
            for ends in contour.points.windows(2) {
                let [[ax, ay], [bx, by]] = [ends[0], ends[1]].map(|[x, y]| [x - 32.0, y - 31.0]);
                assert!((libm::hypot(ax, ay) - radius).abs() < 0.15, "{ax} {ay}");
                area += 0.5 * (ax * by - ay * bx);
            }
            let expected = std::f64::consts::PI * radius * radius;
            // Counter-clockwise: the deeper water is on the left.
            assert!((area / expected - 1.0).abs() < 0.02, "{area} {expected}");
        }
    }

    #[test]
    fn lines_end_where_nothing_is_known() {
        let contours = contours(|x, y| match (x as i64, y as i64) {
            (_, -20..=20) => 2.0 + 0.05 * x,
            _ => f64::NAN,
        });
        let three = contours
            .iter()
            .find(|contour| contour.depth_m.to_bits() == 3.0_f32.to_bits())
            .unwrap();
        let ys: Vec<_> = three.points.iter().map(|[_, y]| *y).collect();
        // Deeper towards x, so upwards is with the deeper water on the right: it runs downwards.
        assert_eq!((ys[0], *ys.last().unwrap()), (20.5, -20.5));
        assert!(three.points.iter().all(|[x, _]| (x - 20.0).abs() < 0.15));
    }

    #[test]
    fn saddles_and_noise_draw_no_loose_ends() {
        // Unknown cells and saddles everywhere: each line must still be closed or end at an unknown cell.
        let noise = |x: f64, y: f64| {
            let n = (x as i64).wrapping_mul(7919) ^ (y as i64).wrapping_mul(104_729);
            2.0 + (n.rem_euclid(97)) as f64 / 97.0
        };
        let is_known = |x: f64, y: f64| (x - 10.0).abs() > 1.0 || (y - 10.0).abs() > 1.0;
        let with_hole = |x, y| {
            if is_known(x, y) {
                noise(x, y)
            } else {
                f64::NAN
            }
        };
        for contour in contours(with_hole) {
            let ends = [contour.points[0], *contour.points.last().unwrap()];
            let is_at_edge = |[x, y]: [f64; 2]| {
                let outer = x.min(y) <= -63.0 || x.max(y) >= 127.0;
                outer || ((x - 10.0).abs() < 2.6 && (y - 10.0).abs() < 2.6)
            };
            assert!(
                contour.points.first() == contour.points.last() || ends.into_iter().all(is_at_edge),
                "{ends:?}"
            );
        }
    }
}
