//! Three-dimensional lidars that send packets over UDP: Velodyne, Ouster and Livox Mid-360. Crate `lidar` decodes them.
//!
//! A revolution is complete when the first packet of the next one has come: that packet's time is when it was sent, and the time
//! since the revolution's first point, by the same clock, is its age.

use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

use lidar::livox::Livox;
use lidar::ouster::Ouster;
use lidar::velodyne::{Calibration, Velodyne};
use lidar::{LidarDecoder, PacketError, Revolution, Sensor, ouster};
use measurement::MeasurementData;
use measurement::time::RobotTime;

use crate::clock_mapping::DeviceTime;
use crate::config::{DeviceConfig, Kind};
use crate::device::{Device, Event, Preparation, Sample, Step};
use crate::{Decoder, DropReason, Dropped};

mod preparation;

use preparation::{LivoxHost, OusterMetadata};

/// A Velodyne's clock begins again every hour.
const HOUR_NS: i64 = 3_600_000_000_000;
/// No sensor turns as slowly.
const MAX_REVOLUTION_S: f64 = 2.0;

/// A lidar.
#[derive(Debug)]
pub struct PacketLidar(Model);

#[derive(Debug)]
enum Model {
    Velodyne(Box<Velodyne>),
    Ouster(Box<Ouster>),
    OusterAt(Box<OusterMetadata>),
    Livox(Option<LivoxHost>),
}

impl PacketLidar {
    /// As configured. Fails with a key and what is wrong with it.
    pub fn new(config: &DeviceConfig) -> Result<Self, (&'static str, String)> {
        let read = |key: &'static str, path: &Path| {
            let text = std::fs::read_to_string(path);
            text.map_err(|error| (key, format!("{}: {error}", path.display())))
        };
        let model = match (config.kind, &config.metadata, &config.calibration) {
            (Kind::Ouster, Some(path), _) => {
                let ouster = Ouster::new(&read("metadata", path)?);
                let wrong = |error| ("metadata", format!("{}: {error}", path.display()));
                Model::Ouster(Box::new(ouster.map_err(wrong)?))
            }
            (Kind::Ouster, None, _) => Model::OusterAt(Box::new(OusterMetadata::new(config)?)),
            (Kind::Livox, ..) => Model::Livox(LivoxHost::new(config)),
            (_, _, Some(path)) => {
                let calibration = Calibration::read(&read("calibration", path)?);
                let wrong = |error| ("calibration", format!("{}: {error}", path.display()));
                Model::Velodyne(Box::new(Velodyne::calibrated(calibration.map_err(wrong)?)))
            }
            _ => Model::Velodyne(Box::default()),
        };
        Ok(Self(model))
    }

    /// On the sensor's clock.
    fn time(&self, seconds: f64) -> DeviceTime {
        let period_ns = match self.0 {
            Model::Velodyne(_) => HOUR_NS,
            Model::Ouster(_) | Model::OusterAt(_) | Model::Livox(_) => i64::MAX,
        };
        DeviceTime {
            nanos: ((seconds * 1e9) as i64).rem_euclid(period_ns),
            period_ns,
        }
    }
}

impl Device for PacketLidar {
    type Decoder = PacketDecoder;

    fn connect(&mut self) -> PacketDecoder {
        PacketDecoder::new(match &self.0 {
            Model::Velodyne(velodyne) => Some(Sensor::Velodyne(velodyne.clone())),
            Model::Ouster(ouster) => Some(Sensor::Ouster(ouster.clone())),
            Model::OusterAt(metadata) => metadata.ouster().map(|it| Sensor::Ouster(Box::new(it))),
            Model::Livox(_) => Some(Sensor::Livox(Box::<Livox>::default())),
        })
    }

    fn preparation(&mut self) -> Option<&mut dyn Preparation> {
        match &mut self.0 {
            Model::OusterAt(metadata) => Some(&mut **metadata),
            Model::Livox(Some(host)) => Some(host),
            Model::Livox(None) | Model::Velodyne(_) | Model::Ouster(_) => None,
        }
    }

