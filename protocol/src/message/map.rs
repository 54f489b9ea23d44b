//! Messages of the map: head, tiles, views, scans, shores, trajectory and voxel files.

use std::num::NonZeroU32;

use serde::{Deserialize, Serialize};

use crate::export::StampedPose;
use crate::layer::LayerId;
use crate::tile::{TileCheck, TileDigest};
use crate::tile_store::RootDigest;

/// `map_head`: digests of the whole map. A console with equal roots holds the same cells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapHead {
    /// One for each layer.
    pub layers: Vec<LayerHead>,
}

/// One layer of [`MapHead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerHead {
    /// The layer.
    pub layer: LayerId,
    /// Number of erasures.
    pub epoch: u32,
    /// Greatest revision.
    pub head_revision: u64,
    /// Tiles with a known cell.
    pub tiles: u32,
    /// Digest of all its cells.
    pub root: RootDigest,
}

/// `map/<layer>/changes`: tiles that changed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Changes {
    /// At least one.
    pub tiles: Vec<ChangedTile>,
}

/// A tile, or half of one, in [`Changes`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangedTile {
    /// Tile column.
    pub tx: i32,
    /// Tile row.
    pub ty: i32,
    /// Its data is so much older than the stamp of the message, nanoseconds.
    pub older_ns: u64,
    /// The tile, or half of it.
    pub band: TileBand,
}

/// A tile, or half of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileBand {
    /// Number of erasures of the layer.
    pub epoch: u32,
    /// Revision of the tile; bands of one revision belong together.
    pub revision: u64,
    /// Revision that it holds the differences to; 0 for none.
    pub base: u64,
    /// That of the digest of the whole tile's cells.
    pub check: TileCheck,
    /// Rows, encoded by [`crate::tile::codec`].
    pub rows: Vec<u8>,
}

/// A reply ends with the tile with which it has this many bytes of bands.
pub const TILES_REPLY_BYTES: usize = 15 * 1024;

/// Request to `map/<layer>/tiles`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TilesRequest {
    /// All tiles newer than a revision, nearest to the vehicle first.
    NewerThan(u64),
    /// These tiles: `(tx, ty)`.
    ByKey(Vec<(i32, i32)>),
}

/// One tile in the answer to [`TilesRequest`], which has one reply per band.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TilesReply {
    /// Tile column.
    pub tx: i32,
    /// Tile row.
    pub ty: i32,
    /// The tile, or half of it.
    pub band: TileBand,
    /// Replies that follow in this answer; tiles that did not fit must be requested again.
    pub following: u32,
}

/// Request to `map/<layer>/digests` for the digests of tiles newer than a revision, oldest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DigestsRequest {
    /// 0 for all.
    pub newer_than: u64,
}

/// Answer to [`DigestsRequest`], a page of the list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Digests {
    /// Number of erasures of the layer.
    pub epoch: u32,
    /// Greatest revision in the layer.
    pub head_revision: u64,
    /// Requested tiles by ascending revision, including tombstones (with the digest of unknown
    /// cells).
    pub tiles: Vec<TileSummary>,
    /// Newer tiles that did not fit; request them with the last listed revision.
    pub more: u32,
}

/// A tile in [`Digests`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileSummary {
    /// Tile column.
    pub tx: i32,
    /// Tile row.
    pub ty: i32,
    /// Its revision.
    pub revision: u64,
    /// Digest of its cells.
    pub digest: TileDigest,
}

/// `view/<session>`: view of a console, twice a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Visible rectangle in `odom`, metres: lowest x, lowest y, greatest x, greatest y.
    pub rectangle_m: [f32; 4],
    /// Requested layers, bit `i` for the layer with wire number `i`.
    pub layers: u32,
    /// Newest revision that the console holds.
    pub revision: u64,
    /// Whether the console holds exactly the last announced map of these layers.
    pub is_synchronized: bool,
    /// Whether the console displays scans.
    pub wants_scan: bool,
}

/// Limit of points in one [`Scan`].
pub const MAX_SCAN_POINTS: usize = 360;
/// Greatest distance of a point from the origin of its [`Scan`], centimetres along x and y.
pub const MAX_SCAN_REACH_CM: i32 = 100_000;

const CM_PER_M: f64 = 100.0;

/// `scan`: ends of the beams of a sensor's last sweep, thinned out, for display. The header has its
/// stamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scan {
    /// The sensor's name, as in [`SensorInfo`](super::SensorInfo).
    pub sensor: String,
    /// Position of the sensor, x and y in `odom`, metres.
    pub origin_m: [f64; 2],
    /// Points in beam order, centimetres along x and y of `odom`: the first relative to the origin,
    /// the others to the previous one.
    pub steps_cm: Vec<(i32, i32)>,
}

