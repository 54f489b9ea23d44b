//! The guard's own process.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2};

use super::TELLS_EVERY;
use super::frame::{ASKED_BYTES, Decoder, Found, Frame as _};
use super::gate::Gate;
use super::told::Told;
use super::wait::wait;
use crate::actuators::report::{ControllerFault, Hold, Readiness, Report};
use crate::actuators::roboteq::RoboteqConfig;
use crate::actuators::roboteq::driver::{State, Status};
use crate::actuators::roboteq::line::Line;
use crate::actuators::roboteq::port::Sharing;
use crate::clock::Monotonic;
use crate::teleop::Velocity;

/// Longest that the guard waits at its end for the motors to acknowledge zero.
const FAREWELL: Duration = Duration::from_millis(600);

/// Ignores what is meant for the edge: `kill -USR2` sent to all of a service's processes, or the end of a terminal. The
/// kernel, too, sends SIGHUP, before SIGCONT, to a guard that is stopped when its edge dies. Before anything else in the
/// process: until then they end it.
///
/// # Errors
/// The system refuses.
pub fn ignore_signals() -> io::Result<()> {
    for signal in [SIGUSR1, SIGUSR2, SIGHUP] {
        // A handler that nobody asks; the standard library ignores SIGPIPE.
        signal_hook::flag::register(signal, Arc::new(AtomicBool::new(false)))?;
    }
    Ok(())
}

/// Owns the motors until `asked` closes or somebody ends the process, and always ends with the motors standing, as far
/// as they can be reached.
///
/// `asked` are frames of [`super::frame::Asked`], `told` gets frames of [`Told`]; both must be pipes of their own: they
/// are made not to block. It says nothing on standard error, where a terminal that is stopped would stop it.
///
/// # Errors
/// It could not begin: there is nothing to hear signals with, or `asked` or `told` cannot be made not to block.
pub fn run(asked: impl AsFd, told: impl AsFd, config: &RoboteqConfig) -> io::Result<()> {
    ignore_signals()?;
    Guard::new(asked.as_fd(), told.as_fd(), config)?.run();
    Ok(())
}

struct Guard<'a> {
    asked: BorrowedFd<'a>,
    told: BorrowedFd<'a>,
    /// Readable after SIGTERM, SIGINT or SIGQUIT.
    signalled: UnixStream,
    decoder: Decoder<ASKED_BYTES>,
    gate: Gate,
    line: Line,
    last_told: Option<(Monotonic, Readiness, Option<ControllerFault>)>,
    /// Since when it ends.
    ending: Option<Monotonic>,
}

impl<'a> Guard<'a> {
    fn new(
        asked: BorrowedFd<'a>,
        told: BorrowedFd<'a>,
        config: &RoboteqConfig,
    ) -> io::Result<Self> {
        let (signalled, on_signal) = UnixStream::pair()?;
        signalled.set_nonblocking(true)?;
        for signal in [SIGTERM, SIGINT, SIGQUIT] {
            signal_hook::low_level::pipe::register(signal, on_signal.try_clone()?)?;
        }
        rustix::io::ioctl_fionbio(asked, true)?;
        rustix::io::ioctl_fionbio(told, true)?;
        Ok(Self {
            asked,
            told,
            signalled,
            decoder: Decoder::new(),
            gate: Gate::new(),
            line: Line::new(config.clone(), Sharing::Exclusive, Monotonic::now()),
            last_told: None,
            ending: None,
        })
    }

    fn run(mut self) {
        while !self.is_over() {
            self.listen();
            // Read after everything that could have taken long: a process may be stopped at any point.
            let now = Monotonic::now();
            let status = self.line.status(now);
            if status.state != State::Ready || status.flags.is_off() {
                self.gate.close(Hold::Controller);
            }
            let velocity = match self.ending {
                None => self.gate.velocity(now),
                Some(_) => Velocity::ZERO,
            };
            self.line.step(velocity, now);
            self.tell(now);
            self.wait(now);
        }
    }

    fn is_over(&self) -> bool {
        self.ending
            .is_some_and(|since| self.line.has_stopped_since(since) || since.elapsed() >= FAREWELL)
    }

    fn end(&mut self) {
        self.ending.get_or_insert_with(Monotonic::now);
    }

    fn listen(&mut self) {
        let mut buffer = [0; 4096];
        if let Ok(1..) = rustix::io::read(&self.signalled, &mut buffer) {
            self.end();
        }
        while self.ending.is_none() {
            match rustix::io::read(self.asked, &mut buffer) {
                Ok(0) => self.end(),
                Ok(count) => {
                    let now = Monotonic::now();
                    let gate = &mut self.gate;
                    let bytes = buffer.get(..count).unwrap_or_default();
                    self.decoder.push(bytes, |found| match found {
                        Found::Frame(asked) => gate.take(&asked, now),
                        Found::Garbage => gate.take_garbage(),
                    });
                    // A flood must not keep it from its motors.
                    if count < buffer.len() {
                        return;
                    }
                }
                Err(Errno::AGAIN) => return,
                Err(Errno::INTR) => {}
                Err(_) => self.end(),
            }
        }
    }

    fn tell(&mut self, now: Monotonic) {
        let told = self.account(now);
        let (readiness, fault) = (told.report.readiness, told.fault);
        let is_due = self
            .last_told
            .is_none_or(|(at, last_readiness, last_fault)| {
                now.since(at) >= TELLS_EVERY || (last_readiness, last_fault) != (readiness, fault)
            });
        if !is_due {
            return;
        }
        self.last_told = Some((now, readiness, fault));
        match rustix::io::write(self.told, &told.encode()) {
            // Where nobody reads, the next one is as good.
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => {}
            Err(_) => self.end(),
        }
    }

    fn account(&self, now: Monotonic) -> Told {
        let status = self.line.status(now);
        let fault = match status.state {
            State::Starting | State::Ready => None,
            State::Faulty(fault) => Some(fault),
        };
        Told {
            sequence: self.gate.sequence(),
            report: Report {
                readiness: self.readiness(&status),
                applied: self.line.applied(&status),
                measured: self.line.measured(&status),
                battery_v: status.battery_v,
                controller: status.flags,
                watchdog: status.watchdog,
                counters: self.gate.counters(status.reconnects),
                at: now,
            },
            fault,
        }
    }

    fn readiness(&self, status: &Status) -> Readiness {
        match (status.state, self.gate.hold()) {
            (State::Starting, _) => Readiness::Starting,
            (State::Ready | State::Faulty(_), Some(hold)) => Readiness::Holding(hold),
            (State::Ready | State::Faulty(_), None) => Readiness::Obeying,
        }
    }

    fn wait(&self, now: Monotonic) {
        let tells = self.last_told.map_or(now, |(at, ..)| at) + TELLS_EVERY;
        let until = self.line.deadline().min(tells);
        let until = self
            .gate
            .deadline()
            .map_or(until, |too_old| until.min(too_old));
        let in_order = |fd| PollFd::from_borrowed_fd(fd, PollFlags::IN);
        let mut events = vec![in_order(self.signalled.as_fd())];
        events.extend(self.line.fd().map(in_order));
        // A pipe that has closed would be ready all the time.
        if self.ending.is_none() {
            events.push(in_order(self.asked));
        }
        wait(&mut events, until);
    }
}
