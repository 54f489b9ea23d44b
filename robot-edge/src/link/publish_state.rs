//! What mapping hands to the link: the latest of everything, under locks that are held for microseconds.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use protocol::message::{
    Event, Info, MAX_SENSORS, Pose, Scan, SensorInfo, Shores, ShoresReply, Status, View,
    VoxelsReply, VoxelsRequest,
};
use protocol::tile::TileKey;

use crate::streaming::tile_queue::TileQueue;
use crate::streaming::trajectory::SharedTrajectory;
use crate::streaming::voxel_snapshots::{VoxelSnapshot, VoxelSnapshots};
use mapping::registered_scan::SensorId;
use measurement::time::Monotonic;
use measurement::time::RobotTime;

/// Events that wait to be told at most; the oldest goes.
const MAX_EVENTS: usize = 256;
/// Consoles whose views are remembered.
const MAX_VIEWS: usize = 64;
/// A console that has not said what it looks at for this long is gone.
const VIEW_LIFETIME: Duration = Duration::from_secs(3);

/// The state that mapping and link share.
#[derive(Debug, Default)]
pub struct PublishState {
    pose: Mutex<Option<(RobotTime, Pose)>>,
    status: Mutex<Status>,
    events: Mutex<VecDeque<Event>>,
    /// Events for the next console that comes.
    queued_events: Mutex<Vec<Event>>,
    shores: Mutex<ShoresState>,
    voxels: Mutex<VoxelSnapshots>,
    trajectory: SharedTrajectory,
    /// What was found out of the sensors, and how often.
    sensors: Mutex<(u32, Vec<SensorInfo>)>,
    /// The last sweep of each sensor that was not sent yet.
    scans: Mutex<BTreeMap<SensorId, (RobotTime, Scan)>>,
    tile_queue: Mutex<TileQueue>,
    views: Mutex<BTreeMap<String, (View, Monotonic)>>,
    refused: AtomicU64,
    /// Tiles, or halves of tiles, that were pushed, and the bytes of their messages.
    pushed: [AtomicU64; 2],
    /// Some console wants to see sweeps.
    wants_scan: AtomicBool,
    /// The map is another than was announced.
    is_map_changed: AtomicBool,
    /// Status and head are wanted at once.
    is_status_requested: AtomicBool,
    has_ended: AtomicBool,
    is_closing: AtomicBool,
}

/// The latest shores. Their revision rises with every change, so that a console can say which it holds.
#[derive(Clone, Debug, Default)]
struct ShoresState {
    revision: u64,
    latest: Option<(RobotTime, Arc<Shores>)>,
}

