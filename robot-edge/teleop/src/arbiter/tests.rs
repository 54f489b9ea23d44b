//! The table of states by hand; what must hold everywhere is in [`crate::proofs`].

mod goals;

use std::time::Duration;

use super::*;
use crate::config::TeleopConfig;
use crate::interface::{LeaseVerb, SpeedLimits};
use crate::lease::{Caller, GrantReason, OperatorId, StoredEStop};
use crate::locomotion::{LocomotionConfig, LocomotionModes};
use crate::report::TeleopReport;
use crate::token::AgeToken;
use mapping::vehicle::VehicleConfig;
use protocol::keys::OperatorTopic;
use protocol::message::Answer::{self, Done, Granted, Refused};
use protocol::message::TeleopState::{self, Driving, EStop, Fault, Held, Idle, SafeBoot, Stopping};
use protocol::message::{Arming, DockingChoice, Refusal, ShoreClass};

const ALICE: OperatorId = OperatorId(1);
const BOB: OperatorId = OperatorId(2);
const CAROL: OperatorId = OperatorId(3);
const NO_TOKEN: AgeToken = AgeToken {
    boot_id: 7,
    n: 0,
    nonce: 0,
};
const FORWARD: Velocity = Velocity::new(0.3, 0.0);

const A: Option<OperatorId> = Some(ALICE);
const FIRST: EStopId = EStopId(1);

#[derive(Clone, Copy)]
enum RoundStep {
    /// Alice's console sends no pressed key for so many rounds.
    Neutral(usize),
    /// It sends [`FORWARD`].
    Press(usize),
    /// Rounds without commands, milliseconds.
    Silence(u64),
    /// No round, milliseconds.
    Pass(u64),
    /// The output of the collision monitor from now on.
    Monitor(CollisionMonitorOutput),
    Lease(OperatorId, LeaseVerb, Answer),
    Reset(OperatorId, u64, Answer),
    Input(ArbiterInput),
}

use RoundStep::{Input, Lease as Ask, Monitor, Neutral, Pass, Press, Reset, Silence};

const fn tested(has_passed: bool, stored: StoredEStop) -> ArbiterInput {
    ArbiterInput::SelfTest { has_passed, stored }
}

const fn ended(why: LeaseEnd) -> TeleopState {
    Stopping(StopReason::LeaseEnded(why))
}