impl Scan {
    /// Scan of these points, x and y in `odom`, metres. It omits points that are not finite or too
    /// far, and points beyond the limit.
    pub fn of_points(
        sensor: String,
        origin_m: [f64; 2],
        points_m: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        let in_cm = |[x, y]: [f64; 2]| {
            let cm = [x - origin_m[0], y - origin_m[1]].map(|metres| (metres * CM_PER_M).round());
            let reach = f64::from(MAX_SCAN_REACH_CM);
            cm.iter()
                .all(|cm| cm.abs() <= reach)
                .then(|| cm.map(|cm| cm as i32))
        };
        let mut last = [0, 0];
        let steps_cm = points_m
            .into_iter()
            .filter_map(in_cm)
            .take(MAX_SCAN_POINTS)
            .map(|[x, y]| {
                let step = (x - last[0], y - last[1]);
                last = [x, y];
                step
            })
            .collect();
        Self {
            sensor,
            origin_m,
            steps_cm,
        }
    }

    /// Points, x and y in `odom`, metres; `None` if there are too many, one is too far, or the
    /// origin is not finite.
    pub fn points_m(&self) -> Option<Vec<[f64; 2]>> {
        let is_sound = self.steps_cm.len() <= MAX_SCAN_POINTS
            && self.origin_m.iter().all(|metres| metres.is_finite());
        if !is_sound {
            return None;
        }
        let mut at = [0i32; 2];
        let point = |&(dx, dy): &(i32, i32)| {
            at = [at[0].checked_add(dx)?, at[1].checked_add(dy)?];
            let is_near = at
                .iter()
                .all(|cm| cm.unsigned_abs() <= MAX_SCAN_REACH_CM.unsigned_abs());
            let metres = |axis: usize| self.origin_m[axis] + f64::from(at[axis]) / CM_PER_M;
            is_near.then(|| [metres(0), metres(1)])
        };
        self.steps_cm.iter().map(point).collect()
    }
}

/// `shores`, published and in answer to [`ShoresRequest`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShoresReply {
    /// Number of the state in one boot, from 1; 0 before the first.
    pub revision: u64,
    /// The state. `None` only in an answer, if there is nothing newer than requested.
    pub shores: Option<Shores>,
}

/// Request to `shores` for a state newer than a revision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShoresRequest {
    /// 0 for any.
    pub newer_than: u64,
}

/// All shores and docking sites at one time; [`Shores::gather`] limits them to a message.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Shores {
    /// Unit of outlines, metres.
    pub cell_m: f64,
    /// Origin of `odom` on Earth, if known.
    pub datum: Option<Datum>,
    /// Ordered by number.
    pub clusters: Vec<ShoreCluster>,
    /// Omitted shores, those of the fewest voxels.
    pub clusters_left_out: u32,
    /// Docking sites, the best first; the rank is the index.
    pub sites: Vec<DockingSite>,
    /// Omitted docking sites, the last in rank.
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

/// A cluster of bank voxels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShoreCluster {
    /// From 1; constant between updates.
    pub number: u32,
    /// Vegetation class.
    pub class: ShoreClass,
    /// Number of voxels.
    pub voxels: u32,
    /// Number of rigid voxels.
    pub rigid_voxels: u32,
    /// Mean of the voxels, x and y in `odom`, metres.
    pub center_m: [f32; 2],
    /// Corners of a convex polygon around its cells, counter-clockwise, in cells: `(x, y)` is the point
    /// `(x · cell_m, y · cell_m)` of `odom`.
    pub outline: Vec<(i32, i32)>,
}

/// Class of a shore: how it gives way to a hull. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum ShoreClass {
    /// Scattered canes.
    Sparse,
    /// Dense canes that still give way.
    Dense,
    /// Bushes, trunks, rock, walls.
    Solid,
}

/// A gentle slope that rises from clear water and holds the boat, or, for an emergency, vegetation
/// that gives way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DockingSite {
    /// From 1; constant for a place while the maps last. Shown as [letters](crate::shores::site_letters).
    pub number: u32,
    /// Its middle, x and y in `odom`, metres.
    pub center_m: [f32; 2],
    /// Direction of the bow on the way in, counter-clockwise from x of `odom`.
    pub heading_rad: f32,
    /// Across the heading, metres.
    pub width_m: f32,
    /// The vegetation that the boat pushes into, never Solid; `None` for a gentle slope.
    pub vegetation: Option<ShoreClass>,
    /// Of a slope its mean cost, 0 … 1; of vegetation 1 plus its density, at most 2.
    pub price: f32,
    /// Where the way in along the heading begins, x and y in `odom`, metres.
    pub approach_m: [f32; 2],
}

/// Limit of poses in one [`TrajectoryPart`].
pub const MAX_TRAJECTORY_POSES: usize = 500;

/// Request to `trajectory` for poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrajectoryRequest {
    /// Its identifier; `None` for the current one.
    pub trajectory: Option<u64>,
    /// Index of the first pose.
    pub from: u64,
    /// Index step.
    pub step: NonZeroU32,
}

/// Reply to [`TrajectoryRequest`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrajectoryPart {
    /// Identifier of the trajectory. If it changes, pose indices have changed and must be requested
    /// again.
    pub trajectory: u64,
    /// Number of its poses.
    pub poses: u64,
    /// Requested poses, at most [`MAX_TRAJECTORY_POSES`]; none for an outdated trajectory. Each as
    /// the difference to the previous one, the first absolute: stamp, nanoseconds; x, y, z, 0.1 µm;
    /// quaternion x, y, z, w, 10⁻⁹.
    pub rows: Vec<[i64; 8]>,
}