/// A panic elsewhere must not take the link with it: what it guards is replaced as a whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl PublishState {
    /// Where the vehicle is now.
    pub fn set_pose(&self, stamp: RobotTime, pose: Pose) {
        *lock(&self.pose) = Some((stamp, pose));
    }

    /// The last pose and its stamp.
    pub fn pose(&self) -> Option<(RobotTime, Pose)> {
        *lock(&self.pose)
    }

    /// Where the vehicle is, metres in `odom`.
    pub fn position_m(&self) -> Option<[f64; 2]> {
        self.pose()
            .map(|(_, pose)| [pose.position_m[0], pose.position_m[1]])
    }

    /// The stamp of the newest pose, nanoseconds; 0 before the first.
    pub fn stamp_ns(&self) -> i64 {
        self.pose().map_or(0, |(stamp, _)| stamp.as_nanos())
    }

    /// How mapping is doing; what the link itself counts is added when it is sent.
    pub fn set_status(&self, status: Status) {
        *lock(&self.status) = status;
    }

    /// The last status, with the link's own figures.
    pub fn status(&self, now: Monotonic) -> Status {
        let mut status = lock(&self.status).clone();
        status.tiles_waiting = u32::try_from(lock(&self.tile_queue).len()).unwrap_or(u32::MAX);
        status.consoles = u16::try_from(self.views(now).len()).unwrap_or(u16::MAX);
        status.tiles = [0, 1].map(|i: usize| self.pushed[i].load(Ordering::Relaxed));
        status.refused = self.refused.load(Ordering::Relaxed);
        status.info_revision = lock(&self.sensors).0;
        status.has_ended = self.has_ended.load(Ordering::Relaxed);
        status
    }

    /// What is known of the sensors, and how often something was found out.
    pub fn set_sensors(&self, revision: u32, sensors: Vec<SensorInfo>) {
        *lock(&self.sensors) = (revision, sensors);
    }

    /// Who the robot is, with what was found out since.
    pub fn info(&self, info: &Info) -> Info {
        let (revision, sensors) = lock(&self.sensors).clone();
        Info {
            revision,
            sensors,
            ..info.clone()
        }
    }

    /// The last sweep of a sensor; one that was not sent yet is forgotten.
    pub fn set_scan(&self, sensor: SensorId, stamp: RobotTime, scan: Scan) {
        let mut scans = lock(&self.scans);
        if scans.len() < MAX_SENSORS || scans.contains_key(&sensor) {
            scans.insert(sensor, (stamp, scan));
        }
    }

    /// The sweeps that were not taken yet, one a sensor.
    pub fn take_scans(&self) -> Vec<(RobotTime, Scan)> {
        std::mem::take(&mut *lock(&self.scans))
            .into_values()
            .collect()
    }

    /// Says whether some console wants to see sweeps. What waits when none does any more would be old news later.
    pub fn want_scan(&self, is_wanted: bool) {
        let was_wanted = self.wants_scan.swap(is_wanted, Ordering::Relaxed);
        if was_wanted && !is_wanted {
            lock(&self.scans).clear();
        }
    }

    /// Whether some console wants to see sweeps.
    pub fn wants_scan(&self) -> bool {
        self.wants_scan.load(Ordering::Relaxed)
    }

    /// The shores and docking sites of measurements up to `stamp`. What equals the last is no news.
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

    /// The shores, if they are newer than a revision, and their stamp, nanoseconds.
    pub fn shores_newer_than(&self, revision: u64) -> (i64, ShoresReply) {
        let ShoresState {
            revision: latest_revision,
            latest,
        } = lock(&self.shores).clone();
        let stamp_ns = latest.as_ref().map_or(0, |(stamp, _)| stamp.as_nanos());
        let news = ShoresReply {
            revision: latest_revision,
            shores: latest
                .filter(|_| latest_revision > revision)
                .map(|(_, shores)| Arc::unwrap_or_clone(shores)),
        };
        (stamp_ns, news)
    }

    /// The answer to a question for the octree's files, and the stamp of what it tells, nanoseconds.
    pub fn voxels(&self, request: VoxelsRequest, now: Monotonic) -> (i64, VoxelsReply) {
        lock(&self.voxels).reply(request, now)
    }

    /// There is an octree, so that its files can be asked for.
    pub fn enable_voxels(&self) {
        lock(&self.voxels).enable();
    }

    /// Whether files of the octree are wanted, as it was up to `stamp`: to be made now, and put or given up. It `is_paused` where
    /// nothing newer comes for now.
    pub fn take_voxels_request(&self, stamp: RobotTime, is_paused: bool) -> bool {
        lock(&self.voxels).take_request(stamp, is_paused)
    }

    /// What was wished for; `None` where it could not be made.
    pub fn put_voxels(&self, snapshot: Option<VoxelSnapshot>, now: Monotonic) {
        lock(&self.voxels).put(snapshot, now);
    }

    /// Where the vehicle was, for mapping to go on with.
    pub const fn trajectory(&self) -> &SharedTrajectory {
        &self.trajectory
    }

    /// Something happened that consoles should know.
    pub fn publish_event(&self, event: Event) {
        let mut events = lock(&self.events);
        if events.len() >= MAX_EVENTS {
            events.pop_front();
        }
        events.push_back(event);
    }

    /// The same, and where no console is there now, the next one that comes gets it: what happens at the start, mostly, few.
    pub fn publish_or_queue_event(&self, event: Event, now: Monotonic) {
        let views = lock(&self.views);
        if views.values().any(|(_, at)| now.since(*at) < VIEW_LIFETIME) {
            self.publish_event(event);
        } else {
            lock(&self.queued_events).push(event);
        }
    }

    /// The events that were not told yet.
    pub fn take_events(&self) -> Vec<Event> {
        lock(&self.events).drain(..).collect()
    }

    /// These tiles changed in the store.
    pub fn tiles_changed(&self, keys: impl IntoIterator<Item = TileKey>) {
        let mut tile_queue = lock(&self.tile_queue);
        keys.into_iter().for_each(|key| tile_queue.add(key));
    }

    /// The tiles that wait to be pushed.
    pub fn tile_queue(&self) -> MutexGuard<'_, TileQueue> {
        lock(&self.tile_queue)
    }

    /// A console said what it looks at. One that is new hears at once what the map is.
    pub fn set_view(&self, session: String, view: View, now: Monotonic) {
        let mut views = lock(&self.views);
        views.retain(|_, (_, at)| now.since(*at) < VIEW_LIFETIME);
        if !views.contains_key(&session) {
            if views.len() >= MAX_VIEWS {
                return self.count_rejected();
            }
            self.is_status_requested.store(true, Ordering::Relaxed);
            for event in lock(&self.queued_events).drain(..) {
                self.publish_event(event);
            }
        }
        views.insert(session, (view, now));
    }

    /// What the consoles that are there look at.
    pub fn views(&self, now: Monotonic) -> Vec<View> {
        let views = lock(&self.views);
        let fresh = views
            .values()
            .filter(|(_, at)| now.since(*at) < VIEW_LIFETIME);
        fresh.map(|(view, _)| view.clone()).collect()
    }

    /// Status and head are wanted at once.
    pub fn request_status(&self) {
        self.is_status_requested.store(true, Ordering::Relaxed);
    }

    /// Whether status and head are wanted at once, since the last call.
    pub fn take_status_request(&self) -> bool {
        self.is_status_requested.swap(false, Ordering::Relaxed)
    }

    /// Everything that changed has been pushed.
    pub fn mark_map_changed(&self) {
        self.is_map_changed.store(true, Ordering::Relaxed);
    }

    /// Whether there is news since the last call.
    pub fn take_map_changed(&self) -> bool {
        self.is_map_changed.swap(false, Ordering::Relaxed)
    }

    /// Whether every console that is there holds all that was published up to `revision`.
    pub fn all_consoles_have(&self, revision: u64, now: Monotonic) -> bool {
        let views = self.views(now);
        views
            .iter()
            .all(|view| view.is_synchronized && view.revision >= revision)
    }

    /// Counts a message with a tile that was pushed.
    pub fn pushed(&self, bytes: usize) {
        self.pushed[0].fetch_add(1, Ordering::Relaxed);
        self.pushed[1].fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts a message that made no sense.
    pub fn count_rejected(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// Nothing new will come.
    pub fn end(&self) {
        self.has_ended.store(true, Ordering::Relaxed);
        self.is_status_requested.store(true, Ordering::Relaxed);
    }

    /// Asks the link's threads to end.
    pub fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    /// Whether the link's threads are to end.
    pub fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shores_are_news_once_and_only_where_they_differ() {
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
    fn the_newest_sweep_of_each_sensor_waits_while_somebody_wants_it() {
        let publish_state = PublishState::default();
        let at = RobotTime::from_nanos;
        let sweep = |name: &str| Scan::of_points(name.to_owned(), [0.0; 2], [[1.0, 1.0]]);
        assert!(!publish_state.wants_scan());
        publish_state.want_scan(true);
        publish_state.set_scan(SensorId(1), at(1), sweep("sonar"));
        publish_state.set_scan(SensorId(0), at(2), sweep("laser"));
        publish_state.set_scan(SensorId(0), at(3), sweep("laser"));
        let waiting = [(at(3), sweep("laser")), (at(1), sweep("sonar"))];
        assert_eq!(publish_state.take_scans(), waiting);
        assert_eq!(publish_state.take_scans(), []);
        for n in 0..100 {
            publish_state.set_scan(SensorId(n), at(4), sweep("many"));
        }
        assert_eq!(publish_state.take_scans().len(), MAX_SENSORS);
        publish_state.set_scan(SensorId(0), at(5), sweep("laser"));
        publish_state.want_scan(false);
        assert_eq!(publish_state.take_scans(), []);
    }

    #[test]
    fn what_was_found_out_of_the_sensors_is_in_the_info_and_the_status_says_so() {
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
    fn a_console_that_is_gone_is_not_waited_for() {
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
