//! The console's copy of the map and its synchronization with the robot's map.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::{Digests, Info, LayerHead, MapHead, TileBand};
use protocol::tile::codec::DecodeError;
use protocol::tile::{BootId, TILE_SIDE, TileCells, TileDigest, TileKey};
use protocol::tile_store::{
    Applied, LayerGrid, OVERVIEW_STEP, RootDigest, StoreError, StoredTile, TileStore,
};
use protocol::wire::Header;

use super::layer_sync::{LayerSync, Query, SILENCE};
use super::messages::{RejectReason, RequestId};
use super::retry::ANSWER_TIMEOUT;
use super::tile_ages::TileAges;
use super::tile_intake::TileIntake;

/// Above this number, ages of removed tiles are dropped.
const MAX_AGES: usize = 200_000;

/// Open requests for tiles: while a request is on its way, replies to the others are.
const MAX_TILE_REQUESTS: usize = 4;
/// Fewest tiles in one request, which the first ones have, and most. Tiles that do not fit the reply are requested again.
const TILES_PER_REQUEST: [usize; 2] = [3, 48];
/// After a reply that takes longer requests are for half as many tiles, after a quicker one for twice as many, so that a thin link is not
/// filled: poses and commands would wait behind tiles, and what overflows its buffers is sent again.
const SLOW_REPLY: Duration = Duration::from_millis(1500);
const QUICK_REPLY: Duration = Duration::from_millis(800);

/// Overviews that are requested of a layer: cells of 0.05 m within 64 m. Each has the room of 64 tiles.
const MAX_OVERVIEWS: usize = 36;
/// Places looked at for tiles that no list names: cells of 0.01 m within 80 m. A robot may announce cells of any size.
const MAX_PLACES: usize = 16_384;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSyncState {
    pub layer: LayerId,
    /// Whether this layer equals the robot's last map head, cell for cell.
    pub is_equal: bool,
    pub last_equal: Option<Monotonic>,
    /// Tiles known to be missing. Without a list of tiles there may be more.
    pub missing: usize,
}

struct OpenRequest {
    layer: LayerId,
    /// Requested tiles; empty if they are unknown.
    tiles: Vec<(i32, i32)>,
    is_for_tiles: bool,
    at: Monotonic,
}

pub struct MapSync {
    store: TileStore,
    intake: TileIntake,
    overview_intake: TileIntake,
    /// Layers of which overviews were requested.
    overviews: BTreeSet<LayerId>,
    head: Option<(MapHead, Monotonic)>,
    /// When the last head or tile arrived.
    received: Option<Monotonic>,
    /// Whether a map head has arrived, so that the store's boot is the robot's.
    has_boot: bool,
    layers: BTreeMap<LayerId, LayerSync>,
    roots: BTreeMap<LayerId, RootDigest>,
    changed: BTreeSet<TileKey>,
    ages: TileAges,
    /// Tiles named by the lists that are still incomplete.
    arriving_lists: BTreeMap<LayerId, BTreeSet<(i32, i32)>>,
    open_requests: BTreeMap<RequestId, OpenRequest>,
    tiles_per_request: usize,
    /// Digest of a tile with unknown cells only.
    unknown: TileDigest,
    blank: TileCells,
    wanted: BTreeSet<LayerId>,
    focus_m: [f64; 2],
}

impl MapSync {
    pub(super) fn new(tile_store_mb: u32) -> Self {
        Self {
            store: TileStore::new(BootId([0; 16]), tile_store_mb),
            intake: TileIntake::default(),
            overview_intake: TileIntake::default(),
            overviews: BTreeSet::new(),
            head: None,
            received: None,
            has_boot: false,
            layers: BTreeMap::new(),
            roots: BTreeMap::new(),
            changed: BTreeSet::new(),
            ages: TileAges::default(),
            arriving_lists: BTreeMap::new(),
            open_requests: BTreeMap::new(),
            tiles_per_request: TILES_PER_REQUEST[0],
            unknown: TileCells::unknown().digest(),
            blank: TileCells::unknown(),
            wanted: LayerId::ALL.into_iter().collect(),
            focus_m: [0.0; 2],
        }
    }

