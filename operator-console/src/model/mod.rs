//! One robot as this console knows it: messages in, questions out, everything else to be read.
//!
//! The model owns no thread, socket or clock: whoever holds it feeds it what the link brings, asks it what to
//! send, and draws or exports what it holds. The present is always a parameter.

mod ages;
mod connection;
mod data_end;
mod exports;
mod handle_message;
mod incoming;
mod layer_sync;
mod link_quality;
mod map_queries;
mod map_sync;
mod monitor_history;
mod motion;
mod outgoing;
mod reject_reason;
mod retry;
mod robot_run;
mod saved_site_names;
mod scans;
mod shore_outlines;
mod shores_sync;
mod site_names;
mod standstill_detector;
mod stuck_detector;
mod tile_intake;
mod time_window;
mod trail;
mod trail_sync;
mod trajectory_sync;
mod validation;
mod vehicle;
mod visible_change;
mod voxels_sync;

use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{
    Event, Info, RecordingStatus, SensorInfo, SensorStatus, Status, StopReason,
};
use protocol::tile::BootId;

pub use ages::{AgeOrder, Ages};
pub use connection::{Connection, LastContact, LinkState, SILENT_AFTER, SILENT_AFTER_UNSTEADY};
pub use incoming::{Incoming, OpenSessions, Outgoing, RequestId};
pub use link_quality::{LinkQuality, LinkSample, Stream};
pub use map_sync::{LayerSyncState, MapSync};
pub use monitor_history::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS, MonitorReport, direction_signs};
pub use motion::{DRIFTING_MPS, UncommandedMotion};
pub use reject_reason::{RejectCounts, RejectReason};
pub use saved_site_names::SavedSiteNames;
pub use scans::LastScan;
pub use shore_outlines::{Neighbour, Outline, ShoreOutlines};
pub use site_names::{SiteName, SiteNames};
pub use trajectory_sync::TrajectoryProgress;
pub use vehicle::Vehicle;
pub use voxels_sync::{FetchedVoxels, VoxelsProgress};

use monitor_history::MonitorHistory;
use motion::Motion;
use scans::Scans;
use shores_sync::ShoresSync;
use trail_sync::TrailSync;
use trajectory_sync::TrajectorySync;
use voxels_sync::VoxelsSync;

const MAX_EVENTS: usize = 200;
/// Heads come every second: without one for so long, nobody knows what the robot's map is now.
const HEAD_LIFETIME: Duration = Duration::from_millis(2500);

/// Statuses come more often.
const STATUS_TIMEOUT: Duration = Duration::from_millis(1500);

/// What a console is and wants.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelSettings {
    /// The robot.
    pub robot: RobotId,
    /// This run of the console: random.
    pub session: BootId,
    /// Most memory for tiles, megabytes (10⁶ bytes).
    pub tile_store_mb: u32,
    /// The layers that are wanted.
    pub layers: BTreeSet<LayerId>,
}

/// What a robot told of when an emergency stop was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopBeforeEStop {
    /// The last stop on the way.
    pub last_stop: Option<StopReason>,
}

/// One robot. See the [module](self).
pub struct ConsoleModel {
    settings: ModelSettings,
    map: MapSync,
    vehicle: Vehicle,
    shores: ShoresSync,
    saved_site_names: Option<SavedSiteNames>,
    voxels: VoxelsSync,
    trajectory: TrajectorySync,
    trail: TrailSync,
    is_unfinished: bool,
    scans: Scans,
    wants_scan: bool,
    connection: Connection,
    quality: LinkQuality,
    reject_counts: RejectCounts,
    info: Option<(Info, BootId)>,
    status: Option<(Status, Monotonic)>,
    /// The run of the robot that told it.
    status_run: Option<BootId>,
    motion: Motion,
    monitor_history: MonitorHistory,
    /// The number of the message that first said that the robot's data has ended, and of the newest head.
    ended_seq: Option<u64>,
    head_seq: u64,
    events: VecDeque<(Event, Monotonic)>,
    /// The last stop on the way that was told of when an emergency stop was heard last, in this run of the robot.
    stop_before_estop: Option<StopBeforeEStop>,
    /// Layers that an export wants, shown or not.
    exported: BTreeSet<LayerId>,
    rectangle_m: [f32; 4],
    info_request: Option<(RequestId, Monotonic)>,
    last_view_sent: Option<Monotonic>,
    requests: u64,
    seq: u64,
    /// Counts changes that somebody may want to draw at once.
    changes: u64,
    /// Counts what the sensors of a vehicle bring all the time, whatever it does.
    sensor_updates: u64,
}

