//! The latest state that the pipeline hands to the network threads. Each lock is held for microseconds.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use protocol::message::{
    Event, Info, Localization, MAX_SENSORS, Pose, Scan, SensorInfo, Shores, ShoresReply, Status,
    View, VoxelsReply, VoxelsRequest,
};
use protocol::tile::TileKey;

use crate::lock;
use crate::publishing::tile_queue::TileQueue;
use crate::publishing::trajectory::SharedTrajectory;
use crate::publishing::voxel_snapshots::{VoxelSnapshot, VoxelSnapshots};
use mapping::registered_scan::SensorId;
use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// Events that wait to be sent; a newer one replaces the oldest.
const MAX_EVENTS: usize = 256;
/// Consoles whose views are kept.
const MAX_VIEWS: usize = 64;
/// A console is gone if it has sent no view for this long.
const VIEW_LIFETIME: Duration = Duration::from_secs(3);

/// The latest state of the pipeline for the network.
#[derive(Debug, Default)]
pub struct PublishState {
    pose: Mutex<Option<(RobotTime, Pose)>>,
    status: Mutex<Status>,
    localization: Mutex<Option<Localization>>,
    /// The sensors and the revision of this list.
    sensors: Mutex<(u32, Vec<SensorInfo>)>,
    shores: Mutex<ShoresState>,
    voxels: Mutex<VoxelSnapshots>,
    trajectory: SharedTrajectory,
    /// Not yet announced or held back.
    changed_tiles: Mutex<BTreeSet<TileKey>>,
    tile_queue: Mutex<TileQueue>,
    scans: LatestScans,
    events: Events,
    views: Mutex<BTreeMap<String, (View, Monotonic)>>,
    counters: Counters,
    signals: Signals,
}

/// The latest shores. The revision increases with every change, so that a console can say which one it has.
#[derive(Clone, Debug, Default)]
struct ShoresState {
    revision: u64,
    latest: Option<(RobotTime, Arc<Shores>)>,
}

/// The last scan of each sensor that was not sent yet.
#[derive(Debug, Default)]
struct LatestScans {
    by_sensor: Mutex<BTreeMap<SensorId, (RobotTime, Scan)>>,
    /// A console shows scans.
    is_wanted: AtomicBool,
}

#[derive(Debug, Default)]
struct Events {
    pending: Mutex<VecDeque<Event>>,
    /// For the next console that connects.
    queued: Mutex<Vec<Event>>,
}

impl Events {
    fn push(&self, event: Event) {
        let mut pending = lock(&self.pending);
        if pending.len() >= MAX_EVENTS {
            pending.pop_front();
        }
        pending.push_back(event);
    }
}

#[derive(Debug, Default)]
struct Counters {
    rejected: AtomicU64,
    /// Changed tiles that are held back.
    held: AtomicUsize,
    /// Messages with tiles that were pushed, and their bytes.
    pushed: AtomicU64,
    pushed_bytes: AtomicU64,
}

#[derive(Debug, Default)]
struct Signals {
    /// The map differs from the announced head.
    is_map_changed: AtomicBool,
    /// Status and head are to be sent at once.
    is_status_requested: AtomicBool,
    has_ended: AtomicBool,
    is_closing: AtomicBool,
}

impl PublishState {
    pub fn set_pose(&self, stamp: RobotTime, pose: Pose) {
        *lock(&self.pose) = Some((stamp, pose));
    }

    pub fn pose(&self) -> Option<(RobotTime, Pose)> {
        *lock(&self.pose)
    }

    /// The position of the vehicle in `odom`, metres.
    pub fn position_m(&self) -> Option<[f64; 2]> {
        self.pose()
            .map(|(_, pose)| [pose.position_m[0], pose.position_m[1]])
    }

    /// The stamp of the newest pose, nanoseconds; 0 before the first.
    pub fn stamp_ns(&self) -> i64 {
        self.pose().map_or(0, |(stamp, _)| stamp.as_nanos())
    }

    /// Sets the status of mapping; [`Self::status`] adds the figures of the network.
    pub fn set_status(&self, status: Status) {
        *lock(&self.status) = status;
    }

    pub fn set_localization(&self, localization: Localization) {
        *lock(&self.localization) = Some(localization);
    }