    pub const fn store(&self) -> &TileStore {
        &self.store
    }

    pub const fn ages(&self) -> &TileAges {
        &self.ages
    }

    pub(super) fn update_clock(&mut self, header: Header, now: Monotonic) {
        if self.has_boot && header.boot == self.store.boot() {
            self.ages
                .update_clock(header.seq, header.robot_time_ns, now);
        }
    }

    pub fn layer_states(&self) -> impl Iterator<Item = LayerSyncState> {
        self.layers
            .iter()
            .filter(|(layer, _)| self.wanted.contains(layer))
            .map(|(layer, sync)| LayerSyncState {
                layer: *layer,
                is_equal: !sync.is_different(),
                last_equal: sync.last_equal,
                missing: sync.missing.len(),
            })
    }

    pub(super) fn boot(&self) -> Option<BootId> {
        self.has_boot.then(|| self.store.boot())
    }

    /// Whether all layers equal the newest map head, of any age.
    pub fn matches_head(&self) -> bool {
        self.head.is_some() && self.layer_states().all(|layer| layer.is_equal)
    }

    pub fn head_at(&self) -> Option<Monotonic> {
        self.head.as_ref().map(|(_, at)| *at)
    }

    /// The tiles that changed since the last call. All tiles after the map was emptied.
    pub fn take_changed(&mut self) -> BTreeSet<TileKey> {
        std::mem::take(&mut self.changed)
    }

    pub(super) fn set_wanted(&mut self, wanted: BTreeSet<LayerId>, focus_m: [f64; 2]) {
        self.wanted = wanted;
        self.focus_m = focus_m;
        self.store.set_focus(focus_m);
    }

    /// Whether the robot announced a layer that it has not described.
    pub(super) fn lacks_info(&self) -> bool {
        let layers = self.head.iter().flat_map(|(head, _)| &head.layers);
        let mut cells = layers.map(|head| self.store.cell_m(head.layer));
        cells.any(|cell_m| cell_m.is_none())
    }

    pub fn is_wanted(&self, layer: LayerId) -> bool {
        self.wanted.contains(&layer)
    }

    /// Sets the grids of the layers. Information from another run of the robot is ignored.
    pub(super) fn take_info(&mut self, info: &Info, boot: BootId) -> Result<(), StoreError> {
        if self.has_boot && boot != self.store.boot() {
            // The map head of that run comes first; then the information is requested again.
            return Ok(());
        }
        for layer in &info.layers {
            let held_m = self.store.cell_m(layer.layer);
            if held_m.is_some_and(|held_m| held_m.to_bits() != layer.cell_m.to_bits()) {
                for key in self.forget_layer(layer.layer) {
                    self.store.forget(key);
                }
            }
            self.store.set_grid(LayerGrid {
                layer: layer.layer,
                cell_m: layer.cell_m,
            })?;
            self.roots.remove(&layer.layer);
        }
        Ok(())
    }

    /// Takes a map head; returns whether it is from a new run of the robot.
    pub(super) fn take_head(
        &mut self,
        head: MapHead,
        boot: BootId,
        now: Monotonic,
    ) -> Result<bool, RejectReason> {
        let is_new = !self.has_boot || boot != self.store.boot();
        if is_new {
            let before = LayerId::ALL.into_iter();
            let before = before.flat_map(|layer| self.store.all_shown(layer));
            let before: Vec<_> = before.map(|(key, _)| key).collect();
            if !self.store.adopt_boot(boot) {
                return Err(RejectReason::OtherBoot);
            }
            self.changed.extend(before);
            self.has_boot = true;
            self.layers.clear();
            self.roots.clear();
            self.ages = TileAges::default();
            self.overviews.clear();
            self.forget_queries();
        }
        self.on_received(now);
        for layer in &head.layers {
            if layer.epoch > self.store.epoch(layer.layer) {
                self.erase_layer(layer.layer, layer.epoch);
            }
            self.layers.entry(layer.layer).or_default();
        }
        self.head = Some((head, now));
        Ok(is_new)
    }