const RELEASED: TeleopState = Stopping(StopReason::Released);
const TOO_OLD: TeleopState = Stopping(StopReason::Age);
const STALE: TeleopState = Stopping(StopReason::CollisionMonitorStale);

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
        let mut vehicle = Self {
            rules: Rules::new(
                teleop,
                &VehicleConfig::default(),
                &LocomotionConfig::default(),
            )
            .unwrap(),
            state: ArbiterState::new(7),
            now: Monotonic::from_nanos(1_000_000_000),
            token: NO_TOKEN,
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
        vehicle.input(tested(true, StoredEStop::None));
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
            docking: None,
            goal: None,
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

    /// Takes these steps; after each the state and the holder must be as given, and the output zero where nobody drives.
    #[track_caller]
    fn run<const N: usize>(&mut self, steps: [(RoundStep, TeleopState, Option<OperatorId>); N]) {
        for (number, (step, state, holder)) in steps.into_iter().enumerate() {
            match step {
                RoundStep::Neutral(rounds) => self.hold(Velocity::ZERO, rounds),
                RoundStep::Press(rounds) => self.hold(FORWARD, rounds),
                RoundStep::Silence(millis) => self.silence(millis),
                RoundStep::Pass(millis) => self.pass(millis),
                RoundStep::Monitor(output) => self.collision_monitor = output,
                RoundStep::Lease(operator, verb, answer) => {
                    assert_eq!(self.lease(operator, verb), answer, "step {number}");
                }
                RoundStep::Reset(operator, id, answer) => {
                    assert_eq!(self.reset(operator, EStopId(id)), answer, "step {number}");
                }
                RoundStep::Input(input) => self.input(input),
            }
            let is = (self.state.mode.teleop_state(), self.holder());
            assert_eq!(is, (state, holder), "step {number}");
            let may_move = matches!(state, Driving | Stopping(_));
            assert!(may_move || self.output() == Velocity::ZERO, "step {number}");
        }
    }

    fn has_stored(&self, id: EStopId) -> bool {
        self.actions.contains(&Action::StoreEStop(id))
    }

    fn limit(&mut self, limits: SpeedLimits) {
        self.collision_monitor = CollisionMonitorOutput::Limits(limits);
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

#[test]
fn a_press_after_200_ms_of_neutral_drives() {
    Vehicle::held().run([(Neutral(11), Held, A), (Press(1), Driving, A)]);
    // A key that was pressed before the grant.
    let mut vehicle = Vehicle::held();
    vehicle.run([(Press(100), Held, A)]);
    assert_eq!(vehicle.report().arming, Arming::Locked);
    // The first neutral command at 0 ms, the last at 180 ms, the press at 199 ms.
    Vehicle::held().run([
        (Neutral(9), Held, A),
        (Pass(19), Held, A),
        (Press(5), Held, A),
    ]);
    // A gap of the age limit.
    Vehicle::held().run([
        (Neutral(1), Held, A),
        (Silence(440), Held, A),
        (Press(5), Held, A),
    ]);
}

#[test]
fn letting_go_stops_by_the_ramp_and_keeps_the_lease() {
    let mut vehicle = Vehicle::driving();
    vehicle.run([(Neutral(1), RELEASED, A)]);
    // 0.3 m/s at 1 m/s² are 15 rounds, of which one has passed.
    for round in 1..15 {
        let expected = 0.3 - 0.02 * f64::from(round);
        assert!((vehicle.output().linear_mps - expected).abs() < 1e-9);
        vehicle.hold(Velocity::ZERO, 1);
    }
    vehicle.run([(Pass(0), Held, A)]);
    assert_eq!(vehicle.report().counters.involuntary_stops, 0);
}

#[test]
fn pressing_again_drives_on_at_once_or_waits_for_standstill() {
    Vehicle::driving().run([(Neutral(2), RELEASED, A), (Press(1), Driving, A)]);
    let mut vehicle = Vehicle::driving();
    vehicle.run([(Neutral(12), RELEASED, A), (Press(1), RELEASED, A)]);
    assert_eq!(vehicle.report().arming, Arming::Pressed);
    vehicle.run([(Press(2), Held, A), (Press(1), Driving, A)]);
}

#[test]
fn the_output_falls_when_the_last_command_is_too_old() {
    let mut vehicle = Vehicle::driving();
    // The last token was issued two rounds ago: the console had the one of the round before its command.
    let issued = vehicle.now;
    let command = vehicle.command(ALICE, FORWARD);
    vehicle.send(command);
    while vehicle.state.mode == Mode::Driving {
        vehicle.round();
        // It may slow down before, because commands that grow old allow less speed.
        assert!(vehicle.now.since(issued) <= Duration::from_millis(420));
    }
    vehicle.run([(Pass(0), TOO_OLD, A)]);
    assert_eq!(vehicle.now.since(issued), Duration::from_millis(420));
    let stopped = vehicle.now;
    while vehicle.output() != Velocity::ZERO {
        vehicle.round();
    }
    assert_eq!(vehicle.now.since(stopped), Duration::from_millis(280));
    vehicle.run([(Pass(0), Held, A)]);
    assert_eq!(vehicle.report().counters.involuntary_stops, 1);
}

#[test]
fn commands_that_are_young_again_within_200_ms_take_the_stop_back() {
    for (silence_ms, is_taken_back) in [(160, true), (220, false)] {
        let mut vehicle = Vehicle::driving();
        vehicle.run([
            (Silence(420), TOO_OLD, A),
            (Silence(silence_ms), TOO_OLD, A),
        ]);
        assert!(vehicle.output().linear_mps > 0.0);
        if is_taken_back {
            vehicle.run([(Press(1), Driving, A)]);
        } else {
            vehicle.run([
                (Press(100), Held, A),
                (Neutral(11), Held, A),
                (Press(1), Driving, A),
            ]);
        }
    }
}

#[test]
fn a_stall_s_commands_move_nothing_when_they_arrive() {
    let mut vehicle = Vehicle::driving();
    let stalled = [(); 150].map(|()| {
        let command = vehicle.command(ALICE, FORWARD);
        vehicle.round();
        command
    });
    vehicle.run([(Pass(0), Idle, None)]);
    for command in stalled {
        vehicle.send(command);
        vehicle.input(ArbiterInput::Tick);
        assert_eq!(vehicle.output(), Velocity::ZERO);
    }
    // Tokens of more than 2 s ago are not even known, and those of the last 0.4 s are young, but nobody's.
    let refusals = [Refusal::UnknownToken, Refusal::TooOld, Refusal::NotHolder];
    let refused = refusals.map(|refusal| vehicle.refused(refusal));
    assert_eq!(refused.iter().sum::<u64>(), 150);
    assert_eq!(refused[2], 20);
}

#[test]
fn what_is_no_number_stops_the_vehicle() {
    for nonsense in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut vehicle = Vehicle::driving();
        let command = vehicle.command(ALICE, Velocity::new(0.3, nonsense));
        vehicle.send(command);
        let stopping = Stopping(StopReason::NotFinite);
        vehicle.run([(Pass(0), stopping, A), (Press(100), Held, A)]);
        assert_eq!(vehicle.refused(Refusal::NotFinite), 1);
    }
}

#[test]
fn commands_are_checked_in_the_order_of_their_cost() {
    let mut vehicle = Vehicle::driving();
    let right = vehicle.command(ALICE, FORWARD);
    let check = |role, command: DriveCommand, expected| {
        let now = vehicle.now;
        let is = vehicle.state.precheck(&vehicle.rules, now, role, &command);
        assert_eq!(is, expected);
    };
    let operator = Role::Operator;
    check(operator, right, Ok(Duration::ZERO));
    // Everything is wrong, and is put right one after the other.
    let mut command = DriveCommand {
        operator: BOB,
        epoch: 9,
        seq: 0,
        token: AgeToken {
            boot_id: 1,
            n: u64::MAX,
            nonce: 0,
        },
        ..right
    };
    check(Role::Observer, command, Err(Refusal::Role));
    check(operator, command, Err(Refusal::OtherBoot));
    command.token = AgeToken {
        n: 0,
        ..right.token
    };
    check(operator, command, Err(Refusal::TooOld));
    command.token = right.token;
    check(operator, command, Err(Refusal::NotHolder));
    command.operator = ALICE;
    check(operator, command, Err(Refusal::OtherEpoch));
    command.epoch = 1;
    for seq in [0, right.seq - 1] {
        command.seq = seq;
        check(operator, command, Err(Refusal::OldSequence));
    }
}

#[test]
fn what_was_refused_outside_is_counted() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::Rejected(Refusal::Signature));
    assert_eq!(vehicle.refused(Refusal::Signature), 1);
}

