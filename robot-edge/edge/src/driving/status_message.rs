//! The state of driving as a message, and its events as text.

use std::time::Duration;

use protocol::keys::OperatorId as OperatorName;
use protocol::message::{
    self, CollisionMonitorState, CommandCounters, Drive, EStopStatus, FaultReason, GoalStatus,
    LeaseEnd, LeaseStatus, MapPose, MotorHold, Refusal, RefusedCount, Settings, StopReason,
    TeleopStatus,
};
use protocol::signed::{CommandHeader, SignedError};

use crate::driving::shared_drive_state::{DriveEvent, MonitorReenabled};
use teleop::collision_monitor::Barrier;
use teleop::{
    AgeToken, ArbiterEvent, CollisionMonitorOutput, EStopSource, GrantReason, Mode, OperatorId,
    TeleopReport, Velocity,
};

/// Settings, counters and measurements outside the arbiter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RuntimeSettings {
    pub budget_kbps: u32,
    pub collision_monitor: bool,
    pub can_record: bool,
    pub recording: bool,
    /// Messages dropped because the inbox was full.
    pub dropped: u64,
    pub last_stop: Option<StopReason>,
    pub battery_v: Option<f64>,
    pub motor_hold: Option<MotorHold>,
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
        lateral_mps: drive.lateral_mps.into(),
        angular_radps: drive.angular_radps.into(),
    }
}

/// Why a message was refused before it reached the arbiter.
pub(super) const fn refusal_for(error: &SignedError) -> Refusal {
    match error {
        SignedError::TooLong(_) | SignedError::Unreadable(_) => Refusal::Malformed,
        SignedError::Signature => Refusal::Signature,
    }
}

/// Information of the collision monitor beside its limits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MonitorDetail {
    /// What limits the requested motion.
    pub barrier: Option<Barrier>,
    /// Age of the last observation of the ground: ahead, left, behind, right.
    pub side_ground_ages: [Option<Duration>; 4],
}

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
        state: report.mode.teleop_state(),
        last_stop: runtime_settings.last_stop,
        is_drifting: report.is_drifting,
        lease: LeaseStatus {
            epoch: lease.epoch,
            holder: lease.holder.and_then(|holder| name(holder.operator)),
            next: lease.next.and_then(|(next, _)| name(next)),
            waiting: lease.waiting.and_then(|waiting| name(waiting.operator)),
        },
        arming: report.arming,
        age_ms: report.age.map(ms),
        peak_age_ms: report.peak_age.map(ms),
        speed_allowed_mps: report.speed_allowed_mps as f32,
        requested: wire_velocity(report.requested),
        applied: wire_velocity(report.applied),
        clamp: report.clamp,
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
        barrier: detail.barrier.map(|barrier| message::Barrier {
            position_m: barrier.position_in_odom.map(|along_m| along_m as f32),
            kind: barrier.kind,
        }),
        ground_age_ms: detail.side_ground_ages.map(|age| age.map(ms)),
        battery_v: runtime_settings.battery_v.map(|volts| volts as f32),
        docking: report.docking,
        motor_hold: runtime_settings.motor_hold,
        goal: GoalStatus {
            running: report.goal,
            last_end: report.last_goal_end,
            ..GoalStatus::default()
        },
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
                left_mps: limits.left_mps as f32,
                right_mps: limits.right_mps as f32,
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

fn counters(report: &TeleopReport, dropped: u64) -> CommandCounters {
    let counters = report.counters;
    let refused = Refusal::ALL.into_iter().map(|why| {
        let beside = if why == Refusal::TooMany { dropped } else { 0 };
        RefusedCount {
            reason: why,
            count: counters.refused(why).saturating_add(beside),
        }
    });
    CommandCounters {
        accepted: counters.accepted,
        involuntary_stops: counters.involuntary_stops,
        // `Refusal::ALL` rises.
        refused: refused.filter(|refused| refused.count > 0).collect(),
    }
}

const fn wire_velocity(velocity: Velocity) -> message::Velocity {
    message::Velocity {
        linear_mps: velocity.linear_mps as f32,
        lateral_mps: velocity.lateral_mps as f32,
        angular_radps: velocity.angular_radps as f32,
    }
}

