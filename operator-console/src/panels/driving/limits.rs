//! Requested and applied speeds, and what limits them.

use protocol::message::{
    Clamp, CollisionMonitorState, SpeedLimits, TeleopState, TeleopStatus, Velocity,
};

use super::labels;
use crate::model::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS, MonitorReport, direction_signs};
use crate::panels::formatting::{signed, turn};
use crate::theme::Tone;

/// A limit above this share of the requested speed is not shown as a limit.
const FREE: f32 = 0.98;
/// Limits within this factor of each other are the same limit, measured with noise.
const LOOSER_FACTOR: f32 = 1.1;

const SPEEDING_UP: &str = "Speeding up";
const SLOWING_DOWN: &str = "Slowing down";
const CHANGING_DIRECTION: &str = "Changing direction";

#[derive(Clone, Debug, PartialEq)]
pub struct Gauge {
    pub name: &'static str,
    /// Both speeds with their unit; a dash if nobody drives.
    pub figures: String,
    /// m/s, or °/s to the right.
    pub requested: f32,
    /// Speed sent to the motors, in the same unit.
    pub applied: f32,
    pub limit: f32,
    pub decimals: usize,
    pub ends: [&'static str; 2],
}

impl Gauge {
    /// Whether the applied speed differs from the requested one, also after rounding.
    pub fn is_held_back(&self) -> bool {
        let figure = |speed: f32| signed(f64::from(speed), self.decimals);
        let is_seen = figure(self.applied) != figure(self.requested);
        is_seen && (self.applied - self.requested).abs() > 0.02 * self.limit
    }
}

/// Gauges of linear and angular speed; `limits` are m/s and rad/s.
pub(super) fn gauges(teleop: &TeleopStatus, limits: [f32; 2], is_driven: bool) -> [Gauge; 2] {
    let [requested, applied] = [teleop.requested, teleop.applied];
    let [speed_mps, turn_rate_radps] = limits;
    let figures = |words: String| if is_driven { words } else { "–".to_owned() };
    // Left turns are on the left side of the gauge.
    let to_the_right = |velocity: Velocity| -velocity.angular_radps.to_degrees();
    [
        Gauge {
            name: "Linear speed",
            figures: figures(format!(
                "{} of {} m/s",
                signed(f64::from(applied.linear_mps), 2),
                signed(f64::from(requested.linear_mps), 2)
            )),
            requested: requested.linear_mps,
            applied: applied.linear_mps,
            limit: speed_mps,
            decimals: 2,
            ends: ["back", "forward"],
        },
        Gauge {
            name: "Angular speed",
            figures: figures(turn_of(applied.angular_radps, requested.angular_radps)),
            requested: to_the_right(requested),
            applied: to_the_right(applied),
            limit: turn_rate_radps.to_degrees(),
            decimals: 0,
            ends: ["left", "right"],
        },
    ]
}

/// "Applied of requested" in °/s. The direction is written once if both are the same.
fn turn_of(applied_radps: f32, requested_radps: f32) -> String {
    let [applied, requested] = [applied_radps, requested_radps].map(|radps| turn(f64::from(radps)));
    let (speed, unit) = applied.split_once(' ').unwrap_or((&applied, ""));
    let (_, unit_requested) = requested.split_once(' ').unwrap_or((&requested, ""));
    if unit == unit_requested || speed == "0" {
        format!("{speed} of {requested}")
    } else {
        format!("{applied} of {requested}")
    }
}

/// Limits in the directions of `velocity`, m/s and rad/s; infinite if there is no limit.
const fn allowed(monitor: CollisionMonitorState, velocity: Velocity) -> [f32; 2] {
    match monitor {
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

/// Whether the collision monitor stops a driven vehicle completely.
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

/// Text of the collision monitor's row. `greatest` are the vehicle's speed limits, m/s and rad/s. It names the
/// requested direction, or ahead if there is no request. In states that stop the motors it names no direction. Nothing
/// limits a vehicle that moves by its own program, so without a driver the limit is that of operators.
pub(super) fn monitor_text(
    teleop: &TeleopStatus,
    StrictestLimit {
        monitor,
        is_intermittent,
    }: StrictestLimit,
    greatest: [f32; 2],
) -> (Tone, String) {
    let limits = match teleop.state {
        TeleopState::SafeBoot | TeleopState::EStop | TeleopState::Fault(_) => String::new(),
        _ => limits_text(teleop, monitor, is_intermittent, greatest),
    };
    // An idle vehicle may move by its own program, or drift.
    let nothing = match teleop.state {
        TeleopState::Held | TeleopState::Driving | TeleopState::Stopping(_) => ": nothing moves",
        _ => "",
    };
    match monitor {
        CollisionMonitorState::Silent => (Tone::Warning, format!("Silent{nothing}")),
        CollisionMonitorState::Off => (Tone::Warning, "Off".to_owned()),
        CollisionMonitorState::On(_) => (Tone::Good, format!("On{limits}")),
        CollisionMonitorState::UnknownSpace(_) => {
            (Tone::Warning, format!("Unknown ground{limits}"))
        }
        CollisionMonitorState::Stale => (Tone::Warning, format!("Its data is late{nothing}")),
    }
}

fn limits_text(
    teleop: &TeleopStatus,
    monitor: CollisionMonitorState,
    is_intermittent: [bool; 2],
    [speed_mps, turn_radps]: [f32; 2],
) -> String {
    let Velocity {
        linear_mps,
        angular_radps,
    } = teleop.requested;
    let [going, turning] = allowed(monitor, teleop.requested);
    let goes = linear_mps.abs() >= MIN_SHOWN_MPS;
    let turns = angular_radps.abs() >= MIN_SHOWN_RADPS;
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
        return if teleop.clamp == Some(Clamp::CollisionMonitor) {
            // It limits another direction, usually the turn.
            ", limits it".to_owned()
        } else if is_free && matches!(monitor, CollisionMonitorState::On(_)) {
            format!(", {way} is free")
        } else {
            String::new()
        };
    }
    let at_times = if is_intermittent[usize::from(of_turn)] {
        " at times"
    } else {
        ""
    };
    let for_whom = if teleop.state == TeleopState::Idle {
        " for operators"
    } else {
        ""
    };
    if allowed < least {
        format!(", {way} is blocked{at_times}{for_whom}")
    } else if of_turn {
        let deg = signed(f64::from(allowed.to_degrees()), 0);
        format!(", {way} ≤ {deg} °/s{at_times}")
    } else {
        format!(", {way} ≤ {allowed:.2} m/s{at_times}{for_whom}")
    }
}

/// The collision monitor's state, with the strictest recent limits on the axes whose limit alternates from scan to scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StrictestLimit {
    pub(super) monitor: CollisionMonitorState,
    pub(super) is_intermittent: [bool; 2],
}

/// Of the `recent` reports (oldest first), those with the same requested direction count.
pub(super) fn strictest_limit<'a>(
    teleop: &TeleopStatus,
    recent: impl Iterator<Item = &'a MonitorReport> + Clone,
) -> StrictestLimit {
    let Some((is_blind, now)) = limits(teleop.collision_monitor) else {
        return StrictestLimit {
            monitor: teleop.collision_monitor,
            is_intermittent: [false; 2],
        };
    };
    let asked = direction_signs(teleop.requested);
    let recent = recent
        .filter(|report| direction_signs(report.requested) == asked)
        .filter_map(|report| limits(report.state));
    let tight = recent.clone().fold(now, |strictest_limit, (_, recent)| {
        least(strictest_limit, recent)
    });
    let of = |limits: SpeedLimits| allowed(CollisionMonitorState::On(limits), teleop.requested);
    let is_intermittent =
        [(0, MIN_SHOWN_MPS), (1, MIN_SHOWN_RADPS)].map(|(axis, nothing): (usize, f32)| {
            let bound = LOOSER_FACTOR * of(tight)[axis].max(nothing);
            alternates(recent.clone().map(|(_, recent)| of(recent)[axis] <= bound))
        });
    let [going, turning] = is_intermittent.map(|is_so| if is_so { tight } else { now });
    let limits = SpeedLimits {
        forward_mps: going.forward_mps,
        reverse_mps: going.reverse_mps,
        left_radps: turning.left_radps,
        right_radps: turning.right_radps,
    };
    let is_blind = is_blind || alternates(recent.map(|(is_blind, _)| is_blind));
    StrictestLimit {
        monitor: if is_blind {
            CollisionMonitorState::UnknownSpace(limits)
        } else {
            CollisionMonitorState::On(limits)
        },
        is_intermittent,
    }
}

