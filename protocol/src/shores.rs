//! Limits and checks for shores on the wire, and their convex outlines, in integers and therefore
//! equal on every platform.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use crate::layer::LayerId;
use crate::message::{Datum, DockingChoice, DockingSite, ShoreClass, ShoreCluster, Shores};

/// Limit of shores in one message. With [`MAX_SITES`] and [`MAX_CORNERS`] any such message is
/// within [`MAX_MESSAGE_BYTES`](crate::wire::MAX_MESSAGE_BYTES).
pub const MAX_CLUSTERS: usize = 400;
/// Limit of docking sites in one message.
pub const MAX_SITES: usize = 100;

impl Shores {
    /// Limits shores and docking sites to a message: omits and counts the smallest shores and the
    /// last docking sites.
    ///
    /// `clusters` in any order with distinct numbers; `sites` the best first.
    pub fn gather(
        cell_m: f64,
        datum: Option<Datum>,
        mut clusters: Vec<ShoreCluster>,
        mut sites: Vec<DockingSite>,
    ) -> Self {
        clusters.sort_by_key(|cluster| (Reverse(cluster.voxels), cluster.number));
        let clusters_left_out = left_out(clusters.len(), MAX_CLUSTERS);
        clusters.truncate(MAX_CLUSTERS);
        clusters.sort_by_key(|cluster| cluster.number);
        let sites_left_out = left_out(sites.len(), MAX_SITES);
        sites.truncate(MAX_SITES);
        Self {
            cell_m,
            datum,
            clusters,
            clusters_left_out,
            sites,
            sites_left_out,
        }
    }

    /// Whether all values are in bounds. Invalid messages must not be displayed.
    pub fn is_valid(&self) -> bool {
        let is_number = |number: &f32| number.is_finite();
        let is_shore = |cluster: &ShoreCluster| {
            cluster.rigid_voxels <= cluster.voxels
                && cluster.outline.len() <= MAX_CORNERS
                && cluster.center_m.iter().all(is_number)
        };
        let numbers: BTreeSet<_> = self.sites.iter().map(|site| site.number).collect();
        let is_site = |site: &DockingSite| {
            let [x_m, y_m] = site.approach_m;
            site.number > 0
                && site.vegetation != Some(ShoreClass::Solid)
                && [x_m, y_m, site.heading_rad, site.width_m, site.price]
                    .iter()
                    .chain(&site.center_m)
                    .all(is_number)
        };
        self.cell_m.is_finite()
            && self.datum.is_none_or(is_on_earth)
            && self.clusters.len() <= MAX_CLUSTERS
            && self.clusters.is_sorted_by(|a, b| a.number < b.number)
            && self.clusters.iter().all(is_shore)
            && self.sites.len() <= MAX_SITES
            && self.sites.iter().all(is_site)
            && numbers.len() == self.sites.len()
    }
}

impl ShoreCluster {
    /// Corners of its outline, x and y in `odom`, metres; `cell_m` is the side of a cell.
    pub fn corners_m(&self, cell_m: f64) -> impl Iterator<Item = [f64; 2]> {
        let corners = self.outline.iter();
        corners.map(move |&(x, y)| [x, y].map(|edge| f64::from(edge) * cell_m))
    }

    /// Share of rigid voxels, 0 … 1.
    pub fn ratio(&self) -> f64 {
        f64::from(self.rigid_voxels) / f64::from(self.voxels.max(1))
    }
}

impl DockingSite {
    /// What it is made of, for people.
    pub fn ground_name(&self) -> &'static str {
        self.vegetation.map_or("gentle slope", ShoreClass::name)
    }

    /// The choice that lets its driver push into its vegetation; `None` for a slope.
    pub fn choice(&self) -> Option<DockingChoice> {
        let choice = |vegetation| DockingChoice {
            site: self.number,
            vegetation,
        };
        self.vegetation.map(choice)
    }
}

impl ShoreClass {
    /// Code of its cells in the layer [`Shore`](LayerId::Shore).
    pub const fn code(self) -> u16 {
        match self {
            Self::Sparse => 1,
            Self::Dense => 2,
            Self::Solid => 3,
        }
    }

    /// Name in legends.
    pub fn name(self) -> &'static str {
        LayerId::Shore.classes()[usize::from(self.code()) - 1].name
    }
}

