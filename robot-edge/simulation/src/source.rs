//! A simulated run as a source of measurements.

mod driving;
mod options;
mod run;
mod sensor;
mod streams;
mod ticks;

use std::collections::VecDeque;

use crate::motion::Motion;
use crate::source::options::Errors;
use crate::source::run::Run;
use crate::source::sensor::Sensor;
use crate::source::ticks::Ticks;
use crate::world::World;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, Stream};

pub use driving::{DriveError, FARTHEST_AHEAD_S};
pub use options::{OptionError, SimulationOptions};
pub use sensor::WHEEL_JOINTS;

/// The stamp of time 0 of every run: 2000-01-01T00:00:00Z. Not zero, which in ROS messages means that
/// there is no stamp.
pub const START: RobotTime = RobotTime::from_nanos(946_684_800_000_000_000);

/// Drives a world's path, or as it is told, and yields what the vehicle's sensors say, in the order of stamps.
///
/// `/tf_static` comes once, `/tf` and `/odom` say the same true pose at the odometry's rate, `/scan` and the
/// scans of further range sensors come at theirs. `/joint_states` says how far the left and the right wheels
/// have turned where they have encoders, and, in messages of its own, the angle of a sensor that tilts; its
/// mount is not in `/tf`. Where the vehicle has an AHRS, `/imu/data` says its attitude in the world; where it
/// has a satellite receiver, `/fix` says where the antenna is, the world's x being east and y north.
///
/// Of equal stamps poses come first, then wheels, tilts, attitude, fixes and scans. A scan's stamp is that of
/// beam 0, so the poses of its later beams follow it. The last scan is one whose last beam still has a pose
/// after it.
///
/// Nobody drives the vehicle until [`SimulatedSource::drive`] tells it to go, or [`SimulatedSource::take_over`].
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
        let run = Run::new(world, Errors::new(world, options)?);
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

    /// All streams of the run; a [`StreamId`](measurement::StreamId) is an index into it.
    pub fn streams(&self) -> &[Stream] {
        &self.streams
    }

    /// Time from the first stamp to the last pose, seconds; infinite where nothing ends the run.
    pub fn duration_s(&self) -> f64 {
        self.last_pose_s
    }

    /// Where the vehicle truly is, by seconds since [`START`].
    pub fn motion(&self) -> &Motion {
        &self.run.motion
    }

    /// The next measurement; `None` at the end of the path or of the duration. After the end of the path there
    /// are more where somebody takes over.
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

#[cfg(test)]
mod driving_tests;
#[cfg(test)]
mod holos_tests;
#[cfg(test)]
mod introbot_tests;
#[cfg(test)]
mod riverwatch_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod undriven_tests;
