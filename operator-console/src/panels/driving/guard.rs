//! What the collision guard says of the way that is asked for.

use protocol::message::{Clamp, Guard, TeleopState, TeleopStatus, Velocity};

use super::tightest::Tightest;
use crate::model::{LEAST_MPS, LEAST_RADPS};
use crate::panels::wording::signed;
use crate::theme::Tone;

/// What lets through so much of what is asked for does not bound it to be seen.
pub(super) const FREE: f32 = 0.98;

/// What its words mean.
pub(super) const HINT: &str = "How fast the collision guard lets the robot go that way, so that it still stops before \
                               what its sensors or its map show, and before ground that nobody has seen. Where its \
                               data is late, nothing is driven. It sees too little where nobody has looked yet, or \
                               where the last look is too old: there the robot may only creep, or not move at all. \
                               That ends by itself where its sensors have looked. What bars the way is among the red \
                               points of the last scans, which a sonar sees under water, or is fatal on the map. Where \
                               it changes its mind by turns, this is the least of the last 1.5 s, at times.";

/// How fast it lets a vehicle go and turn the ways of `velocity`, m/s and rad/s; infinite where it sets no limit.
pub(super) const fn allowed(guard: Guard, velocity: Velocity) -> [f32; 2] {
    match guard {
        Guard::On(limits) | Guard::Blind(limits) => [
            if velocity.linear_mps <= -LEAST_MPS {
                limits.reverse_mps
            } else {
                limits.forward_mps
            },
            if velocity.angular_radps > 0.0 {
                limits.left_radps
            } else {
                limits.right_radps
            },
        ],
        Guard::Silent | Guard::Off | Guard::Stale => [f32::INFINITY; 2],
    }
}

/// Whether it lets a vehicle that is driven neither go nor turn.
pub(crate) fn makes_stand(teleop: &TeleopStatus) -> bool {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.applied;
    teleop.state == TeleopState::Driving
        && teleop.clamp == Some(Clamp::Guard)
        && linear_mps.abs() < LEAST_MPS
        && angular_radps.abs() < LEAST_RADPS
}

/// What the guard says to a vehicle that goes and turns so fast at most, m/s and rad/s. Where nothing is asked for, it
/// speaks of what is ahead; where only the turn is bounded, of that; where nothing may move whatever it allows, of no
/// way.
pub(super) fn guard(
    teleop: &TeleopStatus,
    Tightest {
        guard,
        comes_and_goes,
    }: Tightest,
    greatest: [f32; 2],
) -> (Tone, String) {
    let with = |word: &str| match teleop.state {
        TeleopState::SafeBoot | TeleopState::EStop | TeleopState::Fault(_) => word.to_owned(),
        TeleopState::Idle | TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => {
            format!("{word}{}", allows(teleop, guard, comes_and_goes, greatest))
        }
    };
    // What nobody drives from afar may move all the same: by its own program, or adrift.
    let nothing = match teleop.state {
        TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => ": nothing moves",
        TeleopState::SafeBoot | TeleopState::Idle | TeleopState::EStop | TeleopState::Fault(_) => {
            ""
        }
    };
    match guard {
        Guard::Silent => (Tone::Warning, format!("Silent{nothing}")),
        Guard::Off => (Tone::Warning, "Off".to_owned()),
        Guard::On(_) => (Tone::Good, with("On")),
        Guard::Blind(_) => (Tone::Warning, with("Sees too little")),
        Guard::Stale => (Tone::Warning, format!("Its data is late{nothing}")),
    }
}

fn allows(
    teleop: &TeleopStatus,
    guard: Guard,
    comes_and_goes: [bool; 2],
    [speed_mps, turn_radps]: [f32; 2],
) -> String {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.requested;
    let [going, turning] = allowed(guard, teleop.requested);
    let goes = linear_mps.abs() >= LEAST_MPS;
    let turns = angular_radps.abs() >= LEAST_RADPS;
    // Letting go of the turn is all that helps then.
    let is_turn_bound = going >= FREE * linear_mps.abs() && turning < FREE * angular_radps.abs();
    let of_turn = turns && (!goes || is_turn_bound);
    let (way, allowed, greatest) = match (of_turn, linear_mps <= -LEAST_MPS) {
        (true, _) if angular_radps > 0.0 => ("turning left", turning, turn_radps),
        (true, _) => ("turning right", turning, turn_radps),
        (false, true) => ("behind", going, speed_mps),
        (false, false) => ("ahead", going, speed_mps),
    };
    let least = if of_turn { LEAST_RADPS } else { LEAST_MPS };
    let is_free = greatest > 0.0 && allowed >= greatest;
    if is_free || !allowed.is_finite() {
        // It has a reason that is not of this way: a turn beside it, as a rule.
        let is_seen = matches!(guard, Guard::On(_));
        return match (teleop.clamp, is_free && is_seen) {
            (Some(Clamp::Guard), _) => ", holds it back".to_owned(),
            (Some(Clamp::Speed | Clamp::Ramp | Clamp::Age | Clamp::Stop) | None, true) => {
                format!(", {way} is free")
            }
            (Some(Clamp::Speed | Clamp::Ramp | Clamp::Age | Clamp::Stop) | None, false) => {
                String::new()
            }
        };
    }
    let at_times = if comes_and_goes[usize::from(of_turn)] {
        " at times"
    } else {
        ""
    };
    if allowed < least {
        format!(", {way} is blocked{at_times}")
    } else if of_turn {
        let deg = signed(f64::from(allowed.to_degrees()), 0);
        format!(", {way} ≤ {deg} °/s{at_times}")
    } else {
        format!(", {way} ≤ {allowed:.2} m/s{at_times}")
    }
}
