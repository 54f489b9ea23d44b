//! One robot as this console knows it: messages in, questions out, everything else to be read.
//!
//! The model owns no thread, socket or clock: whoever holds it feeds it what the link brings, asks it what to
//! send, and draws or exports what it holds. The present is always a parameter.

mod ages;
mod connection;
mod ending;
mod exports;
mod following;
mod guarding;
mod history;
mod incoming;
mod kept_names;
mod layer_sync;
mod link_quality;
mod map_questions;
mod map_sync;
mod motion;
mod recent;
mod refusals;
mod repeated;
mod scans;
mod sending;
mod shore_outlines;
mod shores_sync;
mod sight;
mod site_names;
mod soundness;
mod stillness;
mod taking;
mod tile_intake;
mod trail;
mod trail_sync;
mod trajectory_sync;
mod vehicle;
mod voxels_sync;

use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{
    Event, Info, RecordingStatus, SensorInfo, SensorStatus, Status, StopReason,
};
use protocol::tile::BootId;
use robot_edge::clock::Monotonic;

pub use ages::{AgeOrder, Ages};
pub use connection::{Connection, HeardBefore, LinkState, SILENT_AFTER, SLOWLY_SILENT_AFTER};
pub use guarding::{Guarding, LEAST_MPS, LEAST_RADPS, way};
pub use incoming::{Incoming, OpenSessions, Outgoing, RequestId};
pub use kept_names::KeptSiteNames;
pub use link_quality::{LinkQuality, LinkSample, Stream};
pub use map_sync::{LayerStep, MapSync};
pub use motion::{DRIFTING_MPS, OwnMotion};
pub use refusals::{Refusal, Refusals};
pub use scans::LastScan;
pub use shore_outlines::{Neighbour, Outline, ShoreOutlines};
pub use site_names::{SiteName, SiteNames};
pub use trajectory_sync::TrajectoryProgress;
pub use vehicle::Vehicle;
pub use voxels_sync::{FetchedVoxels, VoxelsProgress};

use guarding::Guardings;
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
const STATUSES_COME: Duration = Duration::from_millis(1500);

/// What a console is and wants.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelSettings {
    /// The robot.
    pub robot: RobotId,
    /// This run of the console: random.
    pub session: BootId,
    /// Most memory for tiles, megabytes (10⁶ bytes).
    pub store_mb: u32,
    /// The layers that are wanted.
    pub layers: BTreeSet<LayerId>,
}

/// What a robot told of when an emergency stop was heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BeforeEStop {
    /// The last stop on the way.
    pub last_stop: Option<StopReason>,
}

/// One robot. See the [module](self).
pub struct ConsoleModel {
    settings: ModelSettings,
    map: MapSync,
    vehicle: Vehicle,
    shores: ShoresSync,
    kept_names: Option<KeptSiteNames>,
    voxels: VoxelsSync,
    trajectory: TrajectorySync,
    trail: TrailSync,
    is_unfinished: bool,
    scans: Scans,
    wants_scan: bool,
    connection: Connection,
    quality: LinkQuality,
    refusals: Refusals,
    info: Option<(Info, BootId)>,
    status: Option<(Status, Monotonic)>,
    /// The run of the robot that told it.
    status_run: Option<BootId>,
    motion: Motion,
    guardings: Guardings,
    /// The number of the message that first said that the robot's data has ended, and of the newest head.
    ended_seq: Option<u64>,
    head_seq: u64,
    events: VecDeque<(Event, Monotonic)>,
    /// The last stop on the way that was told of when an emergency stop was heard last, in this run of the robot.
    before_estop: Option<BeforeEStop>,
    /// Layers that an export wants, shown or not.
    exported: BTreeSet<LayerId>,
    rectangle_m: [f32; 4],
    asked_info: Option<(RequestId, Monotonic)>,
    told_view: Option<Monotonic>,
    requests: u64,
    seq: u64,
    /// Counts changes that somebody may want to draw at once.
    changes: u64,
    /// Counts what the sensors of a vehicle bring all the time, whatever it does.
    surveys: u64,
}

