//! A simulated run as a source of measurements.

mod sensor;

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::ops::RangeInclusive;
use std::sync::Arc;

use measurement::pose::Pose;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};

use self::sensor::Sensor;
use crate::gps::{Datum, GpsReceiver};
use crate::laser::LaserErrors;
use crate::motion::{Motion, POSTURE_STEP_S};
use crate::scene::Scene;
use crate::vehicle::SimulatedVehicle;
use crate::velocity::{CommandedVelocity, PlanarVelocity};
use crate::wheel_encoders::WheelErrors;
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
/// there is a satellite receiver, the world's x being east and y north. `/ultrasonic/…` and `/bumper/…` are the ranges
/// and contacts of a vehicle that has such sensors; their mounts are not in `/tf_static`.
///
/// Of equal stamps poses come first, then wheels, tilts, attitude, fixes, scans, ranges and contacts. A scan's stamp is that of
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
            self.frontier = self.frontier.max(observed_until(nanos, sensor));
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

/// How far ahead of the last measurement a vehicle can be driven, seconds: half of what is kept of its motion, so
/// that what is measured next finds all of it.
pub const FARTHEST_AHEAD_S: f64 = 5.0;

const STEP_NANOS: i64 = (POSTURE_STEP_S * 1e9) as i64;
const _: () = assert!(STEP_NANOS == 5_000_000, "whole nanoseconds");

/// A command whose time is too far ahead of what was measured.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "a command for {at_s:.3} s, where the last measurement is of {now_s:.3} s: take measurements up to \
     {FARTHEST_AHEAD_S} s before it first"
)]
pub struct DriveError {
    /// Time of the command, since [`START`].
    pub at_s: f64,
    /// Time of the last measurement, since [`START`].
    pub now_s: f64,
}

/// The vehicle as an actuator.
///
/// Motion advances in steps of 5 ms; a command holds from the first step at or after its time that no measurement
/// has looked at. A scan looks as far ahead of its stamp as its sweep takes (30 ms on a land robot, 200 ms on the
/// boat), an AHRS by its period: commands given meanwhile wait for the end of the sweep.
///
/// The same commands at the same effective times give the same motion and the same measurements, bit for bit,
/// however measurements were taken in between.
impl SimulatedSource {
    /// The same run, but the end of the path does not end it: the vehicle waits there to be driven.
    #[must_use]
    pub fn until_stopped(mut self) -> Self {
        self.continue_past_path();
        self
    }

    /// Commands a velocity from `at` on, until the next command. Returns when that takes effect: never before `at`,
    /// never before the command that came before this one.
    ///
    /// The first command other than zero takes the vehicle off its path; until then zero does nothing.
    ///
    /// # Errors
    /// Where `at` is more than [`FARTHEST_AHEAD_S`] ahead of the last measurement. A driven vehicle then stops.
    pub fn drive(
        &mut self,
        at: RobotTime,
        velocity: CommandedVelocity,
    ) -> Result<RobotTime, DriveError> {
        if self.is_driven() || !velocity.or_zero().is_zero() {
            let effective = self.take_over(at);
            let applied = effective.map_or(CommandedVelocity::ZERO, |_effective| velocity);
            self.run.motion.set_command(applied);
            return effective;
        }
        Ok(at.max(self.frontier()))
    }

    /// Takes the vehicle off its path at `at`, or as soon after as [`SimulatedSource::drive`] would, and stops it:
    /// its command is zero. One that is driven already goes on to that time.
    ///
    /// # Errors
    /// As [`SimulatedSource::drive`].
    pub fn take_over(&mut self, at: RobotTime) -> Result<RobotTime, DriveError> {
        let since_start = at.since(START);
        let (at_s, now_s) = (since_start.as_secs_f64(), self.now_nanos as f64 / 1e9);
        if at_s > now_s + FARTHEST_AHEAD_S {
            return Err(DriveError { at_s, now_s });
        }
        self.frontier = self.frontier.max(step_from(since_start.as_nanos()));
        if !self.is_driven() {
            let scene = Arc::clone(&self.run.scene);
            self.run
                .motion
                .take_over(self.frontier, &self.run.vehicle, scene);
            self.continue_past_path();
        }
        self.run.motion.advance_to(self.frontier);
        Ok(self.frontier())
    }

    /// Turns the servo of that joint to an angle, radians, from [`SimulatedSource::frontier`] on.
    pub fn turn(&mut self, joint: &str, angle_rad: f64) {
        let at_s = self.frontier().since(START).as_secs_f64();
        let sensors = self.timetable.iter_mut().map(|(_, sensor)| sensor);
        let servos = sensors.filter_map(Sensor::servo_mut);
        for servo in servos.filter(|servo| servo.joint == joint) {
            servo.turn_to(at_s, angle_rad);
        }
    }

    /// The time up to which measurements have looked or commands were given: later commands take effect then at the
    /// earliest.
    pub fn frontier(&self) -> RobotTime {
        START + RobotDuration::from_nanos(self.frontier * STEP_NANOS)
    }

    /// How fast the vehicle truly goes in the plane at `at`, as far as it has got: not after
    /// [`SimulatedSource::frontier`].
    pub fn velocity(&self, at: RobotTime) -> PlanarVelocity {
        let known = at.min(self.frontier());
        self.run.motion.velocity(known.since(START).as_secs_f64())
    }

    /// Whether the vehicle is driven by commands instead of its path.
    pub fn is_driven(&self) -> bool {
        self.run.motion.is_driven()
    }

