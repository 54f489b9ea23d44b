//! Every sequence of inputs, on a small network: two operators, a supervisor among them, and a stranger.
//!
//! Time goes in steps of 100 ms, of which the age limit, the neutral time and the time to resume take two each and the
//! lease three; from full speed the vehicle stops within four. Nothing the arbiter decides depends on the time, the epoch
//! or the sequence number itself, only on differences (a property test says so), and all that is older than every limit
//! is alike. So a state of the model is the arbiter's *relative to the present* ([`Small`]), of which there are finitely
//! many, and the search ends by itself.
//!
//! The network holds a few commands at once; each is delivered, delivered and kept (a duplicate), or lost, in any order, at any
//! time later. A console stamps a command with any of the latest tokens and with the present epoch or an earlier one, so that tokens
//! and grants are delayed as well. Requests come at any time, with a young or an old token. Invariants hold for every transition.

use std::hash::{Hash, Hasher};
use std::time::Duration;

use protocol::message::{FaultReason, LeaseEnd, StopReason};
use stateright::{Checker as _, Model, Property};

use super::invariants::{InForce, Latched, Monitor, Transition, Violation};
use super::permission::{GoalInForce, Permission};
use super::{GOAL, caller, millis};
use crate::arbiter::{ArbiterState, Mode, RunningGoal, step};
use crate::command_stream::{ArmingState, DriveCommand};
use crate::config::{PlannerRules, Rules};
use crate::interface::{ArbiterInput, CollisionMonitorOutput, LeaseVerb};
use crate::lease::{EStop, EStopId, Lease, LeaseHolder, OperatorId, Role, StoredEStop, Waiting};
use crate::locomotion::{Locomotion, LocomotionConfig, LocomotionMode};
use crate::motion::{AxisLimits, MotionLimits, Velocity};
use crate::token::{AgeToken, TokenRing};
use measurement::time::Monotonic;

/// Operators 0 and 1 may drive; 1 is a supervisor; 2 is a stranger.
const STRANGER: u8 = 2;

/// Full speed, micrometres per second: four steps of the stopping ramp.
const FULL_UM: i64 = 400_000;

/// How much of the world is in the model.
#[derive(Clone, Copy)]
struct Scope {
    /// Most commands on their way at once.
    capacity: usize,
    /// Operators who act.
    operators: u8,
    /// Emergency stops and their resets happen.
    has_estop: bool,
    /// Faults, revocations and self-tests that fail happen, and the collision monitor is stale at times.
    has_faults: bool,
    /// Consoles name goals, and there is a planner.
    has_goals: bool,
}

fn rules() -> Rules {
    let axis = AxisLimits {
        speed: FULL_UM as f64 / 1e6,
        accel: 1e3,
        jerk: 1e12,
        stop_decel: 1.0,
    };
    Rules {
        max_age: 2 * UNIT,
        lease: 3 * UNIT,
        neutral: 2 * UNIT,
        // No limit: the age of commands is to decide only whether they count.
        max_latency_travel_m: 1e9,
        limits: MotionLimits {
            linear: axis,
            angular: axis,
        },
        locomotion: Locomotion::new(&LocomotionConfig::default()),
        is_boat: false,
        request_timeout: 2 * UNIT,
        planner: Some(PlannerRules {
            max_gap: UNIT,
            planning_time: 2 * UNIT,
        }),
    }
}

impl Scope {
    /// Applies `inputs` in the state `small`, a step later if time has `passed`.
    fn apply(small: &mut Small, inputs: &[ArbiterInput], passed: bool) {
        let (mut state, mut monitor) = small.lift();
        let now = if passed { PRESENT + UNIT } else { PRESENT };
        let rules = rules();
        for input in inputs {
            let before = state;
            let (after, actions) = step(&rules, before, now, *input);
            let outcome = monitor.observe(&Transition {
                rules: &rules,
                before: &before,
                now,
                input: *input,
                after: &after,
                actions: &actions,
            });
            small.violation = small.violation.or(outcome.err());
            state = after;
        }
        small.lower(&state, &monitor, passed);
    }

