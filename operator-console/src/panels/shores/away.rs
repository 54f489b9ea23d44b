//! How far it is to shores and docking sites, in a straight line. Pure.
//!
//! A shore is as near as the nearest edge of its outline, which the map draws while it is marked: its middle may lie
//! metres behind its first reeds. Outlines are convex. One of a shore that bends around a bay spans the bay: how near
//! its reeds are to who is within is not told, and no number is made up.

use protocol::message::{DockingSite, ShoreCluster, Shores};

/// x and y in `odom`, metres.
type Point = [f64; 2];

/// What the numbers are, as the lists say it.
pub(super) const TO_SHORES: &str = "from the middle of the vehicle to the nearest edge of the shore's outline; \
                                    around: the vehicle is within it";
pub(super) const TO_SITES: &str =
    "from the middle of the vehicle to the middle of the docking site";

/// How far something is from the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Away {
    /// Nobody knows where the vehicle is.
    Unknown,
    /// The vehicle is within its outline.
    Around,
    /// So many metres.
    Metres(f64),
}

impl Away {
    /// A shore from a vehicle whose middle is there.
    pub(crate) fn of_shore(outline: &Outline<'_>, vehicle_m: Option<Point>) -> Self {
        match vehicle_m.map(|at_m| outline.away_m(at_m)) {
            None => Self::Unknown,
            Some(away_m) if away_m > 0.0 => Self::Metres(away_m),
            Some(_) => Self::Around,
        }
    }

    /// The middle of a docking site from a vehicle whose middle is there.
    pub(crate) fn of_site(site: &DockingSite, vehicle_m: Option<Point>) -> Self {
        vehicle_m.map_or(Self::Unknown, |at_m| {
            let [x, y] = way(at_m, site.center_m.map(f64::from));
            Self::Metres(libm::hypot(x, y))
        })
    }

    /// To sort by, metres: what is not known comes last.
    pub(crate) const fn key(self) -> f64 {
        match self {
            Self::Unknown => f64::INFINITY,
            Self::Around => 0.0,
            Self::Metres(away_m) => away_m,
        }
    }

    /// As a column has it.
    pub(super) fn column(self) -> String {
        match self {
            Self::Unknown => "–".to_owned(),
            Self::Around => "around".to_owned(),
            Self::Metres(away_m) => {
                let decimals = usize::from(away_m < 9.95);
                format!("{away_m:.decimals$} m")
            }
        }
    }

    /// As a sentence ends with it.
    pub(super) fn words(self) -> String {
        match self {
            Self::Unknown => "nobody knows how far away".to_owned(),
            Self::Around => "around the vehicle".to_owned(),
            Self::Metres(_) => format!("{} away", self.column()),
        }
    }
}

/// A shore, and where its edges are.
pub(crate) struct Outline<'a> {
    /// Whose.
    pub(super) shore: &'a ShoreCluster,
    /// Counter-clockwise; of a shore that tells none, its middle alone.
    corners_m: Vec<Point>,
    /// Lowest x and y of the corners, and greatest.
    bounds_m: [Point; 2],
}

impl<'a> Outline<'a> {
    /// Those of all shores, in their order.
    pub(crate) fn all(shores: &'a Shores) -> Vec<Self> {
        let clusters = shores.clusters.iter();
        clusters
            .map(|shore| Self::new(shore, shores.cell_m))
            .collect()
    }

    fn new(shore: &'a ShoreCluster, cell_m: f64) -> Self {
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
            shore,
            corners_m,
        }
    }

    /// From a place to its nearest edge, metres; 0 within it.
    pub(super) fn away_m(&self, place_m: Point) -> f64 {
        let count = self.corners_m.len();
        let edge = |at: usize| [self.corners_m[at], self.corners_m[(at + 1) % count]];
        if count > 2 && (0..count).all(|at| is_left_of(edge(at), place_m)) {
            return 0.0;
        }
        let edges = (0..count).map(|at| to_edge_m(edge(at), place_m));
        edges.fold(f64::INFINITY, f64::min)
    }

    /// It is not nearer to a place than this, metres.
    fn least_m(&self, place_m: Point) -> f64 {
        let [low_m, high_m] = self.bounds_m;
        let [x, y] = [0, 1].map(|axis| {
            let outside_m = (low_m[axis] - place_m[axis]).max(place_m[axis] - high_m[axis]);
            outside_m.max(0.0)
        });
        libm::hypot(x, y)
    }
}

