use std::f64::consts::{FRAC_PI_2, TAU};

use super::*;
use measurement::mount::Mount;
use measurement::pose;
use measurement::pose::planar;
use nalgebra::Point3;
use proptest::prelude::*;

use crate::sample_synchronizer::MAX_SAMPLES;
use crate::test_data::{ATTITUDE, about, at, imu, imu_at};

const RADIUS_M: f64 = 0.125;

fn settings() -> DeadReckoningSettings {
    DeadReckoningSettings {
        wheels: WheelSettings {
            left_joint: "left".to_owned(),
            right_joint: "right".to_owned(),
            radius_m: RADIUS_M,
            max_speed_mps: 9.0,
        },
        wheels_time_offset: RobotDuration::ZERO,
        attitude: ATTITUDE,
        max_gap: RobotDuration::from_millis(500),
    }
}

fn smoothed(window_ms: i64) -> DeadReckoningSettings {
    let mut settings = settings();
    settings.attitude.smoothing = RobotDuration::from_millis(window_ms);
    settings
}

#[derive(Clone, Debug)]
enum Message {
    Joints([f64; 2]),
    Imu(UnitQuaternion<f64>),
}

type StampedMessage = (RobotTime, Message);

fn joints([left_rad, right_rad]: [f64; 2]) -> Vec<(String, f64)> {
    vec![
        ("left".to_owned(), left_rad),
        ("right".to_owned(), right_rad),
    ]
}

fn push(reckoning: &mut DeadReckoning, message: &StampedMessage, out: &mut Vec<StampedPose>) {
    match &message.1 {
        Message::Joints(angles_rad) => reckoning.push_joints(message.0, &joints(*angles_rad), out),
        Message::Imu(attitude) => reckoning.push_attitude(message.0, &imu_at(*attitude), out),
    }
}

fn reckoned(settings: DeadReckoningSettings, messages: &[StampedMessage]) -> Vec<StampedPose> {
    let mut reckoning = DeadReckoning::new(settings);
    let mut out = Vec::new();
    for message in messages {
        push(&mut reckoning, message, &mut out);
    }
    reckoning.finish(&mut out);
    assert_eq!(*reckoning.drops(), DropCounts::default());
    assert!(out.is_sorted_by(|a, b| a.0 < b.0));
    out
}

