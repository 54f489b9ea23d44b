//! The commands of the program, and the threads and channels of a run.

mod batching_channel;
pub mod choice;
mod driving;
mod kept_scans;
mod live;
mod live_recording;
pub mod localization_plan;
mod localization_stage;
mod map_correction;
mod mapping_stage;
mod maps;
mod network;
mod network_plan;
mod outputs;
mod pipeline;
mod plan;
mod player;
mod recorder;
mod replay;
mod ros_endpoint;
mod run;
mod run_live;
mod saved_map;
mod searched_map;
#[cfg(feature = "simulation")]
mod simulate;
mod source;
mod source_reader;
mod state_publisher;
mod temporary_file;
pub mod tilt_control;

use std::io::{self, BufRead, IsTerminal as _, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;

use crate::cli::{Cli, Command, Evaluate, MotorGuard, Recover};
use crate::config::{self, presets};
use crate::device_commands;
use crate::evaluate;
use crate::exit::{Exit, UsageError};
use crate::setup::setup;
use crate::survey::Survey;
use crate::vehicle_commands;
use recording::Format;
use recording::mcap::recover::{RecoverError, recover};

pub use maps::{MapEvent, MapUpdate, Maps, MapsCheckpoint, MapsReport, PausedSnapshot};
pub use pipeline::Pipeline;
pub use replay::play;
#[cfg(feature = "simulation")]
pub use simulate::simulated_localization_plan;

/// Runs one command. Results go to `out`, progress and warnings to standard error.
pub fn run(cli: &Cli, out: &mut dyn Write) -> anyhow::Result<Exit> {
    match &cli.command {
        Command::Run(_)
        | Command::Replay(_)
        | Command::Simulate(_)
        | Command::Check(_)
        | Command::Devices(_)
        | Command::Calibrate(_)
        | Command::Experiments(_) => run_until(cli, &*interrupt_flag()?, out),
        Command::Info(_)
        | Command::Recover(_)
        | Command::Vehicles(_)
        | Command::Evaluate(_)
        | Command::Setup(_)
        | Command::Keys(_)
        | Command::InstallKeys(_)
        | Command::Completions(_)
        | Command::Man(_)
        | Command::MotorGuard(_) => run_until(cli, &AtomicBool::new(false), out),
    }
}

/// As [`run`], but ends cleanly when `interrupt` is set, and not at Ctrl-C: for programs that contain a robot.
pub fn run_until(cli: &Cli, interrupt: &AtomicBool, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let quiet = cli.verbosity.quiet;
    match &cli.command {
        Command::Run(command) => run_live::run_live(command, quiet, interrupt, out),
        Command::Replay(command) => replay::replay(command, quiet, interrupt, out),
        #[cfg(feature = "simulation")]
        Command::Simulate(command) => simulate::simulate(command, quiet, interrupt, out),
        #[cfg(not(feature = "simulation"))]
        Command::Simulate(_) => Err(not_built("simulation")),
        Command::Info(command) => {
            write!(out, "{}", Survey::of(&command.recording, None)?)?;
            Ok(Exit::Done)
        }
        Command::Recover(command) => salvage(command, out),
        Command::Evaluate(Evaluate::Relations(command)) => evaluate::relations(command, out),
        Command::Vehicles(command) => {
            match &command.name {
                Some(name) => vehicle_commands::print(&presets::get(name)?, out)?,
                None => vehicle_commands::list(presets::PRESETS, out)?,
            }
            Ok(Exit::Done)
        }
        Command::Setup(command) => {
            let input = io::stdin();
            let mut input = input.is_terminal().then(|| input.lock());
            let input = input.as_mut().map(|input| input as &mut dyn BufRead);
            setup(command, input, out)
        }
        Command::Check(command) => {
            let checked = vehicle_commands::check(&command.config, out)?;
            if checked != Exit::Done || !command.connect {
                return Ok(checked);
            }
            let config = config::load(&command.config, &[])?;
            let time = Duration::from_secs_f64(command.seconds);
            device_commands::connect(&config, time, interrupt, out)
        }
        Command::Devices(command) => device_commands::devices(command, interrupt, out),
        Command::Calibrate(command) => device_commands::calibrate(command, interrupt, out),
        Command::Keys(command) => vehicle_commands::keys(command, out),
        Command::InstallKeys(command) => vehicle_commands::install_keys(command, out),
        Command::Experiments(_) => Err(not_built("experiments")),
        Command::Completions(command) => {
            command.print(out)?;
            Ok(Exit::Done)
        }
        Command::Man(command) => {
            let folder = command.out.display();
            command.write().with_context(|| folder.to_string())?;
            Ok(Exit::Done)
        }
        Command::MotorGuard(command) => guard_motors(command),
    }
}

fn not_built(feature: &str) -> anyhow::Error {
    UsageError(format!(
        "this program was built without `{feature}`: build it with `--features {feature}`"
    ))
    .into()
}

#[cfg(target_os = "linux")]
fn guard_motors(command: &MotorGuard) -> anyhow::Result<Exit> {
    let config: crate::actuators::motor_link::MotorLinkConfig =
        serde_json::from_str(&command.config)
            .map_err(|err| UsageError(format!("motor guard: {err}")))?;
    crate::actuators::motor_guard::run(std::io::stdin(), std::io::stdout(), &config)?;
    Ok(Exit::Done)
}

#[cfg(not(target_os = "linux"))]
fn guard_motors(_command: &MotorGuard) -> anyhow::Result<Exit> {
    Err(UsageError("motors are driven on Linux only".to_owned()).into())
}

fn salvage(command: &Recover, out: &mut dyn Write) -> anyhow::Result<Exit> {
    let (damaged, saved) = (&command.recording, &command.out);
    let format = Format::of(damaged)?;
    if format != Format::Mcap {
        return Err(UsageError(format!(
            "{}: this is a {format}, and recover writes MCAP from MCAP. `robot-edge replay` reads what is \
             left of it as it is, and with --record {} writes that as MCAP; add --set localization.source=static \
             where `robot-edge info` finds nothing that says where the sensor was",
            damaged.display(),
            saved.with_extension("mcap").display()
        ))
        .into());
    }
    if saved.symlink_metadata().is_ok() {
        return Err(UsageError(format!(
            "{}: exists already and is not written over: give another name",
            saved.display()
        ))
        .into());
    }
    let report = recover(damaged, saved).map_err(|err| match err {
        RecoverError::Recording(err) => anyhow::Error::from(err),
        err @ RecoverError::Write { .. } => err.into(),
    })?;
    for note in &report.notes {
        writeln!(out, "{note}")?;
    }
    let lost: Vec<_> = report
        .losses
        .iter()
        .map(|(why, n)| format!("{n} × {why}"))
        .collect();
    let lost = if lost.is_empty() {
        "nothing".to_owned()
    } else {
        lost.join(", ")
    };
    writeln!(
        out,
        "{}: {} messages saved, lost: {lost}",
        saved.display(),
        report.messages
    )?;
    Ok(Exit::Done)
}

/// A flag that the first Ctrl-C or termination request sets; the second one ends the process at once.
pub fn interrupt_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let code = i32::from(Exit::Interrupted.code());
        signal_hook::flag::register_conditional_shutdown(signal, code, Arc::clone(&flag))
            .and_then(|_id| signal_hook::flag::register(signal, Arc::clone(&flag)))
            .context("cannot listen for Ctrl-C")?;
    }
    Ok(flag)
}

pub(crate) fn is_set(flag: &AtomicBool) -> bool {
    flag.load(Ordering::Relaxed)
}
