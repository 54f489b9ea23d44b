//! The second stage of a run: maps what was placed, publishes it, and tells of that.

use std::sync::Arc;
use std::time::Duration;

use super::data_clock::DataClock;
use super::event_log::EventLog;
use super::map_stats::SharedMapStats;
use super::mapping_input::{InputDelay, MappingInput};
use super::network::Network;
use crate::clock;
use crate::overload::{OverloadChange, OverloadMonitor};
use crate::pipeline::{MapEvent, Maps, PausedSnapshot, ScanObserver};
use crate::replay_control::{ReplayControl, TimelineMark};
use crate::streaming::publisher::PublishError;
use crate::streaming::trajectory::SharedTrajectory;
use localization::registration::RegistrationOutput;
use mapping::Mapper;
use mapping::registered_scan::RegisteredScan;
use measurement::drops::DropReason;
use measurement::time::Monotonic;

/// A scan that has waited longer for mapping is left out, where the present matters …
pub(super) const MAX_QUEUE_DELAY: Duration = Duration::from_secs(2);
/// … with all behind it, up to the first that has waited no longer than this: else every one that is mapped would have waited
/// for nearly as long, and the guard never had a map that is of the present.
pub(super) const RECOVERED_QUEUE_DELAY: Duration = Duration::from_millis(250);

/// What takes the steps of the placing side.
pub(super) struct MappingStage {
    pub(super) maps: Maps,
    pub(super) network: Option<Network>,
    pub(super) trajectory: SharedTrajectory,
    /// What happened on the way, for the summary.
    pub(super) events: EventLog,
    pub(super) overload: OverloadMonitor,
    /// The present matters: where mapping cannot keep up, it maps less and not later.
    pub(super) is_live: bool,
    /// Scans are left out until one comes that has hardly waited.
    pub(super) is_dropping: bool,
    /// Where a replay can be wound: what happens again is not told again.
    pub(super) timeline: Option<TimelineRecorder>,
    /// For the placing side.
    pub(super) stats: SharedMapStats,
}

/// Marks what happens on the time line of a replay.
pub(super) struct TimelineRecorder {
    pub(super) control: ReplayControl,
    /// Time of the data since the first scan.
    pub(super) clock: DataClock,
}