fn turned(roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> UnitQuaternion<f64> {
    about(Vector3::z(), yaw_rad) * about(Vector3::y(), pitch_rad) * about(Vector3::x(), roll_rad)
}

/// A smooth drive: speed and angles oscillate about a mean.
#[derive(Clone, Copy, Debug)]
struct Drive {
    speed_mps: f64,
    speed_swing_mps: f64,
    turn_rate_radps: f64,
    pitch_swing_rad: f64,
    roll_swing_rad: f64,
    rate_radps: f64,
}

const DURATION_S: f64 = 6.0;

impl Drive {
    fn any() -> impl Strategy<Value = Self> {
        let speed = (-1.5..1.5f64, -0.5..0.5f64, -0.8..0.8f64);
        (speed, -0.3..0.3f64, -0.3..0.3f64, 0.2..2.0f64).prop_map(
            |((speed_mps, speed_swing_mps, turn_rate_radps), pitch, roll, rate_radps)| Self {
                speed_mps,
                speed_swing_mps,
                turn_rate_radps,
                pitch_swing_rad: pitch,
                roll_swing_rad: roll,
                rate_radps,
            },
        )
    }

    fn speed_mps(&self, secs: f64) -> f64 {
        self.speed_mps + self.speed_swing_mps * libm::sin(self.rate_radps * secs)
    }

    fn distance_m(&self, secs: f64) -> f64 {
        let swung = (1.0 - libm::cos(self.rate_radps * secs)) / self.rate_radps;
        self.speed_mps * secs + self.speed_swing_mps * swung
    }

    fn attitude(&self, secs: f64) -> UnitQuaternion<f64> {
        let swing = libm::sin(self.rate_radps * secs);
        let yaw_rad = 0.7 + self.turn_rate_radps * secs;
        turned(
            self.roll_swing_rad * swing,
            self.pitch_swing_rad * swing,
            yaw_rad,
        )
    }

    /// Simpson's integral of the speed along the attitude, to far below a micrometre.
    fn position_m(&self, until_s: f64) -> Vector3<f64> {
        let velocity = |secs| self.attitude(secs) * (Vector3::x() * self.speed_mps(secs));
        let steps = 2000;
        let step_s = until_s / f64::from(steps);
        let slice = |n| {
            let from = f64::from(n) * step_s;
            let middle = velocity(from + 0.5 * step_s);
            (velocity(from) + middle * 4.0 + velocity(from + step_s)) * (step_s / 6.0)
        };
        (0..steps).map(slice).sum()
    }

    fn angles_rad(&self, secs: f64) -> [f64; 2] {
        // The gain of one wheel in a curve is the loss of the other.
        let turned_rad = 2.0 * self.turn_rate_radps * secs;
        let mean_rad = self.distance_m(secs) / RADIUS_M;
        [mean_rad - turned_rad, mean_rad + turned_rad]
    }

    /// 50 Hz of wheels, 100 Hz of attitudes.
    fn messages(&self) -> Vec<StampedMessage> {
        let mut messages = Vec::new();
        for tick in 0..=(DURATION_S * 100.0) as i32 {
            let secs = f64::from(tick) * 0.01;
            messages.push((at(secs), Message::Imu(self.attitude(secs))));
            if tick % 2 == 0 {
                messages.push((at(secs), Message::Joints(self.angles_rad(secs))));
            }
        }
        messages
    }
}

/// The same messages, those of one kind stamped `by` later.
fn late(
    messages: &[StampedMessage],
    by: RobotDuration,
    is_late: fn(&Message) -> bool,
) -> Vec<StampedMessage> {
    let mut messages = messages.to_vec();
    for (stamp, message) in &mut messages {
        if is_late(message) {
            *stamp = *stamp + by;
        }
    }
    messages.sort_by_key(|(stamp, _)| *stamp);
    messages
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_smooth_drive_in_space_is_followed(drive in Drive::any()) {
        for (smoothing_ms, within_m) in [(0, 1e-3), (100, 0.01)] {
            let poses = reckoned(smoothed(smoothing_ms), &drive.messages());
            prop_assert_eq!(poses.len(), 601);
            for (stamp, pose) in poses.iter().step_by(50) {
                let secs = stamp.as_secs_f64();
                let error_m = (pose.translation.vector - drive.position_m(secs)).norm();
                prop_assert!(error_m < within_m, "{error_m} m off at {secs} s");
                let error_rad = pose.rotation.angle_to(&drive.attitude(secs));
                prop_assert!(error_rad < within_m, "{error_rad} rad off at {secs} s");
            }
        }
    }

    #[test]
    fn encoders_that_are_wrong_by_a_factor_scale_the_way_by_it(
        drive in Drive::any(), scale in -0.1..0.1f64,
    ) {
        let messages = drive.messages();
        let mut wrong = messages.clone();
        for (_, message) in &mut wrong {
            if let Message::Joints(angles_rad) = message {
                *angles_rad = angles_rad.map(|angle_rad| angle_rad * (1.0 + scale));
            }
        }
        for (right, wrong) in reckoned(settings(), &messages).iter().zip(reckoned(settings(), &wrong)) {
            let expected = right.1.translation.vector * (1.0 + scale);
            prop_assert!((wrong.1.translation.vector - expected).norm() < 1e-9);
        }
    }

    #[test]
    fn a_sensor_that_is_late_gives_the_same_poses_with_its_offset(drive in Drive::any()) {
        let messages = drive.messages();
        let on_time = smoothed(100);
        let expected = reckoned(on_time.clone(), &messages);
        let by = RobotDuration::from_millis(200);
        let back = RobotDuration::from_millis(-200);
        let wheels = late(&messages, by, |message| matches!(message, Message::Joints(_)));
        let wheels_late = DeadReckoningSettings { wheels_time_offset: back, ..on_time.clone() };
        prop_assert_eq!(&reckoned(wheels_late, &wheels), &expected);
        let attitude = late(&messages, by, |message| matches!(message, Message::Imu(_)));
        let mut attitude_late = on_time.clone();
        attitude_late.attitude.time_offset = back;
        prop_assert_eq!(&reckoned(attitude_late, &attitude), &expected);
        // Without the offset they differ, unless the vehicle is stationary.
        if drive.speed_mps.abs() > 0.5 {
            prop_assert!(reckoned(on_time, &wheels) != expected);
        }
    }

    #[test]
    fn a_turned_sensor_gives_the_vehicles_attitude(
        drive in Drive::any(), roll_deg in -180.0..180.0f64, pitch_deg in -90.0..90.0f64,
        yaw_deg in -180.0..180.0f64,
    ) {
        let mount = Mount { roll_deg, pitch_deg, yaw_deg, x_m: 0.3, ..Mount::default() };
        let base_from_imu = mount.base_from_sensor().rotation;
        let messages = drive.messages();
        let mut of_sensor = messages.clone();
        for (_, message) in &mut of_sensor {
            if let Message::Imu(attitude) = message {
                *attitude *= base_from_imu;
            }
        }
        let mut settings_turned = settings();
        settings_turned.attitude.base_from_imu = base_from_imu;
        let straight = reckoned(settings(), &messages);
        for (got, expected) in reckoned(settings_turned, &of_sensor).iter().zip(straight) {
            prop_assert!((got.1.translation.vector - expected.1.translation.vector).norm() < 1e-9);
            prop_assert!(got.1.rotation.angle_to(&expected.1.rotation) < 1e-7);
        }
    }

    #[test]
    fn any_input_gives_finite_poses_without_panic(
        messages in prop::collection::vec(
            (any::<i64>(), any::<bool>(), prop::array::uniform4(any::<f64>()), any::<bool>()), 0..60,
        ),
        offset_s in -3600.0..3600.0f64,
    ) {
        let mut reckoning = DeadReckoning::new(DeadReckoningSettings {
            wheels_time_offset: RobotDuration::from_secs_f64(offset_s),
            ..smoothed(100)
        });
        let mut out = Vec::new();
        for (nanos, is_imu, values, is_sensible) in messages {
            let stamp = RobotTime::from_nanos(if is_sensible { nanos % 1_000_000_000 } else { nanos });
            let level = [0.0, 0.0, 0.0, 1.0];
            if is_imu {
                let xyzw = if is_sensible { level } else { values };
                reckoning.push_attitude(stamp, &imu(Some(xyzw)), &mut out);
            } else {
                let [left, right, ..] = if is_sensible { level } else { values };
                reckoning.push_joints(stamp, &joints([left, right]), &mut out);
            }
        }
        reckoning.finish(&mut out);
        for (_, pose) in &out {
            prop_assert!(pose.translation.vector.iter().all(|value| value.is_finite()));
            prop_assert!((pose.rotation.norm() - 1.0).abs() < 1e-9);
        }
    }
}

fn straight(attitude: UnitQuaternion<f64>, ticks: i32) -> Vec<StampedMessage> {
    let mut messages = Vec::new();
    for tick in 0..ticks {
        let secs = f64::from(tick) * 0.01;
        messages.push((at(secs), Message::Imu(attitude)));
        messages.push((at(secs), Message::Joints([secs / RADIUS_M; 2])));
    }
    messages
}

#[test]
fn the_way_up_a_ramp_leads_up() {
    // Nose up by 10°, to the left by 90°: 1 m/s for 4 s.
    let nose_up_rad = -10f64.to_radians();
    let poses = reckoned(
        settings(),
        &straight(turned(0.0, nose_up_rad, FRAC_PI_2), 401),
    );
    let (stamp, pose) = poses.last().unwrap();
    assert_eq!(*stamp, at(4.0));
    let expected = Point3::new(
        0.0,
        4.0 * libm::cos(nose_up_rad),
        -4.0 * libm::sin(nose_up_rad),
    );
    assert!((pose * Point3::origin() - expected).norm() < 1e-9, "{pose}");
    assert_eq!(poses[0].1.translation, planar(0.0, 0.0, 0.0).translation);
}

#[test]
fn poses_at_the_stamps_of_both_sensors() {
    let level = Message::Imu(UnitQuaternion::identity());
    let wheels = |distance_m: f64| Message::Joints([distance_m / RADIUS_M; 2]);
    let messages = [
        (at(0.00), level.clone()),
        (at(0.03), wheels(5.0)),
        (at(0.05), Message::Imu(turned(0.0, 0.0, 0.1))),
        (at(0.10), level.clone()),
        (at(0.13), wheels(5.1)),
        (at(0.15), level.clone()),
    ];
    let poses = reckoned(settings(), &messages);
    let stamps: Vec<_> = poses.iter().map(|(stamp, _)| *stamp).collect();
    assert_eq!(stamps, [0.03, 0.05, 0.1, 0.13].map(at));
    let yaw_rad: Vec<_> = poses.iter().map(|(_, pose)| pose::yaw_rad(pose)).collect();
    assert!((yaw_rad[0] - 0.06).abs() < 1e-6, "{yaw_rad:?}");
    assert!((yaw_rad[1] - 0.1).abs() < 1e-9, "{yaw_rad:?}");
    // From 5 m on: the first wheel angles are the origin.
    let distance_m: Vec<_> = poses
        .iter()
        .map(|(_, pose)| pose.translation.vector.norm())
        .collect();
    for (got, expected) in distance_m.iter().zip([0.0, 0.02, 0.07, 0.1]) {
        assert!((got - expected).abs() < 1e-4, "{distance_m:?}");
    }
}

#[test]
fn gaps_give_no_poses_but_displacement_continues() {
    for is_silent in [
        |message: &Message| matches!(message, Message::Imu(_)),
        |message: &Message| matches!(message, Message::Joints(_)),
    ] {
        let mut messages = straight(UnitQuaternion::identity(), 401);
        messages.retain(|(stamp, message)| {
            !(is_silent(message) && at(1.0) < *stamp && *stamp < at(3.0))
        });
        let poses = reckoned(settings(), &messages);
        let none_between = |(stamp, _): &StampedPose| *stamp <= at(1.0) || *stamp >= at(3.0);
        assert!(poses.iter().all(none_between));
        for (stamp, pose) in &poses {
            assert!((pose.translation.x - stamp.as_secs_f64()).abs() < 1e-9);
        }
        assert_eq!(poses.last().map(|(stamp, _)| *stamp), Some(at(4.0)));
    }
}

#[test]
fn what_makes_no_sense_is_left_out_and_counted() {
    let mut messages = straight(UnitQuaternion::identity(), 101);
    let mut reckoning = DeadReckoning::new(settings());
    let mut out = Vec::new();
    for message in messages.drain(..200) {
        push(&mut reckoning, &message, &mut out);
    }
    let bad_attitudes = [
        Some([f64::NAN, 0.0, 0.0, 1.0]),
        Some([0.0; 4]),
        Some([0.0, 0.0, 0.0, 2.0]),
        None,
    ];
    for xyzw in bad_attitudes {
        reckoning.push_attitude(at(0.995), &imu(xyzw), &mut out);
    }
    let before = [0.5, 0.99].map(at);
    for stamp in before {
        let level = imu(Some([0.0, 0.0, 0.0, 1.0]));
        reckoning.push_attitude(stamp, &level, &mut out);
        reckoning.push_joints(stamp, &joints([0.0; 2]), &mut out);
    }
    let wrapped = 0.995 / RADIUS_M - TAU;
    let back = 0.995 / RADIUS_M;
    reckoning.push_joints(at(0.993), &joints([f64::NAN, 1.0]), &mut out);
    reckoning.push_joints(at(0.994), &joints([wrapped, back]), &mut out);
    reckoning.push_joints(at(0.995), &joints([back; 2]), &mut out);
    reckoning.push_joints(at(0.996), &[("arm".to_owned(), 1.0)], &mut out);
    for message in &messages {
        push(&mut reckoning, message, &mut out);
    }
    reckoning.finish(&mut out);
    let drops: Vec<_> = reckoning.drops().iter().collect();
    assert_eq!(
        drops,
        [
            (DropReason::BadPose, 4),
            (DropReason::Late, 4),
            (DropReason::WheelJump, 3),
        ]
    );
    // The steps at the jumps are missing from 1 m, 5 mm; none is added.
    let (stamp, last) = out.last().unwrap();
    assert_eq!(*stamp, at(1.0));
    assert!((last.translation.x - 0.995).abs() < 1e-9, "{last}");
}

#[test]
fn memory_is_bounded_whichever_sensor_is_missing() {
    let level = |secs| (at(secs), Message::Imu(UnitQuaternion::identity()));
    let wheels = |secs: f64| (at(secs), Message::Joints([secs / RADIUS_M; 2]));
    let (mut reckoning, mut out) = (DeadReckoning::new(settings()), Vec::new());
    // Only attitudes at first: the newest are kept.
    for n in 0..15_000 {
        push(&mut reckoning, &level(f64::from(n) * 0.01), &mut out);
    }
    assert_eq!(reckoning.joined.kept().1, MAX_SAMPLES);
    push(&mut reckoning, &wheels(149.98), &mut out);
    push(&mut reckoning, &wheels(149.99), &mut out);
    assert_eq!(out.len(), 2);
    assert_eq!(*reckoning.drops(), DropCounts::default());
    // Then only wheels: their displacement after the queue is full is not lost.
    for n in 15_000..30_000 {
        push(&mut reckoning, &wheels(f64::from(n) * 0.01), &mut out);
    }
    assert_eq!(reckoning.joined.kept().0, MAX_SAMPLES);
    assert_eq!(reckoning.drops().get(DropReason::QueueFull), 5001);
    for n in 30_000..30_010 {
        push(&mut reckoning, &level(f64::from(n) * 0.01), &mut out);
        push(&mut reckoning, &wheels(f64::from(n) * 0.01), &mut out);
    }
    let (stamp, last) = out.last().unwrap();
    assert_eq!(*stamp, at(300.09));
    assert!(
        (last.translation.x - (300.09 - 149.98)).abs() < 1e-6,
        "{last}"
    );
}

#[test]
fn clock_reset_restarts_at_the_origin() {
    let (mut reckoning, mut out) = (DeadReckoning::new(settings()), Vec::new());
    for message in straight(UnitQuaternion::identity(), 50) {
        push(&mut reckoning, &message, &mut out);
    }
    reckoning.push_joints(at(0.0), &joints([0.0; 2]), &mut out);
    reckoning.reset();
    out.clear();
    for message in straight(turned(0.0, 0.0, FRAC_PI_2), 50) {
        push(&mut reckoning, &message, &mut out);
    }
    assert_eq!(
        out[0],
        (
            at(0.0),
            Pose::from_parts(Vector3::zeros().into(), turned(0.0, 0.0, FRAC_PI_2))
        )
    );
    assert_eq!(reckoning.drops().get(DropReason::Late), 1, "counts stay");
}

#[test]
fn the_lag_is_that_of_the_slower_sensor() {
    let ms = RobotDuration::from_millis;
    let lag = |wheels_ms, attitude_ms, smoothing_ms| {
        let mut settings = smoothed(smoothing_ms);
        settings.wheels_time_offset = ms(wheels_ms);
        settings.attitude.time_offset = ms(attitude_ms);
        settings.lag()
    };
    assert_eq!(lag(0, 0, 100), ms(50));
    assert_eq!(lag(-200, 0, 100), ms(200));
    assert_eq!(lag(-200, -180, 100), ms(230));
    assert_eq!(lag(10, 200, 100), ms(0));
}
