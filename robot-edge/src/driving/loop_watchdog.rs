//! Watches the teleop loop. Where it ends or stands still, nobody can drive, stop or reset the vehicle any more: then the
//! process ends, so that a service manager starts it anew. The motors' own guard tells real motors zero long before.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use super::motors::SimulatedMotors;
use super::shared_drive_state::{DriveEvent, SharedDriveState};
use crate::clock::{self, sleep_until};
use teleop::Velocity;

/// Looks are counted, not time: those of a process that is stopped, or of a machine that is suspended, cease as well.
const CHECK_PERIOD: Duration = Duration::from_millis(100);

/// Looks in a row that find no new round of a loop that has one every 20 ms.
const MISSED_CHECKS: u32 = 10;

/// Until consoles have got the event that says why.
const EVENT_DELIVERY_TIME: Duration = Duration::from_millis(500);

/// Why the loop does not drive any more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoopFailure {
    /// Its thread has ended, and nobody wanted it to.
    Ended,
    /// It has no rounds any more.
    Stalled,
}

impl fmt::Display for LoopFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ended => "the teleop loop has failed: the robot program ends",
            Self::Stalled => "the teleop loop stands still for a second: the robot program ends",
        })
    }
}

/// What the loop says of itself.
#[derive(Debug, Default)]
pub(super) struct Heartbeat {
    rounds: AtomicU64,
    has_ended: AtomicBool,
}

impl Heartbeat {
    /// A round has ended.
    pub(super) fn round(&self) {
        self.rounds.fetch_add(1, Ordering::Relaxed);
    }
}

/// Says that the loop has ended, whichever way it does.
#[derive(Debug)]
pub(super) struct EndMarker<'a>(pub(super) &'a Heartbeat);

impl Drop for EndMarker<'_> {
    fn drop(&mut self) {
        self.0.has_ended.store(true, Ordering::Release);
    }
}

/// What was seen of the loop so far.
#[derive(Debug, Default)]
struct ProgressMonitor {
    rounds: u64,
    missed_checks: u32,
}

impl ProgressMonitor {
    fn check(&mut self, heartbeat: &Heartbeat) -> Option<LoopFailure> {
        if heartbeat.has_ended.load(Ordering::Acquire) {
            return Some(LoopFailure::Ended);
        }
        let rounds = heartbeat.rounds.load(Ordering::Relaxed);
        self.missed_checks = if rounds == self.rounds {
            self.missed_checks + 1
        } else {
            0
        };
        self.rounds = rounds;
        (self.missed_checks >= MISSED_CHECKS).then_some(LoopFailure::Stalled)
    }
}

/// Returns when the loop has ended as it was asked to; where it fails, ends the process.
pub(super) fn run_watchdog(
    heartbeat: &Heartbeat,
    drive_state: &Arc<SharedDriveState>,
    simulated: Option<&SimulatedMotors>,
) {
    let mut progress = ProgressMonitor::default();
    let failure = loop {
        sleep_until(clock::now() + CHECK_PERIOD, || false);
        match progress.check(heartbeat) {
            Some(LoopFailure::Ended) if drive_state.is_closing() => return,
            Some(failure) => break failure,
            None => {}
        }
    };
    if let Some(motors) = simulated {
        motors.command(Velocity::ZERO, clock::now());
    }
    drive_state.publish_events(&mut [DriveEvent::LoopFailed(failure)].into());
    // A terminal that is stopped stops whoever writes to it.
    drop(
        std::thread::Builder::new()
            .name("final-log".to_owned())
            .spawn(move || tracing::error!("{failure}")),
    );
    sleep_until(clock::now() + EVENT_DELIVERY_TIME, || false);
    // Not `exit`: what is done at an orderly end could wait for the loop.
    std::process::abort();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_ten_looks_in_a_row_without_a_round_are_a_stall() {
        let (heartbeat, mut progress) = (Heartbeat::default(), ProgressMonitor::default());
        heartbeat.round();
        for _ in 0..3 {
            heartbeat.round();
            for _ in 0..10 {
                assert_eq!(progress.check(&heartbeat), None);
            }
        }
        assert_eq!(progress.check(&heartbeat), Some(LoopFailure::Stalled));
    }

    #[test]
    fn an_end_is_seen_at_the_next_look() {
        let (heartbeat, mut progress) = (Heartbeat::default(), ProgressMonitor::default());
        drop(EndMarker(&heartbeat));
        assert_eq!(progress.check(&heartbeat), Some(LoopFailure::Ended));
    }
}
