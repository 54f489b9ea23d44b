//! The state of the model: the arbiter and its monitor relative to the present, and what is on its way.

use std::time::Duration;

use crate::arbiter::{ArbiterState, Mode};
use crate::command_stream::ArmingState;
use crate::input::CollisionMonitorOutput;
use crate::lease::OperatorId;
use crate::lease::{EStop, EStopId};
use crate::lease::{Lease, LeaseHolder, Waiting};
use crate::motion::Velocity;
use crate::proofs::licence::Licence;
use crate::proofs::millis;
use crate::proofs::monitor::{InForce, Latched, Monitor, Violation};
use crate::token::{AgeToken, TokenRing};
use measurement::time::Monotonic;
use protocol::message::StopReason;

/// A step of time.
pub(super) const UNIT: Duration = millis(100);

/// Tokens that are told apart, by their age in steps: the last one is too old.
pub(super) const TOKENS: u8 = 4;

/// What the present epoch, and the emergency stop in force or last in force, are called.
pub(super) const EPOCH: u64 = 1;
pub(super) const ESTOP: EStopId = EStopId(1);

/// Older than every limit by this many steps, moments are alike.
const HORIZON: u32 = 5;
const BOOT: u128 = 0xb007;
const PRESENT: u64 = 1000;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Pressed {
    Nothing,
    Key,
    /// Not a number.
    Nonsense,
}

impl Pressed {
    pub(super) const fn velocity(self) -> Velocity {
        let linear_mps = match self {
            Self::Nothing => 0.0,
            Self::Key => 1.0,
            Self::Nonsense => f64::NAN,
        };
        Velocity {
            linear_mps,
            angular_radps: 0.0,
        }
    }
}

/// A command on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct Message {
    pub(super) who: u8,
    /// [`EPOCH`], or 0 for any earlier.
    pub(super) epoch: u64,
    /// Its rank among those on their way; 0 where it cannot matter any more.
    pub(super) seq: u64,
    /// Age in steps, at most [`TOKENS`]` - 1`.
    pub(super) token: u8,
    pub(super) pressed: Pressed,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Small {
    pub(super) mode: Mode,
    lease: Lease,
    last_seq: Option<u64>,
    issued: Option<Monotonic>,
    is_pressed: bool,
    pub(super) arming: ArmingState,
    /// Micrometres per second.
    pub(super) speed_um: i64,
    monitor_is_available: bool,
    pub(super) estop: Option<EStop>,
    watched: Watched,
    pub(super) network: Vec<Message>,
    pub(super) violation: Option<Violation>,
}

/// The monitor's memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Watched {
    holder: Option<OperatorId>,
    renewed: Monotonic,
    last_seq: Option<u64>,
    in_force: Option<InForce>,
    licence: Licence,
    requested_at: u32,
    estop: Option<Latched>,
    is_booted: bool,
    has_fault: bool,
}

pub(super) fn present() -> Monotonic {
    Monotonic::default() + millis(PRESENT * 1000)
}

fn ago(steps: u32) -> Monotonic {
    Monotonic::default() + millis(PRESENT * 1000).saturating_sub(steps * UNIT)
}

/// The token that was issued so many steps ago.
pub(super) fn token(steps: u8) -> AgeToken {
    AgeToken {
        boot_id: BOOT,
        n: u64::from(TOKENS - 1 - steps),
        nonce: 0,
    }
}

impl Small {
    pub(super) fn at_boot() -> Self {
        let (state, monitor) = (ArbiterState::new(BOOT), Monitor::new());
        let mut small = Self {
            mode: state.mode,
            lease: state.lease,
            last_seq: None,
            issued: None,
            is_pressed: false,
            arming: ArmingState::Locked,
            speed_um: 0,
            monitor_is_available: false,
            estop: None,
            watched: Watched {
                holder: None,
                renewed: Monotonic::default(),
                last_seq: None,
                in_force: None,
                licence: Licence::default(),
                requested_at: 0,
                estop: None,
                is_booted: false,
                has_fault: false,
            },
            network: Vec::new(),
            violation: None,
        };
        small.lower(&state, &monitor, false);
        small
    }

    pub(super) const fn stopping(&self) -> Option<StopReason> {
        match self.mode {
            Mode::Stopping { reason, .. } => Some(reason),
            Mode::SafeBoot
            | Mode::Idle
            | Mode::Held
            | Mode::Driving
            | Mode::EStop
            | Mode::Fault(_) => None,
        }
    }

    /// The arbiter and its monitor at the present.
    pub(super) fn lift(&self) -> (ArbiterState, Monitor) {
        let mut tokens = TokenRing::new(BOOT);
        for steps in (0..TOKENS).rev() {
            tokens.issue(ago(steps.into()), 0);
        }
        let mut state = ArbiterState::new(BOOT);
        let collision_monitor = if self.monitor_is_available {
            CollisionMonitorOutput::Off
        } else {
            CollisionMonitorOutput::Stale
        };
        state.mode = self.mode;
        state.now = present();
        state.last_tick = Some(present());
        state.tokens = tokens;
        state.lease = self.lease;
        state.stream.last_seq = self.last_seq;
        state.stream.issued = self.issued;
        state.stream.arming = self.arming;
        if self.is_pressed {
            state.stream.requested = Pressed::Key.velocity();
        }
        state.motion.linear.speed = self.speed_um as f64 / 1e6;
        state.collision_monitor = Some((collision_monitor, present()));
        state.estop = self.estop;
        state.last_estop = ESTOP;
        let watched = &self.watched;
        let monitor = Monitor {
            epoch: self.lease.epoch,
            holder: watched.holder,
            renewed: watched.renewed,
            last_seq: watched.last_seq,
            in_force: watched.in_force,
            licence: watched.licence,
            requested_at: watched.requested_at,
            estop: watched.estop,
            is_booted: watched.is_booted,
            has_fault: watched.has_fault,
            collision_monitor: state.collision_monitor,
            last_tick: state.last_tick,
            accel: Velocity::ZERO,
        };
        (state, monitor)
    }

