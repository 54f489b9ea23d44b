//! E7 [LOD §6.2]: smooth slopes by heights above the local ground: a ramp, a bank, a crowned road.

use nalgebra::{Point3, Vector3};
use protocol::layer::Scheme;

use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::session::{Rules, SEED, Session};
use super::terrain::{self, Cell, TerrainWorld, around, obstacle_map};
use crate::truth::GroundPlane;
use mapping::elevation::CellClass;
use simulation::World;

/// Per cent of the ground's known cells that may be false obstacles where heights are above the local ground.
const FALSE_OBSTACLES_MAX: f64 = 2.0;
/// The same that must be there above one plane in at least one of the worlds, for their absence to mean anything.
const FALSE_OBSTACLES_MIN: f64 = 5.0;

/// Ground of two planes that meet in a line, and blocks of 0.3 m on it.
struct Slopes {
    name: &'static str,
    /// The slopes on both sides of the line, degrees: along x where `is_ahead`, else along y.
    slopes_deg: [f64; 2],
    is_ahead: bool,
    /// Where the line is, metres along that axis.
    line_m: f64,
    /// Centres of the blocks, metres.
    blocks: &'static [[f64; 2]],
    /// The vehicle drives along x from 0 to here, metres.
    end_m: f64,
}

const WORLDS: [Slopes; 3] = [
    Slopes {
        name: "ramp of 5°",
        slopes_deg: [0.0, 5.0],
        is_ahead: true,
        line_m: 12.03,
        blocks: &[[9.0, 1.73], [13.5, -1.77], [14.7, 2.33], [15.9, -1.27]],
        // Before its wheels reach the ramp, which is seen ahead.
        end_m: 11.0,
    },
    Slopes {
        name: "bank of 8° beside the way",
        slopes_deg: [0.0, 8.0],
        is_ahead: false,
        line_m: 1.13,
        blocks: &[[10.0, 2.33], [13.0, -1.77], [16.0, 3.73], [19.0, -2.27]],
        end_m: 22.0,
    },
    // Cross falls of 4 %, as of a country road.
    Slopes {
        name: "crowned road",
        slopes_deg: [2.29, -2.29],
        is_ahead: false,
        line_m: 1.5,
        blocks: &[[10.0, 2.23], [13.0, 4.73], [16.0, 3.83], [19.0, -1.77]],
        end_m: 22.0,
    },
];
/// Half the width of the ground, metres.
const HALF_WIDTH_M: f64 = 6.0;
/// Where it begins and ends along x, metres.
const ENDS_M: [f64; 2] = [-3.0, 45.0];
const BLOCK_M: f64 = 0.3;

/// What one drive gave.
struct Drive {
    known: usize,
    false_obstacles: usize,
    blocks: usize,
}

impl Slopes {
    /// Height of the ground, metres.
    fn height_m(&self, [x, y]: [f64; 2]) -> f64 {
        let from_line_m = if self.is_ahead { x } else { y } - self.line_m;
        let slope_deg = self.slopes_deg[usize::from(from_line_m > 0.0)];
        from_line_m * libm::tan(slope_deg.to_radians())
    }

    /// The plane of the ground at a point.
    fn plane_at(&self, [x, y]: [f64; 2]) -> GroundPlane {
        let z = self.height_m([x, y]);
        let axis = if self.is_ahead {
            [1.0, 0.0]
        } else {
            [0.0, 1.0]
        };
        let step = 1e-3;
        let beside =
            |sign: f64| self.height_m([x + sign * step * axis[0], y + sign * step * axis[1]]);
        let slope = (beside(1.0) - beside(-1.0)) / (2.0 * step);
        let normal = Vector3::new(-slope * axis[0], -slope * axis[1], 1.0).normalize();
        GroundPlane {
            point_m: Point3::new(x, y, z),
            normal,
        }
    }

    fn world(&self) -> anyhow::Result<World> {
        let [first, last] = ENDS_M;
        let (across, along) = ([-HALF_WIDTH_M, HALF_WIDTH_M], [first, last]);
        // A row of corners on either edge and one along the line between.
        let corners: Vec<[f64; 2]> = if self.is_ahead {
            let rows = [first, self.line_m, last];
            rows.iter().flat_map(|&x| across.map(|y| [x, y])).collect()
        } else {
            let rows = [across[0], self.line_m, across[1]];
            rows.iter().flat_map(|&y| along.map(|x| [x, y])).collect()
        };
        let vertices = corners.iter().map(|&[x, y]| [x, y, self.height_m([x, y])]);
        let vertices: Vec<_> = vertices.collect();
        let blocks = self.blocks.iter().enumerate().map(|(number, &[x, y])| {
            format!(
                "\n[[solids]]\nname = \"block {number}\"\nshape = \"box\"\ncentre_m = [{x}, {y}, {}]\n\
                 size_m = [{BLOCK_M}, {BLOCK_M}, {}]\n",
                self.height_m([x, y]),
                2.0 * BLOCK_M,
            )
        });
        let text = format!(
            "name = \"{}\"\nvehicle = \"holos\"\n[noise]\nrange_m = 0.01\ndropout = 0.005\n[start]\nx_m = 0.0\n\
             y_m = 0.0\nyaw_deg = 0.0\n[path]\nspeed_mps = 0.4\nturn_rate_degps = 30.0\n\
             waypoints = [{{ x_m = {end}, y_m = 0.0 }}]\n[[solids]]\nname = \"ground\"\nshape = \"mesh\"\n\
             vertices_m = {vertices:?}\ntriangles = [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]\n{}",
            self.name,
            blocks.collect::<String>(),
            end = self.end_m,
        );
        Ok(World::parse(self.name, &text)?)
    }

