//! The tightest of what the collision guard said lately, for its row, where it says now this and now that: words that come
//! and go with every scan are not read, and the looser ones hide why the vehicle slows down.

use protocol::message::{Guard, GuardLimits, TeleopStatus};

use super::guard::allowed;
use crate::model::{Guarding, LEAST_MPS, LEAST_RADPS, way};

/// What allows so many times as much is looser, and not only another measurement.
const LOOSER: f32 = 1.1;

/// What the guard allows, and where it changes that by turns, the least of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tightest {
    pub(super) guard: Guard,
    /// Of going and of turning: whether it sets that limit, and lifts it, by turns.
    pub(super) comes_and_goes: [bool; 2],
}

/// What the guard allows, by what it said `lately` of the way that is asked for now, the oldest first. Late data, silence and a
/// guard that is off are no limits, and are told as they are.
pub(super) fn tightest<'a>(
    teleop: &TeleopStatus,
    lately: impl Iterator<Item = &'a Guarding> + Clone,
) -> Tightest {
    let Some((is_blind, now)) = limits(teleop.guard) else {
        return Tightest {
            guard: teleop.guard,
            comes_and_goes: [false; 2],
        };
    };
    let asked = way(teleop.requested);
    let of_way = lately.filter(|told| way(told.requested) == asked);
    let told = of_way.filter_map(|told| limits(told.guard));
    let tight = told
        .clone()
        .fold(now, |tightest, (_, told)| least(tightest, told));
    let of = |limits: GuardLimits| allowed(Guard::On(limits), teleop.requested);
    let comes_and_goes = [(0, LEAST_MPS), (1, LEAST_RADPS)].map(|(axis, nothing): (usize, f32)| {
        let bound = LOOSER * of(tight)[axis].max(nothing);
        changes_by_turns(told.clone().map(|(_, told)| of(told)[axis] <= bound))
    });
    let [going, turning] = comes_and_goes.map(|is_so| if is_so { tight } else { now });
    let limits = GuardLimits {
        forward_mps: going.forward_mps,
        reverse_mps: going.reverse_mps,
        left_radps: turning.left_radps,
        right_radps: turning.right_radps,
    };
    let is_blind = is_blind || changes_by_turns(told.map(|(is_blind, _)| is_blind));
    Tightest {
        guard: if is_blind {
            Guard::Blind(limits)
        } else {
            Guard::On(limits)
        },
        comes_and_goes,
    }
}

/// Its limits, and whether it sets them as it sees too little.
const fn limits(guard: Guard) -> Option<(bool, GuardLimits)> {
    match guard {
        Guard::On(limits) => Some((false, limits)),
        Guard::Blind(limits) => Some((true, limits)),
        Guard::Silent | Guard::Off | Guard::Stale => None,
    }
}

/// Whether something was so, then not, and then so again, or the other way round.
fn changes_by_turns(told: impl Iterator<Item = bool> + Clone) -> bool {
    let changes = told.clone().zip(told.skip(1));
    changes.filter(|(one, next)| one != next).count() > 1
}

const fn least(one: GuardLimits, other: GuardLimits) -> GuardLimits {
    GuardLimits {
        forward_mps: one.forward_mps.min(other.forward_mps),
        reverse_mps: one.reverse_mps.min(other.reverse_mps),
        left_radps: one.left_radps.min(other.left_radps),
        right_radps: one.right_radps.min(other.right_radps),
    }
}
