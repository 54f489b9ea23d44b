//! What a console lacks of one layer, and when it asks for it. Pure: the present is a parameter.
//!
//! A console does not count messages: it compares the root digest that the robot announces with its own. Only
//! where they differ for longer than tiles take to arrive does it ask which tiles there are, and then for
//! those it lacks.

use std::collections::BTreeMap;
use std::time::Duration;

use measurement::time::Monotonic;

use super::incoming::RequestId;

/// Pushed tiles may be on their way this long before a difference means that something was lost.
const PUSH_GRACE: Duration = Duration::from_secs(2);
/// Unless pushes keep coming: then as long as this.
const PUSHES_GRACE: Duration = Duration::from_secs(5);
/// Without an announcement for this long the link was down, and what was pushed meanwhile is gone.
pub(super) const SILENCE: Duration = Duration::from_secs(2);
const FIRST_BACK_OFF: Duration = Duration::from_millis(200);
const LONGEST_BACK_OFF: Duration = Duration::from_secs(2);
/// Lists with nothing to ask for, one after another, before all that was confirmed is doubted.
const LISTS_BEFORE_DOUBT: u32 = 3;
/// Questions for tiles in a row that bring nothing, before a list is asked for again.
const FAILURES_BEFORE_LIST: u32 = 3;
/// Between two lists of everything.
const DOUBT_PAUSE: Duration = Duration::from_secs(30);

/// What is asked of the robot about a layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Query {
    /// Which tiles are newer than this revision.
    Digests { newer_than: u64 },
    /// These tiles.
    Tiles(Vec<(i32, i32)>),
}

/// A list of tiles that is being fetched, page by page.
#[derive(Clone, Copy, Debug)]
struct Listing {
    /// What the first page was asked with.
    newer_than: u64,
    /// What the next page is asked with.
    from: u64,
    /// The question for a page that is under way, and what it was asked with.
    page: Option<(RequestId, u64)>,
    /// The head at which the last page was made, once it has come.
    complete_at: Option<u64>,
}

impl Listing {
    fn asks(&self, request: RequestId) -> bool {
        self.page.is_some_and(|(page, _)| page == request)
    }
}

/// The state of one layer.
#[derive(Debug)]
pub(super) struct LayerSync {
    /// Up to this revision every tile is known to be held.
    confirmed: u64,
    /// Whether the roots have been equal in this boot and epoch.
    was_synchronized: bool,
    /// Since when they differ.
    differs_since: Option<Monotonic>,
    last_push: Option<Monotonic>,
    last_equal: Option<Monotonic>,
    /// Ask without waiting for pushes.
    is_urgent: bool,
    /// The revision that each tile that is lacking should have.
    missing: BTreeMap<(i32, i32), u64>,
    listing: Option<Listing>,
    /// Tiles that were asked for, and whether any has come.
    pulls: BTreeMap<RequestId, bool>,
    /// The head of the last whole list, of which tiles are still lacking.
    listed_to: Option<u64>,
    failures: u32,
    /// Lists in a row that had nothing to ask for although the roots differed.
    idle_lists: u32,
    not_before: Monotonic,
}

impl LayerSync {
    pub(super) fn new() -> Self {
        Self {
            confirmed: 0,
            was_synchronized: false,
            differs_since: None,
            last_push: None,
            last_equal: None,
            is_urgent: true,
            missing: BTreeMap::new(),
            listing: None,
            pulls: BTreeMap::new(),
            listed_to: None,
            failures: 0,
            idle_lists: 0,
            not_before: Monotonic::default(),
        }
    }

    /// The roots are equal at a head of this revision.
    pub(super) fn equal(&mut self, head_revision: u64, now: Monotonic) {
        self.confirmed = head_revision;
        self.was_synchronized = true;
        self.differs_since = None;
        self.last_equal = Some(now);
        self.is_urgent = false;
        self.missing.clear();
        self.failures = 0;
        self.idle_lists = 0;
    }

    /// The roots differ.
    pub(super) fn differs(&mut self, now: Monotonic) {
        self.differs_since.get_or_insert(now);
    }

    /// The link was down: nothing that was asked will be answered, nothing that was pushed arrived.
    pub(super) fn link_was_down(&mut self) {
        self.is_urgent = true;
        self.listing = None;
        self.listed_to = None;
        self.pulls.clear();
        self.failures = 0;
        self.not_before = Monotonic::default();
    }

    /// A tile was pushed.
    pub(super) fn pushed(&mut self, tile: (i32, i32), revision: u64, now: Monotonic) {
        self.last_push = Some(now);
        self.held(tile, revision);
    }

    /// A tile of this revision is held now.
    pub(super) fn held(&mut self, tile: (i32, i32), revision: u64) {
        if self
            .missing
            .get(&tile)
            .is_some_and(|wanted| revision >= *wanted)
        {
            self.missing.remove(&tile);
            if self.missing.is_empty()
                && self.listing.is_none()
                && let Some(listed_to) = self.listed_to.take()
            {
                self.confirmed = listed_to;
            }
        }
    }

    /// A tile answered a question.
    pub(super) fn pulled(&mut self, request: RequestId) {
        if let Some(any) = self.pulls.get_mut(&request) {
            *any = true;
        }
    }