pub(super) fn event_text(
    drive_event: &DriveEvent,
    names: &[OperatorName],
) -> (&'static str, String) {
    let name = |id: OperatorId| {
        let known = names.get(id.0 as usize);
        known.map_or_else(|| format!("operator {}", id.0), ToString::to_string)
    };
    let event = match drive_event.clone() {
        DriveEvent::Arbiter(event) => event,
        DriveEvent::MonitorUnavailable { unavailable_reason } => {
            let unavailable_reason = unavailable_reason.map_or_else(
                || "it did not respond".to_owned(),
                |unavailable_reason| unavailable_reason.to_string(),
            );
            return (
                "involuntary_stop",
                format!("stopping: the collision monitor could not judge, {unavailable_reason}"),
            );
        }
        DriveEvent::Motors(fault) => return ("motors", fault.to_string()),
        DriveEvent::MotorsHeld(Some(hold)) => return ("motors_held", hold.to_string()),
        DriveEvent::MotorsHeld(None) => {
            return ("autopilot", "the autopilot obeys velocities".to_owned());
        }
        DriveEvent::Autopilot(text) => return ("autopilot", text),
        DriveEvent::LoopFailed(failure) => return ("fault", failure.to_string()),
        DriveEvent::Recording { is_on, by } => {
            let done = if is_on { "started" } else { "stopped" };
            return (
                "recording",
                format!("a recording was {done} by {}", name(by)),
            );
        }
        DriveEvent::MonitorSwitched { is_on, by } => {
            let (kind, to) = if is_on {
                ("collision_monitor", "on")
            } else {
                ("collision_monitor_off", "off")
            };
            return (
                kind,
                format!("the collision monitor was switched {to} by {}", name(by)),
            );
        }
        DriveEvent::MonitorReenabled(why) => {
            let why = match why {
                MonitorReenabled::Granted(to) => format!("{} has the lease from now on", name(to)),
                MonitorReenabled::EStopped => "an emergency stop".to_owned(),
                MonitorReenabled::Reset => "a reset".to_owned(),
            };
            return (
                "collision_monitor",
                format!("the collision monitor is on again: {why}"),
            );
        }
    };
    match event {
        ArbiterEvent::ModeChanged { from, to } => {
            let text = match to {
                Mode::Stopping { reason, .. } => format!("stopping: {}", stop_reason_text(reason)),
                Mode::Idle | Mode::Held | Mode::Driving => {
                    format!("{}{}", ended_mode_text(from), mode_text(to))
                }
                Mode::SafeBoot | Mode::EStop | Mode::Fault(_) => mode_text(to).to_owned(),
            };
            (mode_event_kind(to), text)
        }
        ArbiterEvent::GoalStarted(MapPose { x_mm, y_mm, .. }) => {
            let [x_m, y_m] = [x_mm, y_mm].map(|along_mm| f64::from(along_mm) / 1000.0);
            ("goal", format!("a planner drives to {x_m:.2}, {y_m:.2}"))
        }
        ArbiterEvent::GoalEnded(why) => ("goal", format!("the goal has ended: {why}")),
        ArbiterEvent::LeaseRequested { by } => {
            ("lease_requested", format!("{} asks to drive", name(by)))
        }
        ArbiterEvent::LeaseGranted { to, how, .. } => {
            let how = match how {
                GrantReason::Request => "asked and the lease was free",
                GrantReason::HandOver => "it was handed over",
                GrantReason::TakeOver => "as supervisor, whoever drove",
            };
            ("lease_granted", format!("{} drives: {how}", name(to)))
        }
        ArbiterEvent::LeaseEnded { operator, why } => (
            "lease_ended",
            format!(
                "{} no longer drives: {}",
                name(operator),
                lease_end_text(why)
            ),
        ),
        ArbiterEvent::EStopped { id, by } => {
            let by = match by {
                Some(EStopSource::Operator(operator)) => name(operator),
                Some(EStopSource::Local) => "somebody at the vehicle".to_owned(),
                None => "the run before".to_owned(),
            };
            ("estop", format!("emergency stop {}, by {by}", id.0))
        }
        ArbiterEvent::Reset { id, by } => {
            let by = by.map_or_else(
                || "somebody at the vehicle".to_owned(),
                |caller| name(caller.operator),
            );
            (
                "estop_reset",
                format!("emergency stop {} reset by {by}", id.0),
            )
        }
        ArbiterEvent::Refused {
            caller, refusal, ..
        } => (
            "refused",
            format!("a request of {}: {refusal}", name(caller.operator)),
        ),
    }
}

/// Faults and involuntary stops have a kind of their own.
const fn mode_event_kind(to: Mode) -> &'static str {
    match to {
        Mode::Fault(_) => "fault",
        Mode::Stopping { reason, .. } if !reason.is_voluntary() => "involuntary_stop",
        Mode::SafeBoot
        | Mode::Idle
        | Mode::Held
        | Mode::Driving
        | Mode::Stopping { .. }
        | Mode::EStop => "teleop_state",
    }
}

