//! The live source of a vehicle whose devices are read without a middleware.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use super::arrival_order::ArrivalOrder;
use super::{POLL_TIMEOUT, ProbeBuffer, StreamSelection};
use crate::config::{Config, SensorConfig};
use crate::runtime::mapping_stage::MAX_QUEUE_DELAY;
use crate::runtime::source::{Source, SourceItem, SourceLosses};
use crate::survey::Survey;
use drivers::config::Output;
use drivers::joint_goal::JointGoal;
use drivers::status::{DeviceStatuses, Loss};
use drivers::supervisor::Reading;
use drivers::{Drivers, StartError};
use measurement::cloud::Cloud;
use measurement::drops::{DropCounts, DropReason};
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{GeodeticFix, ImuSample, Measurement, MeasurementData, Stream, StreamId};
use network::clock;
use recording::{Position, RecordingError, StreamSummary};

/// Readings that wait: two seconds of fast sensors.
const MAX_READINGS: usize = 4096;

/// The encoders of the motor controller, which the motor guard reads, as a device.
const ENCODERS: &str = "encoders";
/// The autopilot, likewise; the topics of its outputs begin with it.
const AUTOPILOT: &str = "autopilot";
const JOINTS: &str = "sensor_msgs/JointState";

/// What the motor guard forwards, and the read end of its pipe.
#[cfg(target_os = "linux")]
pub(in crate::runtime) type ForwardedInput = (Forwarded, std::os::fd::OwnedFd);
#[cfg(not(target_os = "linux"))]
pub(in crate::runtime) type ForwardedInput = std::convert::Infallible;

#[cfg(target_os = "linux")]
pub(in crate::runtime) enum Forwarded {
    Encoders(drivers::roboteq_encoders::RoboteqEncoders),
    Autopilot(drivers::mavlink::Autopilot),
}

pub(in crate::runtime) struct DeviceSource {
    /// They end with it.
    drivers: Drivers,
    statuses: DeviceStatuses,
    readings: Receiver<Reading>,
    streams: Vec<Stream>,
    selection: StreamSelection,
    order: ArrivalOrder,
    /// From the steady clock of the stamps to the wall clock at the start, so that a recording has dates.
    to_wall_clock: RobotDuration,
    /// Scans that were dropped because mapping was too slow.
    scans_skipped: u64,
    /// Items were returned since the last `Idle`.
    is_busy: bool,
}

impl DeviceSource {
    /// Starts the devices. One that is not there is waited for.
    pub(in crate::runtime) fn start(
        config: &Config,
        forwarded: Option<ForwardedInput>,
        selection: StreamSelection,
    ) -> Result<Self, StartError> {
        let (sender, readings) = sync_channel(MAX_READINGS);
        let streams = outputs(config, forwarded.is_some()).map(|(stream, _)| stream);
        let streams = streams.collect();
        let mut drivers = Drivers::start(&config.devices, clock::now, &sender)?;
        #[cfg(target_os = "linux")]
        match forwarded {
            Some((Forwarded::Encoders(encoders), pipe)) => {
                drivers.add_forwarded(ENCODERS, (encoders, pipe), clock::now, &sender);
            }
            Some((Forwarded::Autopilot(autopilot), pipe)) => {
                drivers.add_forwarded(AUTOPILOT, (autopilot, pipe), clock::now, &sender);
            }
            None => {}
        }
        let wall_ns = i64::try_from(clock::seconds_since_1970()).unwrap_or(0) * 1_000_000_000;
        Ok(Self {
            statuses: drivers.statuses().clone(),
            drivers,
            readings,
            streams,
            selection,
            // Their stamps are of one clock, and each stream is in order.
            order: ArrivalOrder::new(Duration::ZERO),
            to_wall_clock: RobotDuration::from_nanos(wall_ns - clock::now().nanos()),
            scans_skipped: 0,
            is_busy: false,
        })
    }

    /// Of the joints that devices turn.
    pub(in crate::runtime) fn goals(&self) -> &[JointGoal] {
        self.drivers.goals()
    }

