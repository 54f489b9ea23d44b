//! Setup of each command.

use std::io::{self, Write};
use std::sync::atomic::Ordering;

use clap::CommandFactory as _;
use edge::exit::{Exit, UsageError};
use edge::runtime::interrupt_flag;
use network::credentials::Credentials;
use network::endpoints;
use network::program_code::load_program;
use network::zenoh_config_file;
use recording::Format;

use crate::cli::{Cli, Task};
use crate::demo::Demo;
use crate::headless::{self, Headless};
use crate::identity::Identity;
use crate::playback::{ToOpen, in_words};
use crate::script::{self, Drive};
use crate::settings::{ConfigPath, default_file};
use crate::target::Target;
use crate::window::{self, WindowSettings};

pub fn run(cli: &Cli, out: &mut dyn Write) -> anyhow::Result<Exit> {
    cli.check()?;
    if let Some(Task::Completions(completions)) = &cli.task {
        let mut text = Vec::new();
        let command = &mut Cli::command();
        clap_complete::generate(completions.shell, command, "operator-console", &mut text);
        out.write_all(&text)?;
        return Ok(Exit::Done);
    }
    for endpoint in &cli.connect {
        endpoints::check_console(endpoint, cli.keys.is_some())
            .map_err(|err| UsageError(err.to_string()))?;
    }
    let credentials = cli.keys.as_deref().map(Credentials::open).transpose()?;
    if let Some(complaint) = credentials.as_ref().and_then(Credentials::warning) {
        writeln!(io::stderr(), "{complaint}")?;
    }
    let identity = Identity::of(cli.operator.clone(), credentials.as_ref())?;
    if let Some(recording) = &cli.open {
        // Fail before the window opens.
        Format::of(recording)?;
    }
    load_program();
    let demo = cli.demo.as_deref().map(Demo::start).transpose()?;
    let (connect, robot) = match &demo {
        Some(demo) => (vec![demo.endpoint.clone()], Some(demo.robot.clone())),
        None => (cli.connect.clone(), cli.robot.clone()),
    };
    let target = |connect, robot, credentials| Target {
        connect,
        robot,
        zenoh_config: cli.zenoh_config.clone(),
        credentials,
        timeout: cli.timeout,
        quiet: cli.quiet,
    };
    // The demo's own failure explains a missing robot.
    let result = |ended| match demo.as_ref().and_then(|demo| demo.failure.take()) {
        Some(why) => Err(why),
        None => ended,
    };
    if let Some(Task::Drive(drive)) = &cli.task {
        let settings = Drive {
            target: target(connect, robot, credentials),
            identity,
            script: drive.script.clone(),
        };
        let interrupt = interrupt_flag()?;
        let is_interrupted = || interrupt.load(Ordering::Relaxed);
        return result(script::run(&settings, is_interrupted, out));
    }
    if let Some(export) = &cli.export {
        let settings = Headless {
            target: target(connect, robot, credentials),
            export: export.clone(),
            watch_for: cli.watch_for,
        };
        let interrupt = interrupt_flag()?;
        let is_interrupted = || interrupt.load(Ordering::Relaxed);
        return result(headless::run(&settings, is_interrupted, out));
    }
    let settings = WindowSettings {
        connect,
        robot,
        demo: demo.as_ref().map(|demo| demo.failure.clone()),
        recordings: demo.as_ref().and_then(|demo| demo.recordings.clone()),
        identity,
        zenoh_config: zenoh_config_file(cli.zenoh_config.clone()),
        credentials,
        screenshot: cli.screenshot.clone().zip(cli.after),
        controls: cli.controls.clone(),
        open: cli.open.clone().map(|path| ToOpen {
            path,
            setup: cli.setup.clone(),
            rate: cli.rate,
        }),
        config: config_path(cli),
        forgets_settings: cli.reset_settings,
    };
    result(window::run(settings).map(|()| Exit::Done))
}

pub fn complaint(error: &anyhow::Error) -> String {
    in_words(error)
}

/// A scheduled screenshot shows the defaults and saves nothing.
fn config_path(cli: &Cli) -> ConfigPath {
    match (&cli.config, &cli.screenshot) {
        (Some(path), _) => ConfigPath::File(path.clone()),
        (None, Some(_)) => ConfigPath::None,
        (None, None) => default_file().map_or(ConfigPath::None, ConfigPath::File),
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[test]
    fn missing_recording_is_reported_once() {
        let line = "operator-console --operator anna --open nowhere/nix.mcap";
        let cli = Cli::try_parse_from(line.split(' ')).unwrap();
        let error = run(&cli, &mut io::sink()).unwrap_err();
        let words = complaint(&error);
        assert!(
            words.starts_with("nowhere/nix.mcap: there is no folder nowhere"),
            "{words}"
        );
        assert_eq!(words.matches("there is no").count(), 1, "{words}");
        assert_eq!(Exit::of(error.as_ref()), Exit::Unreadable);
    }
}
