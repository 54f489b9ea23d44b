//! The world `rooms` and its variants, and how its map is judged.

use std::collections::HashMap;

use anyhow::Context as _;
use nalgebra::Point2;
use protocol::export::Trinary;
use protocol::layer::LayerId;
use protocol::tile_store::TileStore;

use super::outcome::Table;
use super::pictures::Picture;
use super::run::{SimulatedRun, config_by, known_cells, vehicle_config};
use super::session::Rules;
use super::truth::outline::Outline;
use super::truth::{self, Bounds, CellKind, TruthCell, TruthGrid};
use super::voxel_views::Canvas;
use mapping::grid::CellIndex;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use simulation::{SimulationOptions, World};

const ROOMS: &str = include_str!("../../../robot-edge/simulation/worlds/rooms.toml");
const MIRRORED: &str = "reflectivity.specular = { probability = 0.3 }\n";

/// The rooms as they are.
pub(super) fn rooms() -> anyhow::Result<World> {
    Ok(World::parse("rooms", ROOMS)?)
}

/// The same rooms with a mirror that scatters light like any other surface.
pub(super) fn without_reflections() -> anyhow::Result<World> {
    let text = ROOMS.replace(MIRRORED, "");
    Ok(World::parse("rooms without reflections", &text)?)
}

/// The same rooms; the vehicle stays in the one with the mirror and drives up and down before it, for as
/// long as it drives through all of them otherwise.
pub(super) fn seen_from_one() -> anyhow::Result<World> {
    let path = ROOMS
        .split_once("waypoints = [")
        .and_then(|(before, rest)| {
            let (_, behind) = rest.split_once("\n]\n")?;
            Some((before, behind))
        });
    let (before, behind) = path.context("the path of the world `rooms` is not where it was")?;
    let up_and_down = "
    { x_m = 2.505, y_m = -1.935, corner_radius_m = 0.0 },
    { x_m = 2.505, y_m = 2.40, corner_radius_m = 0.0 },"
        .repeat(6);
    let text = format!(
        "{before}waypoints = [\n    {{ x_m = 2.505, y_m = 4.32 }},{up_and_down}\n]\n{behind}"
    );
    Ok(World::parse("rooms seen from one", &text)?)
}

/// The truth of `world` in cells as large as the vehicle's, over more than its laser reaches.
pub(super) fn truth_of(world: &World) -> anyhow::Result<Truth> {
    let bounds = Bounds {
        min_m: [-10.0, -11.0],
        max_m: [26.0, 20.0],
    };
    let cell_m = vehicle_config(world, &[])?.mapping.occupancy.cell_m;
    let grid = truth::occupancy(world, cell_m, bounds)?;
    Ok(Truth::new(grid, world.laser_errors().range_noise_m))
}

/// The mirror's section in the plane of the laser.
pub(super) fn mirror_of(world: &World) -> Outline {
    let mirror: Vec<_> = world
        .solids()
        .iter()
        .filter(|solid| solid.name == "mirror")
        .cloned()
        .collect();
    let laser = &world.simulated_vehicle().laser;
    Outline::at_height(&mirror, laser.base_from_mount.translation.z)
}

/// A run with the vehicle's own configuration and `settings` (`key=value`) over it, for as long as the
/// vehicle drives through all rooms.
pub(super) fn run(
    world: &World,
    rules: Rules,
    seed: u64,
    settings: &[&str],
) -> anyhow::Result<SimulatedRun> {
    let options = SimulationOptions {
        seed,
        duration_s: Some(rooms()?.path().duration_s()),
        ..SimulationOptions::default()
    };
    SimulatedRun::new(world, options, &config_by(world, rules, settings)?)
}

/// The truth of a world, and how well a laser could see it.
pub(super) struct Truth {
    grid: TruthGrid,
    /// Three standard deviations of a range: readings scatter this far about a surface.
    scatter_m: f64,
}

