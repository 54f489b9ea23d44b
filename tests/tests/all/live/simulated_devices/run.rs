//! One run: the simulation in step with the clock, the edge that records the devices, and an operator who drives. The
//! recording is then put on the time of the simulation.

use std::f64::consts::TAU;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use experiments::run::vehicle_config;
use foreshore_tests::operator::{Input, Operator};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, Stream, StreamId};
use network::clock;
use protocol::message::TeleopState;
use recording::Selection;
use rustix::process::{getpriority_process, setpriority_process};
use rustix::thread::gettid;
use simulation::SimulatedSource;
use simulation::source::START;
use tempfile::tempdir;

use super::devices::Devices;
use super::{DRIVE, Vehicle};
use crate::processes::{Running, command, free_port, tcp, wait_until};

/// How far the simulation is ahead of the clock, so that a measurement exists before its device has to send it.
const AHEAD: Duration = Duration::from_millis(300);

/// If more than one in a hundred measurements comes so much earlier or later than usual, the machine was busy with
/// other work, and the run is repeated.
const BUSY_MS: f64 = 1.0;

/// The step of the angles that a servo of the X series sends.
const SERVO_STEP_RAD: f64 = TAU / 4096.0;

/// The running simulation, in step with the clock.
struct Simulation {
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<Vec<Measurement>>,
    devices: Arc<Devices>,
    vehicle: Arc<Vehicle>,
}

impl Simulation {
    fn start(vehicle: &Arc<Vehicle>, mut source: SimulatedSource, mut devices: Devices) -> Self {
        let began = clock::now() + 2 * AHEAD;
        devices.begin(vehicle.tilt(), 2 * AHEAD);
        let devices = Arc::new(devices);
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let (vehicle, devices, is_over) = (
                Arc::clone(vehicle),
                Arc::clone(&devices),
                Arc::clone(&is_over),
            );
            move || {
                // The simulation is ahead of the clock and can wait; the devices and the edge cannot.
                let priority = getpriority_process(Some(gettid())).unwrap();
                setpriority_process(Some(gettid()), priority + 5).unwrap();
                source.take_over(START).unwrap();
                let mut measured = Vec::new();
                let mut next = source.next_measurement();
                while !is_over.load(Ordering::Relaxed) {
                    let ahead = (clock::now() + AHEAD).since(began).as_nanos();
                    let until = START + RobotDuration::from_nanos(ahead as i64);
                    while let Some(measurement) = next.take_if(|next| next.stamp <= until) {
                        devices.feed(&measurement);
                        measured.push(measurement);
                        let powers = devices.controller.emulator.with(|it| it.ax3500.motors());
                        let velocity = vehicle.velocity(powers);
                        source.drive(source.frontier(), velocity).unwrap();
                        next = source.next_measurement();
                    }
                    sleep(Duration::from_millis(2));
                }
                measured
            }
        });
        Self {
            is_over,
            thread,
            devices,
            vehicle: Arc::clone(vehicle),
        }
    }

    /// Returns all measurements. A servo measures when the edge asks it, so its angles are those at the times of the
    /// requests.
    fn stop(self) -> Vec<Measurement> {
        self.is_over.store(true, Ordering::Relaxed);
        let mut measured = self.thread.join().unwrap();
        if let Some(tilt) = self.vehicle.tilt() {
            let asked_s = self.devices.asked_s.lock().unwrap();
            let asked_s = asked_s.iter().filter(|time_s| **time_s > 0.0);
            let simulated = measured.iter().find(|it| is_joints(it)).unwrap().clone();
            let readings = asked_s.map(|time_s| {
                let angle_rad = (tilt.angle_rad(*time_s) / SERVO_STEP_RAD).round() * SERVO_STEP_RAD;
                Measurement {
                    stamp: START + RobotDuration::from_secs_f64(*time_s),
                    data: MeasurementData::Joints(vec![(tilt.joint.to_owned(), angle_rad)]),
                    ..simulated.clone()
                }
            });
            measured.retain(|it| !is_joints(it));
            measured.extend(readings);
            measured.sort_by_key(|it| it.stamp);
        }
        measured
    }
}

/// The measurements of one run, in the order of their stamps.
pub(super) struct Run {
    /// Those of the simulation itself.
    pub(super) direct: Vec<Measurement>,
    /// Those that the edge recorded from the devices, with the simulation's times and streams, without poses.
    pub(super) recorded: Vec<Measurement>,
    pub(super) streams: Vec<Stream>,
}

