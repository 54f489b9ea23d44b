//! State of one robot in this console: takes messages from the link, decides what to request, holds the rest to be read.
//!
//! The model owns no thread, socket or clock. Its owner passes in messages and the current time, sends what
//! [`ConsoleModel::outgoing`] returns, and draws or exports the state.

mod handle_message;
mod layer_sync;
mod link_state;
mod localization;
mod map_sync;
mod messages;
mod monitor_history;
mod motion;
mod retry;
mod shore_outlines;
mod shores_sync;
mod tile_ages;
mod tile_intake;
mod trajectory_sync;
mod vehicle;
mod voxels_sync;

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{
    Barrier, DeviceStatus, Event, GoalStatus, Info, Plan, RecordingStatus, SensorInfo,
    SensorStatus, Shores, Status, StopReason, TeleopState, TeleopStatus,
};
use protocol::tile::{BootId, TileKey};

pub use link_state::{
    Connection, LastContact, LinkQuality, LinkSample, LinkState, SILENT_AFTER_UNSTEADY, Stream,
};
pub use localization::{LocalizationHistory, ellipse_95};
pub use map_sync::{LayerSyncState, MapSync};
pub use messages::{Incoming, OpenSessions, Outgoing, RejectCounts, RejectReason, RequestId};
pub use monitor_history::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS, MonitorReport, direction_signs};
pub use motion::{DRIFTING_MPS, UncommandedMotion};
pub use shore_outlines::{Neighbour, Outline, ShoreOutlines};
pub use tile_ages::{AgeOrder, TileAges};
pub use trajectory_sync::TrajectoryProgress;
pub use vehicle::{LastScan, Vehicle};
pub use voxels_sync::{FetchedVoxels, VoxelsProgress};

use monitor_history::MonitorHistory;
use motion::{MOVING, Motion};
use retry::RetryTimer;
use shores_sync::ShoresSync;
use trajectory_sync::{TrailSync, TrajectorySync};
use vehicle::Scans;
use voxels_sync::VoxelsSync;

const MAX_EVENTS: usize = 200;
/// Map heads come once a second. An older one does not describe the robot's present map.
const HEAD_LIFETIME: Duration = Duration::from_millis(2500);
/// Statuses come at least twice a second.
const STATUS_TIMEOUT: Duration = Duration::from_millis(1500);

#[derive(Clone, Debug, PartialEq)]
pub struct ModelSettings {
    pub robot: RobotId,
    /// Random number of this run of the console.
    pub session: BootId,
    pub tile_store_mb: u32,
    pub layers: BTreeSet<LayerId>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopBeforeEStop {
    pub last_stop: Option<StopReason>,
}

pub struct ConsoleModel {
    settings: ModelSettings,
    map: MapSync,
    vehicle: Vehicle,
    scans: Scans,
    robot: RobotState,
    events: VecDeque<(Event, Monotonic)>,
    shores: ShoresSync,
    voxels: VoxelsSync,
    trajectory: TrajectorySync,
    trail: TrailSync,
    connection: Connection,
    quality: LinkQuality,
    reject_counts: RejectCounts,
    view: ViewState,
    /// Numbers of the last request and of the last message.
    requests: u64,
    seq: u64,
    /// Counts changes that need a frame at once.
    changes: u64,
    /// Counts pushed tiles and scans, which arrive all the time.
    sensor_updates: u64,
}

#[derive(Default)]
struct RobotState {
    info: Option<(Info, BootId)>,
    info_query: RetryTimer,
    status: Option<(Status, Monotonic)>,
    /// The run of the robot that sent `status`.
    status_run: Option<BootId>,
    motion: Motion,
    monitor_history: MonitorHistory,
    localization: LocalizationHistory,
    /// The path of the planner.
    plan: Plan,
    stop_before_estop: Option<StopBeforeEStop>,
    /// Sequence number of the first message that reported the end of the data.
    ended_seq: Option<u64>,
    head_seq: u64,
}

impl RobotState {
    fn teleop(&self) -> Option<&TeleopStatus> {
        self.status.as_ref()?.0.teleop.as_ref()
    }

