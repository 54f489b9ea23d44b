//! The command line. Its names are an interface for scripts.

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::NonEmptyStringValueParser;
use clap::{ArgAction, Args, Parser, Subcommand};
use clap_complete::Shell;
use edge::cli::VehicleOptions;
use edge::exit::UsageError;
use edge::pacer::Rate;
use edge::replay_control::RATES;
use protocol::keys::{OperatorId, RobotId};

use crate::link::LOG_FILTER;

const EXIT_CODES: &str = "\
Exit codes: 0 done; 1 it failed while running; 2 wrong usage or configuration;
3 the recording could not be read; 130 interrupted.";

/// Shows what a robot maps, live.
///
/// Without options it looks for robots on the network and lists them.
#[derive(Clone, Debug, PartialEq, Parser)]
#[command(name = "operator-console", version, after_help = EXIT_CODES)]
pub struct Cli {
    /// Ask here for robots, and look nowhere else: `tcp/HOST:PORT` of a robot or router; may be repeated
    #[arg(long, value_name = "ENDPOINT", global = true)]
    pub connect: Vec<String>,
    /// Watch this robot
    #[arg(long, value_name = "ID", global = true)]
    pub robot: Option<RobotId>,
    /// Start a simulated robot and connect to it: nothing else to set up. Other robots are not looked for
    #[arg(long, value_name = "WORLD", num_args = 0..=1, default_missing_value = "rooms",
          conflicts_with_all = ["connect", "robot"], value_parser = NonEmptyStringValueParser::new())]
    pub demo: Option<String>,
    /// Open a recording (MCAP, ROS 1 bag or CARMEN log) and map it here
    #[arg(long, value_name = "FILE", conflicts_with_all = ["connect", "robot", "demo"])]
    pub open: Option<PathBuf>,
    /// Times as fast as it was recorded, 0.1 to 20, or `max` (with --open)
    #[arg(long, value_name = "1|2.5|max", default_value = "1", requires = "open", value_parser = rate, allow_negative_numbers = true)]
    pub rate: Rate,
    /// No window: wait until the map is synchronized, write the exports, end; or `drive` by a script
    #[arg(long)]
    pub headless: bool,
    /// Where to write the maps (with --headless)
    #[arg(long, value_name = "DIR", requires = "headless")]
    pub export: Option<PathBuf>,
    /// Watch for this long first, seconds, or until the robot's data ends (with --headless)
    #[arg(long = "for", value_name = "S", requires = "headless", value_parser = seconds, allow_negative_numbers = true)]
    pub watch_for: Option<Duration>,
    /// Give up where the map is not synchronized this long after that, seconds (with --headless)
    #[arg(long, value_name = "S", default_value = "60", requires = "headless", value_parser = seconds, allow_negative_numbers = true)]
    pub timeout: Duration,
    /// Save a picture of the window and end; --after says when
    #[arg(
        long,
        value_name = "FILE.png",
        requires = "after",
        conflicts_with = "headless"
    )]
    pub screenshot: Option<PathBuf>,
    /// Seconds from the start to the picture (with --screenshot, which needs it)
    #[arg(long, value_name = "S", requires = "screenshot", value_parser = seconds, allow_negative_numbers = true)]
    pub after: Option<Duration>,
    /// Write what a screen reader gets of the window, at every change
    #[arg(long, value_name = "FILE", hide = true)]
    pub controls: Option<PathBuf>,
    /// Who you are: your folder of `robot-edge keys`. Then the link is mutual TLS, and --connect is quic/HOST:PORT
    #[arg(long, value_name = "DIR", requires = "connect", global = true)]
    pub keys: Option<PathBuf>,
    /// Who drives [default: the user of this computer by `USER`, `LOGNAME` or `USERNAME`, else `console`]
    #[arg(long, value_name = "NAME", global = true)]
    pub operator: Option<OperatorId>,
    /// Zenoh configuration (JSON5) that ours is laid over [default: what `ZENOH_CONFIG` names]
    #[arg(long, value_name = "FILE", global = true)]
    pub zenoh_config: Option<PathBuf>,
    /// Where the window's settings are kept [default: foreshore/console.json in the system's folder for settings; with
    /// --screenshot: nowhere]
    #[arg(long, value_name = "FILE", conflicts_with = "headless")]
    pub config: Option<PathBuf>,
    /// Begin with the settings of a first run
    #[arg(long, conflicts_with = "headless")]
    pub reset_settings: bool,
    /// Say nothing but errors
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Say more; twice, still more (`RUST_LOG` overrides)
    #[arg(long, short, action = ArgAction::Count, conflicts_with = "quiet", global = true)]
    pub verbose: u8,
    // Last: its heading would apply to all options behind it.
    /// Which vehicle recorded what is opened, and what to take of it.
    #[command(flatten, next_help_heading = "How to map the recording of --open")]
    pub setup: VehicleOptions,
    /// What to do besides showing a map
    #[command(subcommand)]
    pub task: Option<Task>,
}

