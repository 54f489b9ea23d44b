//! Pushes the last sweeps of sensors to consoles that want to see them, after everything else.

use std::time::Duration;

use protocol::keys::Topic;

use super::open_sessions::Context;
use super::outgoing::Outgoing;
use super::streams::{cell_m, put_bulk};
use crate::streaming::replies::with_store;
use crate::streaming::token_bucket::TokenBucket;
use measurement::time::Monotonic;

/// Sweeps are not pushed more often.
const SCAN_PERIOD: Duration = Duration::from_millis(200);
/// Sweeps get this part of the tiles' share of the link at most: they are for people to see, and make no map.
const SCAN_SHARE: f64 = 1.0 / 16.0;
/// A tile that waits and is so near to the vehicle goes before any sweep, metres.
const SCAN_WAITS_FOR_M: f64 = 15.0;
/// When sweeps may be pushed.
pub(super) struct ScanPush {
    token_bucket: TokenBucket,
    next: Monotonic,
}

impl ScanPush {
    pub(super) fn new(budget_kbps: u32, now: Monotonic) -> Self {
        Self {
            token_bucket: TokenBucket::new(SCAN_SHARE * f64::from(budget_kbps), now),
            next: now,
        }
    }

    pub(super) fn set_budget(&mut self, budget_kbps: u32) {
        self.token_bucket
            .set_rate(SCAN_SHARE * f64::from(budget_kbps));
    }

    /// Sends the last sweeps if it is time and the map around the vehicle does not wait; how many bytes that were.
    pub(super) fn send(&mut self, context: &Context, out: &Outgoing, now: Monotonic) -> usize {
        if now < self.next || !self.token_bucket.allows(now) || is_map_waiting(context) {
            return 0;
        }
        self.next = now + SCAN_PERIOD;
        let scans = context.publish_state.take_scans().into_iter();
        let messages = scans.filter_map(|(stamp, scan)| out.message(stamp.as_nanos(), &scan));
        let bytes = messages
            .map(|message| put_bulk(context, Topic::Scan, message))
            .sum();
        self.token_bucket.spend(bytes);
        bytes
    }
}

/// Whether a tile near the vehicle waits, or nobody knows where the vehicle is.
fn is_map_waiting(context: &Context) -> bool {
    let Some(position_m) = context.publish_state.position_m() else {
        return true;
    };
    let tile_queue = context.publish_state.tile_queue();
    if tile_queue.is_empty() {
        return false;
    }
    let cells = with_store(&context.store, |store| store.grids().collect::<Vec<_>>());
    tile_queue.has_within(SCAN_WAITS_FOR_M, position_m, |key| cell_m(&cells, key))
}
