//! What wants somebody's attention until they say that they have seen it.
//!
//! An alert is there while its reason lasts, and after that until it is acknowledged. The same reason again is the same
//! alert, once more.

mod fleet;
mod reasons;

use measurement::time::Monotonic;
use protocol::message::Event;

use crate::link::FleetState;
use crate::model::ConsoleModel;
use reasons::{Reason, is_motion_current, link_lost, reasons, reasons_from_discovery};

pub use fleet::FleetAlerts;

/// Alerts that are listed.
const MAX_ALERTS: usize = 64;

/// What an alert is about.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Alarm {
    /// An emergency stop is active.
    EStop,
    /// The vehicle does not trust itself.
    Fault,
    /// No data from the robot.
    LinkLost,
    /// Something is wrong with a sensor: its name.
    Sensor(String),
    /// The robot no longer records what it was to record.
    Recording,
    /// The position is somewhere else all at once.
    PositionJump,
    /// The robot's machine does not keep up with its sensors.
    Overload,
    /// The vehicle is told to go, and does not.
    Stuck,
}

/// Whose alerts they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlertSource {
    /// A robot at the other end of a link.
    Robot,
    /// A recording that this program maps. Its link cannot be lost: where it is silent it is wound, or its time line says why.
    Recording,
}

/// Something that wants attention.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alert {
    /// What it is about.
    pub alarm: Alarm,
    /// The same in words: what is so, or what was so last, where its reason is gone.
    pub text: String,
    /// What it is to say when its reason is gone.
    past: String,
    /// When it began last.
    pub since: Monotonic,
    /// How often it has begun.
    pub times: u32,
    /// Whether its reason lasts.
    pub is_active: bool,
    /// Whether somebody has said that they have seen it.
    pub is_acknowledged: bool,
}

/// The alerts of one robot.
#[derive(Clone, Debug, Default)]
pub struct Alerts {
    alerts: Vec<Alert>,
}

impl Alerts {
    /// Those that are not acknowledged, or whose reason lasts; the newest first.
    pub fn iter(&self) -> impl Iterator<Item = &Alert> {
        self.alerts.iter().rev()
    }

    /// How many nobody has seen yet.
    pub fn unacknowledged(&self) -> usize {
        self.alerts
            .iter()
            .filter(|alert| !alert.is_acknowledged)
            .count()
    }

    /// Somebody has seen it.
    pub fn acknowledge(&mut self, alarm: &Alarm) {
        for alert in &mut self.alerts {
            alert.is_acknowledged |= alert.alarm == *alarm;
        }
        self.drop_finished();
    }

    /// Somebody has seen them all.
    pub fn acknowledge_all(&mut self) {
        for alert in &mut self.alerts {
            alert.is_acknowledged = true;
        }
        self.drop_finished();
    }

    /// Looks at the robot, or at the recording of one, and at what it has told of since the last look. Those that have
    /// begun, in words.
    pub fn update(
        &mut self,
        model: &ConsoleModel,
        source: AlertSource,
        new_events: &[Event],
        now: Monotonic,
    ) -> Vec<(Alarm, String)> {
        let reasons = reasons(model, source, now);
        // Until the robot speaks, what it said before it was shown again is the newest that is known.
        let is_heard = model.status().is_some();
        // Who is not heard may move by now, or not: neither is told.
        let is_motion_current = is_motion_current(model, now);
        self.end_others(&reasons, |alarm| {
            is_heard && (is_motion_current || *alarm != Alarm::Stuck)
        });
        if !is_motion_current {
            self.deactivate(&Alarm::Stuck);
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
            let (text, past) = (event.message.clone(), event.message.clone());
            self.begin(Reason { alarm, text, past }, false, now);
        }
        self.drop_finished();
        begun
    }

    /// The same for a robot that is not shown, but heard, from what it said of itself lately, if anything. Of what it does not
    /// say, it stays as it was when the robot was shown last.
    fn update_from_discovery(
        &mut self,
        state: Option<&FleetState>,
        now: Monotonic,
    ) -> Option<(Alarm, String)> {
        let reason = state.and_then(reasons_from_discovery);
        let is_said = |alarm: &Alarm| match alarm {
            Alarm::LinkLost => true,
            Alarm::Fault => state.is_some(),
            // A fault comes first in what is said, and ends no stop.
            Alarm::EStop => state.is_some_and(|state| !matches!(state, FleetState::Fault { .. })),
            // Whom nobody drives nobody tells to go.
            Alarm::Stuck => state.is_some_and(|state| !matches!(state, FleetState::DrivenBy(_))),
            Alarm::Sensor(_) | Alarm::Recording | Alarm::PositionJump | Alarm::Overload => false,
        };
        self.end_others(reason.as_slice(), is_said);
        let begun = reason.and_then(|reason| self.begin_unless_active(reason, now));
        self.drop_finished();
        begun
    }

    /// A robot that is not shown is not heard any more.
    fn mark_lost(&mut self, now: Monotonic) -> Option<(Alarm, String)> {
        self.begin_unless_active(link_lost(), now)
    }

    /// What the robot said itself says more.
    fn begin_unless_active(&mut self, reason: Reason, now: Monotonic) -> Option<(Alarm, String)> {
        let mut alerts = self.alerts.iter();
        let is_known = alerts.any(|alert| alert.is_active && alert.alarm == reason.alarm);
        (!is_known).then(|| self.set_active(reason, now)).flatten()
    }

    /// What is none of `reasons`, and would be told of, is over.
    fn end_others(&mut self, reasons: &[Reason], is_told: impl Fn(&Alarm) -> bool) {
        for alert in &mut self.alerts {
            let lasts = reasons.iter().any(|reason| reason.alarm == alert.alarm);
            if alert.is_active && !lasts && is_told(&alert.alarm) {
                alert.is_active = false;
                alert.text.clone_from(&alert.past);
            }
        }
    }

    /// Nobody knows whether it lasts.
    fn deactivate(&mut self, alarm: &Alarm) {
        for alert in &mut self.alerts {
            if alert.alarm == *alarm {
                alert.text.clone_from(&alert.past);
            }
        }
    }

    /// There is a reason; in words where it has just begun.
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

    /// It is the newest, and nobody has seen it. `lasts`: its reason is there until a look says that it is not.
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

#[cfg(test)]
mod tests;
