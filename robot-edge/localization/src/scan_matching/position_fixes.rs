//! Positions on Earth as factors of the pose graph: they say where the map lies and which way it faces, and bound its drift.
//!
//! A receiver gives the position of its antenna, not the heading. So a map is turned and moved to the frame of the positions once the
//! way of the vehicle is long enough (B. Horn, "Closed-form solution of absolute orientation", JOSA A 1987, in the plane). From then
//! on each position pulls at one keyframe, with the robust kernel of closures: a leap or an echo from a wall (multipath) loses its weight.

use std::collections::VecDeque;

use measurement::time::RobotTime;
use nalgebra::{Isometry2, Matrix2x3, Point2, Vector2};

/// A position that a receiver measured.
#[derive(Clone, Copy, Debug)]
pub struct AntennaPosition {
    /// When.
    pub stamp: RobotTime,
    /// Of the antenna, metres east and north of the datum.
    pub antenna: Point2<f64>,
    /// Standard deviation along each axis, metres.
    pub sigma_m: f64,
}

/// Way between two positions in the graph, metres: errors of a receiver last, so that more of them say no more.
const SPACING_M: f64 = 2.0;
/// Positions that wait for a scan; beyond it the oldest is dropped.
const MAX_WAITING: usize = 64;

/// Positions that no scan has passed yet.
#[derive(Clone, Debug, Default)]
pub(super) struct PendingPositions {
    waiting: VecDeque<AntennaPosition>,
    /// Way at the newest one that was taken, metres.
    taken_m: Option<f64>,
}

impl PendingPositions {
    /// Adds one; returns whether the oldest was dropped for it.
    pub(super) fn push(&mut self, position: AntennaPosition) -> bool {
        let is_full = self.waiting.len() >= MAX_WAITING;
        if is_full {
            self.waiting.pop_front();
        }
        self.waiting.push_back(position);
        is_full
    }

    /// The first one between two scans, and how far between them it is, if it is due on the way. The others up to the second scan go.
    pub(super) fn take_due(
        &mut self,
        [before, after]: [RobotTime; 2],
        driven_m: f64,
    ) -> Option<(AntennaPosition, f64)> {
        let passed = self.waiting.partition_point(|next| next.stamp <= after);
        let mut passed = self.waiting.drain(..passed);
        let is_due = self
            .taken_m
            .is_none_or(|taken_m| driven_m - taken_m >= SPACING_M);
        let position = passed.find(|position| is_due && position.stamp > before)?;
        self.taken_m = Some(driven_m);
        let share = position.stamp.since(before).as_secs_f64() / after.since(before).as_secs_f64();
        Some((position, share))
    }
}

/// A position that was measured near a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionFix {
    /// The keyframe.
    pub keyframe: u32,
    /// The antenna in the frame of the keyframe, metres.
    pub keyframe_from_antenna: Point2<f64>,
    /// Its position, metres east and north of the datum.
    pub antenna: Point2<f64>,
    /// Standard deviation along each axis, metres.
    pub sigma_m: f64,
    /// The frame of the map at the keyframe is that of the positions.
    pub is_aligned: bool,
}

impl PositionFix {
    /// The error in the frame of the keyframe in standard deviations, and its derivative by a step of the keyframe.
    pub(super) fn error(
        &self,
        map_from_keyframe: &Isometry2<f64>,
    ) -> (Vector2<f64>, Matrix2x3<f64>) {
        let place = self.keyframe_from_antenna;
        let error = place - map_from_keyframe.inverse_transform_point(&self.antenna);
        let by_step = Matrix2x3::new(1.0, 0.0, -place.y, 0.0, 1.0, place.x);
        (error / self.sigma_m, by_step / self.sigma_m)
    }
}

/// Where the antenna is by the map and by its receiver, metres, and the standard deviation of the latter.
pub(super) type Pair = (Point2<f64>, Point2<f64>, f64);

/// Greatest standard deviation of the heading of an aligned map, radians.
const ALIGNED_RAD: f64 = 0.035;
/// An error up to so many standard deviations, and this share of the distance from the middle of the way, agrees: the map has a drift.
const AGREES: f64 = 3.0;
const DRIFT: f64 = 0.1;
/// Least share of the positions that must agree, and their least number.
const LEAST_SHARE: f64 = 0.75;
const LEAST_PAIRS: usize = 4;