/// What the truth asks of a cell.
///
/// A surface that passes within the scatter of an edge between two cells marks either or both of them,
/// however good the map: what such cells hold says where a wall lies in its cell, not whether the map is
/// right. So a cell is asked only where all readings, scatter included, must fall on one side. With the
/// distance `d` from the cell's centre to the nearest surface and cells of side `c`:
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Expected {
    /// No surface passes within the scatter of it (`d > c/√2 + scatter`), and it is outside all solids.
    Free,
    /// A surface passes so near its centre (`d ≤ c/2 − scatter`) that readings of it stay within.
    Occupied,
    /// As far from every surface as [`Expected::Free`], but inside a solid: no beam ends or passes there.
    Unobservable,
    /// All others: cells at edges, which are left out of every comparison.
    Edge,
}

/// How many cells of a map are what, by what is asked of them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Confusion {
    counts: [[u64; 3]; 4],
}

/// One known cell of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KnownCell {
    pub(super) index: [i64; 2],
    /// What is truly there.
    pub(super) truth: TruthCell,
    pub(super) expected: Expected,
    /// What the map says, as exports and `--summary` do.
    pub(super) map: Trinary,
}

impl Truth {
    /// `range_noise_m`: standard deviation of a range.
    pub(super) fn new(grid: TruthGrid, range_noise_m: f64) -> Self {
        Self {
            grid,
            scatter_m: 3.0 * range_noise_m,
        }
    }

    /// What the truth asks of a cell.
    pub(super) fn expected(&self, cell: TruthCell) -> Expected {
        let clear_m = self.grid.cell_m() * std::f64::consts::FRAC_1_SQRT_2 + self.scatter_m;
        match cell.kind {
            CellKind::Free if cell.surface_distance_m > clear_m => Expected::Free,
            CellKind::Occupied if cell.surface_distance_m <= self.near_m() => Expected::Occupied,
            CellKind::Inside if cell.surface_distance_m > clear_m => Expected::Unobservable,
            CellKind::Free | CellKind::Occupied | CellKind::Inside => Expected::Edge,
        }
    }

    /// Readings of a surface at most this far from a cell's centre stay within the cell, metres.
    pub(super) fn near_m(&self) -> f64 {
        // Walls are placed to the centimetre, so that many lie exactly at the limit.
        0.5 * self.grid.cell_m() - self.scatter_m + 1e-9
    }

    /// Centre of a cell in the world, metres.
    pub(super) fn centre_m(&self, index: [i64; 2]) -> [f64; 2] {
        index.map(|i| (i as f64 + 0.5) * self.grid.cell_m())
    }

    /// Every cell of which the published map knows something; those beyond the truth, which no laser of its
    /// world reaches, are left out.
    pub(super) fn known_cells(&self, store: &TileStore) -> impl Iterator<Item = KnownCell> {
        let quantisation = LayerId::Occupancy.quantisation();
        let cells = known_cells(store, LayerId::Occupancy);
        cells.filter_map(move |(index, code)| {
            let probability = quantisation.decode(code)?;
            let truth = self.grid.get(index)?;
            Some(KnownCell {
                index,
                truth,
                expected: self.expected(truth),
                map: Trinary::of(probability),
            })
        })
    }

    /// Compares the published map with the truth.
    pub(super) fn compare(&self, store: &TileStore) -> Confusion {
        let mut confusion = Confusion::default();
        for cell in self.known_cells(store) {
            confusion.counts[cell.expected as usize][cell.map as usize] += 1;
        }
        confusion
    }
}

impl Confusion {
    pub(super) fn count(&self, expected: Expected, map: Trinary) -> u64 {
        self.counts[expected as usize][map as usize]
    }

    /// Share of the decided cells that are to be free and are.
    pub(super) fn free_agreement(&self) -> f64 {
        let right = self.count(Expected::Free, Trinary::Free);
        share(right, right + self.count(Expected::Free, Trinary::Occupied))
    }

