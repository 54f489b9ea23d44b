//! A submap that scans are still added to, and how far the vehicle's pose in it is known.

use nalgebra::{Isometry2, Matrix3};

use super::loop_closure::{Window, with_noise};
use super::search_grid::SearchGrid;
use super::slam_settings::SlamSettings;
use super::submap::{difference, transported};

#[derive(Clone, Debug)]
pub(super) struct ActiveSubmap {
    pub(super) index: u32,
    pub(super) local_from_anchor: Isometry2<f64>,
    pub(super) grid: SearchGrid,
    /// Covariance of the vehicle's pose relative to the anchor, in the frame of the vehicle.
    pub(super) covariance: Matrix3<f64>,
    /// Pose of the vehicle relative to the anchor by the odometry since.
    pub(super) anchor_from_base_by_odometry: Isometry2<f64>,
    pub(super) begun_m: f64,
}

impl ActiveSubmap {
    /// Begins where the vehicle is, after so many metres of driving.
    pub(super) fn new(
        index: u32,
        local_from_base: Isometry2<f64>,
        grid: SearchGrid,
        driven_m: f64,
    ) -> Self {
        Self {
            index,
            local_from_anchor: local_from_base,
            grid,
            covariance: Matrix3::zeros(),
            anchor_from_base_by_odometry: Isometry2::identity(),
            begun_m: driven_m,
        }
    }

    /// The vehicle moves, with this covariance of the motion.
    pub(super) fn predict(&mut self, motion: &Isometry2<f64>, noise: &Matrix3<f64>) {
        self.covariance = transported(&self.covariance, motion) + noise;
    }

    /// A scan with this information was matched.
    pub(super) fn update(&mut self, information: &Matrix3<f64>) {
        let prior = self.covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let both = prior + information;
        self.covariance = both.try_inverse().unwrap_or(self.covariance);
    }

    /// Information of a pose relative to the anchor, in its own frame.
    pub(super) fn edge_information(
        &self,
        anchor_from_base: &Isometry2<f64>,
        settings: &SlamSettings,
    ) -> Matrix3<f64> {
        let covariance = self.edge_covariance(anchor_from_base, settings);
        let information = covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        with_noise(&information, settings.pose_noise)
    }

    /// Drift since the submap began.
    pub(super) fn drift(
        &self,
        local_from_base: &Isometry2<f64>,
        driven_m: f64,
        settings: &SlamSettings,
    ) -> Window {
        let way_m = driven_m - self.begun_m;
        let (m_per_m, rad_per_m) = settings.closure.drift_per_m;
        let anchor_from_base = self.local_from_anchor.inv_mul(local_from_base);
        let covariance = self.edge_covariance(&anchor_from_base, settings);
        let [x, y, yaw] = [0, 1, 2].map(|at| libm::sqrt(covariance[(at, at)]));
        (m_per_m * way_m + x.max(y), rad_per_m * way_m + yaw)
    }

    /// Where matching and odometry part, either may be wrong: what looks rigid may move with the vehicle, as the ground that a laser
    /// sees in a turn.
    fn edge_covariance(
        &self,
        anchor_from_base: &Isometry2<f64>,
        settings: &SlamSettings,
    ) -> Matrix3<f64> {
        let parted = difference(&self.anchor_from_base_by_odometry, anchor_from_base);
        let parted = parted * settings.odometry_share;
        self.covariance + parted * parted.transpose()
    }
}
