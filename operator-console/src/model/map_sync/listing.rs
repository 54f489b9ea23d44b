//! What the robot lists of its tiles, and what that says of those that are held.

use super::super::incoming::RequestId;
use super::super::reject_reason::RejectReason;
use super::MapSync;
use protocol::layer::LayerId;
use protocol::message::Digests;
use protocol::tile::{BootId, TileKey};
use std::collections::BTreeSet;

impl MapSync {
    /// A part of a list of tiles answered a question.
    pub(in crate::model) fn take_digests(
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
        let Some(newer_than) = sync.listed_from(request) else {
            return Ok(());
        };
        let (store, unknown) = (&self.store, self.unknown);
        let lacking = digests.tiles.iter().filter_map(|tile| {
            let key = TileKey {
                layer,
                tx: tile.tx,
                ty: tile.ty,
            };
            let is_lacking = match store.get(key) {
                None => tile.digest != unknown,
                Some(held) if held.is_evicted() => tile.revision > held.revision(),
                Some(held) => tile.revision >= held.revision() && tile.digest != held.digest(),
            };
            is_lacking.then_some(((tile.tx, tile.ty), tile.revision))
        });
        let last = digests.tiles.last().map(|tile| tile.revision);
        let next = last.filter(|_| digests.more > 0);
        sync.listed(request, lacking, digests.head_revision, next);
        let listed = self.listed.entry(layer).or_default();
        listed.extend(digests.tiles.iter().map(|tile| (tile.tx, tile.ty)));
        if next.is_none() {
            let listed = std::mem::take(listed);
            if newer_than == 0 {
                self.forget_unlisted(layer, &listed, digests.head_revision);
            }
        }
        Ok(())
    }

    /// What a list of everything does not name, the robot does not hold.
    pub(super) fn forget_unlisted(
        &mut self,
        layer: LayerId,
        listed: &BTreeSet<(i32, i32)>,
        head_revision: u64,
    ) {
        let gone: Vec<_> = self
            .store
            .tiles(layer)
            .filter(|(key, held)| {
                held.revision() <= head_revision && !listed.contains(&(key.tx, key.ty))
            })
            .map(|(key, _)| key)
            .collect();
        for key in gone {
            self.store.forget(key);
            self.roots.remove(&layer);
            self.ages.remove(key);
            self.changed.insert(key);
        }
    }
}