#[test]
fn time_does_not_go_back() {
    let mut vehicle = Vehicle::driving();
    let command = vehicle.command(ALICE, FORWARD);
    vehicle.silence(420);
    let now = std::mem::replace(&mut vehicle.now, Monotonic::from_nanos(0));
    vehicle.send(command);
    assert_eq!(vehicle.refused(Refusal::TooOld), 1);
    assert_eq!(vehicle.state.now, now);
}

#[test]
fn a_stop_that_is_over_within_one_step_says_why_it_was() {
    let mut vehicle = Vehicle::driving();
    vehicle.events.clear();
    // The process was suspended for longer than the lease lasts.
    vehicle.pass(5000);
    vehicle.run([(Input(ArbiterInput::Tick), Idle, None)]);
    let since = vehicle.now;
    let stopping = Mode::Stopping {
        reason: StopReason::Age,
        since,
    };
    let changed = |from, to| ArbiterEvent::ModeChanged { from, to };
    let is_change = |event: &&ArbiterEvent| matches!(event, ArbiterEvent::ModeChanged { .. });
    assert_eq!(
        vehicle.events.iter().filter(is_change).collect::<Vec<_>>(),
        [
            &changed(Mode::Driving, stopping),
            &changed(stopping, Mode::Idle)
        ]
    );
    assert!(vehicle.events.contains(&ArbiterEvent::LeaseEnded {
        operator: ALICE,
        why: LeaseEnd::Expired
    }));
}

#[test]
fn old_requests_and_onlookers_are_refused() {
    let not_ready = Refused(Refusal::NotReady);
    Vehicle::at_boot().run([(Ask(ALICE, LeaseVerb::Request, not_ready), SafeBoot, None)]);
    let mut vehicle = Vehicle::idle();
    let too_old = Refused(Refusal::TooOld);
    vehicle.run([
        (Pass(401), Idle, None),
        (Ask(ALICE, LeaseVerb::Request, too_old), Idle, None),
        (Silence(20), Idle, None),
    ]);
    let onlooker = Caller {
        role: Role::Observer,
        ..caller(ALICE)
    };
    let token = vehicle.token;
    for (input, request_kind) in [
        (
            ArbiterInput::Lease {
                caller: onlooker,
                token,
                verb: LeaseVerb::Request,
            },
            OperatorTopic::Lease,
        ),
        (ArbiterInput::EStop(onlooker), OperatorTopic::EStop),
    ] {
        vehicle.run([(Input(input), Idle, None)]);
        assert_eq!(vehicle.answer(), Some(Refused(Refusal::Role)));
        assert!(vehicle.events.contains(&ArbiterEvent::Refused {
            request_kind,
            caller: onlooker,
            refusal: Refusal::Role
        }));
    }
    Vehicle::driving().run([(Input(ArbiterInput::EStop(onlooker)), Driving, A)]);
}

#[test]
fn a_hand_over_happens_after_the_vehicle_has_stopped() {
    let mut vehicle = Vehicle::driving();
    let stopping = ended(LeaseEnd::HandedOver);
    let hand_over = |to| LeaseVerb::HandOver { to };
    vehicle.run([
        (Ask(BOB, LeaseVerb::Request, Answer::Waiting), Driving, A),
        (
            Ask(CAROL, LeaseVerb::Request, Refused(Refusal::Busy)),
            Driving,
            A,
        ),
        (
            Ask(ALICE, hand_over(CAROL), Refused(Refusal::NotWaiting)),
            Driving,
            A,
        ),
        (
            Ask(BOB, hand_over(BOB), Refused(Refusal::NotHolder)),
            Driving,
            A,
        ),
        (Ask(ALICE, hand_over(BOB), Done), stopping, None),
        (Press(14), stopping, None),
    ]);
    assert_eq!(vehicle.refused(Refusal::NotHolder), 15);
    vehicle.run([(Silence(20), Held, Some(BOB))]);
    for event in [
        ArbiterEvent::LeaseRequested { by: BOB },
        ArbiterEvent::LeaseGranted {
            to: BOB,
            epoch: 2,
            how: GrantReason::HandOver,
        },
    ] {
        assert!(vehicle.events.contains(&event), "{event:?}");
    }
}

#[test]
fn a_supervisor_takes_over_through_zero() {
    let mut vehicle = Vehicle::driving();
    let stopping = ended(LeaseEnd::TakenOver);
    vehicle.run([
        (
            Ask(BOB, LeaseVerb::TakeOver, Refused(Refusal::Role)),
            Driving,
            A,
        ),
        (
            Ask(CAROL, LeaseVerb::TakeOver, Answer::Waiting),
            stopping,
            None,
        ),
        (Silence(280), stopping, None),
        (Silence(20), Held, Some(CAROL)),
    ]);
    assert_eq!(vehicle.report().counters.involuntary_stops, 1);
}