impl Run {
    /// An operator drives the vehicle through [`DRIVE`]; `None` if the machine was too busy.
    pub(super) fn of(vehicle: &Arc<Vehicle>) -> Option<Self> {
        let folder = tempdir().unwrap();
        let [file, recording] = ["vehicle.toml", "run.mcap"].map(|name| folder.path().join(name));
        let devices = Devices::of(&vehicle.world);
        fs::write(&file, vehicle.configuration(&devices)).unwrap();
        let source = SimulatedSource::new(&vehicle.world, vehicle.options).unwrap();
        let streams = source.streams().to_vec();
        let port = free_port();
        let mut edge = command(&format!(
            "robot-edge run --vehicle {} --robot rover --quiet --listen {} --record {}",
            file.display(),
            tcp(port),
            recording.display()
        ));
        for setting in vehicle.settings {
            edge.args(["--set", setting]);
        }
        edge.env("STATE_DIRECTORY", folder.path().join("state"));
        let edge = Running::start(&mut edge, "edge");
        wait_until("the devices are ready", || devices.are_ready());
        let simulation = Simulation::start(vehicle, source, devices);

        let config = vehicle_config(&vehicle.world, &[]).unwrap().vehicle;
        let mut anna = Operator::ready(&tcp(port), "rover", "anna");
        anna.wait_for_status("ready", |teleop| teleop.state == TeleopState::Idle);
        let speeds = |(along, turning, _)| {
            Input::of(
                (along * config.max_speed_mps) as f32,
                (turning * config.max_turn_rate_radps) as f32,
            )
        };
        anna.start_driving(speeds(DRIVE[0]));
        for step in DRIVE {
            anna.hold(speeds(step), step.2);
        }
        // The last measurements are still on their way to the edge.
        sleep(Duration::from_millis(500));
        edge.signal("INT");
        edge.ends_with(130);
        let direct = simulation.stop();
        let has_servo = vehicle.tilt().is_some();
        let recorded = recorded(&recording, &streams, &direct, has_servo)?;
        let mut run = Self {
            direct,
            recorded,
            streams,
        };
        run.end_together();
        Some(run)
    }

    /// Both begin and end with the same scans.
    fn end_together(&mut self) {
        let last = |measurements: &[Measurement]| {
            let stamps = measurements
                .iter()
                .filter(|it| is_scan(it))
                .map(|it| it.stamp);
            stamps.max().unwrap()
        };
        let last = last(&self.recorded).min(last(&self.direct)).since(START);
        // All sensors begin a scan at each multiple of 0.2 s; 20 ms later, jitter of the stamps does not matter.
        let end_s = (last.as_secs_f64() / 0.2).floor() * 0.2 - 0.18;
        let end = START + RobotDuration::from_secs_f64(end_s);
        let begin = START + RobotDuration::from_millis(150);
        for measurements in [&mut self.direct, &mut self.recorded] {
            measurements.retain(|it| it.stamp <= end && (it.stamp >= begin || !is_scan(it)));
        }
    }

    /// The recorded measurements and the simulation's poses, which are the true ones.
    pub(super) fn with_truth(&self) -> Vec<Measurement> {
        let is_pose = |it: &&Measurement| matches!(it.data, MeasurementData::Odometry { .. });
        let poses = self.direct.iter().filter(is_pose);
        let mut all: Vec<_> = poses.chain(&self.recorded).cloned().collect();
        all.sort_by_key(|it| it.stamp);
        all
    }
}

fn is_joints(measurement: &Measurement) -> bool {
    matches!(measurement.data, MeasurementData::Joints(_))
}

fn is_scan(measurement: &Measurement) -> bool {
    matches!(measurement.data, MeasurementData::Scan { .. })
}