    fn step(&self, _step: usize) -> Step {
        Step::Done
    }

    fn take(&mut self, message: Message, _awaited: Option<usize>, events: &mut Vec<Event>) {
        events.push(match message {
            Message::Identity(identity) => Event::Identity(identity),
            Message::Refused(error) => Event::Refused(error.to_string()),
            Message::Gyroscopes => Event::Unexpected,
            Message::Revolution(revolution) => Event::Sample(Sample {
                sent: Some(self.time(revolution.completed_s)),
                age: age(&revolution),
                data: MeasurementData::Cloud(revolution.cloud),
            }),
        });
    }
}

fn age(revolution: &Revolution) -> Duration {
    let age_s = revolution.completed_s - revolution.sensor_time_s;
    let age_s = if (0.0..MAX_REVOLUTION_S).contains(&age_s) {
        age_s
    } else {
        // The sensor's clock was set meanwhile.
        let last = revolution.cloud.points.last();
        last.map_or(0.0, |point| point.after_s.into())
    };
    Duration::try_from_secs_f64(age_s).unwrap_or_default()
}

/// What the packets of a lidar give.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Which one it is.
    Identity(String),
    /// A revolution.
    Revolution(Revolution),
    /// Before any packet that could be decoded came one that could not: it is another sensor.
    Refused(PacketError),
    /// Turn rates and accelerations, which nothing takes without an orientation.
    Gyroscopes,
}

/// Decodes the packets of a lidar.
#[derive(Debug)]
pub struct PacketDecoder {
    /// `None` if an Ouster's metadata are not known.
    lidar: Option<LidarDecoder>,
    messages: VecDeque<Message>,
    dropped: Dropped,
}

impl PacketDecoder {
    fn new(sensor: Option<Sensor>) -> Self {
        Self {
            lidar: sensor.map(LidarDecoder::new),
            messages: VecDeque::new(),
            dropped: Dropped::default(),
        }
    }
}

impl Decoder for PacketDecoder {
    type Message = Message;

    fn push(&mut self, datagram: &[u8]) {
        let Some(lidar) = &mut self.lidar else {
            return self.dropped.add(DropReason::UnknownKind, 1);
        };
        let before = lidar.counts();
        // The supervisor stamps what is complete.
        let decoded = lidar.push(RobotTime::default(), datagram);
        let lost = lidar.counts().lost - before.lost;
        self.dropped.add(DropReason::Lost, lost as usize);
        match decoded {
            Ok(revolutions) => {
                if before.decoded == 0 {
                    let identity = lidar.sensor().identity();
                    self.messages.extend(identity.map(Message::Identity));
                }
                self.messages
                    .extend(revolutions.into_iter().map(Message::Revolution));
            }
            Err(_)
                if matches!(lidar.sensor(), Sensor::Ouster(_))
                    && ouster::imu(datagram).is_some() =>
            {
                self.messages.push_back(Message::Gyroscopes);
            }
            Err(error) => {
                self.dropped.add(drop_reason(error), 1);
                if before.decoded == 0 {
                    self.messages.push_back(Message::Refused(error));
                }
            }
        }
    }

    fn next_message(&mut self) -> Option<Message> {
        self.messages.pop_front()
    }

    fn dropped(&self) -> &Dropped {
        &self.dropped
    }
}

const fn drop_reason(error: PacketError) -> DropReason {
    match error {
        PacketError::Length { .. } => DropReason::Length,
        PacketError::Damaged => DropReason::Field,
        PacketError::Checksum => DropReason::Checksum,
        PacketError::OtherSensor(_)
        | PacketError::UnknownModel
        | PacketError::OtherCalibration(_) => DropReason::UnknownKind,
    }
}

#[cfg(test)]
mod tests;
