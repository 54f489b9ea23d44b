//! What holds a vehicle up.

use std::cell::RefCell;
use std::sync::Arc;

use super::posture_track::PostureTrack;
use crate::chassis::{Chassis, Posture};
use crate::hull::Hull;
use crate::path::{Path, PlanarPose};
use crate::scene::Scene;
use crate::waves::Waves;
use measurement::pose::Pose;

/// What holds the vehicle up.
#[derive(Clone)]
pub(super) enum Support {
    Level,
    Ground(RefCell<PostureTrack>),
    Water {
        hull: Hull,
        waves: Arc<Waves>,
        water_level_m: f64,
    },
}

impl Support {
    pub(super) fn on_ground(chassis: Chassis, scene: Arc<Scene>, path: Arc<Path>) -> Self {
        Self::Ground(RefCell::new(PostureTrack::new(chassis, scene, path)))
    }

    /// The pose of a vehicle at `at`. On ground it stands as `on_ground` says; water decides by itself.
    pub(super) fn pose(
        &self,
        at: PlanarPose,
        time_s: f64,
        on_ground: impl FnOnce(&RefCell<PostureTrack>) -> Posture,
    ) -> Pose {
        match self {
            Self::Level => at.level(),
            Self::Ground(postures) => on_ground(postures).world_from_base(at),
            Self::Water {
                hull,
                waves,
                water_level_m,
            } => hull
                .afloat(at, waves, *water_level_m, time_s)
                .world_from_base(at),
        }
    }

    /// How the vehicle stands on ground at `time_s` of its path; elsewhere level.
    pub(super) fn posture_on_path(&self, time_s: f64) -> Posture {
        match self {
            Self::Ground(postures) => postures.borrow_mut().posture(time_s),
            Self::Level | Self::Water { .. } => Posture::default(),
        }
    }

    /// How the vehicle stands on ground at `at`, where it stood as `last` shortly before; elsewhere level.
    pub(super) fn posture(&self, at: PlanarPose, last: Posture, time_s: f64) -> Posture {
        match self {
            Self::Ground(postures) => postures.borrow().settle(at, last, time_s),
            Self::Level | Self::Water { .. } => Posture::default(),
        }
    }
}
