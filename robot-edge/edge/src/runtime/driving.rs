//! The motors of a run, and the rules of driving it.

use std::path::{Path, PathBuf};
#[cfg(target_os = "linux")]
use std::{io, os::fd::OwnedFd, sync::Arc};

use anyhow::Context as _;
use protocol::keys::RobotId;
use protocol::tile::BootId;

#[cfg(target_os = "linux")]
use super::live::devices::Forwarded;
use super::live::devices::ForwardedInput;
use super::live_recording::LiveRecording;
#[cfg(target_os = "linux")]
use crate::actuators::mavlink::obstacle_pipe::ObstacleSender;
#[cfg(target_os = "linux")]
use crate::actuators::motor_guard::{GuardCommand, GuardedMotors};
use crate::actuators::published_velocity::PublishedVelocity;
#[cfg(target_os = "linux")]
use crate::actuators::{forward_pipe, motor_link::MotorLinkConfig};
use crate::cli::DrivingOptions;
use crate::config::{Config, ConfigIssue, TwistConfig};
#[cfg(target_os = "linux")]
use crate::driving::autopilot::AutopilotMonitor;
#[cfg(feature = "simulation")]
use crate::driving::motors::SimulatedMotors;
use crate::driving::planner::PlannerExchange;
use crate::driving::{
    DriveLog, Driving, DrivingSettings, EStopFile, EStopStore, LocalCommands, MonitorMapInput,
    MonitorSensorInput, Motors, Operators, monitor_input,
};
use crate::exit::UsageError;
use crate::ros2::{RosNode, TwistPublisher};
use crate::service_manager::ServiceManager;
#[cfg(target_os = "linux")]
use mapping::ground_plane::GroundTracker;
use network::audit::Audit;
use recording::new_file::{self, NewFile};
use teleop::Rules;
use teleop::SettingError;
use teleop::collision_monitor::CollisionMonitorRules;

/// The inputs of the collision monitor: from localization and from mapping.
pub(super) type CollisionMonitorInputs = (MonitorSensorInput, MonitorMapInput);

#[derive(Clone, Debug)]
pub(super) enum MotorsPlan {
    None,
    #[cfg(feature = "simulation")]
    Simulated(SimulatedMotors),
    /// Velocities are published in a ROS 2 system, in this frame of the vehicle.
    Ros2Twist(RosNode, TwistConfig, String),
    /// Real motors, owned by the motor guard.
    #[cfg(target_os = "linux")]
    Guarded(MotorLinkConfig),
}

/// Capacity of the pipe for what an autopilot sends: some 3 s of a fast link.
#[cfg(target_os = "linux")]
const AUTOPILOT_BYTES: usize = 1 << 16;

/// The motors of a run, and the files of driving.
#[derive(Clone, Debug)]
pub(super) struct DrivePlan {
    motors: MotorsPlan,
    /// Write end of the pipe through which the motor guard forwards what encoders or an autopilot say.
    #[cfg(target_os = "linux")]
    forward_pipe: Option<Arc<OwnedFd>>,
    #[cfg(target_os = "linux")]
    autopilot: drivers::mavlink::AutopilotStatus,
    log: Option<PathBuf>,
    state: Option<PathBuf>,
    recordings: Option<PathBuf>,
    maps: Option<PathBuf>,
    /// Of the planner, where one is configured and can be reached.
    pub(super) planner: Option<PlannerExchange>,
}

impl DrivePlan {
    pub(super) fn none() -> Self {
        Self {
            motors: MotorsPlan::None,
            #[cfg(target_os = "linux")]
            forward_pipe: None,
            #[cfg(target_os = "linux")]
            autopilot: drivers::mavlink::AutopilotStatus::default(),
            log: None,
            state: None,
            recordings: None,
            maps: None,
            planner: None,
        }
    }

    pub(super) fn new(motors: MotorsPlan, options: &DrivingOptions) -> Self {
        Self {
            motors,
            #[cfg(target_os = "linux")]
            forward_pipe: None,
            #[cfg(target_os = "linux")]
            autopilot: drivers::mavlink::AutopilotStatus::default(),
            log: options.drive_log.clone(),
            state: options.state_dir.clone(),
            recordings: options.recordings.clone(),
            maps: options.maps.clone(),
            planner: None,
        }
    }

