use protocol::keys::Topic;
use protocol::message::{
    EStopStatus, Info, Pose, SensorFault, SensorStatus, Severity, Status, TeleopState,
    TeleopStatus, Velocity,
};
use protocol::tile::BootId;

use super::*;
use crate::model::RequestId;
use crate::test_support::{
    self, announce_boot, at, idle_teleop_status, inject_reply, pose_at_rest, scout,
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
    alerts.update(&model, AlertSource::Robot, &[jump.clone(), jump], at(4_000));
    update(&mut alerts, &model, 9_000);
    let mut alarms = listed(&alerts);
    alarms.sort();
    assert_eq!(
        alarms,
        [
            (Alarm::LinkLost, 1, true),
            (laser, 1, false),
            (Alarm::PositionJump, 2, false),
        ]
    );
}

/// A commanded and a measured speed, m/s.
fn drives(model: &mut ConsoleModel, told_mps: f32, speed_mps: f32, now: Monotonic) {
    let pose = Pose {
        speed_mps,
        ..pose_at_rest()
    };
    let teleop = TeleopStatus {
        state: TeleopState::Driving,
        applied: Velocity {
            linear_mps: told_mps,
            angular_radps: 0.0,
        },
        ..idle_teleop_status()
    };
    let status = Status {
        teleop: Some(teleop),
        ..Status::default()
    };
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
        for (ms, told_mps, speed_mps, has_begun, is_active) in [
            (0, 1.0, 0.0, false, None),
            (2_000, 1.0, 0.0, false, None),
            (3_000, 1.0, 0.0, true, Some(true)),
            (4_000, 1.0, 0.0, false, Some(true)),
            (5_000, 0.0, 0.0, false, Some(false)),
            (6_000, 1.0, 0.0, false, Some(false)),
            (9_000, 1.0, 0.0, true, Some(true)),
            (9_500, 1.0, 0.5, false, Some(false)),
        ] {
            drives(&mut model, told_mps, speed_mps, at(ms));
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
    // The condition lasts: nothing begins.
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
