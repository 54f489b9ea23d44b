//! Queued scans of one range sensor.

use std::collections::VecDeque;

use mapping::registered_scan::{RegisteredScan, ScanKind};
use measurement::cloud::Cloud;
use measurement::drops::{DropCounts, DropReason};
use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, StreamId};

use crate::beam_projection::{BeamProjector, BodyBox};
use crate::registration::{
    MountOrigin, RangeSensorSettings, RegistrationOutput, RegistrationSettings, SensorCounts,
};
use crate::transform_buffer::{TransformBuffer, TransformChain};

#[derive(Clone, Debug)]
pub(super) struct ScanQueue {
    pub(super) settings: RangeSensorSettings,
    pub(super) projector: BeamProjector,
    /// Frame of the tilted sensor in the transform tree. Frames of recordings never begin with a
    /// slash.
    pub(super) tilted_frame: FrameId,
    /// Delay of its scans, so that earlier ones of other sensors can arrive.
    pub(super) hold: RobotDuration,
    queue: VecDeque<QueuedScan>,
    newest_scan: RobotTime,
    scans_in: u64,
    scans_registered: u64,
    dropped_scans: DropCounts,
}

#[derive(Clone, Debug)]
pub(super) struct QueuedScan {
    pub(super) first_beam: RobotTime,
    pub(super) last_beam: RobotTime,
    /// Stamp of the data from which no earlier scan of another sensor can arrive.
    pub(super) release_at: RobotTime,
    pub(super) frame: FrameId,
    pub(super) sweep: Sweep,
}

/// What a range sensor measured at once.
#[derive(Clone, Debug)]
pub(crate) enum Sweep {
    Planar(Scan),
    /// With the stamp of the cloud, time offset applied.
    Cloud(Cloud, RobotTime),
}

impl ScanQueue {
    pub(super) fn new(settings: RangeSensorSettings, body: BodyBox) -> Self {
        let id = settings.beams.id;
        Self {
            projector: BeamProjector::new(settings.beams.clone(), body),
            tilted_frame: format!("/tilted sensor {}", id.0).into(),
            hold: RobotDuration::ZERO,
            queue: VecDeque::new(),
            newest_scan: RobotTime::MIN,
            scans_in: 0,
            scans_registered: 0,
            dropped_scans: DropCounts::default(),
            settings,
        }
    }

    pub(super) fn kind(&self) -> ScanKind {
        self.settings.beams.kind
    }

    pub(super) fn accepts(&self, stream: StreamId) -> bool {
        self.settings.stream.is_none_or(|own| own == stream)
    }

    /// Times of the first and last beam of what was received.
    pub(super) fn beam_times(
        &mut self,
        stamp: RobotTime,
        sweep: &Sweep,
    ) -> Option<(RobotTime, RobotTime)> {
        self.scans_in += 1;
        let first_beam = stamp + self.settings.beams.time_offset;
        let times = match sweep {
            Sweep::Planar(scan) => {
                let duration = scan.sweep_duration();
                duration.map(|duration| (first_beam, first_beam + duration))
            }
            Sweep::Cloud(cloud, stamp) => cloud.span(*stamp),
        };
        if times.is_none() {
            self.drop(DropReason::BadScan);
        }
        times
    }

    /// Queues a scan, unless it is older than the previous one or than `newest_out`.
    pub(super) fn enqueue(&mut self, scan: QueuedScan, newest_out: RobotTime, max_queued: usize) {
        if scan.first_beam < self.newest_scan.max(newest_out) {
            return self.drop(DropReason::Late);
        }
        self.newest_scan = scan.first_beam;
        if self.queue.len() >= max_queued.max(1) {
            self.queue.pop_front();
            self.drop(DropReason::QueueFull);
        }
        self.queue.push_back(scan);
    }

    pub(super) fn next(&self) -> Option<&QueuedScan> {
        self.queue.front()
    }

    pub(super) fn take_next(&mut self) -> Option<QueuedScan> {
        self.queue.pop_front()
    }

    /// Chain to a frame: `target_from_sensor = chain · mount`; `mount` is the identity if the tree
    /// contains the sensor.
    pub(super) fn chain<'a>(
        &self,
        tree: &'a TransformBuffer,
        target: &str,
        settings: &RegistrationSettings,
        sensor_frame: &FrameId,
    ) -> Option<(TransformChain<'a>, Pose)> {
        let own = &self.settings;
        let (source, mount) = match (own.mount, &own.tilt) {
            (MountOrigin::Tree, _) => (sensor_frame, Pose::identity()),
            (MountOrigin::Configured, Some(_)) => (&self.tilted_frame, Pose::identity()),
            (MountOrigin::Configured, None) => (&settings.base_frame, own.beams.base_from_sensor),
        };
        Some((tree.chain(target, source)?, mount))
    }

    pub(super) fn project(
        &mut self,
        sweep: &Sweep,
        first_beam: RobotTime,
        odom_from_base: Pose,
        odom_from_sensor_at: impl FnMut(RobotTime) -> Result<Pose, DropReason>,
    ) -> Result<RegisteredScan, DropReason> {
        let projector = &mut self.projector;
        match sweep {
            Sweep::Planar(scan) => {
                projector.project(scan, first_beam, odom_from_base, odom_from_sensor_at)
            }
            Sweep::Cloud(cloud, stamp) => {
                let times = (*stamp, first_beam);
                projector.project_cloud(cloud, times, odom_from_base, odom_from_sensor_at)
            }
        }
    }

    pub(super) fn drop(&mut self, reason: DropReason) {
        self.dropped_scans.add(reason);
    }

    pub(super) fn finish_scan(
        &mut self,
        registered: Result<RegisteredScan, DropReason>,
        out: &mut Vec<RegistrationOutput>,
    ) {
        match registered {
            Ok(registered) => {
                self.scans_registered += 1;
                out.push(RegistrationOutput::Scan(registered));
            }
            Err(reason) => self.drop(reason),
        }
    }

    pub(super) fn reset_clock(&mut self) {
        self.newest_scan = RobotTime::MIN;
    }

    pub(super) fn counts(&self) -> SensorCounts {
        SensorCounts {
            sensor: self.settings.beams.id,
            scans_in: self.scans_in,
            scans_registered: self.scans_registered,
            dropped_scans: self.dropped_scans.clone(),
            beams_in: self.projector.beams_in(),
            dropped_beams: self.projector.dropped_beams().clone(),
        }
    }
}

/// Limit of the delay in time of the data. Of sensors whose offsets differ by more, scans that
/// arrive too late for the order are dropped.
const MAX_HOLD: RobotDuration = RobotDuration::from_millis(1000);

/// Sets the delays: measurements arrive in stamp order, so a scan of a sensor whose offset is
/// smaller by `d` may arrive up to `d` late.
pub(super) fn set_holds(sensors: &mut [ScanQueue]) -> RobotDuration {
    let offset = |sensor: &ScanQueue| sensor.settings.beams.time_offset.as_nanos();
    let least = sensors.iter().map(offset).min().unwrap_or(0);
    let mut longest = RobotDuration::ZERO;
    for sensor in sensors {
        let behind = offset(sensor).saturating_sub(least);
        sensor.hold = RobotDuration::from_nanos(behind).min(MAX_HOLD);
        longest = longest.max(sensor.hold);
    }
    longest
}
