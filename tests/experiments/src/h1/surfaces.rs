//! Where hits and voxels of open ground lie, those of sweeps down and up apart.

use std::collections::{BTreeMap, BTreeSet};

use crate::land::{Cell, Ground, LandWorld, octree_and_cost};
use crate::run::SimulatedRun;
use crate::terrain::seconds;
use mapping::octree::Octree;
use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan};
use measurement::time::RobotTime;
use simulation::tilt_servo::TiltServo;

/// Distances of hits from the vehicle, metres.
pub(super) const BINS_M: [[f64; 2]; 2] = [[3.0, 8.0], [8.0, 15.0]];
/// What the vehicle sees in the time, metres.
const REGION_M: [[f64; 2]; 2] = [[-5.0, -10.0], [26.0, 10.0]];
/// Nothing stands this near to open ground, metres: plants sway.
const ASIDE_M: f64 = 0.5;
/// A hit this near to the ground is one on it where the encoder does not lag, metres.
const ON_GROUND_M: f64 = 0.1;
/// Columns count where sweeps either way met them this far ahead or farther, metres: there the lag lifts one surface above
/// the other by three voxels, and nearer by too little for a voxel between them.
const APART_FROM_M: f64 = 5.0;
/// Of the servo's even rate at least, for a sweep to have a direction.
const EVEN: f64 = 0.99;

/// Which way the laser turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Sweep {
    Down,
    Up,
}

/// Open ground, and the servo that tilts the laser over it.
pub(super) struct OpenGround<'a> {
    world: &'a LandWorld,
    ground: Ground<'a>,
    open: BTreeSet<Cell>,
    servo: TiltServo,
}

/// Beams that truly met open ground, by scan; and the columns that sweeps either way met.
pub(super) struct Observed {
    beams: BTreeMap<RobotTime, BTreeSet<u32>>,
    columns: BTreeSet<Cell>,
}

/// Heights above the ground.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heights {
    hits: u32,
    sum_m: f64,
    squares_m2: f64,
}

/// What a map makes of open ground.
#[derive(Debug, Default)]
pub(super) struct Surfaces {
    /// Of hits, by distance.
    pub(super) down: [Heights; BINS_M.len()],
    pub(super) up: [Heights; BINS_M.len()],
    /// Columns that sweeps either way met.
    pub(super) columns: usize,
    /// Those with voxels that are not occupied between occupied ones.
    double: usize,
    /// Those with an occupied voxel that is not the ground's or next to it.
    astray: usize,
    /// From the lowest occupied voxel's lower side to the highest one's upper side, of all columns, metres.
    thickness_m: f64,
}

impl Heights {
    fn add(&mut self, height_m: f64) {
        self.hits += 1;
        self.sum_m += height_m;
        self.squares_m2 += height_m * height_m;
    }

    pub(super) fn mean_m(&self) -> f64 {
        self.sum_m / f64::from(self.hits)
    }

    pub(super) fn deviation_m(&self) -> f64 {
        let mean_m = self.mean_m();
        libm::sqrt((self.squares_m2 / f64::from(self.hits) - mean_m * mean_m).max(0.0))
    }
}

impl Surfaces {
    /// By how much the ground of sweeps down is above that of sweeps up, metres; not-a-number where either saw
    /// none.
    pub(super) fn apart_m(&self, bin: usize) -> f64 {
        self.down[bin].mean_m() - self.up[bin].mean_m()
    }

    pub(super) fn double_share(&self) -> f64 {
        self.double as f64 / self.columns.max(1) as f64
    }

    pub(super) fn astray_share(&self) -> f64 {
        self.astray as f64 / self.columns.max(1) as f64
    }

    pub(super) fn thickness_m(&self) -> f64 {
        self.thickness_m / self.columns.max(1) as f64
    }
}

impl<'a> OpenGround<'a> {
    pub(super) fn of(world: &'a LandWorld) -> anyhow::Result<Self> {
        let ground = Ground::of(world, REGION_M)?;
        let servo = world.world.simulated_vehicle().laser.tilt.clone();
        let servo = servo.ok_or_else(|| world.unsuitable("has no laser that tilts"))?;
        let open = ground.cells().filter(|&cell| ground.is_bare(cell, ASIDE_M));
        Ok(Self {
            open: open.collect(),
            world,
            ground,
            servo,
        })
    }