/// The shore that is nearest to a place, and how far its nearest edge is, metres.
pub(super) fn nearest<'a>(
    outlines: &[Outline<'a>],
    place_m: Point,
) -> Option<(&'a ShoreCluster, f64)> {
    let mut nearest: Option<(&ShoreCluster, f64)> = None;
    for outline in outlines {
        let best_m = nearest.map_or(f64::INFINITY, |(_, away_m)| away_m);
        // There may be 400 shores for each of 100 docking sites, in every frame: most are out of the question.
        if outline.least_m(place_m) < best_m {
            let away_m = outline.away_m(place_m);
            if away_m < best_m {
                nearest = Some((outline.shore, away_m));
            }
        }
    }
    nearest
}

/// Whether a place is on the left of who goes along an edge, or in front of or behind them.
fn is_left_of([from_m, to_m]: [Point; 2], place_m: Point) -> bool {
    let ([along_x, along_y], [x, y]) = (way(from_m, to_m), way(from_m, place_m));
    along_x * y - along_y * x >= 0.0
}

/// From a place to the nearest point of an edge, metres.
fn to_edge_m([from_m, to_m]: [Point; 2], place_m: Point) -> f64 {
    let ([along_x, along_y], [x, y]) = (way(from_m, to_m), way(from_m, place_m));
    let length_squared = along_x * along_x + along_y * along_y;
    // A corner alone is an edge without length.
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
    use protocol::message::ShoreClass;

    use super::*;

    /// Half a metre a cell: corners `(2, 4)` are 1 m and 2 m.
    const CELL_M: f64 = 0.5;

    fn shore(number: u32, center_m: [f32; 2], outline: &[(i32, i32)]) -> ShoreCluster {
        ShoreCluster {
            number,
            class: ShoreClass::Dense,
            voxels: 10,
            rigid_voxels: 0,
            center_m,
            outline: outline.to_vec(),
        }
    }

    /// Reeds between 5 m and 13 m in x, 0 m and 4 m in y.
    fn reeds() -> ShoreCluster {
        shore(1, [9.0, 2.0], &[(10, 0), (26, 0), (26, 8), (10, 8)])
    }

    #[test]
    fn a_shore_is_as_near_as_its_nearest_edge() {
        let reeds = reeds();
        let outline = Outline::new(&reeds, CELL_M);
        for (vehicle_m, expected) in [
            ([4.0, 2.0], Away::Metres(1.0)),
            ([15.0, 3.9], Away::Metres(2.0)),
            ([9.0, 6.5], Away::Metres(2.5)),
            // From a corner.
            ([2.0, -4.0], Away::Metres(5.0)),
            ([9.0, 2.0], Away::Around),
            ([5.1, 0.1], Away::Around),
        ] {
            let found = Away::of_shore(&outline, Some(vehicle_m));
            assert_eq!(found, expected, "{vehicle_m:?}");
        }
        assert_eq!(Away::of_shore(&outline, None), Away::Unknown);
    }

    #[test]
    fn a_shore_without_an_outline_is_where_its_middle_is() {
        let point = shore(1, [3.0, 4.0], &[]);
        let outline = Outline::new(&point, CELL_M);
        assert_eq!(
            Away::of_shore(&outline, Some([0.0, 0.0])),
            Away::Metres(5.0)
        );
    }

    #[test]
    fn the_nearest_shore_is_not_that_of_the_nearest_middle() {
        let mut bush = shore(2, [4.0, 0.0], &[]);
        let reeds = reeds();
        let shores = |bush: &ShoreCluster| {
            let clusters = vec![reeds.clone(), bush.clone()];
            Shores::gather(CELL_M, None, clusters, Vec::new())
        };
        let found = |bush: &ShoreCluster, place_m| {
            let shores = shores(bush);
            nearest(&Outline::all(&shores), place_m).map(|(shore, away_m)| (shore.number, away_m))
        };
        // The middle of the reeds is 7 m away, their edge 3 m.
        assert_eq!(found(&bush, [2.0, 2.0]).map(|(number, _)| number), Some(2));
        bush.center_m = [2.0, -3.0];
        assert_eq!(found(&bush, [2.0, 2.0]), Some((1, 3.0)));
        assert_eq!(nearest(&[], [0.0, 0.0]), None);
    }

    #[test]
    fn distances_are_said_shortly_and_whole() {
        let check = |away: Away, column: &str, words: &str| {
            assert_eq!((&*away.column(), &*away.words()), (column, words));
        };
        check(Away::Metres(9.94), "9.9 m", "9.9 m away");
        check(Away::Metres(9.96), "10 m", "10 m away");
        check(Away::Around, "around", "around the vehicle");
        check(Away::Unknown, "–", "nobody knows how far away");
    }
}
