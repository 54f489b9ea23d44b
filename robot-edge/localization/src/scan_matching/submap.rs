//! A submap: what the scans of a few metres of driving saw, as small Gaussians, and the registration of points
//! against it by least squares.
//!
//! The map is that of the normal distributions transform (P. Biber, W. Straßer, "The Normal Distributions Transform",
//! IROS 2003), with cells so small that those around a point are merged, weighted by their distance, into one
//! distribution (moving least squares, as in J.-E. Deschaud, "IMLS-SLAM", ICRA 2018). The residual of a point
//! is its distance across that distribution: a line where the map shows a wall (A. Censi, "An ICP variant using a
//! point-to-line metric", ICRA 2008), a point where it shows a post or a corner. Directions that the scan does not
//! determine are found and left to the prior as in J. Zhang, M. Kaess, S. Singh, "On Degeneracy of
//! Optimization-based State Estimation Problems", ICRA 2016.

use nalgebra::{Isometry2, Matrix2, Matrix3, Point2, Vector2, Vector3};
use rustc_hash::FxHashMap;

use super::scan_points::ScanPoint;
use super::search_grid::SearchGrid;

/// Side of a cell, metres.
const CELL_M: f64 = 0.1;
/// Cells on either side of a point's own that are merged.
const REACH: i16 = 2;
/// Distance at which the weight of a cell becomes zero, metres.
const REACH_M: f64 = 0.22;
/// Standard deviation of a hit across a surface, with the errors of the model, metres.
const HIT_SIGMA_M: f64 = 0.04;
/// Residual at which the weight of a point has fallen to a quarter, metres.
const OUTLIER_M: f64 = 0.1;
/// A residual below this is an inlier, metres.
const INLIER_M: f64 = 0.1;
/// A direction is degenerate whose share of the greatest possible information, by surfaces as far as they are trusted, is
/// below this: with a prior that can determine it, and without one.
const DEGENERATE_SHARE: (f64, f64) = (0.02, 0.01);
/// Points, weighted by their distance, that may show a post or a corner, and that are trusted by half.
const MIN_POINTS: f64 = 5.0;
const MAX_ITERATIONS: usize = 12;

/// Points of a cell that were seen from about one direction.
#[derive(Clone, Copy, Debug)]
struct Surfel {
    /// Number of points.
    weight: f32,
    mean: Vector2<f32>,
    /// Sum of squares about the mean: xx, xy, yy.
    scatter: [f32; 3],
    /// Sum of the directions of the beams.
    view: Vector2<f32>,
    /// The next of the same cell, that was seen from another direction.
    next: Option<u32>,
}

/// Map of a few metres of driving, in the frame of its first keyframe (its anchor).
#[derive(Clone, Debug, Default)]
pub struct Submap {
    surfels: Vec<Surfel>,
    /// The first surfel of each cell. Never iterated.
    cells: FxHashMap<(i16, i16), u32>,
}

/// Distribution of the map around a point.
struct Surface {
    mean: Vector2<f64>,
    /// Of unit length, the direction of the least variance.
    across: Vector2<f64>,
    /// Inverse variance of a hit across and along it, 1/m².
    information: [f64; 2],
    /// 0 to 1; little where few points were seen, whose direction is that of their noise.
    trust: f64,
}

/// A prior of a registration.
#[derive(Clone, Copy, Debug)]
pub struct Prior {
    /// Its middle.
    pub submap_from_base: Isometry2<f64>,
    /// Of x, y (metres) and yaw (radians) in the frame of the vehicle.
    pub covariance: Matrix3<f64>,
}

/// Result of a registration.
#[derive(Clone, Copy, Debug)]
pub struct Registered {
    /// The pose.
    pub submap_from_base: Isometry2<f64>,
    /// Information of the scan alone about x, y (metres) and yaw (radians) in the frame of the vehicle, degenerate
    /// directions left out.
    pub information: Matrix3<f64>,
    /// Number of degenerate directions.
    pub degenerate: usize,
    /// The translation that is determined least is degenerate: its direction in the frame of the vehicle.
    pub uncertain_along: Option<Vector2<f64>>,
    /// Share of the points that lie on surfaces of the map.
    pub inliers: f64,
    /// Root mean square of the inliers' residuals, metres.
    pub residual_m: f64,
}