    /// Share of the decided cells that are to be occupied and are.
    pub(super) fn occupied_agreement(&self) -> f64 {
        let right = self.count(Expected::Occupied, Trinary::Occupied);
        share(right, right + self.count(Expected::Occupied, Trinary::Free))
    }

    /// Share of the decided cells of both kinds that are as asked.
    pub(super) fn agreement(&self) -> f64 {
        let [right, wrong] = [
            (Trinary::Free, Trinary::Occupied),
            (Trinary::Occupied, Trinary::Free),
        ]
        .map(|(free, occupied)| {
            self.count(Expected::Free, free) + self.count(Expected::Occupied, occupied)
        });
        share(right, right + wrong)
    }

    /// How many decided cells are compared: those to be free and those to be occupied.
    pub(super) fn compared(&self) -> (u64, u64) {
        let decided = |expected| {
            self.count(expected, Trinary::Free) + self.count(expected, Trinary::Occupied)
        };
        (decided(Expected::Free), decided(Expected::Occupied))
    }

    /// Cells that are to be occupied and are not: free or undecided.
    pub(super) fn surfaces_missed(&self) -> u64 {
        self.count(Expected::Occupied, Trinary::Free)
            + self.count(Expected::Occupied, Trinary::Undecided)
    }

    /// Known cells that are left out because of where they lie.
    pub(super) fn left_out(&self) -> u64 {
        self.counts[Expected::Edge as usize].iter().sum()
    }

    /// Cells that a comparison could count, were they decided.
    pub(super) fn undecided(&self) -> u64 {
        self.count(Expected::Free, Trinary::Undecided)
            + self.count(Expected::Occupied, Trinary::Undecided)
    }

    /// Cells by what the truth asks and what the map says.
    pub(super) fn table(&self) -> Table {
        let mut table = Table::new(&[
            "the truth asks for",
            "map: free",
            "map: occupied",
            "map: undecided",
        ]);
        for (expected, name) in [
            (Expected::Free, "free"),
            (Expected::Occupied, "occupied"),
            (Expected::Unobservable, "nothing (inside a solid)"),
            (Expected::Edge, "either (left out: at an edge)"),
        ] {
            let [free, occupied, undecided] =
                [Trinary::Free, Trinary::Occupied, Trinary::Undecided]
                    .map(|map| self.count(expected, map).to_string());
            table.push([name.to_owned(), free, occupied, undecided]);
        }
        table
    }
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}

/// The published map of the building and a little ground around it, errors in colour, north up.
pub(super) fn error_map(truth: &Truth, store: &TileStore, name: &str, caption: &str) -> Picture {
    /// Unknown, free, occupied, undecided, ghosts and holes: Okabe and Ito's vermillion and blue stand out from every
    /// grey and from each other.
    const COLORS: [[u8; 3]; 6] = [
        [180, 192, 206],
        [255, 255, 255],
        [40, 40, 40],
        [150, 150, 150],
        [213, 94, 0],
        [0, 114, 178],
    ];
    const PIXELS_PER_CELL: usize = 4;
    const CORNERS_M: [[f64; 2]; 2] = [[-3.0, -4.0], [18.4, 12.6]];
    let [first, end] =
        CORNERS_M.map(|corner| corner.map(|m| libm::round(m / truth.grid.cell_m()) as i64));
    let mut canvas = Canvas::new(first, end.map(|n| n - 1), &COLORS, PIXELS_PER_CELL);
    for cell in truth.known_cells(store) {
        let color = match (cell.expected, cell.map) {
            (_, Trinary::Undecided) => 3,
            (Expected::Free, Trinary::Occupied) => 4,
            (Expected::Occupied, Trinary::Free) => 5,
            (_, Trinary::Free) => 1,
            (_, Trinary::Occupied) => 2,
        };
        canvas.set(cell.index, color);
    }
    canvas.picture(name, caption)
}

