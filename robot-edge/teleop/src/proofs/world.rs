//! An arbiter, three consoles and a network that loses, delays, duplicates and reorders, watched by the monitor.

use std::time::Duration;

use super::millis;
use super::monitor::{Monitor, Violation};
use super::moves::{Fate, Move};
use crate::action::{Action, Actions, ArbiterEvent};
use crate::arbiter::{ArbiterState, Mode, step};
use crate::command_stream::DriveCommand;
use crate::config::Rules;
use crate::input::CollisionMonitorOutput;
use crate::input::{ArbiterInput, LeaseVerb};
use crate::lease::{Caller, OperatorId, RequestId, Role};
use crate::lease::{EStopId, StoredEStop};
use crate::motion::Velocity;
use crate::token::AgeToken;
use measurement::time::Monotonic;

#[derive(Clone, Copy, Debug)]
struct Console {
    is_open: bool,
    epoch: u64,
    seq: u64,
    requested: Velocity,
}

pub(super) struct World {
    pub(super) rules: Rules,
    pub(super) state: ArbiterState,
    pub(super) now: Monotonic,
    monitor: Monitor,
    consoles: [Console; 3],
    tokens: Vec<AgeToken>,
    sent: Vec<DriveCommand>,
    in_flight: Vec<(u8, DriveCommand)>,
    is_stalled: bool,
    collision_monitor: Option<CollisionMonitorOutput>,
    ages: Vec<(Monotonic, Duration)>,
    /// Everything the vehicle did: compared between runs.
    pub(super) outputs: Vec<Velocity>,
    /// Rounds in which the vehicle was driven: shows that sequences get somewhere.
    pub(super) driven: usize,
}

/// Operator, supervisor and a stranger who looks on.
const ROLES: [Role; 3] = [Role::Operator, Role::Supervisor, Role::Observer];

impl World {
    /// A world in which `epoch` grants of the lease and `seq` commands have been before.
    pub(super) fn new(rules: Rules, start: Monotonic, epoch: u64, seq: u64) -> Self {
        let mut state = ArbiterState::new(0xb007);
        state.lease.epoch = epoch;
        let mut monitor = Monitor::new();
        monitor.epoch = epoch;
        let console = Console {
            is_open: true,
            epoch,
            seq,
            requested: Velocity::ZERO,
        };
        Self {
            rules,
            state,
            now: start,
            monitor,
            consoles: [console; 3],
            tokens: Vec::new(),
            sent: Vec::new(),
            in_flight: Vec::new(),
            is_stalled: false,
            collision_monitor: Some(CollisionMonitorOutput::Off),
            ages: Vec::new(),
            outputs: Vec::new(),
            driven: 0,
        }
    }

