//! A simulated run as a source of measurements.

mod driving;
mod options;
mod sensor;

use std::collections::VecDeque;
use std::sync::Arc;

use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};

pub use self::driving::{DriveError, FARTHEST_AHEAD_S};
pub(crate) use self::options::SensorErrors;
pub use self::options::{OptionError, SimulationOptions};
use self::sensor::Sensor;
use crate::gps::{Datum, GpsReceiver};
use crate::motion::Motion;
use crate::scene::Scene;
use crate::vehicle::SimulatedVehicle;
use crate::world::World;

/// The stamp of time 0 of every run: 2000-01-01T00:00:00Z. Not zero, which in ROS messages means that
/// there is no stamp.
pub const START: RobotTime = RobotTime::from_nanos(946_684_800_000_000_000);

/// Drives a world's path, or follows commands, and yields the sensors' measurements in the order of stamps.
///
/// `/tf_static` comes once, `/tf` and `/odom` hold the same true pose at the odometry's rate, `/scan` and the scans
/// of further range sensors come at theirs. `/joint_states` holds how far the left and the right wheels have turned
/// where they have encoders, and, in messages of its own, the angle of a sensor that tilts; its mount is not in
/// `/tf`. `/imu/data` is the attitude in the world where there is an AHRS; `/fix` is the place of the antenna where
/// there is a satellite receiver, the world's x being east and y north.
///
/// Of equal stamps poses come first, then wheels, tilts, attitude, fixes and scans. A scan's stamp is that of
/// beam 0, so the poses of its later beams follow it. The last scan is one whose last beam still has a pose
/// after it.
///
/// The vehicle follows its path until [`SimulatedSource::drive`] or [`SimulatedSource::take_over`].
/// It then leaves the path for good, and the run goes on until [`SimulationOptions::duration_s`], or without end.
pub struct SimulatedSource {
    run: Run,
    streams: Vec<Stream>,
    /// In the order in which equal stamps come.
    timetable: Vec<(Ticks, Sensor)>,
    /// The end that the options give, seconds.
    longest_s: f64,
    last_pose_s: f64,
    /// The last stamp that came, since [`START`].
    now_nanos: i64,
    /// The first step that no measurement has looked at.
    frontier: i64,
    /// At most the measurements of one instant.
    ready: VecDeque<Measurement>,
}

impl SimulatedSource {
    /// A run from the beginning of the world's path.
    pub fn new(world: &World, options: SimulationOptions) -> Result<Self, OptionError> {
        let run = Run::new(world, SensorErrors::new(world, options)?);
        let longest_s = options.duration_s.unwrap_or(f64::INFINITY);
        let run_s = longest_s.min(world.path().duration_s());
        let last_pose_s = Ticks::until(run_s, run.vehicle.odometry_rate_hz).last_s();
        let (sensors, streams) = Sensor::all(&run, options.seed);
        let timetable = sensors
            .into_iter()
            .map(|sensor| (sensor.ticks(&run, last_pose_s), sensor));
        Ok(Self {
            timetable: timetable.collect(),
            streams,
            longest_s,
            last_pose_s,
            now_nanos: 0,
            frontier: 0,
            ready: run.mounts(START).into(),
            run,
        })
    }

    /// All streams of the run; a [`StreamId`] is an index into it.
    pub fn streams(&self) -> &[Stream] {
        &self.streams
    }

    /// Time from the first stamp to the last pose, seconds; infinite where nothing ends the run.
    pub fn duration_s(&self) -> f64 {
        self.last_pose_s
    }

    /// The next measurement; `None` at the end of the path or of the duration. After the end of the path there
    /// are more once it is taken over.
    pub fn next_measurement(&mut self) -> Option<Measurement> {
        if self.ready.is_empty() {
            let (nanos, place) = self.next_reading()?;
            let (ticks, sensor) = self.timetable.get_mut(place)?;
            ticks.advance();
            self.now_nanos = nanos;
            self.frontier = self.frontier.max(driving::observed_until(nanos, sensor));
            self.run.motion.advance_to(self.frontier);
            let stamp = START + RobotDuration::from_nanos(nanos);
            self.ready.extend(sensor.read(&self.run, stamp));
        }
        self.ready.pop_front()
    }

    /// When something is read next, in nanoseconds since [`START`], and its place in the timetable.
    fn next_reading(&self) -> Option<(i64, usize)> {
        let places = self.timetable.iter().enumerate();
        // Of equal instants the first in the timetable.
        places
            .filter_map(|(place, (ticks, _))| Some((ticks.next_nanos()?, place)))
            .min_by_key(|(nanos, _)| *nanos)
    }
}

