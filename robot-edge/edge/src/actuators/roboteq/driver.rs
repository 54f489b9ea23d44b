//! The protocol state machine of an AX3500: finds it, stops it, checks it, and then repeats two speed commands.
//!
//! Bytes go in ([`Driver::receive`]) and out ([`Driver::transmit`]), the time is an argument, and nothing waits. One
//! command at a time is on its way: what the port's buffer holds could not be taken back, and would be an old command.
//! Only a stop goes out at once, for both motors in one write ([`Command::StopBoth`]), behind whatever is on its way.
//!
//! The start takes some 3 s, during which the motors stand: both get zero without a reply; ten carriage returns end R/C
//! mode; zero must be acknowledged; the parameters that decide what a command would do are read; then nothing is said
//! until the controller's watchdog says that it has stopped the motors. All this is repeated whenever the controller
//! has been silent, has garbled or refused several commands, or has been reset.

use std::time::Duration;

use crate::actuators::motor_link::State;
use crate::actuators::report::{ControllerFault, ControllerFlags, ControllerWatchdog};
use crate::actuators::roboteq::wire::{
    self, Channel, Command, Exchange, Line, Outcome, Parameter, Power, ReplyParser,
};
use measurement::time::Monotonic;

/// Consecutive failures after which the search for the controller restarts.
const LIMIT_IN_A_ROW: u8 = 3;

/// Time until the controller has handled an unacknowledged command: 15 characters of 1.04 ms, and its loop of 16 ms.
const STOP_PAUSE: Duration = Duration::from_millis(60);

/// Until it has entered RS-232 mode.
const WAKE_PAUSE: Duration = Duration::from_millis(120);

const RETRY_PAUSE: Duration = Duration::from_millis(300);

/// Its watchdog acts after 1 s (p. 142), more or less with the PWM frequency (p. 157).
const WATCHDOG_WAIT: Duration = Duration::from_millis(2500);

/// What was measured is forgotten after this.
const MEASUREMENT_LASTS: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    pub state: State,
    pub acknowledged: Option<[Power; 2]>,
    pub encoders: Option<[Power; 2]>,
    pub battery_v: Option<f64>,
    /// Why its power stage is off, if it is.
    pub flags: ControllerFlags,
    pub watchdog: ControllerWatchdog,
    pub reconnects: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transmission {
    pub bytes: Line,
    /// First throw away what still waits in the port's buffers, in both directions.
    pub flush: bool,
}

/// What is asked of encoders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderQueries {
    pub speeds: bool,
    pub counts: bool,
}

#[derive(Clone, Debug)]
pub struct Driver {
    require_watchdog: bool,
    phase: Phase,
    /// When the phase goes on.
    due: Monotonic,
    last_fault: Option<ControllerFault>,
    /// Starts in vain since it was last found.
    failed_starts: u32,
    parser: ReplyParser,
    exchange: Option<Exchange>,
    /// The last command, where nothing came back in time.
    unanswered: Option<Command>,
    failures: u8,
    wanted: [Power; 2],
    acknowledged: [Option<(Power, Monotonic)>; 2],
    scheduler: Scheduler,
    /// The controller has acknowledged [`Command::StopBoth`] when it was found.
    takes_pairs: bool,
    /// It has not acknowledged one since: zero is sent to one motor after the other until both have acknowledged that.
    stops_singly: bool,
    input_mode: Option<u8>,
    encoders: Option<([Power; 2], Monotonic)>,
    battery_v: Option<f64>,
    flags: ControllerFlags,
    watchdog: ControllerWatchdog,
    reconnects: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    StopWithoutReply,
    Wake,
    ZeroBoth,
    /// Where the controller does not take both at once.
    Zero(Channel),
    Check(Parameter),
    /// Nothing is sent.
    AwaitWatchdog,
    Ready,
    Refused(ControllerFault),
}

impl Driver {
    pub fn new(queries: EncoderQueries, require_watchdog: bool, now: Monotonic) -> Self {
        Self {
            require_watchdog,
            phase: Phase::StopWithoutReply,
            due: now,
            last_fault: None,
            failed_starts: 0,
            parser: ReplyParser::default(),
            exchange: None,
            unanswered: None,
            failures: 0,
            wanted: [Power::ZERO; 2],
            acknowledged: [None; 2],
            scheduler: Scheduler::new(queries, now),
            takes_pairs: false,
            stops_singly: false,
            input_mode: None,
            encoders: None,
            battery_v: None,
            flags: ControllerFlags::default(),
            watchdog: ControllerWatchdog::Unknown,
            reconnects: 0,
        }
    }