    /// `None` where no scans are matched.
    pub fn localization(&self) -> Option<Localization> {
        lock(&self.localization).clone()
    }

    /// The last status, with the figures of the network.
    pub fn status(&self, now: Monotonic) -> Status {
        let mut status = lock(&self.status).clone();
        status.tiles_waiting = u32::try_from(self.tiles_waiting()).unwrap_or(u32::MAX);
        status.consoles = u16::try_from(self.views(now).len()).unwrap_or(u16::MAX);
        let Counters {
            rejected,
            pushed,
            pushed_bytes,
            ..
        } = &self.counters;
        status.tiles = [pushed, pushed_bytes].map(|counter| counter.load(Ordering::Relaxed));
        status.refused = rejected.load(Ordering::Relaxed);
        status.info_revision = lock(&self.sensors).0;
        status.has_ended = self.has_ended();
        status
    }

    pub fn set_sensors(&self, revision: u32, sensors: Vec<SensorInfo>) {
        *lock(&self.sensors) = (revision, sensors);
    }

    /// `info` with the current list of sensors.
    pub fn info(&self, info: &Info) -> Info {
        let (revision, sensors) = lock(&self.sensors).clone();
        Info {
            revision,
            sensors,
            ..info.clone()
        }
    }

    /// Sets the last scan of a sensor; an earlier one that was not sent is dropped.
    pub fn set_scan(&self, sensor: SensorId, stamp: RobotTime, scan: Scan) {
        let mut scans = lock(&self.scans.by_sensor);
        if scans.len() < MAX_SENSORS || scans.contains_key(&sensor) {
            scans.insert(sensor, (stamp, scan));
        }
    }

    /// The scans that were not sent yet, one per sensor.
    pub fn take_scans(&self) -> Vec<(RobotTime, Scan)> {
        std::mem::take(&mut *lock(&self.scans.by_sensor))
            .into_values()
            .collect()
    }

    /// Sets whether a console shows scans. If none does, waiting scans are dropped: they would be outdated later.
    pub fn want_scan(&self, is_wanted: bool) {
        let was_wanted = self.scans.is_wanted.swap(is_wanted, Ordering::Relaxed);
        if was_wanted && !is_wanted {
            lock(&self.scans.by_sensor).clear();
        }
    }

    pub fn wants_scan(&self) -> bool {
        self.scans.is_wanted.load(Ordering::Relaxed)
    }