    /// What reads the encoders of the motor controller, if they are configured, or the autopilot, and the pipe that it
    /// reads. Once, before the motors are started: the guard asks for counts if this was called. For
    /// [`drivers::Drivers::add_forwarded`].
    #[cfg(target_os = "linux")]
    pub(super) fn forwarded_input(&mut self) -> io::Result<Option<ForwardedInput>> {
        let (reader, capacity) = match &self.motors {
            MotorsPlan::Guarded(MotorLinkConfig::Roboteq(config)) => match config.encoders() {
                Some(encoders) => (Forwarded::Encoders(encoders), forward_pipe::LEAST_BYTES),
                None => return Ok(None),
            },
            MotorsPlan::Guarded(MotorLinkConfig::Mavlink(config)) => {
                let (_, system) = config.numbers();
                let autopilot = drivers::mavlink::Autopilot::new(system, self.autopilot.clone());
                (Forwarded::Autopilot(autopilot), AUTOPILOT_BYTES)
            }
            _ => return Ok(None),
        };
        let (read_end, write_end) = forward_pipe::pipe(capacity)?;
        self.forward_pipe = Some(Arc::new(write_end));
        Ok(Some((reader, read_end)))
    }

    #[cfg(not(target_os = "linux"))]
    pub(super) const fn forwarded_input(&mut self) -> std::io::Result<Option<ForwardedInput>> {
        Ok(None)
    }

