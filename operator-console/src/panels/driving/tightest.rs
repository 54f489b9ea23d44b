//! The tightest of what the collision guard said lately, for its row: words that come and go with every scan are not
//! read, and the looser ones hide why the vehicle slows down.

use protocol::message::{Guard, GuardLimits, TeleopStatus, Velocity};

use super::guard::{LEAST_MPS, LEAST_RADPS};
use crate::model::Guarding;

/// What the guard allows at least, of what it said `lately` of the way that is asked for now. Late data, silence and a
/// guard that is off are no limits, and are told as they are.
pub(super) fn tightest<'a>(
    teleop: &TeleopStatus,
    lately: impl Iterator<Item = &'a Guarding>,
) -> Guard {
    let asked = way(teleop.requested);
    lately
        .filter(|told| way(told.requested) == asked)
        .fold(teleop.guard, |tightest, told| tighter(tightest, told.guard))
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
