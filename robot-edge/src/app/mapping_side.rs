//! The second stage of a run: maps what was placed, publishes it, and tells of that.

use std::sync::Arc;
use std::time::Duration;

use super::data_clock::DataClock;
use super::event_log::EventLog;
use super::map_figures::SharedMapFigures;
use super::network::Network;
use super::step::{Lateness, Step};
use crate::clock::Monotonic;
use crate::drops::DropReason;
use crate::keeping_up::{Change, KeepingUp};
use crate::localization::placer::Placed;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::pipeline::{Happening, Maps, ScanObserver, Standstill};
use crate::replay_control::{Mark, ReplayControl};
use crate::streaming::publisher::PublishError;
use crate::streaming::trajectory::SharedTrajectory;

/// A scan that has waited longer for mapping is left out, where the present matters …
pub(super) const LONGEST_LAG: Duration = Duration::from_secs(2);
/// … with all behind it, up to the first that has waited no longer than this: else every one that is mapped would have waited
/// for nearly as long, and the guard never had a map that is of the present.
pub(super) const CAUGHT_UP: Duration = Duration::from_millis(250);

/// What takes the steps of the placing side.
pub(super) struct MappingSide {
    pub(super) maps: Maps,
    pub(super) network: Option<Network>,
    pub(super) trajectory: SharedTrajectory,
    /// What happened on the way, for the summary.
    pub(super) events: EventLog,
    pub(super) keeping_up: KeepingUp,
    /// The present matters: where mapping cannot keep up, it maps less and not later.
    pub(super) is_live: bool,
    /// Scans are left out until one comes that has hardly waited.
    pub(super) catches_up: bool,
    /// Where a replay can be wound: what happens again is not told again.
    pub(super) marking: Option<Marking>,
    /// For the placing side.
    pub(super) figures: SharedMapFigures,
}

/// Marks what happens on the time line of a replay.
pub(super) struct Marking {
    pub(super) control: ReplayControl,
    /// Time of the data since the first scan.
    pub(super) clock: DataClock,
}

impl MappingSide {
    /// Maps a step.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn take(&mut self, step: Step) -> Result<(), PublishError> {
        self.take_at(step, Monotonic::now())
    }

    /// The same at `now`.
    pub(super) fn take_at(&mut self, step: Step, now: Monotonic) -> Result<(), PublishError> {
        match step {
            Step::ClockReset => self.maps.reset_clock(),
            Step::Placed {
                placed: Placed::Scan(_),
                since,
                ..
            } if self.is_too_late(now.since(since)) => {
                // That costs nothing: what waits behind it is soon young enough.
                self.maps.leave_out(DropReason::QueueFull);
            }
            Step::Placed { placed, taken, .. } => self.map(&placed, taken)?,
            Step::Told { lateness, datum } => {
                self.maps.set_datum(datum);
                self.look_whether_it_keeps_up(lateness);
                self.tell_network();
            }
        }
        Ok(())
    }

    /// Whether a scan that has waited so long for mapping is left out.
    fn is_too_late(&mut self, waited: Duration) -> bool {
        let longest = if self.catches_up {
            CAUGHT_UP
        } else {
            LONGEST_LAG
        };
        self.catches_up = self.is_live && waited > longest;
        self.catches_up
    }

    fn map(&mut self, placed: &Placed, taken: Monotonic) -> Result<(), PublishError> {
        let mut watch = Watch {
            trajectory: &self.trajectory,
            network: self.network.as_mut(),
            marking: self.marking.as_ref(),
            taken,
        };
        self.maps.take(placed, &mut watch)
    }

    /// Tells consoles where this machine does not keep up: whoever drives would see the past.
    fn look_whether_it_keeps_up(&mut self, lateness: Option<Lateness>) {
        let Some((network, lateness)) = self.network.as_ref().zip(lateness) else {
            return;
        };
        let now = Monotonic::now();
        match self.keeping_up.look(lateness.at(now), now) {
            Some(Change::Behind(late)) => {
                let late_s = late.as_secs_f64();
                let message =
                    format!("The robot's machine does not keep up: maps are {late_s:.1} s behind");
                tracing::warn!(message);
                network.tell("too_slow", &message);
            }
            Some(Change::Up) => network.tell("keeps_up", "The robot's machine keeps up again"),
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
        self.tell_network();
        finished
    }

    /// Publishes the maps as if the data ended here, with the scans that `waiting` holds.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn stand_still(&mut self, waiting: Vec<Placed>) -> Result<Standstill, PublishError> {
        let trajectory = &self.trajectory;
        let of_those_that_wait = |scan: &PosedScan| trajectory.lock().add_standing(scan);
        let mut standstill = self.maps.stand_still(waiting, of_those_that_wait)?;
        if let Some(network) = &self.network
            && let Some((stamp, shores)) = standstill.shores.take()
        {
            network.shores(stamp, Arc::new(shores));
        }
        self.tell_network();
        Ok(standstill)
    }

    /// Takes back what was published for a standstill: the data goes on.
    ///
    /// # Errors
    /// Where publishing stopped.
    pub(super) fn go_on(&mut self, standstill: Standstill) -> Result<(), PublishError> {
        let mut trajectory = self.trajectory.lock();
        let scans = trajectory.scans();
        trajectory.wind(scans);
        drop(trajectory);
        self.maps.go_on(standstill)
    }

    /// The maps were wound to where the data has had so many scans.
    pub(super) fn wind(&self, scans: u64) {
        self.trajectory.lock().wind(scans);
        if let Some(network) = &self.network {
            network.no_shores_yet(&self.maps);
            if let Some((stamp, shores)) = self.maps.known_shores() {
                network.shores(stamp, Arc::new(shores));
            }
        }
    }

    /// Gives consoles the octree's files that they asked for, while nothing is mapped.
    pub(super) fn serve_voxels(&self, standstill: &Standstill) {
        if let Some(network) = &self.network {
            network.serve_voxels_of(&self.maps, standstill);
        }
    }

    fn tell_network(&mut self) {
        for happening in self.maps.take_happenings() {
            let is_new = self
                .marking
                .as_ref()
                .is_none_or(|marking| marking.mark(&happening));
            if !is_new {
                continue;
            }
            if let Some(network) = &self.network {
                network.tell(happening.kind, &happening.message);
            }
            self.events.add(happening);
        }
        self.figures.set(self.maps.report());
        let Some(network) = &self.network else {
            drop(self.maps.take_changed_tiles());
            return;
        };
        if let Some((stamp, shores)) = self.maps.take_shores() {
            network.shores(stamp, Arc::new(shores));
        }
        network.tell_changes(&mut self.maps);
    }
}

impl Marking {
    /// Whether this did not happen in an earlier round.
    fn mark(&self, happening: &Happening) -> bool {
        self.control.mark(Mark {
            at: self.clock.at(happening.stamp),
            kind: happening.kind,
            message: happening.message.clone(),
        })
    }
}

/// What is told of scans as they pass.
struct Watch<'a> {
    trajectory: &'a SharedTrajectory,
    network: Option<&'a mut Network>,
    marking: Option<&'a Marking>,
    /// When the scan was measured, on this machine's clock, at the latest.
    taken: Monotonic,
}

impl ScanObserver for Watch<'_> {
    fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper) {
        self.trajectory.lock().add(scan);
        if let Some(marking) = self.marking {
            let position_m = scan.odom_from_base.translation.vector;
            marking.control.pass([position_m.x, position_m.y]);
        }
        if let Some(network) = &mut self.network {
            network.mapped(scan, mapper, self.taken);
        }
    }
}