    /// Sets the channel commands; ignored while the controller is not ready.
    pub fn command(&mut self, wanted: [Power; 2]) {
        if self.phase == Phase::Ready {
            self.wanted = wanted;
        }
    }

    pub fn receive(&mut self, bytes: &[u8], now: Monotonic) {
        for &byte in bytes {
            if let Some(reply) = self.parser.push(byte) {
                self.take(reply, now);
            }
        }
    }

    /// What is to be sent now; ask until there is nothing more, and again at [`Self::deadline`] or when bytes came in.
    pub fn transmit(&mut self, now: Monotonic) -> Option<Transmission> {
        if let Some(exchange) = self.exchange.filter(|exchange| now >= exchange.deadline()) {
            self.exchange = None;
            self.unanswered = exchange.is_silent().then_some(exchange.command);
            self.fail(exchange.command, ControllerFault::Silent, now);
        }
        if self.must_stop() {
            let interrupted = self.exchange.take();
            self.scheduler.stop_both(now);
            return Some(self.send(Exchange::stop_both(interrupted, now)));
        }
        if self.exchange.is_some() || now < self.due {
            return None;
        }
        match self.phase {
            Phase::StopWithoutReply => {
                self.parser.clear();
                self.enter(Phase::Wake, now + STOP_PAUSE);
                Some(Transmission {
                    bytes: wire::stop_without_reply(),
                    flush: true,
                })
            }
            Phase::Wake => {
                self.enter(Phase::ZeroBoth, now + WAKE_PAUSE);
                Some(Transmission {
                    bytes: wire::wake(),
                    flush: false,
                })
            }
            Phase::ZeroBoth => Some(self.start_exchange(Command::StopBoth, now)),
            Phase::Zero(channel) => {
                Some(self.start_exchange(Command::Run(channel, Power::ZERO), now))
            }
            Phase::Check(parameter) => Some(self.start_exchange(Command::Read(parameter), now)),
            Phase::AwaitWatchdog => {
                self.check_watchdog(ControllerWatchdog::Absent, now);
                self.transmit(now)
            }
            Phase::Ready | Phase::Refused(_) => {
                let acknowledged = self.acknowledged_powers();
                let task = self.scheduler.next(self.wanted, acknowledged, now)?;
                Some(self.start_exchange(self.command_of(task), now))
            }
        }
    }

    /// When to ask for something to send at the latest.
    pub fn deadline(&self) -> Monotonic {
        match (self.exchange, self.phase) {
            (Some(exchange), _) => exchange.deadline(),
            (None, Phase::Ready | Phase::Refused(_)) => self
                .scheduler
                .deadline(self.wanted, self.acknowledged_powers()),
            (None, _) => self.due,
        }
    }

    fn acknowledged_powers(&self) -> [Option<Power>; 2] {
        self.acknowledged.map(|last| last.map(|(power, _)| power))
    }

    pub fn status(&self, now: Monotonic) -> Status {
        let state = match (self.phase, self.last_fault) {
            (Phase::Refused(fault), _) | (_, Some(fault)) => State::Faulty(fault),
            (Phase::Ready, None) => State::Ready,
            (_, None) => State::Starting,
        };
        let acknowledged = match self.acknowledged {
            [Some((one, _)), Some((two, _))] => Some([one, two]),
            [..] => None,
        };
        Status {
            state,
            acknowledged,
            encoders: self
                .encoders
                .and_then(|(speeds, at)| (now.since(at) < MEASUREMENT_LASTS).then_some(speeds)),
            battery_v: self.battery_v,
            flags: self.flags,
            watchdog: self.watchdog,
            reconnects: self.reconnects,
        }
    }

    /// Whether both motors have acknowledged a zero that was sent at `since` or later, and nothing else after it.
    pub fn has_stopped_since(&self, since: Monotonic) -> bool {
        self.acknowledged
            .iter()
            .all(|last| last.is_some_and(|(power, sent)| power == Power::ZERO && sent >= since))
    }

    fn start_exchange(&mut self, command: Command, now: Monotonic) -> Transmission {
        self.send(Exchange::new(command, now))
    }

    fn send(&mut self, exchange: Exchange) -> Transmission {
        let exchange = exchange.after_silence(self.unanswered.take());
        self.exchange = Some(exchange);
        Transmission {
            bytes: exchange.command.bytes(),
            flush: false,
        }
    }