impl TrajectoryPart {
    /// Encodes a part.
    pub fn new(trajectory: u64, poses: u64, part: impl Iterator<Item = StampedPose>) -> Self {
        let mut before = [0; 8];
        let rows = part
            .take(MAX_TRAJECTORY_POSES)
            .map(|pose| {
                let now = pose.to_row();
                let row = std::array::from_fn(|i| now[i].wrapping_sub(before[i]));
                before = now;
                row
            })
            .collect();
        Self {
            trajectory,
            poses,
            rows,
        }
    }

    /// Decoded poses.
    pub fn part(&self) -> impl Iterator<Item = StampedPose> {
        let mut before = [0i64; 8];
        self.rows.iter().map(move |row| {
            before = std::array::from_fn(|i| before[i].wrapping_add(row[i]));
            StampedPose::from_row(before)
        })
    }
}

/// Limit of file bytes in one [`VoxelsPart`].
pub const MAX_PART_BYTES: usize = 16 * 1024;

/// A file of the octree. Append-only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum VoxelFile {
    /// `voxels.bt`: `OctoMap`'s binary tree.
    Tree,
    /// `points.ply`: occupied voxels with their class.
    Points,
}

impl VoxelFile {
    /// All files, in wire order.
    pub const ALL: [Self; 2] = [Self::Tree, Self::Points];

    /// File name in exports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tree => "voxels.bt",
            Self::Points => "points.ply",
        }
    }
}

/// Request to `voxels` for a part of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelsRequest {
    /// Identifier of the snapshot; `None` for a new one.
    pub snapshot: Option<u64>,
    /// The file.
    pub file: VoxelFile,
    /// Number of packed bytes already received.
    pub offset: u64,
}

/// Reply to [`VoxelsRequest`]. Append-only.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum VoxelsReply {
    /// The robot has no octree.
    None,
    /// The files are being written; repeat the request in half a second.
    Preparing,
    /// The snapshot no longer exists; start again.
    Gone,
    /// A part.
    Part(VoxelsPart),
}

/// A part of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VoxelsPart {
    /// Identifier of the snapshot; the header has the stamp of its newest data.
    pub snapshot: u64,
    /// The file.
    pub file: VoxelFile,
    /// Length of the whole file.
    pub bytes: u64,
    /// BLAKE3 of the whole file.
    pub digest: [u8; 32],
    /// Length of the whole file as one zstd frame.
    pub packed_bytes: u64,
    /// Offset of this part in that frame.
    pub offset: u64,
    /// The part, at most [`MAX_PART_BYTES`].
    pub packed: Vec<u8>,
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn points_come_back_to_the_centimetre() {
        let points = [[12.344, -3.0], [12.5, -2.75], [-500.0, 900.0]];
        let scan = Scan::of_points("laser".to_owned(), [10.0, -5.0], points);
        assert_eq!(scan.steps_cm, [(234, 200), (16, 25), (-51_250, 90_275)]);
        let back = scan.points_m().unwrap();
        for (back, point) in back.iter().zip(points) {
            for axis in [0, 1] {
                assert!((back[axis] - point[axis]).abs() <= 0.005 + 1e-9, "{back:?}");
            }
        }
        assert_eq!(back.len(), 3);
    }

    #[test]
    fn invalid_points_are_omitted_and_refused() {
        let far = [[f64::NAN, 0.0], [0.0, f64::INFINITY], [1000.01, 0.0]];
        let scan = Scan::of_points(String::new(), [0.0; 2], far);
        assert_eq!(scan.steps_cm, []);
        let many = vec![[1.0, 1.0]; MAX_SCAN_POINTS + 1];
        let scan = Scan::of_points(String::new(), [0.0; 2], many);
        assert_eq!(scan.points_m().unwrap().len(), MAX_SCAN_POINTS);

        let refused = |origin_m, steps_cm| {
            let sensor = String::new();
            let scan = Scan {
                sensor,
                origin_m,
                steps_cm,
            };
            assert_eq!(scan.points_m(), None);
        };
        refused([f64::NAN, 0.0], Vec::new());
        refused([0.0; 2], vec![(0, 0); MAX_SCAN_POINTS + 1]);
        refused([0.0; 2], vec![(60_000, 0), (60_000, 0)]);
        refused([0.0; 2], vec![(i32::MAX, 0), (i32::MAX, 0)]);
        refused([0.0; 2], vec![(0, i32::MIN)]);
    }

    proptest! {
        #[test]
        fn decoded_points_are_refused_or_near(
            steps_cm in prop::collection::vec((any::<i32>(), -200_000i32..200_000), 0..400),
            origin_m in prop::array::uniform2(any::<f64>()),
        ) {
            let scan = Scan { sensor: String::new(), origin_m, steps_cm };
            if let Some(points) = scan.points_m() {
                prop_assert!(points.len() <= MAX_SCAN_POINTS);
                prop_assert!(points.iter().flatten().all(|metres| metres.is_finite()));
            }
        }
    }
}