/// Code of docking sites in the layer [`Shore`](LayerId::Shore).
pub const DOCKING_SITE_CODE: u16 = 4;

/// Letters of the docking site with this number, its name for people: A to Z without I and O, which
/// look like digits, then AA, AB … ZZ, then AAA, as spreadsheet columns. Shores are named by digits.
pub fn site_letters(number: u32) -> String {
    const LETTERS: &[u8] = b"ABCDEFGHJKLMNPQRSTUVWXYZ";
    let mut letters = Vec::new();
    let mut rest = number as usize;
    while rest > 0 {
        letters.push(char::from(LETTERS[(rest - 1) % LETTERS.len()]));
        rest = (rest - 1) / LETTERS.len();
    }
    letters.iter().rev().collect()
}

fn is_on_earth(datum: Datum) -> bool {
    (-90.0..=90.0).contains(&datum.latitude_deg)
        && (-180.0..=180.0).contains(&datum.longitude_deg)
        && (-20_000.0..=100_000.0).contains(&datum.altitude_m)
}

fn left_out(there_are: usize, limit: usize) -> u32 {
    u32::try_from(there_are.saturating_sub(limit)).unwrap_or(u32::MAX)
}

/// Limit of the corners of an outline.
pub const MAX_CORNERS: usize = 12;

type Corner = (i32, i32);

/// Convex hull of cells, counter-clockwise from its lowest left corner, in cells: cell `(x, y)`
/// covers `x … x + 1` and `y … y + 1`. Empty without cells.
///
/// Beyond [`MAX_CORNERS`], the corners that cost the least area are removed one by one, so parts of
/// cells may be outside.
pub fn convex_outline(cells: impl IntoIterator<Item = (i32, i32)>) -> Vec<(i32, i32)> {
    // Only the ends of a row of corners can be on the hull.
    let mut ends: BTreeMap<i32, (i32, i32)> = BTreeMap::new();
    for (x, y) in cells {
        let right = x.saturating_add(1);
        for line in [y, y.saturating_add(1)] {
            let (low, high) = ends.entry(line).or_insert((x, right));
            (*low, *high) = ((*low).min(x), (*high).max(right));
        }
    }
    let mut hull = Vec::new();
    let rights = ends.iter().map(|(&y, &(_, high))| (high, y));
    let lefts = ends.iter().rev().map(|(&y, &(low, _))| (low, y));
    let lowest = ends.iter().next().map(|(&y, &(low, _))| (low, y));
    for corner in lowest.into_iter().chain(rights).chain(lefts) {
        add(&mut hull, corner);
    }
    // The last equals the first.
    hull.pop();
    while hull.len() > MAX_CORNERS {
        let cheapest = (0..hull.len()).min_by_key(|&at| cost(&hull, at));
        hull.remove(cheapest.unwrap_or_default());
    }
    hull
}

/// Adds a corner to the hull and removes earlier ones that become concave.
fn add(hull: &mut Vec<Corner>, corner: Corner) {
    while let [.., a, b] = hull[..]
        && turn(a, b, corner) <= 0
    {
        hull.pop();
    }
    if hull.last() != Some(&corner) {
        hull.push(corner);
    }
}

/// Twice the signed area of a triangle; positive for a left turn.
fn turn(a: Corner, b: Corner, c: Corner) -> i128 {
    let along = |from: Corner, to: Corner| {
        [
            i128::from(to.0) - i128::from(from.0),
            i128::from(to.1) - i128::from(from.1),
        ]
    };
    let ([bx, by], [cx, cy]) = (along(a, b), along(a, c));
    bx * cy - by * cx
}

