//! The motor guard process: it owns the motors, and its gate passes only young commands.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::process::Signal;
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2};

use crate::actuators::forward_pipe::ForwardPipe;
use crate::actuators::motor_guard::frame::Frame as _;
use crate::actuators::motor_guard::frame::MotorReport;
use crate::actuators::motor_guard::frame::{COMMAND_BYTES, Decoder, Found, MotorCommand};
use crate::actuators::motor_guard::{REPORT_PERIOD, WATCHDOG};
use crate::actuators::motor_link::{LinkStatus, MotorLink, MotorLinkConfig, Sharing, State};
use crate::actuators::report::{ControllerFault, Counters, Hold, Readiness, Report};
use measurement::time::Monotonic;
use network::clock;
use teleop::Velocity;

/// Longest that the guard waits at its end for the motors to acknowledge zero.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(600);

/// Ignores what is meant for the edge: `kill -USR2` sent to all of a service's processes, or the end of a terminal. The
/// kernel, too, may send SIGHUP to a guard that is stopped when its edge dies. Before anything else in the process:
/// until then they end it.
pub fn ignore_signals() -> io::Result<()> {
    for signal in [SIGUSR1, SIGUSR2, SIGHUP] {
        // A handler without effect; the standard library ignores SIGPIPE.
        signal_hook::flag::register(signal, Arc::new(AtomicBool::new(false)))?;
    }
    Ok(())
}

/// Owns the motors until `commands` closes or a signal ends the process. It ends with the motors at zero, if they can
/// be reached.
///
/// `commands` are frames of [`super::frame::MotorCommand`], `reports` gets frames of [`MotorReport`]; both must be
/// pipes of their own: they are made not to block. A third may be inherited: [`ForwardPipe`]. It writes nothing to
/// standard error: a stopped terminal would block it.
pub fn run(commands: impl AsFd, reports: impl AsFd, config: &MotorLinkConfig) -> io::Result<()> {
    ignore_signals()?;
    // A guard that is stopped when its edge dies must continue, to send zero. Of itself the kernel continues only a
    // process group that has stopped already and has no other member.
    rustix::process::set_parent_process_death_signal(Some(Signal::CONT))?;
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
    motor_link: Box<dyn MotorLink>,
    /// How often a mode was requested of the motors' controller.
    mode_requests: u32,
    last_report: Option<(Monotonic, Readiness, Option<ControllerFault>)>,
    ending: Option<Monotonic>,
}

impl<'a> Guard<'a> {
    fn new(
        command_pipe: BorrowedFd<'a>,
        report_pipe: BorrowedFd<'a>,
        config: &MotorLinkConfig,
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
            motor_link: config.link(Sharing::Exclusive, ForwardPipe::inherited(), clock::now()),
            mode_requests: 0,
            last_report: None,
            ending: None,
        })
    }

    fn run(mut self) {
        while !self.is_over() {
            self.read_commands();
            // Read after everything that could have taken long: a process may be stopped at any point.
            let now = clock::now();
            let status = self.motor_link.status(now);
            if status.state != State::Ready || status.flags.is_off() {
                self.gate.close(Hold::Controller);
            }
            let velocity = match self.ending {
                None => self.gate.velocity(now),
                Some(_) => Velocity::ZERO,
            };
            if self.gate.mode_requests > self.mode_requests {
                self.mode_requests = self.gate.mode_requests;
                self.motor_link.request_mode();
            }
            self.motor_link.step(velocity, now);
            self.send_report(now);
            self.wait(now);
        }
    }

    fn is_over(&self) -> bool {
        self.ending.is_some_and(|since| {
            self.motor_link.has_stopped_since(since) || clock::elapsed(since) >= SHUTDOWN_TIMEOUT
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
            // If the pipe is full, the next report is as good.
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => {}
            Err(_) => self.end(),
        }
    }

    fn build_report(&self, now: Monotonic) -> MotorReport {
        let status = self.motor_link.status(now);
        let fault = match status.state {
            State::Starting | State::Ready => None,
            State::Faulty(fault) => Some(fault),
        };
        MotorReport {
            sequence: self.gate.sequence(),
            report: Report {
                readiness: self.readiness(&status),
                applied: status.applied,
                measured: status.measured,
                battery_v: status.battery_v,
                controller: status.flags,
                watchdog: status.watchdog,
                counters: Counters {
                    lost_bytes: status.lost_bytes,
                    ..self.gate.counters(status.reconnects)
                },
                at: now,
            },
            fault,
        }
    }

    fn readiness(&self, status: &LinkStatus) -> Readiness {
        match (status.state, self.gate.hold()) {
            (State::Starting, _) => Readiness::Starting,
            (State::Ready | State::Faulty(_), Some(hold)) => Readiness::Holding(hold),
            (State::Ready | State::Faulty(_), None) => Readiness::Active,
        }
    }

    fn wait(&self, now: Monotonic) {
        let next_report = self.last_report.map_or(now, |(at, ..)| at) + REPORT_PERIOD;
        let until = self.motor_link.deadline().min(next_report);
        let until = self
            .gate
            .deadline()
            .map_or(until, |too_old| until.min(too_old));
        let in_order = |fd| PollFd::from_borrowed_fd(fd, PollFlags::IN);
        let mut events = vec![in_order(self.signalled.as_fd())];
        events.extend(self.motor_link.fd().map(in_order));
        // A pipe that has closed would be ready all the time.
        if self.ending.is_none() {
            events.push(in_order(self.command_pipe));
        }
        wait(&mut events, until);
    }
}

