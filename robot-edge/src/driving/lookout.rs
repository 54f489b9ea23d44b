//! What the collision guard is told, and the loop's end of it.
//!
//! Two ends tell it: whoever places scans, at once, of poses and sweeps; whoever maps, later, of the map. Each has buffers of
//! its own and nobody waits: the loop sees the newest of what was handed over (triple buffers).

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Point2, UnitQuaternion};
use triple_buffer::{Input, Output, triple_buffer};

use super::arrivals::Arrivals;
use crate::clock::Monotonic;
use crate::mapping::Mapper;
use crate::mapping::ground_plane::{GroundPlane, GroundTracker};
use crate::mapping::posed_scan::{PosedScan, SensorId};
use crate::pose::{self, Pose};
use crate::robot_time::{RobotDuration, RobotTime};
use crate::teleop::guard::{
    Barrier, BlockageDetector, CollisionGuard, Copying, GuardInput, GuardRules, GuardSweep, Lack,
    LocalMap, Odometry,
};
use crate::teleop::{GuardVerdict, Velocity};

/// The map is copied after so much time of the data, with the next scan of any sensor: between the sweeps of a slow one with
/// those of others.
const MAP_DUE: RobotDuration = RobotDuration::from_millis(100);
/// What the guard takes for the time from copy to copy: after two and a half of it, a copy is stale. It is more than
/// [`MAP_DUE`], for a sweep of 200 ms waits for the poses behind it and then for mapping, and all that is age of the copy.
const MAP_PERIOD: Duration = Duration::from_millis(200);
/// Time from sweep to sweep until two have come.
const UNKNOWN_PERIOD: Duration = Duration::from_millis(100);
/// Of so many times from sweep to sweep the one in the middle counts.
const GAPS: usize = 9;

/// The end of whoever places scans: what cannot wait for the map.
#[derive(Debug)]
pub struct Lookout {
    rules: GuardRules,
    sensors: Vec<Sensor>,
    odometry: Input<Option<Odometry>>,
    /// What mapping makes of the ground, where it maps heights, but of every scan that was placed: those in the map may be
    /// seconds behind.
    ground: Option<GroundTracker>,
    arrivals: Arrivals,
}

/// The end of whoever maps.
#[derive(Debug)]
pub struct MapLookout {
    rules: GuardRules,
    map: Input<LocalMap>,
    copied: Option<RobotTime>,
}

#[derive(Debug)]
struct Sensor {
    sweeps: Input<GuardSweep>,
    blockage: BlockageDetector,
    last: Option<RobotTime>,
    /// The newest times from sweep to sweep.
    gaps: VecDeque<Duration>,
}

/// The loop's end: the guard, and the newest of all that it was told.
#[derive(Debug)]
pub struct Sight {
    guard: CollisionGuard,
    sweeps: Vec<GuardSweep>,
    newest_sweeps: Vec<Output<GuardSweep>>,
    map: Output<LocalMap>,
    odometry: Output<Option<Odometry>>,
}

/// A guard that keeps to `rules` and the ways to tell it what so many range sensors see, and the map. `ground` is one like
/// that of the mapper, where heights are mapped; else each scan's ground is the plane under the vehicle.
pub fn lookout(
    rules: GuardRules,
    sensors: usize,
    ground: Option<GroundTracker>,
) -> (Lookout, MapLookout, Sight) {
    let (inputs, newest_sweeps): (Vec<_>, _) = (0..sensors)
        .map(|_sensor| triple_buffer(&GuardSweep::default()))
        .unzip();
    let (map_input, map) = triple_buffer(&LocalMap::default());
    let (odometry_input, odometry) = triple_buffer(&None);
    let sensor = |sweeps| Sensor {
        sweeps,
        blockage: BlockageDetector::default(),
        last: None,
        gaps: VecDeque::new(),
    };
    let lookout = Lookout {
        rules,
        sensors: inputs.into_iter().map(sensor).collect(),
        odometry: odometry_input,
        ground,
        arrivals: Arrivals::default(),
    };
    let map_lookout = MapLookout {
        rules,
        map: map_input,
        copied: None,
    };
    let sight = Sight {
        guard: CollisionGuard::new(rules),
        sweeps: vec![GuardSweep::default(); sensors],
        newest_sweeps,
        map,
        odometry,
    };
    (lookout, map_lookout, sight)
}

impl Lookout {
    /// Something stamped `stamp` came.
    pub fn came(&mut self, stamp: RobotTime, came: Monotonic) {
        self.arrivals.note(stamp, came);
    }

    /// The clock of the data starts anew.
    pub fn reset_clock(&mut self) {
        self.arrivals.clear();
        for sensor in &mut self.sensors {
            sensor.last = None;
            sensor.blockage.clear();
        }
    }

    /// The next scan gives a new ground: where the vehicle was before says nothing of where it is.
    pub fn forget_ground(&mut self) {
        if let Some(ground) = &mut self.ground {
            ground.reset();
        }
    }

    /// The vehicle is here, and so fast.
    pub fn moved(&mut self, stamp: RobotTime, pose: &Pose, measured: Velocity, now: Monotonic) {
        self.odometry.write(Some(Odometry {
            odom_from_base: *pose,
            measured,
            taken: self.arrivals.of(stamp, now),
        }));
    }