    /// Whatever a stranger does, nothing changes: commands in their own name with the present epoch and the newest
    /// token, requests of every kind.
    fn strangers_effect(small: &Small) -> Option<Violation> {
        let (who, token) = (caller(STRANGER), token(0));
        let command = |operator, estop| ArbiterInput::Command {
            role: Role::Observer,
            command: DriveCommand {
                operator,
                epoch: EPOCH,
                seq: u64::MAX,
                token,
                requested: Pressed::Key.velocity(),
                estop,
                docking: None,
                goal: None,
            },
        };
        let lease = |verb| ArbiterInput::Lease {
            caller: who,
            token,
            verb,
        };
        let id = ESTOP;
        let inputs = [
            command(who.operator, false),
            command(who.operator, true),
            // Somebody who looks on with the number of who drives.
            command(OperatorId(0), false),
            ArbiterInput::EStop(who),
            ArbiterInput::Reset {
                caller: who,
                token,
                id,
            },
            lease(LeaseVerb::Request),
            lease(LeaseVerb::TakeOver),
            lease(LeaseVerb::Release),
            lease(LeaseVerb::HandOver { to: who.operator }),
            lease(LeaseVerb::Refuse { whom: who.operator }),
        ];
        inputs.into_iter().find_map(|input| {
            let mut after = small.clone();
            Self::apply(&mut after, &[input], false);
            let is_same = after == *small;
            after
                .violation
                .or((!is_same).then_some("a stranger has an effect"))
        })
    }
}

/// What can happen next in the model.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Act {
    /// A step of time passes, with this output of the collision monitor.
    Tick(CollisionMonitorOutput),
    /// A console sends a command.
    Send(Message),
    Deliver {
        index: usize,
        is_kept: bool,
    },
    Lose {
        index: usize,
    },
    /// A request, or anything else that is one input by itself.
    Input(ArbiterInput),
}

impl Scope {
    fn push_commands(&self, who: u8, acts: &mut Vec<Act>) {
        let mut send = |epoch, token, pressed| {
            acts.push(Act::Send(Message {
                who,
                epoch,
                seq: u64::MAX,
                token,
                pressed,
            }));
        };
        for token in 0..TOKENS {
            for pressed in [Pressed::Nothing, Pressed::Key] {
                for epochs_ago in 0..2 {
                    send(EPOCH - epochs_ago, token, pressed);
                }
            }
        }
        if self.has_goals {
            for token in 0..TOKENS {
                send(EPOCH, token, Pressed::Goal);
            }
        }
        if self.has_faults {
            send(EPOCH, 0, Pressed::Nonsense);
        }
    }

    fn push_requests(&self, who: u8, acts: &mut Vec<Act>) {
        let caller = caller(who);
        let other = OperatorId(u32::from(1 - who));
        for steps in [0, TOKENS - 1] {
            for verb in [
                LeaseVerb::Request,
                LeaseVerb::Release,
                LeaseVerb::TakeOver,
                LeaseVerb::HandOver { to: other },
                LeaseVerb::Refuse { whom: other },
            ] {
                acts.push(Act::Input(ArbiterInput::Lease {
                    caller,
                    token: token(steps),
                    verb,
                }));
            }
        }
        if self.has_estop {
            // One with a command of no worth otherwise, one with a request.
            acts.push(Act::Input(if who == 0 {
                ArbiterInput::Command {
                    role: Role::Operator,
                    command: DriveCommand {
                        operator: OperatorId(0),
                        epoch: u64::MAX,
                        seq: 0,
                        token: token(TOKENS - 1),
                        requested: Velocity::ZERO,
                        estop: true,
                        docking: None,
                        goal: None,
                    },
                }
            } else {
                ArbiterInput::EStop(caller)
            }));
            for (id, steps) in [(0, 0), (1, 0), (1, 1), (1, TOKENS - 1)] {
                acts.push(Act::Input(ArbiterInput::Reset {
                    caller,
                    token: token(steps),
                    id: EStopId(id),
                }));
            }
        }
    }

    fn push_others(&self, acts: &mut Vec<Act>) {
        let tested = |has_passed, stored| ArbiterInput::SelfTest { has_passed, stored };
        let mut inputs = vec![tested(true, StoredEStop::None)];
        if self.has_estop {
            inputs.extend([
                tested(true, StoredEStop::Latched(ESTOP)),
                tested(true, StoredEStop::Unreadable),
                ArbiterInput::EStopStored(ESTOP),
                ArbiterInput::EStopStored(EStopId(0)),
                ArbiterInput::LocalReset,
            ]);
        }
        if self.has_faults {
            inputs.extend([
                tested(false, StoredEStop::None),
                ArbiterInput::ActuatorFault,
                ArbiterInput::MotorsHeld,
                ArbiterInput::LocalReset,
                ArbiterInput::Revoked(OperatorId(0)),
                ArbiterInput::Revoked(OperatorId(1)),
            ]);
        }
        if self.has_goals {
            inputs.push(ArbiterInput::PlannerFloods);
            let speeds = [Pressed::Nothing, Pressed::Key, Pressed::Nonsense];
            inputs.extend(speeds.iter().flat_map(|speed| {
                let velocity = speed.velocity();
                [0, 1, 2].map(|steps| ArbiterInput::Planned {
                    velocity,
                    arrived: ago(steps),
                })
            }));
        }
        acts.extend(inputs.into_iter().map(Act::Input));
    }
}