    /// The end of the path is no longer that of the run.
    fn continue_past_path(&mut self) {
        self.last_pose_s = Ticks::until(self.longest_s, self.run.vehicle.odometry_rate_hz).last_s();
        for (ticks, sensor) in &mut self.timetable {
            // A sensor may have come to its end before the last pose.
            ticks.extend(&sensor.ticks(&self.run, self.last_pose_s), self.now_nanos);
        }
    }
}

/// The first step that a reading at `nanos` does not look at any more; at the step itself no command holds yet.
fn observed_until(nanos: i64, sensor: &Sensor) -> i64 {
    step_from(nanos.saturating_add(lookahead_nanos(sensor)))
}

fn lookahead_nanos(sensor: &Sensor) -> i64 {
    libm::ceil(sensor.lookahead_s() * 1e9) as i64
}

/// The first step at or after a time.
fn step_from(nanos: i64) -> i64 {
    nanos.max(0).saturating_add(STEP_NANOS - 1) / STEP_NANOS
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
    /// Of messages without one.
    none: FrameId,
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
                none: FrameId::from(""),
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

/// Options of a simulated run.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SimulationOptions {
    /// Chooses the noise.
    pub seed: u64,
    /// Ends the run before the path does, seconds; also the run of a vehicle that is driven, which else does not
    /// end.
    pub duration_s: Option<f64>,
    /// Standard deviation of ranges in place of the world's, metres.
    pub range_noise_m: Option<f64>,
    /// Probability of a dropout in place of the world's.
    pub dropout: Option<f64>,
    /// Standard deviation of the AHRS's roll, pitch and yaw in place of the world's, radians; at most π.
    pub attitude_noise_rad: Option<f64>,
    /// Share by which the wheel encoders read too far in place of the world's: 0.048 where 4.2 m are read as
    /// 4.4 m, 0.07 where 20 m are read as 21.4 m [LOD §5.4]. From −0.9 to 10.
    pub encoder_error: Option<f64>,
    /// Random slip of the wheels of each side, 0 where it is not given: standard deviation after 1 m as a
    /// share of that metre, growing with the square root of the way; at most 1.
    pub wheel_slip: Option<f64>,
    /// Lag of the encoders of tilting sensors in place of the world's, seconds; at most 10.
    pub joint_lag_s: Option<f64>,
    /// Standard deviation of the satellite receiver to the east and to the north in place of the world's,
    /// metres.
    pub fix_noise_m: Option<f64>,
}

/// An option that makes no sense.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{option}` is {value}, it must be {must_be}")]
pub struct OptionError {
    /// Name of the option.
    pub option: &'static str,
    /// The given value.
    pub value: f64,
    /// The allowed range.
    pub must_be: &'static str,
}

/// How the sensors of a run err.
#[derive(Clone, Copy)]
pub(crate) struct SensorErrors {
    pub(crate) laser: LaserErrors,
    pub(crate) wheels: WheelErrors,
    pub(crate) attitude_noise_rad: f64,
    pub(crate) joint_lag_s: f64,
    pub(crate) fix_noise_m: f64,
    /// Time span in which the main laser's window is covered: no beam has an echo.
    pub(crate) laser_covered_s: Option<[f64; 2]>,
}

impl SensorErrors {
    /// Those of the options, else those of the world.
    fn new(world: &World, options: SimulationOptions) -> Result<Self, OptionError> {
        let world = world.errors();
        let errors = Self {
            laser: LaserErrors {
                range_noise_m: options.range_noise_m.unwrap_or(world.laser.range_noise_m),
                dropout: options.dropout.unwrap_or(world.laser.dropout),
                ..world.laser
            },
            wheels: WheelErrors {
                scale_error: options.encoder_error.unwrap_or(world.wheels.scale_error),
                slip: options.wheel_slip.unwrap_or(world.wheels.slip),
            },
            attitude_noise_rad: options
                .attitude_noise_rad
                .unwrap_or(world.attitude_noise_rad),
            joint_lag_s: options.joint_lag_s.unwrap_or(world.joint_lag_s),
            fix_noise_m: options.fix_noise_m.unwrap_or(world.fix_noise_m),
            ..world
        };
        let values = [
            options.duration_s.unwrap_or(0.0),
            errors.laser.range_noise_m,
            errors.laser.dropout,
            errors.attitude_noise_rad,
            errors.wheels.scale_error,
            errors.wheels.slip,
            errors.joint_lag_s,
            errors.fix_noise_m,
        ];
        for ((option, allowed, must_be), value) in ALLOWED.into_iter().zip(values) {
            if !allowed.contains(&value) {
                return Err(OptionError {
                    option,
                    value,
                    must_be,
                });
            }
        }
        Ok(errors)
    }
}

const ALLOWED: [(&str, RangeInclusive<f64>, &str); 8] = [
    ("duration_s", 0.0..=f64::INFINITY, "0 or more"),
    ("range_noise_m", 0.0..=f64::INFINITY, "0 or more"),
    ("dropout", 0.0..=1.0, "a probability from 0 to 1"),
    ("attitude_noise_rad", 0.0..=PI, "from 0 to π"),
    ("encoder_error", -0.9..=10.0, "from -0.9 to 10"),
    ("wheel_slip", 0.0..=1.0, "from 0 to 1"),
    ("joint_lag_s", 0.0..=10.0, "from 0 to 10"),
    ("fix_noise_m", 0.0..=1e6, "from 0 to 1000000"),
];

#[cfg(test)]
mod driving_tests;
#[cfg(test)]
mod lidar_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod vehicle_tests;
