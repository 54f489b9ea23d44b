//! What the map is, and its pieces.

use serde::{Deserialize, Serialize};

use crate::layer::LayerId;
use crate::tile::TileDigest;
use crate::tile_store::RootDigest;

/// `map_head`: the whole map in digests. A console whose roots are equal holds the same cells.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapHead {
    /// One for each layer.
    pub layers: Vec<LayerHead>,
}

/// One layer of [`MapHead`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerHead {
    /// Which.
    pub layer: LayerId,
    /// How often it was erased.
    pub epoch: u32,
    /// The greatest revision in it.
    pub head_revision: u64,
    /// Tiles in it with at least one known cell.
    pub tiles: u32,
    /// Digest of all its cells.
    pub root: RootDigest,
}

/// `map/<layer>/<tx>/<ty>`: a tile, or the half of one that does not fit a message. The key says which tile.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TileBand {
    /// How often the layer had been erased.
    pub epoch: u32,
    /// The tile's revision; bands of one revision belong together.
    pub revision: u64,
    /// Digest of the whole tile's cells.
    pub digest: TileDigest,
    /// The rows, as [`crate::tile::codec`] writes them.
    pub rows: Vec<u8>,
}

/// Asks `map/<layer>/tiles` for tiles.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TilesRequest {
    /// All that are newer than a revision, nearest to the vehicle first.
    NewerThan(u64),
    /// These: `(tx, ty)`.
    ByKey(Vec<(i32, i32)>),
}

/// One tile out of the answer to [`TilesRequest`]; the answer has one of these a reply.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TilesReply {
    /// Tile column.
    pub tx: i32,
    /// Tile row.
    pub ty: i32,
    /// The tile, or half of it.
    pub band: TileBand,
    /// Replies that follow this one in the same answer; what did not fit must be asked for again.
    pub following: u32,
}

/// Asks `map/<layer>/digests` for the digests of tiles newer than a revision, oldest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct DigestsRequest {
    /// 0 for all.
    pub newer_than: u64,
}

/// The answer, in one message: a page of the list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Digests {
    /// How often the layer was erased.
    pub epoch: u32,
    /// The greatest revision in it.
    pub head_revision: u64,
    /// The tiles asked for, by rising revision, tombstones (with the digest of unknown cells) among them.
    pub tiles: Vec<TileSummary>,
    /// Newer ones that did not fit: to be asked for with the last revision listed.
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

/// `view/<session>`: what a console looks at, twice a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// The rectangle on its screen in `odom`, metres: lowest x, lowest y, greatest x, greatest y.
    pub rectangle_m: [f32; 4],
    /// The layers it wants, bit `i` for the layer with wire number `i`.
    pub layers: u32,
    /// The newest revision it holds.
    pub revision: u64,
    /// Whether it holds, of these layers, just what the robot announced last.
    pub is_synchronized: bool,
    /// Whether it wants to see the last sweeps of the sensors.
    pub wants_scan: bool,
}