impl Model for Scope {
    type State = Small;
    type Action = Act;

    fn init_states(&self) -> Vec<Small> {
        vec![Small::at_boot()]
    }

    fn actions(&self, state: &Small, acts: &mut Vec<Act>) {
        if state.violation.is_some() {
            return;
        }
        acts.push(Act::Tick(CollisionMonitorOutput::Off));
        if self.has_faults {
            acts.push(Act::Tick(CollisionMonitorOutput::Stale));
        }
        let others = state.network.len();
        for index in 0..others {
            for is_kept in [false, true] {
                acts.push(Act::Deliver { index, is_kept });
            }
            acts.push(Act::Lose { index });
        }
        for who in 0..self.operators {
            if others < self.capacity {
                self.push_commands(who, acts);
            }
            self.push_requests(who, acts);
        }
        self.push_others(acts);
    }

    fn next_state(&self, last: &Small, act: Act) -> Option<Small> {
        let mut next = last.clone();
        match act {
            Act::Tick(output) => {
                next.violation = Self::strangers_effect(last);
                let inputs = [
                    ArbiterInput::Token { nonce: 0 },
                    ArbiterInput::CollisionMonitor(output),
                    ArbiterInput::Tick,
                ];
                Self::apply(&mut next, &inputs, true);
            }
            Act::Send(message) => next.send(message),
            Act::Deliver { index, is_kept } => {
                let input = next.network[index].input();
                if !is_kept {
                    next.network.remove(index);
                }
                Self::apply(&mut next, &[input], false);
            }
            Act::Lose { index } => {
                next.network.remove(index);
                Self::apply(&mut next, &[], false);
            }
            Act::Input(input) => Self::apply(&mut next, &[input], false),
        }
        (next != *last).then_some(next)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        let mut properties = vec![
            Property::always("P1 to P9", |_, state: &Small| state.violation.is_none()),
            Property::always("the state is all there is", |_, state: &Small| {
                let mut same = state.clone();
                Self::apply(&mut same, &[], false);
                same == *state
            }),
            Property::sometimes("the vehicle is driven", |_, state: &Small| {
                state.mode == Mode::Driving && state.speed_um == FULL_UM
            }),
            Property::sometimes("a stop for age is taken back", |_, state: &Small| {
                state.mode == Mode::Driving && (1..FULL_UM).contains(&state.speed_um)
            }),
            Property::sometimes("a press is kept for standstill", |_, state: &Small| {
                state.stopping().is_some() && state.arming == ArmingState::Pressed
            }),
        ];
        if self.operators > 1 {
            properties.push(Property::sometimes(
                "a lease is taken over",
                |_, state: &Small| {
                    state.stopping() == Some(StopReason::LeaseEnded(LeaseEnd::TakenOver))
                        && state.speed_um > 0
                },
            ));
            properties.push(Property::sometimes(
                "a lease is handed over",
                |_, state: &Small| {
                    state.stopping() == Some(StopReason::LeaseEnded(LeaseEnd::HandedOver))
                },
            ));
        }
        if self.has_estop {
            properties.push(Property::sometimes(
                "an emergency stop is stored",
                |_, state: &Small| {
                    state.mode == Mode::EStop && state.estop.is_some_and(|estop| estop.is_stored)
                },
            ));
        }
        if self.has_goals {
            properties.push(Property::sometimes(
                "a planner drives",
                |_, state: &Small| state.goal.is_some() && state.speed_um == FULL_UM,
            ));
            properties.push(Property::sometimes(
                "a planner falls silent",
                |_, state: &Small| {
                    state.stopping() == Some(StopReason::PlannerSilent) && state.speed_um > 0
                },
            ));
        }
        if self.has_faults {
            properties.push(Property::sometimes(
                "the motors fail",
                |_, state: &Small| state.mode == Mode::Fault(FaultReason::Actuator),
            ));
        }
        properties
    }
}

/// A step of time.
const UNIT: Duration = millis(100);

/// Tokens that are distinguished by their age in steps: the last one is too old.
const TOKENS: u8 = 4;

