//! How a vehicle stands along its path, computed from one instant to the next.

use std::collections::VecDeque;
use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::POSTURE_STEP_S;
use crate::chassis::{Chassis, Posture};
use crate::path::{Path, PlanarPose};
use crate::scene::Scene;

/// Postures at the multiples of [`POSTURE_STEP_S`].
///
/// Each settles from the one before: under a roof, the ground is what was below the wheels a moment ago.
/// They are kept in blocks; of blocks that are gone the first posture stays, to compute them again.
#[derive(Clone)]
pub(super) struct PostureTrack {
    chassis: Chassis,
    scene: Arc<Scene>,
    path: Arc<Path>,
    /// The last step: at the end of the path or just after it.
    last_step: usize,
    /// Posture at the beginning of each block reached so far; at 2.5 s a block, at most 8 MB for the longest
    /// path of 10 days.
    block_starts: Vec<Posture>,
    /// The blocks used last, the last at the back.
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
    pub(super) fn new(chassis: Chassis, scene: Arc<Scene>, path: Arc<Path>) -> Self {
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

    pub(super) fn posture(&mut self, time_s: f64) -> Posture {
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
        if let Some(kept) = self.blocks.iter().rposition(|block| block.number == number) {
            // Almost always the last one already.
            if kept + 1 < self.blocks.len()
                && let Some(block) = self.blocks.remove(kept)
            {
                self.blocks.push_back(block);
            }
        } else {
            let first_new = number.min(self.block_starts.len() - 1);
            for computed in first_new..=number {
                self.compute(computed);
            }
        }
        self.blocks.back().map_or(&[], |block| &block.postures)
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
    pub(super) fn settle(&self, at: PlanarPose, last: Posture, time_s: f64) -> Posture {
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
pub(super) fn ground_below(scene: &Scene, point: Point3<f64>, time_s: f64) -> Option<f64> {
    match scene.cast(point, -Vector3::z(), MAX_DEPTH_M, time_s) {
        None => Some(0.0),
        Some(hit) => (hit.normal != Vector3::zeros()).then_some(point.z - hit.distance_m),
    }
}
