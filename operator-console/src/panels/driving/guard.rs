//! What the collision monitor says of the way that is asked for.

use protocol::message::{Clamp, CollisionMonitorState, TeleopState, TeleopStatus, Velocity};

use super::strictest_limit::StrictestLimit;
use crate::model::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS};
use crate::panels::formatting::signed;
use crate::theme::Tone;

/// What lets through so much of what is asked for does not bound it to be seen.
pub(super) const FREE: f32 = 0.98;

/// What its words mean.
pub(super) const HINT: &str = "The collision monitor's speed limit in that direction, so that the vehicle stops before \
                               obstacles of its sensors or its map, and before unknown ground. When its \
                               data is late, the vehicle stops. Unknown ground has not been observed yet, or \
                               not recently: there the vehicle may only creep, or not move at all. \
                               That ends when its sensors have observed it. Obstacles are among the red \
                               points of the last scans (of a sonar: under water), or lethal on the map. When \
                               the limit alternates, this is the least of the last 1.5 s, at times.";

/// How fast it lets a vehicle go and turn the ways of `velocity`, m/s and rad/s; infinite where it sets no limit.
pub(super) const fn allowed(guard: CollisionMonitorState, velocity: Velocity) -> [f32; 2] {
    match guard {
        CollisionMonitorState::On(limits) | CollisionMonitorState::UnknownSpace(limits) => [
            if velocity.linear_mps <= -MIN_SHOWN_MPS {
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
        CollisionMonitorState::Silent
        | CollisionMonitorState::Off
        | CollisionMonitorState::Stale => [f32::INFINITY; 2],
    }
}

/// Whether it lets a vehicle that is driven neither go nor turn.
pub(crate) fn is_stopped_by_monitor(teleop: &TeleopStatus) -> bool {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.applied;
    teleop.state == TeleopState::Driving
        && teleop.clamp == Some(Clamp::CollisionMonitor)
        && linear_mps.abs() < MIN_SHOWN_MPS
        && angular_radps.abs() < MIN_SHOWN_RADPS
}

/// What the guard says to a vehicle that goes and turns so fast at most, m/s and rad/s. Where nothing is asked for, it
/// speaks of what is ahead; where only the turn is bounded, of that; where nothing may move whatever it allows, of no
/// way.
pub(super) fn guard(
    teleop: &TeleopStatus,
    StrictestLimit {
        guard,
        is_intermittent,
    }: StrictestLimit,
    greatest: [f32; 2],
) -> (Tone, String) {
    let with = |word: &str| match teleop.state {
        TeleopState::SafeBoot | TeleopState::EStop | TeleopState::Fault(_) => word.to_owned(),
        TeleopState::Idle | TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => {
            format!("{word}{}", allows(teleop, guard, is_intermittent, greatest))
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
        CollisionMonitorState::Silent => (Tone::Warning, format!("Silent{nothing}")),
        CollisionMonitorState::Off => (Tone::Warning, "Off".to_owned()),
        CollisionMonitorState::On(_) => (Tone::Good, with("On")),
        CollisionMonitorState::UnknownSpace(_) => (Tone::Warning, with("Unknown ground")),
        CollisionMonitorState::Stale => (Tone::Warning, format!("Its data is late{nothing}")),
    }
}

fn allows(
    teleop: &TeleopStatus,
    guard: CollisionMonitorState,
    is_intermittent: [bool; 2],
    [speed_mps, turn_radps]: [f32; 2],
) -> String {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.requested;
    let [going, turning] = allowed(guard, teleop.requested);
    let goes = linear_mps.abs() >= MIN_SHOWN_MPS;
    let turns = angular_radps.abs() >= MIN_SHOWN_RADPS;
    // Letting go of the turn is all that helps then.
    let is_turn_bound = going >= FREE * linear_mps.abs() && turning < FREE * angular_radps.abs();
    let of_turn = turns && (!goes || is_turn_bound);
    let (way, allowed, greatest) = match (of_turn, linear_mps <= -MIN_SHOWN_MPS) {
        (true, _) if angular_radps > 0.0 => ("turning left", turning, turn_radps),
        (true, _) => ("turning right", turning, turn_radps),
        (false, true) => ("behind", going, speed_mps),
        (false, false) => ("ahead", going, speed_mps),
    };
    let least = if of_turn {
        MIN_SHOWN_RADPS
    } else {
        MIN_SHOWN_MPS
    };
    let is_free = greatest > 0.0 && allowed >= greatest;
    if is_free || !allowed.is_finite() {
        // It has a reason that is not of this way: a turn beside it, as a rule.
        let is_seen = matches!(guard, CollisionMonitorState::On(_));
        return match (teleop.clamp, is_free && is_seen) {
            (Some(Clamp::CollisionMonitor), _) => ", limits it".to_owned(),
            (Some(Clamp::Speed | Clamp::Ramp | Clamp::Age | Clamp::Stop) | None, true) => {
                format!(", {way} is free")
            }
            (Some(Clamp::Speed | Clamp::Ramp | Clamp::Age | Clamp::Stop) | None, false) => {
                String::new()
            }
        };
    }
    let at_times = if is_intermittent[usize::from(of_turn)] {
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
