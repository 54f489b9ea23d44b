//! Inputs of the collision monitor, exchanged through triple buffers.
//!
//! The localization thread writes poses and scans; the mapping thread writes the local map; the loop reads the newest
//! of each. No side waits for another.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Isometry2, Point2, UnitQuaternion};
use triple_buffer::{Input, Output, triple_buffer};

#[cfg(target_os = "linux")]
use crate::actuators::mavlink::obstacle_pipe::ObstacleSender;
use mapping::Mapper;
use mapping::ground_plane::{GroundPlane, GroundTracker};
use mapping::registered_scan::{RegisteredScan, ScanKind, SensorId};
use mapping::shore_layer::ShoreLayer;
use mapping::voxel_layers::VoxelLayers;
use measurement::pose::{self, Pose};
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use protocol::message::DockingChoice;
use teleop::collision_monitor::{
    Barrier, BlockageDetector, CollisionMonitor, CollisionMonitorInput, CollisionMonitorRules,
    CopyRequest, LocalMap, ObstacleScan, ObstaclesAround, OdometrySample, UnavailableReason,
};
use teleop::{CollisionMonitorOutput, Velocity};

/// The map is copied after so much time of the data, with the next scan of any sensor: between the sweeps of a slow one
/// with those of others.
const MAP_COPY_PERIOD: RobotDuration = RobotDuration::from_millis(100);
/// Period between copies that the collision monitor assumes; a copy is stale after 2.5 of them. Longer than
/// [`MAP_COPY_PERIOD`], because a scan of 200 ms waits for its poses and then for mapping, which adds to the copy's age.
const MAP_ASSUMED_PERIOD: Duration = Duration::from_millis(200);
/// Time from sweep to sweep until two have come.
const UNKNOWN_PERIOD: Duration = Duration::from_millis(100);
/// Of so many times from sweep to sweep the one in the middle counts.
const PERIOD_SAMPLES: usize = 9;

/// The localization thread's handle: it passes poses and scans to the collision monitor.
#[derive(Debug)]
pub struct MonitorSensorInput {
    rules: CollisionMonitorRules,
    sensors: Vec<Sensor>,
    odometry: Input<Option<OdometrySample>>,
    /// The ground plane as in mapping, but from each registered scan at once, because the map may lag by seconds. `None`
    /// if heights are not mapped.
    ground: Option<GroundTracker>,
    receive_times: ReceiveTimes,
    /// Where an autopilot wants to know of obstacles.
    #[cfg(target_os = "linux")]
    obstacle_sender: Option<ObstacleSender>,
}

/// The mapping thread's handle: it passes copies of the map.
#[derive(Debug)]
pub struct MonitorMapInput {
    rules: CollisionMonitorRules,
    map: Input<LocalMap>,
    copied: Option<RobotTime>,
}

#[derive(Debug)]
struct Sensor {
    obstacle_scans: Input<ObstacleScan>,
    blockage: BlockageDetector,
    last: Option<RobotTime>,
    gaps: VecDeque<Duration>,
}

/// The loop's end: the collision monitor and its newest inputs.
#[derive(Debug)]
pub struct MonitorRunner {
    monitor: CollisionMonitor,
    obstacle_scans: Vec<ObstacleScan>,
    newest_scans: Vec<Output<ObstacleScan>>,
    map: Output<LocalMap>,
    odometry: Output<Option<OdometrySample>>,
}

/// A collision monitor with `rules`, and its inputs from so many range sensors and from the map. `ground` is one
/// like that of the mapper, where heights are mapped; else each scan's ground is the plane under the vehicle.
pub fn monitor_input(
    rules: CollisionMonitorRules,
    sensors: usize,
    ground: Option<GroundTracker>,
) -> (MonitorSensorInput, MonitorMapInput, MonitorRunner) {
    let (inputs, newest_scans): (Vec<_>, _) = (0..sensors)
        .map(|_sensor| triple_buffer(&ObstacleScan::default()))
        .unzip();
    let (map_input, map) = triple_buffer(&LocalMap::default());
    let (odometry_input, odometry) = triple_buffer(&None);
    let sensor = |obstacle_scans| Sensor {
        obstacle_scans,
        blockage: BlockageDetector::default(),
        last: None,
        gaps: VecDeque::new(),
    };
    let monitor_input = MonitorSensorInput {
        rules,
        sensors: inputs.into_iter().map(sensor).collect(),
        odometry: odometry_input,
        ground,
        receive_times: ReceiveTimes::default(),
        #[cfg(target_os = "linux")]
        obstacle_sender: None,
    };
    let monitor_map_input = MonitorMapInput {
        rules,
        map: map_input,
        copied: None,
    };
    let monitor_runner = MonitorRunner {
        monitor: CollisionMonitor::new(rules),
        obstacle_scans: vec![ObstacleScan::default(); sensors],
        newest_scans,
        map,
        odometry,
    };
    (monitor_input, monitor_map_input, monitor_runner)
}