/// Bytes of garbage in a row, as many as three frames have, after which what came before no longer counts.
const GARBAGE_LIMIT: usize = 3 * COMMAND_BYTES;

/// Passes a velocity only while it is young.
///
/// A velocity holds for [`WATCHDOG`] from the moment on at which the edge decided on it, by the clock that both share:
/// how long it was on the way counts, and what comes late is not obeyed at all. After a gap, and at the start, motors
/// stand until the edge has asked for zero.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    newest: Option<MotorCommand>,
    greatest_sequence: u64,
    hold: Option<Hold>,
    garbage_in_a_row: usize,
    dropouts: u32,
    stale: u32,
    garbage: u32,
    /// Of the newest command that was young when it came.
    pub(super) mode_requests: u32,
}

impl Gate {
    pub(super) const fn new() -> Self {
        Self {
            newest: None,
            greatest_sequence: 0,
            hold: Some(Hold::Start),
            garbage_in_a_row: 0,
            dropouts: 0,
            stale: 0,
            garbage: 0,
            mode_requests: 0,
        }
    }

    pub(super) fn take(&mut self, motor_command: &MotorCommand, now: Monotonic) {
        self.expire(now);
        if !is_current(motor_command, now) || motor_command.sequence <= self.greatest_sequence {
            self.stale = self.stale.saturating_add(1);
            return;
        }
        self.greatest_sequence = motor_command.sequence;
        self.mode_requests = motor_command.mode_requests;
        self.garbage_in_a_row = 0;
        if !motor_command.velocity.is_finite() {
            return self.close(Hold::Garbage);
        }
        self.newest = Some(*motor_command);
        if motor_command.velocity.is_zero() {
            self.hold = None;
        }
    }

    pub(super) fn take_garbage(&mut self) {
        self.garbage = self.garbage.saturating_add(1);
        self.garbage_in_a_row += 1;
        if self.garbage_in_a_row >= GARBAGE_LIMIT {
            self.garbage_in_a_row = 0;
            self.close(Hold::Garbage);
        }
    }

    /// Holds the motors at zero until zero is requested.
    pub(super) fn close(&mut self, hold: Hold) {
        if self.hold.is_none() {
            self.dropouts = self.dropouts.saturating_add(1);
        }
        self.newest = None;
        self.hold = Some(hold);
    }

    pub(super) fn velocity(&mut self, now: Monotonic) -> Velocity {
        self.expire(now);
        match (self.hold, self.newest) {
            (None, Some(motor_command)) => motor_command.velocity,
            (Some(_), _) | (None, None) => Velocity::ZERO,
        }
    }

    /// When what is held grows too old.
    pub(super) fn deadline(&self) -> Option<Monotonic> {
        self.newest
            .map(|motor_command| motor_command.decided_at + WATCHDOG)
    }

    pub(super) const fn hold(&self) -> Option<Hold> {
        self.hold
    }

    pub(super) const fn sequence(&self) -> u64 {
        self.greatest_sequence
    }

    pub(super) const fn counters(&self, reconnects: u32) -> Counters {
        Counters {
            dropouts: self.dropouts,
            stale: self.stale,
            garbage: self.garbage,
            reconnects,
            lost_bytes: 0,
        }
    }

    fn expire(&mut self, now: Monotonic) {
        if self
            .newest
            .is_some_and(|motor_command| !is_current(&motor_command, now))
        {
            self.newest = None;
            // An earlier reason for holding is kept.
            if self.hold.is_none() {
                self.close(Hold::Silence);
            }
        }
    }
}

