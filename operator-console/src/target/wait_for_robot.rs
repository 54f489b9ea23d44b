//! Waiting for a robot that is not heard yet: what is said meanwhile and at the end.

use std::io::{self, Write as _};
use std::time::Duration;

use anyhow::anyhow;
use measurement::time::Monotonic;
use robot_edge::clock;
use robot_edge::exit::Interrupted;

use super::discovery_report::DiscoveryReport;
use super::{POLL_PERIOD, Target};
use crate::link::Discovery;

/// Who is there has answered by then, even at the far end of a slow link.
const SOON: Duration = Duration::from_secs(2);
/// An address that is asked for longer than this has not answered.
const ASKING_TIME: Duration = Duration::from_secs(5);

/// What is said once, as long as there is time to see to it.
pub(super) struct DelayedNotice {
    since: Monotonic,
    is_printed: bool,
}

impl DelayedNotice {
    /// Of a wait that begins at `since` and lasts for `timeout`. `is_quiet`: nothing is to be said.
    pub(super) const fn new(timeout: Duration, is_quiet: bool, since: Monotonic) -> Self {
        Self {
            since,
            is_printed: is_quiet || timeout.as_nanos() <= SOON.as_nanos(),
        }
    }

    /// Whether it is to be said at `now`.
    pub(super) fn is_due(&self, now: Monotonic) -> bool {
        !self.is_printed && now.since(self.since) >= SOON
    }

    /// Says it on standard error.
    pub(super) fn print_once(&mut self, words: &str) {
        self.is_printed = true;
        // What cannot be said keeps nobody from waiting.
        drop(writeln!(io::stderr(), "{words}"));
    }
}

/// Asks who else is where a link waits for a robot. A robot that is heard soon costs no such question.
pub(crate) struct WaitForRobot {
    target: Target,
    notice: DelayedNotice,
    discovery: Option<Discovery>,
}

impl WaitForRobot {
    /// The wait for `target` begins.
    pub(super) fn new(target: Target) -> Self {
        Self {
            notice: DelayedNotice::new(target.timeout, target.quiet, clock::now()),
            target,
            discovery: None,
        }
    }

    fn report(&mut self) -> DiscoveryReport {
        let discovery = self
            .discovery
            .get_or_insert_with(|| self.target.start_discovery());
        DiscoveryReport::of(discovery)
    }

    /// The robot has not been heard yet: says so, and who is there instead, if it is time to.
    pub(crate) fn report_progress(&mut self, now: Monotonic) {
        if !self.notice.is_due(now) {
            return;
        }
        let report = self.report();
        if report.is_known() {
            self.notice.print_once(&report.waiting(&self.target));
        }
    }

    /// Why the robot was never heard. Takes as long as asking takes, where nobody was asked yet.
    pub(crate) fn conclusion(mut self, is_interrupted: &impl Fn() -> bool) -> anyhow::Error {
        let deadline = clock::now() + ASKING_TIME;
        loop {
            let report = self.report();
            if report.is_known() || deadline.since(clock::now()).is_zero() {
                return anyhow!(report.conclusion(&self.target));
            }
            if !clock::sleep_until(clock::now() + POLL_PERIOD, is_interrupted) {
                return Interrupted.into();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_told_once_and_soon() {
        const fn at(s: u64) -> Monotonic {
            Monotonic::from_nanos(s * 1_000_000_000)
        }
        let minute = Duration::from_mins(1);
        let mut notice = DelayedNotice::new(minute, false, at(10));
        assert!(!notice.is_due(at(11)));
        assert!(notice.is_due(at(12)));
        notice.print_once("no answer");
        assert!(!notice.is_due(at(13)));
        for silent in [
            DelayedNotice::new(minute, true, at(10)),
            DelayedNotice::new(Duration::from_secs(1), false, at(10)),
        ] {
            assert!(!silent.is_due(at(30)));
        }
    }
}
