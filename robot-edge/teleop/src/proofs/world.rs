//! Three consoles and a network that loses, delays, duplicates and reorders; every step is checked.

use std::time::Duration;

use super::invariants::{Monitor, Transition, Violation};
use super::{GOAL, ROLES, caller, millis};
use crate::arbiter::{ArbiterState, Mode, step};
use crate::command_stream::DriveCommand;
use crate::config::Rules;
use crate::interface::{Action, ArbiterEvent, ArbiterInput, CollisionMonitorOutput, LeaseVerb};
use crate::lease::{EStopId, OperatorId, StoredEStop};
use crate::motion::Velocity;
use crate::token::AgeToken;
use measurement::time::Monotonic;

/// What happens to a command on its way.
#[derive(Clone, Copy, Debug)]
pub(super) enum Fate {
    Arrives,
    Twice,
    Lost,
    /// Waits for so many rounds, so that later ones pass it.
    Late(u8),
}

/// One move of operators, network and hardware.
#[derive(Clone, Debug)]
pub(super) enum Move {
    /// Rounds of the loop in which open consoles send what is pressed.
    Rounds {
        count: u8,
        millis: u8,
        fate: Fate,
    },
    /// The link stalls for so many rounds of 20 ms, then delivers everything.
    Stall(u8),
    /// The loop itself is late, by milliseconds.
    Pause(u16),
    Stick {
        who: u8,
        requested: Velocity,
    },
    /// A console names a goal from now on, or none.
    Goal {
        who: u8,
        is_named: bool,
    },
    /// What the planner sends in each round, if anything.
    Planner(Option<Velocity>),
    /// A velocity of the planner that arrived so many milliseconds ago.
    Planned {
        velocity: Velocity,
        millis_ago: u16,
    },
    /// Opens a console, or freezes it.
    Open {
        who: u8,
        is_open: bool,
    },
    Lease {
        who: u8,
        verb: LeaseVerb,
        tokens_ago: u8,
    },
    Stored {
        is_right: bool,
    },
    Reset {
        who: u8,
        is_right: bool,
        tokens_ago: u8,
    },
    /// The output of the collision monitor from now on; absent if it gives none.
    CollisionMonitor(Option<CollisionMonitorOutput>),
    Forge(Forged),
    /// A command that was sent before, once more.
    Replay(u8),
    /// To a vehicle that is driven by operator 0.
    StartDriving,
    /// To one that a planner drives to a goal of operator 0.
    StartGoal,
    Input(ArbiterInput),
}

/// A command that no honest console sends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forged {
    pub(super) who: u8,
    pub(super) epochs_ago: u8,
    pub(super) seq_offset: i8,
    pub(super) tokens_ago: u8,
    pub(super) nonce_is_right: bool,
    pub(super) requested: Velocity,
    pub(super) estop: bool,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Console {
    pub(super) is_open: bool,
    /// So many tokens are younger than the newest one that it has.
    pub(super) tokens_ago: u8,
    pub(super) requested: Velocity,
    names_goal: bool,
    epoch: u64,
    seq: u64,
}

pub(super) struct World {
    rules: Rules,
    pub(super) state: ArbiterState,
    now: Monotonic,
    monitor: Monitor,
    pub(super) consoles: [Console; 3],
    tokens: Vec<AgeToken>,
    sent: Vec<DriveCommand>,
    in_flight: Vec<(u8, DriveCommand)>,
    is_stalled: bool,
    planner: Option<Velocity>,
    collision_monitor: Option<CollisionMonitorOutput>,
    ages: Vec<(Monotonic, Duration)>,
    /// Everything the vehicle did: compared between runs.
    pub(super) outputs: Vec<Velocity>,
    /// Rounds in which the vehicle was driven: shows that sequences get somewhere.
    pub(super) driven: usize,
    /// Those of them in which a planner moved it.
    pub(super) planned: usize,
}

impl World {
    /// A world in which `epoch` grants of the lease and `seq` commands have been before.
    pub(super) fn new(rules: Rules, start: Monotonic, epoch: u64, seq: u64) -> Self {
        let mut state = ArbiterState::new(0xb007);
        state.lease.epoch = epoch;
        let monitor = Monitor {
            epoch,
            ..Monitor::default()
        };
        let console = Console {
            is_open: true,
            tokens_ago: 0,
            requested: Velocity::ZERO,
            names_goal: false,
            epoch,
            seq,
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
            planner: None,
            collision_monitor: Some(CollisionMonitorOutput::Off),
            ages: Vec::new(),
            outputs: Vec::new(),
            driven: 0,
            planned: 0,
        }
    }