    pub(super) fn make(&mut self, one: &Move) -> Result<(), Violation> {
        match *one {
            Move::Rounds {
                count,
                millis,
                fate,
            } => self.rounds(count, millis, fate),
            Move::Stall(rounds) => {
                self.is_stalled = true;
                self.rounds(rounds, 20, Fate::Late(0))?;
                self.is_stalled = false;
                self.deliver()
            }
            Move::Pause(pause) => {
                self.now = self.now + millis(pause.into());
                self.happen(ArbiterInput::Tick)
            }
            Move::Stick { who, requested } => {
                self.consoles[index(who)].requested = requested;
                Ok(())
            }
            Move::Open { who, is_open } => {
                self.consoles[index(who)].is_open = is_open;
                Ok(())
            }
            Move::Lease {
                who,
                verb,
                tokens_ago,
            } => {
                let (caller, token) = (caller(who), self.token(tokens_ago));
                self.happen(ArbiterInput::Lease {
                    caller,
                    token,
                    verb,
                })
            }
            Move::EStop { who } => self.happen(ArbiterInput::EStop(caller(who))),
            Move::LocalEStop => self.happen(ArbiterInput::LocalEStop),
            Move::Stored { is_right } => {
                let id = self.estop_id(is_right);
                self.happen(ArbiterInput::EStopStored(id))
            }
            Move::Reset {
                who,
                is_right,
                tokens_ago,
            } => {
                let (caller, token) = (caller(who), self.token(tokens_ago));
                let id = self.estop_id(is_right);
                self.happen(ArbiterInput::Reset { caller, token, id })
            }
            Move::LocalReset => self.happen(ArbiterInput::LocalReset),
            Move::SelfTest { has_passed, stored } => {
                self.happen(ArbiterInput::SelfTest { has_passed, stored })
            }
            Move::CollisionMonitor(output) => {
                self.collision_monitor = self.collision_monitor.map(|_| output);
                Ok(())
            }
            Move::MonitorResponds(speaks) => {
                self.collision_monitor = speaks.then_some(CollisionMonitorOutput::Off);
                Ok(())
            }
            Move::Fault => self.happen(ArbiterInput::ActuatorFault),
            Move::Revoke { who } => self.happen(ArbiterInput::Revoked(OperatorId(who.into()))),
            Move::Forge { .. } => self.forge(one),
            Move::Replay(number) => {
                let Some(len) = self.sent.len().checked_sub(1) else {
                    return Ok(());
                };
                let command = self.sent[usize::from(number).min(len)];
                self.receive(command)
            }
            Move::StartDriving => self.start_driving(),
        }
    }

    fn start_driving(&mut self) -> Result<(), Violation> {
        let stored = StoredEStop::None;
        for input in [
            ArbiterInput::LocalReset,
            ArbiterInput::SelfTest {
                has_passed: true,
                stored,
            },
            ArbiterInput::LocalReset,
        ] {
            self.happen(input)?;
        }
        self.collision_monitor = Some(CollisionMonitorOutput::Off);
        self.rounds(1, 20, Fate::Arrives)?;
        let token = self.token(0);
        self.happen(ArbiterInput::Lease {
            caller: caller(0),
            token,
            verb: LeaseVerb::Request,
        })?;
        self.consoles[0].is_open = true;
        self.consoles[0].requested = Velocity::ZERO;
        self.rounds(12, 20, Fate::Arrives)?;
        self.consoles[0].requested.linear_mps = 0.8;
        self.rounds(10, 20, Fate::Arrives)
    }

    pub(super) fn rounds(
        &mut self,
        count: u8,
        round_millis: u8,
        fate: Fate,
    ) -> Result<(), Violation> {
        for _ in 0..count {
            self.now = self.now + millis(round_millis.into());
            let nonce = self.tokens.len() as u64 * 7919;
            self.happen(ArbiterInput::Token { nonce })?;
            self.send(fate);
            if !self.is_stalled {
                self.deliver()?;
            }
            if let Some(output) = self.collision_monitor {
                self.happen(ArbiterInput::CollisionMonitor(output))?;
            }
            self.happen(ArbiterInput::Tick)?;
        }
        Ok(())
    }

    fn send(&mut self, fate: Fate) {
        let token = self.token(0);
        for (number, console) in self.consoles.iter_mut().enumerate() {
            if !console.is_open {
                continue;
            }
            console.seq += 1;
            let command = DriveCommand {
                operator: OperatorId(number as u32),
                epoch: console.epoch,
                seq: console.seq,
                token,
                requested: console.requested,
                estop: false,
            };
            self.sent.push(command);
            match fate {
                Fate::Arrives => self.in_flight.push((0, command)),
                Fate::Twice => self.in_flight.extend([(0, command), (3, command)]),
                Fate::Lost => {}
                Fate::Late(rounds) => self.in_flight.push((rounds, command)),
            }
        }
    }

    /// Everything that is due arrives; the rest comes a round nearer.
    fn deliver(&mut self) -> Result<(), Violation> {
        let due: Vec<_> = self
            .in_flight
            .extract_if(.., |(rounds, _)| *rounds == 0)
            .collect();
        for (rounds, _) in &mut self.in_flight {
            *rounds -= 1;
        }
        for (_, command) in due {
            self.receive(command)?;
        }
        Ok(())
    }