impl MonitorSensorInput {
    #[cfg(target_os = "linux")]
    pub fn send_obstacles_to(&mut self, sender: ObstacleSender) {
        self.obstacle_sender = Some(sender);
    }

    pub fn record_received(&mut self, stamp: RobotTime, received: Monotonic) {
        self.receive_times.record(stamp, received);
    }

    pub fn reset_clock(&mut self) {
        self.receive_times.clear();
        for sensor in &mut self.sensors {
            sensor.last = None;
            sensor.blockage.clear();
        }
    }

    /// The next scan gives a new ground: where the vehicle was before says nothing of where it is.
    pub fn reset_ground(&mut self) {
        if let Some(ground) = &mut self.ground {
            ground.clear();
        }
    }

    pub fn update_odometry(
        &mut self,
        stamp: RobotTime,
        pose: &Pose,
        measured: Velocity,
        now: Monotonic,
    ) {
        self.odometry.write(Some(OdometrySample {
            odom_from_base: *pose,
            measured,
            measured_at: self.receive_times.received_at(stamp, now),
        }));
    }

    /// Passes a registered scan, before it is in the map. Returns the time of this machine's clock at which it was
    /// measured, an upper bound.
    pub fn add_scan(&mut self, scan: &RegisteredScan, now: Monotonic) -> Monotonic {
        let measured_at = self.receive_times.received_at(scan.stamp, now);
        let plane = self.plane_below(scan);
        if let Some(sensor) = self.sensors.get_mut(usize::from(scan.sensor.0)) {
            let period = sensor.period_at(scan.stamp);
            // A cone without an echo is no covered window; clouds have no beams without a return.
            if scan.kind == ScanKind::Beams {
                sensor.blockage.update(scan, measured_at);
            }
            let obstacle_scan = sensor.obstacle_scans.input_buffer_mut();
            let times = (measured_at, period);
            #[cfg(target_os = "linux")]
            let mut around = self
                .obstacle_sender
                .as_ref()
                .map(|_| ObstaclesAround::default());
            #[cfg(not(target_os = "linux"))]
            let mut around = None;
            let (rules, blockage) = (&self.rules, &sensor.blockage);
            obstacle_scan.read(scan, &plane, rules, blockage, times, around.as_mut());
            sensor.obstacle_scans.publish();
            #[cfg(target_os = "linux")]
            if let (Some(sender), Some(around)) = (&mut self.obstacle_sender, &around) {
                sender.update(around, now);
            }
        }
        measured_at
    }

    /// Whether the window of a sensor seems to be blocked.
    pub fn is_blocked(&self, sensor: SensorId) -> bool {
        let sensor = self.sensors.get(usize::from(sensor.0));
        sensor.is_some_and(|sensor| sensor.blockage.is_blocked())
    }

    /// The poses jumped: what was seen before cannot be compared with what is seen now.
    pub fn on_pose_jump(&mut self) {
        for sensor in &mut self.sensors {
            sensor.blockage.clear();
        }
    }

    /// The plane that the heights of the next scan refer to; `None` before the first one, and where heights are not
    /// mapped.
    pub fn ground_plane(&self) -> Option<GroundPlane> {
        self.ground.as_ref().and_then(GroundTracker::plane)
    }

    /// The plane that a scan's heights refer to, which is that of the scans before it.
    fn plane_below(&mut self, scan: &RegisteredScan) -> GroundPlane {
        let pose = &scan.odom_from_base;
        if self.rules.is_boat() {
            // It floats: its own attitude is that of the waves.
            return GroundPlane::under(&upright(pose));
        }
        let before = self.ground_plane();
        if let Some(ground) = &mut self.ground
            && matches!(scan.kind, ScanKind::Beams | ScanKind::Cloud)
        {
            ground.update(scan.stamp, pose);
        }
        before.unwrap_or_else(|| GroundPlane::under(pose))
    }
}

