//! What the last revolutions showed around the vehicle, as planes of cubes.

use std::collections::HashMap;

use measurement::pose::Pose;
use nalgebra::{Matrix3, Point3, UnitVector3, Vector3};
use rustc_hash::FxBuildHasher;

/// Sides of cubes and the corner of one along each axis, metres. A point belongs to a cube of each; the smallest that holds a plane is
/// used. The corners differ, so that no surface lies on the faces of all.
const SIZES_M: [(f64, f64); 3] = [(0.25, 0.0), (0.6, 0.11), (1.5, 0.37)];
/// A cube with fewer points has no plane.
const LEAST_POINTS: u32 = 6;
/// A plane is computed again when a cube has this share of points more.
const MORE: f64 = 0.2;
/// Standard deviations of points across a plane at most, and along it at least, as shares of the cube's side: what a single ring shows of a
/// plane is a line, and with one point of the next ring it would be a plane that faces the sensor.
const ACROSS: f64 = 0.1;
const ALONG: f64 = 0.1;
/// Of the standard deviations across and along.
const FLATNESS: f64 = 0.35;

/// So many points of a cube at most have errors of their own: ground is rough.
const INDEPENDENT: f64 = 10.0;

/// Square of the distance of the corner of a square from its middle, in sums of the variances along its sides.
const REACH: f64 = 3.0;

/// A part of a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub(super) middle: Point3<f64>,
    pub(super) normal: UnitVector3<f64>,
    /// Variance of the points across it, m².
    pub(super) variance_m2: f64,
    /// Variance of the angle of its normal, rad².
    pub(super) tilt_variance: f64,
    /// Square of the distance along it from its middle to which it was seen, m².
    reach_m2: f64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct SurfaceMap {
    sizes: [HashMap<[i32; 3], Cube, FxBuildHasher>; SIZES_M.len()],
}

/// Points, from the corner of their cube.
#[derive(Clone, Debug, Default)]
struct Cube {
    count: u32,
    sum: Vector3<f64>,
    products: Matrix3<f64>,
    /// Points when the plane was computed.
    fitted: u32,
    plane: Option<Plane>,
}

/// The box of a point, by its place along each axis.
pub(super) fn box_of(point: &Point3<f64>, sides_m: [f64; 3]) -> [i32; 3] {
    let places = point.coords.component_div(&Vector3::from(sides_m));
    places.map(|place| place.floor() as i32).into()
}

fn key(point: &Point3<f64>, (side_m, corner_m): (f64, f64)) -> [i32; 3] {
    box_of(&point.map(|metres| metres - corner_m), [side_m; 3])
}

fn corner(key: [i32; 3], (side_m, corner_m): (f64, f64)) -> Point3<f64> {
    key.map(|place| f64::from(place) * side_m + corner_m).into()
}

impl SurfaceMap {
    pub(super) fn clear(&mut self) {
        self.sizes.iter_mut().for_each(HashMap::clear);
    }

    pub(super) fn insert(&mut self, points: &[Point3<f64>], local_from_base: &Pose) {
        for (cubes, size_m) in self.sizes.iter_mut().zip(SIZES_M) {
            for point in points {
                let point = local_from_base * point;
                let key = key(&point, size_m);
                let cube = cubes.entry(key).or_default();
                let offset = point - corner(key, size_m);
                cube.count += 1;
                cube.sum += offset;
                cube.products += offset * offset.transpose();
            }
        }
    }

    /// Removes what is farther than `radius_m` from a place along an axis.
    pub(super) fn keep_around(&mut self, place: &Point3<f64>, radius_m: f64) {
        for (cubes, size_m) in self.sizes.iter_mut().zip(SIZES_M) {
            cubes.retain(|key, _| (corner(*key, size_m) - place).amax() <= radius_m);
        }
    }

    /// The surface around a point.
    pub(super) fn plane(&mut self, point: &Point3<f64>) -> Option<Plane> {
        let mut sizes = self.sizes.iter_mut().zip(SIZES_M);
        sizes.find_map(|(cubes, size_m)| {
            let key = key(point, size_m);
            let cube = cubes.get_mut(&key)?;
            if f64::from(cube.count) > (1.0 + MORE) * f64::from(cube.fitted) {
                cube.fitted = cube.count;
                cube.plane = cube.fit(size_m.0).map(|plane| Plane {
                    middle: corner(key, size_m) + plane.middle.coords,
                    ..plane
                });
            }
            cube.plane.filter(|plane| {
                let offset = point - plane.middle;
                let across_m = offset.dot(&plane.normal);
                offset.norm_squared() - across_m * across_m <= plane.reach_m2
            })
        })
    }
}

impl Cube {
    /// From the corner of the cube.
    fn fit(&self, side_m: f64) -> Option<Plane> {
        if self.count < LEAST_POINTS {
            return None;
        }
        let count = f64::from(self.count);
        let middle = self.sum / count;
        let eigen = (self.products / count - middle * middle.transpose()).symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let others = (0..3).filter(|at| *at != least);
        let along = others
            .map(|at| eigen.eigenvalues[at])
            .fold(f64::INFINITY, f64::min);
        let across = eigen.eigenvalues[least].max(0.0);
        let is_plane = across <= libm::pow(ACROSS * side_m, 2.0).min(FLATNESS * FLATNESS * along)
            && along >= libm::pow(ALONG * side_m, 2.0);
        is_plane.then(|| Plane {
            middle: middle.into(),
            normal: UnitVector3::new_normalize(eigen.eigenvectors.column(least).into_owned()),
            variance_m2: across,
            tilt_variance: across / (along * count.min(INDEPENDENT)),
            reach_m2: REACH * (eigen.eigenvalues.sum() - across),
        })
    }
}
