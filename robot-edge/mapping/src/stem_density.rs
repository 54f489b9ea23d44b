//! Density of canes from how differently far neighbouring beams go into them (docs/methods.md,
//! section 6).
//!
//! Among stems that stand at random, n to the square metre, a beam ends within every metre with a
//! probability of n · w, where w is the width over which it notices a stem: the stem's and that of its
//! own spot. Its way into them is exponentially distributed, and so is the difference of the ways of
//! two beams that enter side by side; its mean is 1 / (n · w). Neither needs to know where the canes
//! begin. Beams that end on one surface differ by next to nothing.

use std::collections::{BTreeSet, HashMap};

use rustc_hash::FxBuildHasher;

use crate::docking::BoatFootprint;
use crate::grid::CellIndex;
use crate::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};

/// Sums over square tiles half a hull wide, so that two by two are what a hull meets.
#[derive(Clone, Debug)]
pub(crate) struct StemDensity {
    /// Side of a tile, columns.
    columns: i32,
    cell_m: f64,
    hull_length_m: f64,
    tiles: HashMap<CellIndex, Tile, FxBuildHasher>,
}

/// Pairs of neighbouring beams the first of which ends in a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Tile {
    /// Pairs that both end within [`DIFFERENCE_MAX_M`] of each other.
    near: u32,
    /// Sum over all pairs of the difference of their ranges beyond [`SAME_STEM_M`], at most up to
    /// [`DIFFERENCE_MAX_M`], times w, square metres.
    area_m2: f64,
    /// Hits, and those of them that lie on a surface.
    hits: u32,
    smooth: u32,
    /// Hits higher than any cane.
    tall: u32,
    /// Pairs low enough that a wall would end them, whose second beam could go a hull's length on
    /// before it meets the water; and those of them whose second beam does.
    sights: u32,
    through: u32,
}

/// What a hull meets where a cluster is densest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Densest {
    /// Stems a square metre.
    pub stems_per_m2: f64,
    /// Greatest share of the hits on a tile that lie on a surface.
    pub smooth: f64,
    /// Most hits on a tile that are higher than any cane.
    pub tall: u32,
    /// Share of its parts that are seen through over a hull's length.
    pub open: f64,
}

/// Diameter of a cane, metres: 8 mm to 14 mm of common reed.
const CANE_M: f64 = 0.011;
/// Greater differences count as this: what stands behind the canes is no matter, metres.
const DIFFERENCE_MAX_M: f64 = 2.0;
/// Beams whose ranges differ by less may have met the same stem, and do not count: four standard
/// deviations of a laser's noise of 1 cm, metres.
const SAME_STEM_M: f64 = 0.04;
/// Hits farther away do not count: neighbouring beams are 20 cm apart there, metres.
const RANGE_MAX_M: f32 = 45.0;
/// Heights above the water at which canes have not ended yet, metres.
const HEIGHTS_M: [f64; 2] = [0.1, 1.2];
/// Higher above the water than common reed grows, metres.
const TALL_M: f64 = 4.0;
/// Lower above the water than the walls that must be found, metres.
const LOW_M: f64 = 0.8;
/// Two by two tiles count as open or closed from so many pairs on, and as open from this share of them
/// on that see through: at the ends of a wall it is less.
const SIGHTS_MIN: u32 = 50;
const OPEN_SHARE: f64 = 0.005;
/// Never divided by less.
const AREA_MIN_M2: f64 = 1e-6;
/// Two by two tiles with fewer pairs, and tiles with fewer hits, do not count.
const PAIRS_MIN: u32 = 100;
const HITS_MIN: u32 = 30;
/// Of three neighbouring ranges on a surface, the second differs from the mean of the others by no
/// more than half of this: three standard deviations of a laser's noise of 1 cm, metres.
const SMOOTH_M: f32 = 0.07;
/// So wide a run of such beams lies on a surface and not on canes side by side, metres.
const SURFACE_M: f64 = 0.25;

impl StemDensity {
    /// For a hull over columns of that side, metres.
    pub(crate) fn new(hull: &BoatFootprint, cell_m: f64) -> Self {
        Self {
            columns: (libm::round(0.5 * hull.width_m / cell_m) as i32).max(1),
            cell_m,
            hull_length_m: hull.length_m,
            tiles: HashMap::default(),
        }
    }