    fn begin_run(&mut self, boot: BootId) {
        self.stop_before_estop = None;
        self.monitor_history.forget();
        self.localization.begin_run(boot);
        self.plan = Plan::default();
        self.ended_seq = None;
        // The end of the last run's data does not end this run's data.
        self.status.take_if(|(status, _)| status.has_ended);
        self.info.take_if(|(_, info_boot)| *info_boot != boot);
    }
}

#[derive(Default)]
struct ViewState {
    rectangle_m: [f32; 4],
    exported: BTreeSet<LayerId>,
    is_unfinished: bool,
    last_sent: Option<Monotonic>,
}

impl ConsoleModel {
    pub fn new(settings: ModelSettings) -> Self {
        let mut map = MapSync::new(settings.tile_store_mb);
        map.set_wanted(settings.layers.clone(), [0.0; 2]);
        Self {
            settings,
            map,
            vehicle: Vehicle::default(),
            scans: Scans::default(),
            robot: RobotState::default(),
            events: VecDeque::new(),
            shores: ShoresSync::default(),
            voxels: VoxelsSync::default(),
            trajectory: TrajectorySync::default(),
            trail: TrailSync::default(),
            connection: Connection::default(),
            quality: LinkQuality::default(),
            reject_counts: RejectCounts::default(),
            view: ViewState::default(),
            requests: 0,
            seq: 0,
            changes: 0,
            sensor_updates: 0,
        }
    }

    pub const fn robot(&self) -> &RobotId {
        &self.settings.robot
    }

    pub const fn map(&self) -> &MapSync {
        &self.map
    }

    pub fn is_synchronized(&self, now: Monotonic) -> bool {
        let head_at = self.map.head_at();
        head_at.is_some_and(|at| now.since(at) <= HEAD_LIFETIME) && self.matches_last_head()
    }

    /// Whether the map equals the newest map head, of any age, and the shores are known if the robot has any.
    pub fn matches_last_head(&self) -> bool {
        let knows_shores = !self.has_shores() || self.shores.is_current(self.robot.ended_seq);
        self.map.matches_head() && knows_shores
    }

    pub fn has_shores(&self) -> bool {
        let layers = self.info().map_or(&[][..], |info| &info.layers);
        layers.iter().any(|layer| layer.layer == LayerId::Shore)
    }

    /// Sets whether the console needs more data after the map is synchronized. A robot whose data has ended waits for it.
    pub const fn set_unfinished(&mut self, is_unfinished: bool) {
        self.view.is_unfinished = is_unfinished;
    }

    pub fn take_changed_tiles(&mut self) -> BTreeSet<TileKey> {
        self.map.take_changed()
    }

    pub const fn localization(&self) -> &LocalizationHistory {
        &self.robot.localization
    }

    /// Goals for a planner, by the last status.
    pub fn goal(&self) -> GoalStatus {
        self.robot
            .teleop()
            .map(|teleop| teleop.goal)
            .unwrap_or_default()
    }

    /// The path of the planner to the goal; without points where none runs.
    pub const fn plan(&self) -> &Plan {
        &self.robot.plan
    }

    pub const fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    pub const fn connection(&self) -> &Connection {
        &self.connection
    }

    pub const fn set_last_contact(&mut self, before: LastContact) {
        self.connection.before = Some(before);
    }

    pub const fn link_quality(&self) -> &LinkQuality {
        &self.quality
    }

    /// Share of the expected poses of the last 2 s that did not arrive, 0 … 1. `None` if it is unknown whether the robot
    /// sends any: the link is silent or the robot's data has ended.
    pub fn poses_missing(&self, now: Monotonic) -> Option<f32> {
        let is_live = self.connection.state(now) == LinkState::Live;
        let is_sending = is_live && !self.reports_ended();
        self.quality.missing(now).filter(|_| is_sending)
    }

    pub const fn reject_counts(&self) -> &RejectCounts {
        &self.reject_counts
    }

    pub fn info(&self) -> Option<&Info> {
        self.robot.info.as_ref().map(|(info, _)| info)
    }

    pub const fn status(&self) -> Option<&(Status, Monotonic)> {
        self.robot.status.as_ref()
    }

    pub fn run(&self) -> Option<BootId> {
        self.map.boot()
    }

