//! Outlines of the shores and the nearest shore of each docking site. Computed once for each report; lists and map read
//! them in every frame.
//!
//! The distance of a shore is that of the nearest edge of its outline, since its centre may be metres behind its first
//! reeds. Outlines are convex. A shore around a bay spans the bay: within it the distance is zero, as no better number
//! is known.

use protocol::message::{ShoreClass, ShoreCluster, Shores};

/// x and y in `odom`, metres.
type Point = [f64; 2];

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShoreOutlines {
    outlines: Vec<Outline>,
    neighbours: Vec<Option<Neighbour>>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Outline {
    /// Counter-clockwise; the centre alone if the report has no outline.
    corners_m: Vec<Point>,
    /// Lowest and greatest x and y of the corners.
    bounds_m: [Point; 2],
}

/// The nearest shore of a docking site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    pub number: u32,
    pub class: ShoreClass,
    /// From the centre of the site to the nearest edge of the shore, metres; 0 within it.
    pub away_m: f64,
}

impl ShoreOutlines {
    pub fn of(shores: &Shores) -> Self {
        let clusters = shores.clusters.iter();
        let outlines: Vec<_> = clusters
            .map(|shore| Outline::new(shore, shores.cell_m))
            .collect();
        let sites = shores.sites.iter();
        let neighbours = sites
            .map(|site| nearest(&shores.clusters, &outlines, site.center_m.map(f64::from)))
            .collect();
        Self {
            outlines,
            neighbours,
        }
    }

    pub fn outlines(&self) -> &[Outline] {
        &self.outlines
    }

    /// In the order of the docking sites; `None` if there is no shore.
    pub fn neighbours(&self) -> &[Option<Neighbour>] {
        &self.neighbours
    }
}

impl Outline {
    fn new(shore: &ShoreCluster, cell_m: f64) -> Self {
        let mut corners_m: Vec<_> = shore.corners_m(cell_m).collect();
        if corners_m.is_empty() {
            corners_m.push(shore.center_m.map(f64::from));
        }
        let bound = |pick: fn(f64, f64) -> f64| {
            let corners = corners_m.iter().copied();
            let outermost = corners.reduce(|[ax, ay], [bx, by]| [pick(ax, bx), pick(ay, by)]);
            outermost.unwrap_or_default()
        };
        Self {
            bounds_m: [bound(f64::min), bound(f64::max)],
            corners_m,
        }
    }

    /// Counter-clockwise, x and y in `odom`, metres.
    pub fn corners_m(&self) -> &[[f64; 2]] {
        &self.corners_m
    }

    /// Distance of a point (x and y in `odom`, metres) to the nearest edge, metres; 0 within it.
    pub fn away_m(&self, place_m: [f64; 2]) -> f64 {
        let count = self.corners_m.len();
        let edge = |at: usize| [self.corners_m[at], self.corners_m[(at + 1) % count]];
        if count > 2 && (0..count).all(|at| is_left_of(edge(at), place_m)) {
            return 0.0;
        }
        let edges = (0..count).map(|at| to_edge_m(edge(at), place_m));
        edges.fold(f64::INFINITY, f64::min)
    }

    /// Lower bound of the distance, metres.
    fn least_m(&self, place_m: Point) -> f64 {
        let [low_m, high_m] = self.bounds_m;
        let [x, y] = [0, 1].map(|axis| {
            let outside_m = (low_m[axis] - place_m[axis]).max(place_m[axis] - high_m[axis]);
            outside_m.max(0.0)
        });
        libm::hypot(x, y)
    }
}

fn nearest(shores: &[ShoreCluster], outlines: &[Outline], place_m: Point) -> Option<Neighbour> {
    let mut nearest: Option<Neighbour> = None;
    for (shore, outline) in shores.iter().zip(outlines) {
        let best_m = nearest.map_or(f64::INFINITY, |neighbour| neighbour.away_m);
        // There may be 400 shores for each of 100 docking sites; this test skips most.
        if outline.least_m(place_m) < best_m {
            let away_m = outline.away_m(place_m);
            if away_m < best_m {
                nearest = Some(Neighbour {
                    number: shore.number,
                    class: shore.class,
                    away_m,
                });
            }
        }
    }
    nearest
}

fn is_left_of([from_m, to_m]: [Point; 2], place_m: Point) -> bool {
    let ([along_x, along_y], [x, y]) = (way(from_m, to_m), way(from_m, place_m));
    along_x * y - along_y * x >= 0.0
}

fn to_edge_m([from_m, to_m]: [Point; 2], place_m: Point) -> f64 {
    let ([along_x, along_y], [x, y]) = (way(from_m, to_m), way(from_m, place_m));
    let length_squared = along_x * along_x + along_y * along_y;
    // A single corner is an edge without length.
    let part = if length_squared > 0.0 {
        ((x * along_x + y * along_y) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    libm::hypot(x - part * along_x, y - part * along_y)
}

fn way([from_x, from_y]: Point, [to_x, to_y]: Point) -> Point {
    [to_x - from_x, to_y - from_y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::{docking_site as site, shore};

    /// Half a metre a cell: corners `(2, 4)` are 1 m and 2 m.
    const CELL_M: f64 = 0.5;

    /// From 5 m to 13 m in x, from 0 m to 4 m in y.
    fn reeds() -> ShoreCluster {
        ShoreCluster {
            outline: vec![(10, 0), (26, 0), (26, 8), (10, 8)],
            ..shore(1, [9.0, 2.0])
        }
    }

    #[test]
    fn nearest_shore_is_by_edge_not_by_centre() {
        let found = |bush_m, place_m| {
            let clusters = vec![reeds(), shore(2, bush_m)];
            let shores = Shores::gather(CELL_M, None, clusters, vec![site(place_m)]);
            let neighbour = ShoreOutlines::of(&shores).neighbours()[0].unwrap();
            (neighbour.number, neighbour.away_m)
        };
        // The centre of the reeds is 7 m away, their edge 3 m.
        assert_eq!(found([4.0, 0.0], [2.0, 2.0]).0, 2);
        assert_eq!(found([2.0, -3.0], [2.0, 2.0]), (1, 3.0));
    }

    #[test]
    fn each_shore_has_its_outline_and_each_site_its_neighbour() {
        let clusters = vec![reeds(), shore(2, [0.0, -40.0])];
        let sites = vec![site([0.0, -38.0]), site([9.0, 6.0]), site([9.0, 2.0])];
        let known = ShoreOutlines::of(&Shores::gather(CELL_M, None, clusters, sites));
        let to_origin = known.outlines().iter().map(|shore| shore.away_m([0.0; 2]));
        assert_eq!(to_origin.collect::<Vec<_>>(), [5.0, 40.0]);
        let neighbours = known.neighbours().iter().flatten();
        let neighbours: Vec<_> = neighbours.map(|near| (near.number, near.away_m)).collect();
        assert_eq!(neighbours, [(2, 2.0), (1, 2.0), (1, 0.0)]);
        let bare = Shores::gather(CELL_M, None, Vec::new(), vec![site([0.0; 2])]);
        let bare = ShoreOutlines::of(&bare);
        assert_eq!((bare.outlines(), bare.neighbours()), (&[][..], &[None][..]));
    }
}
