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
    Motors,
    LinkLost,
    Sensor(String),
    Recording,
    PositionJump,
    /// The scans do not determine where the vehicle is.
    PositionUncertain,
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
                "localization_uncertain" | "localization_lost" => Alarm::PositionUncertain,
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

    /// For a robot that is not shown. Alerts that the state from discovery does not cover stay as they are.
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

    fn mark_lost(&mut self, now: Monotonic) -> Option<(Alarm, String)> {
        self.begin_unless_active(link_lost(), now)
    }

    /// The robot's own description is more precise.
    fn begin_unless_active(&mut self, reason: Reason, now: Monotonic) -> Option<(Alarm, String)> {
        let mut alerts = self.alerts.iter();
        let is_known = alerts.any(|alert| alert.is_active && alert.alarm == reason.alarm);
        (!is_known).then(|| self.set_active(reason, now)).flatten()
    }

    fn end_others(&mut self, reasons: &[Reason], is_reported: impl Fn(&Alarm) -> bool) {
        for alert in &mut self.alerts {
            let lasts = reasons.iter().any(|reason| reason.alarm == alert.alarm);
            if alert.is_active && !lasts && is_reported(&alert.alarm) {
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
        if let Some(hold) = teleop.motor_hold.filter(|_| teleop.lease.holder.is_some()) {
            let said = |verb| format!("The motors {verb} no velocity: {hold}");
            reasons.push(Reason::new(Alarm::Motors, said("obey"), said("obeyed")));
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
mod tests {
    use protocol::keys::Topic;
    use protocol::message::{
        EStopStatus, Info, Pose, SensorFault, SensorStatus, Severity, Status, TeleopState,
        TeleopStatus, Velocity,
    };
    use protocol::tile::BootId;

    use super::*;
    use crate::model::RequestId;
    use crate::test_support::{
        self, announce_boot, at, idle_teleop_status, inject_reply, pose_at_rest, scout, status_of,
    };

    fn inject(
        model: &mut ConsoleModel,
        fault: Option<SensorFault>,
        estop: Option<u64>,
        now: Monotonic,
    ) {
        let teleop = TeleopStatus {
            estop: estop.map(|number| EStopStatus {
                number,
                is_stored: true,
            }),
            ..idle_teleop_status()
        };
        let laser = SensorStatus {
            name: "laser".to_owned(),
            messages: 10,
            rate_hz: 0.0,
            age_ms: Some(1200),
            dropped: 0,
            fault,
        };
        let status = Status {
            sensors: vec![laser],
            teleop: Some(teleop),
            ..Status::default()
        };
        test_support::inject(model, Topic::Status, &status, now);
    }

    fn update(alerts: &mut Alerts, model: &ConsoleModel, ms: u64) -> Vec<(Alarm, String)> {
        alerts.update(model, AlertSource::Robot, &[], at(ms))
    }

    fn texts(alerts: &Alerts) -> Vec<&str> {
        alerts.iter().map(|alert| alert.text.as_str()).collect()
    }

    fn listed(alerts: &Alerts) -> Vec<(Alarm, u32, bool)> {
        alerts
            .iter()
            .map(|alert| (alert.alarm.clone(), alert.times, alert.is_active))
            .collect()
    }

    #[test]
    fn alert_lasts_until_over_and_acknowledged() {
        let mut model = scout();
        let mut alerts = Alerts::default();
        inject(&mut model, None, Some(3), at(0));
        let begun = update(&mut alerts, &model, 0);
        let text = "Emergency stop 3 is active".to_owned();
        assert_eq!(begun, [(Alarm::EStop, text)]);
        assert_eq!(update(&mut alerts, &model, 10), []);
        assert_eq!(
            (alerts.unacknowledged(), listed(&alerts)),
            (1, vec![(Alarm::EStop, 1, true)])
        );
        alerts.acknowledge(&Alarm::EStop);
        update(&mut alerts, &model, 20);
        assert_eq!(
            (alerts.unacknowledged(), alerts.iter().count()),
            (0, 1),
            "it is in force"
        );
        inject(&mut model, None, None, at(30));
        update(&mut alerts, &model, 30);
        assert_eq!(alerts.iter().count(), 0);

        // An unacknowledged alert stays after its end and counts repetitions.
        for now in [40, 60] {
            inject(&mut model, None, Some(4), at(now));
            assert_eq!(update(&mut alerts, &model, now).len(), 1);
            inject(&mut model, None, None, at(now + 10));
            update(&mut alerts, &model, now + 10);
        }
        assert_eq!(
            (alerts.unacknowledged(), listed(&alerts)),
            (1, vec![(Alarm::EStop, 2, false)])
        );
        assert_eq!(texts(&alerts), ["Emergency stop 4 was active"]);
        inject(&mut model, None, Some(5), at(80));
        update(&mut alerts, &model, 80);
        assert_eq!(texts(&alerts), ["Emergency stop 5 is active"]);
        inject(&mut model, None, None, at(90));
        update(&mut alerts, &model, 90);
        alerts.acknowledge_all();
        assert_eq!(alerts.iter().count(), 0);
    }

    #[test]
    fn seeking_recording_has_no_lost_link() {
        let mut model = scout();
        inject(&mut model, None, None, at(0));
        let mut alerts = Alerts::default();
        let of_recording = alerts.update(&model, AlertSource::Recording, &[], at(60_000));
        assert_eq!(of_recording, []);
        assert_eq!(update(&mut alerts, &model, 60_000).len(), 1);
    }

    #[test]
    fn silence_after_end_alarms_for_vehicles_only() {
        let left = "The vehicle reported the end of its data and is silent";
        let lost = "No data from the robot";
        for (has_ended, can_be_driven, expected) in [
            (true, false, None),
            (true, true, Some(left)),
            (false, true, Some(lost)),
        ] {
            let mut model = scout();
            let status = Status {
                has_ended,
                teleop: can_be_driven.then(idle_teleop_status),
                ..Status::default()
            };
            test_support::inject(&mut model, Topic::Status, &status, at(0));
            let mut alerts = Alerts::default();
            let actual = update(&mut alerts, &model, 60_000);
            let expected = expected.map(|words| (Alarm::LinkLost, words.to_owned()));
            assert_eq!(actual, Vec::from_iter(expected));
        }
    }

    #[test]
    fn discovery_state_does_not_change_sensor_alerts() {
        let mut model = scout();
        let mut alerts = Alerts::default();
        inject(&mut model, Some(SensorFault::Silent), Some(3), at(0));
        update(&mut alerts, &model, 9_000);
        let active = |alerts: &Alerts| -> Vec<Alarm> {
            let active = alerts.iter().filter(|alert| alert.is_active);
            let mut active: Vec<_> = active.map(|alert| alert.alarm.clone()).collect();
            active.sort();
            active
        };
        let laser = Alarm::Sensor("laser".to_owned());
        assert_eq!(
            active(&alerts),
            [Alarm::EStop, Alarm::LinkLost, laser.clone()]
        );
        assert_eq!(
            alerts.update_from_discovery(Some(&FleetState::Free), at(10_000)),
            None
        );
        assert_eq!(active(&alerts), [laser]);
        assert_eq!(alerts.unacknowledged(), 3);
    }

    #[test]
    fn silence_faults_and_jumps_raise_alerts() {
        let mut model = scout();
        let mut alerts = Alerts::default();
        inject(&mut model, Some(SensorFault::Silent), None, at(3_000));
        let begun = update(&mut alerts, &model, 3_000);
        let laser = Alarm::Sensor("laser".to_owned());
        assert_eq!(begun.len(), 1);
        assert_eq!(begun[0].0, laser);
        assert!(begun[0].1.starts_with("laser: Silent. "), "{}", begun[0].1);
        inject(&mut model, None, None, at(4_000));
        let jump = Event {
            kind: "pose_jump".to_owned(),
            severity: Severity::Warning,
            message: "The pose jumped 3 m".to_owned(),
        };
        let lost = Event {
            kind: "localization_lost".to_owned(),
            ..jump.clone()
        };
        let events = [jump.clone(), jump, lost];
        alerts.update(&model, AlertSource::Robot, &events, at(4_000));
        update(&mut alerts, &model, 9_000);
        let mut alarms = listed(&alerts);
        alarms.sort();
        assert_eq!(
            alarms,
            [
                (Alarm::LinkLost, 1, true),
                (laser, 1, false),
                (Alarm::PositionJump, 2, false),
                (Alarm::PositionUncertain, 1, false),
            ]
        );
    }

    fn drives(model: &mut ConsoleModel, commanded_mps: f32, speed_mps: f32, now: Monotonic) {
        let pose = Pose {
            speed_mps,
            ..pose_at_rest()
        };
        let teleop = TeleopStatus {
            state: TeleopState::Driving,
            applied: Velocity {
                linear_mps: commanded_mps,
                lateral_mps: 0.0,
                angular_radps: 0.0,
            },
            ..idle_teleop_status()
        };
        let status = status_of(teleop);
        test_support::inject(model, Topic::Pose, &pose, now);
        test_support::inject(model, Topic::Status, &status, now);
    }

    #[test]
    fn stuck_alert_lasts_until_motion_or_no_command() {
        for (is_boat, is, was) in [
            (
                true,
                "aground, held, or its motors do not respond",
                "aground, held, or its motors did not respond",
            ),
            (
                false,
                "stuck, or its motors do not respond",
                "stuck, or its motors did not respond",
            ),
        ] {
            let mut model = scout();
            let info = Info {
                is_boat,
                ..Info::default()
            };
            inject_reply(&mut model, RequestId(0), Topic::Info, &info, at(0));
            let mut alerts = Alerts::default();
            let text = format!("Commanded but not moving: {is}");
            for (ms, commanded_mps, speed_mps, has_begun, is_active) in [
                (0, 1.0, 0.0, false, None),
                (2_000, 1.0, 0.0, false, None),
                (3_000, 1.0, 0.0, true, Some(true)),
                (4_000, 1.0, 0.0, false, Some(true)),
                (5_000, 0.0, 0.0, false, Some(false)),
                (6_000, 1.0, 0.0, false, Some(false)),
                (9_000, 1.0, 0.0, true, Some(true)),
                (9_500, 1.0, 0.5, false, Some(false)),
            ] {
                drives(&mut model, commanded_mps, speed_mps, at(ms));
                let begun = update(&mut alerts, &model, ms);
                let expected = has_begun.then(|| (Alarm::Stuck, text.clone()));
                assert_eq!(begun, Vec::from_iter(expected), "{ms}");
                let active = alerts.iter().map(|alert| alert.is_active).next();
                assert_eq!(active, is_active, "{ms}");
            }
            assert_eq!(listed(&alerts), [(Alarm::Stuck, 2, false)]);
            let past = format!("Commanded but did not move: {was}");
            assert_eq!(texts(&alerts), [past]);
            alerts.acknowledge(&Alarm::Stuck);
            assert_eq!(alerts.iter().count(), 0);
        }
    }

    #[test]
    fn silent_vehicle_is_not_stuck_now() {
        let mut model = scout();
        announce_boot(&mut model, BootId([7; 16]), at(0));
        let mut alerts = Alerts::default();
        for ms in [0, 3_000] {
            drives(&mut model, 1.0, 0.0, at(ms));
            update(&mut alerts, &model, ms);
        }
        let said = |alerts: &Alerts| {
            let mut all = alerts.iter();
            let stuck = all.find(|alert| alert.alarm == Alarm::Stuck).unwrap();
            let word = stuck.text.split_whitespace().nth(3).unwrap().to_owned();
            (word, stuck.times, stuck.is_acknowledged)
        };
        assert_eq!(said(&alerts), ("moving:".to_owned(), 1, false));
        alerts.acknowledge(&Alarm::Stuck);
        update(&mut alerts, &model, 5_000);
        assert!(model.is_stuck(), "by the last status");
        assert_eq!(said(&alerts), ("not".to_owned(), 1, true));
        assert!(alerts.iter().any(|alert| alert.alarm == Alarm::LinkLost));
        drives(&mut model, 1.0, 0.0, at(5_100));
        let begun = update(&mut alerts, &model, 5_100);
        assert_eq!(begun, []);
        assert_eq!(said(&alerts), ("moving:".to_owned(), 1, true));
        // Another run has not reported it yet.
        announce_boot(&mut model, BootId([9; 16]), at(5_200));
        update(&mut alerts, &model, 5_200);
        assert_eq!(said(&alerts), ("not".to_owned(), 1, true));
    }

    #[test]
    fn undriven_robot_is_not_stuck() {
        let mut model = scout();
        let mut alerts = Alerts::default();
        for ms in [0, 3_000] {
            drives(&mut model, 1.0, 0.0, at(ms));
            update(&mut alerts, &model, ms);
        }
        for (state, is_active) in [
            (FleetState::DrivenBy("bert".parse().unwrap()), true),
            (FleetState::Free, false),
        ] {
            alerts.update_from_discovery(Some(&state), at(10_000));
            assert_eq!(listed(&alerts), [(Alarm::Stuck, 1, is_active)]);
        }
    }
}