    fn receive(&mut self, command: DriveCommand) -> Result<(), Violation> {
        let role = ROLES[command.operator.0 as usize % ROLES.len()];
        self.happen(ArbiterInput::Command { role, command })
    }

    fn forge(&mut self, forged: &Move) -> Result<(), Violation> {
        let Move::Forge {
            who,
            epochs_ago,
            seq_offset,
            tokens_ago,
            nonce_is_right,
            requested,
            estop,
        } = *forged
        else {
            return Ok(());
        };
        let mut token = self.token(tokens_ago);
        token.nonce ^= u64::from(!nonce_is_right);
        let console = self.consoles[index(who)];
        self.receive(DriveCommand {
            operator: OperatorId(who.into()),
            epoch: self.state.lease.epoch.wrapping_sub(epochs_ago.into()),
            seq: console.seq.saturating_add_signed(seq_offset.into()),
            token,
            requested,
            estop,
        })
    }

    pub(super) fn happen(&mut self, input: ArbiterInput) -> Result<(), Violation> {
        let before = self.state;
        let (after, actions) = step(&self.rules, before, self.now, input);
        self.monitor
            .observe(&self.rules, &before, self.now, input, &after, &actions)?;
        self.state = after;
        self.listen(&actions);
        self.check_latency_travel(&before, input, actions.output)?;
        self.outputs.push(actions.output);
        self.driven += usize::from(after.mode() == Mode::Driving && input == ArbiterInput::Tick);
        Ok(())
    }

    fn listen(&mut self, actions: &Actions) {
        for action in actions.iter() {
            if let Action::PublishToken(token) = action {
                self.tokens.push(token);
            }
            if let Action::Notify(ArbiterEvent::LeaseGranted { to, epoch, .. }) = action {
                self.consoles[to.0 as usize].epoch = epoch;
            }
        }
    }

    /// The vehicle goes no farther than `max_latency_travel_m` within the greatest age of the last second.
    fn check_latency_travel(
        &mut self,
        before: &ArbiterState,
        input: ArbiterInput,
        output: Velocity,
    ) -> Result<(), Violation> {
        let Some(age) = self.state.stream.age(self.now) else {
            self.ages.clear();
            return Ok(());
        };
        self.ages.push((self.now, age.min(self.rules.max_age)));
        if input != ArbiterInput::Tick {
            return Ok(());
        }
        let second = Duration::from_secs(1);
        let recent = self
            .ages
            .iter()
            .filter(|(then, _)| self.now.since(*then) <= second);
        let greatest = recent.map(|(_, age)| *age).max().unwrap_or_default();
        let allowed = self.rules.max_latency_travel_m / greatest.max(millis(1)).as_secs_f64();
        let dt = before
            .last_tick
            .map_or(Duration::ZERO, |last| self.now.since(last));
        let was = before.motion.velocity().linear_mps.abs();
        let braked = was - self.rules.linear.stop_decel * dt.as_secs_f64();
        if output.linear_mps.abs() > allowed.max(braked) + 1e-9 {
            return Err("P1: faster than the age of commands allows");
        }
        Ok(())
    }

    fn token(&self, ago: u8) -> AgeToken {
        let unknown = AgeToken {
            boot_id: 0xb007,
            n: 0,
            nonce: 0,
        };
        let wanted = self.tokens.len().checked_sub(1 + usize::from(ago));
        wanted.map_or(unknown, |index| self.tokens[index])
    }

    fn estop_id(&self, is_right: bool) -> EStopId {
        let EStopId(id) = self.state.last_estop;
        EStopId(id.wrapping_sub(u64::from(!is_right)))
    }
}

pub(super) fn caller(who: u8) -> Caller {
    Caller {
        operator: OperatorId(who.into()),
        role: ROLES[index(who)],
        request: RequestId(0),
    }
}

fn index(who: u8) -> usize {
    usize::from(who) % ROLES.len()
}
