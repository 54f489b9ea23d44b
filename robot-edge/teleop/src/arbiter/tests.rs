//! The table of states by hand, an arrow a test; what must hold everywhere is in [`crate::proofs`].

mod driving;
mod emergency;
mod leases;
mod limits;

use std::time::Duration;

use super::*;
use crate::command_stream::DriveCommand;
use crate::config::TeleopConfig;
use crate::input::LeaseVerb;
use crate::lease::StoredEStop;
use crate::lease::{Caller, OperatorId, Role};
use crate::report::TeleopReport;
use crate::token::AgeToken;
use mapping::vehicle::VehicleConfig;
use protocol::message::{Answer, Refusal, StopReason};

const ALICE: OperatorId = OperatorId(1);
const BOB: OperatorId = OperatorId(2);
const CAROL: OperatorId = OperatorId(3);
const FORWARD: Velocity = Velocity {
    linear_mps: 0.3,
    angular_radps: 0.0,
};

/// A vehicle whose loop runs every 20 ms, and who sits at its consoles: Alice and Bob, operators; Carol, a supervisor.
struct Vehicle {
    rules: Rules,
    state: ArbiterState,
    now: Monotonic,
    /// The token that consoles have.
    token: AgeToken,
    seq: u64,
    collision_monitor: CollisionMonitorOutput,
    events: Vec<ArbiterEvent>,
    actions: Vec<Action>,
}

impl Vehicle {
    /// Just switched on.
    fn at_boot() -> Self {
        Self::with(&TeleopConfig::default())
    }

    fn with(teleop: &TeleopConfig) -> Self {
        let state = ArbiterState::new(7);
        let token = AgeToken {
            boot_id: 7,
            n: 0,
            nonce: 0,
        };
        let mut vehicle = Self {
            rules: Rules::new(teleop, &VehicleConfig::default()).unwrap(),
            state,
            now: Monotonic::from_nanos(1_000_000_000),
            token,
            seq: 0,
            collision_monitor: CollisionMonitorOutput::Off,
            events: Vec::new(),
            actions: Vec::new(),
        };
        vehicle.round();
        vehicle
    }

    /// Tested, and idle.
    fn idle() -> Self {
        let mut vehicle = Self::at_boot();
        vehicle.self_test(true, StoredEStop::None);
        vehicle
    }

    /// Alice holds the lease.
    fn held() -> Self {
        let mut vehicle = Self::idle();
        assert_eq!(vehicle.lease(ALICE, LeaseVerb::Request), Answer::Granted(1));
        vehicle
    }

    /// Alice drives, at the speed of [`FORWARD`].
    fn driving() -> Self {
        let mut vehicle = Self::held();
        vehicle.hold(Velocity::ZERO, 11);
        vehicle.hold(FORWARD, 60);
        assert_eq!(vehicle.state.mode, Mode::Driving);
        assert_eq!(vehicle.output(), FORWARD);
        vehicle
    }

    fn input(&mut self, input: ArbiterInput) {
        let (state, actions) = step(&self.rules, self.state, self.now, input);
        self.state = state;
        assert_eq!(actions.output, state.motion.velocity());
        self.actions = actions.iter().collect();
        for action in actions.iter() {
            if let Action::Notify(event) = action {
                self.events.push(event);
            }
            if let Action::PublishToken(token) = action {
                self.token = token;
            }
        }
    }

    fn pass(&mut self, millis: u64) {
        self.now = self.now + Duration::from_millis(millis);
    }

    /// 20 ms in which nobody sends anything.
    fn round(&mut self) {
        self.pass(20);
        self.input(ArbiterInput::Token { nonce: 3 });
        self.input(ArbiterInput::CollisionMonitor(self.collision_monitor));
        self.input(ArbiterInput::Tick);
    }

    fn silence(&mut self, millis: u64) {
        for _ in 0..millis / 20 {
            self.round();
        }
    }

    /// The next command of `operator`, with the newest token and epoch.
    fn command(&mut self, operator: OperatorId, requested: Velocity) -> DriveCommand {
        self.seq += 1;
        DriveCommand {
            operator,
            epoch: self.state.lease.epoch,
            seq: self.seq,
            token: self.token,
            requested,
            estop: false,
        }
    }

    fn send(&mut self, command: DriveCommand) {
        let role = Role::Operator;
        self.input(ArbiterInput::Command { role, command });
    }

    /// Alice's console sends this for so many rounds.
    fn hold(&mut self, requested: Velocity, rounds: usize) {
        for _ in 0..rounds {
            let command = self.command(ALICE, requested);
            self.send(command);
            self.round();
        }
    }

    fn answer(&self) -> Option<Answer> {
        self.actions.iter().find_map(|action| {
            if let Action::Answer { answer, .. } = action {
                Some(*answer)
            } else {
                None
            }
        })
    }

    fn lease(&mut self, operator: OperatorId, verb: LeaseVerb) -> Answer {
        let token = self.token;
        self.input(ArbiterInput::Lease {
            caller: caller(operator),
            token,
            verb,
        });
        self.answer().unwrap()
    }

    fn self_test(&mut self, has_passed: bool, stored: StoredEStop) {
        self.input(ArbiterInput::SelfTest { has_passed, stored });
    }

    fn reset(&mut self, operator: OperatorId, id: EStopId) -> Answer {
        let token = self.token;
        self.input(ArbiterInput::Reset {
            caller: caller(operator),
            token,
            id,
        });
        self.answer().unwrap()
    }

    fn report(&self) -> TeleopReport {
        self.state.report(&self.rules, self.now)
    }

    fn output(&self) -> Velocity {
        self.report().applied
    }

    fn holder(&self) -> Option<OperatorId> {
        self.state.lease.holder.map(|holder| holder.operator)
    }

    fn stopping(&self) -> Option<StopReason> {
        if let Mode::Stopping { reason, .. } = self.state.mode {
            Some(reason)
        } else {
            None
        }
    }

    fn refused(&self, refusal: Refusal) -> u64 {
        self.state.counters.refused(refusal)
    }
}

fn caller(operator: OperatorId) -> Caller {
    let role = if operator == CAROL {
        Role::Supervisor
    } else {
        Role::Operator
    };
    Caller {
        operator,
        role,
        request: RequestId(9),
    }
}
