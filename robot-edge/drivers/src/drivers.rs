//! All devices of a vehicle, each in its own task on one thread.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::sync::mpsc::SyncSender;
#[cfg(target_os = "linux")]
use std::{os::fd::OwnedFd, sync::Arc};

use measurement::StreamId;
use measurement::byte_limit::ByteLimit;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{mpsc, watch};

use crate::config::{DeviceConfig, Kind, Problem};
use crate::device::Device;
use crate::dynamixel::Dynamixel;
use crate::hokuyo::Hokuyo;
use crate::imagenex::Imagenex852;
use crate::imagenex_deltat::ImagenexDeltat;
use crate::joint_goal::JointGoal;
use crate::nmea::Nmea;
use crate::ntrip::Ntrip;
use crate::packet_lidar::PacketLidar;
use crate::ping::Ping1d;
use crate::rplidar::Rplidar;
use crate::sick_cola::SickCola;
use crate::sick_ldlrs::SickLdlrs;
use crate::status::{DeviceStatus, DeviceStatuses};
use crate::supervisor::{Clock, Link, Reading, Readings, Settings, Supervisor};
use crate::ublox::Ublox;
use crate::xsens::Xsens;
#[cfg(target_os = "linux")]
use crate::{
    beam_selection::BeamSelection,
    transport::{Address, PipeEnd},
};

/// Messages that wait at a link between two devices.
const LINK_CAPACITY: usize = 64;

/// Payload of the readings that wait for their receiver: 20 clouds of 64 rings and 2048 columns, or two seconds of one such lidar.
const MAX_READING_BYTES: usize = 64 << 20;

/// The running tasks. They end when this is dropped.
#[derive(Debug)]
pub struct Drivers {
    statuses: DeviceStatuses,
    goals: Vec<JointGoal>,
    limit: ByteLimit,
    runtime: Runtime,
}

/// Why devices cannot be started. A device that is not there is no reason.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// A setting.
    #[error("{0}")]
    Config(Problem),
    /// The system gives no thread.
    #[error("no thread for devices: {0}")]
    Thread(#[from] io::Error),
}

impl Drivers {
    /// Starts the devices of a configuration. Their numbers, the streams of their measurements, are
    /// their places in it.
    pub fn start(
        configs: &BTreeMap<String, DeviceConfig>,
        clock: Clock,
        readings: &SyncSender<Reading>,
    ) -> Result<Self, StartError> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("devices")
            .enable_all()
            .build()?;
        let mut links = links(configs);
        let (mut statuses, mut goals) = (Vec::new(), Vec::new());
        let limit = ByteLimit::new(MAX_READING_BYTES);
        for (number, (name, config)) in configs.iter().enumerate() {
            let problem =
                |(key, text): (&str, String)| StartError::Config(Problem::new(name, key, text));
            let settings = Settings {
                name: name.as_str().into(),
                stream: StreamId(number as u16),
                address: config.address().map_err(problem)?,
                beams: config.beams().map_err(problem)?,
                identity: config.identity.clone(),
            };
            let task = Task {
                runtime: &runtime,
                settings,
                clock,
                readings: Readings {
                    sender: readings.clone(),
                    limit: limit.clone(),
                },
                link: links.remove(name),
            };
            let missing = |key, text: &str| problem((key, text.to_owned()));
            let status = match config.kind {
                Kind::SickCola => task.spawn(SickCola::new(config)),
                Kind::SickLdlrs => task.spawn(SickLdlrs::new(config)),
                Kind::Hokuyo => task.spawn(Hokuyo::default()),
                Kind::Rplidar => task.spawn(Rplidar::new(config)),
                Kind::Xsens => task.spawn(Xsens::new(config)),
                Kind::Nmea => task.spawn(Nmea::new(config)),
                Kind::Ublox => task.spawn(Ublox::new(config)),
                Kind::Ntrip => task.spawn(Ntrip::new(config).ok_or_else(|| {
                    missing("mountpoint", "a mountpoint and a user are words without spaces")
                })?),
                Kind::Imagenex852 => task.spawn(Imagenex852::new(config).ok_or_else(|| {
                    missing("range_max_m", "the device has 5, 10, 20, 30, 40 and 50 m, and a smallest range up to 25 m")
                })?),
                Kind::ImagenexDeltat => task.spawn(ImagenexDeltat::default()),
                Kind::Ping1d => task.spawn(Ping1d::new(config)),
                Kind::Dynamixel => {
                    let servo = Dynamixel::new(config)
                        .ok_or_else(|| missing("servo", "`servo`, `servo_id` and `joint` are needed"))?;
                    goals.extend(servo.goal().cloned());
                    task.spawn(servo)
                }
                Kind::Velodyne | Kind::Ouster | Kind::Livox => {
                    task.spawn(PacketLidar::new(config).map_err(problem)?)
                }
            };
            statuses.push((name.clone(), status));
        }
        Ok(Self {
            statuses: DeviceStatuses(statuses),
            goals,
            limit,
            runtime,
        })
    }

    /// Adds a device whose port another process owns: it forwards what it receives through the pipe with this read
    /// end. Its number is the next one.
    #[cfg(target_os = "linux")]
    pub fn add_forwarded<D: Device>(
        &mut self,
        name: &str,
        (device, read_end): (D, OwnedFd),
        clock: Clock,
        readings: &SyncSender<Reading>,
    ) {
        let task = Task {
            runtime: &self.runtime,
            settings: Settings {
                name: name.into(),
                stream: StreamId(self.statuses.0.len() as u16),
                address: Address::Pipe(PipeEnd(Arc::new(read_end))),
                beams: BeamSelection::default(),
                identity: None,
            },
            clock,
            readings: Readings {
                sender: readings.clone(),
                limit: self.limit.clone(),
            },
            link: None,
        };
        let status = task.spawn(device);
        self.statuses.0.push((name.to_owned(), status));
    }

    /// Of the joints that can be turned.
    pub fn goals(&self) -> &[JointGoal] {
        &self.goals
    }

    /// What is known of the devices that were started so far.
    pub const fn statuses(&self) -> &DeviceStatuses {
        &self.statuses
    }
}

/// The ends of the links between NTRIP casters and receivers, by name.
fn links(configs: &BTreeMap<String, DeviceConfig>) -> BTreeMap<&String, Link> {
    let mut links = BTreeMap::new();
    let mut used = BTreeSet::new();
    for (receiver, config) in configs {
        let Some((caster, _)) = config
            .corrections
            .as_ref()
            .and_then(|caster| configs.get_key_value(caster))
        else {
            continue;
        };
        if !used.insert(caster) {
            continue;
        }
        let (to_receiver, corrections) = mpsc::channel(LINK_CAPACITY);
        let (to_caster, positions) = mpsc::channel(LINK_CAPACITY);
        links.insert(
            receiver,
            Link {
                to: to_caster,
                from: corrections,
            },
        );
        links.insert(
            caster,
            Link {
                to: to_receiver,
                from: positions,
            },
        );
    }
    links
}

/// What the task of a device needs besides the device.
struct Task<'a> {
    runtime: &'a Runtime,
    settings: Settings,
    clock: Clock,
    readings: Readings,
    link: Option<Link>,
}

impl Task<'_> {
    fn spawn<D: Device>(self, device: D) -> watch::Receiver<DeviceStatus> {
        let (supervisor, status) =
            Supervisor::new(device, self.settings, self.clock, self.readings, self.link);
        self.runtime.spawn(supervisor.run());
        status
    }
}
