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

use super::REPORT_PERIOD;
use super::frame::{COMMAND_BYTES, Decoder, Found, Frame as _};
use super::gate::Gate;
use super::motor_report::MotorReport;
use super::wait::wait;
use crate::actuators::report::{ControllerFault, Hold, Readiness, Report};
use crate::actuators::roboteq::RoboteqConfig;
use crate::actuators::roboteq::driver::{State, Status};
use crate::actuators::roboteq::port::Sharing;
use crate::actuators::roboteq::serial_link::SerialLink;
use crate::clock;
use measurement::time::Monotonic;
use teleop::Velocity;

/// Longest that the guard waits at its end for the motors to acknowledge zero.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(600);

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

/// Owns the motors until `commands` closes or somebody ends the process, and always ends with the motors standing, as far
/// as they can be reached.
///
/// `commands` are frames of [`super::frame::MotorCommand`], `reports` gets frames of [`MotorReport`]; both must be pipes of their own: they
/// are made not to block. It says nothing on standard error, where a terminal that is stopped would stop it.
///
/// # Errors
/// It could not begin: there is nothing to hear signals with, or `commands` or `reports` cannot be made not to block.
pub fn run(commands: impl AsFd, reports: impl AsFd, config: &RoboteqConfig) -> io::Result<()> {
    ignore_signals()?;
    Guard::new(commands.as_fd(), reports.as_fd(), config)?.run();
    Ok(())
}

struct Guard<'a> {
    command_pipe: BorrowedFd<'a>,
    report_pipe: BorrowedFd<'a>,
    /// Readable after SIGTERM, SIGINT or SIGQUIT.
    signalled: UnixStream,
    decoder: Decoder<COMMAND_BYTES>,
    gate: Gate,
    serial_link: SerialLink,
    last_report: Option<(Monotonic, Readiness, Option<ControllerFault>)>,
    /// Since when it ends.
    ending: Option<Monotonic>,
}

impl<'a> Guard<'a> {
    fn new(
        command_pipe: BorrowedFd<'a>,
        report_pipe: BorrowedFd<'a>,
        config: &RoboteqConfig,
    ) -> io::Result<Self> {
        let (signalled, on_signal) = UnixStream::pair()?;
        signalled.set_nonblocking(true)?;
        for signal in [SIGTERM, SIGINT, SIGQUIT] {
            signal_hook::low_level::pipe::register(signal, on_signal.try_clone()?)?;
        }
        rustix::io::ioctl_fionbio(command_pipe, true)?;
        rustix::io::ioctl_fionbio(report_pipe, true)?;
        Ok(Self {
            command_pipe,
            report_pipe,
            signalled,
            decoder: Decoder::new(),
            gate: Gate::new(),
            serial_link: SerialLink::new(config.clone(), Sharing::Exclusive, clock::now()),
            last_report: None,
            ending: None,
        })
    }

    fn run(mut self) {
        while !self.is_over() {
            self.read_commands();
            // Read after everything that could have taken long: a process may be stopped at any point.
            let now = clock::now();
            let status = self.serial_link.status(now);
            if status.state != State::Ready || status.flags.is_off() {
                self.gate.close(Hold::Controller);
            }
            let velocity = match self.ending {
                None => self.gate.velocity(now),
                Some(_) => Velocity::ZERO,
            };
            self.serial_link.step(velocity, now);
            self.send_report(now);
            self.wait(now);
        }
    }

    fn is_over(&self) -> bool {
        self.ending.is_some_and(|since| {
            self.serial_link.has_stopped_since(since) || clock::elapsed(since) >= SHUTDOWN_TIMEOUT
        })
    }

    fn end(&mut self) {
        self.ending.get_or_insert_with(clock::now);
    }

    fn read_commands(&mut self) {
        let mut buffer = [0; 4096];
        if let Ok(1..) = rustix::io::read(&self.signalled, &mut buffer) {
            self.end();
        }
        while self.ending.is_none() {
            match rustix::io::read(self.command_pipe, &mut buffer) {
                Ok(0) => self.end(),
                Ok(count) => {
                    let now = clock::now();
                    let gate = &mut self.gate;
                    let bytes = buffer.get(..count).unwrap_or_default();
                    self.decoder.push(bytes, |found| match found {
                        Found::Frame(motor_command) => gate.take(&motor_command, now),
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

    fn send_report(&mut self, now: Monotonic) {
        let motor_report = self.build_report(now);
        let (readiness, fault) = (motor_report.report.readiness, motor_report.fault);
        let is_due = self
            .last_report
            .is_none_or(|(at, last_readiness, last_fault)| {
                now.since(at) >= REPORT_PERIOD || (last_readiness, last_fault) != (readiness, fault)
            });
        if !is_due {
            return;
        }
        self.last_report = Some((now, readiness, fault));
        match rustix::io::write(self.report_pipe, &motor_report.encode()) {
            // Where nobody reads, the next one is as good.
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => {}
            Err(_) => self.end(),
        }
    }

    fn build_report(&self, now: Monotonic) -> MotorReport {
        let status = self.serial_link.status(now);
        let fault = match status.state {
            State::Starting | State::Ready => None,
            State::Faulty(fault) => Some(fault),
        };
        MotorReport {
            sequence: self.gate.sequence(),
            report: Report {
                readiness: self.readiness(&status),
                applied: self.serial_link.applied(&status),
                measured: self.serial_link.measured(&status),
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
            (State::Ready | State::Faulty(_), None) => Readiness::Active,
        }
    }

    fn wait(&self, now: Monotonic) {
        let next_report = self.last_report.map_or(now, |(at, ..)| at) + REPORT_PERIOD;
        let until = self.serial_link.deadline().min(next_report);
        let until = self
            .gate
            .deadline()
            .map_or(until, |too_old| until.min(too_old));
        let in_order = |fd| PollFd::from_borrowed_fd(fd, PollFlags::IN);
        let mut events = vec![in_order(self.signalled.as_fd())];
        events.extend(self.serial_link.fd().map(in_order));
        // A pipe that has closed would be ready all the time.
        if self.ending.is_none() {
            events.push(in_order(self.command_pipe));
        }
        wait(&mut events, until);
    }
}
