//! The thread beside the teleop loop: it may wait for processes and ports, the loop may not.

use std::io;
use std::os::fd::{AsFd as _, AsRawFd as _, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;

use super::frame::{Decoder, Found, Frame as _, MotorCommand, REPORT_BYTES};
use super::guard::wait;
use super::parent::{GuardCommand, MotorSnapshot, Shared};
use crate::actuators::forward_pipe;
use crate::actuators::mavlink::obstacle_pipe;
use crate::actuators::motor_guard::frame::MotorReport;
use crate::actuators::motor_link::{MotorLinkConfig, Sharing, State};
use crate::actuators::report::{FallbackStop, Fault, Report};
use crate::lock;
use crate::service_manager;
use measurement::time::Monotonic;
use network::clock;
use teleop::Velocity;

/// At least this often it looks at everything.
const POLL_PERIOD: Duration = Duration::from_millis(50);

/// A guard that has reported nothing for this long, though it does so every 50 ms, may have been stopped: zero is sent
/// to the motors once. If it was only slow, it goes on.
const REPORT_OVERDUE: Duration = Duration::from_millis(120);

/// Timeout of the first report of a guard: its program must be loaded.
const START: Duration = Duration::from_secs(5);

/// How long a guard may take to end by itself, which includes its last words to the motors.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(1500);

/// How long zero is sent at the end after the loss of the guard.
const FINAL_STOP_TIMEOUT: Duration = Duration::from_secs(1);

pub(super) struct Supervisor {
    command: GuardCommand,
    config: MotorLinkConfig,
    silence: Duration,
    shared: Arc<Shared>,
    woken: UnixStream,
    sequence: u64,
    /// Version of the newest velocity that was handed on.
    known: u64,
}

struct Guard {
    child: Child,
    command_pipe: ChildStdin,
    report_pipe: ChildStdout,
    decoder: Decoder<REPORT_BYTES>,
    /// When it counts as lost without a report.
    lost: Monotonic,
    /// When zero is sent past it, unless it reports something; absent before the first time, and after that.
    missed: Option<Monotonic>,
}

impl Supervisor {
    pub(super) fn new(
        command: GuardCommand,
        config: MotorLinkConfig,
        silence: Duration,
        shared: Arc<Shared>,
        woken: UnixStream,
    ) -> Self {
        Self {
            command,
            config,
            silence,
            shared,
            woken,
            sequence: 0,
            known: 0,
        }
    }

    pub(super) fn run(mut self) {
        let (child, why) = match self.spawn() {
            Ok(mut guard) => match self.supervise(&mut guard) {
                Ok(()) => match shut_down(guard) {
                    None => return,
                    Some(child) => (Some(child), io::ErrorKind::TimedOut.into()),
                },
                Err(why) => {
                    kill(&mut guard.child);
                    (Some(guard.child), why)
                }
            },
            Err(why) => (None, why),
        };
        self.shared.guard_pid.store(0, Ordering::Release);
        self.fallback_stop(child, &why);
    }

    fn spawn(&self) -> io::Result<Guard> {
        // `exec` does not close them, unlike those of `try_clone`: the guard inherits them, as does any other program that is
        // started meanwhile, which does not know them. If one cannot be had, the vehicle drives without.
        let pipes = [
            (forward_pipe::VARIABLE, &self.command.forward_pipe),
            (obstacle_pipe::VARIABLE, &self.command.obstacle_pipe),
        ];
        let inherited = pipes.map(|(variable, pipe)| {
            let pipe = pipe.as_ref().and_then(|pipe| rustix::io::dup(pipe).ok());
            (variable, pipe)
        });
        let numbers = inherited.iter().filter_map(|(variable, pipe)| {
            let number = pipe.as_ref()?.as_raw_fd();
            Some((variable, number.to_string()))
        });
        let mut child = Command::new(&self.command.program)
            .args(&self.command.arguments)
            // The service manager is notified by the edge alone.
            .env_remove(service_manager::SOCKET)
            .env_remove(forward_pipe::VARIABLE)
            .env_remove(obstacle_pipe::VARIABLE)
            .envs(numbers)
            .envs(self.command.environment.iter().cloned())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C is for the edge, which lets the vehicle come to rest and then closes the pipe.
            .process_group(0)
            .spawn()?;
        let (Some(command_pipe), Some(report_pipe)) = (child.stdin.take(), child.stdout.take())
        else {
            kill(&mut child);
            return Err(io::ErrorKind::BrokenPipe.into());
        };
        rustix::io::ioctl_fionbio(&command_pipe, true)?;
        rustix::io::ioctl_fionbio(&report_pipe, true)?;
        self.shared.guard_pid.store(child.id(), Ordering::Release);
        Ok(Guard {
            child,
            command_pipe,
            report_pipe,
            decoder: Decoder::new(),
            lost: clock::now() + self.silence.max(START),
            missed: None,
        })
    }

    /// Hands velocities on and reports back. An error: the guard is lost.
    fn supervise(&mut self, guard: &mut Guard) -> io::Result<()> {
        while !self.is_over() {
            self.send_command(guard)?;
            self.read_reports(guard)?;
            let now = clock::now();
            if guard.missed.take_if(|missed| now >= *missed).is_some() {
                // If this fails, zero is sent when the guard is lost.
                self.config.stop_without_reply(now);
            }
            if now >= guard.lost {
                return Err(io::ErrorKind::TimedOut.into());
            }
            // The last report of the guard still holds; a failure shows in `lost`.
            self.refresh_snapshot(now);
            let turn = now + POLL_PERIOD;
            let until = guard.missed.map_or(turn, |missed| turn.min(missed));
            self.wait(Some(guard.report_pipe.as_fd()), until);
        }
        Ok(())
    }

    fn send_command(&mut self, guard: &Guard) -> io::Result<()> {
        let Some((version, velocity, decided_at)) = self.shared.latest.newer_than(self.known)
        else {
            return Ok(());
        };
        self.known = version;
        self.sequence += 1;
        let motor_command = MotorCommand {
            sequence: self.sequence,
            decided_at,
            velocity,
            mode_requests: self.shared.mode_requests.load(Ordering::Relaxed),
        };
        match rustix::io::write(&guard.command_pipe, &motor_command.encode()) {
            // A frame is written whole or not at all (pipe(7), PIPE_BUF). A full pipe: the guard does not read, and
            // either reads on and finds it all too old, or is lost.
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(errno) => Err(errno.into()),
        }
    }

    fn read_reports(&self, guard: &mut Guard) -> io::Result<()> {
        let mut buffer = [0; 4096];
        let bytes = match rustix::io::read(&guard.report_pipe, &mut buffer) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => buffer.get(..count).unwrap_or_default(),
            Err(Errno::AGAIN | Errno::INTR) => return Ok(()),
            Err(errno) => return Err(errno.into()),
        };
        let mut newest: Option<MotorReport> = None;
        guard.decoder.push(bytes, |found| match found {
            Found::Frame(motor_report) => newest = Some(motor_report),
            Found::Garbage => {}
        });
        if let Some(motor_report) = newest {
            let now = clock::now();
            guard.lost = now + self.silence;
            guard.missed = Some(now + REPORT_OVERDUE);
            let fault = motor_report.fault.map(Fault::Controller);
            self.snapshot(fault.map_or(Ok(motor_report.report), Err), now);
        }
        Ok(())
    }

    /// Sends zero to the motors until the end: only a restart leads out of this state.
    fn fallback_stop(&self, mut child: Option<Child>, why: &io::Error) {
        let since = clock::now();
        let mut is_said = false;
        let mut motor_link = self.config.link(Sharing::Shared, None, since);
        let mut until = None;
        loop {
            let now = clock::now();
            motor_link.step(Velocity::ZERO, now);
            let fallback_stop = match motor_link.status(now).state {
                _ if motor_link.has_stopped_since(since) => FallbackStop::Stopped,
                State::Faulty(crate::actuators::report::ControllerFault::Port(_)) => {
                    FallbackStop::Unreachable
                }
                State::Starting | State::Ready | State::Faulty(_) => FallbackStop::Trying,
            };
            self.snapshot(Err(Fault::GuardGone(fallback_stop)), now);
            if child.as_mut().is_some_and(has_ended) {
                child = None;
            }
            // Not before: writing to a stopped terminal blocks.
            if fallback_stop == FallbackStop::Stopped && !is_said {
                is_said = true;
                tracing::error!(%why, "the motor guard was lost: the motors were commanded to stop");
            }
            if self.is_over() {
                let until = *until.get_or_insert(now + FINAL_STOP_TIMEOUT);
                if fallback_stop == FallbackStop::Stopped || now >= until {
                    return;
                }
            }
            self.wait(
                motor_link.fd(),
                motor_link.deadline().min(now + POLL_PERIOD),
            );
        }
    }

    fn is_over(&self) -> bool {
        self.shared.is_over.load(Ordering::Acquire)
    }

    fn snapshot(&self, known: Result<Report, Fault>, at: Monotonic) {
        *lock(&self.shared.snapshot) = MotorSnapshot { known, at };
    }

    fn refresh_snapshot(&self, now: Monotonic) {
        lock(&self.shared.snapshot).at = now;
    }

    fn wait(&self, other: Option<BorrowedFd<'_>>, until: Monotonic) {
        let readable = |fd| PollFd::from_borrowed_fd(fd, PollFlags::IN);
        let mut events = vec![readable(self.woken.as_fd())];
        events.extend(other.map(readable));
        wait(&mut events, until);
        let mut buffer = [0; 64];
        while let Ok(1..) = rustix::io::read(&self.woken, &mut buffer) {}
    }
}

/// Closes the pipe, which ends the guard after it has sent zero to the motors. Returns it if it had to be ended by force,
/// so that what it has sent is unknown.
fn shut_down(guard: Guard) -> Option<Child> {
    let Guard {
        mut child,
        command_pipe,
        report_pipe,
        ..
    } = guard;
    drop(command_pipe);
    let until = clock::now() + SHUTDOWN_TIMEOUT;
    while !has_ended(&mut child) {
        if clock::now() >= until {
            kill(&mut child);
            return Some(child);
        }
        let mut events = [PollFd::from_borrowed_fd(
            report_pipe.as_fd(),
            PollFlags::HUP,
        )];
        wait(
            &mut events,
            (clock::now() + Duration::from_millis(10)).min(until),
        );
    }
    None
}

/// Ends it for good, stopped or not; only one that hangs in the kernel outlives this.
fn kill(child: &mut Child) {
    // Where it has ended already, that is what was wanted.
    drop(child.kill());
    drop(child.try_wait());
}

fn has_ended(child: &mut Child) -> bool {
    !matches!(child.try_wait(), Ok(None))
}
