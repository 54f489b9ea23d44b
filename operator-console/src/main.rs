//! `operator-console`: see `operator-console --help`.

use std::io::{self, IsTerminal as _, Write as _};
use std::process::ExitCode;

use clap::Parser as _;
use edge::exit::{Exit, Interrupted};
use network::allocator::keep_little_memory;
use operator_console::cli::Cli;
use operator_console::run::{complaint, run};
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    keep_little_memory();
    let cli = Cli::parse();
    let filter =
        EnvFilter::try_from_default_env().unwrap_or_else(|_unset| EnvFilter::new(cli.log_filter()));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .init();

    let mut out = io::stdout().lock();
    let exit = match run(&cli, &mut out) {
        Ok(exit) => exit,
        Err(err) => {
            if err.downcast_ref::<Interrupted>().is_none() {
                drop(writeln!(
                    io::stderr(),
                    "operator-console: {}",
                    complaint(&err)
                ));
            }
            Exit::of(err.as_ref())
        }
    };
    drop(out.flush());
    exit.into()
}
