//! The map as this console holds it, and what it does to be synchronized with the robot's.

mod listing;

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::{DigestsRequest, Info, MapHead, TileBand, TilesReply, TilesRequest};
use protocol::tile::codec::DecodeError;
use protocol::tile::{BootId, TileCells, TileDigest, TileKey};
use protocol::tile_store::{Applied, LayerGrid, RootDigest, StoreError, TileStore};
use protocol::wire::Header;

use super::ages::Ages;
use super::incoming::RequestId;
use super::layer_sync::{LayerSync, SILENCE};
use super::reject_reason::RejectReason;
use super::tile_intake::TileIntake;

/// Ages that are kept before those of tiles that are gone are dropped.
const MAX_AGES: usize = 200_000;

/// A question about a layer, for the link to ask.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum MapQuery {
    Digests(LayerId, DigestsRequest),
    Tiles(LayerId, TilesRequest),
}

/// How far a layer is behind the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerSyncState {
    /// Which layer.
    pub layer: LayerId,
    /// Whether the robot's last announcement and this map are the same, cell for cell.
    pub is_equal: bool,
    /// When they were the same last.
    pub last_equal: Option<Monotonic>,
    /// Tiles known to be lacking; more may be, where no list has been asked for yet.
    pub missing: usize,
}

/// A question that is not answered yet.
pub(super) struct PendingQuery {
    pub(super) layer: LayerId,
    /// Asked for; empty where a list was.
    pub(super) tiles: Vec<(i32, i32)>,
    pub(super) at: Monotonic,
}

/// The map and its reconciliation.
pub struct MapSync {
    pub(super) store: TileStore,
    intake: TileIntake,
    /// What the robot announced last, and when.
    pub(super) head: Option<(MapHead, Monotonic)>,
    /// No announcement has come from the robot yet, so the store's boot is nobody's.
    has_boot: bool,
    pub(super) layers: BTreeMap<LayerId, LayerSync>,
    /// Own roots, while no tile has changed them.
    pub(super) roots: BTreeMap<LayerId, RootDigest>,
    changed: BTreeSet<TileKey>,
    pub(super) ages: Ages,
    /// Tiles named by the lists that are arriving.
    listed: BTreeMap<LayerId, BTreeSet<(i32, i32)>>,
    pub(super) asked: BTreeMap<RequestId, PendingQuery>,
    /// The digest of a tile of which nothing is known.
    unknown: TileDigest,
    pub(super) wanted: BTreeSet<LayerId>,
    pub(super) focus_m: [f64; 2],
}

impl MapSync {
    /// An empty map that takes `tile_store_mb` megabytes at most.
    ///
    /// # Errors
    /// Where zstd cannot be set up.
    pub(super) fn new(tile_store_mb: u32) -> io::Result<Self> {
        Ok(Self {
            store: TileStore::new(BootId([0; 16]), tile_store_mb),
            intake: TileIntake::new()?,
            head: None,
            has_boot: false,
            layers: BTreeMap::new(),
            roots: BTreeMap::new(),
            changed: BTreeSet::new(),
            ages: Ages::default(),
            listed: BTreeMap::new(),
            asked: BTreeMap::new(),
            unknown: TileCells::unknown().digest(),
            wanted: LayerId::ALL.into_iter().collect(),
            focus_m: [0.0; 2],
        })
    }

    /// The tiles.
    pub const fn store(&self) -> &TileStore {
        &self.store
    }

    /// How old its tiles are.
    pub const fn ages(&self) -> &Ages {
        &self.ages
    }

    /// A message whose stamp is that of the robot's newest data came.
    pub(super) fn update_clock(&mut self, header: Header, now: Monotonic) {
        if self.has_boot && header.boot == self.store.boot() {
            self.ages
                .update_clock(header.seq, header.robot_time_ns, now);
        }
    }

    /// How far each layer that the robot announces and this console wants is behind.
    pub fn layer_states(&self) -> impl Iterator<Item = LayerSyncState> {
        self.layers
            .iter()
            .filter(|(layer, _)| self.wanted.contains(layer))
            .map(|(layer, sync)| LayerSyncState {
                layer: *layer,
                is_equal: !sync.is_different(),
                last_equal: sync.last_equal(),
                missing: sync.missing(),
            })
    }

    /// The run of the robot whose map this is, once it has announced itself.
    pub(super) fn boot(&self) -> Option<BootId> {
        self.has_boot.then(|| self.store.boot())
    }

    /// Whether every layer that is wanted equals the robot's last announcement.
    pub fn is_synchronized(&self) -> bool {
        self.head.is_some() && self.layer_states().all(|step| step.is_equal)
    }

    /// When the robot last announced what its map is.
    pub fn head_at(&self) -> Option<Monotonic> {
        self.head.as_ref().map(|(_, at)| *at)
    }

    /// The tiles that changed since the last call. All of them where the map was emptied.
    pub fn take_changed(&mut self) -> BTreeSet<TileKey> {
        std::mem::take(&mut self.changed)
    }

    pub(super) fn set_wanted(&mut self, wanted: BTreeSet<LayerId>, focus_m: [f64; 2]) {
        self.wanted = wanted;
        self.focus_m = focus_m;
        self.store.set_focus(focus_m);
    }

    /// Whether the robot announced a layer that it has not described to us.
    pub(super) fn lacks_info(&self) -> bool {
        let described = |layer| self.store.cell_m(layer).is_some();
        self.head
            .as_ref()
            .is_some_and(|(head, _)| !head.layers.iter().all(|head| described(head.layer)))
    }

    /// Whether what changes of a layer is asked for. What is known of one that is not stays as it was.
    pub fn is_wanted(&self, layer: LayerId) -> bool {
        self.wanted.contains(&layer)
    }