    pub(in crate::runtime) const fn statuses(&self) -> &DeviceStatuses {
        &self.statuses
    }

    fn take(&mut self, reading: Reading) -> Option<SourceItem> {
        let mut measurement = reading.measurement;
        let is_scan = measurement.data.is_scan();
        if is_scan && clock::elapsed(reading.arrived) > MAX_QUEUE_DELAY {
            self.scans_skipped += 1;
            return None;
        }
        measurement.stamp = measurement.stamp + self.to_wall_clock;
        if is_scan {
            tracing::trace!(stamp = %measurement.stamp, at_ns = reading.arrived.nanos(), "scan has arrived");
        }
        let stream = self.streams.get(usize::from(measurement.stream.0))?;
        if self.selection.mapped.contains(&stream.name) {
            self.order.push(measurement, reading.arrived);
            return self.order.next();
        }
        let is_recorded = self.selection.others;
        is_recorded.then_some(SourceItem::Unmapped(measurement))
    }
}

impl Source for DeviceSource {
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        loop {
            if let Some(item) = self.order.next() {
                return Ok(Some(item));
            }
            let wait = if self.is_busy {
                Duration::ZERO
            } else {
                POLL_TIMEOUT
            };
            match self.readings.recv_timeout(wait) {
                Ok(reading) => {
                    if let Some(item) = self.take(reading) {
                        self.is_busy = true;
                        return Ok(Some(item));
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.order.release(clock::now());
                    self.is_busy = false;
                    return Ok(Some(SourceItem::Idle));
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
            }
        }
    }

    fn streams_from(&self, from: usize) -> Vec<Stream> {
        self.streams.get(from..).unwrap_or_default().to_vec()
    }

    fn position(&self) -> Option<Position> {
        None
    }

    fn lost_total(&self) -> u64 {
        self.statuses.lost_total() + self.order.lost_total() + self.scans_skipped
    }

    fn lost(&self) -> SourceLosses {
        let mut lost = SourceLosses::default();
        for (name, status) in self.statuses().now() {
            for (loss, count) in status.losses {
                lost.counts.add_many(drop_reason(loss), count);
                lost.notes.push(format!("{name}: {count} {loss}"));
            }
        }
        lost.counts
            .add_many(DropReason::QueueFull, self.scans_skipped);
        self.order.add_losses(&mut lost);
        lost
    }
}

const fn drop_reason(loss: Loss) -> DropReason {
    match loss {
        Loss::Decoder(drivers::DropReason::Lost) => DropReason::Lost,
        Loss::Decoder(_) | Loss::Unexpected => DropReason::Undecodable,
        Loss::Stale | Loss::Repeated => DropReason::Late,
        Loss::BadScan => DropReason::BadScan,
        Loss::QueueFull => DropReason::QueueFull,
    }
}

/// Gives a sensor without a topic that of the device of its name.
pub(in crate::runtime) fn name_topics(config: &mut Config) {
    for (name, sensor) in &mut config.sensors {
        let topic = match sensor {
            SensorConfig::LaserScan(range)
            | SensorConfig::Sonar(range)
            | SensorConfig::Ultrasonic(range)
            | SensorConfig::Lidar(range)
            | SensorConfig::Bumper(range) => &mut range.topic,
            SensorConfig::WheelEncoders(encoders) => &mut encoders.topic,
            SensorConfig::Imu(imu) => &mut imu.topic,
            SensorConfig::Gps(gps) => &mut gps.topic,
        };
        if topic.is_none() && config.devices.contains_key(name) {
            *topic = Some(topic_of(name));
        }
    }
}

fn topic_of(device: &str) -> String {
    format!("/{device}")
}

/// The streams of the devices, in the order of their numbers, and what each measures.
fn outputs(
    config: &Config,
    has_forwarded: bool,
) -> impl Iterator<Item = (Stream, Option<MeasurementData>)> {
    let autopilot = config.motors.mavlink.as_ref().filter(|_| has_forwarded);
    let autopilot = autopilot.into_iter().flat_map(|_| {
        let outputs = drivers::mavlink::Autopilot::OUTPUTS.into_iter();
        outputs
            .zip([imu(), fix(), scan()])
            .map(|(output, (type_name, data))| {
                let stream = Stream {
                    name: format!("/{AUTOPILOT}/{output}"),
                    type_name: type_name.to_owned(),
                };
                (stream, data)
            })
    });
    let encoders = config.motors.roboteq.as_ref().filter(|_| has_forwarded);
    let encoders = encoders.and_then(|roboteq| roboteq.encoders.as_ref());
    let encoders = encoders.map(|encoders| {
        let joints = [&encoders.left_joint, &encoders.right_joint];
        let joints = joints.map(|joint| (joint.clone(), 0.0)).to_vec();
        let stream = Stream {
            name: topic_of(ENCODERS),
            type_name: JOINTS.to_owned(),
        };
        (stream, Some(MeasurementData::Joints(joints)))
    });
    let of_devices = config.devices.iter().map(|(name, device)| {
        let topic = topic_of(name);
        let of_topic = |sensor: &&SensorConfig| sensor.topic() == Some(&topic);
        let sensor = config.sensors.values().find(of_topic);
        let is_sounder = sensor.is_some_and(|sensor| sensor.range_sensor().is_some());
        let (type_name, data) = match device.kind.output() {
            Output::Scans => scan(),
            Output::Clouds => (
                "sensor_msgs/PointCloud2",
                Some(MeasurementData::Cloud(Cloud::default())),
            ),
            Output::FixesOrDepths if is_sounder => scan(),
            Output::Fixes | Output::FixesOrDepths => fix(),
            Output::Attitudes => imu(),
            Output::Angles => {
                let joint = device.joint.iter().map(|joint| (joint.clone(), 0.0));
                (JOINTS, Some(MeasurementData::Joints(joint.collect())))
            }
            Output::Nothing => ("", None),
        };
        let type_name = type_name.to_owned();
        (
            Stream {
                name: topic,
                type_name,
            },
            data,
        )
    });
    of_devices.chain(encoders).chain(autopilot)
}

fn fix() -> (&'static str, Option<MeasurementData>) {
    let fix = GeodeticFix {
        latitude_deg: 0.0,
        longitude_deg: 0.0,
        altitude_m: 0.0,
        status: 0,
        sigma_m: None,
    };
    ("sensor_msgs/NavSatFix", Some(MeasurementData::Fix(fix)))
}

fn imu() -> (&'static str, Option<MeasurementData>) {
    let imu = ImuSample {
        orientation_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
        angular_velocity_radps: [0.0; 3],
        linear_acceleration_mps2: [0.0; 3],
    };
    ("sensor_msgs/Imu", Some(MeasurementData::Imu(imu)))
}

fn scan() -> (&'static str, Option<MeasurementData>) {
    let (scan, own_pose) = (Scan::default(), None);
    (
        "sensor_msgs/LaserScan",
        Some(MeasurementData::Scan { scan, own_pose }),
    )
}

/// What the devices of a vehicle will measure, as a survey of a recording of it would find it.
pub(in crate::runtime) fn survey(
    config: &Config,
    has_forwarded: bool,
) -> Result<Survey, RecordingError> {
    let forwarded = if config.motors.mavlink.is_some() {
        AUTOPILOT
    } else {
        ENCODERS
    };
    let mut streams = Vec::new();
    let mut measurements = VecDeque::new();
    for ((stream, data), number) in outputs(config, has_forwarded).zip(0..) {
        let name = config.devices.keys().nth(streams.len());
        measurements.extend(data.map(|data| Measurement {
            stamp: RobotTime::from_nanos(0),
            stream: StreamId(number),
            frame: name.map_or(forwarded, String::as_str).into(),
            data,
        }));
        streams.push(StreamSummary {
            stream,
            understood: true,
            messages: 1,
            first: None,
            last: None,
        });
    }
    let probe = ProbeBuffer {
        measurements: measurements.iter(),
        streams: &streams,
        losses: &DropCounts::default(),
        loss_notes: &[],
    };
    probe.survey("[devices]")
}
