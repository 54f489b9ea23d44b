//! The true motion of a vehicle: its path in the plane, or how it is driven, and the ground or the water that
//! carries it.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::sync::Arc;

use measurement::pose::Pose;
use nalgebra::{Point3, Vector3};

use crate::bumper::Bumper;
use crate::chassis::{Chassis, Posture};
use crate::dynamics::{Drive, Momentum};
use crate::path::{Path, PlanarPose};
use crate::scene::Scene;
use crate::vehicle::{Carriage, SimulatedVehicle};
use crate::velocity::{CommandedVelocity, PlanarVelocity};
use crate::waves::{Hull, Waves};
use crate::world::World;

/// True pose of a world's vehicle at any time.
///
/// Position and yaw are the path's, exactly, until commands take it over; from then on they are what the drive
/// makes of its commands, every `POSTURE_STEP_S`, and are interpolated between. Height, pitch and roll of a
/// vehicle on wheels follow from the ground every `POSTURE_STEP_S` and are interpolated between: exact on
/// planes, and where a wheel meets a kerb of 4 cm at 0.5 m/s within 0.4 mm and 0.08° during that one step. Those
/// of a boat follow from the waves at that very time. A vehicle without either stays level at z = 0.
///
/// On the path, poses are computed as they are asked for, and those of the last seconds are kept. The first look
/// at a late time takes as long as driving there. Off the path `Motion::advance_to` computes them.
#[derive(Clone)]
pub struct Motion {
    path: Arc<Path>,
    support: Support,
    driven: Option<Driven>,
}

/// Time between the instants at which the ground under the wheels is looked at and commands take effect, seconds.
pub(crate) const POSTURE_STEP_S: f64 = 0.005;

/// Steps off the path that are kept: 10 s.
const KEPT_STEPS: usize = 2_000;

impl Motion {
    /// The motion of the world's vehicle along the world's path.
    pub fn new(world: &World) -> Self {
        Self::along(
            Arc::clone(world.path()),
            world.simulated_vehicle().carriage,
            Arc::clone(world.scene()),
            Arc::clone(world.waves()),
            world.water_m().unwrap_or(0.0),
        )
    }

    /// The motion along `path`, on the ground of `scene` or on waves about `water_level_m`.
    pub(crate) fn along(
        path: Arc<Path>,
        carriage: Carriage,
        scene: Arc<Scene>,
        waves: Arc<Waves>,
        water_level_m: f64,
    ) -> Self {
        let support = match carriage {
            Carriage::Level => Support::Level,
            Carriage::Wheels(chassis) => {
                let track = PostureTrack::new(chassis, scene, Arc::clone(&path));
                Support::Ground(RefCell::new(track))
            }
            Carriage::Hull(hull) => Support::Water {
                hull,
                waves,
                water_level_m,
            },
        };
        Self {
            path,
            support,
            driven: None,
        }
    }

    /// The path, in the plane.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The vehicle's pose.
    ///
    /// On the path: before its beginning that at its start, after its end that at its end, where waves go on. Off
    /// the path: of the last 10 s up to `Motion::advance_to`, before and after the nearest of them.
    pub fn world_from_base(&self, time_s: f64) -> Pose {
        if let Some(Moment { at, posture, .. }) = self.driven_at(time_s) {
            return self.support.pose(at, posture, time_s);
        }
        let at = self.path.planar_pose(time_s);
        let posture = self.support.posture_on_path(time_s);
        self.support.pose(at, posture, time_s)
    }

    /// How fast it goes in the plane, for the same times. The path's speeds change at once.
    pub fn velocity(&self, time_s: f64) -> PlanarVelocity {
        let driven = self.driven_at(time_s).map(|moment| moment.velocity);
        driven.unwrap_or_else(|| self.path.velocity(time_s))
    }

    fn driven_at(&self, time_s: f64) -> Option<Moment> {
        let driven = self.driven.as_ref()?;
        driven.has_begun(time_s).then(|| driven.moment(time_s))
    }

