//! What consoles and the guard hear of at once, whatever mapping is doing: poses, sweeps, sensors, figures.

use std::sync::Arc;
use std::time::Duration;

use protocol::message::{self, RecordingStatus, Status};

use super::super::data_clock::DataClock;
use super::super::map_figures::MapFigures;
use super::super::told::status;
use super::sensors::of_data;
use crate::clock::Monotonic;
use crate::driving::speedometer::Speedometer;
use crate::driving::{Board, Lookout};
use crate::events::event;
use crate::link::shared::Shared;
use crate::localization::config::OnJump;
use crate::localization::placer::PlacerCounts;
use crate::mapping::posed_scan::PosedScan;
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::sensor_watch::SensorWatch;
use crate::streaming::last_scan::last_scan;

/// The placing side's end of the network. Nothing here waits for a map.
pub(in crate::app) struct Herald {
    pub(super) shared: Arc<Shared>,
    pub(super) board: Option<Arc<Board>>,
    pub(super) lookout: Option<Lookout>,
    /// What becomes of the maps at a jump, and so of the ground that the guard judges by.
    pub(super) on_jump: OnJump,
    pub(super) speedometer: Speedometer,
    pub(super) sensors: SensorWatch,
    /// What the sensors are watched by: since when the program lives, or nothing for the time of the data.
    pub(super) since: Option<Monotonic>,
    pub(super) told_sensors: Option<u32>,
    /// Stamp of the newest pose that was told.
    pub(super) moved: Option<RobotTime>,
}

impl Herald {
    /// The clock of the data starts anew; `is_repeated` where the same data comes again.
    pub(in crate::app) fn reset_clock(&mut self, is_repeated: bool) {
        self.moved = None;
        if is_repeated {
            self.sensors.begin_again();
        }
        if let Some(lookout) = &mut self.lookout {
            lookout.reset_clock();
        }
    }

    /// The data is wound: `elapsed` of its time has passed there.
    pub(in crate::app) fn wind(&mut self, elapsed: RobotDuration) {
        self.reset_clock(false);
        self.sensors.wind(of_data(elapsed));
    }

    /// Tells consoles and the guard where the vehicle is, unless it is older than what they know.
    pub(in crate::app) fn moved(&mut self, (stamp, pose): (RobotTime, Pose)) {
        if self.moved.is_some_and(|last| stamp <= last) {
            return;
        }
        self.moved = Some(stamp);
        let measured = self.speedometer.see(stamp, &pose);
        if let Some(lookout) = &mut self.lookout {
            lookout.moved(stamp, &pose, measured, Monotonic::now());
        }
        let q = pose.rotation.quaternion();
        self.shared.set_pose(
            stamp,
            message::Pose {
                position_m: pose.translation.vector.into(),
                quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|part| part as f32),
                speed_mps: measured.linear_mps as f32,
                turn_rate_radps: measured.angular_radps as f32,
                token: None,
            },
        );
    }

    /// The poses jumped between the scans before and those to come. Nothing was measured with that: the oldest moment there is.
    pub(in crate::app) fn jumped(&mut self) -> Monotonic {
        if let Some(lookout) = &mut self.lookout {
            lookout.jumped();
            if self.on_jump == OnJump::Reset {
                lookout.forget_ground();
            }
        }
        Monotonic::default()
    }

    /// Tells the guard and consoles what a scan sees. When it was measured, on this machine's clock, at the latest.
    pub(in crate::app) fn placed(&mut self, scan: &PosedScan) -> Monotonic {
        // Where scans bring their poses, these are all there are.
        self.moved((scan.stamp, scan.odom_from_base));
        let now = Monotonic::now();
        let taken = match &mut self.lookout {
            Some(lookout) => lookout.see(scan, now),
            None => now,
        };
        let is_blocked = |lookout: &Lookout| lookout.is_blocked(scan.sensor);
        let is_blocked = self.lookout.as_ref().is_some_and(is_blocked);
        self.sensors.placed(scan, is_blocked);
        if self.shared.wants_scan()
            && let Some(name) = self.sensors.name(scan.sensor)
            && let Some(shown) = last_scan(name, scan)
        {
            self.shared.set_scan(scan.sensor, scan.stamp, shown);
        }
        taken
    }

    /// Tells consoles how it is going.
    pub(in crate::app) fn tell_status(
        &mut self,
        counts: PlacerCounts,
        maps: &MapFigures,
        (clock, lost): (&DataClock, u64),
        recording: Option<RecordingStatus>,
    ) {
        let now = match self.since {
            Some(since) => since.elapsed(),
            None => of_data(clock.elapsed()),
        };
        self.look_at_sensors(now);
        self.sensors.count(&counts);
        self.shared.set_status(Status {
            sensors: self.sensors.statuses(now),
            recording,
            ..status(maps, counts, clock, lost)
        });
    }

    /// Whether an operator wants a recording to run, since the last call.
    pub(in crate::app) fn take_recording_wish(&self) -> Option<bool> {
        self.board.as_ref()?.take_recording_wish()
    }

    /// Tells consoles whether a recording runs.
    pub(in crate::app) fn show_recording(&self, is_running: bool) {
        if let Some(board) = &self.board {
            board.show_recording(is_running);
        }
    }

    /// Something happened that consoles should know.
    pub(in crate::app) fn tell(&self, kind: &str, message: &str) {
        self.shared.tell(event(kind, message.to_owned()));
    }

    /// The newest pose that consoles were told.
    #[cfg(test)]
    pub(in crate::app) fn told_pose(&self) -> Option<RobotTime> {
        self.shared.pose().map(|(stamp, _)| stamp)
    }

    /// Time on the clock by which sensors are watched, of what could be known since `came`.
    pub(super) fn watched_at(&self, came: Monotonic, elapsed: RobotDuration) -> Duration {
        match self.since {
            Some(since) => came.since(since),
            None => of_data(elapsed),
        }
    }
}

#[cfg(test)]
mod tests;