struct Run {
    scene: Arc<Scene>,
    motion: Motion,
    vehicle: SimulatedVehicle,
    datum: Datum,
    errors: SensorErrors,
    frames: Frames,
}

/// Frames other than those of range sensors, which are called as the sensors are.
struct Frames {
    odom: FrameId,
    base: FrameId,
    imu: FrameId,
    gps: FrameId,
}

impl Run {
    fn new(world: &World, errors: SensorErrors) -> Self {
        Self {
            scene: Arc::clone(world.scene()),
            motion: Motion::new(world),
            vehicle: world.simulated_vehicle().clone(),
            datum: Datum::LAKE,
            errors,
            frames: Frames {
                odom: FrameId::from("odom"),
                base: FrameId::from("base_link"),
                imu: FrameId::from("imu_link"),
                gps: FrameId::from("gps_link"),
            },
        }
    }

    /// Mounts of the sensors with a frame of their own, except those that tilt: as on a real vehicle, these follow
    /// from their joints.
    fn mounts(&self, stamp: RobotTime) -> Vec<Measurement> {
        let fixed = self.vehicle.range_sensors().filter(|s| s.tilt.is_none());
        let range_sensors = fixed.map(|s| (FrameId::from(s.name), s.base_from_mount));
        let (imu, gps) = (&self.vehicle.attitude_sensor, &self.vehicle.gps);
        let imu = imu.as_ref().map(|_at_base| Pose::identity());
        let gps = gps.as_ref().map(GpsReceiver::base_from_antenna);
        let others = [(&self.frames.imu, imu), (&self.frames.gps, gps)]
            .into_iter()
            .filter_map(|(frame, mount)| Some((FrameId::clone(frame), mount?)));
        let mount = |(child, parent_from_child): (FrameId, Pose)| Measurement {
            stamp,
            stream: TF_STATIC,
            frame: FrameId::clone(&self.frames.base),
            data: MeasurementData::Transform {
                child,
                parent_from_child,
                is_static: true,
            },
        };
        range_sensors.chain(others).map(mount).collect()
    }
}

/// Instants at a fixed rate, in whole nanoseconds so that none drifts.
struct Ticks {
    rate_hz: f64,
    next: i64,
    end: i64,
}

impl Ticks {
    /// The instants from 0 to `end_s` inclusive; none where that is negative, without end where it is infinite.
    fn until(end_s: f64, rate_hz: f64) -> Self {
        // A tick that falls on the end is not lost to rounding.
        let end = (libm::floor(end_s * rate_hz + 1e-6) as i64).saturating_add(1);
        Self {
            rate_hz,
            next: 0,
            end: end.max(0),
        }
    }

    fn nanos(&self, tick: i64) -> i64 {
        libm::round(tick as f64 * 1e9 / self.rate_hz) as i64
    }

    fn next_nanos(&self) -> Option<i64> {
        (self.next < self.end).then(|| self.nanos(self.next))
    }

    fn advance(&mut self) {
        self.next += 1;
    }

    /// Goes on to where `longer` ends; what lies before `from_nanos` is left out.
    fn extend(&mut self, longer: &Self, from_nanos: i64) {
        self.end = self.end.max(longer.end);
        while self.next_nanos().is_some_and(|nanos| nanos < from_nanos) {
            self.advance();
        }
    }

    fn last_s(&self) -> f64 {
        if self.end == i64::MAX {
            return f64::INFINITY;
        }
        seconds(self.nanos((self.end - 1).max(0)))
    }
}

fn seconds(nanos: i64) -> f64 {
    nanos as f64 / 1e9
}

/// Streams that every run has, in the order of their [`StreamId`]s.
const ALWAYS: [(&str, &str); 3] = [
    ("/tf_static", "tf2_msgs/TFMessage"),
    ("/tf", "tf2_msgs/TFMessage"),
    ("/odom", "nav_msgs/Odometry"),
];
const TF_STATIC: StreamId = StreamId(0);
const TF: StreamId = StreamId(1);
const ODOM: StreamId = StreamId(2);
/// That of the main laser, which comes next.
#[cfg(test)]
const SCAN: StreamId = StreamId(3);

/// The stream of this name, which several sensors may share; a [`StreamId`] is an index into `streams`.
fn stream_called(streams: &mut Vec<Stream>, name: &str, type_name: &str) -> StreamId {
    let known = streams.iter().position(|stream| stream.name == name);
    let index = known.unwrap_or_else(|| {
        streams.push(Stream {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
        });
        streams.len() - 1
    });
    StreamId(index as u16)
}

#[cfg(test)]
mod driving_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod vehicle_tests;
