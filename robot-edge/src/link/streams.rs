//! What the robot sends by itself: state at fixed rates, tiles as they change.

use std::time::Duration;

use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{AgeToken, MapHead, View};
use protocol::tile::TileKey;
use protocol::tile::codec::Encoder;
use protocol::tile_store::LayerGrid;
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};

use super::LinkError;
use super::open_sessions::Context;
use super::outgoing::Outgoing;
use super::scan_push::ScanPush;
use crate::clock;
use crate::driving::SharedDriveState;
use crate::events::event;
use crate::streaming::bandwidth_limiter::BandwidthLimiter;
use crate::streaming::replies::{self, with_store};
use measurement::time::Monotonic;

const POSE_PERIOD: Duration = Duration::from_millis(50);
/// While somebody drives, or is about to: with each pose goes a token, and a command is as old as its token.
const DRIVEN_POSE_PERIOD: Duration = Duration::from_millis(20);
const STATUS_PERIOD: Duration = Duration::from_millis(500);
const HEAD_PERIOD: Duration = Duration::from_secs(1);
/// Heads that are news wait for this long at most.
const CHANGED_HEAD_PERIOD: Duration = Duration::from_millis(200);
const TILES_PERIOD: Duration = Duration::from_millis(20);
/// Shores are not pushed more often.
const SHORES_PERIOD: Duration = Duration::from_secs(1);
/// Tiles taken from the outbox at once: the vehicle moves on, and so does what is nearest.
const TILES_AT_ONCE: usize = 8;

/// Publishers of the topics that are sent again and again: their keys cross the network once.
pub(super) struct TopicPublishers {
    pose: Publisher<'static>,
    status: Publisher<'static>,
    event: Publisher<'static>,
    map_head: Publisher<'static>,
}

impl TopicPublishers {
    pub(super) fn declare(context: &Context) -> Result<Self, LinkError> {
        let declare = |topic: Topic, reliability| {
            let key = topic.key(&context.robot);
            context
                .control
                .declare_publisher(key.clone())
                // A console that cannot follow gets the next one.
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::RealTime)
                .express(true)
                .reliability(reliability)
                .wait()
                .map_err(|why| LinkError::Declare { what: key, why })
        };
        Ok(Self {
            // The next one follows: over QUIC it goes as a datagram, and waits for nothing that was lost before it.
            pose: declare(Topic::Pose, Reliability::BestEffort)?,
            status: declare(Topic::Status, Reliability::Reliable)?,
            event: declare(Topic::Event, Reliability::Reliable)?,
            map_head: declare(Topic::MapHead, Reliability::Reliable)?,
        })
    }
}

/// Sends pose, status, events and map heads until the link closes.
pub(super) fn send_state(context: &Context, out: &Outgoing, publishers: &TopicPublishers) {
    let start = clock::now();
    let mut next = start;
    let [mut status_due, mut head_due, mut changed_head_due] = [Due(start); 3];
    let mut announced: Option<MapHead> = None;
    let mut sent_teleop_state = None;
    loop {
        let drive_state = context.drive_state.as_deref();
        let period = if drive_state.is_some_and(SharedDriveState::is_held) {
            DRIVEN_POSE_PERIOD
        } else {
            POSE_PERIOD
        };
        // What a suspended machine missed is not made up for.
        next = (next + period).max(clock::now());
        let is_open = clock::sleep_until(next, || context.is_closing());
        // Somebody new should know at once, and the last word is a head behind a status that says so. It is said also
        // where the link closes at once: an end would be taken for a link that is lost.
        let is_requested = context.publish_state.take_status_request();
        if !is_open && !is_requested {
            return;
        }
        let now = clock::now();
        let mut stamp_ns = 0;
        if let Some((stamp, mut pose)) = context.publish_state.pose() {
            stamp_ns = stamp.as_nanos();
            pose.token = drive_state
                .and_then(SharedDriveState::token)
                .map(|token| AgeToken {
                    n: token.n,
                    nonce: token.nonce,
                });
            put(&publishers.pose, out.message(stamp_ns, &pose));
        }
        for (kind, message) in drive_state
            .map(SharedDriveState::take_events)
            .unwrap_or_default()
        {
            context.publish_state.publish_event(event(kind, message));
        }
        for event in context.publish_state.take_events() {
            put(&publishers.event, out.message(stamp_ns, &event));
        }
        let teleop = drive_state.and_then(SharedDriveState::status);
        let state = teleop
            .as_ref()
            .map(|teleop| (teleop.state, teleop.lease.clone(), teleop.estop));
        let is_changed = sent_teleop_state != state;
        if status_due.is_due(now, STATUS_PERIOD, is_requested || is_changed) {
            let mut status = context.publish_state.status(now);
            status.teleop = teleop;
            put(&publishers.status, out.message(stamp_ns, &status));
            sent_teleop_state = state;
        }
        // A head that is announced while tiles wait is one that nobody can have reached.
        let is_changed_head = changed_head_due.is_due(now, CHANGED_HEAD_PERIOD, false)
            && context.publish_state.tile_queue().is_empty()
            && context.publish_state.take_map_changed();
        let is_head_due = head_due.is_due(now, HEAD_PERIOD, is_requested);
        if is_head_due || is_changed_head {
            let head = replies::head(&context.store);
            if is_head_due || announced.as_ref() != Some(&head) {
                put(&publishers.map_head, out.message(stamp_ns, &head));
            }
            announced = Some(head);
        }
        if !is_open {
            return;
        }
    }
}

/// When something is sent again.
#[derive(Clone, Copy)]
struct Due(Monotonic);

