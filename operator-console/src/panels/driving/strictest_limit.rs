//! The tightest of what the collision monitor said lately, for its row, where it says now this and now that: words that come
//! and go with every scan are not read, and the looser ones hide why the vehicle slows down.

use protocol::message::{CollisionMonitorState, SpeedLimits, TeleopStatus};

use super::guard::allowed;
use crate::model::{MIN_SHOWN_MPS, MIN_SHOWN_RADPS, MonitorReport, direction_signs};

/// What allows so many times as much is looser, and not only another measurement.
const LOOSER_FACTOR: f32 = 1.1;

/// What the guard allows, and where it changes that by turns, the least of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StrictestLimit {
    pub(super) guard: CollisionMonitorState,
    /// Of going and of turning: whether it sets that limit, and lifts it, by turns.
    pub(super) is_intermittent: [bool; 2],
}

/// What the guard allows, by what it said `lately` of the way that is asked for now, the oldest first. Late data, silence and a
/// guard that is off are no limits, and are told as they are.
pub(super) fn strictest_limit<'a>(
    teleop: &TeleopStatus,
    lately: impl Iterator<Item = &'a MonitorReport> + Clone,
) -> StrictestLimit {
    let Some((is_blind, now)) = limits(teleop.collision_monitor) else {
        return StrictestLimit {
            guard: teleop.collision_monitor,
            is_intermittent: [false; 2],
        };
    };
    let asked = direction_signs(teleop.requested);
    let of_way = lately.filter(|recent| direction_signs(recent.requested) == asked);
    let recent = of_way.filter_map(|recent| limits(recent.guard));
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
        guard: if is_blind {
            CollisionMonitorState::UnknownSpace(limits)
        } else {
            CollisionMonitorState::On(limits)
        },
        is_intermittent,
    }
}

/// Its limits, and whether it sets them as it sees too little.
const fn limits(guard: CollisionMonitorState) -> Option<(bool, SpeedLimits)> {
    match guard {
        CollisionMonitorState::On(limits) => Some((false, limits)),
        CollisionMonitorState::UnknownSpace(limits) => Some((true, limits)),
        CollisionMonitorState::Silent
        | CollisionMonitorState::Off
        | CollisionMonitorState::Stale => None,
    }
}

/// Whether something was so, then not, and then so again, or the other way round.
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