    /// Adds the hits of a scan of a laser whose beams diverge by that full angle, over water of that
    /// height, z of `odom`.
    pub(crate) fn add(&mut self, scan: &RegisteredScan, divergence_rad: f64, water_m: f64) {
        let smooth = smooth_beams(scan);
        for (at, beam) in scan.beams.iter().enumerate() {
            let height_m = beam.end_in_odom.z - water_m;
            let is_among_canes = (HEIGHTS_M[0]..HEIGHTS_M[1]).contains(&height_m);
            let is_near = beam.outcome == BeamOutcome::Hit && beam.range_m < RANGE_MAX_M;
            if !is_near || !(is_among_canes || height_m > TALL_M) {
                continue;
            }
            let tile = self.tile_of(CellIndex::containing(beam.end_in_odom.xy(), self.cell_m));
            let tile = self.tiles.entry(tile).or_default();
            if !is_among_canes {
                tile.tall += 1;
                continue;
            }
            tile.hits += 1;
            tile.smooth += u32::from(smooth[at]);
            if let Some(next) = scan.beams.get(at + 1)
                && next.index == beam.index + 1
            {
                tile.add(beam, next, divergence_rad, water_m, self.hull_length_m);
            }
        }
    }

    /// Forgets the tiles that `is_kept` does not accept, of which it is given the first column, too.
    pub(crate) fn retain(&mut self, is_kept: impl Fn(CellIndex, CellIndex) -> bool) {
        let columns = self.columns;
        self.tiles
            .retain(|&tile, _| is_kept(tile, first_column(tile, columns)));
    }

    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.tiles.clear();
    }

    /// The densest of a cluster of these columns; `None` where no beam hit it.
    pub(crate) fn densest(&self, columns: &[CellIndex]) -> Option<Densest> {
        let tiles: BTreeSet<CellIndex> = columns.iter().map(|&cell| self.tile_of(cell)).collect();
        let tile = |x: i32, y: i32| self.tiles.get(&CellIndex { x, y }).copied();
        let window = |&CellIndex { x, y }: &CellIndex| {
            let (right, up) = (x.saturating_add(1), y.saturating_add(1));
            let four = [tile(x, y), tile(right, y), tile(x, up), tile(right, up)];
            four.into_iter().flatten().fold(Tile::default(), Tile::with)
        };
        let there = || tiles.iter().filter_map(|at| self.tiles.get(at));
        let whole = there().copied().fold(Tile::default(), Tile::with);
        let windows: Vec<Tile> = tiles.iter().map(window).collect();
        let dense = windows.iter().filter(|window| window.near >= PAIRS_MIN);
        let smooth = there()
            .filter(|tile| tile.hits >= HITS_MIN)
            .map(Tile::smooth_share);
        let seen = windows.iter().filter(|window| window.sights >= SIGHTS_MIN);
        let (open, closed): (Vec<&Tile>, Vec<&Tile>) = seen.partition(|window| window.is_open());
        (whole.hits > 0).then(|| Densest {
            // A thin stand has too few pairs in each part.
            stems_per_m2: dense
                .chain([&whole])
                .map(Tile::stems_per_m2)
                .fold(0.0, f64::max),
            smooth: smooth.fold(0.0, f64::max),
            tall: there().map(|tile| tile.tall).max().unwrap_or_default(),
            open: match open.len() + closed.len() {
                0 => f64::from(u8::from(whole.is_open())),
                parts => open.len() as f64 / parts as f64,
            },
        })
    }

    /// The least column of a tile.
    pub(crate) const fn first_column(&self, tile: CellIndex) -> CellIndex {
        first_column(tile, self.columns)
    }

    /// The tile that a column is in.
    pub(crate) fn tile_of(&self, cell: CellIndex) -> CellIndex {
        CellIndex {
            x: cell.x.div_euclid(self.columns),
            y: cell.y.div_euclid(self.columns),
        }
    }
}

const fn first_column(tile: CellIndex, columns: i32) -> CellIndex {
    CellIndex {
        x: tile.x.saturating_mul(columns),
        y: tile.y.saturating_mul(columns),
    }
}

impl Tile {
    /// Adds a pair, the first of which is a hit.
    fn add(
        &mut self,
        beam: &RegisteredBeam,
        next: &RegisteredBeam,
        divergence_rad: f64,
        water_m: f64,
        hull_length_m: f64,
    ) {
        let [range_m, next_m] = [beam, next].map(|beam| f64::from(beam.range_m));
        let (origin, end) = (next.origin_in_odom, next.end_in_odom);
        // A miss ends in the water.
        let descent = (origin.z - end.z) / next_m;
        let water_at_m = if descent > 0.0 {
            (origin.z - water_m) / descent
        } else {
            f64::INFINITY
        };
        let end_m = match next.outcome {
            BeamOutcome::Hit => next_m,
            BeamOutcome::Miss => water_at_m,
        };
        if beam.end_in_odom.z - water_m < LOW_M && water_at_m - range_m >= hull_length_m {
            self.sights += 1;
            self.through += u32::from(end_m - range_m >= hull_length_m);
        }
        let difference_m = match next.outcome {
            BeamOutcome::Hit => (next_m - range_m).abs(),
            BeamOutcome::Miss => f64::INFINITY,
        };
        if difference_m >= SAME_STEM_M {
            self.near += u32::from(difference_m < DIFFERENCE_MAX_M);
            // What is exponentially distributed is so beyond any start.
            let way_m = difference_m.min(DIFFERENCE_MAX_M) - SAME_STEM_M;
            self.area_m2 += way_m * (CANE_M + divergence_rad * range_m);
        }
    }