#[test]
fn a_supervisor_takes_over_a_standing_vehicle_at_once() {
    let mut vehicle = Vehicle::held();
    vehicle.run([
        (Neutral(20), Held, A),
        (
            Ask(CAROL, LeaseVerb::TakeOver, Granted(2)),
            Held,
            Some(CAROL),
        ),
    ]);
    let ended = ArbiterEvent::LeaseEnded {
        operator: ALICE,
        why: LeaseEnd::TakenOver,
    };
    assert!(vehicle.events.contains(&ended));
    // Alice's neutral was hers alone.
    let command = vehicle.command(CAROL, FORWARD);
    vehicle.send(command);
    assert_eq!(vehicle.state.mode, Mode::Held);
}

#[test]
fn who_waits_gets_what_is_given_back_unless_they_leave_or_are_forgotten() {
    let request = (Ask(BOB, LeaseVerb::Request, Answer::Waiting), Held, A);
    let release = Ask(ALICE, LeaseVerb::Release, Done);
    Vehicle::held().run([request, (release, Held, Some(BOB))]);
    Vehicle::held().run([
        request,
        (Ask(BOB, LeaseVerb::Release, Done), Held, A),
        (
            Ask(BOB, LeaseVerb::Release, Refused(Refusal::NotHolder)),
            Held,
            A,
        ),
        (release, Idle, None),
    ]);
    let mut vehicle = Vehicle::held();
    vehicle.run([request, (Neutral(501), Held, A)]);
    assert_eq!(vehicle.report().lease.waiting, None);
    vehicle.run([(release, Idle, None)]);
    Vehicle::driving().run([
        (release, ended(LeaseEnd::Released), None),
        (Silence(300), Idle, None),
    ]);
}

#[test]
fn who_is_next_may_leave_it_to_who_waits() {
    let stopping = ended(LeaseEnd::TakenOver);
    let [take_over, leave] = [
        (LeaseVerb::TakeOver, Answer::Waiting),
        (LeaseVerb::Release, Done),
    ]
    .map(|(verb, answer)| (Ask(CAROL, verb, answer), stopping, None));
    Vehicle::driving().run([take_over, leave, (Silence(300), Idle, None)]);
    Vehicle::driving().run([
        (Ask(BOB, LeaseVerb::Request, Answer::Waiting), Driving, A),
        take_over,
        leave,
        (Silence(300), Held, Some(BOB)),
    ]);
}

#[test]
fn a_lease_that_nobody_renews_expires() {
    Vehicle::held().run([(Silence(2000), Held, A), (Silence(20), Idle, None)]);
    // The loop was suspended: one tick is past all limits at once.
    Vehicle::driving().run([
        (Pass(2001), Driving, A),
        (Input(ArbiterInput::Tick), Idle, None),
    ]);
}

#[test]
fn a_console_that_was_restarted_begins_anew() {
    let mut vehicle = Vehicle::driving();
    let old = vehicle.command(ALICE, FORWARD);
    let request = Ask(ALICE, LeaseVerb::Request, Answer::Waiting);
    vehicle.run([
        (request, ended(LeaseEnd::Renewed), None),
        (Silence(300), Held, A),
    ]);
    assert_eq!(vehicle.state.lease.epoch, 2);
    let token = vehicle.token;
    vehicle.send(DriveCommand { token, ..old });
    assert_eq!(vehicle.refused(Refusal::OtherEpoch), 1);
    // Its numbers start anew.
    vehicle.seq = 0;
    vehicle.run([(Neutral(11), Held, A), (Press(1), Driving, A)]);
}

#[test]
fn who_is_no_longer_an_operator_loses_the_lease() {
    let revoke = |operator| Input(ArbiterInput::Revoked(operator));
    Vehicle::driving().run([
        (revoke(BOB), Driving, A),
        (revoke(ALICE), ended(LeaseEnd::Revoked), None),
        (Silence(300), Idle, None),
    ]);
    // Nor is it granted to them at standstill.
    let released = ended(LeaseEnd::Released);
    Vehicle::driving().run([
        (Ask(BOB, LeaseVerb::Request, Answer::Waiting), Driving, A),
        (Ask(ALICE, LeaseVerb::Release, Done), released, None),
        (revoke(BOB), released, None),
        (Silence(300), Idle, None),
    ]);
}

#[test]
fn any_operator_stops_the_vehicle_at_once() {
    let mut vehicle = Vehicle::driving();
    let estop = Input(ArbiterInput::EStop(caller(BOB)));
    let stored = Input(ArbiterInput::EStopStored(FIRST));
    vehicle.run([(estop, EStop, A)]);
    assert!(vehicle.has_stored(FIRST));
    assert_eq!(vehicle.answer(), None, "not before it is stored");
    vehicle.run([(Press(10), EStop, A), (stored, EStop, A)]);
    assert!(vehicle.actions.contains(&Action::AcknowledgeEStop(FIRST)));
    vehicle.run([(estop, EStop, A)]);
    assert_eq!(vehicle.answer(), Some(Answer::EStopped(FIRST.0)));
    vehicle.run([(stored, EStop, A)]);
    assert_eq!(vehicle.actions, []);
}

