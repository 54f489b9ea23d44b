//! D1: what a lidar with many rings maps below, in and on top of things.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Point2, Point3, Vector3};

use super::land::{Cell, LETHAL};
use super::lidars::{add_checks, worlds};
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::run::{SimulatedRun, vehicle_config};
use super::session::{Rules, SEED, Session};
use super::terrain::maps;
use edge::config::Config;
use edge::runtime::Pipeline;
use mapping::elevation::{CellClass, ElevationCell};
use mapping::grid::CellIndex;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use simulation::scene::Scene;
use simulation::source::START;
use simulation::{SimulationOptions, World};

const BRIDGE: &str = include_str!("../../../robot-edge/simulation/worlds/bridge.toml");

/// How far cells are judged, metres from the vehicle.
const RANGE_M: f64 = 15.0;
/// Revolutions from one that is judged to the next.
const EVERY: u32 = 10;
/// Distance of the vehicle's top from what it passes below, as the map has it, metres.
const OVERHANG_M: f64 = 0.1;
/// What stands so near to a cell may be in it by noise, metres.
const ASIDE_M: f64 = 0.1;
/// Ground no farther than this from a plane is even, metres.
const EVEN_M: f64 = 0.02;
/// Hits this high above the ground are on a thing that is an obstacle, metres: `h_pos_m` and five times the noise.
const RAISED_M: f64 = 0.15;
/// Beams by which a thing is within reach.
const BEAMS_MIN: u32 = 3;
/// Rise of the ground from a cell to the next that can be driven, metres: 8° over 0.2 m, and noise.
const STEP_M: f64 = 0.05;
/// Revolutions of which there are pictures, and where the vehicle is then.
const PICTURED: [(u32, &str); 3] = [
    (130, "below the bridge"),
    (640, "on the ramp"),
    (715, "on the bridge"),
];
/// How far ahead of the vehicle's middle the way must be free, seconds at its speed of 1 m/s.
const AHEAD_S: f64 = 3.0;
/// Share of cells of the way that must be known to be free when they are driven.
const KNOWN_MIN_PERCENT: f64 = 95.0;

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    if session.rules() == Rules::Document {
        return Ok(outcome);
    }
    outcome.parts.push(Part::text(include_str!("notes/d1.md")));
    for (label, world) in worlds("bridge", BRIDGE)? {
        let drives = session.for_each_seed(&format!("D1: {label}"), |seed| {
            Drive::of(&world, seed, (seed == SEED).then_some(label))
        })?;
        let (drives, pictures): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
        add_checks(&mut outcome, label, checks(label, &drives));
        outcome.parts.push(Part::Table(by_range(label, &drives)));
        let pictures = pictures.into_iter().flatten().map(Part::Pictures);
        outcome.parts.extend(pictures);
    }
    Ok(outcome)
}

fn begun(world: &World, seed: u64) -> anyhow::Result<SimulatedRun> {
    let options = SimulationOptions {
        seed,
        ..SimulationOptions::default()
    };
    let config = vehicle_config(world, &[])?;
    let rate_hz = world.simulated_vehicle().odometry_rate_hz;
    let averaged = libm::round(config.localization.attitude_smoothing_s * rate_hz) as usize;
    let run = SimulatedRun::new(world, options, &config)?;
    Ok(run.with_noisy_attitudes(world, seed, averaged))
}

/// The parts of the way where something is passed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Passage {
    Beam,
    Underpass,
    Tunnel,
    Ramps,
    Deck,
}

impl Passage {
    const ALL: [(Self, &str); 5] = [
        (Self::Beam, "below a beam"),
        (Self::Underpass, "below the bridge"),
        (Self::Tunnel, "in the tunnel"),
        (Self::Ramps, "on the ramps"),
        (Self::Deck, "on the bridge"),
    ];

    /// That of the world `bridge` at a place and height.
    fn at(at: Point3<f64>) -> Option<Self> {
        let is_across = at.y.abs() < 0.5 && at.z < 0.5;
        if is_across && (2.3..8.3).contains(&at.x) {
            Some(Self::Beam)
        } else if is_across && at.x < 15.9 && at.x > 8.3 {
            Some(Self::Underpass)
        } else if at.x > 20.0 && (3.1..13.9).contains(&at.y) {
            Some(Self::Tunnel)
        } else if (at.x - 12.1).abs() < 0.5 && at.y.abs() <= 2.1 {
            Some(Self::Deck)
        } else if (at.x - 12.1).abs() < 0.5 && at.y.abs() < 15.4 {
            Some(Self::Ramps)
        } else {
            None
        }
    }
}

