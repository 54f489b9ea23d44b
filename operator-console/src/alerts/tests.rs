use protocol::keys::Topic;
use protocol::message::{
    EStopStatus, Info, Pose, SensorFault, SensorStatus, Severity, Status, TeleopState,
    TeleopStatus, Velocity,
};
use protocol::tile::BootId;

use super::*;
use crate::model::RequestId;
use crate::pretend::{self, answers, at, resting, scout, standing, starts};

fn says(model: &mut ConsoleModel, fault: Option<SensorFault>, estop: Option<u64>, now: Monotonic) {
    let teleop = TeleopStatus {
        estop: estop.map(|number| EStopStatus {
            number,
            is_stored: true,
        }),
        ..standing()
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
    pretend::says(model, Topic::Status, &status, now);
}

fn listed(alerts: &Alerts) -> Vec<(Alarm, u32, bool)> {
    alerts
        .iter()
        .map(|alert| (alert.alarm.clone(), alert.times, alert.is_active))
        .collect()
}

#[test]
fn an_alert_lasts_until_its_reason_is_gone_and_somebody_has_seen_it() {
    let mut model = scout();
    let mut alerts = Alerts::default();
    says(&mut model, None, Some(3), at(0));
    let begun = alerts.look(&model, Subject::Robot, &[], at(0));
    let text = "Emergency stop 3 is in force".to_owned();
    assert_eq!(begun, [(Alarm::EStop, text)]);
    assert_eq!(alerts.look(&model, Subject::Robot, &[], at(10)), []);
    assert_eq!(
        (alerts.unseen(), listed(&alerts)),
        (1, vec![(Alarm::EStop, 1, true)])
    );
    alerts.acknowledge(&Alarm::EStop);
    alerts.look(&model, Subject::Robot, &[], at(20));
    assert_eq!(
        (alerts.unseen(), alerts.iter().count()),
        (0, 1),
        "it is in force"
    );
    says(&mut model, None, None, at(30));
    alerts.look(&model, Subject::Robot, &[], at(30));
    assert_eq!(alerts.iter().count(), 0);

    // What nobody has seen stays although it is over, and the same again counts.
    for now in [40, 60] {
        says(&mut model, None, Some(4), at(now));
        assert_eq!(alerts.look(&model, Subject::Robot, &[], at(now)).len(), 1);
        says(&mut model, None, None, at(now + 10));
        alerts.look(&model, Subject::Robot, &[], at(now + 10));
    }
    assert_eq!(
        (alerts.unseen(), listed(&alerts)),
        (1, vec![(Alarm::EStop, 2, false)])
    );
    let texts: Vec<_> = alerts.iter().map(|alert| alert.text.as_str()).collect();
    assert_eq!(texts, ["Emergency stop 4 was in force"]);
    says(&mut model, None, Some(5), at(80));
    alerts.look(&model, Subject::Robot, &[], at(80));
    let texts: Vec<_> = alerts.iter().map(|alert| alert.text.as_str()).collect();
    assert_eq!(texts, ["Emergency stop 5 is in force"]);
    says(&mut model, None, None, at(90));
    alerts.look(&model, Subject::Robot, &[], at(90));
    alerts.acknowledge_all();
    assert_eq!(alerts.iter().count(), 0);
}

#[test]
fn a_recording_that_is_wound_has_lost_no_link() {
    let mut model = scout();
    says(&mut model, None, None, at(0));
    let mut alerts = Alerts::default();
    let later = at(60_000);
    assert_eq!(alerts.look(&model, Subject::Recording, &[], later), []);
    assert_eq!(alerts.look(&model, Subject::Robot, &[], later).len(), 1);
}

#[test]
fn what_had_ended_alarms_nobody_when_it_falls_silent_unless_it_could_move() {
    let left = "The vehicle said that its data has ended, and is not heard any more";
    let lost = "Nothing is heard of the robot";
    for (has_ended, can_be_driven, expected) in [
        (true, false, None),
        (true, true, Some(left)),
        (false, true, Some(lost)),
    ] {
        let mut model = scout();
        let status = Status {
            has_ended,
            teleop: can_be_driven.then(standing),
            ..Status::default()
        };
        pretend::says(&mut model, Topic::Status, &status, at(0));
        let mut alerts = Alerts::default();
        let told = alerts.look(&model, Subject::Robot, &[], at(60_000));
        let expected = expected.map(|words| (Alarm::LinkLost, words.to_owned()));
        assert_eq!(told, Vec::from_iter(expected));
    }
}

#[test]
fn who_says_from_afar_how_it_is_is_heard_and_says_nothing_of_its_sensors() {
    let mut model = scout();
    let mut alerts = Alerts::default();
    says(&mut model, Some(SensorFault::Silent), Some(3), at(0));
    alerts.look(&model, Subject::Robot, &[], at(9_000));
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
        alerts.look_from_afar(Some(&FleetState::Free), at(10_000)),
        None
    );
    assert_eq!(active(&alerts), [laser]);
    assert_eq!(alerts.unseen(), 3);
}

