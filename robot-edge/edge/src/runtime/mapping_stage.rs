//! The second stage of the pipeline: integrates registered scans into the maps and publishes the changes.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::anyhow;

use super::batching_channel::{InputDelay, MappingInput};
use super::maps::{MapEvent, MapUpdate, Maps, MapsReport, PausedSnapshot};
use super::network::Network;
use super::saved_map;
use super::source::DataClock;
use super::tilt_control::TiltControl;
use crate::events;
#[cfg(feature = "foxglove")]
use crate::foxglove::FoxgloveOutput;
use crate::lock;
use crate::overload::{OverloadChange, OverloadMonitor};
use crate::publishing::output_inputs::OutputInputs;
use crate::publishing::publisher::PublishError;
use crate::publishing::trajectory::SharedTrajectory;
use crate::replay_control::{ReplayControl, TimelineMark};
use crate::ros2::{PlannerSession, RosOutput};
use crate::summary::Event;
use localization::registration::RegistrationOutput;
use localization::scan_localization::SavedMap;
use mapping::registered_scan::RegisteredScan;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::{self, Pose};
use measurement::time::{Monotonic, RobotTime};
use network::clock;
use protocol::export::StampedPose;

/// In a live run, a scan that waited longer for mapping is dropped.
pub(super) const MAX_QUEUE_DELAY: Duration = Duration::from_secs(2);
/// After a drop, scans are dropped until one has waited no longer than this. Otherwise every mapped scan would be nearly
/// [`MAX_QUEUE_DELAY`] old, and the collision monitor would never have a current map.
pub(super) const RECOVERED_QUEUE_DELAY: Duration = Duration::from_millis(250);
/// Events that the summary lists.
const MAX_EVENTS: usize = 1000;

pub(super) struct MappingStage {
    pub(super) maps: Maps,
    pub(super) network: Option<Network>,
    pub(super) trajectory: SharedTrajectory,
    pub(super) events: EventLog,
    pub(super) overload: OverloadMonitor,
    /// Late scans are dropped instead of mapped late.
    pub(super) is_live: bool,
    /// Scans are dropped until one has hardly waited.
    pub(super) is_dropping: bool,
    /// Present if the replay can seek: an event that is mapped again is not published again.
    pub(super) timeline: Option<TimelineRecorder>,
    pub(super) stats: SharedMapStats,
    pub(super) map_from_odom: SharedMapFromOdom,
    pub(super) tilt: Option<TiltControl>,
    pub(super) ros: Option<RosOutput>,
    pub(super) planner: Option<PlannerSession>,
    #[cfg(feature = "foxglove")]
    pub(super) foxglove: Option<FoxgloveOutput>,
    /// Of these three.
    pub(super) outputs: Vec<OutputInputs>,
    /// Where operators save maps, and what is being saved.
    pub(super) saved_maps: Option<PathBuf>,
    saving: Vec<(PathBuf, JoinHandle<anyhow::Result<()>>)>,
}

pub(super) struct TimelineRecorder {
    pub(super) control: ReplayControl,
    pub(super) clock: DataClock,
}

impl TimelineRecorder {
    /// Returns whether the event is new, and not a repetition after a seek.
    fn mark(&self, map_event: &MapEvent) -> bool {
        self.control.mark(TimelineMark {
            at: self.clock.at(map_event.stamp),
            kind: map_event.kind,
            message: map_event.message.clone(),
        })
    }
}

impl MappingStage {
    /// A stage without network.
    pub(super) fn new(maps: Maps) -> Self {
        Self {
            maps,
            network: None,
            trajectory: SharedTrajectory::default(),
            events: EventLog::default(),
            overload: OverloadMonitor::default(),
            is_live: false,
            is_dropping: false,
            timeline: None,
            stats: SharedMapStats::default(),
            map_from_odom: SharedMapFromOdom::default(),
            tilt: None,
            ros: None,
            planner: None,
            #[cfg(feature = "foxglove")]
            foxglove: None,
            outputs: Vec::new(),
            saved_maps: None,
            saving: Vec::new(),
        }
    }

    /// Processes one input. Returns the scan if it was mapped.
    pub(super) fn take(&mut self, input: MappingInput) -> anyhow::Result<Option<RegisteredScan>> {
        self.process_at(input, clock::now())
    }