impl Submap {
    /// Of each surfel its weight, mean, scatter and view.
    pub(super) fn to_numbers(&self) -> Vec<[f32; 8]> {
        let numbers = self.surfels.iter().map(|surfel| {
            let ([xx, xy, yy], mean, view) = (surfel.scatter, surfel.mean, surfel.view);
            [surfel.weight, mean.x, mean.y, xx, xy, yy, view.x, view.y]
        });
        numbers.collect()
    }

    /// The opposite of [`Submap::to_numbers`]; none if a surfel lies in no cell or shows nothing.
    pub(super) fn from_numbers(surfels: &[[f32; 8]]) -> Option<Self> {
        let mut submap = Self::default();
        for &[weight, x, y, xx, xy, yy, view_x, view_y] in surfels {
            let (mean, view) = (Vector2::new(x, y), Vector2::new(view_x, view_y));
            let is_surfel = weight >= 1.0
                && view.norm() > 0.0
                && [weight, view.norm(), xx, xy, yy]
                    .iter()
                    .all(|number| number.is_finite());
            if !is_surfel {
                return None;
            }
            // The mean of points of a cell lies in it.
            let cell = cell_of(&Point2::from(mean.cast()))?;
            let next = submap.cells.insert(cell, submap.surfels.len() as u32);
            submap.surfels.push(Surfel {
                weight,
                mean,
                scatter: [xx, xy, yy],
                view,
                next,
            });
        }
        Some(submap)
    }

    /// Whether nothing was added yet.
    pub fn is_empty(&self) -> bool {
        self.surfels.is_empty()
    }

    /// Adds a point in the frame of the submap. Points beyond 3 km are left out.
    pub fn add(&mut self, point: &ScanPoint) {
        let Some(cell) = cell_of(&point.position) else {
            return;
        };
        let view = point.view.cast::<f32>();
        let first = self.cells.get(&cell).copied();
        let mut own = first;
        while let Some(at) = own
            && self.surfels[at as usize].view.dot(&view) < 0.0
        {
            own = self.surfels[at as usize].next;
        }
        let position = point.position.coords.cast::<f32>();
        if let Some(at) = own {
            let surfel = &mut self.surfels[at as usize];
            surfel.weight += 1.0;
            let before = position - surfel.mean;
            surfel.mean += before / surfel.weight;
            let after = position - surfel.mean;
            surfel.scatter[0] += before.x * after.x;
            surfel.scatter[1] += before.x * after.y;
            surfel.scatter[2] += before.y * after.y;
            surfel.view += *view;
        } else {
            let at = self.surfels.len() as u32;
            self.surfels.push(Surfel {
                weight: 1.0,
                mean: position,
                scatter: [0.0; 3],
                view: *view,
                next: first,
            });
            self.cells.insert(cell, at);
        }
    }

    /// Mean points of its cells, with the directions from which they were seen, in the order in which they were found.
    pub fn points(&self) -> impl Iterator<Item = ScanPoint> {
        self.surfels.iter().map(|surfel| ScanPoint {
            position: Point2::from(surfel.mean.cast()),
            view: nalgebra::Unit::new_normalize(surfel.view.cast()),
        })
    }

    /// Its grid for a correlative search.
    pub fn search_grid(&self) -> SearchGrid {
        let mut grid = SearchGrid::default();
        for point in self.points() {
            grid.add(&point.position);
        }
        grid
    }

    /// Whether a point in the frame of the submap lies on a surface, seen from the same side.
    pub fn is_on_surface(&self, point: &ScanPoint) -> bool {
        self.surface(point).is_some_and(|surface| {
            let way = point.position.coords - surface.mean;
            way.dot(&surface.across).abs() < INLIER_M
        })
    }

