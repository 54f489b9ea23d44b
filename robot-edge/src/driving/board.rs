//! What the loop shows to the rest of the program: the newest token, how driving is going, what happened.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use protocol::keys::OperatorId as OperatorName;
use protocol::message::TeleopStatus;

use super::loop_watch::LoopFailure;
use super::words::{self, GuardDetail};
use crate::actuators::Fault;
use crate::teleop::guard::Lack;
use crate::teleop::{AgeToken, Happening, OperatorId, TeleopReport};

/// Notices that wait to be told at most; the oldest goes.
const MAX_NOTICES: usize = 256;

/// Something that people should know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Notice {
    /// Of the arbiter.
    Arbiter(Happening),
    /// The guard could not judge, and the vehicle stops.
    Unguarded {
        /// What it lacked, where that is known.
        lack: Option<Lack>,
    },
    /// Motors that cannot be driven any more.
    Motors(Fault),
    /// The loop does not drive any more.
    LoopFailed(LoopFailure),
    /// Somebody started or stopped a recording.
    Recording {
        /// Started.
        is_on: bool,
        /// Who.
        by: OperatorId,
    },
    /// Somebody switched the collision guard.
    Guard {
        /// To on.
        is_on: bool,
        /// Who.
        by: OperatorId,
    },
    /// The collision guard was off, and is on again.
    GuardAgain(GuardAgain),
}

/// What switches the collision guard on again: it was off for one driver and one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum GuardAgain {
    /// This operator has been granted the lease.
    Granted(OperatorId),
    /// An emergency stop.
    EStopped,
    /// A reset of an emergency stop or of a fault.
    Reset,
}

/// The latest of everything. The loop writes without ever waiting: where a reader holds a part, it keeps it for the
/// next round, 20 ms later.
#[derive(Debug, Default)]
pub struct Board {
    token: Mutex<Option<AgeToken>>,
    /// With what the guard knows beside its limits.
    report: Mutex<Option<(TeleopReport, GuardDetail)>>,
    notices: Mutex<VecDeque<Notice>>,
    names: Mutex<Vec<OperatorName>>,
    switches: Mutex<words::Switches>,
    /// Somebody wants a recording to run, or not to.
    recording_wish: Mutex<Option<bool>>,
    is_recording: AtomicBool,
    is_closing: AtomicBool,
}

impl Board {
    /// The newest token, for the next pose.
    pub fn token(&self) -> Option<AgeToken> {
        *read(&self.token)
    }

    /// Whether somebody holds the lease, or is about to: then tokens go out with every round.
    pub fn is_held(&self) -> bool {
        let report = *read(&self.report);
        report
            .is_some_and(|(report, _)| report.lease.holder.is_some() || report.lease.next.is_some())
    }

    /// How driving is going, for the next status; `None` before the loop's first round.
    pub fn status(&self) -> Option<TeleopStatus> {
        let (report, detail) = (*read(&self.report))?;
        let mut switches = *read(&self.switches);
        switches.recording = self.is_recording.load(Ordering::Relaxed);
        let told = (&report, detail);
        Some(words::status(told, &read(&self.names), switches))
    }

    /// What happened since the last call, in words: kind and message.
    pub fn take_events(&self) -> Vec<(&'static str, String)> {
        let notices: Vec<_> = read(&self.notices).drain(..).collect();
        let names = read(&self.names);
        let notices = notices.iter();
        notices.map(|notice| words::event(notice, &names)).collect()
    }

    /// Bytes for tiles that somebody set, kbit/s.
    pub fn budget_kbps(&self) -> u32 {
        read(&self.switches).budget_kbps
    }

    /// Whether somebody wants a recording to run, since the last call.
    pub fn take_recording_wish(&self) -> Option<bool> {
        read(&self.recording_wish).take()
    }

    /// Whether a recording runs.
    pub fn show_recording(&self, is_running: bool) {
        self.is_recording.store(is_running, Ordering::Relaxed);
    }

    /// Says whether it could be noted; it could not where somebody reads.
    pub(super) fn wish_recording(&self, is_on: bool) -> bool {
        write(&self.recording_wish, |wish| *wish = Some(is_on))
    }

    /// Asks the loop to end.
    pub(super) fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }

    pub(super) fn show_token(&self, token: AgeToken) {
        write(&self.token, |shown| *shown = Some(token));
    }

    pub(super) fn show_report(&self, report: &TeleopReport, detail: GuardDetail) {
        write(&self.report, |shown| *shown = Some((*report, detail)));
    }

    pub(super) fn show_switches(&self, switches: words::Switches) {
        write(&self.switches, |shown| *shown = switches);
    }

    /// Tells what happened; gives it back where it has to wait.
    pub(super) fn tell(&self, waiting: &mut VecDeque<Notice>) {
        write(&self.notices, |told| {
            told.extend(waiting.drain(..));
            while told.len() > MAX_NOTICES {
                told.pop_front();
            }
        });
        // Nobody reads: what is kept must not grow.
        while waiting.len() > MAX_NOTICES {
            waiting.pop_front();
        }
    }

    /// Names of operators, by number.
    pub(super) fn show_names<'a>(&self, names: impl Iterator<Item = &'a OperatorName>) {
        write(&self.names, |shown| {
            shown.clear();
            shown.extend(names.cloned());
        });
    }
}

fn read<T>(part: &Mutex<T>) -> MutexGuard<'_, T> {
    part.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Says whether it was written; it is not where somebody reads.
fn write<T>(part: &Mutex<T>, change: impl FnOnce(&mut T)) -> bool {
    match part.try_lock() {
        Ok(mut shown) => change(&mut shown),
        Err(TryLockError::Poisoned(poisoned)) => change(&mut poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => return false,
    }
    true
}
