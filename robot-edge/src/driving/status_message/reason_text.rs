//! Why the vehicle stops and why somebody no longer drives: in words, and on the wire.

use protocol::message;

use teleop::arbiter::StopReason;
use teleop::lease::LeaseEnd;

/// Why the vehicle stops, in words.
pub(super) const fn stop_reason_text(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Released => "nothing is pressed",
        StopReason::Age => "the commands are too old",
        StopReason::NotFinite => "what was asked for is no number",
        StopReason::CollisionMonitorStale => "the collision monitor could not judge",
        StopReason::LeaseEnded(why) => lease_end_text(why),
    }
}

/// Why somebody no longer drives, in words: of them, and of the vehicle that stops for it.
pub(super) const fn lease_end_text(lease: LeaseEnd) -> &'static str {
    match lease {
        LeaseEnd::Released => "the lease was released",
        LeaseEnd::Expired => "no command came",
        LeaseEnd::Renewed => "the lease was requested again",
        LeaseEnd::HandedOver => "the lease was handed over",
        LeaseEnd::TakenOver => "a supervisor took the lease",
        LeaseEnd::Revoked => "the leave to drive was taken away",
        LeaseEnd::Reset => "an emergency stop was reset",
        LeaseEnd::Fault => "the vehicle is at fault",
    }
}

/// Why the vehicle stops, on the wire.
pub(super) const fn stop_reason(reason: StopReason) -> message::StopReason {
    match reason {
        StopReason::Released => message::StopReason::Released,
        StopReason::Age => message::StopReason::Age,
        StopReason::NotFinite => message::StopReason::NotFinite,
        StopReason::CollisionMonitorStale => message::StopReason::CollisionMonitorStale,
        StopReason::LeaseEnded(why) => message::StopReason::LeaseEnded(lease_end(why)),
    }
}

const fn lease_end(lease: LeaseEnd) -> message::LeaseEnd {
    match lease {
        LeaseEnd::Released => message::LeaseEnd::Released,
        LeaseEnd::Expired => message::LeaseEnd::Expired,
        LeaseEnd::Renewed => message::LeaseEnd::Renewed,
        LeaseEnd::HandedOver => message::LeaseEnd::HandedOver,
        LeaseEnd::TakenOver => message::LeaseEnd::TakenOver,
        LeaseEnd::Revoked => message::LeaseEnd::Revoked,
        LeaseEnd::Reset => message::LeaseEnd::Reset,
        LeaseEnd::Fault => message::LeaseEnd::Fault,
    }
}
