//! Alerts: conditions that need the operator's attention until acknowledged.
//!
//! An alert is listed while its condition lasts and afterwards until it is acknowledged. If the condition returns, the
//! same alert counts once more.

use measurement::time::Monotonic;
use protocol::message::{Event, FaultReason, RecordingState, SensorFault, SensorKind, TeleopState};

use crate::link::FleetState;
use crate::model::{ConsoleModel, LinkState};
use crate::panels::driving::labels::stuck;
use crate::panels::sensors::fault_text;

mod fleet;

pub use fleet::FleetAlerts;

const MAX_ALERTS: usize = 64;

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Alarm {
    EStop,
    Fault,
    LinkLost,
    Sensor(String),
    Recording,
    PositionJump,
    Overload,
    Stuck,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlertSource {
    Robot,
    /// A recording that this program maps. Its link cannot be lost: its timeline shows why it is silent.
    Recording,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alert {
    pub alarm: Alarm,
    /// Description: the present state, or the last one if the condition is over.
    pub text: String,
    past: String,
    pub since: Monotonic,
    pub times: u32,
    pub is_active: bool,
    pub is_acknowledged: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Alerts {
    alerts: Vec<Alert>,
}

impl Alerts {
    pub fn iter(&self) -> impl Iterator<Item = &Alert> {
        self.alerts.iter().rev()
    }

    pub fn unacknowledged(&self) -> usize {
        let alerts = self.alerts.iter();
        alerts.filter(|alert| !alert.is_acknowledged).count()
    }

    pub fn acknowledge(&mut self, alarm: &Alarm) {
        for alert in &mut self.alerts {
            alert.is_acknowledged |= alert.alarm == *alarm;
        }
        self.drop_finished();
    }

    pub fn acknowledge_all(&mut self) {
        for alert in &mut self.alerts {
            alert.is_acknowledged = true;
        }
        self.drop_finished();
    }

    /// Takes the state of a robot or recording and its new events. Returns the alerts that begin.
    pub fn update(
        &mut self,
        model: &ConsoleModel,
        source: AlertSource,
        new_events: &[Event],
        now: Monotonic,
    ) -> Vec<(Alarm, String)> {
        let reasons = reasons(model, source, now);
        // After a change of robots the last known state is valid until the first status.
        let is_heard = model.status().is_some();
        // Without recent data it is unknown whether the vehicle moves.
        let is_motion_current = is_motion_current(model, now);
        self.end_others(&reasons, |alarm| {
            is_heard && (is_motion_current || *alarm != Alarm::Stuck)
        });
        let stuck = |alert: &&mut Alert| !is_motion_current && alert.alarm == Alarm::Stuck;
        for alert in self.alerts.iter_mut().filter(stuck) {
            alert.text.clone_from(&alert.past);
        }
        let mut begun = Vec::new();
        for reason in reasons {
            begun.extend(self.set_active(reason, now));
        }
        for event in new_events {
            let alarm = match event.kind.as_str() {
                "pose_jump" => Alarm::PositionJump,
                "overload" => Alarm::Overload,
                _ => continue,
            };
            begun.push((alarm.clone(), event.message.clone()));
            let reason = Reason::new(alarm, &event.message, &event.message);
            self.begin(reason, false, now);
        }
        self.drop_finished();
        begun
    }

    /// The same for a robot that is not shown, by its state from discovery. Alerts that this state does not cover stay
    /// as they are.
    fn update_from_discovery(
        &mut self,
        state: Option<&FleetState>,
        now: Monotonic,
    ) -> Option<(Alarm, String)> {
        let reason = state.and_then(reasons_from_discovery);
        let is_said = |alarm: &Alarm| match alarm {
            Alarm::LinkLost => true,
            Alarm::Fault => state.is_some(),
            // A fault hides an emergency stop in the state, but does not end it.
            Alarm::EStop => state.is_some_and(|state| !matches!(state, FleetState::Fault { .. })),
            // Without a driver there is no command to move.
            Alarm::Stuck => state.is_some_and(|state| !matches!(state, FleetState::DrivenBy(_))),
            _ => false,
        };
        self.end_others(reason.as_slice(), is_said);
        let begun = reason.and_then(|reason| self.begin_unless_active(reason, now));
        self.drop_finished();
        begun
    }

    /// Marks the link of a robot that is not shown as lost.
    fn mark_lost(&mut self, now: Monotonic) -> Option<(Alarm, String)> {
        self.begin_unless_active(link_lost(), now)
    }

    /// The robot's own description is more precise.
    fn begin_unless_active(&mut self, reason: Reason, now: Monotonic) -> Option<(Alarm, String)> {
        let mut alerts = self.alerts.iter();
        let is_known = alerts.any(|alert| alert.is_active && alert.alarm == reason.alarm);
        (!is_known).then(|| self.set_active(reason, now)).flatten()
    }

    /// Ends the alerts without a reason, if the report would contain one.
    fn end_others(&mut self, reasons: &[Reason], is_told: impl Fn(&Alarm) -> bool) {
        for alert in &mut self.alerts {
            let lasts = reasons.iter().any(|reason| reason.alarm == alert.alarm);
            if alert.is_active && !lasts && is_told(&alert.alarm) {
                alert.is_active = false;
                alert.text.clone_from(&alert.past);
            }
        }
    }

    fn set_active(&mut self, reason: Reason, now: Monotonic) -> Option<(Alarm, String)> {
        let mut alerts = self.alerts.iter_mut();
        let known = alerts.find(|alert| alert.alarm == reason.alarm);
        if let Some(alert) = known.filter(|alert| alert.is_active) {
            alert.text = reason.text;
            alert.past = reason.past;
            return None;
        }
        let begun = (reason.alarm.clone(), reason.text.clone());
        self.begin(reason, true, now);
        Some(begun)
    }

    /// Begins an alert, unacknowledged and newest. `lasts`: the condition is active until an update ends it.
    fn begin(&mut self, reason: Reason, lasts: bool, now: Monotonic) {
        let Reason { alarm, text, past } = reason;
        let known = self.alerts.iter().position(|alert| alert.alarm == alarm);
        let times = known.map_or(0, |at| self.alerts.remove(at).times);
        if self.alerts.len() >= MAX_ALERTS {
            self.alerts.remove(0);
        }
        self.alerts.push(Alert {
            alarm,
            text,
            past,
            since: now,
            times: times.saturating_add(1),
            is_active: lasts,
            is_acknowledged: false,
        });
    }

    fn drop_finished(&mut self) {
        self.alerts
            .retain(|alert| alert.is_active || !alert.is_acknowledged);
    }
}

struct Reason {
    alarm: Alarm,
    text: String,
    past: String,
}

impl Reason {
    fn new(alarm: Alarm, text: impl Into<String>, past: impl Into<String>) -> Self {
        Self {
            alarm,
            text: text.into(),
            past: past.into(),
        }
    }
}

fn reasons(model: &ConsoleModel, source: AlertSource, now: Monotonic) -> Vec<Reason> {
    let mut reasons = Vec::new();
    let is_silent = model.connection().state(now) == LinkState::Silent;
    if source == AlertSource::Robot && is_silent {
        match (model.is_silence_expected(), model.is_vehicle()) {
            (false, _) => reasons.push(link_lost()),
            (true, true) => reasons.push(Reason::new(
                Alarm::LinkLost,
                "The vehicle reported the end of its data and is silent",
                "No data from the vehicle for a while: its data had ended",
            )),
            // A robot that cannot be driven may fall silent after its end.
            (true, false) => {}
        }
    }
    let Some((status, _)) = model.status() else {
        return reasons;
    };
    if let Some(teleop) = &status.teleop {
        if let Some(estop) = teleop.estop {
            let said = |verb| format!("Emergency stop {} {verb} active", estop.number);
            reasons.push(Reason::new(Alarm::EStop, said("is"), said("was")));
        }
        if let TeleopState::Fault(why) = teleop.state {
            let [is, was] = match why {
                FaultReason::SelfTest => ["the self-test failed"; 2],
                FaultReason::Actuator => {
                    ["the motors do not respond", "the motors did not respond"]
                }
            };
            let text = format!("The vehicle is at fault: {is}");
            let past = format!("The vehicle was at fault: {was}");
            reasons.push(Reason::new(Alarm::Fault, text, past));
        }
        if model.is_stuck() && is_motion_current(model, now) {
            let [is, was] = stuck(model.is_boat());
            let text = format!("Commanded but not moving: {is}");
            let past = format!("Commanded but did not move: {was}");
            reasons.push(Reason::new(Alarm::Stuck, text, past));
        }
    }
    for sensor in model.sensor_statuses() {
        if let Some(fault) = sensor.fault {
            let mut described = model.sensors().iter();
            let described = described.find(|info| info.name == sensor.name);
            let kind = described.map(|info| info.kind);
            let (_, state, advice) = fault_text(fault, kind);
            let text = format!("{}: {state}. {advice}", sensor.name);
            let past = format!("{}: {}", sensor.name, past_fault(fault, kind));
            reasons.push(Reason::new(Alarm::Sensor(sensor.name.clone()), text, past));
        }
    }
    let ended = model.recording().map(|recording| recording.state);
    let why = match ended {
        Some(RecordingState::StoppedDiskLow) => {
            Some(["the disk is nearly full", "the disk was nearly full"])
        }
        Some(RecordingState::Failed) => Some(["it cannot be written", "it could not be written"]),
        _ => None,
    };
    if let Some([is, was]) = why {
        let text = format!("The robot has stopped recording: {is}");
        let past = format!("A recording of the robot had ended: {was}");
        reasons.push(Reason::new(Alarm::Recording, text, past));
    }
    reasons
}

/// Whether the motion of the vehicle is known now: the link is live and the robot has sent a status since its restart.
fn is_motion_current(model: &ConsoleModel, now: Monotonic) -> bool {
    model.connection().state(now) != LinkState::Silent && !model.awaits_status()
}

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

fn link_lost() -> Reason {
    Reason::new(
        Alarm::LinkLost,
        "No data from the robot",
        "No data from the robot for a while",
    )
}

/// The condition of a robot by its state from discovery.
fn reasons_from_discovery(state: &FleetState) -> Option<Reason> {
    match state {
        FleetState::EStop { .. } => Some(Reason::new(
            Alarm::EStop,
            "An emergency stop is active",
            "An emergency stop was active",
        )),
        FleetState::Fault { .. } => Some(Reason::new(
            Alarm::Fault,
            "The vehicle is at fault",
            "The vehicle was at fault",
        )),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
