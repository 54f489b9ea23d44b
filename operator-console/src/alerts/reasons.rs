//! What there is to be alarmed about.

use measurement::time::Monotonic;
use protocol::message::{FaultReason, RecordingState, SensorFault, SensorKind, TeleopState};

use super::{Alarm, AlertSource};
use crate::link::FleetState;
use crate::model::{ConsoleModel, LinkState};
use crate::panels::driving::labels::stuck;
use crate::panels::sensors::fault_text;

/// Something to be alarmed about.
pub(super) struct Reason {
    pub(super) alarm: Alarm,
    /// While it lasts.
    pub(super) text: String,
    /// When it is over.
    pub(super) past: String,
}

/// What there is to be alarmed about at the moment.
pub(super) fn reasons(model: &ConsoleModel, source: AlertSource, now: Monotonic) -> Vec<Reason> {
    let mut reasons = Vec::new();
    let is_silent = model.connection().state(now) == LinkState::Silent;
    if source == AlertSource::Robot && is_silent {
        match (model.is_silence_expected(), model.is_vehicle()) {
            (false, _) => reasons.push(link_lost()),
            (true, true) => reasons.push(left()),
            // Nobody waits for what cannot move.
            (true, false) => {}
        }
    }
    let Some((status, _)) = model.status() else {
        return reasons;
    };
    if let Some(teleop) = &status.teleop {
        if let Some(estop) = teleop.estop {
            reasons.push(Reason {
                alarm: Alarm::EStop,
                text: format!("Emergency stop {} is active", estop.number),
                past: format!("Emergency stop {} was active", estop.number),
            });
        }
        if let TeleopState::Fault(why) = teleop.state {
            let [is, was] = match why {
                FaultReason::SelfTest => ["the self-test failed"; 2],
                FaultReason::Actuator => {
                    ["the motors do not respond", "the motors did not respond"]
                }
            };
            reasons.push(Reason {
                alarm: Alarm::Fault,
                text: format!("The vehicle is at fault: {is}"),
                past: format!("The vehicle was at fault: {was}"),
            });
        }
        if model.is_stuck() && is_motion_current(model, now) {
            let [is, was] = stuck(model.is_boat());
            reasons.push(Reason {
                alarm: Alarm::Stuck,
                text: format!("Commanded but not moving: {is}"),
                past: format!("Commanded but did not move: {was}"),
            });
        }
    }
    for sensor in model.sensor_statuses() {
        if let Some(fault) = sensor.fault {
            let mut described = model.sensors().iter();
            let described = described.find(|info| info.name == sensor.name);
            let kind = described.map(|info| info.kind);
            let (_, state, advice) = fault_text(fault, kind);
            reasons.push(Reason {
                alarm: Alarm::Sensor(sensor.name.clone()),
                text: format!("{}: {state}. {advice}", sensor.name),
                past: format!("{}: {}", sensor.name, past_fault(fault, kind)),
            });
        }
    }
    let ended = model.recording().map(|recording| recording.state);
    let why = match ended {
        Some(RecordingState::StoppedDiskLow) => {
            Some(["the disk is nearly full", "the disk was nearly full"])
        }
        Some(RecordingState::Failed) => Some(["it cannot be written", "it could not be written"]),
        Some(RecordingState::Stopped | RecordingState::Recording) | None => None,
    };
    if let Some([is, was]) = why {
        reasons.push(Reason {
            alarm: Alarm::Recording,
            text: format!("The robot records no more: {is}"),
            past: format!("A recording of the robot had ended: {was}"),
        });
    }
    reasons
}

/// Whether what is known of its motion is of now: who is not heard, or runs anew, may long be told something else.
pub(super) fn is_motion_current(model: &ConsoleModel, now: Monotonic) -> bool {
    model.connection().state(now) != LinkState::Silent && !model.awaits_status()
}

/// What was wrong with a sensor that is well again.
fn past_fault(fault: SensorFault, kind: Option<SensorKind>) -> &'static str {
    match fault {
        SensorFault::AllInvalid if kind == Some(SensorKind::Sonar) => {
            "none of its measurements was valid: too near to the bottom, covered or broken"
        }
        SensorFault::Silent => "nothing came from it",
        SensorFault::Clock => "its stamps jumped",
        SensorFault::AllInvalid => "none of its measurements was valid",
        SensorFault::Blocked => "its window seemed to be blocked",
        SensorFault::Slow => "less than half of its measurements came",
    }
}

/// Nothing is heard.
pub(super) fn link_lost() -> Reason {
    Reason {
        alarm: Alarm::LinkLost,
        text: "No data from the robot".to_owned(),
        past: "No data from the robot for a while".to_owned(),
    }
}

/// The same of a vehicle that had taken its leave.
fn left() -> Reason {
    Reason {
        alarm: Alarm::LinkLost,
        text: "The vehicle said that its data has ended, and sends no more".to_owned(),
        past: "No data from the vehicle for a while: its data had ended".to_owned(),
    }
}

/// The same of a robot that is not shown, from what it says of itself to whoever looks for robots.
pub(super) fn reasons_from_discovery(state: &FleetState) -> Option<Reason> {
    let (alarm, [text, past]) = match state {
        FleetState::EStop { .. } => (
            Alarm::EStop,
            [
                "An emergency stop is active",
                "An emergency stop was active",
            ],
        ),
        FleetState::Fault { .. } => (
            Alarm::Fault,
            ["The vehicle is at fault", "The vehicle was at fault"],
        ),
        FleetState::NotDrivable
        | FleetState::Ended
        | FleetState::Free
        | FleetState::DrivenBy(_) => {
            return None;
        }
    };
    Some(Reason {
        alarm,
        text: text.to_owned(),
        past: past.to_owned(),
    })
}