/// Where the frame of the map lies in that of the positions; `None` where they do not determine it or contradict each other.
pub(super) fn alignment(pairs: &[Pair]) -> Option<Isometry2<f64>> {
    let least = LEAST_PAIRS.max(libm::ceil(LEAST_SHARE * pairs.len() as f64) as usize);
    let mut agreeing = pairs.to_vec();
    let mut pose = align(&agreeing)?.0;
    let middle = pairs.iter().map(|pair| pair.0.coords).sum::<Vector2<f64>>() / pairs.len() as f64;
    // 1 where it just agrees.
    let error = |pose: &Isometry2<f64>, (in_map, measured, sigma_m): &Pair| {
        let limit_m = AGREES * sigma_m + DRIFT * (in_map.coords - middle).norm();
        (pose * in_map - measured).norm() / limit_m
    };
    // Without those that agree least, as one that is far off may turn all.
    for _ in 0..3 {
        agreeing = pairs.to_vec();
        agreeing.sort_by(|a, b| error(&pose, a).total_cmp(&error(&pose, b)));
        agreeing.truncate(least);
        pose = align(&agreeing)?.0;
    }
    agreeing = pairs.to_vec();
    agreeing.retain(|pair| error(&pose, pair) <= 1.0);
    if agreeing.len() < least {
        return None;
    }
    let (pose, sigma_rad) = align(&agreeing)?;
    (sigma_rad <= ALIGNED_RAD).then_some(pose)
}

/// By least squares, and the standard deviation of the heading.
fn align(pairs: &[Pair]) -> Option<(Isometry2<f64>, f64)> {
    let weights = pairs
        .iter()
        .map(|(_, _, sigma_m)| 1.0 / (sigma_m * sigma_m));
    let pairs = || pairs.iter().zip(weights.clone());
    let sum: f64 = weights.clone().sum();
    let mean = |of: fn(&Pair) -> Point2<f64>| {
        let weighted = pairs().map(|(pair, weight)| of(pair).coords * weight);
        weighted.sum::<Vector2<f64>>() / sum
    };
    let (in_map, measured) = (mean(|pair| pair.0), mean(|pair| pair.1));
    let (mut dot, mut cross, mut spread) = (0.0, 0.0, 0.0);
    for (pair, weight) in pairs() {
        let (a, b) = (pair.0.coords - in_map, pair.1.coords - measured);
        dot += weight * a.dot(&b);
        cross += weight * a.perp(&b);
        spread += weight * a.norm_squared();
    }
    let turn = Isometry2::rotation(libm::atan2(cross, dot));
    let place = measured - turn * in_map;
    let pose = Isometry2::from_parts(place.into(), turn.rotation);
    (spread > 0.0).then(|| (pose, 1.0 / libm::sqrt(spread)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A way with a bend of 2 m steps, measured with errors of some centimetres to metres; then `leaps` that are 30 m off.
    fn pairs(steps: usize, sigma_m: f64, leaps: usize) -> (Isometry2<f64>, Vec<Pair>) {
        let truth = Isometry2::new(Vector2::new(100.0, -40.0), 2.0);
        let pairs = (0..steps).map(|step| {
            let along_m = 2.0 * step as f64;
            let in_map = Point2::new(along_m.min(20.0), (along_m - 20.0).max(0.0));
            let error = Vector2::new(libm::sin(3.7 * along_m), libm::cos(2.3 * along_m)) * sigma_m;
            let leap = Vector2::new(0.0, if step < leaps { 30.0 } else { 0.0 });
            (in_map, truth * in_map + error + leap, sigma_m)
        });
        (truth, pairs.collect())
    }

    #[test]
    fn a_way_is_aligned_once_it_is_long_enough_and_leaps_do_not_matter() {
        for (steps, sigma_m, leaps, is_aligned) in [
            (3, 0.02, 0, false),
            (4, 0.02, 0, true),
            (12, 2.0, 0, false),
            (40, 2.0, 0, true),
            (40, 2.0, 10, true),
            (40, 2.0, 14, false),
        ] {
            let (truth, pairs) = pairs(steps, sigma_m, leaps);
            let found = alignment(&pairs);
            assert_eq!(found.is_some(), is_aligned, "{steps} {sigma_m} {leaps}");
            let Some(found) = found else { continue };
            let error = truth.inv_mul(&found);
            assert!(error.rotation.angle().abs() < 0.05, "{error}");
            assert!(error.translation.vector.norm() < sigma_m, "{error}");
        }
    }

    #[test]
    fn the_derivative_is_that_of_the_error() {
        let fix = PositionFix {
            keyframe: 0,
            keyframe_from_antenna: Point2::new(0.5, -0.3),
            antenna: Point2::new(3.0, 4.0),
            sigma_m: 0.5,
            is_aligned: true,
        };
        let pose = Isometry2::new(Vector2::new(2.4, 4.1), 1.1);
        let (error, by_step) = fix.error(&pose);
        for axis in 0..3 {
            let mut step = nalgebra::Vector3::zeros();
            step[axis] = 1e-6;
            let (moved, _) = fix.error(&super::super::submap::moved(&pose, &step));
            let by_axis = by_step.column(axis).into_owned();
            // The error itself turns with the frame of the keyframe, which matters in the second order where it is small.
            let difference = (moved - error) / 1e-6 - by_axis;
            assert!(
                difference.norm() < 2.0 * error.norm() + 1e-6,
                "{difference}"
            );
        }
    }
}