    fn with(self, other: Self) -> Self {
        Self {
            near: self.near + other.near,
            area_m2: self.area_m2 + other.area_m2,
            hits: self.hits + other.hits,
            smooth: self.smooth + other.smooth,
            tall: self.tall + other.tall,
            sights: self.sights + other.sights,
            through: self.through + other.through,
        }
    }

    /// Of an exponential distribution that is cut off, what ended before the cut over all that was passed
    /// is the likeliest rate.
    fn stems_per_m2(&self) -> f64 {
        f64::from(self.near) / self.area_m2.max(AREA_MIN_M2)
    }

    fn is_open(&self) -> bool {
        f64::from(self.through) >= OPEN_SHARE * f64::from(self.sights.max(1))
    }

    fn smooth_share(&self) -> f64 {
        f64::from(self.smooth) / f64::from(self.hits)
    }
}

/// Of each beam whether it is in a run on one surface.
fn smooth_beams(scan: &RegisteredScan) -> Vec<bool> {
    let beams = &scan.beams;
    let mut smooth = vec![false; beams.len()];
    let is_middle = |three: &[RegisteredBeam]| {
        let [before, beam, after] = three else {
            return false;
        };
        let are_hits = three.iter().all(|beam| beam.outcome == BeamOutcome::Hit);
        let bend_m = before.range_m - 2.0 * beam.range_m + after.range_m;
        are_hits && after.index == before.index + 2 && bend_m.abs() < SMOOTH_M
    };
    let mut first = 0;
    for at in 0..beams.len() {
        // `at` ends a run unless it continues one.
        let continues =
            beams.get(at..at + 2).is_some() && at > 0 && is_middle(&beams[at - 1..at + 2]);
        if !continues {
            let width_m = (at - first) as f64 * scan.beam_step_rad * f64::from(beams[at].range_m);
            // A run has a middle; a miss has none.
            if at > first + 1 && width_m >= SURFACE_M {
                smooth[first..=at].fill(true);
            }
            first = at;
        }
    }
    smooth
}

#[cfg(test)]
pub(crate) mod tests {
    use measurement::pose::Pose;
    use measurement::time::RobotTime;
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::registered_scan::{ScanKind, SensorId};

    const CELL_M: f64 = 0.3;
    const STEP_RAD: f64 = 0.0044;
    const HULL: BoatFootprint = BoatFootprint {
        length_m: 4.5,
        width_m: 2.44,
    };
    pub(crate) const DIVERGENCE_RAD: f64 = 0.0035;

    /// A level scan of 200 beams about the y axis, 0.5 m above the water.
    fn scan(height_m: f64, mut range_m: impl FnMut(f64) -> Option<f64>) -> RegisteredScan {
        let beams = (0..200).map(|index| {
            let angle_rad = (f64::from(index) - 100.0) * STEP_RAD;
            let range_m = range_m(angle_rad);
            let along = Vector3::new(libm::sin(angle_rad), libm::cos(angle_rad), 0.0);
            let origin_in_odom = Point3::new(0.0, 0.0, height_m);
            RegisteredBeam {
                origin_in_odom,
                end_in_odom: origin_in_odom + along * range_m.unwrap_or(250.0),
                outcome: range_m.map_or(BeamOutcome::Miss, |_| BeamOutcome::Hit),
                index,
                range_m: range_m.unwrap_or(250.0) as f32,
            }
        });
        RegisteredScan {
            stamp: RobotTime::default(),
            sensor: SensorId(0),
            kind: ScanKind::Beams,
            beam_step_rad: STEP_RAD,
            odom_from_base: Pose::identity(),
            own_body_hits: 0,
            beams: beams.collect(),
        }
    }

    fn densest(scans: impl IntoIterator<Item = RegisteredScan>) -> Densest {
        let mut stems = StemDensity::new(&HULL, CELL_M);
        assert_eq!(stems.columns, 4);
        for scan in scans {
            stems.add(&scan, DIVERGENCE_RAD, 0.0);
        }
        let columns = (-60..60).flat_map(|x| (0..150).map(move |y| CellIndex { x, y }));
        stems.densest(&columns.collect::<Vec<_>>()).unwrap()
    }