/// The text of a mode; it also holds for a drifting boat.
const fn mode_text(mode: Mode) -> &'static str {
    match mode {
        Mode::SafeBoot => "the self-test runs",
        Mode::Idle => "nobody drives",
        Mode::Held => "waits for the driver's keys",
        Mode::Driving => "obeys the driver",
        Mode::Stopping { .. } => "stopping",
        Mode::EStop => "emergency stop: nothing moves until a reset",
        Mode::Fault(FaultReason::SelfTest) => "fault: the self-test failed",
        Mode::Fault(FaultReason::Actuator) => "fault: the motors do not respond",
    }
}

/// The prefix for a mode that kept operators from driving.
const fn ended_mode_text(from: Mode) -> &'static str {
    match from {
        Mode::SafeBoot => "self-test passed, ",
        Mode::EStop => "emergency stop over, ",
        // A fault ends in a self-test.
        Mode::Idle | Mode::Held | Mode::Driving | Mode::Stopping { .. } | Mode::Fault(_) => "",
    }
}

pub(super) const fn stop_reason_text(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Released => "nothing is pressed",
        StopReason::Age => "the commands are too old",
        StopReason::NotFinite => "what was asked for is no number",
        StopReason::CollisionMonitorStale => "the collision monitor could not judge",
        StopReason::LeaseEnded(why) => lease_end_text(why),
        StopReason::MotorsHeld => "the motors obey no velocity",
        StopReason::PlannerSilent => "the planner is silent",
        StopReason::PlannerFloods => "the planner sends too many velocities",
    }
}

/// The reason of the end of a lease as text, also of the stop that follows.
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use protocol::message::{LeaseEnd, StopReason};

    use super::*;
    use measurement::time::Monotonic;
    use teleop::collision_monitor::UnavailableReason;

    fn stops(reason: StopReason) -> DriveEvent {
        let since = Monotonic::default();
        let to = Mode::Stopping { reason, since };
        let from = Mode::Driving;
        DriveEvent::Arbiter(ArbiterEvent::ModeChanged { from, to })
    }

    #[test]
    fn a_stop_says_why() {
        let unavailable_reason = Some(UnavailableReason::PoseTooOld(Some(Duration::from_millis(
            420,
        ))));
        for (drive_event, kind, text) in [
            (
                stops(StopReason::Age),
                "involuntary_stop",
                "stopping: the commands are too old",
            ),
            (
                stops(StopReason::Released),
                "teleop_state",
                "stopping: nothing is pressed",
            ),
            (
                DriveEvent::MonitorUnavailable { unavailable_reason },
                "involuntary_stop",
                "stopping: the collision monitor could not judge, its newest pose was 0.42 s old",
            ),
        ] {
            assert_eq!(event_text(&drive_event, &[]), (kind, text.to_owned()));
        }
    }

    #[test]
    fn mode_texts_hold_on_land_and_water() {
        let stopping = Mode::Stopping {
            reason: StopReason::Released,
            since: Monotonic::default(),
        };
        for (from, to, text) in [
            (stopping, Mode::Held, "waits for the driver's keys"),
            (Mode::Held, Mode::Driving, "obeys the driver"),
            (Mode::Held, Mode::Idle, "nobody drives"),
            (
                Mode::SafeBoot,
                Mode::Idle,
                "self-test passed, nobody drives",
            ),
            (
                Mode::EStop,
                Mode::Idle,
                "emergency stop over, nobody drives",
            ),
            (
                Mode::Driving,
                Mode::EStop,
                "emergency stop: nothing moves until a reset",
            ),
        ] {
            let events = event_text(
                &DriveEvent::Arbiter(ArbiterEvent::ModeChanged { from, to }),
                &[],
            );
            assert_eq!(events, ("teleop_state", text.to_owned()));
        }
    }

    #[test]
    fn lease_end_and_stop_have_the_same_reason_text() {
        let operator = OperatorId(0);
        let names = ["anna".parse().unwrap()];
        for (why, kind, status_message) in [
            (
                LeaseEnd::HandedOver,
                "teleop_state",
                "the lease was handed over",
            ),
            (
                LeaseEnd::Revoked,
                "involuntary_stop",
                "the leave to drive was taken away",
            ),
        ] {
            let ended = DriveEvent::Arbiter(ArbiterEvent::LeaseEnded { operator, why });
            let text = format!("anna no longer drives: {status_message}");
            assert_eq!(event_text(&ended, &names), ("lease_ended", text));
            let stopped = stops(StopReason::LeaseEnded(why));
            assert_eq!(
                event_text(&stopped, &names),
                (kind, format!("stopping: {status_message}"))
            );
        }
    }
}