    pub(super) fn ground(&self) -> &Ground<'a> {
        &self.ground
    }

    /// What a run whose encoder does not lag meets.
    pub(super) fn observed(&self, mut run: SimulatedRun, until_s: f64) -> anyhow::Result<Observed> {
        let mut beams = BTreeMap::new();
        let mut by_sweep: BTreeMap<Sweep, BTreeSet<Cell>> = BTreeMap::new();
        run.advance_with(until_s, |_, scan| {
            let on_ground = || hits(scan).filter_map(|beam| Some((beam, self.open_ground(beam)?)));
            beams.insert(
                scan.stamp,
                on_ground().map(|(beam, _)| beam.index).collect(),
            );
            if let Some(sweep) = self.sweep(scan) {
                let columns = by_sweep.entry(sweep).or_default();
                let is_far = |beam: &RegisteredBeam| {
                    ahead_m(scan, beam).is_some_and(|distance_m| distance_m >= APART_FROM_M)
                };
                let far = on_ground().filter(|(beam, _)| is_far(beam));
                columns.extend(far.map(|(_, cell)| cell));
            }
        })?;
        let mut sweeps = by_sweep.into_values();
        let (one, other) = (
            sweeps.next().unwrap_or_default(),
            sweeps.next().unwrap_or_default(),
        );
        Ok(Observed {
            beams,
            columns: one.intersection(&other).copied().collect(),
        })
    }

    /// What a run makes of the same beams and columns.
    pub(super) fn surfaces(
        &self,
        mut run: SimulatedRun,
        until_s: f64,
        observed: &Observed,
    ) -> anyhow::Result<Surfaces> {
        let mut surfaces = Surfaces::default();
        run.advance_with(until_s, |_, scan| {
            self.add_heights(scan, observed, &mut surfaces);
        })?;
        let (octree, _) = octree_and_cost(run.pipeline())?;
        self.add_columns(octree, observed, &mut surfaces);
        Ok(surfaces)
    }

    fn add_heights(&self, scan: &RegisteredScan, observed: &Observed, surfaces: &mut Surfaces) {
        let (Some(sweep), Some(beams)) = (self.sweep(scan), observed.beams.get(&scan.stamp)) else {
            return;
        };
        for beam in hits(scan).filter(|beam| beams.contains(&beam.index)) {
            let at = beam.end_in_odom;
            let bin = ahead_m(scan, beam).and_then(|distance_m| {
                let mut bins = BINS_M.iter();
                bins.position(|[near_m, far_m]| (*near_m..*far_m).contains(&distance_m))
            });
            if let (Some(bin), Some(ground_m)) = (bin, self.ground.height_m(at.xy())) {
                let of_sweep = match sweep {
                    Sweep::Down => &mut surfaces.down,
                    Sweep::Up => &mut surfaces.up,
                };
                of_sweep[bin].add(at.z - ground_m);
            }
        }
    }

    fn add_columns(&self, octree: &Octree, observed: &Observed, surfaces: &mut Surfaces) {
        let mut occupied: BTreeMap<Cell, Vec<i32>> = BTreeMap::new();
        for (voxel, _) in octree.occupied() {
            let cell = [voxel.x.into(), voxel.y.into()];
            if observed.columns.contains(&cell) {
                occupied.entry(cell).or_default().push(voxel.z);
            }
        }
        let voxel_at = |height_m: f64| libm::floor(height_m / octree.cell_m()) as i32;
        for (cell, mut column) in occupied {
            column.sort_unstable();
            let (Some(&lowest), Some(&highest), Some(ground_m)) =
                (column.first(), column.last(), self.ground.heights_m(cell))
            else {
                continue;
            };
            let [low, high] = ground_m.map(voxel_at);
            surfaces.columns += 1;
            surfaces.double += usize::from(column.windows(2).any(|pair| pair[1] > pair[0] + 1));
            surfaces.astray += usize::from(lowest < low - 1 || highest > high + 1);
            surfaces.thickness_m += f64::from(highest - lowest + 1) * octree.cell_m();
        }
    }

    /// The column where a beam met open ground.
    fn open_ground(&self, beam: &RegisteredBeam) -> Option<Cell> {
        let at = beam.end_in_odom;
        let cell = self.world.cell_at([at.x, at.y]);
        let ground_m = self.ground.height_m(at.xy())?;
        let is_met = self.open.contains(&cell) && (at.z - ground_m).abs() <= ON_GROUND_M;
        is_met.then_some(cell)
    }

    /// Which way the laser turned at its even rate while it swept.
    fn sweep(&self, scan: &RegisteredScan) -> Option<Sweep> {
        let at_s = seconds(scan.stamp);
        let turned_rad = self.servo.angle_rad(at_s + SCAN_S) - self.servo.angle_rad(at_s);
        let min_rad = EVEN * self.servo.even_rate_radps() * SCAN_S;
        if turned_rad >= min_rad {
            Some(Sweep::Down)
        } else if turned_rad <= -min_rad {
            Some(Sweep::Up)
        } else {
            None
        }
    }
}

/// How far from the vehicle a beam ends, metres, where that is within 45° of where the vehicle looks: farther to
/// the sides a tilt lifts less, and behind it lowers.
fn ahead_m(scan: &RegisteredScan, beam: &RegisteredBeam) -> Option<f64> {
    let in_base = scan.odom_from_base.inverse() * beam.end_in_odom;
    (in_base.x >= in_base.y.abs()).then(|| in_base.coords.xy().norm())
}

/// What the mirror of the laser takes for its 270°, seconds.
const SCAN_S: f64 = 0.03;

fn hits(scan: &RegisteredScan) -> impl Iterator<Item = &RegisteredBeam> {
    let is_hit = |beam: &&RegisteredBeam| beam.outcome == BeamOutcome::Hit;
    scan.beams.iter().filter(is_hit)
}