    /// After silence the link was lost. On a thin link heads are late behind tiles.
    fn on_received(&mut self, now: Monotonic) {
        let was_silent = self.received.is_none_or(|at| now.since(at) > SILENCE);
        self.received = Some(now);
        if was_silent {
            self.layers.values_mut().for_each(LayerSync::on_link_loss);
            self.overviews.clear();
            self.forget_queries();
        }
    }

    fn of_this_boot(&self, boot: BootId) -> Result<(), RejectReason> {
        if !self.has_boot {
            Err(RejectReason::BeforeJoin)
        } else if boot != self.store.boot() {
            Err(RejectReason::OtherBoot)
        } else {
            Ok(())
        }
    }

    /// Takes one band of a tile, pushed or in reply to `request`.
    pub(super) fn take_band(
        &mut self,
        key: TileKey,
        header: Header,
        band: &TileBand,
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        self.of_this_boot(header.boot)?;
        if self.store.cell_m(key.layer).is_none() {
            return Err(RejectReason::UnknownLayer);
        }
        self.on_received(now);
        let revision = band.revision;
        let at = (key.tx, key.ty);
        if let (Some(sync), Some(request)) = (self.layers.get_mut(&key.layer), request) {
            sync.on_tile_reply(request, at, band.rows.len());
        }
        let held = self.store.get(key);
        let held = held.filter(|_| band.epoch == self.store.epoch(key.layer));
        let base = held.filter(|held| held.revision() == band.base && !held.is_evicted());
        let base = base.map(|held| held.cells().unwrap_or(&self.blank));
        let tile = self.intake.take(key, header, band, base);
        if let Err(DecodeError::NoBase) = tile {
            if held.is_some_and(|held| held.revision() >= revision) {
                return Err(RejectReason::OldRevision);
            }
            // What was evicted here is left to the comparison of digests.
            if !held.is_some_and(StoredTile::is_evicted) {
                let sync = self.layers.entry(key.layer).or_default();
                sync.on_missing(at, revision);
            }
        }
        let Some(tile) = tile.map_err(|why| reject_reason(&why))? else {
            return Ok(());
        };
        if tile.epoch > self.store.epoch(key.layer) {
            self.erase_layer(key.layer, tile.epoch);
        }
        let stamp_ns = tile.stamp_ns;
        let applied = self.store.apply(tile);
        let applied = applied.map_err(|_why| RejectReason::BadTile)?;
        let sync = self.layers.entry(key.layer).or_default();
        match request {
            Some(_) => sync.on_tile(at, revision),
            None => sync.on_pushed_tile(at, revision, now),
        }
        match applied {
            Applied::Stored => {
                self.roots.remove(&key.layer);
                self.changed.insert(key);
                self.ages.on_tile(key, stamp_ns, now);
                if self.ages.len() > MAX_AGES {
                    let store = &self.store;
                    self.ages.retain(|key| store.get(key).is_some());
                }
                Ok(())
            }
            Applied::OldBoot => Err(RejectReason::OtherBoot),
            Applied::OldEpoch => Err(RejectReason::OldEpoch),
            Applied::OldRevision => Err(RejectReason::OldRevision),
        }
    }