    pub(super) fn process_at(
        &mut self,
        input: MappingInput,
        now: Monotonic,
    ) -> anyhow::Result<Option<RegisteredScan>> {
        match input {
            MappingInput::ClockReset => self.maps.reset_clock(),
            MappingInput::Registered {
                output: RegistrationOutput::Scan(scan),
                measured_at,
                queued_at,
            } => {
                if self.is_expired(now.since(queued_at)) {
                    self.maps.count_dropped(DropReason::QueueFull);
                } else {
                    self.map(&scan, measured_at)?;
                    return Ok(Some(scan));
                }
            }
            MappingInput::Registered {
                output: RegistrationOutput::Jump(jump),
                ..
            } => self.maps.on_pose_jump(&jump),
            MappingInput::Registered {
                output: RegistrationOutput::Corrected(way),
                ..
            } => {
                self.maps.correct(way);
                self.take_correction();
            }
            MappingInput::Registered {
                output: RegistrationOutput::Confidence(change),
                ..
            } => self.maps.on_confidence(change),
            MappingInput::SaveMap { name, map } => self.save_map(&name, *map),
            MappingInput::Tick { input_delay, datum } => {
                self.report_saved_maps(false);
                self.maps.set_datum(datum);
                self.check_overload(input_delay);
                self.publish();
            }
        }
        Ok(None)
    }

    /// Saves a map beside mapping: its scans may take seconds to copy.
    fn save_map(&mut self, name: &str, map: SavedMap) {
        let (Some(folder), Some(kept)) = (&self.saved_maps, self.maps.kept_scans()) else {
            return;
        };
        let path = folder.join(name);
        let saving = kept
            .snapshot()
            .map_err(anyhow::Error::from)
            .and_then(|scans| {
                let path = path.clone();
                let thread = thread::Builder::new().name("save-map".to_owned());
                Ok(thread.spawn(move || saved_map::save(&path, &map, scans))?)
            });
        match saving {
            Ok(thread) => self.saving.push((path, thread)),
            Err(error) => self.report_saved_map(&path, Err(error)),
        }
    }

    /// Says which maps were saved; `is_end`: waits for all.
    fn report_saved_maps(&mut self, is_end: bool) {
        let is_done = |(_, thread): &mut (PathBuf, JoinHandle<_>)| is_end || thread.is_finished();
        let done: Vec<_> = self.saving.extract_if(.., is_done).collect();
        for (path, thread) in done {
            let saved = thread
                .join()
                .unwrap_or_else(|_panic| Err(anyhow!("the thread failed")));
            self.report_saved_map(&path, saved);
        }
    }

    fn report_saved_map(&self, path: &Path, saved: anyhow::Result<()>) {
        let path = path.display();
        let (kind, message) = match saved {
            Ok(()) => ("map_saved", format!("{path}: the map is saved")),
            Err(error) => (
                "map_not_saved",
                format!("{path}: the map is not saved: {error:#}"),
            ),
        };
        tracing::info!(kind, message);
        if let Some(network) = &self.network {
            network.publish_event(kind, &message);
        }
    }

    fn is_expired(&mut self, waited: Duration) -> bool {
        let longest = if self.is_dropping {
            RECOVERED_QUEUE_DELAY
        } else {
            MAX_QUEUE_DELAY
        };
        self.is_dropping = self.is_live && waited > longest;
        self.is_dropping
    }

    fn map(&mut self, scan: &RegisteredScan, measured_at: Monotonic) -> anyhow::Result<()> {
        tracing::trace!(stamp = %scan.stamp, at_ns = clock::now().nanos(), "scan is mapped");
        let placed = self.maps.placed(scan);
        self.maps.integrate(&placed);
        self.trajectory.lock().add(&placed);
        if let Some(timeline) = &self.timeline {
            let position_m = placed.odom_from_base.translation.vector;
            timeline.control.add_point([position_m.x, position_m.y]);
        }
        // The collision monitor gets the map before publishing, which takes longer.
        if let Some(network) = &mut self.network {
            let map = (self.maps.mapper(), &self.maps.map_from_odom());
            network.update_monitor(scan, map, measured_at);
        }
        if let Some(tilt) = &mut self.tilt {
            tilt.update(&placed, self.maps.mapper());
        }
        self.maps.keep(scan)?;
        self.take_correction();
        Ok(self.maps.publish_if_due()?)
    }