impl Due {
    /// Whether it is, by the time or because it is `wanted`, and then not again for a `period`.
    fn is_due(&mut self, now: Monotonic, period: Duration, wanted: bool) -> bool {
        let is_due = wanted || now >= self.0;
        if is_due {
            self.0 = now + period;
        }
        is_due
    }
}

fn put(publisher: &Publisher<'static>, message: Option<Vec<u8>>) {
    let Some(message) = message else { return };
    if let Err(why) = publisher.put(message).wait() {
        tracing::debug!(%why, key = %publisher.key_expr(), "not sent");
    }
}

/// Sends changed tiles, nearest first, and shores that changed, inside the budget, until the link closes.
pub(super) fn send_tiles(context: &Context, out: &Outgoing, mut encoder: Encoder) {
    let mut next = clock::now();
    let mut bandwidth_limiter = BandwidthLimiter::new(context.budget_kbps, next);
    let mut shores = ShoresPush::new(next);
    let mut scans = ScanPush::new(context.budget_kbps, next);
    loop {
        next = (next + TILES_PERIOD).max(clock::now());
        if !clock::sleep_until(next, || context.is_closing()) {
            return;
        }
        let now = clock::now();
        if let Some(drive_state) = &context.drive_state {
            bandwidth_limiter.set_budget(drive_state.budget_kbps());
            scans.set_budget(drive_state.budget_kbps());
        }
        let views = context.publish_state.views(now);
        let wanted = views.iter().fold(0, |wanted, view| wanted | view.layers);
        // Nothing is encoded that nobody looks at; whoever turns to it asks.
        context
            .publish_state
            .tile_queue()
            .keep_layers(|layer| wanted & bit(layer) != 0);
        let newest_held = views.iter().map(|view| view.revision).max();
        bandwidth_limiter.acknowledged(newest_held.unwrap_or(u64::MAX), now);
        let near: Vec<_> = context
            .publish_state
            .position_m()
            .into_iter()
            .chain(views.iter().map(center_m))
            .collect();
        // Before the tiles, of which there may always be more.
        if !views.is_empty() && bandwidth_limiter.allows(now) {
            bandwidth_limiter.spent(shores.send(context, out, now));
        }
        let wants_scan = views.iter().any(|view| view.wants_scan);
        context.publish_state.want_scan(wants_scan);
        if wants_scan && bandwidth_limiter.allows(now) {
            bandwidth_limiter.spent(scans.send(context, out, now));
        }
        let mut has_sent = false;
        while bandwidth_limiter.allows(clock::now()) {
            let keys = next_tiles(context, &near);
            if keys.is_empty() {
                break;
            }
            has_sent = true;
            for key in keys {
                for (stamp_ns, band) in replies::bands(&context.store, &mut encoder, key) {
                    let message = out.message(stamp_ns, &band);
                    let bytes = message.map_or(0, |message| send_band(context, key, message));
                    bandwidth_limiter.pushed(band.revision, bytes, clock::now());
                }
            }
        }
        if has_sent {
            context.publish_state.mark_map_changed();
        }
    }
}

/// What was pushed of the shores.
struct ShoresPush {
    revision: u64,
    next: Monotonic,
}

impl ShoresPush {
    const fn new(now: Monotonic) -> Self {
        Self {
            revision: 0,
            next: now,
        }
    }

    /// Sends the shores if they are news and it is time; how many bytes that were.
    fn send(&mut self, context: &Context, out: &Outgoing, now: Monotonic) -> usize {
        if now < self.next {
            return 0;
        }
        let (stamp_ns, news) = context.publish_state.shores_newer_than(self.revision);
        if news.shores.is_none() {
            return 0;
        }
        self.revision = news.revision;
        self.next = now + SHORES_PERIOD;
        let message = out.message(stamp_ns, &news);
        message.map_or(0, |message| put_bulk(context, Topic::Shores, message))
    }
}

pub(super) fn cell_m(grids: &[LayerGrid], key: TileKey) -> f64 {
    let grid = grids.iter().find(|grid| grid.layer == key.layer);
    grid.map_or(1.0, |grid| grid.cell_m)
}

const fn bit(layer: LayerId) -> u32 {
    1 << layer as u32
}

fn center_m(view: &View) -> [f64; 2] {
    let [low_x, low_y, high_x, high_y] = view.rectangle_m.map(f64::from);
    [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)]
}

fn next_tiles(context: &Context, near: &[[f64; 2]]) -> Vec<TileKey> {
    let mut tile_queue = context.publish_state.tile_queue();
    if tile_queue.is_empty() {
        return Vec::new();
    }
    let cells = with_store(&context.store, |store| store.grids().collect::<Vec<_>>());
    tile_queue.take_nearest(TILES_AT_ONCE, near, |key| cell_m(&cells, key))
}

/// Sends a tile, or half of one; how many bytes that were.
fn send_band(context: &Context, key: TileKey, message: Vec<u8>) -> usize {
    let bytes = put_bulk(context, Topic::Tile(key), message);
    context.publish_state.pushed(bytes);
    bytes
}

/// Sends a message on the bulk session; how many bytes it has.
pub(super) fn put_bulk(context: &Context, topic: Topic, message: Vec<u8>) -> usize {
    let bytes = message.len();
    let key = topic.key(&context.robot);
    let sent = context
        .bulk
        .put(key.clone(), message)
        // A console that cannot follow asks for what it lacks; nobody else waits for it.
        .congestion_control(CongestionControl::Drop)
        .priority(Priority::Data)
        .wait();
    if let Err(why) = sent {
        tracing::debug!(%why, key, "not sent");
    }
    bytes
}
