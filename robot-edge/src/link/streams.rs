//! What the robot sends by itself: state at fixed rates, tiles as they change.

use std::time::Duration;

use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{MapHead, TileBand, View};
use protocol::tile::TileKey;
use protocol::tile::codec::Encoder;
use zenoh::Wait;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::LinkError;
use super::edge::Context;
use super::outgoing::Outgoing;
use crate::clock::{self, Monotonic};
use crate::streaming::answers::{self, with};
use crate::streaming::flow::Flow;

const POSE_PERIOD: Duration = Duration::from_millis(50);
/// Status and map heads go out every so many poses.
const POSES_PER_STATUS: u32 = 10;
const POSES_PER_HEAD: u32 = 20;
/// Heads that are news wait for this many poses at most.
const POSES_PER_NEWS: u32 = 4;
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
        let declare = |topic: Topic| {
            let key = topic.key(&context.robot);
            context
                .control
                .declare_publisher(key.clone())
                // A console that cannot follow gets the next one.
                .congestion_control(CongestionControl::Drop)
                .priority(Priority::RealTime)
                .express(true)
                .wait()
                .map_err(|why| LinkError::Declare { what: key, why })
        };
        Ok(Self {
            pose: declare(Topic::Pose)?,
            status: declare(Topic::Status)?,
            event: declare(Topic::Event)?,
            map_head: declare(Topic::MapHead)?,
        })
    }
}

/// Sends pose, status, events and map heads until the link closes.
pub(super) fn send_state(context: &Context, out: &Outgoing, publishers: &StatePublishers) {
    let mut next = Monotonic::now();
    let mut told: Option<MapHead> = None;
    for tick in 0u32.. {
        // What a suspended machine missed is not made up for.
        next = (next + POSE_PERIOD).max(Monotonic::now());
        if !clock::sleep_until(next, || context.shared.is_closing()) {
            return;
        }
        let mut stamp_ns = 0;
        if let Some((stamp, pose)) = context.shared.pose() {
            stamp_ns = stamp.as_nanos();
            put(&publishers.pose, out.message(stamp_ns, &pose));
        }
        for event in context.shared.take_events() {
            put(&publishers.event, out.message(stamp_ns, &event));
        }
        // Somebody new should know at once, and the last word is a head behind a status that says so.
        let is_asked_for = context.shared.take_call();
        if is_asked_for || tick.is_multiple_of(POSES_PER_STATUS) {
            let status = context.shared.status(Monotonic::now());
            put(&publishers.status, out.message(stamp_ns, &status));
        }
        // A head that is announced while tiles wait is one that nobody can have reached.
        let is_news = tick.is_multiple_of(POSES_PER_NEWS)
            && context.shared.outbox().is_empty()
            && context.shared.take_news();
        if is_asked_for || is_news || tick.is_multiple_of(POSES_PER_HEAD) {
            let head = answers::head(&context.store);
            let is_told = told.as_ref() == Some(&head);
            if is_asked_for || !is_told || tick.is_multiple_of(POSES_PER_HEAD) {
                put(&publishers.map_head, out.message(stamp_ns, &head));
            }
            told = Some(head);
        }
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
    loop {
        next = (next + TILES_PERIOD).max(Monotonic::now());
        if !clock::sleep_until(next, || context.shared.is_closing()) {
            return;
        }
        let now = Monotonic::now();
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
        let mut has_sent = false;
        while flow.allows(Monotonic::now()) {
            let keys = next_tiles(context, &near);
            if keys.is_empty() {
                break;
            }
            has_sent = true;
            for key in keys {
                for band in answers::bands(&context.store, &mut encoder, key) {
                    let bytes = send_band(context, out, key, &band);
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
    outbox.take_nearest(TILES_AT_ONCE, near, |key| {
        let grid = cells.iter().find(|grid| grid.layer == key.layer);
        grid.map_or(1.0, |grid| grid.cell_m)
    })
}

/// Sends a tile, or half of one; how many bytes that were.
fn send_band(context: &Context, out: &Outgoing, key: TileKey, band: &TileBand) -> usize {
    let Some(message) = out.message(context.shared.stamp_ns(), band) else {
        return 0;
    };
    let bytes = put_bulk(context, Topic::Tile(key), message);
    context.shared.pushed(bytes);
    bytes
}

/// Sends a message on the bulk session; how many bytes it has.
fn put_bulk(context: &Context, topic: Topic, message: Vec<u8>) -> usize {
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