    pub(super) fn make(&mut self, one: &Move) -> Result<(), Violation> {
        match *one {
            Move::Rounds {
                count,
                millis,
                fate,
            } => return self.rounds(count, millis, fate),
            Move::Stall(rounds) => {
                self.is_stalled = true;
                self.rounds(rounds, 20, Fate::Late(0))?;
                self.is_stalled = false;
                return self.deliver();
            }
            Move::Pause(pause) => {
                self.now = self.now + millis(pause.into());
                return self.happen(ArbiterInput::Tick);
            }
            Move::Stick { who, requested } => self.consoles[usize::from(who)].requested = requested,
            Move::Goal { who, is_named } => self.consoles[usize::from(who)].names_goal = is_named,
            Move::Planner(velocity) => self.planner = velocity,
            Move::Planned {
                velocity,
                millis_ago,
            } => {
                let before = self.now.since(Monotonic::default());
                let arrived =
                    Monotonic::default() + before.saturating_sub(millis(millis_ago.into()));
                return self.happen(ArbiterInput::Planned { velocity, arrived });
            }
            Move::Open { who, is_open } => self.consoles[usize::from(who)].is_open = is_open,
            Move::Lease {
                who,
                verb,
                tokens_ago,
            } => {
                return self.happen(ArbiterInput::Lease {
                    caller: caller(who),
                    token: self.token(tokens_ago),
                    verb,
                });
            }
            Move::Stored { is_right } => {
                let id = self.estop_id(is_right);
                return self.happen(ArbiterInput::EStopStored(id));
            }
            Move::Reset {
                who,
                is_right,
                tokens_ago,
            } => {
                return self.happen(ArbiterInput::Reset {
                    caller: caller(who),
                    token: self.token(tokens_ago),
                    id: self.estop_id(is_right),
                });
            }
            Move::CollisionMonitor(output) => self.collision_monitor = output,
            Move::Forge(forged) => return self.forge(forged),
            Move::Replay(number) => {
                if let Some(last) = self.sent.len().checked_sub(1) {
                    return self.receive(self.sent[usize::from(number).min(last)]);
                }
            }
            Move::StartDriving => return self.start_driving(),
            Move::StartGoal => return self.start_goal(),
            Move::Input(input) => return self.happen(input),
        }
        Ok(())
    }

    fn start_driving(&mut self) -> Result<(), Violation> {
        self.start_holding()?;
        self.consoles[0].requested.linear_mps = 0.8;
        self.rounds(10, 20, Fate::Arrives)
    }

    fn start_goal(&mut self) -> Result<(), Violation> {
        self.start_holding()?;
        self.consoles[0].names_goal = true;
        self.planner = Some(Velocity::new(0.8, 0.1));
        self.rounds(10, 20, Fate::Arrives)
    }

    /// Operator 0 has the lease, and a press would count.
    fn start_holding(&mut self) -> Result<(), Violation> {
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
        self.make(&Move::Lease {
            who: 0,
            verb: LeaseVerb::Request,
            tokens_ago: 0,
        })?;
        self.consoles[0].is_open = true;
        self.consoles[0].requested = Velocity::ZERO;
        self.consoles[0].names_goal = false;
        self.rounds(12, 20, Fate::Arrives)
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
            if let Some(velocity) = self.planner {
                let arrived = self.now;
                self.happen(ArbiterInput::Planned { velocity, arrived })?;
            }
            if let Some(output) = self.collision_monitor {
                self.happen(ArbiterInput::CollisionMonitor(output))?;
            }
            self.happen(ArbiterInput::Tick)?;
        }
        Ok(())
    }

    fn send(&mut self, fate: Fate) {
        for number in 0..self.consoles.len() {
            let token = self.token(self.consoles[number].tokens_ago);
            let console = &mut self.consoles[number];
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
                docking: None,
                goal: console.names_goal.then_some(GOAL),
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

    fn forge(&mut self, forged: Forged) -> Result<(), Violation> {
        let Forged {
            who,
            requested,
            estop,
            ..
        } = forged;
        let mut token = self.token(forged.tokens_ago);
        token.nonce ^= u64::from(!forged.nonce_is_right);
        let console = self.consoles[usize::from(who)];
        self.receive(DriveCommand {
            operator: OperatorId(who.into()),
            epoch: self
                .state
                .lease
                .epoch
                .wrapping_sub(forged.epochs_ago.into()),
            seq: console.seq.saturating_add_signed(forged.seq_offset.into()),
            token,
            requested,
            estop,
            docking: None,
            goal: console.names_goal.then_some(GOAL),
        })
    }

    fn happen(&mut self, input: ArbiterInput) -> Result<(), Violation> {
        let before = self.state;
        let (after, actions) = step(&self.rules, before, self.now, input);
        self.monitor.observe(&Transition {
            rules: &self.rules,
            before: &before,
            now: self.now,
            input,
            after: &after,
            actions: &actions,
        })?;
        self.state = after;
        for action in actions.iter() {
            if let Action::PublishToken(token) = action {
                self.tokens.push(token);
            }
            if let Action::Notify(ArbiterEvent::LeaseGranted { to, epoch, .. }) = action {
                self.consoles[to.0 as usize].epoch = epoch;
            }
        }
        self.check_latency_travel(&before, input, actions.output)?;
        self.outputs.push(actions.output);
        let is_driven = after.mode() == Mode::Driving && input == ArbiterInput::Tick;
        self.driven += usize::from(is_driven);
        self.planned +=
            usize::from(is_driven && after.goal.is_some() && actions.output != Velocity::ZERO);
        Ok(())
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
        self.ages
            .retain(|(then, _)| self.now.since(*then) <= Duration::from_secs(1));
        let ages = self.ages.iter().map(|(_, age)| *age);
        let greatest = ages.max().unwrap_or_default();
        let allowed = self.rules.max_latency_travel_m / greatest.max(millis(1)).as_secs_f64();
        let dt = before
            .last_tick
            .map_or(Duration::ZERO, |last| self.now.since(last));
        let was = before.motion.velocity();
        for (was, is) in [
            (was.linear_mps, output.linear_mps),
            (was.lateral_mps, output.lateral_mps),
        ] {
            let braked = was.abs() - self.rules.limits.linear.stop_decel * dt.as_secs_f64();
            if is.abs() > allowed.max(braked) + 1e-9 {
                return Err("P1: faster than the age of commands allows");
            }
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