impl MappingStage {
    /// Maps a step.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn take(&mut self, input: MappingInput) -> Result<(), PublishError> {
        self.process_at(input, clock::now())
    }

    /// The same at `now`.
    pub(super) fn process_at(
        &mut self,
        input: MappingInput,
        now: Monotonic,
    ) -> Result<(), PublishError> {
        match input {
            MappingInput::ClockReset => self.maps.reset_clock(),
            MappingInput::Registered {
                placed: RegistrationOutput::Scan(_),
                since,
                ..
            } if self.is_expired(now.since(since)) => {
                // That costs nothing: what waits behind it is soon young enough.
                self.maps.count_dropped(DropReason::QueueFull);
            }
            MappingInput::Registered {
                placed,
                measured_at,
                ..
            } => self.map(&placed, measured_at)?,
            MappingInput::Tick { input_delay, datum } => {
                self.maps.set_datum(datum);
                self.check_overload(input_delay);
                self.publish();
            }
        }
        Ok(())
    }

    /// Whether a scan that has waited so long for mapping is left out.
    fn is_expired(&mut self, waited: Duration) -> bool {
        let longest = if self.is_dropping {
            RECOVERED_QUEUE_DELAY
        } else {
            MAX_QUEUE_DELAY
        };
        self.is_dropping = self.is_live && waited > longest;
        self.is_dropping
    }

    fn map(
        &mut self,
        placed: &RegistrationOutput,
        measured_at: Monotonic,
    ) -> Result<(), PublishError> {
        let mut observer = ScanPublisher {
            trajectory: &self.trajectory,
            network: self.network.as_mut(),
            timeline: self.timeline.as_ref(),
            measured_at,
        };
        self.maps.take(placed, &mut observer)
    }

    /// Tells consoles where this machine does not keep up: whoever drives would see the past.
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

    /// What is driven is told zero, and nobody drives it any more.
    pub(super) fn end_driving(&mut self) {
        if let Some(network) = &mut self.network {
            network.end_driving();
        }
    }

    /// The data has ended: publishes all that is mapped.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn finish(&mut self) -> Result<(), PublishError> {
        let finished = self.maps.finish();
        self.publish();
        finished
    }

    /// Publishes the maps as if the data ended here, with the scans that `waiting` holds.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn publish_paused(
        &mut self,
        waiting: Vec<RegistrationOutput>,
    ) -> Result<PausedSnapshot, PublishError> {
        let trajectory = &self.trajectory;
        let on_waiting_scan = |scan: &RegisteredScan| trajectory.lock().add_provisional(scan);
        let mut paused_snapshot = self.maps.publish_paused(waiting, on_waiting_scan)?;
        if let Some(network) = &self.network
            && let Some((stamp, shores)) = paused_snapshot.shores.take()
        {
            network.shores(stamp, Arc::new(shores));
        }
        self.publish();
        Ok(paused_snapshot)
    }

    /// Takes back what was published for a standstill: the data goes on.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn resume(&mut self, paused_snapshot: PausedSnapshot) -> Result<(), PublishError> {
        let mut trajectory = self.trajectory.lock();
        let scans = trajectory.scans();
        trajectory.seek(scans);
        drop(trajectory);
        self.maps.resume(paused_snapshot)
    }

    /// The maps were wound to where the data has had so many scans.
    pub(super) fn seek(&self, scans: u64) {
        self.trajectory.lock().seek(scans);
        if let Some(network) = &self.network {
            network.clear_shores(&self.maps);
            if let Some((stamp, shores)) = self.maps.current_shores() {
                network.shores(stamp, Arc::new(shores));
            }
        }
    }

    /// Gives consoles the octree's files that they asked for, while nothing is mapped.
    pub(super) fn serve_octree_files(&self, paused_snapshot: &PausedSnapshot) {
        if let Some(network) = &self.network {
            network.serve_paused_octree_files(&self.maps, paused_snapshot);
        }
    }

    fn publish(&mut self) {
        for map_event in self.maps.take_map_events() {
            let is_new = self
                .timeline
                .as_ref()
                .is_none_or(|timeline| timeline.mark(&map_event));
            if !is_new {
                continue;
            }
            if let Some(network) = &self.network {
                network.publish_event(map_event.kind, &map_event.message);
            }
            self.events.add(map_event);
        }
        self.stats.set(self.maps.report());
        let Some(network) = &self.network else {
            drop(self.maps.take_changed_tiles());
            return;
        };
        if let Some((stamp, shores)) = self.maps.take_shores() {
            network.shores(stamp, Arc::new(shores));
        }
        network.publish_changes(&mut self.maps);
    }
}

impl TimelineRecorder {
    /// Whether this did not happen in an earlier round.
    fn mark(&self, map_event: &MapEvent) -> bool {
        self.control.mark(TimelineMark {
            at: self.clock.at(map_event.stamp),
            kind: map_event.kind,
            message: map_event.message.clone(),
        })
    }
}

/// What is told of scans as they pass.
struct ScanPublisher<'a> {
    trajectory: &'a SharedTrajectory,
    network: Option<&'a mut Network>,
    timeline: Option<&'a TimelineRecorder>,
    /// When the scan was measured, on this machine's clock, at the latest.
    measured_at: Monotonic,
}

impl ScanObserver for ScanPublisher<'_> {
    fn mapped(&mut self, scan: &RegisteredScan, mapper: &Mapper) {
        self.trajectory.lock().add(scan);
        if let Some(timeline) = self.timeline {
            let position_m = scan.odom_from_base.translation.vector;
            timeline.control.add_point([position_m.x, position_m.y]);
        }
        if let Some(network) = &mut self.network {
            network.mapped(scan, mapper, self.measured_at);
        }
    }
}
