//! From revolution to revolution.

use std::collections::HashSet;

use measurement::cloud::Cloud;
use measurement::pose::{Pose, planar, yaw_rad};
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Matrix6, Point3, UnitQuaternion, Vector3, Vector6};
use rustc_hash::FxBuildHasher;

use super::point_to_plane::{LEAST_POINTS, register};
use super::surface_map::{SurfaceMap, box_of};
use crate::dead_reckoning::StampedPose;
use crate::pose_buffer::Segment;
use crate::scan_localization::MotionPrior;

/// The first point in each cube with this side goes to the map, metres, …
const MAP_SIDES_M: [f64; 3] = [0.1; 3];
/// … and of these the first in each of these boxes is registered: of walls more than of the ground, which else outnumber them.
const REGISTERED_SIDES_M: [f64; 3] = [0.6, 0.6, 0.15];
/// Farther points are left out, and so is what the map shows farther away, metres.
const MAX_RANGE_M: f64 = 60.0;
/// A revolution goes to the map after this way, metres, or this turn, radians.
const MAP_STEP_M: f64 = 0.1;
const MAP_STEP_RAD: f64 = 0.05;
/// The map is cleared of what is far away after this way, metres.
const CLEAR_STEP_M: f64 = 5.0;
/// Standard deviation of the expected poses: before any was compared, and at least, metres.
const FIRST_SIGMA_M: f64 = 0.5;
const LEAST_SIGMA_M: f64 = 0.1;
/// Share of the newest expected pose in that standard deviation.
const NEWEST: f64 = 0.1;
/// Distance at which a turn counts as a way in it, metres.
const ARM_M: f64 = 10.0;
/// The motion within a revolution is taken anew if the expected one was farther off, metres, so many times at most.
const SWEEP_M: f64 = 0.03;
const MAX_AGAIN: usize = 4;
/// Parts of a revolution with a pose each.
const PARTS: i32 = 128;
/// Roll and pitch come to those of the attitude sensor in about this time, seconds: its errors in curves and by its mounting, which turn
/// with the vehicle, are longer over by then than those of the clouds grow.
const GRAVITY_S: f64 = 20.0;
/// The map begins anew after so many revolutions in sequence that do not fit it.
const MAX_UNMATCHED: u32 = 3;
/// And after so many stripes: some show the sky, or only ground that none showed before.
const MAX_UNMATCHED_STRIPES: u32 = 20;
/// Standard deviations of the expected motion between revolutions: shares of its way and of its turn, and at least, metres and radians. By
/// the least a cloud outweighs it where it determines the pose: slip and drift of odometry have one sign for long.
const WAY_SHARE: f64 = 0.1;
const TURN_SHARE: f64 = 0.05;
const LEAST_WAY_M: f64 = 0.05;
const LEAST_TURN_RAD: f64 = 0.02;
/// One stripe determines little, so for stripes the least is this share of it, and the height is surer than the way by this share.
const STRIPE_SHARE: f64 = 0.1;
const RISE_SHARE: f64 = 0.05;
/// Standard deviation of roll and pitch by an attitude sensor, radians.
const ATTITUDE_RAD: f64 = 0.003;
/// Clouds may overlap; their middles then are at least this far apart, seconds.
const LEAST_MOTION_S: f64 = 1e-3;
/// Times between revolutions, as shares of the one before, for which the velocity is known.
const LIKE_BEFORE: std::ops::Range<f64> = 0.2..5.0;

/// One revolution and what is known about the motion.
#[derive(Clone, Copy, Debug)]
pub struct Revolution<'a> {
    /// Its points.
    pub cloud: &'a Cloud,
    /// From which the points' times count.
    pub stamp: RobotTime,
    /// Pose of the sensor on the vehicle.
    pub base_from_sensor: Pose,
    /// Poses of the vehicle by other sensors at the first and at the last point.
    pub prior: [StampedPose; 2],
    /// What these say.
    pub motion: MotionPrior,
    /// Their roll and pitch are those of an attitude sensor.
    pub has_gravity: bool,
    /// It shows a stripe of the surroundings, the next one another.
    pub is_stripe: bool,
}

/// Where the vehicle was in a revolution.
#[derive(Clone, Copy, Debug)]
pub struct CloudPose {
    /// At its first point; `odom` begins at the first prior pose.
    pub odom_from_base: Pose,
    /// Of x, y, z (metres) and of turns about these axes of `odom` (radians), about the vehicle: how well the points determine it. Where
    /// they do not, what the motion was expected to be.
    pub covariance: Matrix6<f64>,
    /// The points lie on what the ones before showed.
    pub is_matched: bool,
}