const fn limits(monitor: CollisionMonitorState) -> Option<(bool, SpeedLimits)> {
    match monitor {
        CollisionMonitorState::On(limits) => Some((false, limits)),
        CollisionMonitorState::UnknownSpace(limits) => Some((true, limits)),
        _ => None,
    }
}

fn alternates(recent: impl Iterator<Item = bool> + Clone) -> bool {
    let changes = recent.clone().zip(recent.skip(1));
    changes.filter(|(one, next)| one != next).count() > 1
}

const fn least(one: SpeedLimits, other: SpeedLimits) -> SpeedLimits {
    SpeedLimits {
        forward_mps: one.forward_mps.min(other.forward_mps),
        reverse_mps: one.reverse_mps.min(other.reverse_mps),
        left_radps: one.left_radps.min(other.left_radps),
        right_radps: one.right_radps.min(other.right_radps),
    }
}

/// Whether a limit reason only says that the vehicle accelerates or brakes.
pub(super) fn is_transient(words: &str) -> bool {
    [SPEEDING_UP, SLOWING_DOWN, CHANGING_DIRECTION].contains(&words)
}

/// A stuck vehicle neither accelerates nor brakes: only the collision monitor is a reason then.
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
    // The monitor brakes no harder than a stop does: meanwhile the applied speed is above its limit.
    if teleop.state == TeleopState::Driving && exceeds_limit(teleop) {
        let asked = parts(teleop.requested).map(|speed| speed > 0.0);
        let [going, turning] = strictest_limit.is_intermittent;
        return Some(if going && asked[0] || turning && asked[1] {
            limited_by(Clamp::CollisionMonitor)
        } else {
            approaching_limit(SLOWING_DOWN, Clamp::CollisionMonitor)
        });
    }
    match clamp? {
        Clamp::Stop => None,
        Clamp::Ramp => Some(acceleration_reason(teleop, strictest_limit.monitor)),
        clamp => Some(limited_by(clamp)),
    }
}

