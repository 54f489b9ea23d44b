//! Synchronization of one layer: what is missing and when to request it.
//!
//! The console compares the root digest that the robot announces with its own; it does not count messages. If they
//! differ for longer than tiles take to arrive, it requests a list of tiles and then the missing ones. A list of a large map takes
//! longer than what the operator sees of it, so a console that joins requests all tiles near the vehicle before, by their places.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::message::TILES_REPLY_BYTES;

use super::messages::RequestId;
use super::retry::Backoff;

/// Pushed tiles may be in flight for this long before a difference means a loss.
const GRACE_WHEN_QUIET: Duration = Duration::from_secs(2);
/// The same while pushes keep arriving.
const GRACE_WHILE_PUSHING: Duration = Duration::from_secs(5);
/// Without a map head or tile for this long the link was down and pushed tiles were lost.
pub(super) const SILENCE: Duration = Duration::from_secs(2);
const FIRST_BACK_OFF: Duration = Duration::from_millis(200);
const LONGEST_BACK_OFF: Duration = Duration::from_secs(2);
/// Lists in a row without a missing tile, before the confirmed revision is doubted.
const LISTS_BEFORE_DOUBT: u32 = 3;
/// Requests for tiles in a row without a reply, before a new list is requested.
const FAILURES_BEFORE_LIST: u32 = 3;
const DOUBT_PAUSE: Duration = Duration::from_secs(30);

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Query {
    /// A list of the tiles newer than this revision.
    Digests {
        newer_than: u64,
    },
    Tiles(Vec<(i32, i32)>),
    /// Overviews at these places.
    Overviews(Vec<(i32, i32)>),
}

/// A list of tiles, fetched page by page.
#[derive(Clone, Copy, Debug)]
struct Listing {
    /// The revision in the request of the first page.
    newer_than: u64,
    /// The revision for the request of the next page.
    from: u64,
    /// The open request for a page, and its revision.
    page: Option<(RequestId, u64)>,
    /// The robot's revision at the last page, once that has arrived.
    complete_at: Option<u64>,
}

impl Listing {
    fn awaits(&self, request: RequestId) -> bool {
        self.page.is_some_and(|(page, _)| page == request)
    }
}

#[derive(Clone, Copy, Debug)]
struct TileRequest {
    /// The last tile that has arrived.
    last: Option<(i32, i32)>,
    bytes: usize,
}

#[derive(Debug)]
pub(super) struct LayerSync {
    /// Every tile up to this revision is known to be held.
    confirmed: u64,
    differs_since: Option<Monotonic>,
    last_push: Option<Monotonic>,
    /// When the roots were last equal in this boot and epoch.
    pub(super) last_equal: Option<Monotonic>,
    /// Request without waiting for pushes.
    is_urgent: bool,
    /// Places for which tiles were requested although no list named them; `None` after the first list.
    unlisted: Option<BTreeSet<(i32, i32)>>,
    /// Missing tiles with the revision that they should have.
    pub(super) missing: BTreeMap<(i32, i32), u64>,
    listing: Option<Listing>,
    /// Open requests for tiles.
    tile_requests: BTreeMap<RequestId, TileRequest>,
    /// The revision of the last complete list, while tiles of it are missing.
    list_revision: Option<u64>,
    backoff: Backoff,
    /// Lists in a row without a missing tile although the roots differed.
    idle_lists: u32,
}

impl Default for LayerSync {
    fn default() -> Self {
        Self {
            confirmed: 0,
            differs_since: None,
            last_push: None,
            last_equal: None,
            is_urgent: true,
            unlisted: Some(BTreeSet::new()),
            missing: BTreeMap::new(),
            listing: None,
            tile_requests: BTreeMap::new(),
            list_revision: None,
            backoff: Backoff::new(FIRST_BACK_OFF, LONGEST_BACK_OFF),
            idle_lists: 0,
        }
    }
}

impl LayerSync {
    pub(super) fn on_equal_root(&mut self, head_revision: u64, now: Monotonic) {
        self.confirmed = head_revision;
        self.differs_since = None;
        self.last_equal = Some(now);
        self.is_urgent = false;
        self.unlisted = None;
        self.missing.clear();
        self.backoff.succeed();
        self.idle_lists = 0;
    }

    pub(super) fn on_other_root(&mut self, now: Monotonic) {
        self.differs_since.get_or_insert(now);
    }

    /// After a link failure: open requests get no reply, and pushed tiles were lost.
    pub(super) fn on_link_loss(&mut self) {
        self.is_urgent = true;
        self.listing = None;
        self.list_revision = None;
        self.tile_requests.clear();
        self.unlisted.as_mut().map(BTreeSet::clear);
        self.backoff = Backoff::new(FIRST_BACK_OFF, LONGEST_BACK_OFF);
    }

