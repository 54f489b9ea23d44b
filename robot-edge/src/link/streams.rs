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
use crate::clock::{self, Monotonic};
use crate::driving::Board;
use crate::events::event;
use crate::streaming::answers::{self, with};
use crate::streaming::flow::Flow;

const POSE_PERIOD: Duration = Duration::from_millis(50);
/// While somebody drives, or is about to: with each pose goes a token, and a command is as old as its token.
const DRIVEN_POSE_PERIOD: Duration = Duration::from_millis(20);
const STATUS_PERIOD: Duration = Duration::from_millis(500);
const HEAD_PERIOD: Duration = Duration::from_secs(1);
/// Heads that are news wait for this long at most.
const NEWS_PERIOD: Duration = Duration::from_millis(200);
const TILES_PERIOD: Duration = Duration::from_millis(20);
/// Shores are not pushed more often.
const SHORES_PERIOD: Duration = Duration::from_secs(1);
/// Tiles taken from the outbox at once: the vehicle moves on, and so does what is nearest.
const TILES_AT_ONCE: usize = 8;

/// Publishers of the topics that are sent again and again: their keys cross the network once.
pub(super) struct StatePublishers {
    pose: Publisher<'static>,
    status: Publisher<'static>,
    event: Publisher<'static>,
    map_head: Publisher<'static>,
}

impl StatePublishers {
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
pub(super) fn send_state(context: &Context, out: &Outgoing, publishers: &StatePublishers) {
    let start = Monotonic::now();
    let mut next = start;
    let [mut status_due, mut head_due, mut news_due] = [Due(start); 3];
    let mut told: Option<MapHead> = None;
    let mut shown = None;
    loop {
        let board = context.board.as_deref();
        let period = if board.is_some_and(Board::is_held) {
            DRIVEN_POSE_PERIOD
        } else {
            POSE_PERIOD
        };
        // What a suspended machine missed is not made up for.
        next = (next + period).max(Monotonic::now());
        let goes_on = clock::sleep_until(next, || context.is_closing());
        // Somebody new should know at once, and the last word is a head behind a status that says so. It is said also
        // where the link closes at once: an end would be taken for a link that is lost.
        let is_asked_for = context.shared.take_call();
        if !goes_on && !is_asked_for {
            return;
        }
        let now = Monotonic::now();
        let mut stamp_ns = 0;
        if let Some((stamp, mut pose)) = context.shared.pose() {
            stamp_ns = stamp.as_nanos();
            pose.token = board.and_then(Board::token).map(|token| AgeToken {
                n: token.n,
                nonce: token.nonce,
            });
            put(&publishers.pose, out.message(stamp_ns, &pose));
        }
        for (kind, message) in board.map(Board::take_events).unwrap_or_default() {
            context.shared.tell(event(kind, message));
        }
        for event in context.shared.take_events() {
            put(&publishers.event, out.message(stamp_ns, &event));
        }
        let teleop = board.and_then(Board::status);
        let state = teleop
            .as_ref()
            .map(|teleop| (teleop.state, teleop.lease.clone(), teleop.estop));
        let is_changed = shown != state;
        if status_due.is_due(now, STATUS_PERIOD, is_asked_for || is_changed) {
            let mut status = context.shared.status(now);
            status.teleop = teleop;
            put(&publishers.status, out.message(stamp_ns, &status));
            shown = state;
        }
        // A head that is announced while tiles wait is one that nobody can have reached.
        let is_news = news_due.is_due(now, NEWS_PERIOD, false)
            && context.shared.outbox().is_empty()
            && context.shared.take_news();
        let is_head_due = head_due.is_due(now, HEAD_PERIOD, is_asked_for);
        if is_head_due || is_news {
            let head = answers::head(&context.store);
            if is_head_due || told.as_ref() != Some(&head) {
                put(&publishers.map_head, out.message(stamp_ns, &head));
            }
            told = Some(head);
        }
        if !goes_on {
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
    let mut next = Monotonic::now();
    let mut flow = Flow::new(context.budget_kbps, next);
    let mut shores = ShoresPush::new(next);
    let mut scans = ScanPush::new(context.budget_kbps, next);
    loop {
        next = (next + TILES_PERIOD).max(Monotonic::now());
        if !clock::sleep_until(next, || context.is_closing()) {
            return;
        }
        let now = Monotonic::now();
        if let Some(board) = &context.board {
            flow.set_budget(board.budget_kbps());
            scans.set_budget(board.budget_kbps());
        }
        let views = context.shared.views(now);
        let wanted = views.iter().fold(0, |wanted, view| wanted | view.layers);
        // Nothing is encoded that nobody looks at; whoever turns to it asks.
        context
            .shared
            .outbox()
            .keep_layers(|layer| wanted & bit(layer) != 0);
        let newest_held = views.iter().map(|view| view.revision).max();
        flow.acknowledged(newest_held.unwrap_or(u64::MAX), now);
        let near: Vec<_> = context
            .shared
            .position_m()
            .into_iter()
            .chain(views.iter().map(center_m))
            .collect();
        // Before the tiles, of which there may always be more.
        if !views.is_empty() && flow.allows(now) {
            flow.spent(shores.send(context, out, now));
        }
        let wants_scan = views.iter().any(|view| view.wants_scan);
        context.shared.want_scan(wants_scan);
        if wants_scan && flow.allows(now) {
            flow.spent(scans.send(context, out, now));
        }
        let mut has_sent = false;
        while flow.allows(Monotonic::now()) {
            let keys = next_tiles(context, &near);
            if keys.is_empty() {
                break;
            }
            has_sent = true;
            for key in keys {
                for (stamp_ns, band) in answers::bands(&context.store, &mut encoder, key) {
                    let message = out.message(stamp_ns, &band);
                    let bytes = message.map_or(0, |message| send_band(context, key, message));
                    flow.pushed(band.revision, bytes, Monotonic::now());
                }
            }
        }
        if has_sent {
            context.shared.tell_news();
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
        let (stamp_ns, news) = context.shared.shores_newer_than(self.revision);
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
    let mut outbox = context.shared.outbox();
    if outbox.is_empty() {
        return Vec::new();
    }
    let cells = with(&context.store, |store| store.grids().collect::<Vec<_>>());
    outbox.take_nearest(TILES_AT_ONCE, near, |key| cell_m(&cells, key))
}

/// Sends a tile, or half of one; how many bytes that were.
fn send_band(context: &Context, key: TileKey, message: Vec<u8>) -> usize {
    let bytes = put_bulk(context, Topic::Tile(key), message);
    context.shared.pushed(bytes);
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
