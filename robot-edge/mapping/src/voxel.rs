//! Voxels of a grid fixed in `odom` and aligned with gravity.

use nalgebra::Point3;

use super::grid::CellIndex;

/// A voxel: (x, y, z) covers `[x, x+1)·cell_m` by `[y, y+1)·cell_m` by `[z, z+1)·cell_m`.
///
/// Ordered by x, then y, then z: the voxels of a column follow one another from the ground up, and columns
/// are in the order of [`CellIndex`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VoxelIndex {
    /// Towards x of `odom`.
    pub x: i32,
    /// Towards y of `odom`.
    pub y: i32,
    /// Upwards.
    pub z: i32,
}

impl VoxelIndex {
    /// The voxel that `point`, metres in `odom`, lies in; saturates where an index cannot reach.
    pub fn containing(point: Point3<f64>, cell_m: f64) -> Self {
        let index = |coordinate: f64| libm::floor(coordinate / cell_m) as i32;
        Self {
            x: index(point.x),
            y: index(point.y),
            z: index(point.z),
        }
    }

    /// Its centre, metres in `odom`.
    pub fn centre(self, cell_m: f64) -> Point3<f64> {
        Point3::new(
            (f64::from(self.x) + 0.5) * cell_m,
            (f64::from(self.y) + 0.5) * cell_m,
            (f64::from(self.z) + 0.5) * cell_m,
        )
    }

    /// The column it stands in.
    pub const fn column(self) -> CellIndex {
        CellIndex {
            x: self.x,
            y: self.y,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_below_zero_lie_below_zero() {
        let voxel = VoxelIndex::containing(Point3::new(-0.05, 0.05, -0.31), 0.1);
        assert_eq!(voxel, VoxelIndex { x: -1, y: 0, z: -4 });
        assert_eq!(voxel.column(), CellIndex { x: -1, y: 0 });
        let centre = Point3::new(-0.05, 0.05, -0.35);
        assert!((voxel.centre(0.1) - centre).norm() < 1e-12);
    }

    #[test]
    fn a_column_is_sorted_together() {
        let at = |x, y, z| VoxelIndex { x, y, z };
        let mut voxels = [at(1, 0, 0), at(0, 1, -3), at(0, 0, 7), at(0, 1, 2)];
        voxels.sort_unstable();
        assert_eq!(
            voxels,
            [at(0, 0, 7), at(0, 1, -3), at(0, 1, 2), at(1, 0, 0)]
        );
    }
}
