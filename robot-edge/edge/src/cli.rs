//! The command line. Names are a contract with scripts; what does not work yet is not offered.

mod mapping;
pub mod setup;
mod tools;

use clap::{ArgAction, Args, Parser, Subcommand};

use crate::actuators::MOTOR_GUARD_COMMAND;
use network::LOG_FILTER;

pub use mapping::{
    DrivingOptions, MapOptions, MappingOptions, NetworkOptions, Replay, RosOptions, RunLive,
    Simulate, VehicleOptions,
};
use setup::{QUESTIONS, Setup};
use tools::INSTALLED_KEYS;
pub use tools::{
    Calibrate, Check, Completions, Devices, Evaluate, EvaluateRelations, Experiments, Info,
    InstallKeys, Keys, Man, MotorGuard, Recover, Vehicles,
};

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 it failed while running; 2 wrong usage or configuration;
3 the recording could not be read; 130 interrupted.";

const LIVE: &str = "\
The sensors are those of [devices] in the vehicle's configuration, which are read without a middleware. One that is off
is waited for. Without [devices] they are those of a ROS 2 system that speaks Zenoh: by rmw_zenoh, or over zenoh-bridge-ros2dds. Topics are
found by their types; the vehicle's configuration or --topic says which one is meant where several fit.

The system's own router has port 7447 of this machine. Consoles are therefore expected at 7449 (tiles at 7450) unless
--listen or --keys says otherwise.

