//! The command line. Names are a contract with scripts; what does not work yet is not offered.

use std::io;
use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use clap::{ArgAction, Args, CommandFactory as _, Parser, Subcommand};
use clap_complete::Shell;

use protocol::keys::{OperatorId, RobotId};

use crate::actuators::MOTOR_GUARD_COMMAND;
use crate::config::Override;
use crate::experiments::Experiment;
use crate::pacer::Rate;
use crate::ros::middleware::MAX_DOMAIN;

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 it failed while running; 2 wrong usage or configuration;
3 the recording could not be read; 130 interrupted.";

const KEYS_FOLDER: &str = "\
What is where in DIR, and where it goes:
  authority/       stays here: whoever has its key can make themselves anybody
  vehicles/ROBOT/  to that vehicle:  robot-edge ... --keys FOLDER
  people/NAME/     to that person:   operator-console --keys FOLDER
  router/          router.json5 alone, to the router:  zenohd -c router.json5

Files that end in .key.pem, and router.json5, are secrets of who uses them.

Run it again to add vehicles and people. Nothing that is there is changed, but router.json5 is
written anew. Lists and router.json5 that have changed must be copied to where they are used;
a vehicle or router that runs lets people who are new connect when it is started again.

To take somebody's leave to drive, remove their entry from operators.toml on each vehicle: within
a second they drive no more. They may watch until the vehicle is started again.

For a new certificate, since they expire, remove link.pem and run this again; for new keys,
remove the whole folder and the entries on the lists.";

const LIVE: &str = "\
The sensors are those of a ROS 2 system that speaks Zenoh: by rmw_zenoh, or over zenoh-bridge-ros2dds. Topics are
found by their types; the vehicle's configuration or --topic says which one is meant where several fit.

The system's own router has port 7447 of this machine. Consoles are therefore expected at 7449 (tiles at 7450) unless
--listen or --keys says otherwise.

[motors.roboteq] in the vehicle's configuration is what is driven; or [motors.ros2_twist], by which velocities are
published on a topic of the ROS 2 system, and then it is up to that system to stop when they cease. Without either
the vehicle can be watched only.";

/// Maps what a ground robot's or boat's laser sees.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "robot-edge", version, after_help = EXIT_CODES)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// How much to say.
    #[command(flatten)]
    pub verbosity: Verbosity,
}

/// How much is said on standard error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Args)]
pub struct Verbosity {
    /// Say nothing but errors; no progress bar
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Say more; twice, still more (`RUST_LOG` overrides)
    #[arg(long, short, global = true, action = ArgAction::Count, conflicts_with = "quiet")]
    pub verbose: u8,
}

impl Verbosity {
    /// The filter for `tracing`, where `RUST_LOG` says nothing.
    pub const fn log_filter(self) -> &'static str {
        match (self.quiet, self.verbose) {
            (true, _) => "error",
            // Zenoh warns of settings that are meant.
            (false, 0) => "warn,zenoh=error",
            (false, 1) => "info,zenoh=warn",
            (false, 2) => "debug",
            (false, _) => "trace",
        }
    }
}

/// The commands.
#[derive(Clone, Debug, PartialEq, Subcommand)]
pub enum Command {
    /// Map what the sensors of a ROS 2 robot see, live, and drive it where it has motors of ours
    #[command(after_help = LIVE)]
    Run(RunLive),
    /// Map a recording
    Replay(Replay),
    /// Map a simulated world
    Simulate(Simulate),
    /// Say what is in a recording: topics, sensors, rates, duration, faults
    Info(Info),
    /// Salvage a cut-off or damaged recording
    Recover(Recover),
    /// List vehicles that come with the program, or print one as a configuration to edit
    Vehicles(Vehicles),
    /// Validate a configuration and say exactly what is wrong
    Check(Check),
    /// Make a certificate authority, certificates for each role, and signing keys
    Keys(Keys),
    /// Run the experiments against simulated truth and write a report page with pictures
    Experiments(Experiments),
    /// Print completions for a shell
    Completions(Completions),
    /// Own the motors for the process that has started this one
    #[command(name = MOTOR_GUARD_COMMAND, hide = true)]
    MotorGuard(MotorGuard),
}

