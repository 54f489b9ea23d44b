//! The motor guard: a small process that owns the motors, so that they stop whatever becomes of the edge.
//!
//! The edge is large: it maps, streams, and talks to a network. Its teleop loop may hang, be killed, be stopped by a
//! debugger or starve; the motors would then keep their last command. So it never holds their port. It says what
//! they are to do to a child process ([`run`]) through a pipe, in frames that carry the time of decision
//! ([`frame`]), and the child sends zero to the motors
//! - when nothing valid has come for [`WATCHDOG`], counted from the decision: also where the edge is stopped and what it
//!   sent before lies in the pipe;
//! - when the pipe closes: the edge is gone;
//! - when garbage comes, and at SIGTERM, SIGINT and SIGQUIT. SIGUSR1, SIGUSR2 and SIGHUP it ignores.
//!
//! After each of these the motors stand until zero has been asked for. The other way round, where the child is gone or
//! does not answer, [`GuardedMotors`] ends it, opens the port itself, sends zero to the motors, and reports a fault for
//! good. Before that, as soon as the child has missed two reports, it sends zero to the motors once.
//!
//! Where encoders are configured, the child also asks for their counts, and forwards what the controller sends through a
//! third pipe that it never waits for, and that nothing comes back through; so it does with what an autopilot sends
//! ([`super::forward_pipe`]). A fourth one brings distances of obstacles for an autopilot ([`super::mavlink::obstacle_pipe`]).
//!
//! The child outlives an edge that is killed by as long as the motors take to acknowledge zero. The next edge's child
//! waits for it to let go of the port, and ends it where it does not.
//!
//! Edge and guard run on one machine and read one clock, `CLOCK_BOOTTIME`, so that an age is a difference of two
//! readings. What neither can do is act on a machine that stands still: for that there is the controller's own
//! watchdog.

use std::time::Duration;

pub mod frame;

mod guard;
mod parent;
mod supervisor;

pub use guard::{ignore_signals, run};
pub use parent::{GuardCommand, GuardedMotors};

/// How long a velocity holds, from the edge's decision on.
pub const WATCHDOG: Duration = Duration::from_millis(200);

pub const REPORT_PERIOD: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests;
