//! P1 to P9, P11 over random sequences of moves, each of one to hundreds of events.
//!
//! The long run is `PROPTEST_CASES=1000000 cargo test --release -p teleop --lib proofs::properties::no_short`: seven
//! minutes.

use std::time::Duration;

use proptest::prelude::*;

use super::world::{Fate, Forged, Move, World};
use super::{caller, rules};
use crate::config::{Rules, TeleopConfig};
use crate::interface::{ArbiterInput, CollisionMonitorOutput, LeaseVerb, SpeedLimits};
use crate::lease::{EStopId, OperatorId, StoredEStop};
use crate::locomotion::{LocomotionConfig, LocomotionModes};
use crate::motion::Velocity;
use mapping::vehicle::VehicleConfig;
use measurement::time::Monotonic;

/// Thousands of events: what needs a long history.
const LONG: usize = 200;
/// Hundreds of events, and many more sequences: what needs an unlikely beginning.
const SHORT: usize = 20;

/// Sequences of a normal run; [`ProptestConfig`] itself reads the variable.
fn config(cases: u32) -> ProptestConfig {
    let is_set = std::env::var_os("PROPTEST_CASES").is_some();
    let default = ProptestConfig::default();
    ProptestConfig {
        cases: if is_set { default.cases } else { cases },
        failure_persistence: None,
        ..default
    }
}

fn velocity(part: impl Strategy<Value = f64> + Clone) -> impl Strategy<Value = Velocity> {
    let lateral = prop_oneof![2 => Just(0.0), 1 => part.clone()];
    (part.clone(), lateral, part).prop_map(|(linear_mps, lateral_mps, angular_radps)| Velocity {
        linear_mps,
        lateral_mps,
        angular_radps,
    })
}

fn sane_speed() -> impl Strategy<Value = Velocity> {
    velocity(prop_oneof![2 => Just(0.0), 1 => Just(1.0), 1 => Just(-1.0), 2 => -2.0..2.0])
}

fn any_speed() -> impl Strategy<Value = Velocity> {
    velocity(
        prop_oneof![3 => -2.0..2.0, 1 => any::<f64>(), 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)],
    )
}

fn fate() -> impl Strategy<Value = Fate> {
    prop_oneof![
        6 => Just(Fate::Arrives),
        1 => Just(Fate::Twice),
        1 => Just(Fate::Lost),
        2 => (0_u8..25).prop_map(Fate::Late),
    ]
}

fn output() -> impl Strategy<Value = CollisionMonitorOutput> {
    let limit = || prop_oneof![3 => 0.0..1.5, 1 => Just(0.0), 1 => any::<f64>()];
    let overspeed = prop_oneof![3 => Just(Velocity::ZERO), 1 => velocity(-1.0..1.0)];
    let limits = (prop::array::uniform6(limit()), any::<bool>(), overspeed);
    prop_oneof![
        1 => Just(CollisionMonitorOutput::Off),
        1 => Just(CollisionMonitorOutput::Stale),
        6 => limits.prop_map(|([forward_mps, reverse_mps, left_mps, right_mps, left_radps, right_radps], in_unknown_space, overspeed)| {
            CollisionMonitorOutput::Limits(SpeedLimits { forward_mps, reverse_mps, left_mps, right_mps, left_radps, right_radps, in_unknown_space, overspeed })
        }),
    ]
}

fn verb() -> impl Strategy<Value = LeaseVerb> {
    prop_oneof![
        4 => Just(LeaseVerb::Request),
        2 => (0_u32..3).prop_map(|to| LeaseVerb::HandOver { to: OperatorId(to) }),
        1 => (0_u32..3).prop_map(|whom| LeaseVerb::Refuse { whom: OperatorId(whom) }),
        2 => Just(LeaseVerb::Release),
        2 => Just(LeaseVerb::TakeOver),
    ]
}

fn stored() -> impl Strategy<Value = StoredEStop> {
    prop_oneof![
        4 => Just(StoredEStop::None),
        1 => (0_u64..9).prop_map(|id| StoredEStop::Latched(EStopId(id))),
        1 => Just(StoredEStop::Unreadable),
    ]
}

fn forged() -> impl Strategy<Value = Move> {
    let parts = (
        0_u8..3,
        0_u8..3,
        -2_i8..3,
        0_u8..40,
        prop::bool::weighted(0.9),
        any_speed(),
    );
    (parts, prop::bool::weighted(0.05)).prop_map(|(parts, estop)| {
        let (who, epochs_ago, seq_offset, tokens_ago, nonce_is_right, requested) = parts;
        Move::Forge(Forged {
            who,
            epochs_ago,
            seq_offset,
            tokens_ago,
            nonce_is_right,
            requested,
            estop,
        })
    })
}

