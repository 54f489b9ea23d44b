//! Why other speeds are told than are asked for: what who drives can wait for, or do something about.

use protocol::message::{Clamp, CollisionMonitorState, TeleopState, TeleopStatus, Velocity};

use super::gauge::Gauge;
use super::guard::{FREE, allowed};
use super::labels;
use super::strictest_limit::StrictestLimit;
use crate::panels::formatting::signed;

/// What nothing holds back but that nobody is faster at once.
const SPEEDS_UP: &str = "Speeding up";
const SLOWS_DOWN: &str = "Slowing down";
const CHANGES: &str = "Changing direction";

/// Whether such words tell of no limit that holds.
pub(super) fn is_free(words: &str) -> bool {
    [SPEEDS_UP, SLOWS_DOWN, CHANGES].contains(&words)
}

/// In words, where there is something to be seen. What `is_stuck` is held by neither acceleration nor brakes, whatever
/// its motors are told.
pub(super) fn limit_reason(
    teleop: &TeleopStatus,
    strictest_limit: StrictestLimit,
    gauges: &[Gauge; 2],
    is_stuck: bool,
) -> Option<String> {
    let is_held_back = gauges.iter().any(Gauge::is_held_back);
    let clamp = teleop.clamp.filter(|_| is_held_back);
    if is_stuck {
        return clamp
            .filter(|clamp| *clamp == Clamp::CollisionMonitor)
            .map(limited_by);
    }
    // The guard brakes no harder than a stop does. Until that is done more is told than it allows: a riddle, however
    // near to what is asked for it is.
    if teleop.state == TeleopState::Driving && exceeds_limit(teleop) {
        // One that changes its mind from scan to scan leads nowhere: neither up nor down.
        let asked = parts(teleop.requested).map(|speed| speed > 0.0);
        let [going, turning] = strictest_limit.is_intermittent;
        return Some(if going && asked[0] || turning && asked[1] {
            limited_by(Clamp::CollisionMonitor)
        } else {
            approaching_limit("Slowing down", Clamp::CollisionMonitor)
        });
    }
    match clamp? {
        Clamp::Stop => None,
        Clamp::Ramp => Some(acceleration_reason(teleop, strictest_limit.guard)),
        clamp @ (Clamp::Speed | Clamp::Age | Clamp::CollisionMonitor) => Some(limited_by(clamp)),
    }
}

fn limited_by(clamp: Clamp) -> String {
    format!("Limited by {}", labels::clamp(clamp))
}

fn approaching_limit(how: &str, to: Clamp) -> String {
    format!("{how} as {} allows", labels::clamp(to))
}

/// The robot names its acceleration wherever it is below all limits. Whether these let it go as it is asked to is
/// another matter, and the one to do something about: of a guard that changes its mind, the tightest of it.
fn acceleration_reason(teleop: &TeleopStatus, guard: CollisionMonitorState) -> String {
    let (asked, applied) = (teleop.requested, teleop.applied);
    let turns_round = asked.linear_mps * applied.linear_mps < 0.0
        || asked.angular_radps * applied.angular_radps < 0.0;
    if turns_round {
        return CHANGES.to_owned();
    }
    let Some((clamp, share)) = strictest_share(teleop, guard) else {
        let speeds_up = exceeds(parts(asked), parts(applied));
        return if speeds_up { SPEEDS_UP } else { SLOWS_DOWN }.to_owned();
    };
    let most = parts(asked).map(|speed| share * speed);
    if exceeds(most, parts(applied)) {
        approaching_limit("Speeding up", clamp)
    } else {
        limited_by(clamp)
    }
}

/// What bounds the motion that is asked for, and to which share of it, where that is to be seen. The robot bounds going
/// and turning alike, so that the arc keeps its shape.
fn strictest_share(teleop: &TeleopStatus, guard: CollisionMonitorState) -> Option<(Clamp, f32)> {
    let share = |speed: f32, allowed: f32| {
        if speed > allowed {
            allowed / speed
        } else {
            1.0
        }
    };
    let [goes, turns] = parts(teleop.requested);
    let [going, turning] = allowed(guard, teleop.requested);
    let by_guard = share(goes, going).min(share(turns, turning));
    let by_age = share(goes, teleop.speed_allowed_mps);
    let strictest_share = if by_guard < by_age {
        (Clamp::CollisionMonitor, by_guard)
    } else {
        (Clamp::Age, by_age)
    };
    Some(strictest_share).filter(|(_, share)| *share < FREE)
}

fn exceeds_limit(teleop: &TeleopStatus) -> bool {
    exceeds(
        parts(teleop.applied),
        allowed(teleop.collision_monitor, teleop.applied),
    )
}

/// How fast it goes and turns, either way, m/s and rad/s.
const fn parts(velocity: Velocity) -> [f32; 2] {
    [velocity.linear_mps.abs(), velocity.angular_radps.abs()]
}

/// Whether one goes or turns faster than the other, m/s and rad/s, as they are written.
fn exceeds(one: [f32; 2], other: [f32; 2]) -> bool {
    let is_more = |one: f32, other: f32, decimals| {
        let figure = |speed: f32| signed(f64::from(speed), decimals);
        one > other && figure(one) != figure(other)
    };
    is_more(one[0], other[0], 2) || is_more(one[1].to_degrees(), other[1].to_degrees(), 0)
}
