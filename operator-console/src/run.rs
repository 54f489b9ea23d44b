//! The program: what each command sets up.

use std::io::Write;
use std::sync::atomic::Ordering;

use robot_edge::app::interrupt_flag;
use robot_edge::exit::{Exit, UsageError};
use robot_edge::link::endpoints::bulk_endpoint;
use robot_edge::link::zenoh_config_file;

use crate::cli::Cli;
use crate::demo::Demo;
use crate::headless::{self, Headless};
use crate::window::{self, WindowSettings};

/// Runs what the command line asks for. What it prints goes to `out`.
///
/// # Errors
/// What went wrong, in words for the person who typed the command; [`Exit::of`] gives the exit code.
pub fn run(cli: &Cli, out: &mut dyn Write) -> anyhow::Result<Exit> {
    for endpoint in &cli.connect {
        bulk_endpoint(endpoint).map_err(|err| UsageError(err.to_string()))?;
    }
    let demo = cli.demo.as_deref().map(Demo::start).transpose()?;
    let (connect, robot) = match &demo {
        Some(demo) => (vec![demo.endpoint.clone()], Some(demo.robot.clone())),
        None => (cli.connect.clone(), cli.robot.clone()),
    };
    if let Some(export) = &cli.export {
        let settings = Headless {
            connect,
            robot,
            zenoh_config: cli.zenoh_config.clone(),
            export: export.clone(),
            watch_for: cli.watch_for,
            timeout: cli.timeout,
            quiet: cli.quiet,
        };
        let interrupt = interrupt_flag()?;
        let ended = headless::run(&settings, || interrupt.load(Ordering::Relaxed), out);
        // Why the demo's robot is not there says more than that it is not.
        return match demo.as_ref().and_then(Demo::failure) {
            Some(why) => Err(why),
            None => ended,
        };
    }
    let settings = WindowSettings {
        connect,
        robot,
        zenoh_config: zenoh_config_file(cli.zenoh_config.clone()),
        screenshot: cli.screenshot.clone().zip(cli.after),
        title: "Foreshore".to_owned(),
    };
    let shown = window::run(settings);
    match demo.as_ref().and_then(Demo::failure) {
        Some(why) => Err(why),
        None => shown.map(|()| Exit::Done),
    }
}