fn input(who: impl Strategy<Value = u8> + Clone) -> impl Strategy<Value = ArbiterInput> {
    prop_oneof![
        who.clone().prop_map(|who| ArbiterInput::EStop(caller(who))),
        Just(ArbiterInput::LocalEStop),
        Just(ArbiterInput::LocalReset),
        (prop::bool::weighted(0.9), stored())
            .prop_map(|(has_passed, stored)| ArbiterInput::SelfTest { has_passed, stored }),
        Just(ArbiterInput::ActuatorFault),
        Just(ArbiterInput::MotorsHeld),
        Just(ArbiterInput::PlannerFloods),
        who.prop_map(|who| ArbiterInput::Revoked(caller(who).operator)),
    ]
}

fn one_move() -> impl Strategy<Value = Move> {
    let who = || prop_oneof![4 => Just(0_u8), 2 => Just(1_u8), 1 => Just(2_u8)];
    let tokens_ago = || prop_oneof![5 => Just(0_u8), 1 => 0_u8..60];
    prop_oneof![
        40 => (1_u8..16, 1_u8..45, fate())
            .prop_map(|(count, millis, fate)| Move::Rounds { count, millis, fate }),
        20 => (who(), sane_speed()).prop_map(|(who, requested)| Move::Stick { who, requested }),
        8 => who().prop_map(|who| Move::Stick { who, requested: Velocity::ZERO }),
        6 => (1_u8..60).prop_map(Move::Stall),
        2 => (0_u16..3000).prop_map(Move::Pause),
        3 => (who(), prop::bool::weighted(0.7)).prop_map(|(who, is_open)| Move::Open { who, is_open }),
        6 => (who(), verb(), tokens_ago()).prop_map(|(who, verb, tokens_ago)| Move::Lease { who, verb, tokens_ago }),
        3 => prop::bool::weighted(0.8).prop_map(|is_right| Move::Stored { is_right }),
        3 => (who(), prop::bool::weighted(0.8), tokens_ago())
            .prop_map(|(who, is_right, tokens_ago)| Move::Reset { who, is_right, tokens_ago }),
        6 => output().prop_map(|output| Move::CollisionMonitor(Some(output))),
        2 => Just(Move::CollisionMonitor(None)),
        6 => input(who()).prop_map(Move::Input),
        6 => forged(),
        4 => any::<u8>().prop_map(Move::Replay),
        6 => Just(Move::StartDriving),
        4 => Just(Move::StartGoal),
        6 => (who(), prop::bool::weighted(0.7)).prop_map(|(who, is_named)| Move::Goal { who, is_named }),
        4 => prop_oneof![4 => sane_speed().prop_map(Some), 1 => any_speed().prop_map(Some), 1 => Just(None)].prop_map(Move::Planner),
        3 => (any_speed(), 0_u16..400).prop_map(|(velocity, millis_ago)| Move::Planned { velocity, millis_ago }),
    ]
}

fn moves(count: usize) -> impl Strategy<Value = Vec<Move>> {
    prop::collection::vec(one_move(), count)
}

fn modes() -> impl Strategy<Value = LocomotionModes> {
    any::<[bool; 4]>().prop_map(
        |[double_ackermann, turn_on_spot, lateral, crab]| LocomotionModes {
            differential: ![double_ackermann, turn_on_spot, lateral, crab].contains(&true),
            double_ackermann,
            turn_on_spot,
            lateral,
            crab,
        },
    )
}

/// The design's defaults, and rules at the edges of what is allowed.
fn any_rules() -> impl Strategy<Value = Rules> {
    let parts = (
        100_u32..=1000,
        1.0..3.0,
        0.05..2.0,
        200_u32..400,
        (any::<bool>(), modes(), 0.3..2.0),
    );
    let made = parts.prop_map(
        |(
            max_command_age_ms,
            lease_s,
            max_latency_travel_m,
            neutral_ms,
            (is_boat, modes, mode_change_s),
        )| {
            let teleop = TeleopConfig {
                max_command_age_ms,
                lease_s,
                max_latency_travel_m,
                neutral_ms,
                is_boat,
                ..TeleopConfig::default()
            };
            let locomotion = LocomotionConfig {
                modes,
                min_turn_radius_m: mode_change_s,
                mode_change_s,
            };
            let rules = Rules::new(&teleop, &VehicleConfig::default(), &locomotion).unwrap();
            // Without a planner where the vehicle is a boat: goals have no effect then.
            if is_boat {
                rules
            } else {
                rules.with_planner(Duration::from_millis(150))
            }
        },
    );
    prop_oneof![Just(rules()), made]
}