/// `run`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct RunLive {
    /// The ROS 2 system's Zenoh router or bridge
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/localhost:7447", value_parser = NonEmptyStringValueParser::new())]
    pub ros: String,
    /// Its domain [default: what `ROS_DOMAIN_ID` says, or 0]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=i64::from(MAX_DOMAIN)))]
    pub ros_domain: Option<u32>,
    /// Look so long for the sensors, seconds
    #[arg(long = "wait", value_name = "S", default_value = "10", value_parser = seconds_above_zero, allow_negative_numbers = true)]
    pub wait_s: f64,
    /// How it is driven.
    #[command(flatten)]
    pub driving: DrivingOptions,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// `replay`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Replay {
    /// MCAP with ROS 2 messages, ROS 1 bag or CARMEN log
    pub recording: PathBuf,
    /// Times as fast as it was recorded, or `max`
    #[arg(long, value_name = "1|2.5|max", default_value = "max", value_parser = str::parse::<Rate>)]
    pub rate: Rate,
    /// Begin again at the end, until interrupted
    #[arg(long = "loop")]
    pub repeat: bool,
    /// Skip this much of the recording, seconds
    #[arg(long = "start", value_name = "S", default_value = "0", value_parser = seconds_from_zero, allow_negative_numbers = true)]
    pub start_s: f64,
    /// Stop after this much of the recording, seconds
    #[arg(long = "duration", value_name = "S", value_parser = seconds_above_zero, allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// `simulate`.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct Simulate {
    /// Name of a world, or a world file
    #[arg(value_parser = NonEmptyStringValueParser::new())]
    pub world: String,
    /// What chance starts from: the same seed gives the same run
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Stop after this much simulated time, seconds
    #[arg(long = "duration", value_name = "S", value_parser = seconds_above_zero, allow_negative_numbers = true)]
    pub duration_s: Option<f64>,
    /// Times as fast as real time, or `max`
    #[arg(long, value_name = "1|max", default_value = "1", value_parser = str::parse::<Rate>)]
    pub rate: Rate,
    /// Let operators drive it at any rate: for hours of driving in minutes. Its world goes faster than their reactions
    #[arg(long, hide = true)]
    pub drive_at_any_rate: bool,
    /// How it is driven.
    #[command(flatten)]
    pub driving: DrivingOptions,
    /// Options of every command that maps.
    #[command(flatten)]
    pub mapping: MappingOptions,
}

/// How the vehicle is driven.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
pub struct DrivingOptions {
    /// Log every round of the loop that drives: what was asked, what the motors were told, and why
    #[arg(long, value_name = "FILE.csv", conflicts_with = "no_network")]
    pub drive_log: Option<PathBuf>,
    /// Keep an emergency stop here, so that it outlives this program [default: of `run`, `$STATE_DIRECTORY`, or
    /// `foreshore/ROBOT` in `$XDG_STATE_HOME` or `~/.local/state`; `simulate` forgets it at the end]
    #[arg(long, value_name = "DIR", conflicts_with = "no_network")]
    pub state: Option<PathBuf>,
    /// Let operators start and stop recordings, which go here in files of a minute
    #[arg(long, value_name = "DIR", conflicts_with = "no_network")]
    pub recordings: Option<PathBuf>,
}

/// Options of every command that maps.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct MappingOptions {
    /// Vehicle: a preset (see `robot-edge vehicles`) or a configuration file
    #[arg(long, value_name = "NAME|FILE", value_parser = NonEmptyStringValueParser::new())]
    pub vehicle: Option<String>,
    /// Override one setting: `mapping.occupancy.cell_m=0.05`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = str::parse::<Override>)]
    pub settings: Vec<Override>,
    /// Topic of a sensor, where several fit: `laser=/scan`; may be repeated
    #[arg(long = "topic", value_name = "ROLE=NAME", value_parser = Override::topic)]
    pub topics: Vec<Override>,
    /// Name of this robot: letters, digits, `_` and `-`
    #[arg(long, value_name = "ID")]
    pub robot: Option<RobotId>,
    /// How consoles reach it.
    #[command(flatten)]
    pub network: NetworkOptions,
    /// Write everything that comes in to a recording
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// Write the maps at the end
    #[arg(long, value_name = "DIR")]
    pub export: Option<PathBuf>,
    /// Write figures of the run at the end
    #[arg(long, value_name = "FILE.json")]
    pub summary: Option<PathBuf>,
}

/// How consoles reach the robot.
#[derive(Clone, Debug, Default, PartialEq, Eq, Args)]
pub struct NetworkOptions {
    /// Listen here for consoles: `quic/HOST:PORT` with --keys, `tcp/HOST:PORT` without, tiles at the next port
    /// [default: this machine only, port 7447]; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Connect to a Zenoh router here; may be repeated
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Who this vehicle is and who may watch and drive it: its folder of `robot-edge keys`
    #[arg(long, value_name = "DIR")]
    pub keys: Option<PathBuf>,
    /// Without keys, let anybody who reaches the listener watch and drive: nothing is encrypted, nobody proves who they
    /// are
    #[arg(long, conflicts_with = "keys")]
    pub insecure: bool,
    /// Zenoh configuration (JSON5) that ours is laid over [default: what `ZENOH_CONFIG` names]
    #[arg(long, value_name = "FILE")]
    pub zenoh_config: Option<PathBuf>,
    /// Do not open the network
    #[arg(long, conflicts_with_all = ["listen", "connect", "keys", "insecure", "zenoh_config", "stay"])]
    pub no_network: bool,
    /// Go on serving the map when the data has ended, until interrupted
    #[arg(long)]
    pub stay: bool,
}

