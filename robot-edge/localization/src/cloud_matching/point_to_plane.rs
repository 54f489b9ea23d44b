//! Registration of points to planes (Chen and Medioni 1992) by Gauss-Newton, with a robust weight.

use measurement::pose::Pose;
use nalgebra::{Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use super::surface_map::SurfaceMap;

const MAX_ITERATIONS: usize = 15;
/// A smaller step is the last one: metres, and radians times the distance of the points.
const LAST_STEP_M: f64 = 1e-3;
/// The first step is made as if the standard deviation of the expected pose were this, metres, each next one as if it were this share of
/// it: a vehicle that begins to turn is elsewhere.
const WIDE_M: f64 = 1.0;
const NARROWER: f64 = 0.6;
/// Such steps use one in so many points, but no fewer than so many.
const WIDE_EVERY: usize = 4;
const WIDE_POINTS: usize = 500;
/// Points farther from a plane than this many standard deviations of the expected pose do not belong to it.
const GATE_SIGMAS: f64 = 3.0;
/// Distance from a plane with a weight of a quarter, as a share of that standard deviation.
const KERNEL_SIGMAS: f64 = 0.5;
/// Standard deviation of a range, metres: points on what is rougher weigh less, and none are more certain.
const RANGE_SIGMA_M: f64 = 0.01;
/// So many times the variance of the planes' normals is no information: level ground does not determine the way ahead.
const TILTS: f64 = 3.0;
/// Errors of so many points are alike: of the same surface, and of the planes of the map.
const POINTS_ALIKE: f64 = 30.0;
/// Fewer points, or a smaller share of those near planes, do not say where the vehicle is.
pub(super) const LEAST_POINTS: u32 = 50;
const LEAST_SHARE: f64 = 0.5;

/// Where points lie in the map.
#[derive(Clone, Copy, Debug)]
pub(super) struct Registered {
    pub(super) local_from_base: Pose,
    /// Of x, y, z (metres) and of turns about them (radians), about the vehicle, along the axes of `local`.
    pub(super) covariance: Matrix6<f64>,
}

/// The pose from which `points` in the frame of the vehicle lie on the planes of `map`, weighed with the expected one and its covariance; the
/// search begins at `start`, whose standard deviation at the distance of the points is `sigma_m`. `None` if too few points lie on planes.
pub(super) fn register(
    map: &mut SurfaceMap,
    points: &[Point3<f64>],
    start: &Pose,
    (expected, prior): (&Pose, &Matrix6<f64>),
    sigma_m: f64,
) -> Option<Registered> {
    let squares: f64 = points.iter().map(|point| point.coords.norm_squared()).sum();
    // Turns are measured in metres at this distance, so that they can be compared with ways.
    let lever_m = libm::sqrt(squares / points.len().max(1) as f64).max(1.0);
    let per_m = 1.0 / lever_m;
    let in_radians = Vector6::new(1.0, 1.0, 1.0, per_m, per_m, per_m);
    let in_radians = in_radians * in_radians.transpose();
    let information = prior.component_div(&in_radians).try_inverse()?;
    let range_variance = RANGE_SIGMA_M * RANGE_SIGMA_M;
    let mut wide_m = WIDE_M;
    let mut pose = *start;
    let mut registered = None;
    for _ in 0..MAX_ITERATIONS {
        let gate_m = GATE_SIGMAS * sigma_m.max(wide_m);
        let kernel_m2 = libm::pow(KERNEL_SIGMAS * sigma_m.max(wide_m), 2.0);
        let (mut hessian, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        let (mut weights, mut weighted_squares, mut tilts) = (0.0, 0.0, 0.0);
        let (mut near, mut inliers) = (0_u32, 0_u32);
        let every = if wide_m > sigma_m {
            (points.len() / WIDE_POINTS).clamp(1, WIDE_EVERY)
        } else {
            1
        };
        for point in points.iter().step_by(every) {
            let seen = pose * point;
            let Some(plane) = map.plane(&seen) else {
                continue;
            };
            near += 1;
            let residual_m = (seen - plane.middle).dot(&plane.normal);
            if residual_m.abs() > gate_m {
                continue;
            }
            inliers += 1;
            let square = residual_m * residual_m;
            let robust = kernel_m2 / (kernel_m2 + square);
            let weight = robust * robust * range_variance / (range_variance + plane.variance_m2);
            let arm = (seen.coords - pose.translation.vector) / lever_m;
            let turn = arm.cross(&plane.normal);
            let normal = plane.normal;
            let row = Vector6::new(normal.x, normal.y, normal.z, turn.x, turn.y, turn.z);
            hessian += row * row.transpose() * weight;
            gradient += row * (weight * residual_m);
            weights += weight;
            tilts += weight * plane.tilt_variance;
            weighted_squares += weight * square;
        }
        if inliers < LEAST_POINTS || f64::from(inliers) < LEAST_SHARE * f64::from(near) {
            return None;
        }
        let variance_m2 = (weighted_squares / weights).max(range_variance) * POINTS_ALIKE;
        let eigen = hessian.symmetric_eigen();
        let mut certain = Matrix6::zeros();
        for (value, direction) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            let share = (1.0 - TILTS * tilts / value).max(0.0);
            certain += direction * direction.transpose() * share;
        }
        hessian = certain * hessian;
        gradient = certain * gradient;
        let way_m = pose.translation.vector - expected.translation.vector;
        let turn = (pose.rotation * expected.rotation.inverse()).scaled_axis() * lever_m;
        let off = Vector6::new(way_m.x, way_m.y, way_m.z, turn.x, turn.y, turn.z);
        let covariance = (hessian / variance_m2 + information).try_inverse()?;
        let step = -covariance * (gradient / variance_m2 + information * off);
        registered = Some(Registered {
            local_from_base: pose,
            covariance: covariance.component_mul(&in_radians),
        });
        if step.norm() < LAST_STEP_M && wide_m <= sigma_m {
            break;
        }
        wide_m *= NARROWER;
        let turn = Vector3::new(step[3], step[4], step[5]) / lever_m;
        let mut rotation = UnitQuaternion::from_scaled_axis(turn) * pose.rotation;
        rotation.renormalize();
        let way_m = Vector3::new(step[0], step[1], step[2]);
        pose = Pose::from_parts(
            Translation3::from(pose.translation.vector + way_m),
            rotation,
        );
    }
    registered
}
