//! The thread beside the teleop loop: it may wait for processes and ports, the loop may not.

use std::io;
use std::os::fd::{AsFd as _, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;

use super::frame::{Asked, Decoder, Found, Frame as _, TOLD_BYTES};
use super::parent::{Account, GuardCommand, Shared};
use super::told::Told;
use super::wait::wait;
use crate::actuators::report::{Fault, Report, Rescue};
use crate::actuators::roboteq::RoboteqConfig;
use crate::actuators::roboteq::driver::State;
use crate::actuators::roboteq::line::Line;
use crate::actuators::roboteq::port::{Port, Sharing};
use crate::clock::Monotonic;
use crate::service_manager;
use crate::teleop::Velocity;

/// At least this often it looks at everything.
const TURN: Duration = Duration::from_millis(50);

/// A guard that has told nothing for this long, though it does so every 50 ms, may have been stopped: the motors are told
/// zero once. If it was only slow, it goes on.
const MISSED: Duration = Duration::from_millis(120);

/// Until a guard must have told something for the first time: its program must be loaded.
const START: Duration = Duration::from_secs(5);

/// How long a guard may take to end by itself, which includes its last words to the motors.
const FAREWELL: Duration = Duration::from_millis(1500);

/// How long motors are told zero at the end that have lost their guard.
const LAST_RESCUE: Duration = Duration::from_secs(1);

pub(super) struct Supervisor {
    command: GuardCommand,
    config: RoboteqConfig,
    silence: Duration,
    shared: Arc<Shared>,
    woken: UnixStream,
    sequence: u64,
    /// Version of the newest velocity that was handed on.
    known: u64,
}

/// A guard that runs, as far as is known.
struct Guard {
    child: Child,
    asks: ChildStdin,
    tells: ChildStdout,
    decoder: Decoder<TOLD_BYTES>,
    /// When it is lost, unless it tells something.
    lost: Monotonic,
    /// When the motors are told zero past it, unless it tells something; absent before the first time, and after that.
    missed: Option<Monotonic>,
}

impl Supervisor {
    pub(super) fn new(
        command: GuardCommand,
        config: RoboteqConfig,
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

    /// Until nobody wants it any more.
    pub(super) fn run(mut self) {
        let (child, why) = match self.spawn() {
            Ok(mut guard) => match self.supervise(&mut guard) {
                Ok(()) => match part(guard) {
                    None => return,
                    Some(child) => (Some(child), io::ErrorKind::TimedOut.into()),
                },
                Err(why) => {
                    end(&mut guard.child);
                    (Some(guard.child), why)
                }
            },
            Err(why) => (None, why),
        };
        self.shared.guard_pid.store(0, Ordering::Release);
        self.rescue(child, &why);
    }

    fn spawn(&self) -> io::Result<Guard> {
        let mut child = Command::new(&self.command.program)
            .args(&self.command.arguments)
            // The service manager is notified by the edge alone.
            .env_remove(service_manager::SOCKET)
            .envs(self.command.environment.iter().cloned())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C is for the edge, which lets the vehicle come to rest and then closes the pipe.
            .process_group(0)
            .spawn()?;
        let (Some(asks), Some(tells)) = (child.stdin.take(), child.stdout.take()) else {
            end(&mut child);
            return Err(io::ErrorKind::BrokenPipe.into());
        };
        rustix::io::ioctl_fionbio(&asks, true)?;
        rustix::io::ioctl_fionbio(&tells, true)?;
        self.shared.guard_pid.store(child.id(), Ordering::Release);
        Ok(Guard {
            child,
            asks,
            tells,
            decoder: Decoder::new(),
            lost: Monotonic::now() + self.silence.max(START),
            missed: None,
        })
    }

    /// Hands velocities on and reports back. An error: the guard is lost.
    fn supervise(&mut self, guard: &mut Guard) -> io::Result<()> {
        while !self.is_over() {
            self.ask(guard)?;
            self.listen(guard)?;
            let now = Monotonic::now();
            if guard.missed.take_if(|missed| now >= *missed).is_some() {
                // What cannot be told now is told when it is lost.
                drop(Port::stop_blindly(&self.config.port));
            }
            if now >= guard.lost {
                return Err(io::ErrorKind::TimedOut.into());
            }
            // What the guard told last still holds; what has gone wrong shows in `lost`.
            self.still_here(now);
            let turn = now + TURN;
            let until = guard.missed.map_or(turn, |missed| turn.min(missed));
            self.wait(Some(guard.tells.as_fd()), until);
        }
        Ok(())
    }

    fn ask(&mut self, guard: &Guard) -> io::Result<()> {
        let Some((version, velocity, decided_at)) = self.shared.latest.newer_than(self.known)
        else {
            return Ok(());
        };
        self.known = version;
        self.sequence += 1;
        let asked = Asked {
            sequence: self.sequence,
            decided_at,
            velocity,
        };
        match rustix::io::write(&guard.asks, &asked.encode()) {
            // A frame is written whole or not at all (pipe(7), PIPE_BUF). A full pipe: the guard does not read, and
            // either reads on and finds it all too old, or is lost.
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(errno) => Err(errno.into()),
        }
    }

    fn listen(&self, guard: &mut Guard) -> io::Result<()> {
        let mut buffer = [0; 4096];
        let bytes = match rustix::io::read(&guard.tells, &mut buffer) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => buffer.get(..count).unwrap_or_default(),
            Err(Errno::AGAIN | Errno::INTR) => return Ok(()),
            Err(errno) => return Err(errno.into()),
        };
        let mut newest: Option<Told> = None;
        guard.decoder.push(bytes, |found| match found {
            Found::Frame(told) => newest = Some(told),
            Found::Garbage => {}
        });
        if let Some(told) = newest {
            let now = Monotonic::now();
            guard.lost = now + self.silence;
            guard.missed = Some(now + MISSED);
            let fault = told.fault.map(Fault::Controller);
            self.account(fault.map_or(Ok(told.report), Err), now);
        }
        Ok(())
    }

    /// Tells the motors zero as long as anybody wants to know: there is no way back from here but a new start.
    fn rescue(&self, mut child: Option<Child>, why: &io::Error) {
        let since = Monotonic::now();
        let mut is_said = false;
        let mut line = Line::new(self.config.clone(), Sharing::Anybody, since);
        let mut until = None;
        loop {
            let now = Monotonic::now();
            line.step(Velocity::ZERO, now);
            let rescue = match line.status(now).state {
                _ if line.has_stopped_since(since) => Rescue::Stopped,
                State::Faulty(crate::actuators::report::ControllerFault::Port(_)) => {
                    Rescue::Unreachable
                }
                State::Starting | State::Ready | State::Faulty(_) => Rescue::Trying,
            };
            self.account(Err(Fault::GuardGone(rescue)), now);
            if child.as_mut().is_some_and(has_ended) {
                child = None;
            }
            // Not before: a terminal that is stopped stops whoever writes to it.
            if rescue == Rescue::Stopped && !is_said {
                is_said = true;
                tracing::error!(%why, "the motor guard was lost: the motors were told to stand");
            }
            if self.is_over() {
                let until = *until.get_or_insert(now + LAST_RESCUE);
                if rescue == Rescue::Stopped || now >= until {
                    return;
                }
            }
            self.wait(line.fd(), line.deadline().min(now + TURN));
        }
    }

    fn is_over(&self) -> bool {
        self.shared.is_over.load(Ordering::Acquire)
    }

    fn account(&self, known: Result<Report, Fault>, at: Monotonic) {
        let mut account = (self.shared.account.lock()).unwrap_or_else(PoisonError::into_inner);
        *account = Account { known, at };
    }

    fn still_here(&self, now: Monotonic) {
        let mut account = (self.shared.account.lock()).unwrap_or_else(PoisonError::into_inner);
        account.at = now;
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

/// Closes the pipe, which ends the guard after it has told the motors zero. Returns it if it had to be ended by force,
/// so that nobody knows what it has told them.
fn part(guard: Guard) -> Option<Child> {
    let Guard {
        mut child,
        asks,
        tells,
        ..
    } = guard;
    drop(asks);
    let until = Monotonic::now() + FAREWELL;
    while !has_ended(&mut child) {
        if Monotonic::now() >= until {
            end(&mut child);
            return Some(child);
        }
        let mut events = [PollFd::from_borrowed_fd(tells.as_fd(), PollFlags::HUP)];
        wait(
            &mut events,
            (Monotonic::now() + Duration::from_millis(10)).min(until),
        );
    }
    None
}

/// Ends it for good, stopped or not; only one that hangs in the kernel outlives this.
fn end(child: &mut Child) {
    // Where it has ended already, that is what was wanted.
    drop(child.kill());
    drop(child.try_wait());
}

fn has_ended(child: &mut Child) -> bool {
    !matches!(child.try_wait(), Ok(None))
}