    /// Ends of the pipe for distances of obstacles, if the autopilot is to have them: to read, and to write.
    #[cfg(target_os = "linux")]
    fn obstacle_pipe(&self) -> io::Result<Option<[Arc<OwnedFd>; 2]>> {
        match &self.motors {
            MotorsPlan::Guarded(MotorLinkConfig::Mavlink(config)) if config.obstacle_distance => {
                let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES)?;
                Ok(Some([read_end, write_end].map(Arc::new)))
            }
            _ => Ok(None),
        }
    }

    fn start_motors(
        &self,
        #[cfg(target_os = "linux")] obstacle_pipe: Option<Arc<OwnedFd>>,
    ) -> anyhow::Result<Motors> {
        Ok(match &self.motors {
            MotorsPlan::None => Motors::None,
            #[cfg(feature = "simulation")]
            MotorsPlan::Simulated(motors) => Motors::Simulated(motors.clone()),
            MotorsPlan::Ros2Twist(node, TwistConfig { topic, message }, frame) => {
                let publisher = TwistPublisher::new(node, topic, *message, frame)?;
                let motors = PublishedVelocity::start(Box::new(publisher));
                Motors::Published(motors.context("no thread can be had to publish velocities")?)
            }
            #[cfg(target_os = "linux")]
            MotorsPlan::Guarded(config) => {
                let guarded = GuardCommand::this_program(config, self.forward_pipe.clone())
                    .map(|command| GuardCommand {
                        obstacle_pipe,
                        ..command
                    })
                    .and_then(|command| GuardedMotors::start(command, config.clone()));
                let guarded = guarded.context("the motors' guard cannot be started")?;
                match config {
                    MotorLinkConfig::Roboteq(_) => Motors::Guarded(guarded),
                    MotorLinkConfig::Mavlink(config) => {
                        let status = self.autopilot.clone();
                        let monitor = AutopilotMonitor::new(status, config.request_guided);
                        Motors::Autopilot(guarded, monitor)
                    }
                }
            }
        })
    }

    /// Goals for the planner of the configuration, if there is one and something to drive.
    #[must_use]
    pub(super) fn with_planner(self, config: &Config) -> Self {
        let has_planner = config.planner.is_some() && self.can_drive();
        Self {
            planner: has_planner.then(PlannerExchange::default),
            ..self
        }
    }

    pub(super) const fn can_drive(&self) -> bool {
        match self.motors {
            MotorsPlan::None => false,
            #[cfg(feature = "simulation")]
            MotorsPlan::Simulated(_) => true,
            MotorsPlan::Ros2Twist(..) => true,
            #[cfg(target_os = "linux")]
            MotorsPlan::Guarded(_) => true,
        }
    }

    pub(super) fn log(&self) -> Option<&Path> {
        self.log.as_deref()
    }

    pub(super) fn create_log(&self) -> anyhow::Result<Option<NewFile>> {
        let path = self.log.as_ref().filter(|_| self.can_drive());
        let file = path.map(|path| {
            new_file::create(path)
                .with_context(|| format!("{}: cannot write the drive log", path.display()))
        });
        file.transpose()
    }

    /// Where operators save maps.
    pub(super) fn maps(&self) -> Option<&Path> {
        self.maps.as_deref()
    }

    pub(super) const fn can_record(&self) -> bool {
        self.recordings.is_some() && self.can_drive()
    }

    pub(super) fn recording(
        &self,
        robot: &RobotId,
        vehicle: &str,
    ) -> anyhow::Result<Option<LiveRecording>> {
        let folder = self.recordings.as_ref().filter(|_| self.can_drive());
        let recording = folder.map(|folder| {
            LiveRecording::new(folder, robot.as_str(), vehicle)
                .with_context(|| format!("{}: cannot record here", folder.display()))
        });
        recording.transpose()
    }

    /// Starts the drive loop if there are motors. `publish_event` receives errors of the drive log.
    pub(super) fn start(
        &self,
        (robot, boot): (&RobotId, BootId),
        (operators, audit): (Operators, Option<Audit>),
        config: &Config,
        (log, publish_event): (
            Option<NewFile>,
            impl FnOnce(&'static str, String) + Send + 'static,
        ),
    ) -> anyhow::Result<Option<(Driving, Option<CollisionMonitorInputs>)>> {
        if !self.can_drive() {
            return Ok(None);
        }
        let mut rules = Rules::new(&config.teleop, &config.vehicle, &config.motors.locomotion())
            .map_err(usage_error)?;
        if let (Some(_), Some(planner)) = (&self.planner, &config.planner) {
            rules = rules.with_planner(planner.max_gap());
        }
        let monitor_rules = CollisionMonitorRules::new(
            &config.teleop.collision_monitor,
            &config.teleop,
            &config.vehicle,
            &config.mapping.obstacle,
        )
        .map_err(usage_error)?;
        #[cfg(target_os = "linux")]
        let [obstacles_out, obstacles_in] = self
            .obstacle_pipe()?
            .map_or([None, None], |ends| ends.map(Some));
        let (monitor_inputs, monitor_runner) = config
            .teleop
            .collision_monitor
            .enabled
            .then(|| {
                monitor_input(
                    monitor_rules,
                    config.range_models().len(),
                    ground_tracker(config),
                )
            })
            .map(|(mut monitor_input, monitor_map_input, monitor_runner)| {
                #[cfg(target_os = "linux")]
                if let Some(write_end) = obstacles_in {
                    monitor_input.send_obstacles_to(ObstacleSender::new(write_end));
                }
                ((monitor_input, monitor_map_input), monitor_runner)
            })
            .unzip();
        let estop_store = self.state.as_ref().map(|dir| {
            EStopFile::open(dir)
                .and_then(EStopStore::start)
                .with_context(|| format!("{}: cannot keep an emergency stop here", dir.display()))
        });
        let log = log.map(|file| {
            DriveLog::start(file, move |why| publish_event("drive_log_stopped", why))
                .context("no thread can be had to write the drive log")
        });
        let driving = Driving::start(DrivingSettings {
            robot: robot.clone(),
            boot,
            rules,
            operators,
            audit,
            motors: self.start_motors(
                #[cfg(target_os = "linux")]
                obstacles_out,
            )?,
            local_commands: LocalCommands::by_signals().context("signals cannot be taken")?,
            budget_kbps: config.streaming.budget_kbps,
            monitor_runner,
            estop_store: estop_store.transpose()?,
            can_record: self.recordings.is_some(),
            can_save_maps: self.maps.is_some(),
            log: log.transpose()?,
            service_manager: ServiceManager::from_environment(),
            planner: self.planner.clone(),
        });
        let driving = driving.context("no thread can be had to drive with")?;
        Ok(Some((driving, monitor_inputs)))
    }
}

/// The ground tracker of the collision monitor, if the mapper maps heights.
fn ground_tracker(config: &Config) -> Option<GroundTracker> {
    let mapping = &config.mapping;
    let new = || GroundTracker::new(&mapping.ground, config.vehicle.wheelbase_m());
    mapping.elevation.enabled.then(new)
}

fn usage_error(errors: Vec<SettingError>) -> UsageError {
    let issues = errors.into_iter().map(ConfigIssue::from);
    UsageError(
        issues
            .map(|issue| issue.to_string())
            .collect::<Vec<_>>()
            .join("\n"),
    )
}