    /// The robot said what its layers are. What another run than the one whose map is held says is not taken.
    pub(super) fn take_info(&mut self, info: &Info, boot: BootId) -> Result<(), StoreError> {
        if self.has_boot && boot != self.store.boot() {
            // Its own announcement comes first; then it is asked again.
            return Ok(());
        }
        for layer in &info.layers {
            let held_m = self.store.cell_m(layer.layer);
            if held_m.is_some_and(|held_m| held_m.to_bits() != layer.cell_m.to_bits()) {
                self.empty_layer(layer.layer);
            }
            self.store.set_grid(LayerGrid {
                layer: layer.layer,
                cell_m: layer.cell_m,
            })?;
            self.roots.remove(&layer.layer);
        }
        Ok(())
    }

    /// The robot announced what its map is; true where it is a run that was not known.
    pub(super) fn take_head(
        &mut self,
        head: MapHead,
        boot: BootId,
        now: Monotonic,
    ) -> Result<bool, RejectReason> {
        let is_new = !self.has_boot || boot != self.store.boot();
        if is_new {
            let before: Vec<_> = LayerId::ALL
                .into_iter()
                .flat_map(|layer| self.store.tiles(layer))
                .map(|(key, _)| key)
                .collect();
            if !self.store.adopt_boot(boot) {
                return Err(RejectReason::OtherBoot);
            }
            self.changed.extend(before);
            self.has_boot = true;
            self.layers.clear();
            self.roots.clear();
            self.ages = Ages::default();
            self.forget_queries();
        }
        let was_silent = self.head_at().is_none_or(|at| now.since(at) > SILENCE);
        for layer in &head.layers {
            if layer.epoch > self.store.epoch(layer.layer) {
                self.erase_layer(layer.layer, layer.epoch);
            }
            let sync = self
                .layers
                .entry(layer.layer)
                .or_insert_with(LayerSync::new);
            if was_silent {
                sync.link_was_down();
            }
        }
        if was_silent {
            self.forget_queries();
        }
        self.head = Some((head, now));
        Ok(is_new)
    }

    /// What is of another run than the map cannot be put into it.
    fn of_this_boot(&self, boot: BootId) -> Result<(), RejectReason> {
        if !self.has_boot {
            Err(RejectReason::BeforeJoin)
        } else if boot != self.store.boot() {
            Err(RejectReason::OtherBoot)
        } else {
            Ok(())
        }
    }

    /// A tile, or half of one, came: pushed, or in answer to `request`.
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
        let revision = band.revision;
        let at = (key.tx, key.ty);
        if let (Some(sync), Some(request)) = (self.layers.get_mut(&key.layer), request) {
            sync.pulled(request);
        }
        let tile = self
            .intake
            .take(key, header, band)
            .map_err(|why| reject_reason(&why))?;
        let Some(tile) = tile else { return Ok(()) };
        if tile.epoch > self.store.epoch(key.layer) {
            self.erase_layer(key.layer, tile.epoch);
        }
        let stamp_ns = tile.stamp_ns;
        let applied = self
            .store
            .apply(tile)
            .map_err(|_why| RejectReason::BadTile)?;
        let sync = self.layers.entry(key.layer).or_insert_with(LayerSync::new);
        match request {
            Some(_) => sync.held(at, revision),
            None => sync.pushed(at, revision, now),
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

    /// A tile answered a question.
    pub(super) fn take_reply(
        &mut self,
        layer: LayerId,
        header: Header,
        reply: &TilesReply,
        request: RequestId,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let key = TileKey {
            layer,
            tx: reply.tx,
            ty: reply.ty,
        };
        self.take_band(key, header, &reply.band, Some(request), now)
    }

    /// No more replies to a question will come.
    pub(super) fn ended(&mut self, request: RequestId, now: Monotonic) {
        let Some(PendingQuery { layer, tiles, .. }) = self.asked.remove(&request) else {
            return;
        };
        if let Some(sync) = self.layers.get_mut(&layer) {
            sync.ended(request, &tiles, now);
        }
    }

    /// Follows the robot to another epoch of a layer.
    fn erase_layer(&mut self, layer: LayerId, epoch: u32) {
        let gone = self.store.tiles(layer).map(|(key, _)| key);
        self.changed.extend(gone);
        self.roots.remove(&layer);
        self.store.adopt_epoch(layer, epoch);
        self.ages.forget(layer);
        self.ages.restart();
        self.layers.insert(layer, LayerSync::new());
    }

    /// Drops what is held of a layer whose cells turn out to be of another size.
    fn empty_layer(&mut self, layer: LayerId) {
        let gone: Vec<_> = self.store.tiles(layer).map(|(key, _)| key).collect();
        for key in &gone {
            self.store.forget(*key);
        }
        self.changed.extend(gone);
        self.ages.forget(layer);
        self.layers.insert(layer, LayerSync::new());
    }

    /// What was asked over a link that is gone is not answered any more.
    fn forget_queries(&mut self) {
        self.asked.clear();
        self.listed.clear();
    }

    /// Halves of tiles that were given up.
    pub fn abandoned_halves(&self) -> u64 {
        self.intake.abandoned()
    }
}

fn reject_reason(why: &DecodeError) -> RejectReason {
    match why {
        DecodeError::Version(_) => RejectReason::OtherProtocol,
        DecodeError::Truncated(_)
        | DecodeError::TooLong(_)
        | DecodeError::Coding(_)
        | DecodeError::Rows { .. }
        | DecodeError::Zstd(_)
        | DecodeError::Length { .. }
        | DecodeError::Code(_)
        | DecodeError::DuplicateRow(_)
        | DecodeError::Incomplete(_) => RejectReason::BadTile,
    }
}