/// Cells of the way ahead.
#[derive(Clone, Copy, Debug, Default)]
struct Lane {
    cells: usize,
    /// Free in the obstacle map.
    free: usize,
    obstacle: usize,
    occupied: usize,
    lethal: usize,
}

/// Cells in steps of distance.
#[derive(Clone, Copy, Debug, Default)]
struct Judged {
    squares_m2: f64,
    heights: usize,
    reached: usize,
    found: usize,
    ground: usize,
    false_obstacles: usize,
}

/// Metres of a step.
const BIN_M: f64 = 5.0;

/// What a drive's maps were like.
#[derive(Clone, Debug, Default)]
struct Drive {
    bins: [Judged; 3],
    lanes: BTreeMap<Passage, Lane>,
}

impl Drive {
    /// With pictures where they have a label.
    fn of(
        world: &World,
        seed: u64,
        label: Option<&str>,
    ) -> anyhow::Result<(Self, Vec<Vec<Picture>>)> {
        let truth = Truth::of(world, &vehicle_config(world, &[])?);
        let mut run = begun(world, seed)?;
        let (mut drive, mut revolution) = (Self::default(), 0);
        let mut pictures = Vec::new();
        run.advance_with(run.duration_s(), |pipeline, scan| {
            revolution += 1;
            if revolution % EVERY == 0 {
                drive.judge(&truth, pipeline, scan);
                drive.look_ahead(&truth, world, pipeline, scan);
            }
            let pictured = PICTURED.iter().find(|(at, _)| *at == revolution);
            if let (Some((_, place)), Some(label)) = (pictured, label) {
                let (name, caption) = (world.vehicle(), format!("{place}, {label}"));
                let name = format!("d1-{name}-{revolution}");
                pictures.push(maps(pipeline, &name, &caption));
            }
        })?;
        Ok((drive, pictures.into_iter().collect::<Result<_, _>>()?))
    }

    fn total(&self, figure: fn(&Judged) -> usize) -> f64 {
        self.bins.iter().map(figure).sum::<usize>() as f64
    }

    fn rms_m(&self) -> f64 {
        let squares_m2: f64 = self.bins.iter().map(|bin| bin.squares_m2).sum();
        libm::sqrt(squares_m2 / self.total(|bin| bin.heights))
    }

    fn judge(&mut self, truth: &Truth, pipeline: &Pipeline, scan: &RegisteredScan) -> Option<()> {
        let terrain = pipeline.mapper().terrain()?;
        let plane = terrain.ground_plane()?;
        let vehicle = Point3::from(scan.odom_from_base.translation.vector);
        let reachable = truth.reachable(vehicle);
        let mut hits: BTreeMap<Cell, (u32, u32)> = BTreeMap::new();
        for beam in &scan.beams {
            let end = beam.end_in_odom;
            let cell = truth.cell_at(end.xy());
            let is_near = f64::from(beam.range_m) <= RANGE_M;
            let Some(ground_m) = reachable.get(&cell).filter(|_| is_near) else {
                continue;
            };
            if beam.outcome == BeamOutcome::Hit {
                let (on_ground, raised) = hits.entry(cell).or_default();
                let above_m = end.z - truth.ground_m(end.xy(), *ground_m).unwrap_or(*ground_m);
                *on_ground += u32::from(above_m.abs() < ASIDE_M);
                *raised += u32::from((RAISED_M..truth.height_m).contains(&above_m));
            }
        }
        let index = |cell: Cell| CellIndex {
            x: cell[0] as i32,
            y: cell[1] as i32,
        };
        for (&cell, &ground_m) in &reachable {
            let centre = truth.centre(cell);
            let distance_m = (centre - vehicle.xy()).norm();
            let Some(bin) = self.bins.get_mut((distance_m / BIN_M) as usize) else {
                continue;
            };
            let elevation = terrain.elevation().grid().get(index(cell));
            let class = terrain.elevation().class(index(cell));
            let (on_ground, raised) = hits.get(&cell).copied().unwrap_or_default();
            if raised >= BEAMS_MIN {
                bin.reached += 1;
                bin.found += usize::from(class == CellClass::Obstacle);
            }
            if class == CellClass::Unknown || !truth.is_even(cell, ground_m) {
                continue;
            }
            bin.ground += 1;
            bin.false_obstacles += usize::from(class == CellClass::Obstacle);
            let mean_m = elevation.and_then(ElevationCell::mean_m);
            if let Some(mean_m) = mean_m.filter(|_| on_ground > 0) {
                let true_m = plane.height_m(&Point3::new(centre.x, centre.y, ground_m));
                bin.heights += 1;
                bin.squares_m2 += (f64::from(mean_m) - true_m).powi(2);
            }
        }
        Some(())
    }

