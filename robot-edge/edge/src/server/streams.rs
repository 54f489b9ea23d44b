//! Periodic messages of the robot: state at fixed rates, and changed tiles.

use std::collections::BTreeMap;
use std::time::Duration;

use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{AgeToken, MapHead, View};
use protocol::tile::TileKey;
use protocol::tile_store::LayerGrid;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::{Session, Wait};

use super::open_sessions::{Context, Outgoing};
use super::token_pace::TokenPace;
use crate::driving::SharedDriveState;
use crate::events::event;
use crate::publishing::bandwidth_limiter::{BandwidthLimiter, TokenBucket};
use crate::publishing::pushed_tiles::PushedTiles;
use crate::publishing::replies::{self, with_store};
use measurement::time::Monotonic;
use network::LinkError;
use network::clock;

/// Interval of looking for what is to be sent while somebody drives, or tiles wait.
const BUSY_PERIOD: Duration = Duration::from_millis(20);
/// The same otherwise: to wake up 50 times a second costs more than all that is sent then.
const IDLE_PERIOD: Duration = Duration::from_millis(50);
/// Interval of poses while nobody drives: with the headers of the network, 20 a second took half of the link.
const POSE_PERIOD: Duration = Duration::from_millis(200);
const STATUS_PERIOD: Duration = Duration::from_millis(500);
const HEAD_PERIOD: Duration = Duration::from_secs(1);
/// Maximum delay of a changed head.
const CHANGED_HEAD_PERIOD: Duration = Duration::from_millis(200);
const SHORES_PERIOD: Duration = Duration::from_secs(1);
/// Tiles taken from the queue at once: few, because the order changes as the vehicle moves.
const TILES_AT_ONCE: usize = 32;

fn publisher(
    session: &Session,
    key: String,
    priority: Priority,
    reliability: Reliability,
) -> Result<Publisher<'static>, LinkError> {
    session
        .declare_publisher(key.clone())
        // A console that cannot follow gets the next message, or requests what it lacks.
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(priority == Priority::RealTime)
        .reliability(reliability)
        .wait()
        .map_err(|why| LinkError::Declare { what: key, why })
}

/// Publishers of periodic topics: their keys cross the network once.
pub(super) struct TopicPublishers {
    pose: Publisher<'static>,
    status: Publisher<'static>,
    localization: Publisher<'static>,
    plan: Publisher<'static>,
    event: Publisher<'static>,
    map_head: Publisher<'static>,
}

impl TopicPublishers {
    pub(super) fn declare(context: &Context) -> Result<Self, LinkError> {
        let declare = |topic: Topic, reliability| {
            let key = topic.key(&context.robot);
            publisher(&context.control, key, Priority::RealTime, reliability)
        };
        Ok(Self {
            // Over QUIC, best effort is a datagram, which does not wait for lost data.
            pose: declare(Topic::Pose, Reliability::BestEffort)?,
            status: declare(Topic::Status, Reliability::Reliable)?,
            localization: declare(Topic::Localization, Reliability::Reliable)?,
            plan: declare(Topic::Plan, Reliability::Reliable)?,
            event: declare(Topic::Event, Reliability::Reliable)?,
            map_head: declare(Topic::MapHead, Reliability::Reliable)?,
        })
    }
}

/// Publishers on the bulk session.
pub(super) struct BulkPublishers {
    changes: BTreeMap<LayerId, Publisher<'static>>,
    shores: Publisher<'static>,
    scan: Publisher<'static>,
}

impl BulkPublishers {
    pub(super) fn declare(context: &Context) -> Result<Self, LinkError> {
        let declare = |topic: Topic| {
            let key = topic.key(&context.robot);
            publisher(&context.bulk, key, Priority::Data, Reliability::Reliable)
        };
        let changes = LayerId::ALL.into_iter();
        let changes = changes.map(|layer| Ok((layer, declare(Topic::Changes(layer))?)));
        Ok(Self {
            changes: changes.collect::<Result<_, LinkError>>()?,
            shores: declare(Topic::Shores)?,
            scan: declare(Topic::Scan)?,
        })
    }

    /// Those of these layers whose changes somebody gets: none while the link to all consoles, or to a router, is lost.
    fn followed(&self, wanted: u32) -> u32 {
        let followed = self.changes.iter().filter(|(layer, publisher)| {
            let matching = || publisher.matching_status().wait();
            wanted & bit(**layer) != 0 && matching().is_ok_and(|status| status.matching())
        });
        followed.fold(0, |followed, (layer, _)| followed | bit(*layer))
    }
}

