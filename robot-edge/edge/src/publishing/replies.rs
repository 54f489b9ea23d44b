//! Replies to queries about the map. Pure.

use std::sync::Mutex;

use protocol::layer::LayerId;
use protocol::message::{
    Digests, DigestsRequest, LayerHead, MapHead, TILES_REPLY_BYTES, TileBand, TileSummary,
    TilesReply, TilesRequest,
};
use protocol::tile::codec;
use protocol::tile::{Tile, TileKey};
use protocol::tile_store::TileStore;

use crate::lock;

/// Tiles in a list of digests: below 8 KiB, so that no queue drops or delays it.
pub const DIGESTS_PER_REPLY: usize = 160;
pub const MAX_TILES_PER_REQUEST: usize = 4096;

/// Runs `read` on the store, for which mapping waits: longer work is done on a copy.
pub fn with_store<T>(store: &Mutex<TileStore>, read: impl FnOnce(&TileStore) -> T) -> T {
    read(&lock(store))
}

pub fn head(store: &Mutex<TileStore>) -> MapHead {
    with_store(store, |store| {
        let layers = store.grids().filter_map(|grid| {
            Some(LayerHead {
                layer: grid.layer,
                epoch: store.epoch(grid.layer),
                head_revision: store.head_revision(grid.layer),
                tiles: u32::try_from(store.tile_count(grid.layer)).unwrap_or(u32::MAX),
                root: store.root_digest(grid.layer)?,
            })
        });
        MapHead {
            layers: layers.collect(),
        }
    })
}

/// The bands of a tile, each with its stamp, nanoseconds on the clock of the data.
pub fn bands(store: &Mutex<TileStore>, key: TileKey) -> Vec<(i64, TileBand)> {
    let tile = with_store(store, |store| store.tile(key));
    tile.as_ref().map_or_else(Vec::new, bands_of)
}

/// As [`bands`].
pub fn bands_of(tile: &Tile) -> Vec<(i64, TileBand)> {
    let bands = codec::encode(tile.key.layer, &tile.cells).into_iter();
    let band = |rows| TileBand {
        epoch: tile.epoch,
        revision: tile.revision,
        base: 0,
        check: tile.check,
        rows,
    };
    bands.map(|rows| (tile.stamp_ns, band(rows))).collect()
}

/// The tiles asked for, as many as fit one answer: listed ones in the order of the list, newer ones from
/// `near_m` (metres in `odom`) outwards; with the stamps of their tiles, as [`bands`] gives them.
pub fn tiles(
    store: &Mutex<TileStore>,
    layer: LayerId,
    request: &TilesRequest,
    near_m: [f64; 2],
) -> Vec<(i64, TilesReply)> {
    let keys = match request {
        TilesRequest::NewerThan(revision) => newer_than(store, layer, *revision, near_m),
        TilesRequest::ByKey(tiles) => by_key(layer, tiles),
    };
    fitting(keys, |key| bands(store, key))
}

/// The overviews asked for by their places; as [`tiles`].
pub fn overviews(
    store: &Mutex<TileStore>,
    layer: LayerId,
    request: &TilesRequest,
) -> Vec<(i64, TilesReply)> {
    let TilesRequest::ByKey(places) = request else {
        return Vec::new();
    };
    let store = with_store(store, TileStore::clone);
    fitting(by_key(layer, places), |key| {
        let overview = store.overview(key);
        overview.as_ref().map_or_else(Vec::new, bands_of)
    })
}

fn by_key(layer: LayerId, places: &[(i32, i32)]) -> Vec<TileKey> {
    let places = places.iter().take(MAX_TILES_PER_REQUEST);
    places.map(|&(tx, ty)| TileKey { layer, tx, ty }).collect()
}

/// The bands of as many of these tiles as fit one answer.
fn fitting(
    keys: Vec<TileKey>,
    bands: impl Fn(TileKey) -> Vec<(i64, TileBand)>,
) -> Vec<(i64, TilesReply)> {
    let mut found: Vec<(TileKey, i64, TileBand)> = Vec::new();
    let mut bytes = 0;
    for key in keys {
        if bytes >= TILES_REPLY_BYTES {
            break;
        }
        for (stamp_ns, band) in bands(key) {
            bytes += band.rows.len();
            found.push((key, stamp_ns, band));
        }
    }
    let count = found.len();
    let replies = found
        .into_iter()
        .enumerate()
        .map(|(index, (key, stamp_ns, band))| {
            let reply = TilesReply {
                tx: key.tx,
                ty: key.ty,
                band,
                following: u32::try_from(count - 1 - index).unwrap_or(u32::MAX),
            };
            (stamp_ns, reply)
        });
    replies.collect()
}

fn newer_than(
    store: &Mutex<TileStore>,
    layer: LayerId,
    revision: u64,
    near_m: [f64; 2],
) -> Vec<TileKey> {
    let mut keys = with_store(store, |store| {
        let cell_m = store.cell_m(layer).unwrap_or(1.0);
        let distance = |key: TileKey| {
            let [x, y] = key.center_m(cell_m);
            let (dx, dy) = (x - near_m[0], y - near_m[1]);
            dx * dx + dy * dy
        };
        let newer = store.newer_than(layer, revision);
        newer
            .map(|(key, _)| (distance(key), key))
            .collect::<Vec<_>>()
    });
    keys.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    keys.into_iter().map(|(_, key)| key).collect()
}

/// Revisions and digests of the tiles asked for: a page of them, oldest first.
pub fn digests(store: &Mutex<TileStore>, layer: LayerId, request: DigestsRequest) -> Digests {
    with_store(store, |store| {
        let newer = store.newer_than(layer, request.newer_than);
        let mut tiles: Vec<_> = newer
            .map(|(key, stored)| TileSummary {
                tx: key.tx,
                ty: key.ty,
                revision: stored.revision(),
                digest: stored.digest(),
            })
            .collect();
        tiles.sort_unstable_by_key(|tile| tile.revision);
        let more = tiles.len().saturating_sub(DIGESTS_PER_REPLY);
        tiles.truncate(DIGESTS_PER_REPLY);
        Digests {
            epoch: store.epoch(layer),
            head_revision: store.head_revision(layer),
            tiles,
            more: u32::try_from(more).unwrap_or(u32::MAX),
        }
    })
}
