//! What somebody at the vehicle wants: signals, for a button or a shell.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A wish of somebody at the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LocalCommand {
    /// Stop and stay stopped: SIGUSR2.
    Stop,
    /// End an emergency stop or a fault: SIGUSR1.
    Reset,
}

/// Wishes that the loop has not taken yet.
#[derive(Clone, Debug, Default)]
pub struct LocalCommands {
    stop: Arc<AtomicBool>,
    reset: Arc<AtomicBool>,
}

impl LocalCommands {
    /// Takes signals from now on.
    ///
    /// # Errors
    /// Where the system does not allow it.
    #[cfg(unix)]
    pub fn by_signals() -> io::Result<Self> {
        use signal_hook::consts::{SIGUSR1, SIGUSR2};
        let commands = Self::default();
        for (signal, flag) in [(SIGUSR2, &commands.stop), (SIGUSR1, &commands.reset)] {
            signal_hook::flag::register(signal, Arc::clone(flag))?;
        }
        Ok(commands)
    }

    /// Nothing: this system has no such signals.
    ///
    /// # Errors
    /// None.
    #[cfg(not(unix))]
    pub fn by_signals() -> io::Result<Self> {
        Ok(Self::default())
    }

    /// The wishes since the last call; stopping last, so that it is what holds.
    pub(super) fn take(&self) -> impl Iterator<Item = LocalCommand> {
        let take =
            |flag: &AtomicBool, command| flag.swap(false, Ordering::Relaxed).then_some(command);
        let reset = take(&self.reset, LocalCommand::Reset);
        let stop = take(&self.stop, LocalCommand::Stop);
        reset.into_iter().chain(stop)
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn signals_are_wishes_and_stopping_has_the_last_word() {
        let commands = LocalCommands::by_signals().unwrap();
        assert_eq!(commands.take().count(), 0);
        for signal in [signal_hook::consts::SIGUSR2, signal_hook::consts::SIGUSR1] {
            signal_hook::low_level::raise(signal).unwrap();
        }
        let taken: Vec<_> = commands.take().collect();
        assert_eq!(taken, [LocalCommand::Reset, LocalCommand::Stop]);
        assert_eq!(commands.take().count(), 0);
    }
}