    fn look_ahead(
        &mut self,
        truth: &Truth,
        world: &World,
        pipeline: &Pipeline,
        scan: &RegisteredScan,
    ) -> Option<()> {
        let mapper = pipeline.mapper();
        let (terrain, occupancy) = (mapper.terrain()?, mapper.occupancy()?);
        let cost = mapper.voxels()?.cost()?;
        let now_s = scan.stamp.since(START).as_secs_f64();
        let passage = Passage::at(scan.odom_from_base.translation.vector.into())?;
        let lane = self.lanes.entry(passage).or_default();
        let steps = (AHEAD_S / 0.1) as u32;
        let mut points = Vec::new();
        for step in 0..=steps {
            let at = world.path().planar_pose(now_s + 0.1 * f64::from(step));
            let across = Point2::new(-libm::sin(at.yaw_rad), libm::cos(at.yaw_rad)).coords;
            let half_m = 0.5 * truth.width_m;
            points.extend((-3..=3).map(|n| at.position_m + across * (f64::from(n) / 3.0 * half_m)));
        }
        let cells = |cell_m: f64| {
            let cells = points
                .iter()
                .map(move |at| CellIndex::containing(*at, cell_m));
            let cells: std::collections::BTreeSet<_> = cells.map(|cell| (cell.y, cell.x)).collect();
            cells.into_iter().map(|(y, x)| CellIndex { x, y })
        };
        for cell in cells(truth.cell_m) {
            let class = terrain.elevation().class(cell);
            lane.cells += 1;
            lane.free += usize::from(class == CellClass::Free);
            lane.obstacle += usize::from(class == CellClass::Obstacle);
        }
        for cell in cells(occupancy.cell_m()) {
            let p = occupancy.cell(cell).probability();
            lane.occupied += usize::from(p.is_some_and(|p| p > 0.5));
        }
        for cell in cells(mapper.voxels()?.octree().cell_m()) {
            let is_lethal = cost.cell(cell).is_some_and(|cell| cell.cost >= LETHAL);
            lane.lethal += usize::from(is_lethal);
        }
        Some(())
    }
}

/// The world as a vehicle meets it, in cells of the elevation map.
struct Truth {
    ground: Scene,
    objects: Scene,
    cell_m: f64,
    width_m: f64,
    /// Of the vehicle.
    height_m: f64,
}

impl Truth {
    fn of(world: &World, config: &Config) -> Self {
        let [ground, objects] = world.ground_and_objects().map(|solids| Scene::new(&solids));
        Self {
            ground,
            objects,
            cell_m: config.mapping.elevation.cell_m,
            width_m: config.vehicle.width_m,
            height_m: config.vehicle.height_m,
        }
    }

    fn cell_at(&self, at: Point2<f64>) -> Cell {
        [at.x, at.y].map(|m| libm::floor(m / self.cell_m) as i64)
    }

    fn centre(&self, [x, y]: Cell) -> Point2<f64> {
        let at = |n: i64| (n as f64 + 0.5) * self.cell_m;
        Point2::new(at(x), at(y))
    }

    /// Height of the ground at a point that a vehicle meets that comes from ground at `near_m`: what is above the vehicle does not count.
    fn ground_m(&self, at: Point2<f64>, near_m: f64) -> Option<f64> {
        let top_m = near_m + self.height_m + OVERHANG_M;
        let from = Point3::new(at.x, at.y, top_m);
        let hit = self.ground.cast(from, -Vector3::z(), f64::MAX, 0.0)?;
        (hit.distance_m > 0.0).then_some(top_m - hit.distance_m)
    }