impl MonitorMapInput {
    /// A scan, in `odom`, is in the map, which was measured at `measured_at`, at the latest.
    pub fn update_map(
        &mut self,
        scan: &RegisteredScan,
        (mapper, map_from_odom): (&Mapper, &Pose),
        measured_at: Monotonic,
    ) {
        let is_due = self.copied.is_none_or(|copied| {
            scan.stamp < copied || scan.stamp.since(copied) >= MAP_COPY_PERIOD
        });
        // What arcs and contacts add comes with the next sweep: without sweeps the map is not renewed.
        if !is_due || !matches!(scan.kind, ScanKind::Beams | ScanKind::Cloud) {
            return;
        }
        self.copied = Some(scan.stamp);
        let at = scan.odom_from_base.translation.vector;
        let request = CopyRequest {
            measured_at,
            period: MAP_ASSUMED_PERIOD,
            centre: Point2::new(at.x, at.y),
            reach_m: self.rules.window_m(),
            map_from_odom: Isometry2::new(
                map_from_odom.translation.vector.xy(),
                pose::yaw_rad(map_from_odom),
            ),
        };
        let map = self.map.input_buffer_mut();
        let costs = mapper
            .voxels()
            .and_then(|voxels| Some((voxels.cost()?, voxels.octree().cell_m())));
        let depth = mapper.voxels().and_then(VoxelLayers::depth);
        let shore = mapper.voxels().and_then(VoxelLayers::shore);
        if let Some(terrain) = mapper.terrain() {
            map.copy_obstacles(terrain.obstacle(), request);
        } else if let Some((costs, cell_m)) = costs {
            map.copy_costs(
                costs,
                depth.zip(self.rules.least_water_m()),
                shore.map_or(&[], ShoreLayer::docking_sites),
                cell_m,
                request,
            );
        } else if let Some(occupancy) = mapper.occupancy() {
            map.copy_occupancy(occupancy, request);
        } else {
            return;
        }
        self.map.publish();
    }
}

impl Sensor {
    /// Time from sweep to sweep: the median of the newest, so that neither a sweep that came late nor two that came at
    /// once change it.
    fn period_at(&mut self, stamp: RobotTime) -> Duration {
        let last = self.last.replace(stamp);
        if let Some(last) = last.filter(|&last| last < stamp) {
            let gap = Duration::from_secs_f64(stamp.since(last).as_secs_f64());
            self.gaps.push_back(gap);
            if self.gaps.len() > PERIOD_SAMPLES {
                self.gaps.pop_front();
            }
        }
        let mut gaps: Vec<_> = self.gaps.iter().copied().collect();
        gaps.sort_unstable();
        gaps.get(gaps.len() / 2).copied().unwrap_or(UNKNOWN_PERIOD)
    }
}

impl MonitorRunner {
    pub(super) const fn unavailable_reason(&self) -> Option<UnavailableReason> {
        self.monitor.unavailable_reason()
    }

    /// What bounded the motion that was asked for in the last round.
    pub(super) const fn barrier(&self) -> Option<Barrier> {
        self.monitor.barrier()
    }

    /// How long ago the ground on each side of the vehicle was looked at last.
    pub(super) const fn side_ground_ages(&self) -> [Option<Duration>; 4] {
        self.monitor.side_ground_ages()
    }

    pub(super) fn output(
        &mut self,
        (commanded, requested): (Velocity, Velocity),
        docking: Option<DockingChoice>,
        now: Monotonic,
    ) -> CollisionMonitorOutput {
        for (obstacle_scan, newest) in self.obstacle_scans.iter_mut().zip(&mut self.newest_scans) {
            if newest.update() {
                // What is given back keeps its memory for a sweep to come.
                std::mem::swap(obstacle_scan, newest.output_buffer_mut());
            }
        }
        let input = CollisionMonitorInput {
            obstacle_scans: &self.obstacle_scans,
            map: Some(self.map.read()),
            odometry: *self.odometry.read(),
            commanded,
            requested,
            docking,
        };
        self.monitor.output(&input, now)
    }
}

/// The same place and heading, without pitch and roll.
fn upright(pose: &Pose) -> Pose {
    let yaw_rad = pose::yaw_rad(pose);
    Pose::from_parts(
        pose.translation,
        UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
    )
}

/// Measurements that are remembered: those of a second of fast sensors.
const CAPACITY: usize = 1024;

/// Receive times of the last measurements, by their rising stamps.
///
/// The age of a scan that waits for a pose or for processing counts from its reception, not from its use.
#[derive(Clone, Debug, Default)]
pub(super) struct ReceiveTimes(VecDeque<(RobotTime, Monotonic)>);

impl ReceiveTimes {
    pub(super) fn record(&mut self, stamp: RobotTime, received: Monotonic) {
        if self.0.back().is_some_and(|&(last, _)| last >= stamp) {
            return;
        }
        if self.0.len() >= CAPACITY {
            self.0.pop_front();
        }
        self.0.push_back((stamp, received));
    }

    /// When the first of those came that were measured at `stamp` or later: no later than what was stamped so itself.
    /// `now` where nothing has come since.
    pub(super) fn received_at(&self, stamp: RobotTime, now: Monotonic) -> Monotonic {
        let at = self.0.partition_point(|&(stored, _)| stored < stamp);
        self.0.get(at).map_or(now, |&(_, received)| received)
    }

    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests;
