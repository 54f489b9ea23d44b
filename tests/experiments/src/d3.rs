//! D3: what a boat with a lidar maps of a jetty, of what is moored there and of what it passes below.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Context as _;
use nalgebra::{Point2, Point3};
use protocol::layer::LayerId;

use super::land::LETHAL;
use super::outcome::{Check, Outcome, Part, Spread, Table};
use super::pictures::Picture;
use super::session::{Rules, SEED, Session};
use super::shores::WaterWorld;
use super::voxel_views;
use edge::runtime::Pipeline;
use mapping::grid::CellIndex;
use mapping::registered_scan::{BeamOutcome, RegisteredScan};
use simulation::scene::Scene;
use simulation::source::START;

/// Revolutions from one that is judged to the next.
const EVERY: u32 = 10;
/// What stands so near to a cell may be in it by noise, metres.
const ASIDE_M: f64 = 0.1;
/// Hits this high above the water are on a thing, metres.
const RAISED_M: f64 = 0.15;
/// Beams by which a thing is within reach.
const BEAMS_MIN: u32 = 3;
/// How far ahead of the boat's middle the way must be free, seconds at its speed of 1 m/s.
const AHEAD_S: f64 = 6.0;
/// Revolutions of which there are pictures, and where the boat is then.
const PICTURED: [(u32, &str); 3] = [
    (131, "below the footbridge"),
    (331, "beside the jetty"),
    (651, "beyond the jetty"),
];
/// Parts of the names of what is judged. What is in a cell with several is the first.
const THINGS: [&str; 4] = ["pile", "deck", "moored boat", "shore"];

pub(super) fn run(session: &Session<'_>) -> anyhow::Result<Outcome> {
    let mut outcome = Outcome::default();
    if session.rules() == Rules::Document {
        return Ok(outcome);
    }
    let mut jetty = WaterWorld::load("jetty", session.rules())?;
    // A cost map of every revolution: none is judged before its cells could change.
    jetty.config.mapping.cost.period_s = 0.1;
    let truth = Truth::of(&jetty);
    let drives = session.for_each_seed("D3: jetty", |seed| Drive::of(&truth, seed))?;
    let (drives, pictures): (Vec<_>, Vec<_>) = drives.into_iter().unzip();
    outcome.checks = checks(&drives);
    outcome.parts = vec![
        Part::text(include_str!("notes/d3.md")),
        Part::Table(by_range(&drives)),
        Part::Table(not_lethal(&drives)),
    ];
    let pictures = pictures.into_iter().flatten().map(Part::Pictures);
    outcome.parts.extend(pictures);
    Ok(outcome)
}

/// Cells, and those of them that are lethal, unknown and called clear water or flat.
#[derive(Clone, Copy, Debug, Default)]
struct Cells {
    all: usize,
    lethal: usize,
    unknown: usize,
    clear: usize,
}

impl Cells {
    fn add(&mut self, cost: f32) {
        self.all += 1;
        self.lethal += usize::from(cost >= LETHAL);
        self.unknown += usize::from(cost.is_nan());
        self.clear += usize::from(cost == 0.0);
    }

    fn percent(cells: impl IntoIterator<Item = Self>) -> f64 {
        let [all, lethal] = cells.into_iter().fold([0, 0], |[all, lethal], cells| {
            [all + cells.all, lethal + cells.lethal]
        });
        100.0 * lethal as f64 / all as f64
    }
}

/// Metres of a step of distance; cells are judged up to three.
const BIN_M: f64 = 10.0;
/// Steps up to which figures are required.
const GATED_BINS: usize = 2;

/// What a drive's maps were like.
#[derive(Clone, Debug, Default)]
struct Drive {
    /// Cells of [`THINGS`] that beams reached, by distance.
    things: [[Cells; 3]; 4],
    /// Known cells of open water, by distance.
    water: [Cells; 3],
    way: Cells,
    /// Cells of [`THINGS`] that beams reached at any time, as they are at the end.
    kept: [Cells; 4],
    reached: [BTreeSet<CellIndex>; 4],
}

impl Drive {
    /// With pictures of the first seed.
    fn of(truth: &Truth<'_>, seed: u64) -> anyhow::Result<(Self, Vec<Vec<Picture>>)> {
        let mut run = truth.jetty.run(seed)?;
        let (mut drive, mut revolution) = (Self::default(), 0);
        let mut pictures = Vec::new();
        run.advance_with(run.duration_s(), |pipeline, scan| {
            revolution += 1;
            if revolution % EVERY == 1 {
                drive.judge(truth, pipeline, scan);
                drive.look_ahead(truth, pipeline, scan);
            }
            let pictured = PICTURED.iter().find(|(at, _)| *at == revolution);
            if let Some((_, place)) = pictured.filter(|_| seed == SEED) {
                pictures.push(maps(pipeline, &format!("d3-{revolution}"), place));
            }
        })?;
        let voxels = run.pipeline().mapper().voxels();
        if let Some(cost) = voxels.and_then(|voxels| voxels.cost()) {
            for (kept, reached) in drive.kept.iter_mut().zip(&drive.reached) {
                let cells = reached.iter().filter_map(|cell| cost.cell(*cell));
                cells.for_each(|cell| kept.add(cell.cost));
            }
        }
        Ok((drive, pictures.into_iter().collect::<Result<_, _>>()?))
    }