    /// Whether the robot restarted and has sent no status since. The status held is of an earlier run.
    pub fn awaits_status(&self) -> bool {
        let run = self.run();
        self.status().is_some() && run.is_some() && self.robot.status_run != run
    }

    pub fn sensors(&self) -> &[SensorInfo] {
        self.info().map_or(&[], |info| &info.sensors)
    }

    pub fn sensor_statuses(&self) -> &[SensorStatus] {
        self.status().map_or(&[], |(status, _)| &status.sensors)
    }

    /// Devices that the robot reads without a middleware.
    pub fn device_statuses(&self) -> &[DeviceStatus] {
        self.status().map_or(&[], |(status, _)| &status.devices)
    }

    /// The recording on the robot; `None` if operators cannot start one.
    pub fn recording(&self) -> Option<&RecordingStatus> {
        self.status()?.0.recording.as_ref()
    }

    /// What to add to the sensor ages of the last status. Zero while statuses arrive: a healthy sensor has measured again.
    pub fn status_delay(&self, now: Monotonic) -> Duration {
        let since = self.status().map(|(_, at)| now.since(*at));
        since
            .filter(|since| *since >= STATUS_TIMEOUT)
            .unwrap_or_default()
    }

    /// Whether the robot takes settings of operators.
    pub fn takes_settings(&self) -> bool {
        self.status()
            .is_some_and(|(status, _)| status.teleop.is_some())
    }

    pub fn reports_ended(&self) -> bool {
        self.status().is_some_and(|(status, _)| status.has_ended)
    }

    /// Whether the robot's data has ended and its last map head arrived: no more data will come.
    pub fn has_ended(&self) -> bool {
        let ended_seq = self.robot.ended_seq;
        ended_seq.is_some_and(|ended| self.robot.head_seq > ended)
    }

    /// Whether silence is expected because the robot's data has ended. Then the link is not lost.
    pub fn is_silence_expected(&self) -> bool {
        self.status().map_or_else(
            || {
                self.connection
                    .before
                    .is_some_and(|before| before.had_ended)
            },
            |(status, _)| status.has_ended,
        )
    }

    pub fn is_vehicle(&self) -> bool {
        self.robot.teleop().is_some()
    }

    pub fn is_boat(&self) -> bool {
        self.info().is_some_and(|info| info.is_boat)
    }

    fn floats(&self) -> bool {
        self.is_boat() || self.robot.teleop().is_some_and(|teleop| teleop.is_drifting)
    }

    /// Speed of a moving vehicle, m/s, negative backwards; `None` if it stands still.
    pub fn moves(&self) -> Option<f32> {
        let (pose, _) = self.vehicle.pose()?;
        let speed_mps = pose.ground_speed_mps();
        let is_moving = speed_mps.abs() >= MOVING || pose.turn_rate_radps.abs() >= MOVING;
        is_moving.then_some(speed_mps)
    }

    /// Whether the vehicle still moves because its stop command is recent. A boat does not brake.
    pub fn brakes(&self, now: Monotonic) -> bool {
        self.moves().is_some() && !self.floats() && self.robot.motion.braking.may_move(now)
    }

    /// Whether a simulated vehicle follows the route of its world, as it does until an operator drives or stops it.
    pub fn is_on_simulated_route(&self) -> bool {
        let is_simulated = self.info().is_some_and(|info| !info.source.is_empty());
        let is_undriven = self
            .robot
            .teleop()
            .is_some_and(|teleop| teleop.state == TeleopState::Idle && teleop.lease.epoch == 0);
        is_simulated && is_undriven && self.robot.stop_before_estop.is_none()
    }

    /// Why the vehicle moves although nobody drives it. `None` if it does not, or if its data is not recent.
    pub fn uncommanded_motion(&self, now: Monotonic) -> Option<UncommandedMotion> {
        let teleop = self.robot.teleop()?;
        let (_, at) = self.vehicle.pose()?;
        let is_fresh = self.connection.state(now) == LinkState::Live
            && now.since(at) <= SILENT_AFTER_UNSTEADY
            && !self.reports_ended()
            && !self.awaits_status();
        let is_undriven = teleop.state == TeleopState::Idle && !self.brakes(now);
        let speed_mps = self.moves().filter(|_| is_fresh && is_undriven)?;
        if self.floats() && !self.is_on_simulated_route() {
            (speed_mps.abs() > DRIFTING_MPS).then_some(UncommandedMotion::MaybeDrifting)
        } else {
            Some(UncommandedMotion::Autonomous)
        }
    }

