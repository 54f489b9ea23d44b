//! Shores and docking sites as they leave the robot: bounded, and checked where they arrive.

mod outline;

use std::cmp::Reverse;

use crate::layer::LayerId;
use crate::message::{Datum, DockingSite, ShoreClass, ShoreCluster, Shores};

pub use outline::{MAX_CORNERS, convex_outline};

/// Shores in one message at most. With [`MAX_SITES`] and [`MAX_CORNERS`] it fits
/// [`MAX_MESSAGE_BYTES`](crate::wire::MAX_MESSAGE_BYTES) whatever its numbers are.
pub const MAX_CLUSTERS: usize = 400;
/// Docking sites in one message at most.
pub const MAX_SITES: usize = 100;

impl Shores {
    /// The shores and docking sites of one moment, of which the smallest shores and the last docking sites are
    /// left out, and counted, where they are too many for a message.
    ///
    /// `clusters` in any order, each with a number of its own; `sites` the best first.
    pub fn gather(
        cell_m: f64,
        datum: Option<Datum>,
        mut clusters: Vec<ShoreCluster>,
        mut sites: Vec<DockingSite>,
    ) -> Self {
        clusters.sort_by_key(|cluster| (Reverse(cluster.voxels), cluster.number));
        let clusters_left_out = left_out(clusters.len(), MAX_CLUSTERS);
        clusters.truncate(MAX_CLUSTERS);
        clusters.sort_by_key(|cluster| cluster.number);
        let sites_left_out = left_out(sites.len(), MAX_SITES);
        sites.truncate(MAX_SITES);
        Self {
            cell_m,
            datum,
            clusters,
            clusters_left_out,
            sites,
            sites_left_out,
        }
    }

    /// Whether everything is in bounds: what arrives and is not must not be shown.
    pub fn is_valid(&self) -> bool {
        let is_number = |number: &f32| number.is_finite();
        let is_shore = |cluster: &ShoreCluster| {
            cluster.rigid_voxels <= cluster.voxels
                && cluster.outline.len() <= MAX_CORNERS
                && cluster.center_m.iter().all(is_number)
        };
        let is_site = |site: &DockingSite| {
            let [x_m, y_m] = site.center_m;
            [x_m, y_m, site.heading_rad, site.width_m, site.mean_cost]
                .iter()
                .all(is_number)
        };
        self.cell_m.is_finite()
            && self.datum.is_none_or(is_on_earth)
            && self.clusters.len() <= MAX_CLUSTERS
            && self.clusters.is_sorted_by(|a, b| a.number < b.number)
            && self.clusters.iter().all(is_shore)
            && self.sites.len() <= MAX_SITES
            && self.sites.iter().all(is_site)
    }
}

impl ShoreCluster {
    /// The corners of its outline, x and y in `odom`, metres, where a cell is `cell_m` wide.
    pub fn corners_m(&self, cell_m: f64) -> impl Iterator<Item = [f64; 2]> {
        let corners = self.outline.iter();
        corners.map(move |&(x, y)| [x, y].map(|edge| f64::from(edge) * cell_m))
    }

    /// The share of rigid voxels, 0 … 1.
    pub fn ratio(&self) -> f64 {
        f64::from(self.rigid_voxels) / f64::from(self.voxels.max(1))
    }
}

impl ShoreClass {
    /// Every class, by rising share of rigid voxels.
    pub const ALL: [Self; 3] = [Self::Sparse, Self::Dense, Self::Solid];

    /// The code of its cells in the layer [`Shore`](LayerId::Shore).
    pub const fn code(self) -> u16 {
        match self {
            Self::Sparse => 1,
            Self::Dense => 2,
            Self::Solid => 3,
        }
    }

    /// The name that legends print.
    pub fn name(self) -> &'static str {
        LayerId::Shore.classes()[usize::from(self.code()) - 1].name
    }
}

/// The code of a docking site's cells in the layer [`Shore`](LayerId::Shore).
pub const DOCKING_SITE_CODE: u16 = 4;

fn is_on_earth(datum: Datum) -> bool {
    (-90.0..=90.0).contains(&datum.latitude_deg)
        && (-180.0..=180.0).contains(&datum.longitude_deg)
        && (-20_000.0..=100_000.0).contains(&datum.altitude_m)
}

fn left_out(there_are: usize, limit: usize) -> u32 {
    u32::try_from(there_are.saturating_sub(limit)).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests;