    /// Whether zero is wanted of motors that run, or may as soon as a command on its way is done.
    fn must_stop(&self) -> bool {
        let is_zero =
            |last: &Option<(Power, Monotonic)>| last.is_some_and(|(power, _)| power == Power::ZERO);
        let may_run = match self.exchange.map(|exchange| exchange.command) {
            Some(Command::StopBoth) => return false,
            Some(Command::Run(_, power)) => power != Power::ZERO,
            Some(
                Command::Read(_)
                | Command::Voltages
                | Command::EncoderSpeeds
                | Command::EncoderCount(_),
            )
            | None => false,
        };
        self.phase == Phase::Ready
            && self.wanted == [Power::ZERO; 2]
            && self.takes_pairs
            && !self.stops_singly
            && (may_run || !self.acknowledged.iter().all(is_zero))
    }

    fn command_of(&self, task: Task) -> Command {
        let [one, two] = self.wanted;
        match task {
            Task::RunOne => Command::Run(Channel::One, one),
            Task::RunTwo => Command::Run(Channel::Two, two),
            Task::Status => Command::Read(Parameter::Status),
            Task::Voltages => Command::Voltages,
            Task::Speeds => Command::EncoderSpeeds,
            Task::CountOne => Command::EncoderCount(Channel::One),
            Task::CountTwo => Command::EncoderCount(Channel::Two),
        }
    }

    fn enter(&mut self, phase: Phase, due: Monotonic) {
        self.phase = phase;
        self.due = due;
    }

    fn take(&mut self, reply: wire::Reply, now: Monotonic) {
        use wire::Reply::{Prompt, WatchdogTripped};
        if reply == WatchdogTripped && self.phase == Phase::AwaitWatchdog {
            return self.check_watchdog(ControllerWatchdog::Proven, now);
        }
        // It received nothing for a second, or was switched off: earlier commands no longer hold.
        if matches!(reply, WatchdogTripped | Prompt) && self.phase == Phase::Ready {
            return self.reconnect(ControllerFault::Silent, now);
        }
        let Some(exchange) = &mut self.exchange else {
            return;
        };
        let outcome = exchange.take(reply);
        let exchange = *exchange;
        if outcome != Outcome::Waiting {
            self.exchange = None;
        }
        match outcome {
            Outcome::Waiting => {}
            Outcome::Done(values) => self.done(&exchange, values, now),
            Outcome::Garbled => self.fail(exchange.command, ControllerFault::GarbledLine, now),
            Outcome::Refused => self.refused(exchange.command, now),
        }
    }

    fn done(&mut self, exchange: &Exchange, values: [u8; 2], now: Monotonic) {
        self.failures = 0;
        match exchange.command {
            Command::StopBoth => {
                self.acknowledged = [Some((Power::ZERO, exchange.sent())); 2];
                if self.phase == Phase::ZeroBoth {
                    self.takes_pairs = true;
                    self.enter(Phase::Check(Parameter::InputControlMode), now);
                }
            }
            Command::Run(channel, power) => {
                self.acknowledged[channel as usize] = Some((power, exchange.sent()));
                let are_zero = self.acknowledged.map(|last| last.map(|(power, _)| power))
                    == [Some(Power::ZERO); 2];
                self.stops_singly &= !are_zero;
                match self.phase {
                    Phase::Zero(Channel::One) => self.enter(Phase::Zero(Channel::Two), now),
                    Phase::Zero(Channel::Two) => {
                        self.enter(Phase::Check(Parameter::InputControlMode), now);
                    }
                    Phase::StopWithoutReply
                    | Phase::Wake
                    | Phase::ZeroBoth
                    | Phase::Check(_)
                    | Phase::AwaitWatchdog
                    | Phase::Ready
                    | Phase::Refused(_) => {}
                }
            }
            Command::Read(Parameter::InputControlMode) => {
                self.input_mode = Some(values[0]);
                self.enter(Phase::Check(Parameter::MotorControlMode), now);
            }
            Command::Read(Parameter::MotorControlMode) => self.check_motor_mode(values[0], now),
            Command::Read(Parameter::Status) => self.flags = ControllerFlags(values[0]),
            Command::Voltages => self.battery_v = Some(wire::battery_v(values[0])),
            Command::EncoderSpeeds => self.encoders = Some((values.map(Power::from_bits), now)),
            // Read elsewhere.
            Command::EncoderCount(_) => {}
        }
    }