impl ConsoleModel {
    /// A robot of which nothing is known.
    ///
    /// # Errors
    /// Where zstd cannot be set up.
    pub fn new(settings: ModelSettings) -> io::Result<Self> {
        let mut map = MapSync::new(settings.tile_store_mb)?;
        map.set_wanted(settings.layers.clone(), [0.0; 2]);
        Ok(Self {
            settings,
            map,
            vehicle: Vehicle::default(),
            shores: ShoresSync::default(),
            saved_site_names: None,
            voxels: VoxelsSync::default(),
            trajectory: TrajectorySync::default(),
            trail: TrailSync::default(),
            is_unfinished: false,
            scans: Scans::default(),
            wants_scan: false,
            connection: Connection::default(),
            quality: LinkQuality::default(),
            reject_counts: RejectCounts::default(),
            info: None,
            status: None,
            status_run: None,
            motion: Motion::default(),
            monitor_history: MonitorHistory::default(),
            ended_seq: None,
            head_seq: 0,
            events: VecDeque::new(),
            stop_before_estop: None,
            exported: BTreeSet::new(),
            rectangle_m: [0.0; 4],
            info_request: None,
            last_view_sent: None,
            requests: 0,
            seq: 0,
            changes: 0,
            sensor_updates: 0,
        })
    }

    /// Which robot.
    pub const fn robot(&self) -> &RobotId {
        &self.settings.robot
    }

    /// The map.
    pub const fn map(&self) -> &MapSync {
        &self.map
    }

    /// Whether the map equals what the robot announced, and that lately.
    pub fn is_synchronized(&self, now: Monotonic) -> bool {
        let head_at = self.map.head_at();
        head_at.is_some_and(|at| now.since(at) <= HEAD_LIFETIME) && self.matches_last_head()
    }

    /// Whether the map equals what the robot announced last, however long ago, and the shores are known, where there
    /// are any.
    pub fn matches_last_head(&self) -> bool {
        let knows_shores = !self.has_shores() || self.shores.is_current(self.ended_seq);
        self.map.is_synchronized() && knows_shores
    }

    /// Whether the robot tells of shores.
    pub fn has_shores(&self) -> bool {
        self.info().is_some_and(|info| {
            info.layers
                .iter()
                .any(|layer| layer.layer == LayerId::Shore)
        })
    }

    /// Whether there is more to fetch once the map is synchronized: a robot whose data has ended waits for that.
    pub const fn set_unfinished(&mut self, is_unfinished: bool) {
        self.is_unfinished = is_unfinished;
    }

    /// The tiles that changed since the last call.
    pub fn take_changed_tiles(&mut self) -> BTreeSet<protocol::tile::TileKey> {
        self.map.take_changed()
    }

    /// Where it is.
    pub const fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// How the link does.
    pub const fn connection(&self) -> &Connection {
        &self.connection
    }

    /// How well it carries each stream.
    pub const fn link_quality(&self) -> &LinkQuality {
        &self.quality
    }

    /// What was not taken.
    pub const fn reject_counts(&self) -> &RejectCounts {
        &self.reject_counts
    }

    /// Who the robot is, once it has said so.
    pub fn info(&self) -> Option<&Info> {
        self.info.as_ref().map(|(info, _)| info)
    }

    /// How the robot is doing, and when it said so.
    pub const fn status(&self) -> Option<&(Status, Monotonic)> {
        self.status.as_ref()
    }

    /// The robot's sensors, as it describes them; empty before it has.
    pub fn sensors(&self) -> &[SensorInfo] {
        self.info().map_or(&[], |info| &info.sensors)
    }

    /// How the sensors were doing when the robot said so last.
    pub fn sensor_statuses(&self) -> &[SensorStatus] {
        self.status
            .as_ref()
            .map_or(&[], |(status, _)| &status.sensors)
    }