/// Runs `moves` in a world that begins at `start_ns`, after that many grants and commands.
fn run(
    rules: Rules,
    (start_ns, epoch, seq): (u64, u64, u64),
    moves: &[Move],
) -> Result<World, TestCaseError> {
    let mut world = World::new(rules, Monotonic::from_nanos(start_ns), epoch, seq);
    for (number, one) in moves.iter().enumerate() {
        let broken =
            |violation| TestCaseError::fail(format!("move {number}, {one:?}: {violation}"));
        world.make(one).map_err(broken)?;
    }
    Ok(world)
}

proptest! {
    #![proptest_config(config(1500))]

    #[test]
    fn no_long_sequence_of_events_breaks_a_property(rules in any_rules(), moves in moves(LONG)) {
        run(rules, (5_000_000_000, 0, 0), &moves)?;
    }
}

proptest! {
    #![proptest_config(config(5000))]

    #[test]
    fn no_short_sequence_of_events_breaks_a_property(rules in any_rules(), moves in moves(SHORT)) {
        run(rules, (5_000_000_000, 0, 0), &moves)?;
    }
}

proptest! {
    #![proptest_config(config(100))]

    /// P11: there is no clock but the moments passed in, and of those only differences count; of epochs and sequence
    /// numbers too, which is what the model checker rests on.
    #[test]
    fn the_same_events_at_another_time_have_the_same_effect(
        moves in moves(LONG),
        start_ns in 0..u64::MAX / 2,
        epoch in 3..u64::MAX / 2,
        seq in 3..u64::MAX / 2,
    ) {
        // A whole number of the 0.1 s in which ages are gathered.
        let start_ns = start_ns / 100_000_000 * 100_000_000;
        let here = run(rules(), (0, 3, 3), &moves)?;
        let there = run(rules(), (start_ns, epoch, seq), &moves)?;
        prop_assert_eq!(here.outputs, there.outputs);
        prop_assert_eq!(here.state.counters, there.state.counters);
    }
}

#[test]
fn random_sequences_do_drive() {
    use proptest::strategy::ValueTree as _;
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let (mut driven, mut planned, mut sequences, mut inputs) = (0, 0, 0, [0; 2]);
    for _ in 0..50 {
        let long = moves(LONG).new_tree(&mut runner).unwrap().current();
        let world = run(rules(), (0, 0, 0), &long).unwrap();
        driven += world.driven;
        planned += world.planned;
        sequences += usize::from(world.driven > 100);
        inputs[0] += world.outputs.len();
        let short = moves(SHORT).new_tree(&mut runner).unwrap().current();
        inputs[1] += run(rules(), (0, 0, 0), &short).unwrap().outputs.len();
    }
    let [long, short] = inputs.map(|inputs| inputs / 50);
    println!("events in a sequence, on average: {long} and {short}");
    assert!(long > 2000 && short > 200, "{long} and {short} events");
    assert!(sequences > 45, "only {sequences} of 50 sequences drive");
    assert!(driven > 10_000, "only {driven} rounds are driven");
    assert!(planned > 100, "a planner moves it in only {planned} rounds");
}

/// The turn rate comes within rounding of what the turn radius allows while it still speeds up.
#[test]
fn a_speed_that_comes_to_its_cap_by_itself_may_go_on() {
    let modes = LocomotionModes {
        differential: false,
        double_ackermann: true,
        turn_on_spot: false,
        lateral: false,
        crab: false,
    };
    let locomotion = LocomotionConfig {
        modes,
        // After three rounds of 1 ms: 15 · 10⁻⁶ / 0.41666 is 0.5 · 10⁻⁹ more than 2.5 · 10⁻⁶ / 0.41666 + 30 · 10⁻⁶.
        min_turn_radius_m: 0.41666,
        ..LocomotionConfig::default()
    };
    let vehicle = VehicleConfig::default();
    let rules = Rules::new(&TeleopConfig::default(), &vehicle, &locomotion).unwrap();
    let rounds = |count, millis| Move::Rounds {
        count,
        millis,
        fate: Fate::Arrives,
    };
    let moves = [
        Move::StartDriving,
        Move::Stick {
            who: 0,
            requested: Velocity::ZERO,
        },
        rounds(100, 20),
        Move::Stick {
            who: 0,
            requested: Velocity::new(0.5, 1.0),
        },
        rounds(15, 1),
    ];
    let world = run(rules, (0, 0, 0), &moves).unwrap();
    assert!(world.driven > 10, "{} rounds are driven", world.driven);
}
