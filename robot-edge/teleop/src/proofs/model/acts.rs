//! What can happen next in the model.

use super::Scope;
use super::small::{self, Pressed, Small, TOKENS};
use crate::command_stream::DriveCommand;
use crate::input::{ArbiterInput, LeaseVerb};
use crate::lease::{EStopId, StoredEStop};
use crate::lease::{OperatorId, Role};
use crate::motion::Velocity;
use crate::proofs::world::caller;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Act {
    /// A step of time passes.
    Tick {
        monitor_is_available: bool,
    },
    /// A console sends a command.
    Send {
        who: u8,
        epochs_ago: u64,
        token: u8,
        pressed: Pressed,
    },
    Deliver {
        index: usize,
        is_kept: bool,
    },
    Lose {
        index: usize,
    },
    Lease {
        who: u8,
        verb: LeaseVerb,
        token: u8,
    },
    Reset {
        who: u8,
        id: EStopId,
        token: u8,
    },
    /// Anything that is one event by itself.
    Other(ArbiterInput),
}

impl Scope {
    pub(super) fn push_acts(&self, state: &Small, actions: &mut Vec<Act>) {
        if state.violation.is_some() {
            return;
        }
        actions.push(Act::Tick {
            monitor_is_available: true,
        });
        if self.has_faults {
            actions.push(Act::Tick {
                monitor_is_available: false,
            });
        }
        let others = state.network.len();
        for index in 0..others {
            actions.push(Act::Deliver {
                index,
                is_kept: false,
            });
            actions.push(Act::Deliver {
                index,
                is_kept: true,
            });
            actions.push(Act::Lose { index });
        }
        for who in 0..self.operators {
            if others < self.capacity {
                self.push_commands(who, actions);
            }
            self.push_requests(who, actions);
        }
        self.push_others(actions);
    }

    fn push_commands(&self, who: u8, actions: &mut Vec<Act>) {
        for token in 0..TOKENS {
            for pressed in [Pressed::Nothing, Pressed::Key] {
                for epochs_ago in 0..2 {
                    actions.push(Act::Send {
                        who,
                        epochs_ago,
                        token,
                        pressed,
                    });
                }
            }
        }
        if self.has_faults {
            actions.push(Act::Send {
                who,
                epochs_ago: 0,
                token: 0,
                pressed: Pressed::Nonsense,
            });
        }
    }

    fn push_requests(&self, who: u8, actions: &mut Vec<Act>) {
        let other = OperatorId(u32::from(1 - who));
        for token in [0, TOKENS - 1] {
            for verb in [
                LeaseVerb::Request,
                LeaseVerb::Release,
                LeaseVerb::TakeOver,
                LeaseVerb::HandOver { to: other },
                LeaseVerb::Refuse { whom: other },
            ] {
                actions.push(Act::Lease { who, verb, token });
            }
        }
        if self.has_estop {
            // One with a command of no worth otherwise, one with a request.
            actions.push(Act::Other(if who == 0 {
                ArbiterInput::Command {
                    role: Role::Operator,
                    command: DriveCommand {
                        operator: OperatorId(0),
                        epoch: u64::MAX,
                        seq: 0,
                        token: small::token(TOKENS - 1),
                        requested: Velocity::ZERO,
                        estop: true,
                    },
                }
            } else {
                ArbiterInput::EStop(caller(who))
            }));
            for (id, token) in [(0, 0), (1, 0), (1, 1), (1, TOKENS - 1)] {
                let id = EStopId(id);
                actions.push(Act::Reset { who, id, token });
            }
        }
    }

    fn push_others(&self, actions: &mut Vec<Act>) {
        let tested = |has_passed, stored| Act::Other(ArbiterInput::SelfTest { has_passed, stored });
        actions.push(tested(true, StoredEStop::None));
        if self.has_estop {
            actions.push(tested(true, StoredEStop::Latched(small::ESTOP)));
            actions.push(tested(true, StoredEStop::Unreadable));
            for input in [
                ArbiterInput::EStopStored(small::ESTOP),
                ArbiterInput::EStopStored(EStopId(0)),
                ArbiterInput::LocalReset,
            ] {
                actions.push(Act::Other(input));
            }
        }
        if self.has_faults {
            actions.push(tested(false, StoredEStop::None));
            for input in [
                ArbiterInput::ActuatorFault,
                ArbiterInput::LocalReset,
                ArbiterInput::Revoked(OperatorId(0)),
                ArbiterInput::Revoked(OperatorId(1)),
            ] {
                actions.push(Act::Other(input));
            }
        }
    }
}
