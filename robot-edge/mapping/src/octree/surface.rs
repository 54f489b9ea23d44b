//! What the hits in a voxel say beyond that it is occupied: where in it the surface lies, and the metrics.

use nalgebra::{Point3, Vector3};

use crate::voxel::VoxelIndex;

/// Parts of a voxel in which positions are summed, along each axis.
const PARTS: f64 = 1024.0;
/// Radius of a spot of light that is fine enough: half a voxel's side.
const FINE: u16 = 512;
/// A spot this much smaller than another one tells better where the surface lies.
pub(crate) const FINER: f64 = 0.75;
/// Hits after which old ones count half, so that a surface may move.
const MEMORY: u16 = 64;

/// The hits in one voxel.
///
/// A spot of light that lies across a crest or an edge sends back a part of itself, and the hit is placed in its middle:
/// so the mean is of the finest hits only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVoxel {
    /// Hits that the mean is of.
    hits: u16,
    /// Radius of the smallest spot of light that hit it, parts of its side.
    spot: u16,
    /// Of their positions in the voxel, parts of its side.
    sums: [u32; 3],
    /// Moving averages; not a number where there is none.
    intra: f32,
    inter: f32,
}

/// One hit: where, and what its beam's metrics are, not-a-number where it has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// Metres in `odom`.
    pub point: Point3<f64>,
    /// Radius of the beam's spot of light there, metres: what came back is from somewhere in it.
    pub spot_m: f32,
    /// Of its segment, 0 … 1.
    pub intra: f32,
    /// From the scan before, 0 … 1.
    pub inter: f32,
}

impl SurfaceVoxel {
    pub(super) const NONE: Self = Self {
        hits: 0,
        spot: u16::MAX,
        sums: [0; 3],
        intra: f32::NAN,
        inter: f32::NAN,
    };

    /// Adds a hit in the voxel; `weight` is that of the newest value in a moving average.
    pub(super) fn add(&mut self, hit: &SurfaceHit, voxel: VoxelIndex, cell_m: f64, weight: f32) {
        self.add_point(hit, voxel, cell_m);
        let average = |value: &mut f32, new: f32| {
            if !new.is_nan() {
                *value = if value.is_nan() {
                    new
                } else {
                    *value * (1.0 - weight) + new * weight
                };
            }
        };
        average(&mut self.intra, hit.intra);
        average(&mut self.inter, hit.inter);
    }

    /// Adds the place of a hit, unless finer ones were there; those that it is finer than no longer count.
    fn add_point(&mut self, hit: &SurfaceHit, voxel: VoxelIndex, cell_m: f64) {
        let spot = libm::ceil(f64::from(hit.spot_m) / cell_m * PARTS) as u16;
        let is_finer = |a: u16, b: u16| f64::from(a.max(FINE)) < FINER * f64::from(b.max(FINE));
        if is_finer(self.spot, spot) {
            return;
        }
        if is_finer(spot, self.spot) {
            self.hits = 0;
            self.sums = [0; 3];
        } else if self.hits >= MEMORY {
            self.hits /= 2;
            self.sums = self.sums.map(|sum| sum / 2);
        }
        self.hits += 1;
        self.spot = self.spot.min(spot);
        let corner = [voxel.x, voxel.y, voxel.z].map(f64::from);
        for ((sum, corner), at_m) in self.sums.iter_mut().zip(corner).zip(&hit.point.coords) {
            let part = (at_m / cell_m - corner) * PARTS;
            *sum += part.clamp(0.0, PARTS - 1.0) as u32;
        }
    }

    /// The mean of the hits, in voxels from the voxel's least corner.
    pub fn mean(&self) -> Vector3<f64> {
        let hits = f64::from(self.hits.max(1));
        let [x, y, z] = self.sums.map(|sum| (f64::from(sum) / hits + 0.5) / PARTS);
        Vector3::new(x, y, z)
    }

    /// Radius of the smallest spot of light among the hits, voxels: how finely the surface's height is known, at most
    /// 64.
    pub fn spot(&self) -> f64 {
        f64::from(self.spot) / PARTS
    }

    /// Moving average of the hits' `IntraScan`, if any had one.
    pub fn intra(&self) -> Option<f32> {
        (!self.intra.is_nan()).then_some(self.intra)
    }

    /// Moving average of the hits' `InterScan`, if any had one.
    pub fn inter(&self) -> Option<f32> {
        (!self.inter.is_nan()).then_some(self.inter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_that_of_the_points_and_follows_a_surface_that_moves() {
        let voxel = VoxelIndex { x: -3, y: 7, z: 0 };
        let mut surface = SurfaceVoxel::NONE;
        let hit = |z_m: f64, inter| SurfaceHit {
            point: Point3::new(-0.25, 0.72, z_m),
            spot_m: 0.0,
            intra: f32::NAN,
            inter,
        };
        for z_m in [0.01, 0.03] {
            surface.add(&hit(z_m, 0.5), voxel, 0.1, 0.3);
        }
        assert!((surface.mean() - Vector3::new(0.5, 0.2, 0.2)).amax() < 1e-3);
        assert_eq!((surface.intra(), surface.inter()), (None, Some(0.5)));
        for _ in 0..400 {
            surface.add(&hit(0.09, 1.0), voxel, 0.1, 0.3);
        }
        assert!((surface.mean().z - 0.9).abs() < 0.01);
        assert!(surface.inter().unwrap() > 0.99);
    }

    #[test]
    fn a_surface_is_known_as_finely_as_by_its_finest_hit() {
        let mut surface = SurfaceVoxel::NONE;
        let hits = [
            (9.0, 64.0, 0.09, 0.9),
            (0.14, 1.4, 0.07, 0.7),
            (0.12, 1.2, 0.05, 0.6), // hardly finer
            (0.04, 0.4, 0.01, 0.1),
            (0.01, 0.1, 0.02, 0.15), // both are fine enough
            (0.10, 0.1, 0.09, 0.15),
        ];
        for (spot_m, voxels, z_m, mean) in hits {
            let hit = SurfaceHit {
                point: Point3::new(0.0, 0.0, z_m),
                spot_m,
                intra: f32::NAN,
                inter: f32::NAN,
            };
            surface.add(&hit, VoxelIndex { x: 0, y: 0, z: 0 }, 0.1, 0.3);
            assert!((surface.spot() - voxels).abs() < 2e-3, "{}", surface.spot());
            assert!((surface.mean().z - mean).abs() < 2e-3, "{}", surface.mean());
        }
    }

    #[test]
    fn the_first_value_sets_a_metric_and_the_next_ones_weigh_less() {
        let mut surface = SurfaceVoxel::NONE;
        for intra in [1.0, 0.0, f32::NAN] {
            let hit = SurfaceHit {
                point: Point3::origin(),
                spot_m: 0.0,
                intra,
                inter: f32::NAN,
            };
            surface.add(&hit, VoxelIndex { x: 0, y: 0, z: 0 }, 0.3, 0.25);
        }
        assert_eq!(surface.intra(), Some(0.75));
    }
}