/// Standard deviations up to which a place (metres) and a heading (radians) are known.
const KNOWN_M: f64 = 0.05;
const KNOWN_RAD: f64 = 0.02;

impl CloudPose {
    /// Whether the points determine place and heading.
    pub fn is_determined(&self) -> bool {
        let known = |at, most: f64| self.covariance[(at, at)] <= most * most;
        self.is_matched && known(0, KNOWN_M) && known(1, KNOWN_M) && known(5, KNOWN_RAD)
    }
}

/// Registers the revolutions of one sensor.
#[derive(Clone, Debug, Default)]
pub struct CloudMatcher {
    map: SurfaceMap,
    last: Option<Last>,
    /// All that the map shows, and the pose at its first point, as long as the motion within it is not known.
    first: Option<(Vec<SweptPoint>, Pose)>,
    /// Revolutions in sequence that did not fit the map.
    unmatched: u32,
    variance_m2: Option<f64>,
}

/// The revolution before. Its poses are those at the middle of it, where an error of the motion within it does least.
#[derive(Clone, Copy, Debug)]
struct Last {
    stamp: RobotTime,
    prior: Pose,
    local_from_base: Pose,
    /// `local` is the frame of the map, which never turns to gravity.
    odom_from_local: Pose,
    /// From the one before it, and its time.
    motion: Pose,
    motion_s: f64,
    /// Of `local_from_base`.
    covariance: Matrix6<f64>,
    in_map: Pose,
    cleared_at: Point3<f64>,
}

/// A point in the frame of the vehicle at its own time, which is this share of the revolution after its middle.
#[derive(Clone, Copy, Debug)]
struct SweptPoint {
    in_base: Point3<f64>,
    after_middle: f64,
}

impl CloudMatcher {
    /// Takes a revolution, in the order of time. Points for which `is_own` holds in the frame of the vehicle are left out.
    pub fn push(
        &mut self,
        revolution: &Revolution<'_>,
        is_own: impl Fn(&Point3<f64>) -> bool,
    ) -> CloudPose {
        let [begin, end] = revolution.prior;
        let duration = end.0.since(begin.0);
        let stamp = begin.0 + RobotDuration::from_nanos(duration.as_nanos() / 2);
        let prior = Segment::between(begin, end, end.0).pose_at(stamp);
        let by_prior = begin.1.inv_mul(&end.1);
        let swept = swept_points(revolution, is_own);
        let Some(mut last) = self.last else {
            let sweep = combined(revolution, &by_prior, &Pose::identity());
            self.map.insert(&placed(&swept, &sweep), &prior);
            self.first = Some((swept, begin.1));
            self.last = Some(Last::first(stamp, prior));
            return CloudPose {
                odom_from_base: begin.1,
                covariance: Matrix6::zeros(),
                is_matched: true,
            };
        };
        let motion_s = stamp.since(last.stamp).as_secs_f64().max(LEAST_MOTION_S);
        let constant = last.constant_motion(motion_s);
        let expected =
            last.local_from_base * combined(revolution, &last.prior.inv_mul(&prior), &constant);
        let (mut expected, prior_covariance) = last.weighed(revolution, expected, &prior);
        let sweep_of = |motion: &Pose| {
            let within = part_of(motion, duration.as_secs_f64() / motion_s);
            combined(revolution, &by_prior, &within)
        };
        let sigma_m = libm::sqrt(self.variance_m2.unwrap_or(FIRST_SIGMA_M * FIRST_SIGMA_M));
        let mut sweep = sweep_of(&constant);
        let mut points = placed(&swept, &sweep);
        let register =
            |map: &mut SurfaceMap, points: &[Point3<f64>], start: &Pose, expected: &Pose| {
                let expected = (expected, &prior_covariance);
                register(map, &thinned(points), start, expected, sigma_m)
            };
        let mut registered = register(&mut self.map, &points, &expected, &expected);
        for _ in 0..MAX_AGAIN {
            let Some(mut found) = registered.map(|of| of.local_from_base) else {
                break;
            };
            let now = sweep_of(&last.local_from_base.inv_mul(&found));
            if distance_m(&sweep, &now) <= SWEEP_M {
                break;
            }
            sweep = now;
            points = placed(&swept, &sweep);
            if let Some((first, local_from_base)) = &self.first {
                let middle = local_from_base * part_of(&sweep, 0.5);
                found = middle * last.local_from_base.inv_mul(&found);
                expected = middle * last.local_from_base.inv_mul(&expected);
                last.local_from_base = middle;
                last.in_map = middle;
                self.map.clear();
                self.map.insert(&placed(first, &sweep), &middle);
            }
            registered = register(&mut self.map, &points, &found, &expected);
        }
        self.first = None;
        let local_from_base = registered.map_or(expected, |of| of.local_from_base);
        let covariance = registered.map_or(prior_covariance, |of| of.covariance);
        last = Last {
            stamp,
            prior,
            local_from_base,
            motion: last.local_from_base.inv_mul(&local_from_base),
            motion_s,
            covariance,
            ..last
        };
        // Without any sensor the vehicle is level on the whole.
        if revolution.has_gravity || registered.is_none() {
            last.turn_to_gravity(motion_s / GRAVITY_S);
        }
        if registered.is_some() {
            self.unmatched = 0;
            self.learn(distance_m(&expected, &local_from_base));
        } else {
            self.unmatched += 1;
        }
        self.add(&points, &mut last, revolution.is_stripe);
        self.last = Some(last);
        let turned = last.odom_from_local.rotation.to_rotation_matrix();
        let mut in_odom = Matrix6::zeros();
        for at in [0, 3] {
            let mut block = in_odom.fixed_view_mut::<3, 3>(at, at);
            block.copy_from(turned.matrix());
        }
        CloudPose {
            odom_from_base: last.odom_from_local * local_from_base * part_of(&sweep, -0.5),
            covariance: in_odom * covariance * in_odom.transpose(),
            is_matched: registered.is_some()
                || revolution.is_stripe && self.unmatched < MAX_UNMATCHED_STRIPES,
        }
    }

