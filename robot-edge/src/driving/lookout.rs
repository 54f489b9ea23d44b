//! What the collision guard is told, and the loop's end of it.
//!
//! Two ends tell it: whoever places scans, at once, of poses and sweeps; whoever maps, later, of the map. Each has buffers of
//! its own and nobody waits: the loop sees the newest of what was handed over (triple buffers).

use std::time::Duration;

use nalgebra::{Point2, UnitQuaternion};
use triple_buffer::{Input, Output, triple_buffer};

use super::arrivals::Arrivals;
use crate::clock::Monotonic;
use crate::mapping::Mapper;
use crate::mapping::ground_plane::GroundPlane;
use crate::mapping::posed_scan::PosedScan;
use crate::mapping::terrain::Terrain;
use crate::pose::{self, Pose};
use crate::robot_time::{RobotDuration, RobotTime};
use crate::teleop::guard::{
    CollisionGuard, Copying, GuardInput, GuardRules, GuardSweep, Lack, LocalMap, Odometry,
};
use crate::teleop::{GuardVerdict, Velocity};

/// The map is copied this often, on the clock of the data.
const MAP_PERIOD: Duration = Duration::from_millis(200);
/// Time from sweep to sweep until two have come.
const UNKNOWN_PERIOD: Duration = Duration::from_millis(100);

/// The end of whoever places scans: what cannot wait for the map.
#[derive(Debug)]
pub struct Lookout {
    rules: GuardRules,
    sensors: Vec<Sensor>,
    odometry: Input<Option<Odometry>>,
    /// As mapping knows it, of the scans that are in the map.
    ground: Output<Option<GroundPlane>>,
    arrivals: Arrivals,
}

/// The end of whoever maps.
#[derive(Debug)]
pub struct MapLookout {
    rules: GuardRules,
    map: Input<LocalMap>,
    copied: Option<RobotTime>,
    ground: Input<Option<GroundPlane>>,
}

#[derive(Debug)]
struct Sensor {
    sweeps: Input<GuardSweep>,
    last: Option<RobotTime>,
    period: Option<Duration>,
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

/// A guard that keeps to `rules` and the ways to tell it what so many range sensors see, and the map.
pub fn lookout(rules: GuardRules, sensors: usize) -> (Lookout, MapLookout, Sight) {
    let (inputs, newest_sweeps): (Vec<_>, _) = (0..sensors)
        .map(|_sensor| triple_buffer(&GuardSweep::default()))
        .unzip();
    let (map_input, map) = triple_buffer(&LocalMap::default());
    let (odometry_input, odometry) = triple_buffer(&None);
    let (ground_input, ground) = triple_buffer(&None);
    let sensor = |sweeps| Sensor {
        sweeps,
        last: None,
        period: None,
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
        ground: ground_input,
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
        let plane = if self.rules.is_boat() {
            // It floats: its own attitude is that of the waves.
            GroundPlane::under(&upright(&scan.odom_from_base))
        } else {
            let ground = *self.ground.read();
            ground.unwrap_or_else(|| GroundPlane::under(&scan.odom_from_base))
        };
        if let Some(sensor) = self.sensors.get_mut(usize::from(scan.sensor.0)) {
            let period = sensor.period_at(scan.stamp);
            let sweep = sensor.sweeps.input_buffer_mut();
            sweep.read(scan, &plane, &self.rules, (taken, period));
            sensor.sweeps.publish();
        }
        taken
    }
}

impl MapLookout {
    /// A scan is in the map, which was measured at `taken`, at the latest.
    pub fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper, taken: Monotonic) {
        let ground = mapper.terrain().and_then(Terrain::ground_plane);
        self.ground.write(ground);
        let is_due = self.copied.is_none_or(|copied| {
            scan.stamp < copied
                || scan.stamp.since(copied)
                    >= RobotDuration::from_secs_f64(MAP_PERIOD.as_secs_f64())
        });
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
    /// Time from sweep to sweep: the shortest seen, so that a sensor that skips some is not waited for longer.
    fn period_at(&mut self, stamp: RobotTime) -> Duration {
        let last = self.last.replace(stamp);
        let since = last
            .filter(|&last| last < stamp)
            .map(|last| Duration::from_secs_f64(stamp.since(last).as_secs_f64()));
        if let Some(since) = since {
            self.period = Some(self.period.map_or(since, |period| period.min(since)));
        }
        self.period.unwrap_or(UNKNOWN_PERIOD)
    }
}

impl Sight {
    /// What the guard lacked in the last round, where it could not judge then.
    pub(super) const fn lack(&self) -> Option<Lack> {
        self.guard.lack()
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
