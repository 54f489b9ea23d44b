//! A guard that says one thing with one scan and another with the next.

use super::*;

const FREE: SpeedLimits = SpeedLimits {
    forward_mps: f32::INFINITY,
    reverse_mps: f32::INFINITY,
    left_radps: f32::INFINITY,
    right_radps: f32::INFINITY,
};

const fn ahead(forward_mps: f32) -> SpeedLimits {
    SpeedLimits {
        forward_mps,
        ..FREE
    }
}

/// The row of a guard that said this within the last second, the oldest first: what was asked for, m/s and rad/s, and
/// what it allowed.
fn row(told: &[([f32; 2], CollisionMonitorState)]) -> (Tone, String) {
    let rig = Rig::driving();
    let mut model = rig.model();
    for (asked, guard) in told {
        let mut teleop = rig.teleop.clone();
        [teleop.requested.linear_mps, teleop.requested.angular_radps] = *asked;
        teleop.collision_monitor = *guard;
        teleop.clamp = None;
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        inject(&mut model, Topic::Status, &status, at(1_050));
    }
    let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
    let mut rows = data.rows.into_iter();
    let (tone, (_, says)) = rows.find(|(_, (name, _))| name == "Guard").unwrap();
    (tone, says)
}

const GO: [f32; 2] = [0.8, 0.0];
const ARC: [f32; 2] = [0.8, 0.5];
const BACK: [f32; 2] = [-0.8, 0.0];

#[test]
fn the_row_of_the_guard_says_the_tightest_of_the_last_while() {
    let left = SpeedLimits {
        left_radps: 0.1,
        ..ahead(0.9)
    };
    for (told, tone, says) in [
        (
            vec![
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(FREE)),
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(FREE)),
            ],
            Tone::Warning,
            "Unknown ground, ahead ≤ 0.30 m/s at times",
        ),
        // It sees enough by turns only.
        (
            vec![
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(ahead(0.3))),
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(ahead(0.3))),
            ],
            Tone::Warning,
            "Unknown ground, ahead ≤ 0.30 m/s",
        ),
        // By turns: the words do not alternate.
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.3))),
                (GO, CollisionMonitorState::On(ahead(0.7))),
                (GO, CollisionMonitorState::On(ahead(0.3))),
            ],
            Tone::Good,
            "On, ahead ≤ 0.30 m/s at times",
        ),
        // Late data is no looser limit.
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.3))),
                (GO, CollisionMonitorState::Stale),
                (GO, CollisionMonitorState::On(ahead(0.3))),
            ],
            Tone::Good,
            "On, ahead ≤ 0.30 m/s",
        ),
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
            ],
            Tone::Warning,
            "Unknown ground, ahead is blocked at times",
        ),
        // What is so at times is not so now.
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.4))),
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::On(ahead(0.4))),
            ],
            Tone::Good,
            "On, ahead is blocked at times",
        ),
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.4))),
                (GO, CollisionMonitorState::On(ahead(0.0))),
            ],
            Tone::Good,
            "On, ahead is blocked",
        ),
        // Each limit for itself.
        (
            vec![
                (ARC, CollisionMonitorState::On(left)),
                (ARC, CollisionMonitorState::On(ahead(0.85))),
                (ARC, CollisionMonitorState::On(left)),
                (ARC, CollisionMonitorState::On(ahead(0.85))),
            ],
            Tone::Good,
            "On, turning left ≤ 6 °/s at times",
        ),
    ] {
        assert_eq!(row(&told), (tone, says.to_owned()), "{told:?}");
    }
}

#[test]
fn what_was_said_of_another_way_or_is_no_limit_is_no_tighter() {
    for (told, tone, says) in [
        (
            vec![
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.0))),
                (BACK, CollisionMonitorState::On(FREE)),
            ],
            Tone::Good,
            "On, behind is free",
        ),
        (
            vec![
                (ARC, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::On(FREE)),
            ],
            Tone::Good,
            "On, ahead is free",
        ),
        // What is no limit is as it is.
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::Stale),
            ],
            Tone::Warning,
            "Its data is late: nothing moves",
        ),
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::Off),
            ],
            Tone::Warning,
            "Off",
        ),
        (
            vec![
                (GO, CollisionMonitorState::Stale),
                (GO, CollisionMonitorState::On(FREE)),
            ],
            Tone::Good,
            "On, ahead is free",
        ),
    ] {
        assert_eq!(row(&told), (tone, says.to_owned()), "{told:?}");
    }
}

#[test]
fn what_is_over_is_over_and_what_is_new_holds() {
    for (told, tone, says) in [
        (
            vec![
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::UnknownSpace(ahead(0.3))),
                (GO, CollisionMonitorState::On(FREE)),
                (GO, CollisionMonitorState::On(FREE)),
            ],
            Tone::Good,
            "On, ahead is free",
        ),
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.0))),
                (GO, CollisionMonitorState::On(ahead(0.4))),
            ],
            Tone::Good,
            "On, ahead ≤ 0.40 m/s",
        ),
        // Whoever comes nearer is told so plainly.
        (
            vec![
                (GO, CollisionMonitorState::On(ahead(0.7))),
                (GO, CollisionMonitorState::On(ahead(0.5))),
                (GO, CollisionMonitorState::On(ahead(0.49))),
            ],
            Tone::Good,
            "On, ahead ≤ 0.49 m/s",
        ),
    ] {
        assert_eq!(row(&told), (tone, says.to_owned()), "{told:?}");
    }
}
