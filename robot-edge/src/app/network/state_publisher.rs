//! What consoles and the guard hear of at once, whatever mapping is doing: poses, sweeps, sensors, figures.

use std::sync::Arc;
use std::time::Duration;

use protocol::message::{self, RecordingStatus, Status};

use super::super::data_clock::DataClock;
use super::super::map_stats::MapStats;
use super::super::status_message::build_status;
use super::sensors::since_data_start;
use crate::clock;
use crate::driving::velocity_estimator::VelocityEstimator;
use crate::driving::{MonitorSensorInput, SharedDriveState};
use crate::events::event;
use crate::link::publish_state::PublishState;
use crate::sensor_monitor::SensorMonitor;
use crate::streaming::scan_downsampling::downsample_scan;
use localization::config::OnJump;
use localization::registration::RegistrationCounts;
use mapping::registered_scan::RegisteredScan;
use measurement::pose::Pose;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};

/// The placing side's end of the network. Nothing here waits for a map.
pub(in crate::app) struct StatePublisher {
    pub(super) publish_state: Arc<PublishState>,
    pub(super) drive_state: Option<Arc<SharedDriveState>>,
    pub(super) monitor_input: Option<MonitorSensorInput>,
    /// What becomes of the maps at a jump, and so of the ground that the guard judges by.
    pub(super) on_jump: OnJump,
    pub(super) velocity_estimator: VelocityEstimator,
    pub(super) sensors: SensorMonitor,
    /// What the sensors are watched by: since when the program lives, or nothing for the time of the data.
    pub(super) since: Option<Monotonic>,
    pub(super) published_sensors: Option<u32>,
    /// Stamp of the newest pose that was told.
    pub(super) last_pose_stamp: Option<RobotTime>,
}

impl StatePublisher {
    /// The clock of the data starts anew; `is_repeated` where the same data comes again.
    pub(in crate::app) fn reset_clock(&mut self, is_repeated: bool) {
        self.last_pose_stamp = None;
        if is_repeated {
            self.sensors.on_replay_restart();
        }
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.reset_clock();
        }
    }

    /// The data is wound: `elapsed` of its time has passed there.
    pub(in crate::app) fn seek(&mut self, elapsed: RobotDuration) {
        self.reset_clock(false);
        self.sensors.seek(since_data_start(elapsed));
    }

    /// Tells consoles and the guard where the vehicle is, unless it is older than what they know.
    pub(in crate::app) fn publish_pose(&mut self, (stamp, pose): (RobotTime, Pose)) {
        if self.last_pose_stamp.is_some_and(|last| stamp <= last) {
            return;
        }
        self.last_pose_stamp = Some(stamp);
        let measured = self.velocity_estimator.update(stamp, &pose);
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.update_odometry(stamp, &pose, measured, clock::now());
        }
        let q = pose.rotation.quaternion();
        self.publish_state.set_pose(
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
    pub(in crate::app) fn on_pose_jump(&mut self) -> Monotonic {
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.on_pose_jump();
            if self.on_jump == OnJump::Reset {
                monitor_input.reset_ground();
            }
        }
        Monotonic::default()
    }

    /// Tells the guard and consoles what a scan sees. When it was measured, on this machine's clock, at the latest.
    pub(in crate::app) fn publish_scan(&mut self, scan: &RegisteredScan) -> Monotonic {
        // Where scans bring their poses, these are all there are.
        self.publish_pose((scan.stamp, scan.odom_from_base));
        let now = clock::now();
        let measured_at = match &mut self.monitor_input {
            Some(monitor_input) => monitor_input.add_scan(scan, now),
            None => now,
        };
        let is_blocked = |monitor_input: &MonitorSensorInput| monitor_input.is_blocked(scan.sensor);
        let is_blocked = self.monitor_input.as_ref().is_some_and(is_blocked);
        self.sensors.on_registered_scan(scan, is_blocked);
        if self.publish_state.wants_scan()
            && let Some(name) = self.sensors.name(scan.sensor)
            && let Some(shown) = downsample_scan(name, scan)
        {
            self.publish_state.set_scan(scan.sensor, scan.stamp, shown);
        }
        measured_at
    }

    /// Tells consoles how it is going.
    pub(in crate::app) fn publish_status(
        &mut self,
        counts: RegistrationCounts,
        maps: &MapStats,
        (clock, lost): (&DataClock, u64),
        recording: Option<RecordingStatus>,
    ) {
        let now = match self.since {
            Some(since) => clock::elapsed(since),
            None => since_data_start(clock.elapsed()),
        };
        self.check_sensors(now);
        self.sensors.count(&counts);
        self.publish_state.set_status(Status {
            sensors: self.sensors.statuses(now),
            recording,
            ..build_status(maps, counts, clock, lost)
        });
    }

    /// Whether an operator wants a recording to run, since the last call.
    pub(in crate::app) fn take_recording_request(&self) -> Option<bool> {
        self.drive_state.as_ref()?.take_recording_request()
    }

    /// Tells consoles whether a recording runs.
    pub(in crate::app) fn set_recording(&self, is_running: bool) {
        if let Some(drive_state) = &self.drive_state {
            drive_state.set_recording(is_running);
        }
    }

    /// Something happened that consoles should know.
    pub(in crate::app) fn publish_event(&self, kind: &str, message: &str) {
        self.publish_state
            .publish_event(event(kind, message.to_owned()));
    }

    /// The newest pose that consoles were told.
    #[cfg(test)]
    pub(in crate::app) fn published_pose(&self) -> Option<RobotTime> {
        self.publish_state.pose().map(|(stamp, _)| stamp)
    }

    /// Time on the clock by which sensors are watched, of what could be known since `received_at`.
    pub(super) fn monitor_time(&self, received_at: Monotonic, elapsed: RobotDuration) -> Duration {
        match self.since {
            Some(since) => received_at.since(since),
            None => since_data_start(elapsed),
        }
    }
}

#[cfg(test)]
mod tests;