impl ConsoleModel {
    /// A robot of which nothing is known.
    ///
    /// # Errors
    /// Where zstd cannot be set up.
    pub fn new(settings: ModelSettings) -> io::Result<Self> {
        let mut map = MapSync::new(settings.store_mb)?;
        map.set_wanted(settings.layers.clone(), [0.0; 2]);
        Ok(Self {
            settings,
            map,
            vehicle: Vehicle::default(),
            shores: ShoresSync::default(),
            kept_names: None,
            voxels: VoxelsSync::default(),
            trajectory: TrajectorySync::default(),
            trail: TrailSync::default(),
            is_unfinished: false,
            scans: Scans::default(),
            wants_scan: false,
            connection: Connection::default(),
            quality: LinkQuality::default(),
            refusals: Refusals::default(),
            info: None,
            status: None,
            status_run: None,
            motion: Motion::default(),
            guardings: Guardings::default(),
            ended_seq: None,
            head_seq: 0,
            events: VecDeque::new(),
            before_estop: None,
            exported: BTreeSet::new(),
            rectangle_m: [0.0; 4],
            asked_info: None,
            told_view: None,
            requests: 0,
            seq: 0,
            changes: 0,
            surveys: 0,
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
    pub fn is_in_step(&self, now: Monotonic) -> bool {
        let head_at = self.map.head_at();
        head_at.is_some_and(|at| now.since(at) <= HEAD_LIFETIME) && self.holds_what_was_announced()
    }

    /// Whether the map equals what the robot announced last, however long ago, and the shores are known, where there
    /// are any.
    pub fn holds_what_was_announced(&self) -> bool {
        let knows_shores = !self.has_shores() || self.shores.is_told(self.ended_seq);
        self.map.is_in_step() && knows_shores
    }

    /// Whether the robot tells of shores.
    pub fn has_shores(&self) -> bool {
        self.info().is_some_and(|info| {
            info.layers
                .iter()
                .any(|layer| layer.layer == LayerId::Shore)
        })
    }

    /// Whether there is more to fetch once the map is in step: a robot whose data has ended waits for that.
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
    pub const fn refusals(&self) -> &Refusals {
        &self.refusals
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
    pub const fn before_estop(&self) -> Option<BeforeEStop> {
        self.before_estop
    }

    /// What is to be added to the ages of sensors that the robot told last. Nothing while its statuses come, twice a second: until
    /// the next one says so, a sensor that measures as it should has measured again.
    pub fn since_statuses(&self, now: Monotonic) -> Duration {
        let since = self.status().map(|(_, at)| now.since(*at));
        since
            .filter(|since| *since >= STATUSES_COME)
            .unwrap_or_default()
    }

    /// Rises with every change that is to be seen at once.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// Rises with tiles and sweeps that were pushed, which come all the time. Who draws need not draw again while this
    /// and [`Self::changes`] stand still.
    pub const fn surveys(&self) -> u64 {
        self.surveys
    }

    /// Draws this way of the vehicle instead of the poses that arrived: oldest first, metres in `odom`.
    pub fn show_trail(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.vehicle.show_trail(points_m);
    }

    /// What is on the screen: lowest and greatest x and y in `odom`, metres, and the layers that are wanted.
    pub fn look_at(&mut self, rectangle_m: [f32; 4], layers: BTreeSet<LayerId>) {
        if rectangle_m.iter().all(|edge| edge.is_finite()) {
            self.rectangle_m = rectangle_m;
            self.settings.layers = layers;
            self.follow();
        }
    }

    fn follow(&mut self) {
        let [low_x, low_y, high_x, high_y] = self.rectangle_m.map(f64::from);
        let focus_m = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)];
        self.map.set_wanted(self.followed(), focus_m);
    }

    /// The layers that are asked for.
    fn followed(&self) -> BTreeSet<LayerId> {
        &self.settings.layers | &self.exported
    }

    /// Takes what the link brought. Whatever it is, nothing panics and nothing grows without limit.
    pub fn apply(&mut self, incoming: Incoming, now: Monotonic) {
        let taken = match incoming {
            Incoming::Sample { key, payload } => {
                self.connection.arrived(payload.len(), now);
                self.take(&key, &payload, None, now)
            }
            Incoming::Reply {
                request,
                key,
                payload,
            } => {
                self.connection.arrived(payload.len(), now);
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
                self.refusals.add_many(Refusal::Overrun, overrun);
                self.refusals.add_many(Refusal::Oversized, oversized);
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
                self.refusals.add(why);
            }
        }
    }
}

#[cfg(test)]
mod tests;
