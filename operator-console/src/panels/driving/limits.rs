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

/// Gauges of linear and angular speed, and of lateral speed where it can go sideways; `limits` are m/s, m/s and rad/s.
pub(super) fn gauges(teleop: &TeleopStatus, limits: [f32; 3], is_driven: bool) -> Vec<Gauge> {
    let [requested, applied] = [teleop.requested, teleop.applied];
    let [speed_mps, lateral_mps, turn_rate_radps] = limits;
    let figures = |words: String| if is_driven { words } else { "–".to_owned() };
    // Left turns are on the left side of the gauge.
    let to_the_right = |velocity: Velocity| -velocity.angular_radps.to_degrees();
    let mut gauges = vec![
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
    ];
    if lateral_mps > 0.0 {
        gauges.push(Gauge {
            name: "Lateral speed",
            figures: figures(format!(
                "{} of {} m/s to the left",
                signed(f64::from(applied.lateral_mps), 2),
                signed(f64::from(requested.lateral_mps), 2)
            )),
            requested: -requested.lateral_mps,
            applied: -applied.lateral_mps,
            limit: lateral_mps,
            decimals: 2,
            ends: ["left", "right"],
        });
    }
    gauges
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

/// Limits in the directions of `velocity`: linear, lateral, angular; infinite if there is no limit.
const fn allowed(monitor: CollisionMonitorState, velocity: Velocity) -> [f32; 3] {
    match monitor {
        CollisionMonitorState::On(limits) | CollisionMonitorState::UnknownSpace(limits) => [
            if velocity.linear_mps <= -MIN_SHOWN_MPS {
                limits.reverse_mps
            } else {
                limits.forward_mps
            },
            if velocity.lateral_mps.abs() < MIN_SHOWN_MPS {
                f32::INFINITY
            } else if velocity.lateral_mps > 0.0 {
                limits.left_mps
            } else {
                limits.right_mps
            },
            if velocity.angular_radps > 0.0 {
                limits.left_radps
            } else {
                limits.right_radps
            },
        ],
        CollisionMonitorState::Silent
        | CollisionMonitorState::Off
        | CollisionMonitorState::Stale => [f32::INFINITY; 3],
    }
}

/// Whether the collision monitor stops a driven vehicle completely.
pub(crate) fn is_stopped_by_monitor(teleop: &TeleopStatus) -> bool {
    teleop.state == TeleopState::Driving
        && teleop.clamp == Some(Clamp::CollisionMonitor)
        && direction_signs(teleop.applied) == [0; 3]
}

/// Text of the collision monitor's row. `greatest` are the vehicle's speed limits: linear, lateral, angular. It names the
/// requested direction, or ahead if there is no request. In states that stop the motors it names no direction. Nothing
/// limits a vehicle that moves by its own program, so without a driver the limit is that of operators.
pub(super) fn monitor_text(
    teleop: &TeleopStatus,
    StrictestLimit {
        monitor,
        is_intermittent,
    }: StrictestLimit,
    greatest: [f32; 3],
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
    is_intermittent: [bool; 3],
    greatest: [f32; 3],
) -> String {
    let (allowed, speeds) = (allowed(monitor, teleop.requested), parts(teleop.requested));
    let signs = direction_signs(teleop.requested);
    // The axis that binds most, else the first one in use.
    let is_bound = |axis: usize| allowed[axis] < FREE * speeds[axis];
    let in_use = || (0..3).filter(|axis| signs[*axis] != 0);
    let axis = in_use()
        .find(|&axis| is_bound(axis))
        .or_else(|| in_use().next())
        .unwrap_or(0);
    let way = match (axis, signs[axis] < 0) {
        (0, false) => "ahead",
        (0, true) => "behind",
        (1, false) => "to the left",
        (1, true) => "to the right",
        (_, false) => "turning left",
        (_, true) => "turning right",
    };
    let of_turn = axis == 2;
    let (allowed, greatest) = (allowed[axis], greatest[axis]);
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
    let at_times = if is_intermittent[axis] {
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
    pub(super) is_intermittent: [bool; 3],
}

/// Of the `recent` reports (oldest first), those with the same requested direction count.
pub(super) fn strictest_limit<'a>(
    teleop: &TeleopStatus,
    recent: impl Iterator<Item = &'a MonitorReport> + Clone,
) -> StrictestLimit {
    let Some((is_blind, now)) = limits(teleop.collision_monitor) else {
        return StrictestLimit {
            monitor: teleop.collision_monitor,
            is_intermittent: [false; 3],
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
    let is_intermittent = [(0, MIN_SHOWN_MPS), (1, MIN_SHOWN_MPS), (2, MIN_SHOWN_RADPS)].map(
        |(axis, nothing): (usize, f32)| {
            let bound = LOOSER_FACTOR * of(tight)[axis].max(nothing);
            alternates(recent.clone().map(|(_, recent)| of(recent)[axis] <= bound))
        },
    );
    let [going, sideways, turning] = is_intermittent.map(|is_so| if is_so { tight } else { now });
    let limits = SpeedLimits {
        forward_mps: going.forward_mps,
        reverse_mps: going.reverse_mps,
        left_mps: sideways.left_mps,
        right_mps: sideways.right_mps,
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
        left_mps: one.left_mps.min(other.left_mps),
        right_mps: one.right_mps.min(other.right_mps),
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
    gauges: &[Gauge],
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
        let mut asked = strictest_limit
            .is_intermittent
            .iter()
            .zip(parts(teleop.requested));
        return Some(
            if asked.any(|(is_intermittent, speed)| *is_intermittent && speed > 0.0) {
                limited_by(Clamp::CollisionMonitor)
            } else {
                approaching_limit(SLOWING_DOWN, Clamp::CollisionMonitor)
            },
        );
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
        || asked.lateral_mps * applied.lateral_mps < 0.0
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
    let asked = parts(teleop.requested);
    let allowed = allowed(monitor, teleop.requested);
    let by_monitor = (0..3).map(|axis| share(asked[axis], allowed[axis]));
    let by_monitor = by_monitor.fold(1.0, f32::min);
    let by_age = share(asked[0].hypot(asked[1]), teleop.speed_allowed_mps);
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

/// Absolute linear, lateral and angular speed.
const fn parts(velocity: Velocity) -> [f32; 3] {
    [
        velocity.linear_mps.abs(),
        velocity.lateral_mps.abs(),
        velocity.angular_radps.abs(),
    ]
}

/// Whether one is faster than the other on an axis after rounding for display: linear, lateral, angular.
fn exceeds(one: [f32; 3], other: [f32; 3]) -> bool {
    let is_more = |one: f32, other: f32, decimals| {
        let figure = |speed: f32| signed(f64::from(speed), decimals);
        one > other && figure(one) != figure(other)
    };
    is_more(one[0], other[0], 2)
        || is_more(one[1], other[1], 2)
        || is_more(one[2].to_degrees(), other[2].to_degrees(), 0)
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
            let [_, turning] = &gauges(&teleop, [1.0, 0.0, 0.5], true)[..] else {
                unreachable!()
            };
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