    /// A scan was placed; it is not in the map yet. When it was measured, on this machine's clock: what came then, at the
    /// latest.
    pub fn see(&mut self, scan: &PosedScan, now: Monotonic) -> Monotonic {
        let taken = self.arrivals.of(scan.stamp, now);
        let plane = self.plane_below(scan);
        if let Some(sensor) = self.sensors.get_mut(usize::from(scan.sensor.0)) {
            let period = sensor.period_at(scan.stamp);
            sensor.blockage.update(scan, taken);
            let sweep = sensor.sweeps.input_buffer_mut();
            let times = (taken, period);
            sweep.read(scan, &plane, &self.rules, &sensor.blockage, times);
            sensor.sweeps.publish();
        }
        taken
    }

    /// Whether the window of a sensor seems to be blocked.
    pub fn is_blocked(&self, sensor: SensorId) -> bool {
        let sensor = self.sensors.get(usize::from(sensor.0));
        sensor.is_some_and(|sensor| sensor.blockage.is_blocked())
    }

    /// The poses jumped: what was seen before cannot be compared with what is seen now.
    pub fn jumped(&mut self) {
        for sensor in &mut self.sensors {
            sensor.blockage.clear();
        }
    }

    /// The plane that the heights of the next scan refer to; `None` before the first one, and where heights are not mapped.
    pub fn ground_plane(&self) -> Option<GroundPlane> {
        self.ground.as_ref().and_then(GroundTracker::plane)
    }

    /// The plane that a scan's heights refer to, which is that of the scans before it.
    fn plane_below(&mut self, scan: &PosedScan) -> GroundPlane {
        let pose = &scan.odom_from_base;
        if self.rules.is_boat() {
            // It floats: its own attitude is that of the waves.
            return GroundPlane::under(&upright(pose));
        }
        let before = self.ground_plane();
        if let Some(ground) = &mut self.ground {
            ground.update(scan.stamp, pose);
        }
        before.unwrap_or_else(|| GroundPlane::under(pose))
    }
}

impl MapLookout {
    /// A scan is in the map, which was measured at `taken`, at the latest.
    pub fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper, taken: Monotonic) {
        let is_due = self
            .copied
            .is_none_or(|copied| scan.stamp < copied || scan.stamp.since(copied) >= MAP_DUE);
        if !is_due {
            return;
        }
        self.copied = Some(scan.stamp);
        let at = scan.odom_from_base.translation.vector;
        let copying = Copying {
            taken,
            period: MAP_PERIOD,
            around: Point2::new(at.x, at.y),
            reach_m: self.rules.window_m(),
        };
        let map = self.map.input_buffer_mut();
        let costs = mapper
            .voxels()
            .and_then(|voxels| Some((voxels.cost()?, voxels.octree().cell_m())));
        if let Some(terrain) = mapper.terrain() {
            map.copy_obstacles(terrain.obstacle(), terrain.elevation().cell_m(), copying);
        } else if let Some((costs, cell_m)) = costs {
            map.copy_costs(costs, cell_m, copying);
        } else if let Some(occupancy) = mapper.occupancy() {
            map.copy_occupancy(occupancy, copying);
        } else {
            return;
        }
        self.map.publish();
    }
}

impl Sensor {
    /// Time from sweep to sweep: the median of the newest, so that neither a sweep that came late nor two that came at once
    /// change it.
    fn period_at(&mut self, stamp: RobotTime) -> Duration {
        let last = self.last.replace(stamp);
        if let Some(last) = last.filter(|&last| last < stamp) {
            let gap = Duration::from_secs_f64(stamp.since(last).as_secs_f64());
            self.gaps.push_back(gap);
            if self.gaps.len() > GAPS {
                self.gaps.pop_front();
            }
        }
        let mut gaps: Vec<_> = self.gaps.iter().copied().collect();
        gaps.sort_unstable();
        gaps.get(gaps.len() / 2).copied().unwrap_or(UNKNOWN_PERIOD)
    }
}

impl Sight {
    /// What the guard lacked in the last round, where it could not judge then.
    pub(super) const fn lack(&self) -> Option<Lack> {
        self.guard.lack()
    }

    /// What bounded the motion that was asked for in the last round.
    pub(super) const fn barrier(&self) -> Option<Barrier> {
        self.guard.barrier()
    }

    /// How long ago the ground on each side of the vehicle was looked at last.
    pub(super) const fn side_ages(&self) -> [Option<Duration>; 4] {
        self.guard.side_ages()
    }

    /// The guard's word of this round.
    pub(super) fn verdict(
        &mut self,
        (told, requested): (Velocity, Velocity),
        now: Monotonic,
    ) -> GuardVerdict {
        for (sweep, newest) in self.sweeps.iter_mut().zip(&mut self.newest_sweeps) {
            if newest.update() {
                // What is given back keeps its memory for a sweep to come.
                std::mem::swap(sweep, newest.output_buffer_mut());
            }
        }
        let input = GuardInput {
            sweeps: &self.sweeps,
            map: Some(self.map.read()),
            odometry: *self.odometry.read(),
            told,
            requested,
        };
        self.guard.verdict(&input, now)
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

#[cfg(test)]
mod tests;