#[test]
fn silence_of_link_and_sensors_and_jumps_are_told() {
    let mut model = scout();
    let mut alerts = Alerts::default();
    says(&mut model, Some(SensorFault::Silent), None, at(3_000));
    let begun = alerts.look(&model, Subject::Robot, &[], at(3_000));
    let laser = Alarm::Sensor("laser".to_owned());
    assert_eq!(begun.len(), 1);
    assert_eq!(begun[0].0, laser);
    assert!(begun[0].1.starts_with("laser: Silent. "), "{}", begun[0].1);
    says(&mut model, None, None, at(4_000));
    let jump = Event {
        kind: "pose_jump".to_owned(),
        severity: Severity::Warning,
        message: "The pose jumped 3 m".to_owned(),
    };
    alerts.look(&model, Subject::Robot, &[jump.clone(), jump], at(4_000));
    alerts.look(&model, Subject::Robot, &[], at(9_000));
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

/// Its motors are told to go so fast, and it measures another speed, m/s.
fn drives(model: &mut ConsoleModel, told_mps: f32, speed_mps: f32, now: Monotonic) {
    let pose = Pose {
        speed_mps,
        ..resting()
    };
    let teleop = TeleopStatus {
        state: TeleopState::Driving,
        applied: Velocity {
            linear_mps: told_mps,
            angular_radps: 0.0,
        },
        ..standing()
    };
    let status = Status {
        teleop: Some(teleop),
        ..Status::default()
    };
    pretend::says(model, Topic::Pose, &pose, now);
    pretend::says(model, Topic::Status, &status, now);
}

#[test]
fn a_vehicle_that_sticks_is_an_alert_until_it_goes_or_is_no_longer_told_to() {
    for (is_boat, is, was) in [
        (
            true,
            "aground, held, or its motors do not obey",
            "aground, held, or its motors did not obey",
        ),
        (
            false,
            "stuck, or its motors do not obey",
            "stuck, or its motors did not obey",
        ),
    ] {
        let mut model = scout();
        let info = Info {
            is_boat,
            ..Info::default()
        };
        answers(&mut model, RequestId(0), Topic::Info, &info, at(0));
        let mut alerts = Alerts::default();
        let text = format!("The vehicle does not move though told to go: {is}");
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
            let begun = alerts.look(&model, Subject::Robot, &[], at(ms));
            let expected = has_begun.then(|| (Alarm::Stuck, text.clone()));
            assert_eq!(begun, Vec::from_iter(expected), "{ms}");
            let active = alerts.iter().map(|alert| alert.is_active).next();
            assert_eq!(active, is_active, "{ms}");
        }
        assert_eq!(listed(&alerts), [(Alarm::Stuck, 2, false)]);
        let told: Vec<_> = alerts.iter().map(|alert| alert.text.clone()).collect();
        let past = format!("The vehicle did not move though told to go: {was}");
        assert_eq!(told, [past]);
        alerts.acknowledge(&Alarm::Stuck);
        assert_eq!(alerts.iter().count(), 0);
    }
}

#[test]
fn nobody_is_said_to_be_stuck_now_who_is_not_heard() {
    let mut model = scout();
    starts(&mut model, BootId([7; 16]), at(0));
    let mut alerts = Alerts::default();
    for ms in [0, 3_000] {
        drives(&mut model, 1.0, 0.0, at(ms));
        alerts.look(&model, Subject::Robot, &[], at(ms));
    }
    let said = |alerts: &Alerts| {
        let mut all = alerts.iter();
        let stuck = all.find(|alert| alert.alarm == Alarm::Stuck).unwrap();
        let word = stuck.text.split_whitespace().nth(2).unwrap().to_owned();
        (word, stuck.times, stuck.is_acknowledged)
    };
    assert_eq!(said(&alerts), ("does".to_owned(), 1, false));
    alerts.acknowledge(&Alarm::Stuck);
    alerts.look(&model, Subject::Robot, &[], at(5_000));
    assert!(model.is_stuck(), "by what was heard last");
    assert_eq!(said(&alerts), ("did".to_owned(), 1, true));
    assert!(alerts.iter().any(|alert| alert.alarm == Alarm::LinkLost));
    // The same goes on: nothing has begun.
    drives(&mut model, 1.0, 0.0, at(5_100));
    let begun = alerts.look(&model, Subject::Robot, &[], at(5_100));
    assert_eq!(begun, []);
    assert_eq!(said(&alerts), ("does".to_owned(), 1, true));
    // Another run of it has told nothing of that yet.
    starts(&mut model, BootId([9; 16]), at(5_200));
    alerts.look(&model, Subject::Robot, &[], at(5_200));
    assert_eq!(said(&alerts), ("did".to_owned(), 1, true));
}

#[test]
fn who_is_driven_by_nobody_is_not_stuck_and_by_another_nobody_here_knows() {
    let mut model = scout();
    let mut alerts = Alerts::default();
    for ms in [0, 3_000] {
        drives(&mut model, 1.0, 0.0, at(ms));
        alerts.look(&model, Subject::Robot, &[], at(ms));
    }
    for (state, is_active) in [
        (FleetState::DrivenBy("bert".parse().unwrap()), true),
        (FleetState::Free, false),
    ] {
        alerts.look_from_afar(Some(&state), at(10_000));
        assert_eq!(listed(&alerts), [(Alarm::Stuck, 1, is_active)]);
    }
}
