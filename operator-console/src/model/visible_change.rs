//! Whether a message changes the display enough for a frame at once. Other changes appear with the next periodic frame,
//! within a second: a robot that stands still costs no frames.

use protocol::message::{
    CollisionMonitorState, CommandCounters, Pose, RecordingStatus, SensorStatus, SpeedLimits,
    Status, TeleopStatus,
};

/// Less than a pixel at the greatest zoom, metres.
const STEP_M: f64 = 2e-3;
/// The same at the end of a vehicle of 3 m, as a quaternion component: half of the angle, radians.
const TURN: f32 = 1e-3;
/// Resolution of displayed speeds, m/s or rad/s.
const SPEED: f32 = 0.01;

pub(super) fn pose_changed(before: &Pose, now: &Pose) -> bool {
    let differ = |a: f32, b: f32, step: f32| (a - b).abs() >= step;
    let mut positions = before.position_m.into_iter().zip(now.position_m);
    let is_moved = positions.any(|(a, b)| (a - b).abs() >= STEP_M);
    let mut turns = before.quaternion_xyzw.into_iter().zip(now.quaternion_xyzw);
    let is_turned = turns.any(|(a, b)| differ(a, b, TURN));
    is_moved
        || is_turned
        || differ(before.speed_mps, now.speed_mps, SPEED)
        || differ(before.turn_rate_radps, now.turn_rate_radps, SPEED)
}

/// Whether a status changes in more than counters, rates and ages.
pub(super) fn status_changed(before: &Status, now: &Status) -> bool {
    without_counters(before) != without_counters(now)
}

fn without_counters(status: &Status) -> Status {
    let sensor = |sensor: &SensorStatus| SensorStatus {
        messages: 0,
        rate_hz: 0.0,
        age_ms: None,
        dropped: 0,
        ..sensor.clone()
    };
    let recording = status.recording.as_ref();
    Status {
        has_ended: status.has_ended,
        consoles: status.consoles,
        info_revision: status.info_revision,
        sensors: status.sensors.iter().map(sensor).collect(),
        recording: recording.map(|recording| RecordingStatus {
            duration_s: 0,
            bytes: 0,
            free_bytes: None,
            lost: 0,
            ..recording.clone()
        }),
        teleop: status.teleop.as_ref().map(teleop),
        ..Status::default()
    }
}

fn teleop(teleop: &TeleopStatus) -> TeleopStatus {
    let no_limits = SpeedLimits {
        forward_mps: 0.0,
        reverse_mps: 0.0,
        left_radps: 0.0,
        right_radps: 0.0,
    };
    TeleopStatus {
        age_ms: None,
        peak_age_ms: None,
        speed_allowed_mps: 0.0,
        ground_age_ms: [None; 4],
        collision_monitor: match teleop.collision_monitor {
            CollisionMonitorState::On(_) => CollisionMonitorState::On(no_limits),
            CollisionMonitorState::UnknownSpace(_) => {
                CollisionMonitorState::UnknownSpace(no_limits)
            }
            other => other,
        },
        counters: CommandCounters {
            accepted: 0,
            ..teleop.counters.clone()
        },
        ..teleop.clone()
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{AgeToken, RecordingState, SensorFault, TeleopState};

    use super::*;
    use crate::test_support::{idle_teleop_status, pose_at_rest};

    fn pose() -> Pose {
        Pose {
            position_m: [1.0, 2.0, 0.0],
            token: Some(AgeToken { n: 1, nonce: 2 }),
            ..pose_at_rest()
        }
    }

    fn monitor(limit: f32) -> CollisionMonitorState {
        CollisionMonitorState::On(SpeedLimits {
            forward_mps: limit,
            reverse_mps: limit,
            left_radps: limit,
            right_radps: limit,
        })
    }

    fn status() -> Status {
        Status {
            sensors: vec![SensorStatus {
                name: "laser".to_owned(),
                messages: 10,
                rate_hz: 9.9,
                age_ms: Some(40),
                dropped: 0,
                fault: None,
            }],
            recording: Some(RecordingStatus {
                state: RecordingState::Recording,
                file: "a.mcap".to_owned(),
                files: 1,
                duration_s: 5,
                bytes: 1000,
                free_bytes: Some(9000),
                lost: 0,
            }),
            teleop: Some(TeleopStatus {
                age_ms: Some(30),
                peak_age_ms: Some(50),
                collision_monitor: monitor(1.0),
                ..idle_teleop_status()
            }),
            ..Status::default()
        }
    }

    fn changed(change: impl Fn(&mut Status)) -> bool {
        let mut now = status();
        change(&mut now);
        assert_ne!(now, status(), "nothing was changed");
        status_changed(&status(), &now)
    }

    #[test]
    fn standing_vehicle_needs_no_frames() {
        let seen = |change: fn(&mut Pose)| {
            let mut now = pose();
            change(&mut now);
            pose_changed(&pose(), &now)
        };
        assert!(!seen(|now| now.token = None));
        assert!(!seen(|now| now.position_m[1] += 0.001));
        assert!(!seen(|now| now.quaternion_xyzw[0] = 0.0009));
        assert!(seen(|now| now.position_m[1] += 0.003));
        assert!(seen(|now| now.position_m[0] -= 0.003));
        assert!(seen(|now| now.quaternion_xyzw[2] = -0.002));
        assert!(seen(|now| now.speed_mps = 0.02));
        assert!(seen(|now| now.turn_rate_radps = -0.02));
    }

    #[test]
    fn figures_that_only_count_on_are_no_news() {
        assert!(!changed(|now| now.data_time_ns = 1));
        assert!(!changed(|now| now.scans_mapped = 7));
        assert!(!changed(|now| now.tiles = [3, 9000]));
        assert!(!changed(|now| {
            now.sensors[0].age_ms = Some(60);
            now.sensors[0].messages += 1;
        }));
        assert!(!changed(|now| now.recording.as_mut().unwrap().bytes += 1));
        assert!(!changed(|now| {
            let teleop = now.teleop.as_mut().unwrap();
            teleop.age_ms = None;
            teleop.counters.accepted += 50;
            teleop.collision_monitor = monitor(0.5);
        }));
    }

    #[test]
    fn status_changes_need_a_frame() {
        fn teleop(now: &mut Status) -> &mut TeleopStatus {
            now.teleop.as_mut().unwrap()
        }
        let changes: [fn(&mut Status); 9] = [
            |now| now.has_ended = true,
            |now| now.info_revision = 2,
            |now| now.sensors[0].fault = Some(SensorFault::Silent),
            |now| now.recording.as_mut().unwrap().state = RecordingState::Failed,
            |now| now.recording = None,
            |now| teleop(now).state = TeleopState::EStop,
            |now| teleop(now).collision_monitor = CollisionMonitorState::Stale,
            |now| teleop(now).applied.linear_mps = 0.2,
            |now| teleop(now).counters.involuntary_stops = 1,
        ];
        for (at, change) in changes.into_iter().enumerate() {
            assert!(changed(change), "change {at}");
        }
    }
}
