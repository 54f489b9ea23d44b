//! What the hits in a voxel say beyond that it is occupied: where in it the surface lies, and the metrics.

use nalgebra::{Point3, Vector3};

use crate::mapping::voxel::VoxelIndex;

/// Parts of a voxel in which positions are summed, along each axis.
const PARTS: f64 = 1024.0;
/// Hits after which old ones count half, so that a surface may move.
const MEMORY: u32 = 64;

/// The hits in one voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVoxel {
    /// Hits that the mean is of.
    hits: u32,
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
    /// Of its segment, 0 … 1.
    pub intra: f32,
    /// From the scan before, 0 … 1.
    pub inter: f32,
}

impl SurfaceVoxel {
    pub(super) const NONE: Self = Self {
        hits: 0,
        sums: [0; 3],
        intra: f32::NAN,
        inter: f32::NAN,
    };

    /// Adds a hit in the voxel; `weight` is that of the newest value in a moving average.
    pub(super) fn add(&mut self, hit: &SurfaceHit, voxel: VoxelIndex, cell_m: f64, weight: f32) {
        if self.hits >= MEMORY {
            self.hits /= 2;
            self.sums = self.sums.map(|sum| sum / 2);
        }
        self.hits += 1;
        let corner = [voxel.x, voxel.y, voxel.z].map(f64::from);
        for ((sum, corner), at_m) in self.sums.iter_mut().zip(corner).zip(&hit.point.coords) {
            let part = (at_m / cell_m - corner) * PARTS;
            *sum += part.clamp(0.0, PARTS - 1.0) as u32;
        }
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

    /// The mean of the hits, in voxels from the voxel's least corner.
    pub fn mean(&self) -> Vector3<f64> {
        let hits = f64::from(self.hits.max(1));
        let [x, y, z] = self.sums.map(|sum| (f64::from(sum) / hits + 0.5) / PARTS);
        Vector3::new(x, y, z)
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
    fn the_first_value_sets_a_metric_and_the_next_ones_weigh_less() {
        let mut surface = SurfaceVoxel::NONE;
        for intra in [1.0, 0.0, f32::NAN] {
            let hit = SurfaceHit {
                point: Point3::origin(),
                intra,
                inter: f32::NAN,
            };
            surface.add(&hit, VoxelIndex { x: 0, y: 0, z: 0 }, 0.3, 0.25);
        }
        assert_eq!(surface.intra(), Some(0.75));
    }
}