    /// Sets the shores and docking sites of the data up to `stamp`. Equal ones get no new revision.
    pub fn set_shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        let mut state = lock(&self.shores);
        let is_known = state
            .latest
            .as_ref()
            .is_some_and(|(_, last)| *last == shores);
        if !is_known {
            state.revision += 1;
            state.latest = Some((stamp, shores));
        }
    }

    /// The shores if they are newer than a revision, and their stamp, nanoseconds.
    pub fn shores_newer_than(&self, revision: u64) -> (i64, ShoresReply) {
        let ShoresState {
            revision: latest_revision,
            latest,
        } = lock(&self.shores).clone();
        let stamp_ns = latest.as_ref().map_or(0, |(stamp, _)| stamp.as_nanos());
        let reply = ShoresReply {
            revision: latest_revision,
            shores: latest
                .filter(|_| latest_revision > revision)
                .map(|(_, shores)| Arc::unwrap_or_clone(shores)),
        };
        (stamp_ns, reply)
    }

    pub fn voxels(&self, request: VoxelsRequest, now: Monotonic) -> (i64, VoxelsReply) {
        lock(&self.voxels).reply(request, now)
    }

    pub fn enable_voxels(&self) {
        lock(&self.voxels).enable();
    }

    /// Whether files of the octree with the data up to `stamp` are to be made now; [`Self::put_voxels`] follows. `is_paused`:
    /// no newer data is expected.
    pub fn take_voxels_request(&self, stamp: RobotTime, is_paused: bool) -> bool {
        lock(&self.voxels).take_request(stamp, is_paused)
    }

    /// Sets the requested files; `None` if they could not be made.
    pub fn put_voxels(&self, snapshot: Option<VoxelSnapshot>, now: Monotonic) {
        lock(&self.voxels).put(snapshot, now);
    }

    pub const fn trajectory(&self) -> &SharedTrajectory {
        &self.trajectory
    }

    pub fn publish_event(&self, event: Event) {
        self.events.push(event);
    }

    /// Sends an event to the consoles, or to the next one that connects. For the few events of the start.
    pub fn publish_or_queue_event(&self, event: Event, now: Monotonic) {
        let views = lock(&self.views);
        if views.values().any(|(_, at)| now.since(*at) < VIEW_LIFETIME) {
            self.events.push(event);
        } else {
            lock(&self.events.queued).push(event);
        }
    }

    pub fn take_events(&self) -> Vec<Event> {
        lock(&self.events.pending).drain(..).collect()
    }

    pub fn tiles_changed(&self, keys: impl IntoIterator<Item = TileKey>) {
        lock(&self.changed_tiles).extend(keys);
    }

    pub fn take_changed_tiles(&self) -> BTreeSet<TileKey> {
        std::mem::take(&mut *lock(&self.changed_tiles))
    }

    /// Queues tiles that were announced; `held` others are held back.
    pub fn tiles_announced(&self, announced: Vec<TileKey>, held: usize) {
        let mut tile_queue = lock(&self.tile_queue);
        for key in announced {
            tile_queue.add(key);
        }
        self.counters.held.store(held, Ordering::Relaxed);
    }

    pub fn tile_queue(&self) -> MutexGuard<'_, TileQueue> {
        lock(&self.tile_queue)
    }

    /// Tiles that wait for the link or are held back.
    pub fn tiles_waiting(&self) -> usize {
        self.counters.held.load(Ordering::Relaxed) + lock(&self.tile_queue).len()
    }

    /// Sets the view of a console. A new console gets status, head and queued events at once.
    pub fn set_view(&self, session: String, view: View, now: Monotonic) {
        let mut views = lock(&self.views);
        views.retain(|_, (_, at)| now.since(*at) < VIEW_LIFETIME);
        if !views.contains_key(&session) {
            if views.len() >= MAX_VIEWS {
                return self.count_rejected();
            }
            self.request_status();
            for event in lock(&self.events.queued).drain(..) {
                self.events.push(event);
            }
        }
        views.insert(session, (view, now));
    }

    pub fn views(&self, now: Monotonic) -> Vec<View> {
        let views = lock(&self.views);
        let fresh = views
            .values()
            .filter(|(_, at)| now.since(*at) < VIEW_LIFETIME);
        fresh.map(|(view, _)| view.clone()).collect()
    }

    pub fn request_status(&self) {
        let is_requested = &self.signals.is_status_requested;
        is_requested.store(true, Ordering::Relaxed);
    }

    /// Whether status and head were requested since the last call.
    pub fn take_status_request(&self) -> bool {
        let is_requested = &self.signals.is_status_requested;
        is_requested.swap(false, Ordering::Relaxed)
    }

    /// All changed tiles have been pushed.
    pub fn mark_map_changed(&self) {
        self.signals.is_map_changed.store(true, Ordering::Relaxed);
    }

    /// Whether the map was marked as changed since the last call.
    pub fn take_map_changed(&self) -> bool {
        self.signals.is_map_changed.swap(false, Ordering::Relaxed)
    }

    /// Whether every connected console has the map up to `revision`.
    pub fn all_consoles_have(&self, revision: u64, now: Monotonic) -> bool {
        let views = self.views(now);
        views
            .iter()
            .all(|view| view.is_synchronized && view.revision >= revision)
    }

    pub fn pushed(&self, bytes: usize) {
        let counters = &self.counters;
        counters.pushed.fetch_add(1, Ordering::Relaxed);
        counters
            .pushed_bytes
            .fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub fn count_rejected(&self) {
        self.counters.rejected.fetch_add(1, Ordering::Relaxed);
    }

    /// The data has ended.
    pub fn end(&self) {
        self.signals.has_ended.store(true, Ordering::Relaxed);
        self.request_status();
    }

    pub fn has_ended(&self) -> bool {
        self.signals.has_ended.load(Ordering::Relaxed)
    }

    /// Asks the network threads to end.
    pub fn close(&self) {
        self.signals.is_closing.store(true, Ordering::Relaxed);
    }

    pub fn is_closing(&self) -> bool {
        self.signals.is_closing.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_different_shores_get_a_new_revision() {
        let publish_state = PublishState::default();
        let at = |s: i64| RobotTime::from_nanos(s * 1_000_000_000);
        let nothing = |revision| ShoresReply {
            revision,
            shores: None,
        };
        assert_eq!(publish_state.shores_newer_than(0), (0, nothing(0)));
        let shores = |cell_m| Shores {
            cell_m,
            ..Shores::default()
        };
        let news = |revision, cell_m| ShoresReply {
            revision,
            shores: Some(shores(cell_m)),
        };
        publish_state.set_shores(at(1), Arc::new(shores(0.3)));
        assert_eq!(
            publish_state.shores_newer_than(0),
            (1_000_000_000, news(1, 0.3))
        );
        assert_eq!(
            publish_state.shores_newer_than(1),
            (1_000_000_000, nothing(1))
        );
        publish_state.set_shores(at(2), Arc::new(shores(0.3)));
        assert_eq!(
            publish_state.shores_newer_than(1),
            (1_000_000_000, nothing(1))
        );
        publish_state.set_shores(at(3), Arc::new(shores(0.4)));
        assert_eq!(
            publish_state.shores_newer_than(1),
            (3_000_000_000, news(2, 0.4))
        );
    }

    #[test]
    fn the_newest_scan_of_each_sensor_waits_while_wanted() {
        let publish_state = PublishState::default();
        let at = RobotTime::from_nanos;
        let scan_of = |name: &str| Scan::of_points(name.to_owned(), [0.0; 2], [[1.0, 1.0]]);
        assert!(!publish_state.wants_scan());
        publish_state.want_scan(true);
        publish_state.set_scan(SensorId(1), at(1), scan_of("sonar"));
        publish_state.set_scan(SensorId(0), at(2), scan_of("laser"));
        publish_state.set_scan(SensorId(0), at(3), scan_of("laser"));
        let waiting = [(at(3), scan_of("laser")), (at(1), scan_of("sonar"))];
        assert_eq!(publish_state.take_scans(), waiting);
        assert_eq!(publish_state.take_scans(), []);
        for n in 0..100 {
            publish_state.set_scan(SensorId(n), at(4), scan_of("many"));
        }
        assert_eq!(publish_state.take_scans().len(), MAX_SENSORS);
        publish_state.set_scan(SensorId(0), at(5), scan_of("laser"));
        publish_state.want_scan(false);
        assert_eq!(publish_state.take_scans(), []);
    }

    #[test]
    fn sensors_are_in_the_info_and_their_revision_in_the_status() {
        let publish_state = PublishState::default();
        let sensor = SensorInfo {
            name: "laser".to_owned(),
            kind: protocol::message::SensorKind::PlanarLaser,
            mount: None,
            view: None,
            rate_hz: None,
        };
        publish_state.set_sensors(3, vec![sensor.clone()]);
        let info = publish_state.info(&Info::default());
        assert_eq!((info.revision, info.sensors), (3, vec![sensor]));
        assert_eq!(publish_state.status(Monotonic::default()).info_revision, 3);
    }

    #[test]
    fn a_console_without_views_is_not_waited_for() {
        let publish_state = PublishState::default();
        let at = |s: u64| Monotonic::from_nanos(s * 1_000_000_000);
        let view = |revision, is_synchronized| View {
            rectangle_m: [0.0; 4],
            layers: 1,
            revision,
            is_synchronized,
            wants_scan: false,
        };
        assert!(publish_state.all_consoles_have(9, at(0)));
        publish_state.set_view("a".to_owned(), view(9, true), at(0));
        publish_state.set_view("b".to_owned(), view(9, false), at(1));
        assert!(!publish_state.all_consoles_have(9, at(1)));
        publish_state.set_view("b".to_owned(), view(8, true), at(2));
        assert!(!publish_state.all_consoles_have(9, at(2)));
        publish_state.set_view("b".to_owned(), view(9, true), at(3));
        assert!(publish_state.all_consoles_have(9, at(2)));
        publish_state.set_view("b".to_owned(), view(1, true), at(4));
        assert!(publish_state.all_consoles_have(9, at(8)), "both are gone");
        for n in 0..100 {
            publish_state.set_view(format!("c{n}"), view(1, true), at(8));
        }
        assert_eq!(publish_state.views(at(8)).len(), MAX_VIEWS);
        assert_eq!(publish_state.status(at(8)).refused, 100 - MAX_VIEWS as u64);
    }
}