    /// Scans of canes from `front_m` on, of which a wall is seen where they are passed by 30 m.
    fn canes(front_m: f64, stems_per_m2: f64) -> Vec<RegisteredScan> {
        let mut state = 1_u64;
        let mut uniform = move || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            ((state >> 33) as f64 + 0.5) / f64::from(1_u32 << 31)
        };
        let mut range_m = move |angle_rad: f64| {
            let front_m = front_m / libm::cos(angle_rad);
            let rate = stems_per_m2 * (CANE_M + DIVERGENCE_RAD * front_m);
            let way_m = -libm::log(uniform()) / rate;
            (way_m < 30.0).then_some(front_m + way_m)
        };
        (0..400).map(|_| scan(0.5, &mut range_m)).collect()
    }

    /// Canes with a trunk of 0.4 m before them, at x = 0.
    pub(crate) fn canes_and_a_trunk() -> impl Iterator<Item = RegisteredScan> {
        let trunk = |angle_rad: f64| (angle_rad.abs() < 0.02).then(|| 10.0 / libm::cos(angle_rad));
        let trunk = (0..400).map(move |_| scan(0.5, trunk));
        canes(10.5, 10.0).into_iter().chain(trunk)
    }

    #[test]
    fn neighbouring_beams_tell_how_dense_canes_are_at_any_distance() {
        for (front_m, stems_per_m2) in [(4.0, 20.0), (10.0, 5.0), (10.0, 40.0), (20.0, 20.0)] {
            let found = densest(canes(front_m, stems_per_m2)).stems_per_m2;
            // The greatest of many parts.
            let ratio = found / stems_per_m2;
            assert!(
                (0.9..1.6).contains(&ratio),
                "{front_m} m, {stems_per_m2}: {found}"
            );
        }
    }

    #[test]
    fn a_wall_is_a_surface_and_canes_are_none() {
        let wall = |angle_rad: f64| Some(10.0 / libm::cos(angle_rad));
        let found = densest([scan(0.5, wall), scan(0.6, wall)]);
        assert_eq!((found.stems_per_m2, found.smooth), (0.0, 1.0));
        for stems_per_m2 in [0.1, 10.0] {
            let found = densest(canes(10.0, stems_per_m2));
            assert!(found.smooth < 0.1, "{stems_per_m2}: {found:?}");
        }
        assert!(densest(canes_and_a_trunk()).smooth > 0.5);
    }

    #[test]
    fn canes_are_open_unless_a_wall_or_their_own_density_ends_all_beams() {
        let front_m = 15.0;
        for (stems_per_m2, wall_behind_m, open) in
            [(6.0, None, 1.0), (6.0, Some(3.0), 0.0), (60.0, None, 0.0)]
        {
            let scans = canes(front_m, stems_per_m2).into_iter().map(|mut scan| {
                for beam in &mut scan.beams {
                    let along = (beam.end_in_odom - beam.origin_in_odom).normalize();
                    let wall_m = wall_behind_m.map(|behind_m| (front_m + behind_m) / along.y);
                    if let Some(wall_m) = wall_m.filter(|m| *m < f64::from(beam.range_m)) {
                        beam.outcome = BeamOutcome::Hit;
                        beam.range_m = wall_m as f32;
                        beam.end_in_odom = beam.origin_in_odom + along * wall_m;
                    }
                }
                scan
            });
            let found = densest(scans).open;
            // The last parts that any beam reaches are never passed.
            assert!(
                (found - open).abs() < 0.3,
                "{stems_per_m2}, {wall_behind_m:?}: {found}"
            );
        }
    }

    #[test]
    fn what_is_higher_than_canes_is_counted_apart() {
        let wall = |angle_rad: f64| Some(10.0 / libm::cos(angle_rad));
        let found = densest([scan(0.5, wall), scan(5.0, wall), scan(3.0, wall)]);
        assert!((20..60).contains(&found.tall), "{found:?}");
        let mut stems = StemDensity::new(&HULL, CELL_M);
        stems.add(&scan(3.0, wall), DIVERGENCE_RAD, 0.0);
        assert_eq!(stems.densest(&[CellIndex { x: 0, y: 33 }]), None);
    }

    #[test]
    fn tiles_are_forgotten_that_are_not_kept() {
        let wall = |angle_rad: f64| Some(10.0 / libm::cos(angle_rad));
        let mut stems = StemDensity::new(&HULL, CELL_M);
        stems.add(&scan(0.5, wall), DIVERGENCE_RAD, 0.0);
        stems.retain(|_, first| first.x >= 0);
        let columns = |x| [CellIndex { x, y: 33 }];
        assert!(stems.densest(&columns(1)).is_some());
        assert_eq!(stems.densest(&columns(-1)), None);
        stems.clear();
        assert_eq!(stems.densest(&columns(1)), None);
    }
}
