//! Waits for bytes, and never longer than until a deadline.

use rustix::event::{PollFd, Timespec, poll};

use crate::clock;
use measurement::time::Monotonic;

/// Returns when one of `events` has come, at `until`, or earlier.
pub(super) fn wait(events: &mut [PollFd<'_>], until: Monotonic) {
    let rest = until.since(clock::now());
    let timeout = Timespec {
        tv_sec: i64::try_from(rest.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: rest.subsec_nanos().into(),
    };
    match poll(events, Some(&timeout)) {
        // What goes wrong here shows in the reads that follow; until then the caller turns in a circle, and works.
        Ok(_) | Err(_) => {}
    }
}