/// Reads the recording of the devices, and gives its measurements the streams and the times of the simulation.
///
/// A device's measurements are late by a constant delay that the edge cannot know; on a real vehicle it is configured
/// as `time_offset_s`. Here it is measured with the scans of the main laser and applied to all, then with the angles of
/// the servo, whose replies carry no time, and applied to these. `None` if the machine was too busy.
fn recorded(
    path: &Path,
    streams: &[Stream],
    direct: &[Measurement],
    has_servo: bool,
) -> Option<Vec<Measurement>> {
    let id = |device: &str| {
        let name = match device {
            "/laser" => "/scan",
            "/servo" | "/encoders" => "/joint_states",
            "/ahrs" | "/imu" => "/imu/data",
            "/gps" => "/fix",
            other => other,
        };
        let at = streams.iter().position(|stream| stream.name == name);
        StreamId(at.unwrap_or_else(|| panic!("{device} in {streams:?}")) as u16)
    };
    let mut reader = recording::open(path, Selection::All).unwrap();
    let mut all = Vec::new();
    while let Some(mut measurement) = reader.next_measurement().unwrap() {
        let stream = &reader.streams()[usize::from(measurement.stream.0)].stream;
        measurement.stream = id(&stream.name);
        all.push(measurement);
    }
    let main = id("/laser");
    let late = scans_late(main, direct, &all)?;
    for measurement in &mut all {
        measurement.stamp = measurement.stamp - late;
    }
    // Earlier measurements are the devices' own: the simulation had not begun.
    all.retain(|it| it.stamp >= START - RobotDuration::from_millis(5));
    if has_servo {
        let late = angles_late(direct, &all)?;
        for joints in all.iter_mut().filter(|it| is_joints(it)) {
            joints.stamp = joints.stamp - late;
        }
    }
    all.sort_by_key(|it| it.stamp);
    Some(all)
}

/// By how much the recorded scans of a stream are later than the simulation's; `None` if more than one in a hundred is
/// missing or the machine was too busy.
fn scans_late(
    stream: StreamId,
    direct: &[Measurement],
    recorded: &[Measurement],
) -> Option<RobotDuration> {
    let scans = |of: &[Measurement]| -> Vec<(RobotTime, Vec<f32>)> {
        let of_stream = of.iter().filter(|it| it.stream == stream);
        let scans = of_stream.filter_map(|it| match &it.data {
            MeasurementData::Scan { scan, .. } => Some((it.stamp, scan.ranges_m.clone())),
            _ => None,
        });
        scans.collect()
    };
    // No two scans of the simulation have the same noise.
    let is_same = |a: &[f32], b: &[f32]| {
        let pairs = a.iter().zip(b);
        let hits: Vec<_> = pairs
            .filter(|(a, b)| a.is_normal() && b.is_normal())
            .collect();
        let same = hits.iter().filter(|(a, b)| (*a - *b).abs() < 1e-3);
        10 * same.count() > 9 * hits.len()
    };
    let (direct, recorded) = (scans(direct), scans(recorded));
    let (mut late, mut missing, mut next) = (Vec::new(), 0, 0);
    for (stamp, ranges_m) in &recorded {
        let mut rest = direct[next..].iter();
        if let Some(skipped) = rest.position(|(_, other)| is_same(ranges_m, other)) {
            missing += skipped;
            late.push(stamp.since(direct[next + skipped].0).as_nanos());
            next += skipped + 1;
        }
    }
    if 100 * missing > late.len() {
        println!("{missing} scans are missing");
        return None;
    }
    prompt(late)
}

/// By how much the recorded angles of a servo are later than the simulation's; `None` if the machine was too busy.
fn angles_late(direct: &[Measurement], recorded: &[Measurement]) -> Option<RobotDuration> {
    const NEAR_S: f64 = 0.005;
    let angles = |of: &[Measurement]| -> Vec<(RobotTime, f64)> {
        let angles = of.iter().filter_map(|it| match &it.data {
            MeasurementData::Joints(joints) => Some((it.stamp, joints[0].1)),
            _ => None,
        });
        angles.collect()
    };
    let direct = angles(direct);
    let late = angles(recorded)
        .into_iter()
        .filter_map(|(stamp, angle_rad)| {
            let same = direct
                .iter()
                .filter(|(_, other_rad)| (other_rad - angle_rad).abs() < 1e-6);
            let late = same.map(|(other, _)| stamp.since(*other));
            late.filter(|late| late.as_secs_f64().abs() < NEAR_S)
                .min_by_key(|late| late.as_nanos().abs())
                .map(RobotDuration::as_nanos)
        });
    prompt(late.collect())
}

/// The median of these delays, nanoseconds; `None` if too many deviate from it by [`BUSY_MS`].
fn prompt(mut late: Vec<i64>) -> Option<RobotDuration> {
    late.sort_unstable();
    let usually = *late.get(late.len() / 2)?;
    let off_ms = |percent: usize| {
        let nanos = late[percent * (late.len() - 1) / 100];
        (nanos - usually) as f64 / 1e6
    };
    let off_ms = [0, 1, 50, 99, 100].map(off_ms);
    println!("{} measurements, off by {off_ms:.3?} ms", late.len());
    let is_prompt = off_ms[1] > -BUSY_MS && off_ms[3] < BUSY_MS;
    is_prompt.then(|| RobotDuration::from_nanos(usually))
}