    pub const fn is_still(&self) -> bool {
        self.robot.motion.standstill.is_still
    }

    pub fn is_stuck(&self) -> bool {
        self.robot.motion.stuck_detector.is_stuck()
    }

    /// States of the collision monitor in the 1.5 s before the newest status, oldest first. For display only.
    pub fn recent_monitor_states(&self) -> impl DoubleEndedIterator<Item = &MonitorReport> + Clone {
        self.robot.monitor_history.recent()
    }

    /// The newest recent barrier in the requested direction. The collision monitor may change its result with each scan.
    pub fn barrier(&self) -> Option<Barrier> {
        let mut recent = self.recent_monitor_states().rev().peekable();
        let requested = direction_signs(recent.peek()?.requested);
        recent
            .filter(|report| direction_signs(report.requested) == requested)
            .find_map(|report| report.barrier)
    }

    pub const fn events(&self) -> &VecDeque<(Event, Monotonic)> {
        &self.events
    }

    pub const fn stop_before_estop(&self) -> Option<StopBeforeEStop> {
        self.robot.stop_before_estop
    }

    pub fn scans(&self) -> impl Iterator<Item = (&str, &LastScan)> {
        self.scans
            .by_sensor
            .iter()
            .map(|(sensor, scan)| (sensor.as_str(), scan))
    }

    /// Requests scans or stops requesting them. They use up to a sixteenth of the tiles' share of the link.
    pub fn want_scan(&mut self, is_wanted: bool) {
        if self.scans.want(is_wanted) {
            self.changes += 1;
        }
    }

    pub const fn shores(&self) -> Option<&Shores> {
        self.shores.shores.as_ref()
    }

    /// Outlines of [`Self::shores`] and what is near their docking sites. Computed once for each report.
    pub const fn shore_outlines(&self) -> &ShoreOutlines {
        &self.shores.outlines
    }

    pub fn want_for_export(&mut self, layers: BTreeSet<LayerId>) {
        self.view.exported = layers;
        self.update_wanted_layers();
    }

    pub fn want_voxels(&mut self) {
        self.voxels.want();
    }

    pub fn drop_voxels(&mut self) {
        self.voxels = VoxelsSync::default();
    }

    pub fn voxels(&self) -> VoxelsProgress {
        self.voxels.progress.clone()
    }

    pub fn want_trajectory(&mut self) {
        self.trajectory.want();
    }

    pub fn drop_trajectory(&mut self) {
        self.trajectory = TrajectorySync::default();
    }

    pub fn trajectory(&self) -> TrajectoryProgress {
        self.trajectory.progress.clone()
    }

    /// Rises with each change that must be drawn at once.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// Rises with each pushed tile and scan. Without a change of this or of [`Self::changes`] no frame is needed.
    pub const fn sensor_updates(&self) -> u64 {
        self.sensor_updates
    }

    /// Replaces the trail by these points: oldest first, metres in `odom`.
    pub fn show_trail(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.vehicle.show_trail(points_m);
    }

    /// Sets the visible rectangle (lowest and greatest x and y in `odom`, metres) and the layers that are shown.
    pub fn set_view(&mut self, rectangle_m: [f32; 4], layers: BTreeSet<LayerId>) {
        if rectangle_m.iter().all(|edge| edge.is_finite()) {
            self.view.rectangle_m = rectangle_m;
            self.settings.layers = layers;
            self.update_wanted_layers();
        }
    }

    fn update_wanted_layers(&mut self) {
        let [low_x, low_y, high_x, high_y] = self.view.rectangle_m.map(f64::from);
        let focus_m = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)];
        self.map.set_wanted(self.wanted_layers(), focus_m);
    }

    fn wanted_layers(&self) -> BTreeSet<LayerId> {
        &self.settings.layers | &self.view.exported
    }
}

#[cfg(test)]
mod tests;