#[test]
fn a_command_stops_it_whatever_else_is_wrong_with_it() {
    let mut vehicle = Vehicle::driving();
    let command = DriveCommand {
        epoch: 77,
        seq: 0,
        token: AgeToken {
            boot_id: 0,
            ..NO_TOKEN
        },
        estop: true,
        ..vehicle.command(BOB, FORWARD)
    };
    let send = |role| Input(ArbiterInput::Command { role, command });
    vehicle.run([
        (send(Role::Observer), Driving, A),
        (send(Role::Operator), EStop, A),
    ]);
}

#[test]
fn it_is_given_to_be_stored_until_it_is() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::LocalEStop);
    assert!(vehicle.has_stored(FIRST));
    let mut retries = 0;
    for _ in 0..150 {
        vehicle.round();
        retries += usize::from(vehicle.has_stored(FIRST));
    }
    assert_eq!(retries, 3);
    vehicle.input(ArbiterInput::EStopStored(FIRST));
    for _ in 0..150 {
        vehicle.round();
        assert_eq!(vehicle.actions, []);
    }
}

#[test]
fn a_reset_must_be_right_in_everything() {
    let mut vehicle = Vehicle::driving();
    let estop = (Input(ArbiterInput::EStop(caller(BOB))), EStop, A);
    let refused = |refusal| (Reset(CAROL, 1, Refused(refusal)), EStop, A);
    vehicle.run([
        (Reset(CAROL, 1, Refused(Refusal::NoEStop)), Driving, A),
        estop,
    ]);
    let before = vehicle.token;
    vehicle.run([
        (Silence(20), EStop, A),
        refused(Refusal::EStopNotStored),
        (Input(ArbiterInput::EStopStored(FIRST)), EStop, A),
        (Reset(BOB, 1, Refused(Refusal::NotHolder)), EStop, A),
    ]);
    assert!(matches!(
        vehicle.events.last(),
        Some(ArbiterEvent::Refused {
            request_kind: OperatorTopic::Reset,
            refusal: Refusal::NotHolder,
            ..
        })
    ));
    vehicle.run([(Reset(CAROL, 0, Refused(Refusal::OtherEStop)), EStop, A)]);
    let young = std::mem::replace(&mut vehicle.token, before);
    vehicle.run([refused(Refusal::EStopSince)]);
    vehicle.token = young;
    vehicle.run([
        estop,
        refused(Refusal::EStopSince),
        (Pass(401), EStop, A),
        refused(Refusal::TooOld),
        (Silence(20), EStop, A),
        (Reset(CAROL, 1, Done), Idle, None),
    ]);
    assert!(vehicle.actions.contains(&Action::ClearEStop(FIRST)));
    vehicle.run([(Reset(CAROL, 1, Refused(Refusal::NoEStop)), Idle, None)]);
}

#[test]
fn after_a_reset_the_holder_asks_lets_go_and_presses() {
    let mut vehicle = Vehicle::driving();
    vehicle.run([
        (Input(ArbiterInput::EStop(caller(ALICE))), EStop, A),
        (Input(ArbiterInput::EStopStored(FIRST)), EStop, A),
        (Press(6), EStop, A),
        (Reset(ALICE, 1, Done), Idle, None),
        (Press(5), Idle, None),
        (Ask(ALICE, LeaseVerb::Request, Granted(2)), Held, A),
        (Press(20), Held, A),
        (Neutral(11), Held, A),
        (Press(1), Driving, A),
        (Input(ArbiterInput::LocalEStop), EStop, A),
    ]);
    assert_eq!(vehicle.report().estop.unwrap().id, EStopId(2));
}

#[test]
fn an_operator_alone_can_reset_what_was_found_at_the_start() {
    let found = EStopId(41);
    let mut vehicle = Vehicle::at_boot();
    vehicle.input(tested(true, StoredEStop::Latched(found)));
    assert!(!vehicle.has_stored(found));
    vehicle.run([
        (Silence(20), EStop, None),
        (Reset(ALICE, 41, Refused(Refusal::NotHolder)), EStop, None),
        (Ask(ALICE, LeaseVerb::Request, Granted(1)), EStop, A),
        (Reset(ALICE, 41, Done), Idle, None),
        (Input(ArbiterInput::LocalEStop), EStop, None),
    ]);
    assert_eq!(vehicle.report().estop.unwrap().id, EStopId(42));
    // What cannot be read counts as a stop.
    let mut vehicle = Vehicle::at_boot();
    vehicle.run([(Input(tested(true, StoredEStop::Unreadable)), EStop, None)]);
    assert!(vehicle.has_stored(FIRST));
}

#[test]
fn a_stop_during_the_self_test_is_in_force_after_it() {
    Vehicle::at_boot().run([
        (Input(ArbiterInput::EStop(caller(BOB))), SafeBoot, None),
        (Input(ArbiterInput::EStopStored(FIRST)), SafeBoot, None),
        (Silence(20), SafeBoot, None),
        (Reset(CAROL, 1, Refused(Refusal::NotReady)), SafeBoot, None),
        (Input(tested(true, StoredEStop::None)), EStop, None),
    ]);
}

