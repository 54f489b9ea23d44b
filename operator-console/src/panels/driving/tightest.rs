//! The tightest of what the collision guard said lately, for its row: words that come and go with every scan are not
//! read, and the looser ones hide why the vehicle slows down.

use protocol::message::{Guard, GuardLimits, TeleopStatus, Velocity};

use super::guard::{LEAST_MPS, LEAST_RADPS, allowed};
use crate::model::Guarding;

/// What allows so many times as much is looser, and not only another measurement.
const LOOSER: f32 = 1.1;

/// What the guard allows at least, and whether that holds at times only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tightest {
    pub(super) guard: Guard,
    /// Of going and of turning: it has let more through since it said that.
    pub(super) is_looser: [bool; 2],
}

/// What the guard allows at least, of what it said `lately` of the way that is asked for now, the oldest first. Late
/// data, silence and a guard that is off are no limits, and are told as they are.
pub(super) fn tightest<'a>(
    teleop: &TeleopStatus,
    lately: impl Iterator<Item = &'a Guarding> + Clone,
) -> Tightest {
    let asked = way(teleop.requested);
    let of_way = lately.filter(|told| way(told.requested) == asked);
    let guard = of_way
        .clone()
        .fold(teleop.guard, |tightest, told| tighter(tightest, told.guard));
    let least = allowed(guard, teleop.requested);
    let limits = of_way.filter(|told| matches!(told.guard, Guard::On(_) | Guard::Blind(_)));
    let limits = limits.map(|told| allowed(told.guard, teleop.requested));
    let is_looser = [(0, LEAST_MPS), (1, LEAST_RADPS)].map(|(axis, nothing): (usize, f32)| {
        let tight = LOOSER * least[axis].max(nothing);
        let mut since = limits.clone().skip_while(|told| told[axis] > tight);
        since.any(|told| told[axis] > tight)
    });
    Tightest { guard, is_looser }
}

/// Whither one goes and turns: 1 forwards and to the left, −1 back and to the right, 0 neither.
fn way(asked: Velocity) -> [i8; 2] {
    let sign = |speed: f32, least: f32| i8::from(speed >= least) - i8::from(speed <= -least);
    [
        sign(asked.linear_mps, LEAST_MPS),
        sign(asked.angular_radps, LEAST_RADPS),
    ]
}

const fn tighter(tightest: Guard, told: Guard) -> Guard {
    match (tightest, told) {
        (Guard::On(one), Guard::On(other)) => Guard::On(least(one, other)),
        (Guard::Blind(one), Guard::On(other) | Guard::Blind(other))
        | (Guard::On(one), Guard::Blind(other)) => Guard::Blind(least(one, other)),
        (Guard::Silent | Guard::Off | Guard::Stale, _)
        | (Guard::On(_) | Guard::Blind(_), Guard::Silent | Guard::Off | Guard::Stale) => tightest,
    }
}

const fn least(one: GuardLimits, other: GuardLimits) -> GuardLimits {
    GuardLimits {
        forward_mps: one.forward_mps.min(other.forward_mps),
        reverse_mps: one.reverse_mps.min(other.reverse_mps),
        left_radps: one.left_radps.min(other.left_radps),
        right_radps: one.right_radps.min(other.right_radps),
    }
}