    pub(super) fn on_pushed_tile(&mut self, tile: (i32, i32), revision: u64, now: Monotonic) {
        self.last_push = Some(now);
        self.on_tile(tile, revision);
    }

    /// A push holds differences to a revision that is not here.
    pub(super) fn on_missing(&mut self, tile: (i32, i32), revision: u64) {
        let wanted = self.missing.entry(tile).or_default();
        *wanted = revision.max(*wanted);
    }

    pub(super) fn on_tile(&mut self, tile: (i32, i32), revision: u64) {
        let wanted = self.missing.get(&tile);
        if wanted.is_some_and(|wanted| revision >= *wanted) {
            self.missing.remove(&tile);
            if self.missing.is_empty()
                && self.listing.is_none()
                && let Some(list_revision) = self.list_revision.take()
            {
                self.confirmed = list_revision;
            }
        }
    }

    /// A reply with a band of `bytes`.
    pub(super) fn on_tile_reply(&mut self, request: RequestId, tile: (i32, i32), bytes: usize) {
        if let Some(open) = self.tile_requests.get_mut(&request) {
            open.last = Some(tile);
            open.bytes += bytes;
        }
    }

    /// The first revision of the list that `request` is for.
    pub(super) fn list_start(&self, request: RequestId) -> Option<u64> {
        let listing = self.listing.filter(|listing| listing.awaits(request));
        listing.map(|listing| listing.newer_than)
    }

    /// Takes a page of a list with its missing tiles. `next` is the revision for the request of the next page.
    pub(super) fn on_list_page(
        &mut self,
        request: RequestId,
        lacking: impl IntoIterator<Item = ((i32, i32), u64)>,
        head_revision: u64,
        next: Option<u64>,
    ) {
        if let Some(listing) = &mut self.listing
            && listing.awaits(request)
        {
            match next {
                Some(from) => listing.from = listing.from.max(from),
                None => listing.complete_at = Some(head_revision),
            }
            self.missing.extend(lacking);
        }
    }

    pub(super) fn ended(&mut self, request: RequestId, tiles: &[(i32, i32)], now: Monotonic) {
        if let Some(mut listing) = self.listing
            && let Some((_, requested_from)) = listing.page.take_if(|(page, _)| *page == request)
        {
            self.listing = Some(listing);
            if let Some(head_revision) = listing.complete_at {
                self.listing = None;
                self.list_is_complete(listing.newer_than, head_revision, now);
            } else if listing.from == requested_from {
                self.backoff.fail(now);
            } else {
                self.backoff.succeed();
            }
        }
        let Some(open) = self.tile_requests.remove(&request) else {
            return;
        };
        match (open.last, &mut self.unlisted) {
            (Some(last), asked) => {
                self.backoff.succeed();
                self.backoff.not_before = now;
                if let Some(asked) = asked
                    && open.bytes >= TILES_REPLY_BYTES
                {
                    // What follows did not fit.
                    let fitting = tiles.iter().position(|tile| *tile == last);
                    let rest = &tiles[fitting.map_or(0, |last| last + 1)..];
                    asked.retain(|tile| !rest.contains(tile));
                }
            }
            // There may be no such tiles.
            (None, Some(_)) => {}
            (None, None) => {
                self.backoff.fail(now);
                if self.backoff.failures >= FAILURES_BEFORE_LIST {
                    // The robot may have removed them since the list. Only a new list shows that.
                    for tile in tiles {
                        self.missing.remove(tile);
                    }
                    self.list_revision = None;
                    self.is_urgent = true;
                }
            }
        }
    }

    fn list_is_complete(&mut self, newer_than: u64, head_revision: u64, now: Monotonic) {
        self.backoff.succeed();
        self.is_urgent = false;
        self.unlisted = None;
        self.differs_since = self.differs_since.map(|_| now);
        if !self.missing.is_empty() {
            self.idle_lists = 0;
            self.list_revision = Some(head_revision);
            return;
        }
        // All listed tiles are held: most likely the roots differed only because the map changes.
        self.idle_lists += 1;
        if self.idle_lists < LISTS_BEFORE_DOUBT {
            self.confirmed = head_revision;
        } else if newer_than > 0 {
            self.confirmed = 0;
            self.list_revision = None;
            self.is_urgent = true;
        } else {
            // Not even the list of all tiles explains the difference.
            self.backoff.not_before = now + DOUBT_PAUSE;
        }
    }

    pub(super) const fn is_listed(&self) -> bool {
        self.unlisted.is_none()
    }

    /// Whether the maps differ and no list says which tiles there are.
    pub(super) const fn is_joining(&self) -> bool {
        self.unlisted.is_some() && self.differs_since.is_some()
    }