/// What the present epoch, and the emergency stop in force or last in force, are called.
const EPOCH: u64 = 1;
const ESTOP: EStopId = EStopId(1);

/// Older than every limit by this many steps, moments are alike.
const HORIZON: u32 = 5;
const BOOT: u128 = 0xb007;
const PRESENT: Monotonic = Monotonic::from_nanos(1_000_000_000_000);

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
enum Pressed {
    Nothing,
    Key,
    /// Not a number.
    Nonsense,
    /// Nothing, and a goal is named.
    Goal,
}

impl Pressed {
    const fn velocity(self) -> Velocity {
        let linear_mps = match self {
            Self::Nothing | Self::Goal => 0.0,
            Self::Key => 1.0,
            Self::Nonsense => f64::NAN,
        };
        Velocity {
            linear_mps,
            lateral_mps: 0.0,
            angular_radps: 0.0,
        }
    }
}

/// A command on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
struct Message {
    who: u8,
    /// [`EPOCH`], or 0 for any earlier.
    epoch: u64,
    /// Its rank among those on their way; 0 where it cannot matter any more.
    seq: u64,
    /// Age in steps, at most [`TOKENS`]` - 1`.
    token: u8,
    pressed: Pressed,
}

impl Message {
    fn input(self) -> ArbiterInput {
        let sender = caller(self.who);
        ArbiterInput::Command {
            role: sender.role,
            command: DriveCommand {
                operator: sender.operator,
                epoch: self.epoch,
                seq: self.seq,
                token: token(self.token),
                requested: self.pressed.velocity(),
                estop: false,
                docking: None,
                goal: (self.pressed == Pressed::Goal).then_some(GOAL),
            },
        }
    }
}

/// The arbiter and the memory of the invariants relative to the present, and what is on its way.
#[derive(Clone, Debug, PartialEq)]
struct Small {
    mode: Mode,
    lease: Lease,
    last_seq: Option<u64>,
    issued: Option<Monotonic>,
    is_pressed: bool,
    arming: ArmingState,
    goal: Option<RunningGoal>,
    /// Micrometres per second.
    speed_um: i64,
    monitor_is_available: bool,
    estop: Option<EStop>,
    monitor: Monitor,
    network: Vec<Message>,
    violation: Option<Violation>,
}

fn ago(steps: u32) -> Monotonic {
    Monotonic::default()
        + PRESENT
            .since(Monotonic::default())
            .saturating_sub(steps * UNIT)
}

impl Hash for Small {
    fn hash<H: Hasher>(&self, hasher: &mut H) {
        (self.mode, self.lease, self.last_seq, self.issued).hash(hasher);
        (self.is_pressed, self.arming, self.speed_um, self.estop).hash(hasher);
        (self.goal, self.monitor_is_available).hash(hasher);
        (&self.network, self.violation).hash(hasher);
        let Monitor {
            holder,
            renewed,
            last_seq,
            in_force,
            permission,
            requested_at,
            estop,
            is_booted,
            has_fault,
            ..
        } = self.monitor;
        (holder, renewed, last_seq, in_force, permission).hash(hasher);
        (requested_at, estop, is_booted, has_fault).hash(hasher);
    }
}

/// The token that was issued so many steps ago.
fn token(steps: u8) -> AgeToken {
    AgeToken {
        boot_id: BOOT,
        n: u64::from(TOKENS - 1 - steps),
        nonce: 0,
    }
}

impl Small {
    fn at_boot() -> Self {
        let state = ArbiterState::new(BOOT);
        let mut small = Self {
            mode: state.mode,
            lease: state.lease,
            last_seq: None,
            issued: None,
            is_pressed: false,
            arming: ArmingState::Locked,
            goal: None,
            speed_um: 0,
            monitor_is_available: false,
            estop: None,
            monitor: Monitor::default(),
            network: Vec::new(),
            violation: None,
        };
        small.lower(&state, &Monitor::default(), false);
        small
    }

    const fn stopping(&self) -> Option<StopReason> {
        if let Mode::Stopping { reason, .. } = self.mode {
            Some(reason)
        } else {
            None
        }
    }

    /// The arbiter and its monitor at the present.
    fn lift(&self) -> (ArbiterState, Monitor) {
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
        state.now = PRESENT;
        state.last_tick = Some(PRESENT);
        state.tokens = tokens;
        state.lease = self.lease;
        state.stream.last_seq = self.last_seq;
        state.stream.issued = self.issued;
        state.stream.arming = self.arming;
        state.goal = self.goal;
        if self.is_pressed {
            state.stream.requested = Pressed::Key.velocity();
        }
        state.motion.linear.speed = self.speed_um as f64 / 1e6;
        state.locomotion = Some(LocomotionMode::Differential);
        state.collision_monitor = Some((collision_monitor, PRESENT));
        state.estop = self.estop;
        state.last_estop = ESTOP;
        let monitor = Monitor {
            collision_monitor: state.collision_monitor,
            last_tick: state.last_tick,
            ..self.monitor
        };
        (state, monitor)
    }