    fn judge(
        &mut self,
        truth: &Truth<'_>,
        pipeline: &Pipeline,
        scan: &RegisteredScan,
    ) -> Option<()> {
        let cost = pipeline.mapper().voxels()?.cost()?;
        let boat = scan.odom_from_base.translation.vector.xy();
        let mut hits: BTreeMap<CellIndex, u32> = BTreeMap::new();
        for beam in &scan.beams {
            let height_m = truth.jetty.point_in_world(beam.end_in_odom).z;
            let is_raised = (RAISED_M..truth.top_m).contains(&height_m);
            if beam.outcome == BeamOutcome::Hit && is_raised {
                let cell = CellIndex::containing(beam.end_in_odom.xy(), truth.cell_m);
                *hits.entry(cell).or_default() += 1;
            }
        }
        let mut window = Vec::new();
        let (first, width) = cost.cells(&mut window, |cell| *cell);
        for (place, found) in window.into_iter().enumerate() {
            let cell = CellIndex {
                x: first.x + i32::from((place % width) as u16),
                y: first.y + i32::from((place / width) as u16),
            };
            let distance_m = (cell.centre(truth.cell_m).coords - boat).norm();
            let bin = (distance_m / BIN_M) as usize;
            let Some(water) = self.water.get_mut(bin) else {
                continue;
            };
            let is_reached = hits.get(&cell).is_some_and(|hits| *hits >= BEAMS_MIN);
            if is_reached && let Some(thing) = truth.thing_in(cell) {
                self.things[thing][bin].add(found.cost);
                self.reached[thing].insert(cell);
            }
            if !found.cost.is_nan() && truth.is_clear(cell) {
                water.add(found.cost);
            }
        }
        Some(())
    }

    fn look_ahead(
        &mut self,
        truth: &Truth<'_>,
        pipeline: &Pipeline,
        scan: &RegisteredScan,
    ) -> Option<()> {
        let cost = pipeline.mapper().voxels()?.cost()?;
        let now_s = scan.stamp.since(START).as_secs_f64();
        let mut cells = BTreeSet::new();
        for step in 0..=(AHEAD_S / 0.1) as u32 {
            let path = truth.jetty.world.path();
            let at = path.planar_pose(now_s + 0.1 * f64::from(step));
            let across = Point2::new(-libm::sin(at.yaw_rad), libm::cos(at.yaw_rad)).coords;
            cells.extend((-5..=5).map(|n| {
                let at = at.position_m + across * (0.1 * f64::from(n) * truth.width_m);
                let in_odom = truth.jetty.in_odom(Point3::new(at.x, at.y, 0.0)).xy();
                CellIndex::containing(in_odom, truth.cell_m)
            }));
        }
        for cost in cells.iter().filter_map(|cell| cost.cell(*cell)) {
            self.way.add(cost.cost);
        }
        Some(())
    }
}

/// The world as the boat meets it.
struct Truth<'a> {
    jetty: &'a WaterWorld,
    all: Scene,
    /// In the order of [`THINGS`].
    things: [Scene; 4],
    cell_m: f64,
    width_m: f64,
    /// Lowest and highest point of the boat, above the water.
    bottom_m: f64,
    top_m: f64,
}

impl<'a> Truth<'a> {
    fn of(jetty: &'a WaterWorld) -> Self {
        let vehicle = &jetty.config.vehicle;
        let solids = jetty.world.solids();
        Self {
            jetty,
            all: Scene::new(solids),
            things: THINGS
                .map(|thing| Scene::new(solids.iter().filter(|solid| solid.name.contains(thing)))),
            cell_m: jetty.config.mapping.octree.cell_m,
            width_m: vehicle.width_m,
            bottom_m: vehicle.bottom_z_m,
            top_m: vehicle.bottom_z_m + vehicle.height_m,
        }
    }

    /// Which of [`THINGS`] is in or close to a cell above the water.
    fn thing_in(&self, cell: CellIndex) -> Option<usize> {
        let [low, high] = self.corners(cell, RAISED_M);
        let is_in = |thing: &Scene| thing.touches_box(low, high, 0.0);
        self.things.iter().position(is_in)
    }