    /// Leaves the path at step number `step`, at the pose and the velocity that it has there, for good; does
    /// nothing where it has left it already.
    pub(crate) fn take_over(&mut self, step: i64, vehicle: &SimulatedVehicle, scene: Arc<Scene>) {
        if self.driven.is_some() {
            return;
        }
        let time_s = step as f64 * POSTURE_STEP_S;
        let first = Moment {
            at: self.path.planar_pose(time_s),
            posture: self.support.posture_on_path(time_s),
            velocity: self.path.velocity(time_s),
        };
        self.driven = Some(Driven {
            begin: step,
            newest: step,
            moments: VecDeque::from([first]),
            drive: vehicle.drive,
            bumper: Bumper::new(vehicle.body, scene),
            command: CommandedVelocity::ZERO,
            momentum: Momentum {
                velocity: first.velocity,
                ..Momentum::default()
            },
        });
    }

    /// Drives on to step number `step`; on the path and backwards there is nothing to do.
    pub(crate) fn advance_to(&mut self, step: i64) {
        if let Some(driven) = &mut self.driven {
            driven.advance_to(step, &self.support);
        }
    }

    pub(crate) fn is_driven(&self) -> bool {
        self.driven.is_some()
    }

    /// Commands it from the next step on; what is not finite stops it. On the path it does nothing.
    pub(crate) fn set_command(&mut self, command: CommandedVelocity) {
        if let Some(driven) = &mut self.driven {
            driven.command = command.or_zero();
        }
    }
}

/// Support of the vehicle: ground or water.
#[derive(Clone)]
enum Support {
    Level,
    Ground(RefCell<PostureTrack>),
    Water {
        hull: Hull,
        waves: Arc<Waves>,
        water_level_m: f64,
    },
}

impl Support {
    /// The pose of a vehicle at `at`. On ground it has the posture; water decides by itself.
    fn pose(&self, at: PlanarPose, posture: Posture, time_s: f64) -> Pose {
        match self {
            Self::Level => at.level(),
            Self::Ground(_) => posture.world_from_base(at),
            Self::Water {
                hull,
                waves,
                water_level_m,
            } => hull
                .afloat(at, waves, *water_level_m, time_s)
                .world_from_base(at),
        }
    }

    /// Posture on ground at `time_s` of its path; elsewhere level.
    fn posture_on_path(&self, time_s: f64) -> Posture {
        match self {
            Self::Ground(track) => track.borrow_mut().posture(time_s),
            Self::Level | Self::Water { .. } => Posture::default(),
        }
    }

    /// Posture on ground at `at`, where it was `last` shortly before; elsewhere level.
    fn posture(&self, at: PlanarPose, last: Posture, time_s: f64) -> Posture {
        match self {
            Self::Ground(track) => track.borrow().settle(at, last, time_s),
            Self::Level | Self::Water { .. } => Posture::default(),
        }
    }
}

/// The motion of a vehicle that follows commands and stops at obstacles.
///
/// Steps are numbered from the beginning of the run and lie `POSTURE_STEP_S` apart. A command holds for whole
/// steps, so that the motion depends on the steps at which commands came and on nothing else.
#[derive(Clone)]
struct Driven {
    begin: i64,
    /// The number of the last of the moments.
    newest: i64,
    /// At least one.
    moments: VecDeque<Moment>,
    drive: Drive,
    bumper: Bumper,
    command: CommandedVelocity,
    momentum: Momentum,
}

/// A vehicle at a step.
#[derive(Clone, Copy)]
struct Moment {
    at: PlanarPose,
    posture: Posture,
    velocity: PlanarVelocity,
}

/// Times nearer to a step than this are at it, in steps: what rounding makes of the step's own time.
const AT_STEP: f64 = 1e-6;

