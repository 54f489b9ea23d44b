//! The command line. Names are a contract with scripts; what does not work yet is not offered.

mod mapping;
mod tools;

use clap::{ArgAction, Args, Parser, Subcommand};

use crate::actuators::MOTOR_GUARD_COMMAND;
use network::LOG_FILTER;

pub use mapping::{
    DrivingOptions, MappingOptions, NetworkOptions, Replay, RunLive, Simulate, VehicleOptions,
};
use tools::INSTALLED_KEYS;
pub use tools::{
    Check, Completions, Experiments, Info, InstallKeys, Keys, MotorGuard, Recover, Vehicles,
};

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 it failed while running; 2 wrong usage or configuration;
3 the recording could not be read; 130 interrupted.";

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
    pub fn log_filter(self) -> String {
        match (self.quiet, self.verbose) {
            (true, _) => format!("error,{LOG_FILTER}"),
            (false, 0) => format!("warn,{LOG_FILTER}"),
            (false, 1) => "info,zenoh=warn".to_owned(),
            (false, 2) => "debug".to_owned(),
            (false, _) => "trace".to_owned(),
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
    /// Put a vehicle's keys where it reads them, in the place of those that are there
    #[command(after_help = INSTALLED_KEYS)]
    InstallKeys(InstallKeys),
    /// Run the experiments against simulated truth and write a report page with pictures
    Experiments(Experiments),
    /// Print completions for a shell
    Completions(Completions),
    /// Own the motors for the process that has started this one
    #[command(name = MOTOR_GUARD_COMMAND, hide = true)]
    MotorGuard(MotorGuard),
}

#[cfg(test)]
mod tests;
