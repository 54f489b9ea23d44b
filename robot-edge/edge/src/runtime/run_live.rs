//! `run`: the sensors of a vehicle as the source, its own devices or those of a ROS 2 system, and its motors.

use std::env;
use std::io::{self, Write};
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use drivers::joint_goal::JointGoal;
use drivers::status::DeviceStatuses;
use protocol::keys::RobotId;

use super::driving::{DrivePlan, MotorsPlan};
use super::live::devices::{self, DeviceSource, ForwardedInput, name_topics};
use super::live::{StreamSelection, TopicDiscovery, find};
use super::localization_plan::{range_sensors, registration_settings};
use super::network_plan::NetworkPlan;
use super::outputs::{self, SETUP};
use super::plan::{Plan, plan};
use super::ros_endpoint::ros_endpoint;
use super::run::Run;
use super::source::Source;
use super::tilt_control::TiltControl;
#[cfg(target_os = "linux")]
use crate::actuators::motor_link::MotorLinkConfig;
use crate::cli::{DrivingOptions, NetworkOptions, RunLive};
use crate::config::advice::advise;
use crate::config::presets::GENERIC;
use crate::config::{self, Config};
use crate::exit::{Exit, UsageError};
use crate::pacer::Rate;
use crate::ros2::{RosLink, RosTarget};
use crate::summary::Event;

/// Default endpoint for consoles. It differs from that of the router of `rmw_zenoh`.
const DEFAULT_LISTEN: &str = "tcp/127.0.0.1:7449";

pub(super) fn run_live(
    command: &RunLive,
    quiet: bool,
    interrupt: &AtomicBool,
    out: &mut dyn Write,
) -> anyhow::Result<Exit> {
    let options = &command.mapping;
    let (vehicle, why) = match &options.setup.vehicle {
        Some(vehicle) => (vehicle.as_str(), "as asked for"),
        None => (
            GENERIC.name,
            "nobody says which vehicle it is; --vehicle does",
        ),
    };
    let mut config = config::load(vehicle, &options.setup.overrides())?;
    name_topics(&mut config);
    let config = config;
    range_sensors(&config)?;
    // Unwritable outputs are reported before the sensors are found.
    outputs::prepare(options.export.as_deref(), options.summary.as_deref())?;
    let network = NetworkPlan::new(
        &with_default_listen(&options.network, &config),
        options.robot.as_ref(),
        &config,
    )?;
    let driving = match &network {
        Some(network) => driving_options(command, &config, network.robot())?,
        None => None,
    };
    let others = options.record.is_some() || command.driving.recordings.is_some();
    let drive_by = |link| match &driving {
        Some(options) => Ok(DrivePlan::new(motors(&config, link)?, options).with_planner(&config)),
        None => Ok::<_, UsageError>(DrivePlan::none()),
    };
    let tilt = TiltControl::new(&config);
    let (sensors, drive) = if config.devices.is_empty() && config.motors.mavlink.is_none() {
        // Before its sensors are waited for.
        tilt.clone().map(|tilt| turned_by(tilt, &[])).transpose()?;
        let sensors = ros_sensors(command, &config, others, quiet, interrupt)?;
        let drive = drive_by(sensors.link.clone())?;
        (sensors, drive)
    } else {
        let mut drive = drive_by(None)?;
        let forwarded = drive.forwarded_input()?;
        (own_devices(command, &config, forwarded, others)?, drive)
    };
    let Sensors {
        mut source,
        place,
        plan,
        devices,
        goals,
        ros,
        ..
    } = sensors;
    let tilt = tilt.map(|tilt| turned_by(tilt, &goals)).transpose()?;

    let mut notes = vec![format!("{vehicle} ({why})")];
    let sensors = plan.sensors.iter();
    notes.extend(sensors.map(|(name, topic)| format!("{name}: {topic}")));
    notes.extend(plan.notes);
    let overrides = options.setup.overrides();
    notes.extend(advise(vehicle, &overrides, &config, drive.can_drive()));
    if let Some(twist) = config
        .motors
        .ros2_twist
        .as_ref()
        .filter(|_| drive.can_drive())
    {
        notes.push(format!(
            "motors: velocities on {}. Whether the vehicle stops when they cease is up to who listens there",
            twist.topic
        ));
    }
    if !drive.can_drive() {
        notes.push("no motors: the vehicle can be watched, and not driven".to_owned());
    }
    let events = notes.into_iter().map(|message| Event {
        stamp_s: None,
        kind: SETUP.to_owned(),
        message,
    });
    let run = Run {
        source: place,
        title: config.vehicle.name.clone(),
        config: &config,
        registration: registration_settings(&config, &plan.localization_plan),
        // Live data is not paced.
        rate: Rate::Times(1.0),
        is_live: true,
        network,
        drive,
        record: options.record.clone(),
        foxglove: options.foxglove_address()?,
        export: options.export.clone(),
        map: &options.map,
        summary: options.summary.clone(),
        quiet,
        earliest: None,
        events: events.collect(),
        devices,
        tilt,
        ros,
    };
    run.execute(&mut *source, interrupt, out)
}