    /// Takes the arbiter and its monitor over, relative to their present; where time has `passed`, by a step.
    pub(super) fn lower(&mut self, state: &ArbiterState, monitor: &Monitor, passed: bool) {
        let now = state.now;
        let at = |then: Monotonic| {
            let steps = now.since(then).as_nanos() / UNIT.as_nanos();
            ago(steps.min(HORIZON.into()) as u32)
        };
        let relative_estop = |estop: EStop| EStop {
            id: ESTOP,
            is_stored: estop.is_stored,
            last_requested: at(estop.last_requested),
            // When it is given to be stored again changes nothing.
            store_requested: present(),
        };
        let last_seq = state.stream.last_seq.map(|_| 0);
        if monitor.last_seq != state.stream.last_seq || monitor.epoch != state.lease.epoch {
            self.violation
                .get_or_insert("P4: another sequence number is remembered");
        }
        self.mode = match state.mode {
            Mode::Stopping { reason, since } => Mode::Stopping {
                reason,
                since: at(since),
            },
            mode @ (Mode::SafeBoot
            | Mode::Idle
            | Mode::Held
            | Mode::Driving
            | Mode::EStop
            | Mode::Fault(_)) => mode,
        };
        self.lease = Lease {
            epoch: EPOCH,
            holder: state.lease.holder.map(|holder| LeaseHolder {
                renewed: at(holder.renewed),
                ..holder
            }),
            next: state.lease.next,
            waiting: state.lease.waiting.map(|waiting| Waiting {
                requested_at: at(waiting.requested_at),
                ..waiting
            }),
        };
        self.rename(state.lease.epoch, state.stream.last_seq, passed);
        self.last_seq = last_seq;
        self.issued = state.stream.issued.map(at);
        self.is_pressed = !state.stream.requested.is_neutral();
        self.arming = match state.stream.arming {
            ArmingState::Neutral { since } => ArmingState::Neutral { since: at(since) },
            arming @ (ArmingState::Locked | ArmingState::Pressed) => arming,
        };
        self.speed_um = (state.motion.linear.speed * 1e6).round() as i64;
        self.monitor_is_available = matches!(
            state.collision_monitor,
            Some((CollisionMonitorOutput::Off, _))
        );
        self.estop = state.estop.map(relative_estop);
        let mut licence = monitor.licence;
        licence.lost = licence.lost.map(at);
        licence.neutral_since = licence.neutral_since.map(at);
        self.watched = Watched {
            holder: monitor.holder,
            // Nobody's renewal matters where nobody holds the lease.
            renewed: monitor.holder.map_or(ago(0), |_| at(monitor.renewed)),
            last_seq,
            in_force: monitor.in_force.map(|last| InForce {
                issued: at(last.issued),
                ..last
            }),
            licence,
            requested_at: monitor.requested_at,
            estop: monitor.estop.map(|estop| Latched {
                id: ESTOP,
                requested_at: at(estop.requested_at),
                ..estop
            }),
            is_booted: monitor.is_booted,
            has_fault: monitor.has_fault,
        };
    }

    pub(super) fn send(&mut self, who: u8, epochs_ago: u64, token: u8, pressed: Pressed) {
        let message = Message {
            who,
            epoch: EPOCH - epochs_ago,
            seq: u64::MAX,
            token,
            pressed,
        };
        self.network.push(message);
        self.rename(EPOCH, self.last_seq, false);
    }

    /// Calls epochs, sequence numbers and tokens what they are relative to the present ones.
    fn rename(&mut self, epoch: u64, last_seq: Option<u64>, passed: bool) {
        let holder = self.lease.holder;
        for message in &mut self.network {
            message.epoch = u64::from(message.epoch == epoch);
            message.token = (message.token + u8::from(passed)).min(TOKENS - 1);
            let is_old = last_seq.is_some_and(|last| message.seq <= last);
            let is_holders =
                holder.is_some_and(|holder| holder.operator == OperatorId(message.who.into()));
            let matters = message.epoch == EPOCH && message.token < TOKENS - 1 && is_holders;
            if is_old || !matters {
                message.seq = 0;
            }
        }
        let mut seqs: Vec<u64> = self.network.iter().map(|message| message.seq).collect();
        seqs.push(0);
        seqs.sort_unstable();
        seqs.dedup();
        for message in &mut self.network {
            message.seq = seqs.partition_point(|seq| *seq < message.seq) as u64;
        }
        self.network.sort_unstable();
        self.network.dedup();
    }
}