#[test]
fn a_take_over_under_way_ends_with_the_supervisor_able_to_reset() {
    Vehicle::driving().run([
        (
            Ask(CAROL, LeaseVerb::TakeOver, Answer::Waiting),
            ended(LeaseEnd::TakenOver),
            None,
        ),
        (
            Input(ArbiterInput::EStop(caller(ALICE))),
            EStop,
            Some(CAROL),
        ),
    ]);
}

#[test]
fn a_fault_is_ended_at_the_vehicle_alone_and_by_a_self_test() {
    let fault = Fault(FaultReason::Actuator);
    let not_ready = Refused(Refusal::NotReady);
    Vehicle::driving().run([
        (Input(ArbiterInput::ActuatorFault), fault, None),
        (Ask(CAROL, LeaseVerb::TakeOver, not_ready), fault, None),
        (Input(tested(true, StoredEStop::None)), fault, None),
        (Input(ArbiterInput::EStop(caller(BOB))), fault, None),
        (Input(ArbiterInput::EStopStored(FIRST)), fault, None),
        (Input(ArbiterInput::LocalReset), SafeBoot, None),
        // The fault did not end the emergency stop.
        (Input(tested(true, StoredEStop::None)), EStop, None),
        (Input(ArbiterInput::LocalReset), Idle, None),
    ]);
}

#[test]
fn a_self_test_that_fails_is_a_fault_at_any_time() {
    let failed = Input(tested(false, StoredEStop::None));
    for mut vehicle in [Vehicle::at_boot(), Vehicle::idle(), Vehicle::driving()] {
        vehicle.run([(failed, Fault(FaultReason::SelfTest), None)]);
    }
}

/// No limit but one ahead.
const fn ahead(forward_mps: f64) -> SpeedLimits {
    SpeedLimits {
        forward_mps,
        ..OPEN
    }
}

const OPEN: SpeedLimits = SpeedLimits {
    forward_mps: 1.0,
    reverse_mps: 1.0,
    left_mps: 0.0,
    right_mps: 0.0,
    left_radps: 1.0,
    right_radps: 1.0,
    in_unknown_space: false,
    overspeed: Velocity::ZERO,
};

#[track_caller]
fn near(is: f64, expected: f64) {
    assert!((is - expected).abs() < 1e-6, "{is} is not {expected}");
}

#[test]
fn old_commands_allow_less_speed() {
    let mut vehicle = Vehicle::driving();
    let fast = Velocity::new(1.0, 0.5);
    vehicle.hold(fast, 100);
    // The token of a command is 20 ms old when the next one comes.
    near(vehicle.report().speed_allowed_mps, 1.0);
    near(vehicle.output().linear_mps, 1.0);
    let delayed = |vehicle: &mut Vehicle, rounds: usize| {
        let mut tokens = vec![vehicle.token; 10];
        for _ in 0..rounds {
            let command = vehicle.command(ALICE, fast);
            tokens.push(vehicle.token);
            let token = tokens.remove(0);
            vehicle.send(DriveCommand { token, ..command });
            vehicle.round();
        }
    };
    delayed(&mut vehicle, 120);
    // Ten rounds on the way and one until the next: 220 ms.
    let report = vehicle.report();
    assert_eq!(report.peak_age, Some(Duration::from_millis(220)));
    near(report.speed_allowed_mps, 0.15 / 0.22);
    near(report.applied.linear_mps, 0.15 / 0.22);
    near(report.applied.angular_radps, 0.5 * 0.15 / 0.22);
    assert_eq!(report.clamp, Some(Clamp::Age));
    assert_eq!(report.requested, fast);
    // A second later, and not before, it is forgotten.
    vehicle.hold(fast, 40);
    near(vehicle.output().linear_mps, 0.15 / 0.22);
    vehicle.hold(fast, 100);
    near(vehicle.output().linear_mps, 1.0);
}

#[test]
fn the_monitor_slows_an_arc_without_bending_it() {
    let mut vehicle = Vehicle::driving();
    let arc = Velocity::new(0.8, -0.4);
    vehicle.limit(ahead(0.2));
    vehicle.hold(arc, 100);
    near(vehicle.output().linear_mps, 0.2);
    near(vehicle.output().angular_radps, -0.1);
    assert_eq!(vehicle.report().clamp, Some(Clamp::CollisionMonitor));
    vehicle.limit(SpeedLimits {
        right_radps: 0.2,
        ..OPEN
    });
    vehicle.hold(arc, 100);
    near(vehicle.output().linear_mps, 0.4);
    near(vehicle.output().angular_radps, -0.2);
}

#[test]
fn the_monitor_brakes_without_regard_to_jerk_and_is_reported() {
    let mut vehicle = Vehicle::driving();
    vehicle.limit(ahead(0.1));
    for (rounds, mps) in [(1, 0.28), (9, 0.1), (9, 0.1), (41, 0.1)] {
        vehicle.run([(Press(rounds), Driving, A)]);
        near(vehicle.output().linear_mps, mps);
        let clamp = vehicle.report().clamp;
        assert_eq!(clamp, Some(Clamp::CollisionMonitor), "{rounds}");
    }
}

