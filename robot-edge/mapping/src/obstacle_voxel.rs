//! An occupied voxel of an obstacle, what the metrics say of it, and what follows from that.

use super::voxel::VoxelIndex;

/// A voxel that is occupied now, in a column of lethal cost, strictly above the ground and no higher than the
/// vehicle: the ground under grass is rigid, and what hangs higher is not in the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstacleVoxel {
    /// Where it lies.
    pub voxel: VoxelIndex,
    /// Moving average of its `IntraScan`s; `None` where there was none.
    pub intra: Option<f32>,
    /// Moving average of its `InterScan`s; `None` where there was none.
    pub inter: Option<f32>,
}

/// Whether something gives way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rigidity {
    /// No metric says.
    #[default]
    Unlabelled,
    /// It gives way: vegetation.
    Traversable,
    /// It does not.
    Rigid,
}

impl ObstacleVoxel {
    /// What `IntraScan` alone says: rigid above `threshold`.
    pub fn by_intra(&self, threshold: f64) -> Rigidity {
        Rigidity::of(self.intra, |width| width > threshold)
    }

    /// What `InterScan` alone says: rigid below `threshold`.
    pub fn by_inter(&self, threshold: f64) -> Rigidity {
        Rigidity::of(self.inter, |change| change < threshold)
    }
}

impl Rigidity {
    fn of(metric: Option<f32>, is_rigid: impl Fn(f64) -> bool) -> Self {
        match metric {
            Some(value) if value.is_nan() => Self::Unlabelled,
            Some(value) if is_rigid(value.into()) => Self::Rigid,
            Some(_) => Self::Traversable,
            None => Self::Unlabelled,
        }
    }

    /// Rigid only if both say so; where one says nothing, the other decides (\[HYB\] §7.1).
    #[must_use]
    pub const fn both(self, other: Self) -> Self {
        match (self, other) {
            (Self::Unlabelled, label) | (label, Self::Unlabelled) => label,
            (Self::Rigid, Self::Rigid) => Self::Rigid,
            (Self::Traversable, _) | (_, Self::Traversable) => Self::Traversable,
        }
    }

    /// Rigid if either says so; where one says nothing, the other decides (\[HYB\] §7.2).
    #[must_use]
    pub const fn either(self, other: Self) -> Self {
        match (self, other) {
            (Self::Unlabelled, label) | (label, Self::Unlabelled) => label,
            (Self::Traversable, Self::Traversable) => Self::Traversable,
            (Self::Rigid, _) | (_, Self::Rigid) => Self::Rigid,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Rigidity::{Rigid, Traversable, Unlabelled};

    #[test]
    fn labels_follow_the_thresholds() {
        let voxel = |intra, inter| ObstacleVoxel {
            voxel: VoxelIndex { x: 0, y: 0, z: 0 },
            intra,
            inter,
        };
        let labels = |voxel: ObstacleVoxel| (voxel.by_intra(0.04), voxel.by_inter(0.39));
        assert_eq!(labels(voxel(Some(0.05), Some(0.3))), (Rigid, Rigid));
        assert_eq!(
            labels(voxel(Some(0.03), Some(0.4))),
            (Traversable, Traversable)
        );
        assert_eq!(
            labels(voxel(None, Some(f32::NAN))),
            (Unlabelled, Unlabelled)
        );
    }

    #[test]
    fn land_asks_both_and_water_either() {
        let all = [Unlabelled, Traversable, Rigid];
        let both = all.map(|a| all.map(|b| a.both(b)));
        assert_eq!(both[0], all);
        assert_eq!(both[1], [Traversable, Traversable, Traversable]);
        assert_eq!(both[2], [Rigid, Traversable, Rigid]);
        let either = all.map(|a| all.map(|b| a.either(b)));
        assert_eq!(either[0], all);
        assert_eq!(either[1], [Traversable, Traversable, Rigid]);
        assert_eq!(either[2], [Rigid, Rigid, Rigid]);
    }
}