    /// Corrects the poses of the mapped scans, if the maps were made again.
    fn take_correction(&mut self) {
        let Some((before, now)) = self.maps.take_correction() else {
            return;
        };
        self.trajectory.lock().correct(|pose| {
            let at = (now.session(), RobotTime::from_nanos(pose.stamp_ns));
            match (before.at(at), now.at(at)) {
                (Some(before), Some(now)) => moved(pose, &(now * before.inverse())),
                _ => *pose,
            }
        });
        self.map_from_odom.set(now.newest());
    }

    /// Publishes everything, at the end of the data.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        self.report_saved_maps(true);
        self.maps.finish_correction()?;
        self.take_correction();
        Ok(self.maps.finish()?)
    }

    /// Publishes an event if mapping cannot keep up: an operator would see an old map.
    fn check_overload(&mut self, input_delay: Option<InputDelay>) {
        let Some((network, input_delay)) = self.network.as_ref().zip(input_delay) else {
            return;
        };
        let now = clock::now();
        match self.overload.update(input_delay.at(now), now) {
            Some(OverloadChange::Started(delay)) => {
                let delay_s = delay.as_secs_f64();
                let message = format!("Overload: maps are {delay_s:.1} s behind");
                tracing::warn!(message);
                network.publish_event("overload", &message);
            }
            Some(OverloadChange::Cleared) => {
                network.publish_event("overload_cleared", "Overload is over: maps are up to date");
            }
            None => {}
        }
    }

    pub(super) fn end_driving(&mut self) {
        if let Some(network) = &mut self.network {
            network.end_driving();
        }
    }

    /// Publishes the maps as if the data ended here, including the `waiting` scans.
    pub(super) fn publish_paused(
        &mut self,
        waiting: Vec<RegistrationOutput>,
    ) -> Result<PausedSnapshot, PublishError> {
        let mut paused_snapshot = self.maps.publish_paused(waiting)?;
        let mut trajectory = self.trajectory.lock();
        for scan in paused_snapshot.waiting_scans() {
            trajectory.add_provisional(scan);
        }
        drop(trajectory);
        if let Some(network) = &self.network
            && let Some((stamp, shores)) = paused_snapshot.shores.take()
        {
            network.shores(stamp, Arc::new(shores));
        }
        self.publish();
        Ok(paused_snapshot)
    }

    /// Restores what [`Self::publish_paused`] replaced.
    pub(super) fn resume(&mut self, paused_snapshot: PausedSnapshot) -> Result<(), PublishError> {
        let mut trajectory = self.trajectory.lock();
        let scans = trajectory.scans();
        trajectory.seek(scans);
        drop(trajectory);
        self.maps.resume(paused_snapshot)
    }

    /// The maps were restored to the state after `scans` scans.
    pub(super) fn seek(&self, scans: u64) {
        self.trajectory.lock().seek(scans);
        self.map_from_odom.set(self.maps.map_from_odom());
        if let Some(network) = &self.network {
            network.clear_shores(&self.maps);
            if let Some((stamp, shores)) = self.maps.current_shores() {
                network.shores(stamp, Arc::new(shores));
            }
        }
    }

    pub(super) fn serve_octree_files(&self, paused_snapshot: &PausedSnapshot) {
        if let Some(network) = &self.network {
            network.serve_paused_octree_files(&self.maps, paused_snapshot);
        }
    }

    /// Sends events, shores and changed tiles to the consoles.
    pub(super) fn publish(&mut self) {
        let MapUpdate {
            changed_tiles,
            events,
        } = self.maps.take_update();
        self.stats.set(self.maps.report());
        for event in events {
            let is_new = self
                .timeline
                .as_ref()
                .is_none_or(|timeline| timeline.mark(&event));
            if !is_new {
                continue;
            }
            if let Some(network) = &self.network {
                network.publish_event(event.kind, &event.message);
            }
            for output in &self.outputs {
                output.add_event(
                    event.stamp,
                    events::event(event.kind, event.message.clone()),
                );
            }
            self.events.add(event);
        }
        let is_published = self.network.is_some() || !self.outputs.is_empty();
        if is_published && let Some((stamp, shores)) = self.maps.take_shores() {
            let shores = Arc::new(shores);
            for output in &self.outputs {
                output.set_shores(stamp, Arc::clone(&shores));
            }
            if let Some(network) = &self.network {
                network.shores(stamp, shores);
            }
        }
        if let Some(network) = &self.network {
            network.publish_tiles(changed_tiles);
            network.serve_octree_files(&self.maps, false);
        }
        self.serve_ros();
    }

    /// Hands the octree over to the ROS 2 system, if it is requested, and publishes what went wrong there.
    pub(super) fn serve_ros(&self) {
        let Some(ros) = &self.ros else {
            return;
        };
        if let Some((voxels, stamp)) = self.maps.mapper().voxels().zip(self.maps.last_scan()) {
            ros.inputs().offer_octree(stamp, voxels.octree());
        }
        for warning in ros.inputs().take_warnings() {
            if let Some(network) = &self.network {
                network.publish_event("ros2_output", &warning);
            }
        }
    }
}