[motors.roboteq] in the vehicle's configuration is what is driven; or [motors.mavlink], an autopilot with ArduPilot,
whose sensors are read too, without ROS 2; or [motors.ros2_twist], by which velocities are published on a topic of the
ROS 2 system, and then it is up to that system to stop when they cease. Without any the vehicle can be watched only. [ros2_output] names the maps and poses that are published there.";

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
    /// Map what a vehicle's sensors see, live, and drive it where it has motors of ours
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
    /// Ask what a vehicle has, and write its configuration
    #[command(after_help = QUESTIONS)]
    Setup(Setup),
    /// Validate a configuration and say exactly what is wrong
    Check(Check),
    /// Say which sensors are connected
    Devices(Devices),
    /// Learn a part of the configuration from the sensors
    #[command(subcommand)]
    Calibrate(Calibrate),
    /// Make a certificate authority, certificates for each role, and signing keys
    Keys(Keys),
    /// Put a vehicle's keys where it reads them, in the place of those that are there
    #[command(after_help = INSTALLED_KEYS)]
    InstallKeys(InstallKeys),
    /// Measure the errors of a trajectory
    #[command(subcommand)]
    Evaluate(Evaluate),
    /// Run the experiments against simulated truth and write a report page with pictures
    Experiments(Experiments),
    /// Print completions for a shell
    Completions(Completions),
    /// Write the manual pages, as packages need them
    #[command(hide = true)]
    Man(Man),
    /// Own the motors for the process that has started this one
    #[command(name = MOTOR_GUARD_COMMAND, hide = true)]
    MotorGuard(MotorGuard),
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use clap::CommandFactory as _;
    use clap_complete::Shell;

    use super::*;
    use crate::pacer::Rate;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        let arguments = std::iter::once("robot-edge").chain(line.split_whitespace());
        Cli::try_parse_from(arguments).map(|cli| cli.command)
    }

    fn replay(line: &str) -> Replay {
        let command = parse(line).unwrap();
        let Command::Replay(replay) = command else {
            panic!("{command:?}");
        };
        replay
    }

    #[test]
    fn definitions_hold_together() {
        Cli::command().debug_assert();
    }

    #[test]
    fn replay_takes_every_option() {
        let replay = replay(
            "replay log.clf --rate 2.5 --loop --start 1.5 --duration 60 --vehicle pioneer \
         --set mapping.occupancy.cell_m=0.05 --set vehicle.name=max --topic laser=/scan \
         --robot scout-1 --no-network --record out.mcap --export maps --summary s.json -vv",
        );
        assert_eq!(replay.recording, PathBuf::from("log.clf"));
        assert_eq!(replay.rate, Rate::Times(2.5));
        assert!(replay.repeat && replay.mapping.network.no_network);
        assert_eq!((replay.start_s, replay.duration_s), (1.5, Some(60.0)));
        assert_eq!(replay.mapping.setup.vehicle.as_deref(), Some("pioneer"));
        assert_eq!(replay.mapping.robot, Some("scout-1".parse().unwrap()));
        assert_eq!(replay.mapping.setup.overrides().len(), 3);
        assert_eq!(replay.mapping.summary, Some(PathBuf::from("s.json")));
    }

    #[test]
    fn run_takes_its_sensors_from_where_ros_is() {
        let run = |line: &str| {
            let Command::Run(run) = parse(line).unwrap() else {
                panic!("{line}")
            };
            run
        };
        let default = run("run");
        assert_eq!(default.ros, RosOptions::default());
        assert!((default.wait_s - 10.0).abs() < 1e-9);
        let named =
            run("run --ros tcp/bot:7447 --ros-domain 232 --wait 3 --vehicle v.toml --state-dir s");
        assert_eq!(
            (named.ros.endpoint.as_deref(), named.ros.domain),
            (Some("tcp/bot:7447"), Some(232))
        );
        assert_eq!(named.driving.state_dir, Some(PathBuf::from("s")));
    }

    #[test]
    fn defaults_are_those_of_the_contract() {
        let replay = replay("replay log.clf");
        assert_eq!(replay.rate, Rate::Max);
        assert_eq!((replay.start_s, replay.duration_s), (0.0, None));
        assert_eq!(replay.mapping.setup.vehicle, None);
    }

    #[test]
    fn wrong_usage_is_refused_with_code_2_and_says_what_is_allowed() {
        for (line, says) in [
            ("replay", "RECORDING"),
            ("replay a --rate 0", "above 0"),
            ("replay a --rate -1", "-1"),
            ("replay a --rate fast", "`max`"),
            ("replay a --start -1", "0 or more"),
            ("replay a --duration nan", "above 0"),
            ("replay a --set cell_m", "no `=`"),
            ("replay a --set a..b=1", "not a key"),
            ("replay a --set vehicle.name=\"x", "not a TOML value"),
            ("replay a --topic /scan", "laser=/scan"),
            ("replay a --robot a/b", "letters"),
            ("replay a --quiet -v", "cannot be used with"),
            ("simulate rooms --seed -3", "-3"),
            ("run --ros-domain 233", "0..=232"),
            ("run --wait 0", "above 0"),
            ("run --no-network --state-dir d", "cannot be used with"),
            (
                "replay a --no-network --listen tcp/0.0.0.0:1",
                "cannot be used with",
            ),
            ("recover a", "OUT"),
            ("keys d --operator an/na", "letters"),
            ("keys d --host tcp/boat", "boat.example"),
            ("keys d --days 0", "0 is not in 1..=3650"),
            ("replay a --keys d --insecure", "cannot be used with"),
            ("setup --vehicle pionear", "did you mean `pioneer`?"),
            ("setup --size 1,2", "length, width, height"),
            ("setup --device laser", "laser=sick_cola,tcp="),
            ("setup --device laser=hokuyo,serial", "no KEY=VALUE"),
            ("setup --mount laser=1,2", "x,y,z,roll,pitch,yaw"),
            ("experiments", "--out"),
            ("experiments --out d --seeds 0", "0 is not in 1..=1000"),
        ] {
            let error = parse(line).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{line}");
            assert!(error.to_string().contains(says), "{line}: {error}");
        }
        assert_eq!(parse("--help").unwrap_err().exit_code(), 0);
        assert!(
            parse("--help")
                .unwrap_err()
                .to_string()
                .contains("130 interrupted")
        );
    }

    #[test]
    fn experiments_are_named_by_id() {
        let experiments = |ids: &[&str], seeds| {
            Command::Experiments(Experiments {
                ids: ids.iter().map(ToString::to_string).collect(),
                out: "d".into(),
                seeds,
            })
        };
        let all = parse("experiments --out d").unwrap();
        assert_eq!(all, experiments(&[], 1));
        let two = parse("experiments L2 l1 --out d --seeds 20").unwrap();
        assert_eq!(two, experiments(&["L2", "l1"], 20));
    }

    #[test]
    fn verbosity_chooses_the_filter() {
        let [quiet, usual] = ["error", "warn"].map(|level| format!("{level},{LOG_FILTER}"));
        for (line, filter) in [
            ("robot-edge --quiet info a", &*quiet),
            ("robot-edge info a", &usual),
            ("robot-edge info a -v", "info,zenoh=warn"),
            ("robot-edge -vvv info a", "trace"),
        ] {
            let cli = Cli::try_parse_from(line.split_whitespace()).unwrap();
            assert_eq!(cli.verbosity.log_filter(), filter, "{line}");
        }
    }

    #[test]
    fn every_command_but_hidden_ones_has_a_page() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("man");
        Man { out: out.clone() }.write().unwrap();
        let command = Cli::command();
        let shown = command.get_subcommands().filter(|each| !each.is_hide_set());
        let mut expected: Vec<String> = shown
            .map(|each| format!("robot-edge-{}.1", each.get_name()))
            .collect();
        expected.extend(
            [
                "robot-edge.1",
                "robot-edge-calibrate-self-hits.1",
                "robot-edge-evaluate-relations.1",
            ]
            .map(str::to_owned),
        );
        expected.sort();
        let pages = std::fs::read_dir(&out).unwrap();
        let mut pages: Vec<String> = pages
            .map(|page| page.unwrap().file_name().into_string().unwrap())
            .collect();
        pages.sort();
        assert_eq!(pages, expected);
        let page = std::fs::read_to_string(out.join("robot-edge-setup.1")).unwrap();
        assert!(page.contains("192.168.0.1:2111"), "{page}");
    }

    #[test]
    fn completions_know_the_commands() {
        let mut out = Vec::new();
        Completions { shell: Shell::Bash }.print(&mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        assert!(text.contains("replay") && text.contains("--summary"));
    }
}
