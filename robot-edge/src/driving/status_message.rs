//! Between the arbiter's terms and those of the protocol.

use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;
use protocol::message::{
    self, Answer, CollisionMonitorState, CommandCounters, Drive, EStopStatus, LeaseStatus,
    RefusedCount, Settings, TeleopState, TeleopStatus,
};
use protocol::signed::{CommandHeader, SignedError};

use teleop::arbiter::{FaultReason, StopReason};
use teleop::arming::Arming;
use teleop::collision_monitor::{Barrier, BarrierKind};
use teleop::report::Clamp;
use teleop::{
    self, AgeToken, CollisionMonitorOutput, Mode, OperatorId, Refusal, TeleopReport, Velocity,
};

mod event_text;
mod reason_text;

pub(super) use event_text::event_text;
use reason_text::stop_reason;

/// What can be switched beside the arbiter, and what is counted there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct RuntimeSettings {
    /// Bytes for tiles, kbit/s.
    pub budget_kbps: u32,
    /// Whether the collision monitor is on.
    pub collision_monitor: bool,
    /// Whether recordings can be started and stopped.
    pub can_record: bool,
    /// Whether one runs.
    pub recording: bool,
    /// Messages that were dropped because too many pendinged.
    pub dropped: u64,
    /// Why it stopped last.
    pub last_stop: Option<StopReason>,
}

pub(super) fn token(stamp: &CommandHeader) -> AgeToken {
    AgeToken {
        boot_id: u128::from_be_bytes(stamp.boot.0),
        n: stamp.token.n,
        nonce: stamp.token.nonce,
    }
}

pub(super) fn velocity(drive: &Drive) -> Velocity {
    Velocity {
        linear_mps: drive.linear_mps.into(),
        angular_radps: drive.angular_radps.into(),
    }
}

/// Why a message was refused before the arbiter saw it.
pub(super) const fn refusal_for(error: &SignedError) -> Refusal {
    match error {
        SignedError::TooLong(_) | SignedError::Unreadable(_) => Refusal::Malformed,
        SignedError::Signature => Refusal::Signature,
    }
}

pub(super) const fn refusal(refusal: Refusal) -> message::Refusal {
    match refusal {
        Refusal::Malformed => message::Refusal::Malformed,
        Refusal::TooMany => message::Refusal::TooMany,
        Refusal::Signature => message::Refusal::Signature,
        Refusal::Role => message::Refusal::Role,
        Refusal::OtherBoot => message::Refusal::OtherBoot,
        Refusal::UnknownToken => message::Refusal::UnknownToken,
        Refusal::WrongNonce => message::Refusal::WrongNonce,
        Refusal::TooOld => message::Refusal::TooOld,
        Refusal::NotHolder => message::Refusal::NotHolder,
        Refusal::OtherEpoch => message::Refusal::OtherEpoch,
        Refusal::OldSequence => message::Refusal::OldSequence,
        Refusal::NotFinite => message::Refusal::NotFinite,
        Refusal::NotReady => message::Refusal::NotReady,
        Refusal::Busy => message::Refusal::Busy,
        Refusal::NotWaiting => message::Refusal::NotWaiting,
        Refusal::NoEStop => message::Refusal::NoEStop,
        Refusal::OtherEStop => message::Refusal::OtherEStop,
        Refusal::EStopNotStored => message::Refusal::EStopNotStored,
        Refusal::EStopSince => message::Refusal::EStopSince,
    }
}

pub(super) const fn answer(answer: teleop::Answer) -> Answer {
    match answer {
        teleop::Answer::Granted { epoch } => Answer::Granted(epoch),
        teleop::Answer::Waiting => Answer::Waiting,
        teleop::Answer::Done => Answer::Done,
        teleop::Answer::EStopped(id) => Answer::EStopped(id.0),
        teleop::Answer::Refused(why) => Answer::Refused(refusal(why)),
    }
}

/// What the collision monitor knows beside its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MonitorDetail {
    /// What bounds the motion that is asked for.
    pub barrier: Option<Barrier>,
    /// How long ago the ground on each side was looked at last: ahead, to the left, behind, to the right.
    pub side_ground_ages: [Option<Duration>; 4],
}