fn limited_by(clamp: Clamp) -> String {
    format!("Limited by {}", labels::clamp(clamp))
}

fn approaching_limit(how: &str, to: Clamp) -> String {
    format!("{how} as {} allows", labels::clamp(to))
}

/// While it accelerates, a limit below the requested speed is a more useful reason than the ramp.
fn acceleration_reason(teleop: &TeleopStatus, monitor: CollisionMonitorState) -> String {
    let (asked, applied) = (teleop.requested, teleop.applied);
    let turns_round = asked.linear_mps * applied.linear_mps < 0.0
        || asked.angular_radps * applied.angular_radps < 0.0;
    if turns_round {
        return CHANGING_DIRECTION.to_owned();
    }
    let Some((clamp, share)) = strictest_share(teleop, monitor) else {
        let speeds_up = exceeds(parts(asked), parts(applied));
        return if speeds_up { SPEEDING_UP } else { SLOWING_DOWN }.to_owned();
    };
    let most = parts(asked).map(|speed| share * speed);
    if exceeds(most, parts(applied)) {
        approaching_limit(SPEEDING_UP, clamp)
    } else {
        limited_by(clamp)
    }
}

/// As a share of the requested motion: the robot scales both speeds alike, so that the curvature stays.
fn strictest_share(teleop: &TeleopStatus, monitor: CollisionMonitorState) -> Option<(Clamp, f32)> {
    let share = |speed: f32, allowed: f32| {
        if speed > allowed {
            allowed / speed
        } else {
            1.0
        }
    };
    let [goes, turns] = parts(teleop.requested);
    let [going, turning] = allowed(monitor, teleop.requested);
    let by_monitor = share(goes, going).min(share(turns, turning));
    let by_age = share(goes, teleop.speed_allowed_mps);
    let strictest_share = if by_monitor < by_age {
        (Clamp::CollisionMonitor, by_monitor)
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

/// Absolute linear and angular speed, m/s and rad/s.
const fn parts(velocity: Velocity) -> [f32; 2] {
    [velocity.linear_mps.abs(), velocity.angular_radps.abs()]
}

/// Whether one is faster than the other on an axis after rounding for display, m/s and rad/s.
fn exceeds(one: [f32; 2], other: [f32; 2]) -> bool {
    let is_more = |one: f32, other: f32, decimals| {
        let figure = |speed: f32| signed(f64::from(speed), decimals);
        one > other && figure(one) != figure(other)
    };
    is_more(one[0], other[0], 2) || is_more(one[1].to_degrees(), other[1].to_degrees(), 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::idle_teleop_status;

    #[test]
    fn equal_rounded_speeds_are_not_held_back() {
        for (applied, requested, figures, is_held_back) in [
            (0.185, 0.199, "11 of 11 °/s left", false),
            (0.17, 0.199, "10 of 11 °/s left", true),
            (-0.185, 0.199, "11 °/s right of 11 °/s left", true),
        ] {
            let mut teleop = idle_teleop_status();
            teleop.applied.angular_radps = applied;
            teleop.requested.angular_radps = requested;
            let [_, turning] = gauges(&teleop, [1.0, 0.5], true);
            assert_eq!(turning.figures, figures);
            assert_eq!(turning.is_held_back(), is_held_back, "{figures}");
        }
    }

    #[test]
    fn angular_speed_text() {
        for (applied_radps, requested_radps, expected) in [
            (0.0, 0.0, "0 of 0 °/s"),
            (0.2, 0.4, "11 of 23 °/s left"),
            (-0.2, -0.4, "11 of 23 °/s right"),
            (0.0, -0.4, "0 of 23 °/s right"),
            (0.001, -0.4, "0 of 23 °/s right"),
            (0.2, 0.0, "11 °/s left of 0 °/s"),
            (-0.2, 0.4, "11 °/s right of 23 °/s left"),
        ] {
            assert_eq!(turn_of(applied_radps, requested_radps), expected);
        }
    }
}
