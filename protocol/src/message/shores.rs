//! What stands along the water, and where one could dock.

use serde::{Deserialize, Serialize};

/// `shores`, pushed and in answer to [`ShoresRequest`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShoresReply {
    /// Counts the states of the shores in one boot, from 1; 0 where there is none yet.
    pub revision: u64,
    /// That state. `None` only in an answer: there is nothing newer than what was asked with.
    pub shores: Option<Shores>,
}

/// Asks `shores` for the shores, if they are newer than a revision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShoresRequest {
    /// 0 for whatever there is.
    pub newer_than: u64,
}

/// All shores and docking sites of one moment; [`Shores::gather`] makes one that fits a message.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shores {
    /// Side of the cells that outlines are counted in, metres.
    pub cell_m: f64,
    /// Where on Earth `odom` is, once that is known.
    pub datum: Option<Datum>,
    /// The shores, by number.
    pub clusters: Vec<ShoreCluster>,
    /// Shores that are too many for a message: those of the fewest voxels.
    pub clusters_left_out: u32,
    /// Where one could dock, the best first: the rank is the place in this list.
    pub sites: Vec<DockingSite>,
    /// Docking sites that are too many for a message: the last in rank.
    pub sites_left_out: u32,
}

/// The origin of `odom` by WGS-84; x points east there, y north.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Datum {
    /// Degrees, north positive.
    pub latitude_deg: f64,
    /// Degrees, east positive.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid.
    pub altitude_m: f64,
}

/// Voxels that stand together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShoreCluster {
    /// The same from update to update, from 1.
    pub number: u32,
    /// What grows there.
    pub class: ShoreClass,
    /// How many it has.
    pub voxels: u32,
    /// How many of these are rigid.
    pub rigid_voxels: u32,
    /// Mean of the voxels, x and y in `odom`, metres.
    pub center_m: [f32; 2],
    /// Corners of a convex polygon around its cells, counter-clockwise, in cells: `(x, y)` is the point
    /// `(x · cell_m, y · cell_m)` of `odom`.
    pub outline: Vec<(i32, i32)>,
}

/// What grows on a shore, by the share of rigid voxels. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ShoreClass {
    /// Scattered canes.
    Sparse,
    /// Canes close together, that still give way.
    Dense,
    /// Bushes, trunks, rock, walls.
    Solid,
}

/// A gentle slope that rises from clear water and is large enough for the boat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DockingSite {
    /// Its middle, x and y in `odom`, metres.
    pub center_m: [f32; 2],
    /// Where the bow points on the way in, counter-clockwise from x of `odom`.
    pub heading_rad: f32,
    /// Across the heading, metres.
    pub width_m: f32,
    /// Mean slope cost of its cells, 0 … 1.
    pub mean_cost: f32,
}