#[derive(Clone, Debug, PartialEq, Eq, Subcommand)]
pub enum Task {
    /// Drive by a script of timed inputs (with --headless), for tests and demonstrations
    #[command(after_help = crate::script::LANGUAGE)]
    Drive(DriveArgs),
    /// Print what a shell needs to complete this program's options
    Completions(CompletionsArgs),
}

#[derive(Clone, Debug, PartialEq, Eq, Args)]
pub struct DriveArgs {
    /// Timed inputs, one a line
    #[arg(long, value_name = "FILE")]
    pub script: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Args)]
pub struct CompletionsArgs {
    /// Which shell
    pub shell: Shell,
}

impl Cli {
    /// Without `RUST_LOG`. Of winit errors only: it warns about displays without a desktop.
    pub fn log_filter(&self) -> String {
        match (self.quiet, self.verbose) {
            (true, _) => format!("error,{LOG_FILTER}"),
            (false, 0) => format!("warn,winit=error,{LOG_FILTER}"),
            (false, 1) => "info,zenoh=warn".to_owned(),
            (false, 2) => "debug".to_owned(),
            (false, _) => "trace".to_owned(),
        }
    }

    /// Checks rules between options.
    pub fn check(&self) -> Result<(), UsageError> {
        let wrong = |why: &str| Err(UsageError(why.to_owned()));
        if self.open.is_some() && self.headless {
            return wrong(
                "--open shows a recording in the window: without one, use `robot-edge replay FILE --export DIR`",
            );
        }
        if self.open.is_none() && self.setup != VehicleOptions::default() {
            return wrong(
                "--vehicle, --set and --topic say how to map the recording of --open: a robot is set up where it runs",
            );
        }
        match (&self.task, self.headless, &self.export) {
            (Some(Task::Drive(_)), false, _) => {
                wrong("`drive` needs --headless: in the window you drive by hand")
            }
            (Some(Task::Drive(_)), true, Some(_)) => {
                wrong("`drive` writes no maps: leave out --export")
            }
            (None, true, None) => wrong("--headless needs --export DIR, or `drive --script FILE`"),
            (Some(Task::Drive(_)), true, None)
            | (Some(Task::Completions(_)), ..)
            | (None, true, Some(_))
            | (None, false, _) => Ok(()),
        }
    }
}