    /// Takes one band of an overview, which is shown until the tiles arrive.
    pub(super) fn take_overview(
        &mut self,
        key: TileKey,
        header: Header,
        band: &TileBand,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        self.of_this_boot(header.boot)?;
        if band.epoch != self.store.epoch(key.layer) {
            return Err(RejectReason::OldEpoch);
        }
        self.on_received(now);
        let overview = self.overview_intake.take(key, header, band, None);
        let overview = overview.map_err(|why| reject_reason(&why))?;
        let sync = self.layers.get(&key.layer);
        if sync.is_some_and(LayerSync::is_different)
            && let Some(overview) = overview
        {
            let shown = self.store.show_overview(&overview);
            self.changed
                .extend(shown.map_err(|_why| RejectReason::BadTile)?);
        }
        Ok(())
    }

    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) {
        let Some(open) = self.open_requests.remove(&request) else {
            return;
        };
        if open.is_for_tiles {
            let took = now.since(open.at);
            let [least, most] = TILES_PER_REQUEST;
            if took > SLOW_REPLY {
                self.tiles_per_request = least.max(self.tiles_per_request / 2);
            } else if took < QUICK_REPLY {
                self.tiles_per_request = most.min(self.tiles_per_request * 2);
            }
        }
        if let Some(sync) = self.layers.get_mut(&open.layer) {
            sync.ended(request, &open.tiles, now);
        }
    }

    fn erase_layer(&mut self, layer: LayerId, epoch: u32) {
        self.forget_layer(layer);
        self.store.adopt_epoch(layer, epoch);
        self.ages.restart();
    }

    /// Restarts the synchronization of a layer; returns its tiles, which are void.
    fn forget_layer(&mut self, layer: LayerId) -> Vec<TileKey> {
        let gone: Vec<_> = self.store.tiles(layer).map(|(key, _)| key).collect();
        self.changed.extend(&gone);
        self.changed.extend(self.store.forget_overviews(layer));
        self.overviews.remove(&layer);
        self.roots.remove(&layer);
        self.ages.forget(layer);
        self.layers.insert(layer, LayerSync::default());
        gone
    }

    fn forget_queries(&mut self) {
        self.open_requests.clear();
        self.arriving_lists.clear();
    }

    pub fn abandoned_bands(&self) -> u64 {
        self.intake.abandoned
    }

    /// Compares root digests and returns the requests that are due. A console that joins requests all that is in `near_m` first:
    /// lowest and greatest x and y in `odom`, metres.
    pub(super) fn queries(
        &mut self,
        near_m: Option<[f64; 4]>,
        now: Monotonic,
        mut number: impl FnMut() -> RequestId,
    ) -> Vec<(RequestId, LayerId, Query)> {
        let Some((head, _)) = self.head.clone() else {
            return Vec::new();
        };
        // The end of a request can be lost too.
        let open = self.open_requests.iter();
        let late = open.filter(|(_, open)| now.since(open.at) >= ANSWER_TIMEOUT);
        for request in late.map(|(request, _)| *request).collect::<Vec<_>>() {
            self.ended(request, now);
        }
        let wanted = head.layers.iter();
        let wanted: Vec<_> = wanted
            .filter(|head| self.wanted.contains(&head.layer))
            .collect();
        for head in &wanted {
            self.compare(head, now);
        }
        let mut queries = Vec::new();
        for head in &wanted {
            if let Some(query) = self.overview_query(head.layer, near_m) {
                queries.push(self.open_request(head.layer, query, now, &mut number));
            }
        }
        for head in &wanted {
            while let Some(query) = self.near_query(head.layer, near_m) {
                queries.push(self.open_request(head.layer, query, now, &mut number));
            }
        }
        // A list of a layer is as long as many of its tiles.
        if self.is_joining(near_m) {
            return queries;
        }
        for head in &wanted {
            while let Some(query) = self.next_query(head.layer, now) {
                queries.push(self.open_request(head.layer, query, now, &mut number));
            }
        }
        queries
    }

    fn open_request(
        &mut self,
        layer: LayerId,
        query: Query,
        now: Monotonic,
        number: &mut impl FnMut() -> RequestId,
    ) -> (RequestId, LayerId, Query) {
        let request = number();
        if let Some(sync) = self.layers.get_mut(&layer) {
            sync.on_request(request, &query);
        }
        let tiles = match &query {
            Query::Digests { .. } | Query::Overviews(_) => Vec::new(),
            Query::Tiles(tiles) => tiles.clone(),
        };
        let open = OpenRequest {
            layer,
            tiles,
            is_for_tiles: matches!(query, Query::Tiles(_)),
            at: now,
        };
        self.open_requests.insert(request, open);
        (request, layer, query)
    }

    /// Whether layers are not described yet, or tiles near the vehicle have not arrived.
    pub(super) fn is_joining(&self, near_m: Option<[f64; 4]>) -> bool {
        let is_incomplete = |layer: &LayerId| {
            let mut open = self.open_requests.values();
            let is_listed = self.layers.get(layer).is_none_or(LayerSync::is_listed);
            !is_listed && open.any(|open| open.layer == *layer && open.is_for_tiles)
                || self.unlisted(*layer, near_m).next().is_some()
        };
        self.lacks_info() || self.wanted.iter().any(is_incomplete)
    }

    /// Places in `near_m` whose tiles are neither here nor requested, while no list says which there are.
    fn unlisted(
        &self,
        layer: LayerId,
        near_m: Option<[f64; 4]>,
    ) -> impl Iterator<Item = (i32, i32)> {
        let sync = self.layers.get(&layer).filter(|sync| !sync.is_listed());
        let found = near_m.zip(self.store.cell_m(layer)).zip(sync);
        found.into_iter().flat_map(move |((near_m, cell_m), sync)| {
            places(near_m, cell_m).filter(move |&(tx, ty)| {
                let key = TileKey { layer, tx, ty };
                sync.is_unlisted((tx, ty)) && self.store.get(key).is_none()
            })
        })
    }

    /// The overviews in `near_m`, once, of a layer of which no list says what there is.
    fn overview_query(&mut self, layer: LayerId, near_m: Option<[f64; 4]>) -> Option<Query> {
        let is_joining = |sync: &&LayerSync| sync.is_joining();
        self.layers.get(&layer).filter(is_joining)?;
        let cell_m = self.store.cell_m(layer)? * OVERVIEW_STEP as f64;
        let near_m = near_m.filter(|_| self.overviews.insert(layer))?;
        let places = places(near_m, cell_m).collect();
        let near = nearest(near_m, cell_m, places, MAX_OVERVIEWS);
        Some(Query::Overviews(near))
    }

    fn near_query(&self, layer: LayerId, near_m: Option<[f64; 4]>) -> Option<Query> {
        if self.room_for_tiles() == 0 {
            return None;
        }
        let tiles = self.unlisted(layer, near_m).collect();
        let cell_m = self.store.cell_m(layer)?;
        let tiles = nearest(near_m?, cell_m, tiles, self.tiles_per_request);
        (!tiles.is_empty()).then_some(Query::Tiles(tiles))
    }

    fn room_for_tiles(&self) -> usize {
        let open = self.open_requests.values();
        let for_tiles = open.filter(|open| open.is_for_tiles).count();
        MAX_TILE_REQUESTS.saturating_sub(for_tiles)
    }

    fn next_query(&self, layer: LayerId, now: Monotonic) -> Option<Query> {
        let is_requested = |tile| {
            let mut open = self.open_requests.values();
            open.any(|open| open.layer == layer && open.tiles.contains(&tile))
        };
        self.layers.get(&layer)?.query(
            now,
            self.room_for_tiles(),
            self.tiles_per_request,
            distance(self.focus_m, self.store.cell_m(layer)?),
            is_requested,
        )
    }

    fn compare(&mut self, head: &LayerHead, now: Monotonic) {
        let known = self.roots.get(&head.layer).copied();
        let own = known.or_else(|| self.store.root_digest(head.layer));
        self.roots.extend(own.map(|root| (head.layer, root)));
        let Some(sync) = self.layers.get_mut(&head.layer) else {
            return;
        };
        if own == Some(head.root) && head.epoch == self.store.epoch(head.layer) {
            sync.on_equal_root(head.head_revision, now);
            self.changed.extend(self.store.forget_overviews(head.layer));
        } else if own.is_some() {
            sync.on_other_root(now);
        }
    }

    pub(super) fn take_digests(
        &mut self,
        layer: LayerId,
        boot: BootId,
        digests: &Digests,
        request: RequestId,
    ) -> Result<(), RejectReason> {
        self.of_this_boot(boot)?;
        if digests.epoch != self.store.epoch(layer) {
            return Err(RejectReason::OldEpoch);
        }
        let Some(sync) = self.layers.get_mut(&layer) else {
            return Err(RejectReason::UnknownLayer);
        };
        let Some(newer_than) = sync.list_start(request) else {
            return Ok(());
        };
        let (store, unknown) = (&self.store, self.unknown);
        let lacking = digests.tiles.iter().filter_map(|tile| {
            let (tx, ty) = (tile.tx, tile.ty);
            let key = TileKey { layer, tx, ty };
            let is_lacking = match store.get(key) {
                None => tile.digest != unknown,
                Some(held) if held.is_evicted() => tile.revision > held.revision(),
                Some(held) => tile.revision >= held.revision() && tile.digest != held.digest(),
            };
            is_lacking.then_some(((tx, ty), tile.revision))
        });
        let last = digests.tiles.last().map(|tile| tile.revision);
        let next = last.filter(|_| digests.more > 0);
        sync.on_list_page(request, lacking, digests.head_revision, next);
        let listed = self.arriving_lists.entry(layer).or_default();
        listed.extend(digests.tiles.iter().map(|tile| (tile.tx, tile.ty)));
        if next.is_none() {
            let listed = std::mem::take(listed);
            if newer_than == 0 {
                self.forget_unlisted(layer, &listed, digests.head_revision);
            }
        }
        Ok(())
    }

    /// Removes tiles that a complete list does not name: the robot does not have them.
    fn forget_unlisted(
        &mut self,
        layer: LayerId,
        listed: &BTreeSet<(i32, i32)>,
        head_revision: u64,
    ) {
        let gone = self.store.tiles(layer).filter(|(key, held)| {
            held.revision() <= head_revision && !listed.contains(&(key.tx, key.ty))
        });
        for key in gone.map(|(key, _)| key).collect::<Vec<_>>() {
            self.store.forget(key);
            self.roots.remove(&layer);
            self.ages.remove(key);
            self.changed.insert(key);
        }
    }
}