    fn refused(&mut self, command: Command, now: Monotonic) {
        match command {
            Command::Run(..) | Command::StopBoth => {
                self.fail(command, ControllerFault::Refusing, now);
            }
            // Without it, what a motor command means would be guessed. It may have been refused because of a bad line:
            // it is asked again.
            Command::Read(Parameter::MotorControlMode) => {
                self.fail(command, ControllerFault::Unreadable, now);
            }
            Command::Read(Parameter::InputControlMode) => {
                self.enter(Phase::Check(Parameter::MotorControlMode), now);
            }
            // It has none of these; that is not dangerous.
            Command::Read(Parameter::Status) | Command::Voltages | Command::EncoderSpeeds => {}
            Command::EncoderCount(_) => self.scheduler.postpone_counts(now),
        }
    }

    fn fail(&mut self, command: Command, fault: ControllerFault, now: Monotonic) {
        if self.phase == Phase::ZeroBoth {
            return self.enter(Phase::Zero(Channel::One), now);
        }
        if matches!(command, Command::EncoderCount(_)) {
            self.scheduler.postpone_counts(now);
        }
        self.stops_singly |= command == Command::StopBoth;
        self.failures = self.failures.saturating_add(1);
        self.scheduler.repeat(now);
        let is_looking = matches!(self.phase, Phase::Zero(_));
        if is_looking || self.failures >= LIMIT_IN_A_ROW {
            self.reconnect(fault, now);
        }
    }

    fn reconnect(&mut self, fault: ControllerFault, now: Monotonic) {
        let was_found = matches!(self.phase, Phase::Ready | Phase::Refused(_));
        self.reconnects = self.reconnects.saturating_add(u32::from(was_found));
        // A controller may still boot, and the first answers may come late: a fault only where it is not found again.
        self.failed_starts = self.failed_starts.saturating_add(1);
        if was_found || self.failed_starts > 1 {
            self.last_fault = Some(fault);
        }
        self.failures = 0;
        self.exchange = None;
        self.unanswered = None;
        self.wanted = [Power::ZERO; 2];
        self.acknowledged = [None; 2];
        self.takes_pairs = false;
        self.stops_singly = false;
        self.encoders = None;
        let pause = if was_found {
            Duration::ZERO
        } else {
            RETRY_PAUSE
        };
        self.enter(Phase::StopWithoutReply, now + pause);
    }

    fn check_motor_mode(&mut self, mode: u8, now: Monotonic) {
        match mode & 0b111 {
            0 | 4 => self.enter(Phase::AwaitWatchdog, now + WATCHDOG_WAIT),
            _ => self.enter(Phase::Refused(ControllerFault::MotorMode(mode)), now),
        }
    }

    fn check_watchdog(&mut self, watchdog: ControllerWatchdog, now: Monotonic) {
        self.watchdog = watchdog;
        self.last_fault = None;
        self.failed_starts = 0;
        let is_safe = watchdog == ControllerWatchdog::Proven || !self.require_watchdog;
        let phase = if is_safe {
            Phase::Ready
        } else {
            Phase::Refused(ControllerFault::NoWatchdog(self.input_mode.unwrap_or(0xFF)))
        };
        self.enter(phase, now);
    }
}

/// Speeds that have not changed are repeated after this: a command that got lost, or a controller that was reset, must
/// not last.
const REPEAT: Duration = Duration::from_millis(50);

/// Least time between two pairs of motor commands: a quick line must not be flooded.
const MIN_PAUSE: Duration = Duration::from_millis(10);

const STATUS_EVERY: Duration = Duration::from_millis(200);
const VOLTAGES_EVERY: Duration = Duration::from_secs(1);
const SPEEDS_EVERY: Duration = Duration::from_millis(100);

/// Beside counts.
const SPEEDS_SELDOM_EVERY: Duration = Duration::from_millis(250);

/// What is wanted of the count of each encoder; 5 to 8 a second are had.
///
/// 9600 baud are 960 characters a second (start, 7 data, parity, stop bit) in each direction. With a pair of motor
/// commands every 50 ms and a question after each, 20 of each a second:
///
/// | | sent, characters | received |
/// | --- | --- | --- |
/// | 40 × `!Ann` | 200 | echo and `+`: 280 |
/// | 13 × `?Q0`, `?Q1` | 52 | echo and up to 8 digits: 169 |
/// | 4 × `^89`, 3 × `?Z`, 1 × `?E` | 28 | 64 |
/// | of 960 | 280 | 513 |
///
/// The controller's loop of 16 ms, in which it is taken to handle one line, is the narrower limit: 62 lines a second, of
/// which these are 60. So they do not all get what they want: the one that is most overdue is asked.
const COUNTS_EVERY: Duration = Duration::from_millis(100);