    /// The recording on the robot when it told of it last; `None` where operators cannot start one.
    pub fn recording(&self) -> Option<&RecordingStatus> {
        self.status.as_ref()?.0.recording.as_ref()
    }

    /// The last sweep of each sensor that was heard, by name.
    pub fn scans(&self) -> impl Iterator<Item = (&str, &LastScan)> {
        self.scans.iter()
    }

    /// Asks for last sweeps, or for none any more. They cost up to a sixteenth of the tiles' share of the link.
    pub fn want_scan(&mut self, is_wanted: bool) {
        if self.wants_scan && !is_wanted {
            self.scans.forget();
            self.changes += 1;
        }
        self.wants_scan = is_wanted;
    }

    /// What happened, oldest first, and when it was heard.
    pub const fn events(&self) -> &VecDeque<(Event, Monotonic)> {
        &self.events
    }

    /// What the robot told of when an emergency stop was heard; `None` where no such was heard since it began to run.
    pub const fn stop_before_estop(&self) -> Option<StopBeforeEStop> {
        self.stop_before_estop
    }

    /// What is to be added to the ages of sensors that the robot told last. Nothing while its statuses come, twice a second: until
    /// the next one says so, a sensor that measures as it should has measured again.
    pub fn status_delay(&self, now: Monotonic) -> Duration {
        let since = self.status().map(|(_, at)| now.since(*at));
        since
            .filter(|since| *since >= STATUS_TIMEOUT)
            .unwrap_or_default()
    }

    /// Rises with every change that is to be seen at once.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// Rises with tiles and sweeps that were pushed, which come all the time. Who draws need not draw again while this
    /// and [`Self::changes`] stand still.
    pub const fn sensor_updates(&self) -> u64 {
        self.sensor_updates
    }

    /// Draws this way of the vehicle instead of the poses that arrived: oldest first, metres in `odom`.
    pub fn show_trail(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.vehicle.show_trail(points_m);
    }

    /// What is on the screen: lowest and greatest x and y in `odom`, metres, and the layers that are wanted.
    pub fn set_view(&mut self, rectangle_m: [f32; 4], layers: BTreeSet<LayerId>) {
        if rectangle_m.iter().all(|edge| edge.is_finite()) {
            self.rectangle_m = rectangle_m;
            self.settings.layers = layers;
            self.update_wanted_layers();
        }
    }

    fn update_wanted_layers(&mut self) {
        let [low_x, low_y, high_x, high_y] = self.rectangle_m.map(f64::from);
        let focus_m = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)];
        self.map.set_wanted(self.wanted_layers(), focus_m);
    }

    /// The layers that are asked for.
    fn wanted_layers(&self) -> BTreeSet<LayerId> {
        &self.settings.layers | &self.exported
    }

    /// Takes what the link brought. Whatever it is, nothing panics and nothing grows without limit.
    pub fn apply(&mut self, incoming: Incoming, now: Monotonic) {
        let taken = match incoming {
            Incoming::Sample { key, payload } => {
                self.connection.add_bytes(payload.len(), now);
                self.take(&key, &payload, None, now)
            }
            Incoming::Reply {
                request,
                key,
                payload,
            } => {
                self.connection.add_bytes(payload.len(), now);
                self.take(&key, &payload, Some(request), now)
            }
            Incoming::Ended { request } => {
                let is_taken = self.shores.ended(request, now)
                    || self.voxels.ended(request, now)
                    || self.trajectory.ended(request, now)
                    || self.trail.ended(request, now);
                if !is_taken {
                    self.map.ended(request, now);
                }
                Ok(())
            }
            Incoming::Lost { overrun, oversized } => {
                self.reject_counts.add_many(RejectReason::Overrun, overrun);
                self.reject_counts
                    .add_many(RejectReason::Oversized, oversized);
                Ok(())
            }
            Incoming::Presence(is_present) => {
                self.connection.set_present(is_present);
                self.changes += 1;
                Ok(())
            }
        };
        match taken {
            Ok(()) => {}
            Err(why) => {
                tracing::debug!(why = why.name(), "a message was not taken");
                self.reject_counts.add(why);
            }
        }
    }
}

#[cfg(test)]
mod tests;