    /// Whether the boat meets nothing in a cell and close to it.
    fn is_clear(&self, cell: CellIndex) -> bool {
        let [low, high] = self.corners(cell, self.bottom_m);
        !self.all.touches_box(low, high, 0.0)
    }

    /// Of a box in the world around a cell, up to the boat's top.
    fn corners(&self, cell: CellIndex, from_m: f64) -> [Point3<f64>; 2] {
        let centre = self.jetty.cell_in_world(cell, self.cell_m);
        let half_m = 0.5 * self.cell_m + ASIDE_M;
        [(-half_m, from_m), (half_m, self.top_m)]
            .map(|(aside_m, z)| Point3::new(centre.x + aside_m, centre.y + aside_m, z))
    }
}

/// Those within the distance up to which something is required.
fn gated(bins: [Cells; 3]) -> impl Iterator<Item = Cells> {
    bins.into_iter().take(GATED_BINS)
}

fn checks(drives: &[Drive]) -> Vec<Check> {
    let mut checks = Vec::new();
    for (thing, name) in THINGS.iter().enumerate() {
        let found = Spread::over(drives, |drive| Cells::percent(gated(drive.things[thing])));
        let what = format!("cells of the {name} that are lethal, up to 20 m");
        checks.push(Check::at_least(what, (found, 2, " %"), 99.0));
    }
    let names = THINGS.iter().enumerate();
    checks.extend(names.map(|(thing, name)| {
        let kept = Spread::over(drives, |drive| Cells::percent([drive.kept[thing]]));
        let what = format!("cells of the {name} that were reached, lethal at the end");
        Check::shown(what, kept.text(1, " %"))
    }));
    let water = Spread::over(drives, |drive| Cells::percent(gated(drive.water)));
    let way = Spread::count(drives, |drive| drive.way.lethal);
    let known = Spread::over(drives, |drive| {
        100.0 - 100.0 * drive.way.unknown as f64 / drive.way.all as f64
    });
    checks.extend([
        Check::zero("cells of the way called lethal", way),
        Check::at_most("water called lethal, up to 20 m", (water, 3, " %"), 0.5),
        Check::shown("cells of the way that are known", known.text(1, " %")),
    ]);
    checks
}

/// The same by distance.
fn by_range(drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "",
        "0 m to 10 m",
        "of",
        "10 m to 20 m",
        "of",
        "20 m to 30 m",
        "of",
    ]);
    let mut push = |name: &str, cells: &dyn Fn(&Drive) -> [Cells; 3]| {
        let mut row = vec![name.to_owned()];
        for bin in 0..3 {
            let percent = Spread::over(drives, |drive| Cells::percent([cells(drive)[bin]]));
            let all = Spread::count(drives, |drive| cells(drive)[bin].all);
            row.extend([
                format!("{:.2} %", percent.median),
                format!("{:.0}", all.median),
            ]);
        }
        table.push(row);
    };
    for (thing, name) in THINGS.iter().enumerate() {
        push(&format!("lethal cells of the {name}"), &|drive| {
            drive.things[thing]
        });
    }
    push("water called lethal", &|drive| drive.water);
    table
}

/// What the cells of things are that are not lethal.
fn not_lethal(drives: &[Drive]) -> Table {
    let mut table = Table::new(&[
        "cells, not lethal",
        "unknown",
        "clear",
        "a slope to land on",
    ]);
    for (thing, name) in THINGS.iter().enumerate() {
        let median = |figure: fn(&Cells) -> usize| {
            let count = |drive: &Drive| drive.things[thing].iter().map(figure).sum();
            format!("{:.0}", Spread::count(drives, count).median)
        };
        table.push([
            (*name).to_owned(),
            median(|cells| cells.unknown),
            median(|cells| cells.clear),
            median(|cells| cells.all - cells.lethal - cells.unknown - cells.clear),
        ]);
    }
    table
}

/// Octree and cost as they are at a time.
fn maps(pipeline: &Pipeline, name: &str, caption: &str) -> anyhow::Result<Vec<Picture>> {
    let voxels = pipeline.mapper().voxels().context("no octree is mapped")?;
    let boat = pipeline.mapper().vehicle_in_odom();
    let above = format!("the octree from above, {caption}");
    let octree = format!("{name}-octree");
    let mut pictures = voxel_views::from_above(voxels.octree(), &octree, &above, boat.z + 2.0)?;
    let store = pipeline.publisher().store();
    let palette = LayerId::Cost.default_palette();
    let (name, caption) = (format!("{name}-cost"), format!("slope cost, {caption}"));
    let vehicle_m = Some([boat.x, boat.y]);
    pictures.extend(Picture::of_layer(
        &store, palette, vehicle_m, &name, &caption,
    )?);
    Ok(pictures)
}