#[test]
fn before_a_wall_it_still_backs_off_and_turns() {
    let mut vehicle = Vehicle::driving();
    vehicle.limit(ahead(0.0));
    vehicle.run([(Press(50), Driving, A)]);
    assert_eq!(vehicle.output(), Velocity::ZERO);
    vehicle.hold(FORWARD.scaled(-1.0), 60);
    near(vehicle.output().linear_mps, -0.3);
    let turn = Velocity::new(0.0, 0.6);
    vehicle.hold(turn, 60);
    near(vehicle.output().angular_radps, 0.6);
    near(vehicle.output().linear_mps, 0.0);
}

#[test]
fn a_stop_at_a_wall_is_immediate_and_needs_neutral_again() {
    let mut vehicle = Vehicle::driving();
    vehicle.limit(ahead(0.0));
    // Too late to take the stop back, too early to count.
    vehicle.run([(Press(50), Driving, A), (Neutral(3), Held, A)]);
    let back = FORWARD.scaled(-1.0);
    vehicle.hold(back, 20);
    vehicle.run([(Pass(0), Held, A)]);
    assert_eq!(vehicle.report().arming, Arming::Locked);
    vehicle.hold(Velocity::ZERO, 11);
    vehicle.hold(back, 60);
    near(vehicle.output().linear_mps, -0.3);
}

#[test]
fn a_stale_monitor_stops_the_vehicle_until_a_new_press() {
    let [stale, off] = [CollisionMonitorOutput::Stale, CollisionMonitorOutput::Off].map(Monitor);
    Vehicle::driving().run([
        (stale, Driving, A),
        (Press(1), STALE, A),
        (off, STALE, A),
        (Press(50), Held, A),
    ]);
    // A press without a monitor does not count later.
    Vehicle::held().run([
        (Neutral(11), Held, A),
        (stale, Held, A),
        (Silence(20), Held, A),
        (Press(2), Held, A),
        (off, Held, A),
        (Press(20), Held, A),
    ]);
    // A monitor without output.
    let mut vehicle = Vehicle::driving();
    for _ in 0..16 {
        vehicle.pass(20);
        vehicle.input(ArbiterInput::Token { nonce: 1 });
        let command = vehicle.command(ALICE, FORWARD);
        vehicle.send(command);
        vehicle.input(ArbiterInput::Tick);
    }
    vehicle.run([(Pass(0), STALE, A)]);
    assert_eq!(vehicle.report().collision_monitor, None);
}

#[test]
fn what_limits_the_speed_is_reported() {
    let mut vehicle = Vehicle::driving();
    assert_eq!(vehicle.report().clamp, None);
    let fast = Velocity::new(0.6, 0.0);
    vehicle.hold(fast, 2);
    assert_eq!(vehicle.report().clamp, Some(Clamp::Ramp));
    let spin = Velocity::new(0.0, 5.0);
    vehicle.hold(spin, 100);
    assert_eq!(vehicle.report().clamp, Some(Clamp::Speed));
    near(vehicle.output().angular_radps, 1.0);
    vehicle.silence(600);
    assert_eq!(vehicle.report().clamp, None);
}

#[test]
fn on_its_way_to_a_limit_it_is_held_back_by_its_acceleration() {
    // The first is the greatest speed as the 32 bits of the wire may round it.
    for (asked_mps, at_last) in [(1.000_000_05, None), (1.5, Some(Clamp::Speed))] {
        for way in [1.0, -1.0] {
            let asked = Velocity::new(way * asked_mps, 0.0);
            let mut vehicle = Vehicle::driving();
            vehicle.hold(asked, 60);
            assert!(vehicle.output().linear_mps.abs() < 0.95, "{asked:?}");
            assert_eq!(vehicle.report().clamp, Some(Clamp::Ramp), "{asked:?}");
            vehicle.hold(asked, 200);
            near(vehicle.output().linear_mps, way);
            assert_eq!(vehicle.report().clamp, at_last, "{asked:?}");
        }
    }
}

#[test]
fn a_boat_that_is_too_fast_is_shown_the_limit_and_gets_no_thrust() {
    let mut boat = Vehicle::driving();
    boat.limit(SpeedLimits {
        overspeed: FORWARD.scaled(1.0 / 3.0),
        ..ahead(0.2)
    });
    boat.hold(FORWARD, 60);
    near(boat.output().linear_mps, 0.0);
    let reported = boat.report().collision_monitor;
    assert_eq!(reported, Some(boat.collision_monitor));
    // Thrust the other way slows it down.
    boat.hold(FORWARD.scaled(-1.0), 100);
    near(boat.output().linear_mps, -0.3);
}

#[test]
fn a_boat_without_thrust_drifts() {
    let teleop = TeleopConfig {
        is_boat: true,
        ..TeleopConfig::default()
    };
    let mut boat = Vehicle::with(&teleop);
    assert!(!boat.report().is_drifting);
    boat.input(tested(true, StoredEStop::None));
    assert!(boat.report().is_drifting);
    boat.lease(ALICE, LeaseVerb::Request);
    boat.hold(Velocity::ZERO, 11);
    assert!(boat.report().is_drifting);
    boat.hold(FORWARD, 1);
    assert!(!boat.report().is_drifting);
    assert!(!Vehicle::idle().report().is_drifting);
}

#[test]
fn measured_speed_is_passed_on_unless_it_is_none() {
    let mut vehicle = Vehicle::idle();
    vehicle.input(ArbiterInput::Measured(FORWARD));
    assert_eq!(vehicle.report().measured, Some(FORWARD));
    vehicle.input(ArbiterInput::Measured(FORWARD.scaled(f64::NAN)));
    assert_eq!(vehicle.report().measured, None);
}