/// The cells that the truth asks to be occupied and that are not.
pub(super) struct Erosion {
    /// They were occupied at the end of some second, and later scans undid it.
    pub(super) undone: usize,
    /// They never were.
    pub(super) never: usize,
    /// The same by [`Place`]: known cells that must be occupied, those undone, those that never were.
    pub(super) places: [[usize; 3]; 3],
    /// Of the beams that undid it, crossing such a cell without a hit in it after it was last occupied: angle
    /// to the nearest surface, degrees, ascending; nowhere but in an empty world not-a-number.
    pub(super) angles_deg: Vec<f64>,
}

/// What a cell that must be occupied holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// A corner or an end of a surface within a cell's side of its centre.
    Corner,
    /// A face that is at an angle to the grid.
    Askew,
    /// A face along the grid.
    Along,
}

impl Place {
    fn of(outline: &Outline, cell: Square) -> Self {
        let Some([a, b]) = nearest_segment(outline, cell.centre_m) else {
            return Self::Along;
        };
        let is_near = |end: Point2<f64>| (end - cell.centre_m).norm() < cell.side_m;
        let along = (b - a).normalize();
        match (is_near(a) || is_near(b), along.x.abs().max(along.y.abs())) {
            (true, _) => Self::Corner,
            (false, cosine) if cosine < ASKEW => Self::Askew,
            (false, _) => Self::Along,
        }
    }
}

/// Cosine of 2°.
const ASKEW: f64 = 0.9994;

impl Erosion {
    /// Of one run through `world`.
    pub(super) fn of(world: &World, truth: &Truth, seed: u64) -> anyhow::Result<Self> {
        let mut run = run(world, Rules::Own, seed, &[])?;
        let (mut scans, mut last_occupied) = (Vec::new(), HashMap::new());
        for second in 1..=run.duration_s() as u32 {
            run.advance_with(f64::from(second), |_, scan| scans.push(scan.clone()))?;
            let store = run.store();
            let occupied = truth
                .known_cells(&store)
                .filter(|cell| cell.map == Trinary::Occupied);
            last_occupied.extend(occupied.map(|cell| (cell.index, scans.len())));
        }
        let pipeline = run.finish()?;
        let store = pipeline.publisher().store();
        let must_be = |cell: &KnownCell| cell.expected == Expected::Occupied;
        let (undone, never): (Vec<_>, Vec<_>) = truth
            .known_cells(&store)
            .filter(|cell| must_be(cell) && cell.map != Trinary::Occupied)
            .map(|cell| (cell.index, last_occupied.get(&cell.index)))
            .partition(|(_, last)| last.is_some());
        let height_m = world
            .simulated_vehicle()
            .laser
            .base_from_mount
            .translation
            .z;
        let outline = Outline::at_height(world.solids(), height_m);
        let mut places = [[0; 3]; 3];
        for cell in truth.known_cells(&store).filter(must_be) {
            let counts = &mut places[Place::of(&outline, Square::new(truth, cell.index)) as usize];
            counts[0] += 1;
            if cell.map != Trinary::Occupied {
                counts[if last_occupied.contains_key(&cell.index) {
                    1
                } else {
                    2
                }] += 1;
            }
        }
        let mut angles_deg: Vec<f64> = undone
            .iter()
            .flat_map(|&(index, last)| {
                let cell = Square::new(truth, index);
                let since = last.and_then(|&scan| scans.get(scan..)).unwrap_or_default();
                since
                    .iter()
                    .flat_map(move |scan| cell.crossed_without_a_hit(scan))
            })
            .map(|(beam, centre_m)| angle_to_surface_deg(&outline, beam, centre_m))
            .collect();
        angles_deg.sort_by(f64::total_cmp);
        Ok(Self {
            undone: undone.len(),
            never: never.len(),
            places,
            angles_deg,
        })
    }