    /// How far the expected pose was off.
    fn learn(&mut self, error_m: f64) {
        let before = self.variance_m2.unwrap_or(error_m * error_m);
        let variance_m2 = before + NEWEST * (error_m * error_m - before);
        self.variance_m2 = Some(variance_m2.max(LEAST_SIGMA_M * LEAST_SIGMA_M));
    }

    /// Adds a revolution that fits the map and was taken elsewhere than what is in it.
    fn add(&mut self, points: &[Point3<f64>], last: &mut Last, is_stripe: bool) {
        let max_unmatched = if is_stripe {
            MAX_UNMATCHED_STRIPES
        } else {
            MAX_UNMATCHED
        };
        let begins_anew = self.unmatched >= max_unmatched && points.len() >= LEAST_POINTS as usize;
        if begins_anew {
            self.unmatched = 0;
            self.map.clear();
        }
        let since = last.in_map.inv_mul(&last.local_from_base);
        let has_moved =
            since.translation.vector.norm() > MAP_STEP_M || since.rotation.angle() > MAP_STEP_RAD;
        if begins_anew || is_stripe || self.unmatched == 0 && has_moved {
            self.map.insert(points, &last.local_from_base);
            last.in_map = last.local_from_base;
        }
        let place = Point3::from(last.local_from_base.translation.vector);
        if (place - last.cleared_at).norm() > CLEAR_STEP_M {
            self.map.keep_around(&place, MAX_RANGE_M + CLEAR_STEP_M);
            last.cleared_at = place;
        }
    }
}

impl Last {
    fn first(stamp: RobotTime, prior: Pose) -> Self {
        Self {
            stamp,
            prior,
            local_from_base: prior,
            odom_from_local: Pose::identity(),
            motion: Pose::identity(),
            motion_s: 0.0,
            covariance: Matrix6::zeros(),
            in_map: prior,
            cleared_at: prior.translation.vector.into(),
        }
    }

    /// The covariance of an expected pose; and for a stripe roll and pitch by the attitude sensor.
    fn weighed(
        &self,
        revolution: &Revolution<'_>,
        mut expected: Pose,
        prior: &Pose,
    ) -> (Pose, Matrix6<f64>) {
        let motion = self.local_from_base.inv_mul(&expected);
        let (least, rise) = if revolution.is_stripe {
            (STRIPE_SHARE, RISE_SHARE)
        } else {
            (1.0, 1.0)
        };
        let way_m = least * LEAST_WAY_M + WAY_SHARE * motion.translation.vector.norm();
        let turn_rad = least * LEAST_TURN_RAD + TURN_SHARE * motion.rotation.angle();
        let sigmas = Vector6::new(way_m, way_m, rise * way_m, turn_rad, turn_rad, turn_rad);
        let way = expected.translation.vector - self.local_from_base.translation.vector;
        let mut transport = Matrix6::identity();
        let mut by_turn = transport.fixed_view_mut::<3, 3>(0, 3);
        by_turn.copy_from(&-way.cross_matrix());
        let mut covariance = transport * self.covariance * transport.transpose()
            + Matrix6::from_diagonal(&sigmas.component_mul(&sigmas));
        if revolution.is_stripe && revolution.has_gravity {
            let turn_rad = yaw_rad(&expected) - yaw_rad(prior);
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
            expected.rotation = turn * prior.rotation;
            for at in [3, 4] {
                covariance.row_mut(at).fill(0.0);
                covariance.column_mut(at).fill(0.0);
                covariance[(at, at)] = ATTITUDE_RAD * ATTITUDE_RAD;
            }
        }
        (expected, covariance)
    }