/// Sends pose, status, events and map heads until the network closes.
pub(super) fn send_state(
    context: &Context,
    out: &Outgoing,
    publishers: &TopicPublishers,
    max_command_age: Duration,
) {
    let start = clock::now();
    let (mut next, mut period) = (start, IDLE_PERIOD);
    let [mut status_due, mut head_due, mut changed_head_due] = [Due(start); 3];
    let mut pose_sent = Monotonic::default();
    let mut token_pace = TokenPace::new(max_command_age, start);
    let mut announced: Option<MapHead> = None;
    let mut sent_teleop_state = None;
    let mut sent_closures_m = None;
    let mut sent_plan = None;
    loop {
        let drive_state = context.drive_state.as_deref();
        // Periods that a suspended machine missed are skipped.
        next = (next + period).max(clock::now());
        let is_open = clock::sleep_until(next, || context.is_closing());
        // A new console gets the state at once. The final status and head are sent even if the network closes at
        // once: otherwise the end would look like a lost link.
        let is_requested = context.publish_state.take_status_request();
        if !is_open && !is_requested {
            return;
        }
        let now = clock::now();
        let pose = context.publish_state.pose();
        let stamp_ns = pose.map_or(0, |(stamp, _)| stamp.as_nanos());
        let is_driven = drive_state.is_some_and(SharedDriveState::is_held);
        let teleop = drive_state.and_then(SharedDriveState::status);
        let age = teleop.as_ref().and_then(|teleop| teleop.age_ms);
        let age = age.map(|age_ms| Duration::from_millis(age_ms.into()));
        let token_interval = token_pace.interval(age, now);
        // A pose carries a token, which limits the age of commands: while the lease is held or requested poses are as frequent.
        let pose_interval;
        (period, pose_interval) = if is_driven {
            (BUSY_PERIOD, token_interval)
        } else {
            (IDLE_PERIOD, POSE_PERIOD)
        };
        // By the schedule, which does not shift where a round is late.
        if let Some((_, mut pose)) = pose
            && (is_requested || next.since(pose_sent) >= pose_interval)
        {
            pose_sent = next;
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
        let state = teleop.as_ref().map(|teleop| {
            (
                teleop.state,
                teleop.lease.clone(),
                teleop.estop,
                teleop.goal,
            )
        });
        let is_changed = sent_teleop_state != state;
        if status_due.is_due(now, STATUS_PERIOD, is_requested || is_changed) {
            let mut status = context.publish_state.status(now);
            status.teleop = teleop;
            put(&publishers.status, out.message(stamp_ns, &status));
            sent_teleop_state = state;
            if let Some(mut localization) = context.publish_state.localization() {
                // A new console has none.
                if localization.closures_m == sent_closures_m && !is_requested {
                    localization.closures_m = None;
                } else {
                    sent_closures_m.clone_from(&localization.closures_m);
                }
                put(
                    &publishers.localization,
                    out.message(stamp_ns, &localization),
                );
            }
        }
        if let Some(plan) = drive_state.and_then(SharedDriveState::plan)
            && (is_requested || sent_plan.as_ref() != Some(&plan))
        {
            put(&publishers.plan, out.message(stamp_ns, &plan));
            sent_plan = Some(plan);
        }
        // No console can have the map of a head while tiles wait, and while some are held back the map goes on changing.
        let is_changed_head = changed_head_due.is_due(now, CHANGED_HEAD_PERIOD, false)
            && context.publish_state.tiles_waiting() == 0
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

/// A deadline that repeats.
#[derive(Clone, Copy)]
struct Due(Monotonic);

impl Due {
    /// Whether it is reached or `wanted`; then it is set `period` ahead.
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

/// Announces changed tiles, and sends them, nearest first, and changed shores, within the budget, until the network closes.
pub(super) fn send_tiles(context: &Context, out: &Outgoing, publishers: &BulkPublishers) {
    let (mut next, mut period) = (clock::now(), IDLE_PERIOD);
    let mut bandwidth_limiter = BandwidthLimiter::new(context.budget_kbps, next);
    let mut shores = ShoresPush::new(next);
    let mut scans = ScanPush::new(context.budget_kbps, next);
    let mut pushed_tiles = PushedTiles::default();
    loop {
        next = (next + period).max(clock::now());
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
        let wanted = publishers.followed(wanted);
        context.announce(&views, now);
        // Only layers that a console shows and gets are encoded; a console that shows another one requests it. Once nobody could get
        // them tiles are pushed whole: what was pushed before may be lost.
        context
            .publish_state
            .tile_queue()
            .keep_layers(|layer| wanted & bit(layer) != 0);
        pushed_tiles.keep_layers(|layer| wanted & bit(layer) != 0);
        let newest_held = views.iter().map(|view| view.revision).max();
        bandwidth_limiter.acknowledged(newest_held.unwrap_or(u64::MAX), now);
        let near: Vec<_> = context
            .publish_state
            .position_m()
            .into_iter()
            .chain(views.iter().map(center_m))
            .collect();
        // Before the tiles, which may fill the budget.
        if !views.is_empty() && bandwidth_limiter.allows(now) {
            bandwidth_limiter.spent(shores.send(context, out, &publishers.shores, now));
        }
        let wants_scan = views.iter().any(|view| view.wants_scan);
        context.publish_state.want_scan(wants_scan);
        if wants_scan && bandwidth_limiter.allows(now) {
            bandwidth_limiter.spent(scans.send(context, out, &publishers.scan, now));
        }
        let mut has_sent = false;
        while bandwidth_limiter.allows(clock::now()) {
            let keys = next_tiles(context, &near);
            if keys.is_empty() {
                break;
            }
            has_sent = true;
            for (layer, stamp_ns, changes) in pushed_tiles.changes(&context.store, keys) {
                let newest = changes.tiles.iter().map(|tile| tile.band.revision).max();
                let message = out.message(stamp_ns, &changes);
                let publisher = publishers.changes.get(&layer);
                let bytes = publisher.zip(message).map_or(0, |(publisher, message)| {
                    let bytes = put_bulk(publisher, message);
                    context.publish_state.pushed(bytes);
                    bytes
                });
                bandwidth_limiter.pushed(newest.unwrap_or(0), bytes, clock::now());
            }
        }
        if has_sent {
            context.publish_state.mark_map_changed();
        }
        period = if context.publish_state.tile_queue().is_empty() {
            IDLE_PERIOD
        } else {
            BUSY_PERIOD
        };
    }
}

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

    /// Sends the shores if they changed and the interval has passed. Returns the number of bytes.
    fn send(
        &mut self,
        context: &Context,
        out: &Outgoing,
        publisher: &Publisher<'static>,
        now: Monotonic,
    ) -> usize {
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
        message.map_or(0, |message| put_bulk(publisher, message))
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

/// Sends a message on the bulk session. Returns the number of bytes.
fn put_bulk(publisher: &Publisher<'static>, message: Vec<u8>) -> usize {
    let bytes = message.len();
    put(publisher, Some(message));
    bytes
}

const SCAN_PERIOD: Duration = Duration::from_millis(200);
/// Maximum share of scans in the tile budget: they are only displayed.
const SCAN_SHARE: f64 = 1.0 / 16.0;
/// A waiting tile within this distance of the vehicle has priority over scans, metres.
const SCAN_WAITS_FOR_M: f64 = 15.0;
struct ScanPush {
    token_bucket: TokenBucket,
    next: Monotonic,
}

impl ScanPush {
    fn new(budget_kbps: u32, now: Monotonic) -> Self {
        Self {
            token_bucket: TokenBucket::new(SCAN_SHARE * f64::from(budget_kbps), now),
            next: now,
        }
    }

    fn set_budget(&mut self, budget_kbps: u32) {
        self.token_bucket
            .set_rate(SCAN_SHARE * f64::from(budget_kbps));
    }

    /// Sends the last scans if they are due and no tile near the vehicle waits. Returns the number of bytes.
    fn send(
        &mut self,
        context: &Context,
        out: &Outgoing,
        publisher: &Publisher<'static>,
        now: Monotonic,
    ) -> usize {
        if now < self.next || !self.token_bucket.allows(now) || is_map_waiting(context) {
            return 0;
        }
        self.next = now + SCAN_PERIOD;
        let scans = context.publish_state.take_scans().into_iter();
        let messages = scans.filter_map(|(stamp, scan)| out.message(stamp.as_nanos(), &scan));
        let bytes = messages.map(|message| put_bulk(publisher, message)).sum();
        self.token_bucket.spend(bytes);
        bytes
    }
}

/// Whether a tile near the vehicle waits, or the position is unknown.
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