/// Where measurements come from.
struct Sensors {
    source: Box<dyn Source>,
    /// For summaries and errors.
    place: String,
    plan: Plan,
    /// The ROS 2 system, if there is one.
    link: Option<RosLink>,
    /// Where maps and poses are published.
    ros: Option<RosTarget>,
    devices: Option<DeviceStatuses>,
    /// Of the joints that devices turn.
    goals: Vec<JointGoal>,
}

/// The devices of the configuration; they need not be there yet.
fn own_devices(
    command: &RunLive,
    config: &Config,
    forwarded: Option<ForwardedInput>,
    others: bool,
) -> anyhow::Result<Sensors> {
    let publishes = !config.ros2_output.is_empty() || config.planner.is_some();
    if let Some(ros) = command.ros.endpoint.as_ref().filter(|_| !publishes) {
        return Err(UsageError(format!(
            "--ros {ros}: the vehicle's configuration has devices of its own ([devices]), which are read without ROS 2, and \
             nothing to publish ([ros2_output], [planner]): leave the option out"
        ))
        .into());
    }
    let ros = publishes
        .then(|| ros_endpoint(&command.ros, config))
        .transpose()?;
    let plan = plan(&devices::survey(config, forwarded.is_some())?, config)?;
    let selection = StreamSelection {
        mapped: plan.streams.clone(),
        others,
    };
    let source = DeviceSource::start(config, forwarded, selection)?;
    Ok(Sensors {
        devices: Some(source.statuses().clone()),
        goals: source.goals().to_vec(),
        source: Box::new(source),
        place: "[devices]".to_owned(),
        plan,
        link: None,
        ros: ros.map(RosTarget::Endpoint),
    })
}

/// The servo that turns is that of a device.
fn turned_by(tilt: TiltControl, goals: &[JointGoal]) -> Result<TiltControl, UsageError> {
    let joint = tilt.goal().joint().to_owned();
    let goal = goals.iter().find(|goal| goal.joint() == joint);
    goal.map(|goal| tilt.with_goal(goal.clone())).ok_or_else(|| {
        UsageError(format!(
            "`tilt.search`: nothing turns the joint {joint:?}. A device of kind \"dynamixel\" does that has this `joint`, and \
             `sweep_from_deg`, `sweep_to_deg` and `sweep_degps`, within which it turns: add one, or leave `tilt.search` out"
        ))
    })
}

/// The sensors of a ROS 2 system, once they are there.
fn ros_sensors(
    command: &RunLive,
    config: &Config,
    others: bool,
    quiet: bool,
    interrupt: &AtomicBool,
) -> anyhow::Result<Sensors> {
    let at = ros_endpoint(&command.ros, config)?;
    if !quiet {
        writeln!(
            io::stderr(),
            "{SETUP}: looking for sensors at {}, domain {}",
            at.endpoint,
            at.domain
        )?;
    }
    let discovery = TopicDiscovery {
        at: &at,
        wait: Duration::from_secs_f64(command.wait_s.min(1e6)),
        config,
    };
    let (mut live, plan) = find(discovery, interrupt)?;
    live.begin(StreamSelection {
        mapped: plan.streams.clone(),
        others,
    });
    Ok(Sensors {
        link: Some(live.link().clone()),
        ros: Some(RosTarget::Node(live.link().node().clone())),
        source: Box::new(live),
        place: at.endpoint,
        plan,
        devices: None,
        goals: Vec::new(),
    })
}

/// Without options, the robot listens beside the router of ROS 2, which uses the default port.
fn with_default_listen(options: &NetworkOptions, config: &Config) -> NetworkOptions {
    let mut options = options.clone();
    let named = !(options.listen.is_empty() && options.connect.is_empty());
    let link = &config.link;
    let configured = link.listen.is_some() || link.connect.is_some() || link.keys.is_some();
    if !named && !configured && options.keys.is_none() {
        options.listen.push(DEFAULT_LISTEN.to_owned());
    }
    options
}