#[test]
fn between_two_locomotion_modes_it_stands() {
    let mut vehicle = Vehicle::held();
    let teleop = TeleopConfig::default();
    let locomotion = LocomotionConfig {
        modes: LocomotionModes {
            differential: false,
            double_ackermann: true,
            turn_on_spot: true,
            lateral: false,
            crab: true,
        },
        min_turn_radius_m: 2.0,
        mode_change_s: 1.0,
    };
    vehicle.rules = Rules::new(&teleop, &VehicleConfig::default(), &locomotion).unwrap();
    let sideways = |linear_mps, lateral_mps| Velocity {
        lateral_mps,
        ..Velocity::new(linear_mps, 0.0)
    };
    vehicle.hold(Velocity::ZERO, 11);
    // It turns with the radius that it can.
    vehicle.hold(Velocity::new(0.3, 0.5), 60);
    assert_eq!(vehicle.output(), Velocity::new(0.3, 0.15));
    assert_eq!(vehicle.report().clamp, Some(Clamp::Locomotion));
    assert_eq!(vehicle.state.possible_request(), Velocity::new(0.3, 0.5));
    // From 0.3 m/s it needs about 0.8 s to stand, and a second more.
    vehicle.hold(sideways(0.2, 0.2), 60);
    assert_eq!(vehicle.output(), Velocity::ZERO);
    assert_eq!(vehicle.report().clamp, Some(Clamp::Locomotion));
    assert_eq!(vehicle.state.mode, Mode::Driving);
    vehicle.hold(sideways(0.2, 0.2), 75);
    assert_eq!(vehicle.output(), sideways(0.2, 0.2));
    // Straight on it need not change.
    vehicle.hold(sideways(0.2, 0.0), 60);
    assert_eq!(vehicle.output(), sideways(0.2, 0.0));
    // No mode can do all three: it keeps its own.
    let all = Velocity {
        angular_radps: 0.5,
        ..sideways(0.1, -0.1)
    };
    vehicle.hold(all, 60);
    assert_eq!(vehicle.output(), sideways(0.1, -0.1));
    assert_eq!(vehicle.report().clamp, Some(Clamp::Locomotion));
    // Both axes together stay below the speed that age allows, and the vehicle's greatest.
    vehicle.hold(sideways(1.0, 1.0), 200);
    let speed_mps = vehicle.output().ground_speed_mps();
    assert!((speed_mps - 1.0).abs() < 1e-6, "{speed_mps}");
    // After a stop the other mode takes its time, too.
    vehicle.hold(Velocity::ZERO, 60);
    vehicle.hold(Velocity::new(0.0, 0.5), 20);
    assert_eq!(vehicle.output(), Velocity::ZERO);
    vehicle.hold(Velocity::new(0.0, 0.5), 60);
    assert_eq!(vehicle.output(), Velocity::new(0.0, 0.5));
}

#[test]
fn a_docking_site_is_chosen_as_long_as_the_command_in_force_names_it() {
    let choice = DockingChoice {
        site: 2,
        vegetation: ShoreClass::Sparse,
    };
    let push = |vehicle: &mut Vehicle, docking: Option<DockingChoice>| {
        let command = DriveCommand {
            docking,
            ..vehicle.command(ALICE, FORWARD)
        };
        vehicle.send(command);
        vehicle.round();
        assert_eq!(vehicle.report().docking, vehicle.state.docking());
        vehicle.state.docking()
    };
    let mut vehicle = Vehicle::driving();
    assert_eq!(push(&mut vehicle, Some(choice)), Some(choice));
    assert_eq!(push(&mut vehicle, None), None);

    // A command of another, an older one, and one of another grant change nothing.
    assert_eq!(push(&mut vehicle, Some(choice)), Some(choice));
    let forged = DriveCommand {
        docking: None,
        goal: None,
        ..vehicle.command(BOB, FORWARD)
    };
    vehicle.send(forged);
    assert_eq!(vehicle.state.docking(), Some(choice));

    vehicle.hold(Velocity::ZERO, 1);
    assert_eq!(vehicle.state.docking(), None, "no key is pressed");
    let mut vehicle = Vehicle::driving();
    push(&mut vehicle, Some(choice));
    vehicle.silence(1000);
    assert_eq!(vehicle.state.docking(), None, "commands are too old");
    let mut vehicle = Vehicle::driving();
    push(&mut vehicle, Some(choice));
    assert_eq!(vehicle.lease(ALICE, LeaseVerb::Release), Answer::Done);
    assert_eq!(vehicle.state.docking(), None, "the lease has ended");
    vehicle.silence(5000);
    assert_eq!(vehicle.lease(BOB, LeaseVerb::Request), Answer::Granted(2));
    for (requested, rounds) in [(Velocity::ZERO, 11), (FORWARD, 5)] {
        for _ in 0..rounds {
            let command = vehicle.command(BOB, requested);
            vehicle.send(command);
            vehicle.round();
        }
    }
    assert_eq!(
        (vehicle.state.mode, vehicle.state.docking()),
        (Mode::Driving, None)
    );
}