    fn surface(&self, point: &ScanPoint) -> Option<Surface> {
        let (column, row) = cell_of(&point.position)?;
        let view = point.view.cast::<f32>();
        let position = point.position.coords.cast::<f32>();
        let (mut weight, mut mean, mut scatter) = (0.0, Vector2::zeros(), [0.0; 3]);
        for y in row - REACH..=row + REACH {
            for x in column - REACH..=column + REACH {
                let mut next = self.cells.get(&(x, y)).copied();
                while let Some(at) = next {
                    let surfel = &self.surfels[at as usize];
                    next = surfel.next;
                    // Relative to the point, for precision.
                    let way = surfel.mean - position;
                    let near = 1.0 - way.norm_squared() / (REACH_M * REACH_M) as f32;
                    if near <= 0.0 || surfel.view.dot(&view) <= 0.0 {
                        continue;
                    }
                    let share = near * near;
                    let points = share * surfel.weight;
                    weight += points;
                    mean += way * points;
                    for (sum, (own, (a, b))) in scatter.iter_mut().zip(surfel.scatter.iter().zip([
                        (way.x, way.x),
                        (way.x, way.y),
                        (way.y, way.y),
                    ])) {
                        *sum += share * own + points * a * b;
                    }
                }
            }
        }
        if weight <= 0.0 {
            return None;
        }
        mean /= weight;
        let [xx, xy, yy] = scatter.map(|sum| f64::from(sum / weight));
        let mean = mean.cast::<f64>();
        let (xx, xy, yy) = (
            xx - mean.x * mean.x,
            xy - mean.x * mean.y,
            yy - mean.y * mean.y,
        );
        // Eigenvalues of the symmetric 2 × 2 matrix.
        let (half_sum, half_difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = libm::sqrt(half_difference * half_difference + xy * xy);
        let (great, small) = (half_sum + root, (half_sum - root).max(0.0));
        let across = Vector2::new(xy, small - xx);
        let other = Vector2::new(small - yy, xy);
        let across = if across.norm_squared() > other.norm_squared() {
            across
        } else {
            other
        };
        let across = across.try_normalize(1e-9).unwrap_or_else(Vector2::x);
        let noise = HIT_SIGMA_M * HIT_SIGMA_M;
        // A surface that goes on beyond the cells that were merged says nothing along itself; nor do a few points, which
        // may be all that was seen of a wall far away.
        let roundness = (small + 0.1 * noise) / (great + 0.1 * noise);
        let weight = f64::from(weight);
        let is_post = weight >= MIN_POINTS;
        let along = if is_post {
            roundness * roundness / (noise + great)
        } else {
            0.0
        };
        Some(Surface {
            mean: mean + point.position.coords,
            across,
            information: [1.0 / (noise + small), along],
            trust: weight / (weight + MIN_POINTS),
        })
    }

    /// Registers points, in the frame of the vehicle, with a pose nearby, by Gauss-Newton steps.
    pub fn register(
        &self,
        points: &[ScanPoint],
        start: &Isometry2<f64>,
        prior: Option<&Prior>,
    ) -> Registered {
        let mut pose = *start;
        let prior_information = prior.and_then(|prior| prior.covariance.try_inverse());
        let square_reach: f64 = points
            .iter()
            .map(|p| p.position.coords.norm_squared())
            .sum();
        let reach_m = libm::sqrt((square_reach / points.len().max(1) as f64).max(1.0));
        let scale = Vector3::new(1.0, 1.0, 1.0 / reach_m);
        let degenerate_share = match prior {
            Some(_) => DEGENERATE_SHARE.0,
            None => DEGENERATE_SHARE.1,
        };
        let mut result = Registered {
            submap_from_base: pose,
            information: Matrix3::zeros(),
            degenerate: 3,
            uncertain_along: None,
            inliers: 0.0,
            residual_m: 0.0,
        };
        for iteration in 0..MAX_ITERATIONS {
            let (mut hessian, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            let (mut trusted, mut greatest) = (Matrix3::zeros(), 1e-9);
            let (mut inliers, mut squares) = (0, 0.0);
            let rotation = pose.rotation.to_rotation_matrix();
            for point in points {
                let in_submap = point.in_frame(&pose);
                let Some(surface) = self.surface(&in_submap) else {
                    continue;
                };
                let way = in_submap.position.coords - surface.mean;
                let along = Vector2::new(-surface.across.y, surface.across.x);
                let residual = way.dot(&surface.across);
                if residual.abs() < INLIER_M {
                    inliers += 1;
                    squares += residual * residual;
                }
                greatest += surface.trust / (HIT_SIGMA_M * HIT_SIGMA_M);
                let outlier = OUTLIER_M * OUTLIER_M;
                let weight = outlier / (outlier + residual * residual);
                for (direction, information) in [
                    (surface.across, surface.information[0]),
                    (along, surface.information[1]),
                ] {
                    // In the frame of the vehicle: (n, n·(−y, x)).
                    let n = rotation.inverse() * direction;
                    let p = point.position;
                    let row = Vector3::new(n.x, n.y, n.y * p.x - n.x * p.y);
                    let weight = weight * weight * information;
                    let part = row * row.transpose() * weight;
                    hessian += part;
                    trusted += part * surface.trust;
                    gradient += row * (weight * way.dot(&direction));
                }
            }
            // Degenerate directions, with the rotation in metres at the points' distance.
            let scaled = |m: Matrix3<f64>| Matrix3::from_fn(|r, c| m[(r, c)] * scale[r] * scale[c]);
            let eigen = scaled(trusted).symmetric_eigen();
            let mut keep = Matrix3::zeros();
            result.degenerate = 0;
            result.uncertain_along = None;
            let mut least = f64::INFINITY;
            for (value, vector) in eigen
                .eigenvalues
                .iter()
                .zip(eigen.eigenvectors.column_iter())
            {
                let translation = Vector2::new(vector[0], vector[1]);
                if *value < degenerate_share * greatest {
                    result.degenerate += 1;
                    if translation.norm() > 0.7 && *value < least {
                        least = *value;
                        result.uncertain_along = Some(translation.normalize());
                    }
                } else {
                    keep += vector * vector.transpose();
                }
            }
            let information = keep * scaled(hessian) * keep;
            result.information =
                Matrix3::from_fn(|r, c| information[(r, c)] / (scale[r] * scale[c]));
            let kept = Matrix3::from_fn(|r, c| keep[(r, c)] * scale[c] / scale[r]);
            let (mut normal, mut right) = (result.information, kept * gradient);
            if let (Some(prior), Some(prior_information)) = (prior, &prior_information) {
                normal += prior_information;
                right += prior_information * difference(&prior.submap_from_base, &pose);
            } else {
                // Without a prior, degenerate directions stay where they are.
                normal += Matrix3::identity() * 1e-6;
            }
            result.inliers = f64::from(inliers) / points.len().max(1) as f64;
            result.residual_m = libm::sqrt(squares / f64::from(inliers.max(1)));
            result.submap_from_base = pose;
            let Some(step) = normal.cholesky().map(|cholesky| -cholesky.solve(&right)) else {
                break;
            };
            let is_small = step.xy().norm() < 2e-4 && step.z.abs() < 2e-5;
            if iteration + 1 == MAX_ITERATIONS || is_small {
                break;
            }
            pose = moved(&pose, &step);
        }
        result
    }
}

/// The pose after a step of x, y (metres) and yaw (radians) in its own frame.
pub fn moved(pose: &Isometry2<f64>, step: &Vector3<f64>) -> Isometry2<f64> {
    let mut moved = pose * Isometry2::new(step.xy(), step.z);
    // Against the growth of rounding errors.
    moved.rotation.renormalize();
    moved
}

/// The step from `from` to `to`: x, y (metres) and yaw (radians) in the frame of `to`.
pub fn difference(from: &Isometry2<f64>, to: &Isometry2<f64>) -> Vector3<f64> {
    let between = from.inv_mul(to);
    let step = between.rotation.inverse() * between.translation.vector;
    Vector3::new(step.x, step.y, between.rotation.angle())
}

/// Covariance of a pose, in its own frame, after a motion to another frame.
pub fn transported(covariance: &Matrix3<f64>, motion: &Isometry2<f64>) -> Matrix3<f64> {
    let adjoint = adjoint(&motion.inverse());
    adjoint * covariance * adjoint.transpose()
}

/// The adjoint of a pose: `pose · exp(step) = exp(adjoint · step) · pose` for small steps.
pub fn adjoint(pose: &Isometry2<f64>) -> Matrix3<f64> {
    let rotation: Matrix2<f64> = pose.rotation.to_rotation_matrix().into_inner();
    let (x, y) = (pose.translation.x, pose.translation.y);
    Matrix3::new(
        rotation[(0, 0)],
        rotation[(0, 1)],
        y,
        rotation[(1, 0)],
        rotation[(1, 1)],
        -x,
        0.0,
        0.0,
        1.0,
    )
}

fn cell_of(point: &Point2<f64>) -> Option<(i16, i16)> {
    let limit = f64::from(i16::MAX - REACH);
    let [x, y] = [point.x, point.y].map(|metres| libm::floor(metres / CELL_M));
    (x.abs() < limit && y.abs() < limit).then_some((x as i16, y as i16))
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    /// Points on walls from `from` to `to`, seen from the origin.
    fn wall(from: [f64; 2], to: [f64; 2]) -> Vec<ScanPoint> {
        let (from, to) = (Vector2::from(from), Vector2::from(to));
        let number = ((to - from).norm() / 0.04) as u32;
        let point = |at: u32| from.lerp(&to, f64::from(at) / f64::from(number));
        let view = |point: Vector2<f64>| ScanPoint {
            position: Point2::from(point),
            view: Unit::new_normalize(point),
        };
        (0..number).map(|at| view(point(at))).collect()
    }

    fn submap(points: &[ScanPoint]) -> Submap {
        let mut submap = Submap::default();
        for point in points {
            submap.add(point);
        }
        submap
    }

    fn moved_by(points: &[ScanPoint], pose: &Isometry2<f64>) -> Vec<ScanPoint> {
        points
            .iter()
            .map(|point| point.in_frame(&pose.inverse()))
            .collect()
    }

    #[test]
    fn a_corner_determines_the_pose() {
        let points = [wall([3.0, -2.0], [3.0, 2.0]), wall([-2.0, 2.0], [3.0, 2.0])].concat();
        let pose = Isometry2::new(Vector2::new(0.06, -0.05), 0.02);
        let start = Isometry2::identity();
        let registered = submap(&points).register(&moved_by(&points, &pose), &start, None);
        let error = difference(&pose, &registered.submap_from_base);
        assert!(error.xy().norm() < 2e-3 && error.z.abs() < 1e-3, "{error}");
        assert_eq!(
            (registered.degenerate, registered.uncertain_along),
            (0, None)
        );
        assert!(
            registered.inliers > 0.99 && registered.residual_m < 0.005,
            "{registered:?}"
        );
    }

    #[test]
    fn a_corridor_leaves_the_direction_along_itself_to_the_prior() {
        let points = [
            wall([-4.0, 1.0], [4.0, 1.0]),
            wall([-4.0, -1.0], [4.0, -1.0]),
        ]
        .concat();
        let pose = Isometry2::new(Vector2::new(0.05, 0.08), 0.03);
        let prior = Prior {
            submap_from_base: Isometry2::new(Vector2::new(0.2, 0.0), 0.0),
            covariance: Matrix3::from_diagonal(&Vector3::new(0.04, 0.04, 0.01)),
        };
        let start = prior.submap_from_base;
        let scan = moved_by(&points[20..points.len() - 20], &pose);
        let registered = submap(&points).register(&scan, &start, Some(&prior));
        assert_eq!(registered.degenerate, 1);
        let along = registered.submap_from_base.rotation * registered.uncertain_along.unwrap();
        assert!(along.x.abs() > 0.99, "{along}");
        let [x, y] = registered.submap_from_base.translation.vector.into();
        assert!((x - 0.2).abs() < 0.01 && (y - 0.08).abs() < 3e-3, "{x} {y}");
        let rotation = registered.submap_from_base.rotation.angle();
        assert!((rotation - 0.03).abs() < 1e-3, "{rotation}");
    }

    #[test]
    fn the_two_sides_of_a_thin_wall_are_kept_apart() {
        let near = wall([2.0, -1.0], [2.0, 1.0]);
        let back = |point: &ScanPoint| ScanPoint {
            position: point.position + Vector2::new(0.08, 0.0),
            view: -point.view,
        };
        let both: Vec<_> = near.iter().copied().chain(near.iter().map(back)).collect();
        let surface = submap(&both).surface(&near[25]).unwrap();
        assert!((surface.mean.x - 2.0).abs() < 0.01, "{}", surface.mean);
        assert!(surface.across.x.abs() > 0.99 && surface.information[0] > 200.0);
    }

    #[test]
    fn covariance_moves_with_the_vehicle() {
        // An error of yaw alone, 2 m later, is an error to the side too.
        let yaw = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 0.01));
        let motion = Isometry2::new(Vector2::new(2.0, 0.0), 0.0);
        let later = transported(&yaw, &motion);
        assert!(
            (later[(1, 1)] - 0.04).abs() < 1e-12 && later[(0, 0)].abs() < 1e-12,
            "{later}"
        );
    }
}