    /// Cells around the vehicle to which the ground goes on without a step, and its height in their middles.
    fn reachable(&self, vehicle: Point3<f64>) -> BTreeMap<Cell, f64> {
        let start = self.cell_at(vehicle.xy());
        let mut reached = BTreeMap::from([(start, vehicle.z)]);
        let mut front = VecDeque::from([start]);
        while let Some(cell) = front.pop_front() {
            let near_m = reached.get(&cell).copied().unwrap_or(vehicle.z);
            for [dx, dy] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
                let next = [cell[0] + dx, cell[1] + dy];
                let at = self.centre(next);
                let is_near = (at - vehicle.xy()).norm() <= RANGE_M;
                let ground_m = self.ground_m(at, near_m);
                let ground_m = ground_m.filter(|m| (m - near_m).abs() <= STEP_M && is_near);
                if let Some(ground_m) = ground_m
                    && !reached.contains_key(&next)
                {
                    reached.insert(next, ground_m);
                    front.push_back(next);
                }
            }
        }
        reached
    }

    /// Whether the ground in and near a cell is one plane on which nothing stands, as high as the vehicle needs.
    fn is_even(&self, cell: Cell, ground_m: f64) -> bool {
        let (centre, half_m) = (self.centre(cell), 0.5 * self.cell_m + ASIDE_M);
        let at = |x: f64, y: f64| self.ground_m(centre + nalgebra::Vector2::new(x, y), ground_m);
        let pairs = [
            [half_m, half_m],
            [half_m, -half_m],
            [half_m, 0.0],
            [0.0, half_m],
        ];
        let is_plane = pairs.iter().all(|&[x, y]| {
            let ends = at(x, y).zip(at(-x, -y));
            ends.is_some_and(|(a, b)| {
                (0.5 * (a + b) - ground_m).abs() <= EVEN_M && (a - b).abs() <= 4.0 * STEP_M
            })
        });
        let corner =
            |sign: f64, z: f64| Point3::new(centre.x + sign * half_m, centre.y + sign * half_m, z);
        let (low, high) = (ground_m + 0.01, ground_m + self.height_m + OVERHANG_M);
        is_plane
            && !self
                .objects
                .touches_box(corner(-1.0, low), corner(1.0, high), 0.0)
    }
}

fn checks(label: &str, drives: &[Drive]) -> Vec<Check> {
    let percent = |part: fn(&Judged) -> usize, of: fn(&Judged) -> usize| {
        Spread::over(drives, move |drive| {
            100.0 * drive.total(part) / drive.total(of)
        })
    };
    let what = |what: &str| format!("{label}: {what}");
    let rms = Spread::over(drives, |drive| 100.0 * drive.rms_m());
    let mut checks = vec![
        Check::at_most(what("error of heights, rms"), (rms, 2, " cm"), 2.0),
        Check::at_least(
            what("obstacles found"),
            (percent(|bin| bin.found, |bin| bin.reached), 2, " %"),
            99.0,
        ),
        Check::at_most(
            what("ground called an obstacle"),
            (
                percent(|bin| bin.false_obstacles, |bin| bin.ground),
                2,
                " %",
            ),
            0.5,
        ),
    ];
    for (passage, name) in Passage::ALL {
        let of = |drive: &Drive| drive.lanes.get(&passage).copied().unwrap_or_default();
        for (layer, figure) in [
            ("obstacles", (|lane| lane.obstacle) as fn(Lane) -> usize),
            ("occupied cells", |lane| lane.occupied),
            ("lethal cells", |lane| lane.lethal),
        ] {
            let count = Spread::count(drives, |drive| figure(of(drive)));
            checks.push(Check::zero(
                what(&format!("{layer} in the way {name}")),
                count,
            ));
        }
        let free = Spread::over(drives, |drive| {
            100.0 * of(drive).free as f64 / of(drive).cells as f64
        });
        let known = what(&format!("way {name} known to be free"));
        checks.push(Check::at_least(known, (free, 1, " %"), KNOWN_MIN_PERCENT));
    }
    checks
}

/// The same by distance.
fn by_range(label: &str, drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        label,
        "heights, rms, cm",
        "cells",
        "obstacles found, %",
        "of",
        "ground called an obstacle, %",
        "of",
    ]);
    for place in 0..3 {
        let bins: Vec<Judged> = drives.iter().map(|drive| drive.bins[place]).collect();
        let median = |figure: fn(&Judged) -> f64, decimals: usize| {
            format!("{:.decimals$}", Spread::over(&bins, figure).median)
        };
        let (from_m, to_m) = (BIN_M * place as f64, BIN_M * (place + 1) as f64);
        table.push([
            format!("{from_m:.0} m to {to_m:.0} m"),
            median(
                |bin| 100.0 * libm::sqrt(bin.squares_m2 / bin.heights as f64),
                2,
            ),
            median(|bin| bin.heights as f64, 0),
            median(|bin| 100.0 * bin.found as f64 / bin.reached as f64, 2),
            median(|bin| bin.reached as f64, 0),
            median(
                |bin| 100.0 * bin.false_obstacles as f64 / bin.ground as f64,
                3,
            ),
            median(|bin| bin.ground as f64, 0),
        ]);
    }
    table
}