/// Twice the area lost without a corner.
fn cost(hull: &[Corner], at: usize) -> i128 {
    let before = hull[(at + hull.len() - 1) % hull.len()];
    let after = hull[(at + 1) % hull.len()];
    turn(before, hull[at], after)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::message::ShoresReply;
    use crate::tile::BootId;
    use crate::wire::{Header, MAX_MESSAGE_BYTES, encode};

    fn cluster(number: u32, voxels: u32) -> ShoreCluster {
        ShoreCluster {
            number,
            class: ShoreClass::Dense,
            voxels,
            rigid_voxels: voxels / 2,
            center_m: [1.0, 2.0],
            outline: convex_outline([(0, 0)]),
        }
    }

    fn site(width_m: f32) -> DockingSite {
        DockingSite {
            number: 1 + width_m as u32,
            center_m: [3.0, 4.0],
            heading_rad: 0.5,
            width_m,
            vegetation: None,
            price: 0.2,
            approach_m: [3.0, 0.0],
        }
    }

    #[test]
    fn smallest_shores_and_last_sites_are_omitted_and_counted() {
        // The higher the number the smaller, except one.
        let mut clusters: Vec<_> = (1..=403u32)
            .rev()
            .map(|number| cluster(number, 1_000 - number))
            .collect();
        clusters[1].voxels = 5_000;
        let sites: Vec<_> = (0..102u8).map(|n| site(f32::from(n))).collect();
        let shores = Shores::gather(0.3, None, clusters, sites.clone());
        assert_eq!((shores.clusters_left_out, shores.sites_left_out), (3, 2));
        let numbers: Vec<u32> = shores
            .clusters
            .iter()
            .map(|cluster| cluster.number)
            .collect();
        let expected: Vec<u32> = (1..=399).chain([402]).collect();
        assert_eq!(numbers, expected);
        assert_eq!(shores.sites, sites[..100]);
        assert!(shores.is_valid());

        let few = Shores::gather(0.3, None, vec![cluster(9, 4), cluster(2, 8)], Vec::new());
        assert_eq!(few.clusters, [cluster(2, 8), cluster(9, 4)]);
        assert_eq!((few.clusters_left_out, few.sites_left_out), (0, 0));
    }

    #[test]
    fn largest_message_fits() {
        let cluster = |number| ShoreCluster {
            number,
            voxels: u32::MAX,
            rigid_voxels: u32::MAX,
            outline: vec![(i32::MIN, i32::MAX); MAX_CORNERS],
            ..cluster(1, 1)
        };
        let datum = Datum {
            latitude_deg: 90.0,
            longitude_deg: -180.0,
            altitude_m: 100_000.0,
        };
        let clusters = (0..1_000).map(|n| cluster(u32::MAX - n)).collect();
        let sites = (0..1_000).map(|n| DockingSite {
            number: u32::MAX - n,
            vegetation: Some(ShoreClass::Dense),
            ..site(1.0)
        });
        let mut shores = Shores::gather(0.3, Some(datum), clusters, sites.collect());
        (shores.clusters_left_out, shores.sites_left_out) = (u32::MAX, u32::MAX);
        assert!(shores.is_valid());
        let header = Header {
            boot: BootId([0; 16]),
            seq: 0,
            robot_time_ns: 0,
        };
        let news = ShoresReply {
            revision: u64::MAX,
            shores: Some(shores),
        };
        let bytes = encode(&header, &news).unwrap();
        assert_eq!((bytes.len(), MAX_MESSAGE_BYTES), (61_591, 65_536));
    }

    #[test]
    fn what_is_out_of_bounds_is_not_valid() {
        let good = Shores::gather(
            0.3,
            None,
            vec![cluster(1, 4), cluster(2, 4)],
            vec![site(1.0)],
        );
        assert!(good.is_valid() && Shores::default().is_valid());
        let spoil = |how: fn(&mut Shores)| {
            let mut shores = good.clone();
            how(&mut shores);
            shores.is_valid()
        };
        assert!(!spoil(|shores| shores.clusters[0].rigid_voxels = 5));
        assert!(!spoil(|shores| shores.clusters[1].center_m[1] = f32::NAN));
        assert!(!spoil(|shores| shores.clusters[1].number = 1));
        assert!(!spoil(
            |shores| shores.clusters[0].outline = vec![(0, 0); 13]
        ));
        assert!(!spoil(|shores| shores.sites[0].heading_rad = f32::INFINITY));
        assert!(!spoil(|shores| shores.sites = vec![site(1.0); 101]));
        assert!(!spoil(|shores| shores.sites[0].approach_m[1] = f32::NAN));
        assert!(!spoil(
            |shores| shores.sites[0].vegetation = Some(ShoreClass::Solid)
        ));
        assert!(!spoil(|shores| shores.cell_m = f64::NAN));
        let datum = |latitude_deg, altitude_m| {
            let datum = Datum {
                latitude_deg,
                longitude_deg: 0.0,
                altitude_m,
            };
            let shores = Shores {
                datum: Some(datum),
                ..good.clone()
            };
            shores.is_valid()
        };
        assert!(datum(-90.0, 0.0) && !datum(90.1, 0.0) && !datum(0.0, f64::NAN));
    }

    #[test]
    fn classes_are_those_of_the_layer() {
        let names =
            [ShoreClass::Sparse, ShoreClass::Dense, ShoreClass::Solid].map(ShoreClass::name);
        assert_eq!(names, ["sparse", "dense", "solid"]);
        let site = LayerId::Shore.classes()[usize::from(DOCKING_SITE_CODE) - 1];
        assert_eq!(site.name, "docking site");
        let shore = cluster(1, 9);
        assert!((shore.ratio() - 4.0 / 9.0).abs() < 1e-12);
        assert!(cluster(1, 0).ratio().abs() < 1e-12);
    }

    #[test]
    fn hulls_are_those_drawn_by_hand() {
        let check = |cells: &[(i32, i32)], expected: &[(i32, i32)]| {
            assert_eq!(convex_outline(cells.iter().copied()), expected, "{cells:?}");
        };
        check(&[], &[]);
        check(&[(2, -3)], &[(2, -3), (3, -3), (3, -2), (2, -2)]);
        // L shape: its inner corner is bridged.
        check(
            &[(0, 0), (1, 0), (2, 0), (0, 1), (0, 2)],
            &[(0, 0), (3, 0), (3, 1), (1, 3), (0, 3)],
        );
        // Diagonal from the upper left to the lower right.
        check(
            &[(0, 2), (1, 1), (2, 0)],
            &[(2, 0), (3, 0), (3, 1), (1, 3), (0, 3), (0, 2)],
        );
        // An overflowing right side gives no outline.
        check(&[(i32::MAX, i32::MIN)], &[]);
    }

    #[test]
    fn a_disc_keeps_its_twelve_dearest_corners() {
        let disc = (-50..50).flat_map(|x: i32| (-50..50).map(move |y| (x, y)));
        let disc = disc.filter(|(x, y)| x * x + y * y < 2_400);
        let hull = convex_outline(disc);
        assert_eq!(hull.len(), MAX_CORNERS);
        let area: i128 = (1..hull.len() - 1)
            .map(|at| turn(hull[0], hull[at], hull[at + 1]))
            .sum();
        // π · 2400 = 7540; a regular polygon of twelve corners has 95.5 % of its circle.
        assert!((7_200..7_800).contains(&(area / 2)), "{area}");
    }

    proptest! {
        #[test]
        fn few_corners_hold_every_cell_and_turn_left(
            cells in prop::collection::vec((-4..4i32, -4..4i32), 1..20)
        ) {
            let hull = convex_outline(cells.iter().copied());
            let side = |at: usize, corner| turn(hull[at], hull[(at + 1) % hull.len()], corner);
            for at in 0..hull.len() {
                prop_assert!(side(at, hull[(at + 2) % hull.len()]) > 0);
            }
            // Such a small patch has a hull of at most twelve corners.
            for (x, y) in cells {
                for corner in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
                    prop_assert!((0..hull.len()).all(|at| side(at, corner) >= 0), "{hull:?}");
                }
            }
        }
    }

    #[test]
    fn letters_of_sites_are_those_of_spreadsheet_columns() {
        for (number, letters) in [
            (1, "A"),
            (8, "H"),
            (9, "J"),
            (24, "Z"),
            (25, "AA"),
            (48, "AZ"),
            (49, "BA"),
            (600, "ZZ"),
            (601, "AAA"),
        ] {
            assert_eq!(site_letters(number), letters, "{number}");
        }
    }

    #[test]
    fn site_numbers_are_distinct_and_not_zero() {
        let mut shores = Shores::gather(0.3, None, Vec::new(), vec![site(1.0), site(2.0)]);
        assert!(shores.is_valid());
        for wrong in [0, shores.sites[0].number] {
            shores.sites[1].number = wrong;
            assert!(!shores.is_valid(), "{wrong}");
        }
    }
}
