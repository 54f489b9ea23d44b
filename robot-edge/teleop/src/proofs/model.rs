//! Every sequence of events, on a small network: two operators, a supervisor among them, and a stranger.
//!
//! Time goes in steps of 100 ms, of which the age limit, the neutral time and the time for recovery take two each and
//! the lease three; from full speed the vehicle stops within four. Nothing the arbiter decides depends on the time, the
//! epoch or the sequence number itself, only on differences (a property test says so), and all that is older than every
//! limit is alike. So a state of the model is the arbiter's *relative to the present* ([`small`]), of which there are
//! finitely many, and the search ends by itself.
//!
//! The network holds a few commands at once; each is delivered, delivered and kept (a duplicate), or lost, in any
//! order, at any time later. A console stamps a command with any of the latest tokens and with the present epoch or an
//! earlier one, so that tokens and grants are delayed as well. Requests are made at any time, with a young or an old
//! token. The same monitor that watches the random sequences watches every transition.

mod acts;
mod small;

use protocol::message::{FaultReason, LeaseEnd, StopReason};
use stateright::{Checker as _, Model, Property};

use self::acts::Act;
use self::small::{Message, Pressed, Small, UNIT};
use super::monitor::Violation;
use super::world::caller;
use crate::arbiter::{Mode, step};
use crate::command_stream::ArmingState;
use crate::command_stream::DriveCommand;
use crate::config::Rules;
use crate::input::CollisionMonitorOutput;
use crate::input::{ArbiterInput, LeaseVerb};
use crate::lease::{OperatorId, Role};
use crate::motion::AxisLimits;

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
    /// Faults, revocations and self-tests that fail happen, and the guard is blind at times.
    has_faults: bool,
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
        linear: axis,
        angular: axis,
        is_boat: false,
        request_timeout: 2 * UNIT,
    }
}

impl Scope {
    /// What follows from `input` in the state `small`, apart from the network.
    fn apply(small: &mut Small, inputs: &[ArbiterInput], passed: bool) {
        let (mut state, mut monitor) = small.lift();
        let mut now = small::present();
        if passed {
            now = now + UNIT;
        }
        let rules = rules();
        for input in inputs {
            let before = state;
            let (after, actions) = step(&rules, before, now, *input);
            let outcome = monitor.observe(&rules, &before, now, *input, &after, &actions);
            small.violation = small.violation.or(outcome.err());
            state = after;
        }
        small.lower(&state, &monitor, passed);
    }

    /// Whatever a stranger does, nothing changes: commands in their own name with the present epoch and the newest
    /// token, requests of every kind.
    fn strangers_effect(small: &Small) -> Option<Violation> {
        let (who, token) = (caller(STRANGER), small::token(0));
        let command = |operator, estop| ArbiterInput::Command {
            role: Role::Observer,
            command: DriveCommand {
                operator,
                epoch: small::EPOCH,
                seq: u64::MAX,
                token,
                requested: Pressed::Key.velocity(),
                estop,
            },
        };
        let lease = |verb| ArbiterInput::Lease {
            caller: who,
            token,
            verb,
        };
        let id = small::ESTOP;
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

impl Model for Scope {
    type State = Small;
    type Action = Act;

    fn init_states(&self) -> Vec<Small> {
        vec![Small::at_boot()]
    }

    fn actions(&self, state: &Small, actions: &mut Vec<Act>) {
        self.push_acts(state, actions);
    }

    fn next_state(&self, last: &Small, action: Act) -> Option<Small> {
        let mut next = last.clone();
        match action {
            Act::Tick {
                monitor_is_available,
            } => {
                next.violation = Self::strangers_effect(last);
                let output = if monitor_is_available {
                    CollisionMonitorOutput::Off
                } else {
                    CollisionMonitorOutput::Stale
                };
                let inputs = [
                    ArbiterInput::Token { nonce: 0 },
                    ArbiterInput::CollisionMonitor(output),
                    ArbiterInput::Tick,
                ];
                Self::apply(&mut next, &inputs, true);
            }
            Act::Send {
                who,
                epochs_ago,
                token,
                pressed,
            } => {
                next.send(who, epochs_ago, token, pressed);
            }
            Act::Deliver { index, is_kept } => {
                let message = next.network[index];
                if !is_kept {
                    next.network.remove(index);
                }
                Self::apply(&mut next, &[input_of(message)], false);
            }
            Act::Lose { index } => {
                next.network.remove(index);
                Self::apply(&mut next, &[], false);
            }
            Act::Lease { who, verb, token } => {
                let (caller, token) = (caller(who), small::token(token));
                let input = ArbiterInput::Lease {
                    caller,
                    token,
                    verb,
                };
                Self::apply(&mut next, &[input], false);
            }
            Act::Reset { who, id, token } => {
                let (caller, token) = (caller(who), small::token(token));
                Self::apply(
                    &mut next,
                    &[ArbiterInput::Reset { caller, token, id }],
                    false,
                );
            }
            Act::Other(input) => Self::apply(&mut next, &[input], false),
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
            Property::sometimes("somebody drives", |_, state: &Small| {
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
        if self.has_faults {
            properties.push(Property::sometimes(
                "the motors fail",
                |_, state: &Small| state.mode == Mode::Fault(FaultReason::Actuator),
            ));
        }
        properties
    }
}

fn input_of(message: Message) -> ArbiterInput {
    ArbiterInput::Command {
        role: caller(message.who).role,
        command: DriveCommand {
            operator: OperatorId(message.who.into()),
            epoch: message.epoch,
            seq: message.seq,
            token: small::token(message.token),
            requested: message.pressed.velocity(),
            estop: false,
        },
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
    });
}

#[test]
fn two_operators_and_a_stranger() {
    check(Scope {
        capacity: 1,
        operators: 2,
        has_estop: false,
        has_faults: false,
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
    });
}
