//! Surface in a voxel: mean position of the hits, and the metrics (docs/methods.md, sections 4 and
//! 5).

use nalgebra::{Point3, Vector3};

use crate::grid::VoxelIndex;

/// Resolution of positions within a voxel, along each axis.
const PARTS: f64 = 1024.0;
/// Radius of a spot that is fine enough: half a voxel.
const FINE: u16 = 512;
/// A spot smaller than another by this factor locates the surface better.
pub(crate) const FINER: f64 = 0.75;
/// Number of hits after which the sums are halved, so that a surface may move.
const MEMORY: u16 = 64;

/// Surface in one voxel.
///
/// A laser spot across a crest or an edge returns a part of itself, and the hit is placed in its
/// middle. So the mean is of the finest hits only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceVoxel {
    /// Hits in the mean.
    hits: u16,
    /// Radius of the smallest spot, in parts of a voxel.
    spot: u16,
    /// Sums of positions in the voxel, in parts of a voxel.
    sums: [u32; 3],
    /// Moving averages; NaN without value.
    intra: f32,
    inter: f32,
}

/// A hit and its beam's metrics; NaN without.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// Metres in `odom`.
    pub point: Point3<f64>,
    /// Radius of the laser spot, metres.
    pub spot_m: f32,
    /// `IntraScan`, 0 … 1.
    pub intra: f32,
    /// `InterScan`, 0 … 1.
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

    pub(super) const BYTES: usize = 6 * 4;

    pub(super) fn to_bytes(self) -> [u8; Self::BYTES] {
        let [x, y, z] = self.sums;
        let counts = u32::from(self.hits) << 16 | u32::from(self.spot);
        let words = [counts, x, y, z, self.intra.to_bits(), self.inter.to_bits()];
        std::array::from_fn(|byte| words[byte / 4].to_le_bytes()[byte % 4])
    }

    /// Of as many bytes as [`SurfaceVoxel::to_bytes`] gives.
    pub(super) fn from_bytes(bytes: &[u8]) -> Self {
        let words = bytes.as_chunks().0;
        let word = |at: usize| words.get(at).map_or(0, |word| u32::from_le_bytes(*word));
        Self {
            hits: (word(0) >> 16) as u16,
            spot: word(0) as u16,
            sums: [word(1), word(2), word(3)],
            intra: f32::from_bits(word(4)),
            inter: f32::from_bits(word(5)),
        }
    }

    /// Adds a hit in the voxel; `weights` are those of the newest `intra` and `inter`.
    pub(super) fn add(
        &mut self,
        hit: &SurfaceHit,
        voxel: VoxelIndex,
        cell_m: f64,
        weights: [f32; 2],
    ) {
        self.add_point(hit, voxel, cell_m);
        let average = |value: &mut f32, new: f32, weight: f32| {
            if !new.is_nan() {
                *value = if value.is_nan() {
                    new
                } else {
                    *value * (1.0 - weight) + new * weight
                };
            }
        };
        average(&mut self.intra, hit.intra, weights[0]);
        average(&mut self.inter, hit.inter, weights[1]);
    }

    /// Adds a position unless finer ones exist; replaces coarser ones.
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

    /// Mean of the hits, in voxels from the voxel's least corner.
    pub fn mean(&self) -> Vector3<f64> {
        let hits = f64::from(self.hits.max(1));
        let [x, y, z] = self.sums.map(|sum| (f64::from(sum) / hits + 0.5) / PARTS);
        Vector3::new(x, y, z)
    }

    /// Radius of the smallest spot, voxels, at most 64.
    pub fn spot(&self) -> f64 {
        f64::from(self.spot) / PARTS
    }

    /// Moving average of `IntraScan`.
    pub fn intra(&self) -> Option<f32> {
        (!self.intra.is_nan()).then_some(self.intra)
    }

    /// Moving average of `InterScan`.
    pub fn inter(&self) -> Option<f32> {
        (!self.inter.is_nan()).then_some(self.inter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_follows_a_moving_surface() {
        let voxel = VoxelIndex { x: -3, y: 7, z: 0 };
        let mut surface = SurfaceVoxel::NONE;
        let hit = |z_m: f64, inter| SurfaceHit {
            point: Point3::new(-0.25, 0.72, z_m),
            spot_m: 0.0,
            intra: f32::NAN,
            inter,
        };
        for z_m in [0.01, 0.03] {
            surface.add(&hit(z_m, 0.5), voxel, 0.1, [0.3; 2]);
        }
        assert!((surface.mean() - Vector3::new(0.5, 0.2, 0.2)).amax() < 1e-3);
        assert_eq!((surface.intra(), surface.inter()), (None, Some(0.5)));
        for _ in 0..400 {
            surface.add(&hit(0.09, 1.0), voxel, 0.1, [0.3; 2]);
        }
        assert!((surface.mean().z - 0.9).abs() < 0.01);
        assert!(surface.inter().unwrap() > 0.99);
    }

    #[test]
    fn finest_hits_define_the_surface() {
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
            surface.add(&hit, VoxelIndex { x: 0, y: 0, z: 0 }, 0.1, [0.3; 2]);
            assert!((surface.spot() - voxels).abs() < 2e-3, "{}", surface.spot());
            assert!((surface.mean().z - mean).abs() < 2e-3, "{}", surface.mean());
        }
    }

    #[test]
    fn the_first_value_sets_a_metric_and_the_next_ones_weigh_less() {
        let mut surface = SurfaceVoxel::NONE;
        for (intra, inter) in [(1.0, 0.0), (0.0, 1.0), (f32::NAN, f32::NAN)] {
            let hit = SurfaceHit {
                point: Point3::origin(),
                spot_m: 0.0,
                intra,
                inter,
            };
            surface.add(&hit, VoxelIndex { x: 0, y: 0, z: 0 }, 0.3, [0.25, 0.125]);
        }
        assert_eq!(
            (surface.intra(), surface.inter()),
            (Some(0.75), Some(0.125))
        );
    }
}