    /// A row for each [`Place`].
    pub(super) fn table(&self) -> Table {
        let mut table = Table::new(&["cells that hold", "known", "lost again", "never occupied"]);
        for (place, name) in [
            (Place::Corner, "a corner or an end of a surface"),
            (Place::Askew, "a face at an angle to the grid"),
            (Place::Along, "a face along the grid"),
        ] {
            let counts = self.places[place as usize].map(|count| count.to_string());
            table.push([name.to_owned()].into_iter().chain(counts));
        }
        table
    }

    /// The angle below which this share of the beams is, degrees.
    pub(super) fn quantile_deg(&self, share: f64) -> f64 {
        let place = self.angles_deg.len().saturating_sub(1) as f64 * share;
        self.angles_deg
            .get(place as usize)
            .copied()
            .unwrap_or(f64::NAN)
    }
}

/// A cell as a place.
#[derive(Clone, Copy)]
struct Square {
    index: [i64; 2],
    centre_m: Point2<f64>,
    side_m: f64,
}

impl Square {
    fn new(truth: &Truth, index: [i64; 2]) -> Self {
        Self {
            index,
            centre_m: truth.centre_m(index).into(),
            side_m: truth.grid.cell_m(),
        }
    }

    /// The beams of a scan that cross the cell, none if one ends in it.
    fn crossed_without_a_hit(self, scan: &RegisteredScan) -> Vec<(&RegisteredBeam, Point2<f64>)> {
        let mut crossing = Vec::new();
        for beam in scan
            .beams
            .iter()
            .filter(|beam| beam.outcome == BeamOutcome::Hit)
        {
            let end = CellIndex::containing(beam.end_in_odom.xy(), self.side_m);
            if [i64::from(end.x), i64::from(end.y)] == self.index {
                return Vec::new();
            }
            if self.is_crossed(beam) {
                crossing.push((beam, self.centre_m));
            }
        }
        crossing
    }

    /// Clips the beam to the square (Liang and Barsky).
    fn is_crossed(self, beam: &RegisteredBeam) -> bool {
        let (start, along) = (
            beam.origin_in_odom.xy(),
            (beam.end_in_odom - beam.origin_in_odom).xy(),
        );
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            let [a, b] = [-0.5, 0.5]
                .map(|edge| (self.centre_m[axis] + edge * self.side_m - start[axis]) / along[axis]);
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        enter < leave
    }
}

fn nearest_segment(outline: &Outline, point_m: Point2<f64>) -> Option<[Point2<f64>; 2]> {
    let distance_m = |&[a, b]: &[Point2<f64>; 2]| {
        let along = b - a;
        let t = ((point_m - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
        (point_m - (a + along * t)).norm()
    };
    let segments = outline.segments().iter();
    segments
        .min_by(|a, b| distance_m(a).total_cmp(&distance_m(b)))
        .copied()
}

fn angle_to_surface_deg(outline: &Outline, beam: &RegisteredBeam, point_m: Point2<f64>) -> f64 {
    let Some([a, b]) = nearest_segment(outline, point_m) else {
        return f64::NAN;
    };
    let beam = (beam.end_in_odom - beam.origin_in_odom).xy().normalize();
    let surface = (b - a).normalize();
    libm::asin(beam.perp(&surface).abs()).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variants_differ_where_they_should() {
        assert_eq!(ROOMS.matches("reflectivity").count(), 1);
        assert_eq!(ROOMS.matches(MIRRORED).count(), 1);
        let (rooms, one) = (rooms().unwrap(), seen_from_one().unwrap());
        assert_eq!(rooms.solids(), one.solids());
        assert!(one.path().duration_s() > rooms.path().duration_s());
        let plain = without_reflections().unwrap();
        assert_eq!(rooms.solids().len(), plain.solids().len());
        assert_ne!(rooms.solids(), plain.solids());
        assert!(!mirror_of(&rooms).segments().is_empty());
    }
}