    /// What the first page was asked with of the list that `request` asks a page of.
    pub(super) fn listed_from(&self, request: RequestId) -> Option<u64> {
        let listing = self.listing.filter(|listing| listing.asks(request));
        listing.map(|listing| listing.newer_than)
    }

    /// A page of a list came, of which these are lacking. `next` is what the next page is to be asked with, if
    /// there is one.
    pub(super) fn listed(
        &mut self,
        request: RequestId,
        lacking: impl IntoIterator<Item = ((i32, i32), u64)>,
        head_revision: u64,
        next: Option<u64>,
    ) {
        if let Some(listing) = &mut self.listing
            && listing.asks(request)
        {
            match next {
                Some(from) => listing.from = listing.from.max(from),
                None => listing.complete_at = Some(head_revision),
            }
            self.missing.extend(lacking);
        }
    }

    /// No more answers to `request`.
    pub(super) fn ended(&mut self, request: RequestId, tiles: &[(i32, i32)], now: Monotonic) {
        if let Some(mut listing) = self.listing
            && let Some((_, asked)) = listing.page.take_if(|(page, _)| *page == request)
        {
            self.listing = Some(listing);
            if let Some(head_revision) = listing.complete_at {
                self.listing = None;
                self.list_is_complete(listing.newer_than, head_revision, now);
            } else if listing.from == asked {
                self.back_off(now);
            } else {
                self.failures = 0;
            }
        }
        match self.pulls.remove(&request) {
            Some(true) => {
                self.failures = 0;
                self.not_before = now;
            }
            Some(false) => {
                self.back_off(now);
                if self.failures >= FAILURES_BEFORE_LIST {
                    // Not lost but gone from the robot since it listed them? Only another list can tell.
                    for tile in tiles {
                        self.missing.remove(tile);
                    }
                    self.listed_to = None;
                    self.is_urgent = true;
                }
            }
            None => {}
        }
    }

    fn list_is_complete(&mut self, newer_than: u64, head_revision: u64, now: Monotonic) {
        self.failures = 0;
        self.is_urgent = false;
        if !self.missing.is_empty() {
            self.idle_lists = 0;
            self.listed_to = Some(head_revision);
            self.differs_since = self.differs_since.map(|_| now);
            return;
        }
        // All that the list names is held: most likely the roots differed only because the map goes on.
        self.differs_since = self.differs_since.map(|_| now);
        self.idle_lists += 1;
        if self.idle_lists < LISTS_BEFORE_DOUBT {
            self.confirmed = head_revision;
        } else if newer_than > 0 {
            self.confirmed = 0;
            self.listed_to = None;
            self.is_urgent = true;
        } else {
            // Not even the list of everything explains it.
            self.not_before = now + DOUBT_PAUSE;
        }
    }

    fn back_off(&mut self, now: Monotonic) {
        let pause = FIRST_BACK_OFF.saturating_mul(1 << self.failures.min(8));
        self.failures = self.failures.saturating_add(1);
        self.not_before = now + pause.min(LONGEST_BACK_OFF);
    }

    /// What to ask now, if anything; `order` sorts the tiles that are lacking, `room` says how many
    /// questions for tiles may still be asked.
    pub(super) fn query(
        &self,
        now: Monotonic,
        room: usize,
        limit: usize,
        order: impl Fn((i32, i32)) -> f64,
        is_asked: impl Fn((i32, i32)) -> bool,
    ) -> Option<Query> {
        self.differs_since?;
        if now < self.not_before {
            return None;
        }
        if let Some(Listing {
            from, page: None, ..
        }) = self.listing
        {
            return Some(Query::Digests { newer_than: from });
        }
        if !self.missing.is_empty() && room > 0 {
            let tiles = self.missing.keys().copied();
            let mut tiles: Vec<_> = tiles.filter(|tile| !is_asked(*tile)).collect();
            tiles.sort_by(|a, b| order(*a).total_cmp(&order(*b)).then(a.cmp(b)));
            tiles.truncate(limit);
            return (!tiles.is_empty()).then_some(Query::Tiles(tiles));
        }
        let is_idle = self.missing.is_empty() && self.pulls.is_empty() && self.listing.is_none();
        let is_due = is_idle && (self.is_urgent || self.is_overdue(now));
        is_due.then_some(Query::Digests {
            newer_than: self.confirmed,
        })
    }

    fn is_overdue(&self, now: Monotonic) -> bool {
        let Some(since) = self.differs_since else {
            return false;
        };
        let differs_for = now.since(since);
        let pushes_pause = self
            .last_push
            .is_none_or(|at| now.since(at) >= PUSH_GRACE / 2);
        differs_for >= PUSHES_GRACE || (differs_for >= PUSH_GRACE && pushes_pause)
    }

    /// A question was asked.
    pub(super) fn asked(&mut self, request: RequestId, query: &Query) {
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
            Query::Tiles(_) => {
                self.pulls.insert(request, false);
            }
        }
    }

    /// Tiles known to be lacking.
    pub(super) fn missing(&self) -> usize {
        self.missing.len()
    }

    /// When the roots were last equal; `None` if never in this boot and epoch.
    pub(super) fn last_equal(&self) -> Option<Monotonic> {
        self.last_equal.filter(|_| self.was_synchronized)
    }

    /// Whether the roots differ now, or are not known.
    pub(super) const fn is_different(&self) -> bool {
        self.differs_since.is_some() || !self.was_synchronized
    }
}