/// Places of the tiles with cells of `cell_m` that a rectangle meets: lowest and greatest x and y, metres.
fn places(rectangle_m: [f64; 4], cell_m: f64) -> impl Iterator<Item = (i32, i32)> {
    let side_m = TILE_SIDE as f64 * cell_m;
    let [low_x, low_y, high_x, high_y] = rectangle_m.map(|edge_m| (edge_m / side_m).floor() as i32);
    let places = (low_y..=high_y).flat_map(move |ty| (low_x..=high_x).map(move |tx| (tx, ty)));
    places.take(MAX_PLACES)
}

/// The tiles with cells of `cell_m` that are nearest to the middle of a rectangle, at most `most`.
fn nearest(
    [low_x, low_y, high_x, high_y]: [f64; 4],
    cell_m: f64,
    mut tiles: Vec<(i32, i32)>,
    most: usize,
) -> Vec<(i32, i32)> {
    let order = distance([0.5 * (low_x + high_x), 0.5 * (low_y + high_y)], cell_m);
    tiles.sort_by(|a, b| order(*a).total_cmp(&order(*b)));
    tiles.truncate(most);
    tiles
}

/// Squares of the distances of tiles with cells of `cell_m` from a point, metres.
fn distance([x, y]: [f64; 2], cell_m: f64) -> impl Fn((i32, i32)) -> f64 {
    let middle_m = move |tile: i32| (f64::from(tile) + 0.5) * TILE_SIDE as f64 * cell_m;
    move |(tx, ty)| (middle_m(tx) - x).powi(2) + (middle_m(ty) - y).powi(2)
}

fn reject_reason(why: &DecodeError) -> RejectReason {
    match why {
        DecodeError::Version(_) => RejectReason::OtherProtocol,
        DecodeError::NoBase => RejectReason::NoBase,
        _ => RejectReason::BadTile,
    }
}