/// How driving is going, for everybody.
pub(super) fn status(
    (report, detail): (&TeleopReport, MonitorDetail),
    names: &[OperatorName],
    runtime_settings: RuntimeSettings,
) -> TeleopStatus {
    let name = |id: OperatorId| names.get(id.0 as usize).cloned();
    let lease = report.lease;
    let detail = match report.collision_monitor {
        Some(CollisionMonitorOutput::Limits(_)) => detail,
        None | Some(CollisionMonitorOutput::Off | CollisionMonitorOutput::Stale) => {
            MonitorDetail::default()
        }
    };
    let ms = |age: Duration| u32::try_from(age.as_millis()).unwrap_or(u32::MAX);
    TeleopStatus {
        state: state(report.mode),
        last_stop: runtime_settings.last_stop.map(stop_reason),
        is_drifting: report.is_drifting,
        lease: LeaseStatus {
            epoch: lease.epoch,
            holder: lease.holder.and_then(|holder| name(holder.operator)),
            next: lease.next.and_then(|(next, _)| name(next)),
            waiting: lease.waiting.and_then(|waiting| name(waiting.operator)),
        },
        arming: match report.arming {
            Arming::Locked => message::Arming::Locked,
            Arming::Neutral { .. } => message::Arming::Neutral,
            Arming::Pressed => message::Arming::Pressed,
        },
        age_ms: report.age.map(ms),
        peak_age_ms: report.peak_age.map(ms),
        speed_allowed_mps: report.speed_allowed_mps as f32,
        requested: wire_velocity(report.requested),
        applied: wire_velocity(report.applied),
        clamp: report.clamp.map(|clamp| match clamp {
            Clamp::Vehicle => message::Clamp::Speed,
            Clamp::Age => message::Clamp::Age,
            Clamp::CollisionMonitor => message::Clamp::CollisionMonitor,
            Clamp::Ramp => message::Clamp::Ramp,
        }),
        collision_monitor: collision_monitor(report.collision_monitor),
        estop: report.estop.map(|estop| EStopStatus {
            number: estop.id.0,
            is_stored: estop.is_stored,
        }),
        counters: counters(report, runtime_settings.dropped),
        settings: Settings {
            budget_kbps: runtime_settings.budget_kbps,
            collision_monitor: runtime_settings.collision_monitor,
            recording: runtime_settings.recording,
        },
        barrier: detail.barrier.map(wire_barrier),
        ground_age_ms: detail.side_ground_ages.map(|age| age.map(ms)),
    }
}

const fn state(mode: Mode) -> TeleopState {
    match mode {
        Mode::SafeBoot => TeleopState::SafeBoot,
        Mode::Idle => TeleopState::Idle,
        Mode::Held => TeleopState::Held,
        Mode::Driving => TeleopState::Driving,
        Mode::Stopping { reason, .. } => TeleopState::Stopping(stop_reason(reason)),
        Mode::EStop => TeleopState::EStop,
        Mode::Fault(FaultReason::SelfTest) => TeleopState::Fault(message::FaultReason::SelfTest),
        Mode::Fault(FaultReason::Actuator) => TeleopState::Fault(message::FaultReason::Actuator),
    }
}

fn collision_monitor(output: Option<CollisionMonitorOutput>) -> CollisionMonitorState {
    match output {
        None => CollisionMonitorState::Silent,
        Some(CollisionMonitorOutput::Off) => CollisionMonitorState::Off,
        Some(CollisionMonitorOutput::Stale) => CollisionMonitorState::Stale,
        Some(CollisionMonitorOutput::Limits(limits)) => {
            let shown = message::SpeedLimits {
                forward_mps: limits.forward_mps as f32,
                reverse_mps: limits.reverse_mps as f32,
                left_radps: limits.left_radps as f32,
                right_radps: limits.right_radps as f32,
            };
            if limits.in_unknown_space {
                CollisionMonitorState::UnknownSpace(shown)
            } else {
                CollisionMonitorState::On(shown)
            }
        }
    }
}

fn wire_barrier(barrier: Barrier) -> message::Barrier {
    message::Barrier {
        position_m: barrier.position_in_odom.map(|along_m| along_m as f32),
        kind: match barrier.kind {
            BarrierKind::Detected => message::BarrierKind::Detected,
            BarrierKind::Mapped => message::BarrierKind::Mapped,
            BarrierKind::Unknown => message::BarrierKind::Unknown,
            BarrierKind::Shallow => message::BarrierKind::Shallow,
            BarrierKind::NoReturn => message::BarrierKind::NoReturn,
        },
    }
}

fn counters(report: &TeleopReport, dropped: u64) -> CommandCounters {
    let counters = report.counters;
    let refused = Refusal::ALL.into_iter().map(|why| {
        let beside = if why == Refusal::TooMany { dropped } else { 0 };
        RefusedCount {
            reason: refusal(why),
            count: counters.refused(why).saturating_add(beside),
        }
    });
    let mut refused: Vec<_> = refused.filter(|refused| refused.count > 0).collect();
    refused.sort_by_key(|refused| refused.reason);
    CommandCounters {
        accepted: counters.accepted,
        involuntary_stops: counters.involuntary_stops,
        refused,
    }
}

const fn wire_velocity(velocity: Velocity) -> message::Velocity {
    message::Velocity {
        linear_mps: velocity.linear_mps as f32,
        angular_radps: velocity.angular_radps as f32,
    }
}