fn rate(text: &str) -> Result<Rate, String> {
    let [slowest, fastest] = RATES;
    match text.parse() {
        Ok(Rate::Max) => Ok(Rate::Max),
        Ok(Rate::Times(times)) if (slowest..=fastest).contains(&times) => Ok(Rate::Times(times)),
        Ok(Rate::Times(_)) | Err(_) => Err(format!(
            "a rate is a number from {slowest} to {fastest} (1 is the speed of the recording), or `max`"
        )),
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text
        .parse()
        .ok()
        .filter(|seconds: &f64| seconds.is_finite() && *seconds >= 0.0);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "seconds are a number, 0 or more".to_owned())
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;
    use tracing_subscriber::EnvFilter;

    use super::*;

    fn parse(line: &str) -> Result<Cli, clap::Error> {
        Cli::try_parse_from(std::iter::once("operator-console").chain(line.split_whitespace()))
    }

    #[test]
    fn options_are_those_of_the_contract() {
        Cli::command().debug_assert();
        assert_eq!(parse("--demo").unwrap().demo.as_deref(), Some("rooms"));
        assert_eq!(parse("--demo hall").unwrap().demo.as_deref(), Some("hall"));
        let headless =
            parse("--headless --export maps --for 2.5 --connect tcp/a:1 --robot scout-1").unwrap();
        assert_eq!(headless.watch_for, Some(Duration::from_millis(2500)));
        assert_eq!(headless.connect, ["tcp/a:1"]);
        let recording = parse("--open rooms.mcap --rate max").unwrap();
        assert_eq!(recording.open, Some(PathBuf::from("rooms.mcap")));
        assert_eq!(recording.rate, Rate::Max);
        let settings = parse("--config a.json --reset-settings").unwrap();
        assert_eq!(settings.config, Some(PathBuf::from("a.json")));
        assert!(settings.reset_settings);
        let shell = Shell::Zsh;
        let completions = Some(Task::Completions(CompletionsArgs { shell }));
        assert_eq!(parse("completions zsh").unwrap().task, completions);
        let picture = parse("--screenshot a.png --after 3").unwrap();
        assert_eq!(picture.after, Some(Duration::from_secs(3)));
    }

    #[test]
    fn a_script_drives_without_a_window_only() {
        let cli =
            parse("--headless drive --script a.txt --connect tcp/a:1 --operator anna").unwrap();
        assert_eq!(cli.check(), Ok(()));
        assert_eq!(cli.connect, ["tcp/a:1"]);
        let script = PathBuf::from("a.txt");
        assert_eq!(cli.task, Some(Task::Drive(DriveArgs { script })));
        for (line, says) in [
            ("--headless", "--export DIR, or `drive"),
            (
                "--open a.mcap --headless --export b",
                "`robot-edge replay FILE --export DIR`",
            ),
            ("drive --script a", "--headless"),
            ("--demo --set a=1", "recording of --open"),
            ("--topic laser=/scan", "recording of --open"),
            (
                "--headless --export b drive --script a",
                "leave out --export",
            ),
        ] {
            let error = parse(line).unwrap().check().unwrap_err();
            assert!(error.0.contains(says), "{line}: {error}");
        }
        let setup =
            "--open a.bag --vehicle holos --set localization.source=static --topic laser=/b";
        for line in ["", "--demo", "--headless --export a", setup] {
            assert_eq!(parse(line).unwrap().check(), Ok(()));
        }
    }

    #[test]
    fn help_of_scripts_ends_with_a_whole_command() {
        let shown = crate::script::LANGUAGE.lines().next_back().unwrap();
        let (_, line) = shown.split_once(": operator-console ").unwrap();
        let cli = parse(line).unwrap();
        assert_eq!(cli.demo.as_deref(), Some("rooms"));
        assert_eq!(cli.check(), Ok(()));
        let script = PathBuf::from("FILE");
        assert_eq!(cli.task, Some(Task::Drive(DriveArgs { script })));
    }

    #[test]
    fn winit_warnings_need_verbose() {
        for (line, of_all, of_winit) in [
            ("--quiet", "error,", None),
            ("", "warn,", Some("winit=error")),
            ("-v", "info,", None),
            ("-vv", "debug", None),
        ] {
            let filter = parse(line).unwrap().log_filter();
            let found = filter.split(',').find(|part| part.starts_with("winit"));
            assert_eq!(found, of_winit, "{line}: {filter}");
            assert!(filter.starts_with(of_all), "{line}: {filter}");
            assert!(filter.parse::<EnvFilter>().is_ok(), "{filter}");
        }
    }

    #[test]
    fn usage_errors_name_allowed_values() {
        for (line, says) in [
            ("--export maps", "--headless"),
            ("--robot a/b", "letters"),
            ("--headless --export a --for -1", "0 or more"),
            ("--screenshot a.png", "--after"),
            ("--demo --connect tcp/a:1", "cannot be used with"),
            ("--keys anna", "--connect"),
            ("--open a.mcap --demo", "cannot be used with"),
            ("--open a.mcap --rate 0", "0.1 to 20"),
            ("--open a.mcap --rate 21", "or `max`"),
            ("--rate 2", "--open"),
            ("--headless --export a --config b", "cannot be used with"),
            ("completions cobol", "bash"),
        ] {
            let error = parse(line).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{line}");
            assert!(error.to_string().contains(says), "{line}: {error}");
        }
    }
}