/// Driving options; `None` if the vehicle has no motors.
fn driving_options(
    command: &RunLive,
    config: &Config,
    robot: &RobotId,
) -> Result<Option<DrivingOptions>, UsageError> {
    let options = &command.driving;
    if !config.motors.has_motors() {
        let wanted = [
            ("--drive-log", &options.drive_log),
            ("--recordings", &options.recordings),
        ];
        return match wanted.into_iter().find(|(_, path)| path.is_some()) {
            Some((option, _)) => Err(UsageError(format!(
                "{option}: nobody drives: the vehicle's configuration has none of [motors.roboteq], [motors.mavlink] and \
                 [motors.ros2_twist]"
            ))),
            None => Ok(None),
        };
    }
    let from_environment = || default_state_dir(|name| env::var_os(name).map(PathBuf::from), robot);
    let state_dir = options.state_dir.clone().or_else(from_environment);
    if state_dir.is_none() {
        return Err(UsageError(
            "nobody says where to keep an emergency stop: there is neither $STATE_DIRECTORY nor $XDG_STATE_HOME nor \
             $HOME. --state-dir DIR says it"
                .to_owned(),
        ));
    }
    Ok(Some(DrivingOptions {
        state_dir,
        ..options.clone()
    }))
}

fn motors(config: &Config, link: Option<RosLink>) -> Result<MotorsPlan, UsageError> {
    if let Some(twist) = &config.motors.ros2_twist {
        let link = link.ok_or_else(|| {
            UsageError(
                "[motors.ros2_twist]: velocities are published to a ROS 2 system, but this vehicle's sensors are its own \
                 ([devices])"
                    .to_owned(),
            )
        })?;
        let frame = config.localization.base_frame.clone();
        return Ok(MotorsPlan::Ros2Twist(
            link.node().clone(),
            twist.clone(),
            frame,
        ));
    }
    match (&config.motors.roboteq, &config.motors.mavlink) {
        (None, None) => Ok(MotorsPlan::None),
        #[cfg(target_os = "linux")]
        (Some(roboteq), _) => Ok(MotorsPlan::Guarded(roboteq.clone().into())),
        #[cfg(target_os = "linux")]
        (None, Some(mavlink)) => Ok(MotorsPlan::Guarded(MotorLinkConfig::Mavlink(
            mavlink.clone(),
        ))),
        #[cfg(not(target_os = "linux"))]
        _ => Err(UsageError(
            "[motors]: motors are driven on Linux only".to_owned(),
        )),
    }
}

/// The state folder of systemd or of the XDG base directory specification.
fn default_state_dir(
    variable: impl Fn(&str) -> Option<PathBuf>,
    robot: &RobotId,
) -> Option<PathBuf> {
    let set = |name: &str| variable(name).filter(|path| path.is_absolute());
    // systemd separates several folders by colons.
    let of_unit = variable("STATE_DIRECTORY").and_then(|all| env::split_paths(&all).next());
    of_unit.filter(|path| path.is_absolute()).or_else(|| {
        let state_dir =
            set("XDG_STATE_HOME").or_else(|| Some(set("HOME")?.join(".local/state")))?;
        Some(state_dir.join("foreshore").join(robot.as_str()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(set: &[(&str, &str)]) -> Option<String> {
        let variable = |name: &str| {
            let found = set.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| PathBuf::from(value))
        };
        let folder = default_state_dir(variable, &"scout-1".parse().unwrap())?;
        Some(folder.display().to_string())
    }

    #[test]
    fn the_state_folder_follows_systemd_and_xdg() {
        let home = ("HOME", "/home/anna");
        let of_home = "/home/anna/.local/state/foreshore/scout-1";
        assert_eq!(folder(&[home]).unwrap(), of_home);
        let xdg = ("XDG_STATE_HOME", "/state");
        assert_eq!(folder(&[home, xdg]).unwrap(), "/state/foreshore/scout-1");
        let unit = ("STATE_DIRECTORY", "/var/lib/edge:/var/lib/other");
        assert_eq!(folder(&[home, xdg, unit]).unwrap(), "/var/lib/edge");
        // By the specification, relative paths are ignored.
        assert_eq!(
            folder(&[home, ("XDG_STATE_HOME", "state")]).unwrap(),
            of_home
        );
        assert_eq!(folder(&[]), None);
    }

    #[test]
    fn the_default_port_is_beside_the_router_of_ros() {
        let listen = |options: &NetworkOptions, set: &[&str]| {
            let set: Vec<_> = set.iter().map(|set| set.parse().unwrap()).collect();
            let config = config::load(GENERIC.name, &set).unwrap();
            with_default_listen(options, &config).listen
        };
        let none = NetworkOptions::default();
        assert_eq!(listen(&none, &[]), [DEFAULT_LISTEN]);
        assert_eq!(listen(&none, &["link.listen=tcp/127.0.0.1:9000"]), [""; 0]);
        let keys = NetworkOptions {
            keys: Some("keys".into()),
            ..NetworkOptions::default()
        };
        assert_eq!(listen(&keys, &[]), [""; 0]);
    }
}