    /// The motion in this time at the velocity before. Times that differ much say nothing about the speed; a vehicle that rises or tilts
    /// soon ceases to.
    fn constant_motion(&self, motion_s: f64) -> Pose {
        let share = motion_s / self.motion_s;
        let share = if LIKE_BEFORE.contains(&share) {
            share
        } else {
            1.0
        };
        let way_m = self.motion.translation.vector * share;
        planar(way_m.x, way_m.y, yaw_rad(&self.motion) * share)
    }

    /// Turns `odom` about the vehicle by a share of what is between its vertical and that of the prior pose.
    fn turn_to_gravity(&mut self, share: f64) {
        let odom_from_base = self.odom_from_local * self.local_from_base;
        let up = odom_from_base.rotation * (self.prior.rotation.inverse() * Vector3::z());
        let turn = UnitQuaternion::from_scaled_axis(up.cross(&Vector3::z()) * share.min(1.0));
        let place = odom_from_base.translation.vector;
        let about = Pose::from_parts((place - turn * place).into(), turn);
        self.odom_from_local = about * self.odom_from_local;
    }
}

/// What is known of a motion, by the other sensors and by constant velocity.
fn combined(revolution: &Revolution<'_>, by_prior: &Pose, constant: &Pose) -> Pose {
    match revolution.motion {
        MotionPrior::None => *constant,
        MotionPrior::Heading => Pose::from_parts(constant.translation, by_prior.rotation),
        MotionPrior::Full if revolution.has_gravity => *by_prior,
        // Odometry is often planar.
        MotionPrior::Full => {
            let (way_m, turn) = (by_prior.translation.vector, by_prior.rotation.scaled_axis());
            let (up_m, tilt) = (constant.translation.z, constant.rotation.scaled_axis());
            Pose::new(
                Vector3::new(way_m.x, way_m.y, up_m),
                Vector3::new(tilt.x, tilt.y, turn.z),
            )
        }
    }
}

/// A share of a small motion.
fn part_of(motion: &Pose, share: f64) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(motion.rotation.scaled_axis() * share);
    Pose::from_parts((motion.translation.vector * share).into(), turn)
}

/// How far two poses are apart, seen from `ARM_M` away.
fn distance_m(a: &Pose, b: &Pose) -> f64 {
    let between = a.inv_mul(b);
    between.translation.vector.norm() + ARM_M * between.rotation.angle()
}

/// One point in each cube of the map.
fn swept_points(
    revolution: &Revolution<'_>,
    is_own: impl Fn(&Point3<f64>) -> bool,
) -> Vec<SweptPoint> {
    let [(begin, _), (end, _)] = revolution.prior;
    let duration_s = end.since(begin).as_secs_f64();
    let begin_s = begin.since(revolution.stamp).as_secs_f64();
    let mut cubes = HashSet::with_hasher(FxBuildHasher);
    let points = revolution.cloud.points.iter().filter_map(|point| {
        let in_sensor = Point3::from(point.position_m.map(f64::from));
        // Not a number fails the comparison.
        if !(in_sensor.coords.norm() <= MAX_RANGE_M
            && cubes.insert(box_of(&in_sensor, MAP_SIDES_M)))
        {
            return None;
        }
        let in_base = revolution.base_from_sensor * in_sensor;
        let share = (f64::from(point.after_s) - begin_s) / duration_s;
        let after_middle = if duration_s > 0.0 { share - 0.5 } else { 0.0 };
        (!is_own(&in_base)).then_some(SweptPoint {
            in_base,
            after_middle,
        })
    });
    points.collect()
}

/// In the frame of the vehicle at the middle of the revolution, in which it moved by `sweep`.
fn placed(points: &[SweptPoint], sweep: &Pose) -> Vec<Point3<f64>> {
    let part = |part| part_of(sweep, f64::from(part) / f64::from(PARTS) - 0.5);
    let middle_from_base: Vec<_> = (0..=PARTS).map(part).collect();
    let points = points.iter().map(|point| {
        let part = ((point.after_middle + 0.5) * f64::from(PARTS)).round() as usize;
        middle_from_base[part.min(middle_from_base.len() - 1)] * point.in_base
    });
    points.collect()
}

fn thinned(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut cubes = HashSet::with_hasher(FxBuildHasher);
    let points = points.iter().copied();
    points
        .filter(|point| cubes.insert(box_of(point, REGISTERED_SIDES_M)))
        .collect()
}