    /// Takes the arbiter and its monitor over, relative to their present; where time has `passed`, by a step.
    fn lower(&mut self, state: &ArbiterState, monitor: &Monitor, passed: bool) {
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
            store_requested: PRESENT,
        };
        let last_seq = state.stream.last_seq.map(|_| 0);
        if monitor.last_seq != state.stream.last_seq || monitor.epoch != state.lease.epoch {
            self.violation
                .get_or_insert("P4: another sequence number is remembered");
        }
        self.mode = state.mode;
        if let Mode::Stopping { since, .. } = &mut self.mode {
            *since = at(*since);
        }
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
        self.arming = state.stream.arming;
        if let ArmingState::Neutral { since } = &mut self.arming {
            *since = at(*since);
        }
        self.goal = state.goal.map(|goal| RunningGoal {
            pose: goal.pose,
            started: at(goal.started),
            received: goal.received.map(at),
        });
        self.speed_um = (state.motion.linear.speed * 1e6).round() as i64;
        self.monitor_is_available = matches!(
            state.collision_monitor,
            Some((CollisionMonitorOutput::Off, _))
        );
        self.estop = state.estop.map(relative_estop);
        self.monitor = Monitor {
            epoch: EPOCH,
            // A renewal matters only to a holder.
            renewed: monitor.holder.map_or(ago(0), |_| at(monitor.renewed)),
            last_seq,
            in_force: monitor.in_force.map(|last| InForce {
                issued: at(last.issued),
                ..last
            }),
            permission: Permission {
                lost: monitor.permission.lost.map(at),
                neutral_since: monitor.permission.neutral_since.map(at),
                goal: monitor.permission.goal.map(|goal| GoalInForce {
                    started: at(goal.started),
                    received: goal.received.map(at),
                }),
                ..monitor.permission
            },
            estop: monitor.estop.map(|estop| Latched {
                id: ESTOP,
                requested_at: at(estop.requested_at),
                ..estop
            }),
            collision_monitor: None,
            last_tick: None,
            accel: [Velocity::ZERO; 2],
            ..*monitor
        };
    }

    fn send(&mut self, message: Message) {
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

fn check(scope: Scope) {
    let checker = scope.checker().threads(2).spawn_bfs().join();
    println!(
        "{} states, {} unique, depth {}",
        checker.state_count(),
        checker.unique_state_count(),
        checker.max_depth()
    );
    checker.assert_properties();
}

/// The properties of one operator's commands, on a network that holds two of them.
#[test]
fn one_operator_on_a_network_that_reorders() {
    check(Scope {
        capacity: 2,
        operators: 1,
        has_estop: false,
        has_faults: false,
        has_goals: false,
    });
}

/// Goals of one operator, and a planner whose velocities arrive late, too, and are no numbers at times.
#[test]
fn goals_and_a_planner() {
    check(Scope {
        capacity: 1,
        operators: 1,
        has_estop: false,
        has_faults: false,
        has_goals: true,
    });
}

#[test]
#[ignore = "minutes, in release: cargo test --release --lib in_release -- --ignored --nocapture"]
fn goals_with_everything_of_one_operator_in_release() {
    check(Scope {
        capacity: 1,
        operators: 1,
        has_estop: true,
        has_faults: true,
        has_goals: true,
    });
}

#[test]
fn two_operators_and_a_stranger() {
    check(Scope {
        capacity: 1,
        operators: 2,
        has_estop: false,
        has_faults: false,
        has_goals: false,
    });
}

#[test]
#[ignore = "minutes, in release: cargo test --release --lib in_release -- --ignored --nocapture"]
fn everything_at_once_in_release() {
    check(Scope {
        capacity: 1,
        operators: 2,
        has_estop: true,
        has_faults: true,
        has_goals: false,
    });
}

#[test]
#[ignore = "minutes, in release: cargo test --release --lib in_release -- --ignored --nocapture"]
fn two_operators_on_a_network_that_reorders_in_release() {
    check(Scope {
        capacity: 2,
        operators: 2,
        has_estop: false,
        has_faults: false,
        has_goals: false,
    });
}
