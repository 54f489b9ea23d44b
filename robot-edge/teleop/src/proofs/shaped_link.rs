//! P12: a live operator on the shaped link does get to drive, without involuntary stops.
//!
//! The link of "Teleop": 75 ms one way with jitter of 20 ms and 2 % loss each way, tokens and commands at 50 Hz.
//! Nothing is sent twice here, though every change of input would be: the figures are those of the worse case.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use super::world::caller;
use crate::action::{Action, Actions, ArbiterEvent};
use crate::arbiter::{ArbiterState, Mode, step};
use crate::command_stream::DriveCommand;
use crate::config::{Rules, TeleopConfig};
use crate::input::CollisionMonitorOutput;
use crate::input::{ArbiterInput, LeaseVerb};
use crate::lease::StoredEStop;
use crate::lease::{OperatorId, Role};
use crate::motion::Velocity;
use crate::token::AgeToken;
use mapping::vehicle::VehicleConfig;
use measurement::time::Monotonic;

/// Lengths in milliseconds.
const ONE_WAY: u64 = 75;
const JITTER: u64 = 20;
const ROUND: u64 = 20;
const LOST_PER_MILLE: u64 = 20;

/// What is on its way, with the millisecond of its arrival.
struct Way<T> {
    random: ChaCha8Rng,
    in_flight: Vec<(u64, T)>,
}

impl<T> Way<T> {
    fn new(seed: u64) -> Self {
        Self {
            random: ChaCha8Rng::seed_from_u64(seed),
            in_flight: Vec::new(),
        }
    }

    fn send(&mut self, now_ms: u64, what: T) {
        let mut below = |limit: u64| self.random.next_u64() % limit;
        let delay = ONE_WAY - JITTER + below(2 * JITTER + 1);
        if below(1000) >= LOST_PER_MILLE {
            self.in_flight.push((now_ms + delay, what));
        }
    }

    fn arrived(&mut self, now_ms: u64) -> Vec<T> {
        let due = self
            .in_flight
            .extract_if(.., |(arrival, _)| *arrival <= now_ms);
        due.map(|(_, what)| what).collect()
    }
}

struct Drive {
    rules: Rules,
    state: ArbiterState,
    epoch: u64,
    newest: Option<AgeToken>,
    tokens: Way<AgeToken>,
    commands: Way<DriveCommand>,
    seq: u64,
    /// Milliseconds with something pressed, and of those, with the vehicle being driven.
    pressed_ms: u64,
    driven_ms: u64,
    travelled_m: f64,
}

impl Drive {
    fn new(rules: Rules) -> Self {
        Self {
            rules,
            state: ArbiterState::new(1),
            epoch: 0,
            newest: None,
            tokens: Way::new(1),
            commands: Way::new(2),
            seq: 0,
            pressed_ms: 0,
            driven_ms: 0,
            travelled_m: 0.0,
        }
    }

    fn happen(&mut self, now_ms: u64, input: ArbiterInput) -> Actions {
        let now = Monotonic::from_nanos(now_ms * 1_000_000);
        let (state, actions) = step(&self.rules, self.state, now, input);
        self.state = state;
        for action in actions.iter() {
            if let Action::PublishToken(token) = action {
                self.tokens.send(now_ms, token);
            }
            if let Action::Notify(ArbiterEvent::LeaseGranted { epoch, .. }) = action {
                self.epoch = epoch;
            }
        }
        actions
    }

    /// One millisecond of the edge's loop and of a console whose operator presses forward, or nothing.
    fn pass(&mut self, now_ms: u64, is_pressed: bool) {
        self.happen(
            now_ms,
            ArbiterInput::CollisionMonitor(CollisionMonitorOutput::Off),
        );
        let commands = self.commands.arrived(now_ms);
        let is_round = now_ms.is_multiple_of(ROUND);
        if is_round {
            self.happen(now_ms, ArbiterInput::Token { nonce: now_ms });
        }
        let wakes = is_round || !commands.is_empty();
        for command in commands {
            let role = Role::Operator;
            self.happen(now_ms, ArbiterInput::Command { role, command });
        }
        if wakes {
            self.happen(now_ms, ArbiterInput::Tick);
        }
        for token in self.tokens.arrived(now_ms) {
            if self.newest.is_none_or(|newest| newest.n < token.n) {
                self.newest = Some(token);
            }
        }
        if let Some(token) = self.newest
            && now_ms % ROUND == 7
        {
            self.seq += 1;
            let linear_mps = if is_pressed { 1.0 } else { 0.0 };
            self.commands.send(
                now_ms,
                DriveCommand {
                    operator: OperatorId(0),
                    epoch: self.epoch,
                    seq: self.seq,
                    token,
                    requested: Velocity {
                        linear_mps,
                        angular_radps: 0.0,
                    },
                    estop: false,
                },
            );
        }
        self.pressed_ms += u64::from(is_pressed);
        self.driven_ms += u64::from(is_pressed && self.state.mode() == Mode::Driving);
        self.travelled_m += self.state.motion.velocity().linear_mps / 1000.0;
    }
}

/// Presses for 9 s of every 10 s, for `minutes`.
fn drive(max_command_age_ms: u32, minutes: u64) -> Drive {
    let teleop = TeleopConfig {
        max_command_age_ms,
        ..TeleopConfig::default()
    };
    let mut drive = Drive::new(Rules::new(&teleop, &VehicleConfig::default()).unwrap());
    let stored = StoredEStop::None;
    drive.happen(
        0,
        ArbiterInput::SelfTest {
            has_passed: true,
            stored,
        },
    );
    for now_ms in 1..=minutes * 60_000 {
        drive.pass(now_ms, now_ms % 10_000 >= 1000);
        if now_ms == 200 {
            drive.happen(
                now_ms,
                ArbiterInput::Lease {
                    caller: caller(0),
                    token: drive.newest.unwrap(),
                    verb: LeaseVerb::Request,
                },
            );
        }
    }
    drive
}

#[test]
fn a_live_operator_drives_without_involuntary_stops() {
    let minutes = 10;
    let drive = drive(400, minutes);
    let report = drive.state.report(
        &drive.rules,
        Monotonic::from_nanos(minutes * 60_000_000_000),
    );
    let stops = report.counters.involuntary_stops;
    println!(
        "{stops} involuntary stops in {minutes} minutes, driven {} of {} ms, {:.0} m, greatest age {:?}, refused as too late: {}",
        drive.driven_ms,
        drive.pressed_ms,
        drive.travelled_m,
        report.peak_age,
        report
            .counters
            .refused(protocol::message::Refusal::OldSequence),
    );
    assert!(
        stops <= minutes,
        "{stops} involuntary stops in {minutes} minutes"
    );
    // What is missing is the way of the press over the link, ten times a minute.
    assert!(drive.driven_ms as f64 > 0.98 * drive.pressed_ms as f64);
    // 0.15 m per greatest age of the last second, which is about 0.2 s.
    let mean_mps = drive.travelled_m / (minutes as f64 * 60.0);
    assert!((0.45..0.8).contains(&mean_mps), "{mean_mps} m/s");
}

#[test]
fn an_age_limit_below_the_link_s_own_delay_never_drives() {
    let drive = drive(100, 1);
    assert_eq!(drive.driven_ms, 0);
    assert!(drive.travelled_m.abs() < 1e-12);
}
