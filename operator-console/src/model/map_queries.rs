//! What to ask about the map now.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::layer::LayerId;
use protocol::message::{DigestsRequest, LayerHead, TilesRequest};
use protocol::tile::TileKey;

use super::incoming::RequestId;
use super::layer_sync::Query;
use super::map_sync::{MapQuery, MapSync, PendingQuery};

/// Questions for tiles that may be open at once; with the size of an answer, 32 KiB are outstanding at most.
const MAX_PULLS: usize = 2;
/// Tiles in one question. What does not fit the answer is asked for again.
const TILES_PER_PULL: usize = 24;
/// An answer that takes longer than this, and so than the link waits for it, does not come any more.
const ANSWER_LIFETIME: Duration = Duration::from_secs(12);

impl MapSync {
    /// Compares roots and says what to ask now.
    pub(super) fn queries(
        &mut self,
        now: Monotonic,
        mut number: impl FnMut() -> RequestId,
    ) -> Vec<(RequestId, MapQuery)> {
        let Some((head, _)) = self.head.clone() else {
            return Vec::new();
        };
        // The end of a question can be lost like anything else.
        let asked = self.asked.iter();
        let late = asked.filter(|(_, asked)| now.since(asked.at) >= ANSWER_LIFETIME);
        for request in late.map(|(request, _)| *request).collect::<Vec<_>>() {
            self.ended(request, now);
        }
        let mut queries = Vec::new();
        let heads = head.layers;
        for head in &heads {
            if !self.wanted.contains(&head.layer) {
                continue;
            }
            self.compare(head, now);
            while let Some(query) = self.next_query(head.layer, now) {
                let request = number();
                if let Some(sync) = self.layers.get_mut(&head.layer) {
                    sync.asked(request, &query);
                }
                let (tiles, query) = match query {
                    Query::Digests { newer_than } => (
                        Vec::new(),
                        MapQuery::Digests(head.layer, DigestsRequest { newer_than }),
                    ),
                    Query::Tiles(tiles) => (
                        tiles.clone(),
                        MapQuery::Tiles(head.layer, TilesRequest::ByKey(tiles)),
                    ),
                };
                let (layer, at) = (head.layer, now);
                self.asked
                    .insert(request, PendingQuery { layer, tiles, at });
                queries.push((request, query));
            }
        }
        queries
    }

    fn next_query(&self, layer: LayerId, now: Monotonic) -> Option<Query> {
        let cell_m = self.store.cell_m(layer)?;
        let asked = self.asked.values();
        let pulls = asked.filter(|asked| !asked.tiles.is_empty()).count();
        let distance = |(tx, ty)| {
            let [x, y] = TileKey { layer, tx, ty }.center_m(cell_m);
            let (dx, dy) = (x - self.focus_m[0], y - self.focus_m[1]);
            dx * dx + dy * dy
        };
        let is_asked = |tile| {
            let mut asked = self.asked.values();
            asked.any(|asked| asked.layer == layer && asked.tiles.contains(&tile))
        };
        self.layers.get(&layer)?.query(
            now,
            MAX_PULLS.saturating_sub(pulls),
            TILES_PER_PULL,
            distance,
            is_asked,
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
            sync.equal(head.head_revision, now);
        } else if own.is_some() {
            sync.differs(now);
        }
    }
}