/// The first [`MAX_EVENTS`] events of a run, and the number of the others.
#[derive(Debug, Default)]
pub(super) struct EventLog {
    events: Vec<Event>,
    omitted: u64,
}

impl EventLog {
    pub(super) const fn with_events(events: Vec<Event>) -> Self {
        Self { events, omitted: 0 }
    }

    fn add(&mut self, map_event: MapEvent) {
        if self.events.len() < MAX_EVENTS {
            self.events.push(Event {
                stamp_s: Some(map_event.stamp.as_secs_f64()),
                kind: map_event.kind.to_owned(),
                message: map_event.message,
            });
        } else {
            self.omitted += 1;
        }
    }

    pub(super) fn into_events(self) -> Vec<Event> {
        let mut events = self.events;
        if self.omitted > 0 {
            events.push(Event {
                stamp_s: None,
                kind: "events".to_owned(),
                message: format!(
                    "{} more happened, only the first {MAX_EVENTS} are listed",
                    self.omitted
                ),
            });
        }
        events
    }
}

/// Pose of `odom` in the maps that are served, for the poses and scans that are shown in them. It moves where a loop is closed.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedMapFromOdom(Arc<Mutex<Pose>>);

impl SharedMapFromOdom {
    pub(super) fn set(&self, map_from_odom: Pose) {
        *lock(&self.0) = map_from_odom;
    }

    pub(super) fn get(&self) -> Pose {
        *lock(&self.0)
    }
}

/// Counts of the maps that the localization stage publishes.
#[derive(Clone, Debug, Default)]
pub(super) struct MapStats {
    pub(super) scans_mapped: u64,
    /// Registered scans that were dropped, by reason.
    pub(super) dropped_scans: DropCounts,
    /// Beams that no layer used, by reason.
    pub(super) dropped_beams: DropCounts,
}

/// [`MapStats`] shared by both stages. The lock is held only for a copy.
#[derive(Clone, Debug, Default)]
pub(super) struct SharedMapStats(Arc<Mutex<MapStats>>);

impl SharedMapStats {
    fn set(&self, report: &MapsReport) {
        let stats = MapStats {
            scans_mapped: report.scans_mapped,
            dropped_scans: report.dropped_scans.clone(),
            dropped_beams: report.dropped_beams.clone(),
        };
        *lock(&self.0) = stats;
    }

    pub(super) fn get(&self) -> MapStats {
        lock(&self.0).clone()
    }
}

/// A pose of the map, after the map was moved there.
fn moved(pose: &StampedPose, by: &Pose) -> StampedPose {
    let [x, y, z, w] = pose.quaternion_xyzw();
    let Some(own) = pose::from_parts(pose.position_m(), [x, y, z, w]) else {
        return *pose;
    };
    let moved = by * own;
    let q = moved.rotation.quaternion();
    StampedPose::new(
        pose.stamp_ns,
        moved.translation.vector.into(),
        [q.i, q.j, q.k, q.w],
    )
}