impl Driven {
    /// At the very beginning both have the same pose; the path gives it, whether it was read before or not.
    fn has_begun(&self, time_s: f64) -> bool {
        time_s / POSTURE_STEP_S > self.begin as f64 + AT_STEP
    }

    fn advance_to(&mut self, step: i64, support: &Support) {
        while self.newest < step
            && let Some(&last) = self.moments.back()
        {
            self.newest += 1;
            let time_s = self.newest as f64 * POSTURE_STEP_S;
            let next = self.step(&last, support, time_s);
            self.moments.push_back(next);
            if self.moments.len() > KEPT_STEPS {
                self.moments.pop_front();
            }
        }
    }

    /// Interpolated between the steps before and after `time_s`.
    fn moment(&self, time_s: f64) -> Moment {
        let steps = time_s / POSTURE_STEP_S - (self.newest + 1) as f64 + self.moments.len() as f64;
        let steps = steps.clamp(0.0, (self.moments.len() - 1) as f64);
        let nearest = libm::round(steps);
        let steps = if (steps - nearest).abs() < AT_STEP {
            nearest
        } else {
            steps
        };
        let before = libm::floor(steps);
        let share = steps - before;
        let from = &self.moments[before as usize];
        let to = self.moments.get(before as usize + 1).unwrap_or(from);
        Moment {
            at: from.at.towards(&to.at, share),
            posture: from.posture.towards(&to.posture, share),
            velocity: from.velocity.towards(to.velocity, share),
        }
    }

    /// The moment after `last`, a step later, at `time_s`.
    ///
    /// A vehicle that would run into something does not move in that step and loses all speed, so that it ends
    /// within a step's way of the obstacle. Coming down on something, as the tail does behind a kerb, does not
    /// stop it.
    fn step(&mut self, last: &Moment, support: &Support, time_s: f64) -> Moment {
        let before = self.momentum.velocity;
        self.momentum = self
            .drive
            .after(self.momentum, self.command, POSTURE_STEP_S);
        let mut mean = before.towards(self.momentum.velocity, 0.5);
        // Along the ground, not along the map.
        mean.forward_mps *= libm::cos(last.posture.pitch_rad);
        let at = mean.moved(last.at, POSTURE_STEP_S);
        let mut next = Moment {
            velocity: self.momentum.velocity,
            ..*last
        };
        if at == last.at {
            return next;
        }
        let as_it_stood = |at| support.pose(at, last.posture, time_s - POSTURE_STEP_S);
        let (from, to) = (as_it_stood(last.at), as_it_stood(at));
        if self.bumper.allows_motion(&from, &to, time_s) {
            next.at = at;
            next.posture = support.posture(at, last.posture, time_s);
        } else {
            self.momentum.velocity = PlanarVelocity::default();
            next.velocity = PlanarVelocity::default();
        }
        next
    }
}

/// Postures at the multiples of `POSTURE_STEP_S`.
///
/// Each settles from the one before: under a roof, the ground is what was below the wheels a moment ago.
/// They are kept in blocks; of blocks that are gone the first posture stays, to compute them again.
#[derive(Clone)]
struct PostureTrack {
    chassis: Chassis,
    scene: Arc<Scene>,
    path: Arc<Path>,
    /// The last step: at the end of the path or just after it.
    last_step: usize,
    /// Posture at the beginning of each block reached so far; at 2.5 s a block, at most 8 MB for the longest
    /// path of 10 days.
    block_starts: Vec<Posture>,
    /// The blocks computed last, the last at the back.
    blocks: VecDeque<Block>,
}

#[derive(Clone)]
struct Block {
    number: usize,
    /// At the block's steps and at the first step of the next.
    postures: Vec<Posture>,
}

const STEPS_PER_BLOCK: usize = 500;

const MAX_BLOCKS: usize = 8;

/// A vehicle starts on the lowest ground above z = 0 that has room for its wheels, sought up to here, metres.
const MAX_START_M: f64 = 100.0;