    /// Cells of the ground alone: no block is in them or beside them.
    fn is_ground(&self, world: &TerrainWorld, cell: Cell) -> bool {
        let is_block = |at: &Cell| {
            let [x, y] = world.centre_m(*at);
            let near_m = 0.5 * (BLOCK_M + world.cell_m());
            let is_there =
                |&[bx, by]: &[f64; 2]| (bx - x).abs() < near_m && (by - y).abs() < near_m;
            self.blocks.iter().any(is_there)
        };
        world.is_drivable(cell, &self.plane_at(world.centre_m(cell)))
            && !around(cell).any(|at| is_block(&at))
    }

    fn drive(&self, world: &TerrainWorld, seed: u64) -> anyhow::Result<Drive> {
        let map = obstacle_map(&world.run(seed, 0.0)?.finish()?.publisher().store());
        let is_obstacle = |cell: Cell| map.get(&cell) == Some(&CellClass::Obstacle);
        let ground: Vec<Cell> = map
            .keys()
            .copied()
            .filter(|&cell| self.is_ground(world, cell))
            .collect();
        let is_found = |&&block: &&[f64; 2]| around(world.cell_at(block)).any(is_obstacle);
        Ok(Drive {
            known: ground.len(),
            false_obstacles: ground.into_iter().filter(|&cell| is_obstacle(cell)).count(),
            blocks: self.blocks.iter().filter(is_found).count(),
        })
    }
}

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    outcome.parts.push(Part::text(include_str!("notes/e7.md")));
    let mut table = Table::new(&[
        "ground",
        "heights above",
        "known cells of the ground",
        "false obstacles, %",
        "blocks found",
    ]);
    let mut by_plane = Vec::new();
    // The document knows no other reference than the plane.
    let references = match session.rules() {
        Rules::Own => &["plane", "local"][..],
        Rules::Document => &["plane"],
    };
    for slopes in &WORLDS {
        for &reference in references {
            let name = slopes.name;
            let setting = format!("mapping.ground.reference={reference}");
            let world = TerrainWorld::new(slopes.world()?, None, session.rules(), &[&setting])?;
            let drives = session.for_each_seed(&format!("E7: {name}, {reference}"), |seed| {
                slopes.drive(&world, seed)
            })?;
            let known = Spread::count(&drives, |drive| drive.known);
            let blocks = Spread::count(&drives, |drive| drive.blocks);
            let share = Spread::over(&drives, |drive| {
                100.0 * drive.false_obstacles as f64 / drive.known.max(1) as f64
            });
            let count = slopes.blocks.len();
            table.push([
                name.to_owned(),
                reference.to_owned(),
                known.text(0, ""),
                share.text(1, ""),
                format!("{} of {count}", blocks.text(0, "")),
            ]);
            if reference == "local" {
                let what = format!("{name}: false obstacles above the local ground");
                outcome
                    .checks
                    .push(Check::at_most(what, (share, 1, " %"), FALSE_OBSTACLES_MAX));
                outcome.checks.push(Check::gate(
                    format!("{name}: blocks of 0.3 m found, local ground"),
                    format!("{} of {count}", blocks.text(0, "")),
                    "all",
                    blocks.least >= count as f64,
                ));
            } else {
                by_plane.push(share);
            }
            session.step(&format!("E7: pictures of {name}"))?;
            let pipeline = world.run(SEED, 0.0)?.finish()?;
            let id = name.split(' ').next().unwrap_or_default();
            let caption = format!("{name}, reference = \"{reference}\"");
            let maps = terrain::maps_in(
                Scheme::GroundPlane6,
                &pipeline,
                &format!("e7-{id}-{reference}"),
                &caption,
            )?;
            outcome.parts.push(Part::Pictures(maps));
        }
    }
    let worst = by_plane
        .into_iter()
        .max_by(|a, b| a.least.total_cmp(&b.least));
    if let Some(worst) = worst {
        let what = "most false obstacles above one plane, of the three";
        outcome
            .checks
            .push(Check::at_least(what, (worst, 1, " %"), FALSE_OBSTACLES_MIN));
    }
    outcome.parts.insert(1, Part::Table(table));
    Ok(outcome)
}