    /// Whether a tile is to be requested although no list names it yet.
    pub(super) fn is_unlisted(&self, tile: (i32, i32)) -> bool {
        let asked = self
            .unlisted
            .as_ref()
            .filter(|_| self.differs_since.is_some());
        asked.is_some_and(|asked| !asked.contains(&tile))
    }

    /// The next request, if any. `order` sorts the missing tiles; `room` limits the open requests for tiles.
    pub(super) fn query(
        &self,
        now: Monotonic,
        room: usize,
        limit: usize,
        order: impl Fn((i32, i32)) -> f64,
        is_requested: impl Fn((i32, i32)) -> bool,
    ) -> Option<Query> {
        self.differs_since?;
        if !self.backoff.is_due(now) {
            return None;
        }
        if let Some(listing) = self.listing.filter(|listing| listing.page.is_none()) {
            let newer_than = listing.from;
            return Some(Query::Digests { newer_than });
        }
        if !self.missing.is_empty() && room > 0 {
            let tiles = self.missing.keys().copied();
            let mut tiles: Vec<_> = tiles.filter(|tile| !is_requested(*tile)).collect();
            tiles.sort_by(|a, b| order(*a).total_cmp(&order(*b)).then(a.cmp(b)));
            tiles.truncate(limit);
            return (!tiles.is_empty()).then_some(Query::Tiles(tiles));
        }
        let is_idle =
            self.missing.is_empty() && self.tile_requests.is_empty() && self.listing.is_none();
        let is_due = is_idle && (self.is_urgent || self.is_overdue(now));
        is_due.then_some(Query::Digests {
            newer_than: self.confirmed,
        })
    }

    fn is_overdue(&self, now: Monotonic) -> bool {
        let pushes_pause = |at| now.since(at) >= GRACE_WHEN_QUIET / 2;
        let pushes_pause = self.last_push.is_none_or(pushes_pause);
        let grace = if pushes_pause {
            GRACE_WHEN_QUIET
        } else {
            GRACE_WHILE_PUSHING
        };
        let differs_long = |since| now.since(since) >= grace;
        self.differs_since.is_some_and(differs_long)
    }

    pub(super) fn on_request(&mut self, request: RequestId, query: &Query) {
        match query {
            Query::Digests { newer_than } => {
                let listing = self.listing.get_or_insert(Listing {
                    newer_than: *newer_than,
                    from: *newer_than,
                    page: None,
                    complete_at: None,
                });
                listing.page = Some((request, *newer_than));
            }
            Query::Tiles(tiles) => {
                let open = TileRequest {
                    last: None,
                    bytes: 0,
                };
                self.tile_requests.insert(request, open);
                self.unlisted
                    .iter_mut()
                    .for_each(|asked| asked.extend(tiles));
            }
            Query::Overviews(_) => {}
        }
    }

    pub(super) const fn is_different(&self) -> bool {
        self.differs_since.is_some() || self.last_equal.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::at;

    fn query(sync: &LayerSync, room: usize, ms: u64) -> Option<Query> {
        sync.query(at(ms), room, 9, |_| 0.0, |_| false)
    }

    #[test]
    fn what_did_not_fit_a_reply_is_requested_again_and_no_other_place() {
        let mut joiner = LayerSync::default();
        let tiles = [(0, 0), (1, 0), (2, 0), (3, 0)];
        let waiting = |joiner: &LayerSync| tiles.map(|tile| joiner.is_unlisted(tile));
        assert_eq!(waiting(&joiner), [false; 4], "nothing is mapped");
        joiner.on_other_root(at(0));
        assert_eq!(waiting(&joiner), [true; 4]);
        for (request, bytes, waits) in [
            // There is no tile before the one that arrived.
            (1, TILES_REPLY_BYTES, [false, false, true, true]),
            (2, TILES_REPLY_BYTES - 1, [false; 4]),
        ] {
            let request = RequestId(request);
            joiner.on_request(request, &Query::Tiles(tiles.to_vec()));
            assert_eq!(waiting(&joiner), [false; 4]);
            joiner.on_tile_reply(request, (1, 0), bytes);
            joiner.ended(request, &tiles, at(1));
            assert_eq!(waiting(&joiner), waits);
        }
        let list = |newer_than| Some(Query::Digests { newer_than });
        assert_eq!(query(&joiner, 2, 1), list(0));

        let mut follower = LayerSync::default();
        follower.on_equal_root(5, at(0));
        follower.on_other_root(at(1_000));
        assert_eq!(waiting(&follower), [false; 4]);
        assert_eq!(query(&follower, 2, 2_999), None);
        assert_eq!(query(&follower, 2, 3_000), list(5));
    }
}