/// Ground farther below than this is no ground, metres.
const MAX_DEPTH_M: f64 = 100.0;

impl PostureTrack {
    fn new(chassis: Chassis, scene: Arc<Scene>, path: Arc<Path>) -> Self {
        let mut track = Self {
            chassis,
            last_step: libm::ceil(path.duration_s() / POSTURE_STEP_S) as usize,
            block_starts: Vec::new(),
            blocks: VecDeque::new(),
            scene,
            path,
        };
        let start = track.settled(0, track.above_ground());
        track.block_starts.push(start);
        track
    }

    fn posture(&mut self, time_s: f64) -> Posture {
        let steps = (time_s / POSTURE_STEP_S).clamp(0.0, self.last_step as f64);
        let step = libm::floor(steps) as usize;
        let in_block = step % STEPS_PER_BLOCK;
        let share = steps - step as f64;
        let block = self.block(step / STEPS_PER_BLOCK);
        match block.get(in_block..=in_block + 1) {
            Some([before, after]) => before.towards(after, share),
            _ => Posture::default(),
        }
    }

    fn block(&mut self, number: usize) -> &[Posture] {
        if self.blocks.iter().all(|block| block.number != number) {
            let first_new = number.min(self.block_starts.len() - 1);
            for computed in first_new..=number {
                self.compute(computed);
            }
        }
        let block = self.blocks.iter().rfind(|block| block.number == number);
        block.map_or(&[], |block| &block.postures)
    }

    /// Appends a block whose first posture is known.
    fn compute(&mut self, number: usize) {
        let first_step = number * STEPS_PER_BLOCK;
        let mut posture = self.block_starts.get(number).copied().unwrap_or_default();
        let mut postures = Vec::with_capacity(STEPS_PER_BLOCK + 1);
        postures.push(posture);
        for step in first_step + 1..=first_step + STEPS_PER_BLOCK {
            if step <= self.last_step {
                posture = self.settled(step, posture);
            }
            postures.push(posture);
        }
        if self.block_starts.len() == number + 1 {
            self.block_starts.push(posture);
        }
        if self.blocks.len() == MAX_BLOCKS {
            self.blocks.pop_front();
        }
        self.blocks.push_back(Block { number, postures });
    }

    fn settled(&self, step: usize, last: Posture) -> Posture {
        let time_s = step as f64 * POSTURE_STEP_S;
        self.settle(self.path.planar_pose(time_s), last, time_s)
    }

    /// How the vehicle stands at `at`, on its path or off it, where it stood as `last` shortly before.
    fn settle(&self, at: PlanarPose, last: Posture, time_s: f64) -> Posture {
        let ground_below = |point| ground_below(&self.scene, point, time_s);
        self.chassis.settle(at, last, &ground_below)
    }

    /// Level at the lowest height from which the middle of the vehicle has ground below it.
    fn above_ground(&self) -> Posture {
        let at = self.path.planar_pose(0.0).position_m;
        let step_m = self.chassis.wheel_radius_m;
        let mut z_m = 0.0;
        while z_m < MAX_START_M {
            let top = Point3::new(at.x, at.y, z_m + 2.0 * self.chassis.wheel_radius_m);
            if ground_below(&self.scene, top, 0.0).is_some() {
                break;
            }
            z_m += step_m;
        }
        Posture {
            z_m,
            ..Posture::default()
        }
    }
}

/// Height of the first surface below `point`, 0 where there is none; `None` inside a solid. Metres.
fn ground_below(scene: &Scene, point: Point3<f64>, time_s: f64) -> Option<f64> {
    match scene.cast(point, -Vector3::z(), MAX_DEPTH_M, time_s) {
        None => Some(0.0),
        Some(hit) => (hit.normal != Vector3::zeros()).then_some(point.z - hit.distance_m),
    }
}

#[cfg(test)]
mod tests;
