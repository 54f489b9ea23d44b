//! `robot-edge`: see `robot-edge --help`.

use std::io::{self, IsTerminal as _, Write as _};
use std::process::ExitCode;

use clap::Parser as _;
use edge::cli::Cli;
use edge::exit::{Exit, Interrupted};
use network::allocator::keep_little_memory;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::FmtContext;
use tracing_subscriber::fmt::format::{FormatEvent, FormatFields, Writer};
use tracing_subscriber::registry::LookupSpan;

fn main() -> ExitCode {
    keep_little_memory();
    #[cfg(target_os = "linux")]
    if std::env::args_os()
        .nth(1)
        .is_some_and(|command| command == edge::actuators::MOTOR_GUARD_COMMAND)
        && edge::actuators::motor_guard::ignore_signals().is_err()
    {
        return ExitCode::FAILURE;
    }
    let cli = Cli::parse();
    let filter = EnvFilter::try_from_default_env()
        .unwrap_or_else(|_unset| EnvFilter::new(cli.verbosity.log_filter()));
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        // A log in a file has no colours.
        .with_ansi(io::stderr().is_terminal());
    if cli.verbosity.verbose == 0 {
        log.event_format(PlainMessage).init();
    } else {
        log.init();
    }

    let mut out = io::stdout().lock();
    let exit = match run(&cli, &mut out) {
        Ok(exit) => exit,
        Err(err) => {
            let exit = Exit::of(err.as_ref());
            // A closed standard output and Ctrl-C are no errors to report.
            if !is_broken_pipe(&err) && err.downcast_ref::<Interrupted>().is_none() {
                // Nothing is left to be done where even standard error fails.
                drop(writeln!(io::stderr(), "robot-edge: {}", in_words(&err)));
            }
            exit
        }
    };
    drop(out.flush());
    exit.into()
}

/// A line such as `warning: MESSAGE FIELD=VALUE`, as the program writes its own. `--verbose` has times and places.
struct PlainMessage;

impl<S, N> FormatEvent<S, N> for PlainMessage
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(
        &self,
        context: &FmtContext<'_, S, N>,
        mut writer: Writer<'_>,
        event: &Event<'_>,
    ) -> std::fmt::Result {
        let kind = match *event.metadata().level() {
            Level::ERROR => "error",
            Level::WARN => "warning",
            Level::INFO => "info",
            Level::DEBUG => "debug",
            Level::TRACE => "trace",
        };
        write!(writer, "{kind}: ")?;
        context.format_fields(writer.by_ref(), event)?;
        writeln!(writer)
    }
}

fn run(cli: &Cli, out: &mut dyn io::Write) -> anyhow::Result<Exit> {
    #[cfg(feature = "experiments")]
    if let edge::cli::Command::Experiments(command) = &cli.command {
        let interrupt = edge::runtime::interrupt_flag()?;
        return experiments::command::run(command, cli.verbosity.quiet, &interrupt, out);
    }
    edge::runtime::run(cli, out)
}

fn is_broken_pipe(err: &anyhow::Error) -> bool {
    err.downcast_ref::<io::Error>()
        .is_some_and(|err| err.kind() == io::ErrorKind::BrokenPipe)
}

/// The error and its causes; some of our errors already hold their cause's words.
fn in_words(err: &anyhow::Error) -> String {
    let mut words = err.to_string();
    for cause in err.chain().skip(1) {
        let cause = cause.to_string();
        if !words.contains(&cause) {
            words = format!("{words}: {cause}");
        }
    }
    words
}