/// Younger than the watchdog, and not from the future: such a command would never expire.
fn is_current(motor_command: &MotorCommand, now: Monotonic) -> bool {
    motor_command.decided_at <= now && now.since(motor_command.decided_at) < WATCHDOG
}

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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::*;

    const START_MS: u64 = 1_000_000;

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos((START_MS + ms) * 1_000_000)
    }

    fn ask(gate: &mut Gate, sequence: u64, decided_ms: u64, linear_mps: f64, now_ms: u64) {
        let motor_command = MotorCommand {
            sequence,
            decided_at: at(decided_ms),
            velocity: Velocity {
                linear_mps,
                lateral_mps: 0.0,
                angular_radps: 0.0,
            },
            mode_requests: 0,
        };
        gate.take(&motor_command, at(now_ms));
    }

    fn moves(gate: &mut Gate, now_ms: u64) -> bool {
        gate.velocity(at(now_ms)) != Velocity::ZERO
    }

    /// Open, at 1 m/s decided at 20 ms.
    fn open() -> Gate {
        let mut gate = Gate::new();
        ask(&mut gate, 1, 0, 0.0, 0);
        ask(&mut gate, 2, 20, 1.0, 20);
        assert!(moves(&mut gate, 20));
        gate
    }

    #[test]
    fn nothing_moves_before_zero_was_asked_for() {
        let mut gate = Gate::new();
        ask(&mut gate, 1, 0, 1.0, 0);
        assert!(!moves(&mut gate, 0));
        ask(&mut gate, 2, 20, 0.0, 20);
        assert!(!moves(&mut gate, 20));
        ask(&mut gate, 3, 40, 1.0, 40);
        assert!(moves(&mut gate, 40));
    }

    #[test]
    fn a_velocity_holds_for_200_ms_from_its_decision() {
        let mut gate = open();
        assert_eq!(gate.deadline(), Some(at(220)));
        assert!(moves(&mut gate, 219));
        assert!(!moves(&mut gate, 220));
        assert_eq!(gate.hold(), Some(Hold::Silence));
        assert_eq!(gate.counters(0).dropouts, 1);
        // On its way for 150 ms: 50 ms are left.
        let mut gate = open();
        ask(&mut gate, 3, 50, 1.0, 200);
        assert!(moves(&mut gate, 249));
        assert!(!moves(&mut gate, 250));
    }

    #[test]
    fn late_repeated_and_future_ones_are_refused() {
        let mut gate = open();
        ask(&mut gate, 3, 30, -1.0, 230);
        assert!(!moves(&mut gate, 230), "too old when it came");
        let mut gate = open();
        ask(&mut gate, 2, 100, -1.0, 100);
        ask(&mut gate, 1, 100, -1.0, 100);
        ask(&mut gate, 9, 101, -1.0, 100);
        assert!((gate.velocity(at(100)).linear_mps - 1.0).abs() < 1e-9);
        assert_eq!(gate.counters(0).stale, 3);
    }

    #[test]
    fn after_a_gap_zero_comes_first() {
        let mut gate = open();
        ask(&mut gate, 3, 400, 1.0, 400);
        assert!(!moves(&mut gate, 400), "the key was down all the time");
        ask(&mut gate, 4, 420, 0.0, 420);
        ask(&mut gate, 5, 440, 1.0, 440);
        assert!(moves(&mut gate, 440));
    }

    #[test]
    fn garbage_closes() {
        let mut gate = open();
        (1..GARBAGE_LIMIT).for_each(|_| gate.take_garbage());
        assert!(moves(&mut gate, 30));
        gate.take_garbage();
        assert!(!moves(&mut gate, 30));
        assert_eq!(gate.hold(), Some(Hold::Garbage));
        let mut gate = open();
        ask(&mut gate, 3, 30, f64::NAN, 30);
        assert!(!moves(&mut gate, 30), "a number that is none is no zero");
        ask(&mut gate, 4, 40, 1.0, 40);
        assert!(!moves(&mut gate, 40));
    }

    #[test]
    fn a_frame_between_resets_the_count_of_garbage() {
        let mut gate = open();
        for sequence in 3..50 {
            (0..100).for_each(|_| gate.take_garbage());
            ask(&mut gate, sequence, sequence * 10, 1.0, sequence * 10);
            assert!(moves(&mut gate, sequence * 10));
        }
    }

    proptest! {
        /// Whatever comes, in whatever order and however late: what passes was asked for within the last 200 ms.
        #[test]
        fn what_passes_is_young(
            events in prop::collection::vec((0..8u8, 0..120u64, 0..500u64, 0..60u64, any::<bool>()), 1..200),
        ) {
            let mut gate = Gate::new();
            let mut now_ms = 1000;
            let mut taken: Vec<(u64, f64)> = Vec::new();
            for (number, (kind, pass_ms, age_ms, sequence, is_zero)) in events.into_iter().enumerate() {
                now_ms += pass_ms;
                let speed = if is_zero { 0.0 } else { number as f64 + 1.0 };
                match kind {
                    0 => gate.take_garbage(),
                    1 => ask(&mut gate, sequence, now_ms + 1 + age_ms, speed, now_ms),
                    _ => {
                        ask(&mut gate, sequence, now_ms - age_ms, speed, now_ms);
                        taken.push((now_ms - age_ms, speed));
                    }
                }
                let passes = gate.velocity(at(now_ms));
                let is_young = taken.iter().any(|&(decided_ms, motor_command)| {
                    passes.linear_mps.to_bits() == motor_command.to_bits() && now_ms - decided_ms < 200
                });
                prop_assert!(passes == Velocity::ZERO || is_young);
                let later = gate.clone().velocity(at(now_ms) + Duration::from_millis(200));
                prop_assert_eq!(later, Velocity::ZERO);
            }
        }
    }
}