impl MappingOptions {
    /// Everything that overrides the vehicle's configuration, weakest first.
    pub fn overrides(&self) -> Vec<Override> {
        self.settings.iter().chain(&self.topics).cloned().collect()
    }
}

/// `info`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Info {
    /// MCAP, ROS 1 bag or CARMEN log
    pub recording: PathBuf,
}

/// `recover`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Recover {
    /// The damaged recording; it is not changed
    pub recording: PathBuf,
    /// Where to write what can be saved
    pub out: PathBuf,
}

/// `vehicles`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Vehicles {
    /// Vehicle to print
    pub name: Option<String>,
}

/// `check`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Check {
    /// Configuration file, or name of a preset
    #[arg(value_name = "CONFIG", value_parser = NonEmptyStringValueParser::new())]
    pub config: String,
}

/// `keys`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
#[command(after_help = KEYS_FOLDER)]
pub struct Keys {
    /// Folder of the fleet; made where there is none
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// A vehicle; may be repeated
    #[arg(long = "robot", value_name = "ID")]
    pub robots: Vec<RobotId>,
    /// Name or address by which the vehicle is reached, beside this machine's own; may be repeated
    #[arg(long = "host", value_name = "HOST", value_parser = host)]
    pub hosts: Vec<String>,
    /// Somebody who drives; may be repeated. People are for the vehicles named, or for all where none is
    #[arg(long = "operator", value_name = "NAME")]
    pub operators: Vec<OperatorId>,
    /// Somebody who drives, and takes over from others; may be repeated
    #[arg(long = "supervisor", value_name = "NAME")]
    pub supervisors: Vec<OperatorId>,
    /// Somebody who watches; may be repeated
    #[arg(long = "observer", value_name = "NAME")]
    pub observers: Vec<OperatorId>,
    /// Name or address by which a router is reached; may be repeated
    #[arg(long = "router", value_name = "HOST", value_parser = host)]
    pub router_hosts: Vec<String>,
    /// How long new certificates are good for
    #[arg(long, value_name = "N", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

/// `experiments`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct Experiments {
    /// Experiments to run [default: all]
    #[arg(value_name = "ID", value_parser = str::parse::<Experiment>)]
    pub ids: Vec<Experiment>,
    /// Where to write the page and its pictures
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Run each with the seeds 1 to N
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
}

/// `motor-guard`.
#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct MotorGuard {
    /// Which motors, as JSON
    pub config: String,
}

/// `completions`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Args)]
pub struct Completions {
    /// The shell
    pub shell: Shell,
}

impl Completions {
    /// Prints the completions.
    pub fn print(self, out: &mut dyn io::Write) -> io::Result<()> {
        // The generator panics where it cannot write; memory can always be written.
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "robot-edge", &mut script);
        out.write_all(&script)
    }
}

/// A host name (RFC 1123) or an address.
fn host(text: &str) -> Result<String, String> {
    if let Ok(address) = text.parse::<std::net::IpAddr>() {
        return Ok(address.to_string());
    }
    let is_plain = |label: &str| {
        let bytes = label.as_bytes();
        let is_inner = |byte: &u8| byte.is_ascii_alphanumeric() || *byte == b'-';
        (1..=63).contains(&bytes.len())
            && bytes.iter().all(is_inner)
            && !label.starts_with('-')
            && !label.ends_with('-')
    };
    if text.len() <= 253 && text.split('.').all(is_plain) {
        Ok(text.to_ascii_lowercase())
    } else {
        Err("a host is a name like boat.example, or an address".to_owned())
    }
}

fn seconds_from_zero(text: &str) -> Result<f64, String> {
    finite(text)
        .filter(|&secs| secs >= 0.0)
        .ok_or_else(|| "seconds are a number, 0 or more".to_owned())
}

fn seconds_above_zero(text: &str) -> Result<f64, String> {
    finite(text)
        .filter(|&secs| secs > 0.0)
        .ok_or_else(|| "seconds are a number above 0".to_owned())
}

fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

#[cfg(test)]
mod tests;