/// A controller without encoders, or without an answer, must not fill the line.
const COUNTS_RETRY: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    RunOne,
    RunTwo,
    Status,
    Voltages,
    Speeds,
    CountOne,
    CountTwo,
}

/// Motor commands in pairs, and at most one question between two pairs.
#[derive(Clone, Debug)]
pub(super) struct Scheduler {
    /// The first command of a pair was sent.
    is_half: bool,
    /// A question may come before the next pair.
    may_poll: bool,
    pair_at: Monotonic,
    must_repeat: bool,
    polls: [Poll; 5],
}

#[derive(Clone, Copy, Debug)]
struct Poll {
    task: Task,
    every: Duration,
    /// Absent where it is never asked.
    due: Option<Monotonic>,
}

impl Scheduler {
    pub(super) fn new(queries: EncoderQueries, now: Monotonic) -> Self {
        let speeds_every = if queries.counts {
            SPEEDS_SELDOM_EVERY
        } else {
            SPEEDS_EVERY
        };
        let poll = |task, every, is_asked: bool| Poll {
            task,
            every,
            due: is_asked.then_some(now),
        };
        Self {
            is_half: false,
            may_poll: false,
            pair_at: now,
            must_repeat: true,
            polls: [
                poll(Task::Status, STATUS_EVERY, true),
                poll(Task::Speeds, speeds_every, queries.speeds),
                poll(Task::CountOne, COUNTS_EVERY, queries.counts),
                poll(Task::CountTwo, COUNTS_EVERY, queries.counts),
                poll(Task::Voltages, VOLTAGES_EVERY, true),
            ],
        }
    }

    pub(super) fn next(
        &mut self,
        wanted: [Power; 2],
        acknowledged: [Option<Power>; 2],
        now: Monotonic,
    ) -> Option<Task> {
        if self.is_half {
            self.is_half = false;
            self.may_poll = true;
            return Some(Task::RunTwo);
        }
        if self.may_ask(wanted, acknowledged) {
            let due = |poll: &&mut Poll| poll.due.is_some_and(|due| now >= due);
            let polls = self.polls.iter_mut().filter(due);
            if let Some(poll) = polls.min_by_key(|poll| poll.due) {
                poll.due = Some(now + poll.every);
                self.may_poll = false;
                return Some(poll.task);
            }
        }
        if now < self.next_pair(wanted, acknowledged) {
            return None;
        }
        self.pair_at = now;
        self.must_repeat = false;
        self.is_half = true;
        Some(Task::RunOne)
    }

    pub(super) fn stop_both(&mut self, now: Monotonic) {
        self.is_half = false;
        self.may_poll = true;
        self.must_repeat = false;
        self.pair_at = now;
    }

    /// The last exchange failed: both motors get their commands again.
    pub(super) fn repeat(&mut self, now: Monotonic) {
        self.is_half = false;
        self.must_repeat = true;
        self.pair_at = now;
    }

    pub(super) fn postpone_counts(&mut self, now: Monotonic) {
        for poll in &mut self.polls {
            if matches!(poll.task, Task::CountOne | Task::CountTwo) {
                poll.due = Some(now + COUNTS_RETRY);
            }
        }
    }

    /// No question delays a stop, or the repetition of what has failed.
    fn may_ask(&self, wanted: [Power; 2], acknowledged: [Option<Power>; 2]) -> bool {
        let is_stop = wanted == [Power::ZERO; 2];
        self.may_poll && !self.must_repeat && (acknowledged == wanted.map(Some) || !is_stop)
    }

    fn next_pair(&self, wanted: [Power; 2], acknowledged: [Option<Power>; 2]) -> Monotonic {
        let is_acknowledged = acknowledged == wanted.map(Some);
        let pause = if is_acknowledged && !self.must_repeat {
            REPEAT
        } else {
            MIN_PAUSE
        };
        self.pair_at + pause
    }

    /// When there is something to send, while `wanted` stays as it is.
    pub(super) fn deadline(
        &self,
        wanted: [Power; 2],
        acknowledged: [Option<Power>; 2],
    ) -> Monotonic {
        if self.is_half {
            return self.pair_at;
        }
        let next_pair = self.next_pair(wanted, acknowledged);
        if !self.may_ask(wanted, acknowledged) {
            return next_pair;
        }
        let polls = self.polls.iter().filter_map(|poll| poll.due);
        polls.fold(next_pair, Monotonic::min)
    }
}

#[cfg(test)]
mod tests;
