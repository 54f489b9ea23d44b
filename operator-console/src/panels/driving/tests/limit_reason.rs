//! Why other speeds are told than are asked for.

use super::*;

const FREE: SpeedLimits = SpeedLimits {
    forward_mps: 3.0,
    reverse_mps: 3.0,
    left_radps: 0.2,
    right_radps: 0.2,
};
const SLOWS: &str = "Slowing down as the collision monitor allows";
const BY_GUARD: &str = "Limited by the collision monitor";

/// A boat of 3 m/s and 0.2 rad/s, that is asked for and told these, m/s and rad/s.
fn boat(
    asked: [f32; 2],
    told: [f32; 2],
    clamp: Option<Clamp>,
    guard: CollisionMonitorState,
) -> Rig {
    let mut rig = Rig::driving();
    let velocity = |[linear_mps, angular_radps]: [f32; 2]| protocol::message::Velocity {
        linear_mps,
        angular_radps,
    };
    rig.is_boat = true;
    rig.teleop_client.limits = [3.0, 0.2];
    rig.teleop.requested = velocity(asked);
    rig.teleop.applied = velocity(told);
    rig.teleop.speed_allowed_mps = 3.0;
    rig.teleop.clamp = clamp;
    rig.teleop.collision_monitor = guard;
    rig
}

#[test]
fn who_is_told_more_than_the_guard_allows_slows_down_to_that() {
    let ahead = |forward_mps| SpeedLimits {
        forward_mps,
        ..FREE
    };
    let behind = SpeedLimits {
        reverse_mps: 0.4,
        ..FREE
    };
    let guard = Some(Clamp::CollisionMonitor);
    for (asked_mps, told_mps, clamp, limits, says) in [
        (
            1.8,
            1.08,
            guard,
            CollisionMonitorState::On(ahead(0.4)),
            Some(SLOWS),
        ),
        (
            1.8,
            1.78,
            None,
            CollisionMonitorState::UnknownSpace(ahead(0.3)),
            Some(SLOWS),
        ),
        (
            -1.8,
            -1.08,
            guard,
            CollisionMonitorState::On(behind),
            Some(SLOWS),
        ),
        // As it is written, it is there.
        (
            1.8,
            0.404,
            guard,
            CollisionMonitorState::On(ahead(0.4)),
            Some(BY_GUARD),
        ),
        (
            1.8,
            1.08,
            guard,
            CollisionMonitorState::On(behind),
            Some(BY_GUARD),
        ),
        (1.8, 1.78, None, CollisionMonitorState::Off, None),
    ] {
        let mut rig = boat([asked_mps, 0.0], [told_mps, 0.0], clamp, limits);
        assert_eq!(rig.data().clamp.as_deref(), says, "{told_mps} {limits:?}");
        rig.teleop.state = TeleopState::Stopping(StopReason::Released);
        rig.teleop.clamp = None;
        assert_eq!(rig.data().clamp, None, "it slows down to nothing");
    }
    let left = SpeedLimits {
        left_radps: 0.1,
        ..FREE
    };
    let turning = boat(
        [0.0, 0.2],
        [0.0, 0.19],
        guard,
        CollisionMonitorState::On(left),
    );
    assert_eq!(turning.data().clamp.as_deref(), Some(SLOWS));
}

#[test]
fn who_speeds_up_to_less_than_is_asked_for_is_told_what_will_hold_it_back() {
    let speeds_up = "Speeding up as the collision monitor allows";
    let left = SpeedLimits {
        left_radps: 0.15,
        ..FREE
    };
    for (told, limits, allowed_mps, says) in [
        ([1.44, 0.2], FREE, 3.0, "Speeding up"),
        // The turn slows the whole arc: to 2.25 m/s.
        ([1.44, 0.05], left, 3.0, speeds_up),
        ([2.25, 0.15], left, 3.0, BY_GUARD),
        (
            [1.44, 0.1],
            FREE,
            1.5,
            "Speeding up as the age of commands allows",
        ),
        // It still goes the other way.
        ([-0.5, 0.0], left, 3.0, "Changing direction"),
    ] {
        let mut rig = boat(
            [3.0, 0.2],
            told,
            Some(Clamp::Ramp),
            CollisionMonitorState::On(limits),
        );
        rig.teleop.speed_allowed_mps = allowed_mps;
        assert_eq!(rig.data().clamp.as_deref(), Some(says), "{told:?}");
    }
}

#[test]
fn what_is_stuck_is_held_back_by_the_guard_or_by_nothing_that_is_said() {
    for (clamp, says) in [
        (Clamp::Ramp, None),
        (Clamp::Age, None),
        (Clamp::CollisionMonitor, Some(BY_GUARD)),
    ] {
        let mut rig = boat(
            [3.0, 0.0],
            [1.44, 0.0],
            Some(clamp),
            CollisionMonitorState::On(FREE),
        );
        rig.velocity = [0.0; 2];
        let mut model = rig.model();
        let (status, _) = model.status().unwrap().clone();
        let (pose, _) = model.vehicle().pose().unwrap();
        says_again(&mut model, &pose, &status);
        let data = DrivingData::new(&model, &rig.teleop_client, at(4_100)).unwrap();
        let said = (data.headline.as_str(), data.clamp.as_deref());
        assert_eq!(said, ("Not moving", says), "{clamp:?}");
    }
}

/// Three seconds later everything is as it was.
fn says_again(model: &mut ConsoleModel, pose: &Pose, status: &Status) {
    inject(model, Topic::Pose, pose, at(4_000));
    inject(model, Topic::Status, status, at(4_000));
}

#[test]
fn who_creeps_by_a_guard_that_changes_its_mind_neither_speeds_up_nor_slows_down() {
    let ahead = |forward_mps| {
        CollisionMonitorState::UnknownSpace(SpeedLimits {
            forward_mps,
            ..FREE
        })
    };
    let ramp = Some(Clamp::Ramp);
    // Told at each of the last statuses, and what the guard allowed then, m/s.
    for (told_mps, lately_mps, says) in [
        (0.08, &[0.05, 0.5, 0.05, 0.5][..], Some(BY_GUARD)),
        (0.08, &[0.5, 0.05, 0.5, 0.05], Some(BY_GUARD)),
        (0.01, &[0.0, 0.3, 0.0, 0.3], Some(BY_GUARD)),
        // Who stood in the way has gone.
        (
            0.01,
            &[0.0, 0.0, 0.3],
            Some("Speeding up as the collision monitor allows"),
        ),
        // A wider way is opening.
        (
            0.08,
            &[0.4, 0.5],
            Some("Speeding up as the collision monitor allows"),
        ),
        // It comes nearer.
        (0.5, &[0.8, 0.6, 0.3], Some(SLOWS)),
    ] {
        let rig = boat([1.0, 0.0], [told_mps, 0.0], ramp, ahead(lately_mps[0]));
        let mut model = rig.model();
        for allowed_mps in lately_mps {
            let mut teleop = rig.teleop.clone();
            teleop.collision_monitor = ahead(*allowed_mps);
            let status = Status {
                teleop: Some(teleop),
                ..Status::default()
            };
            crate::test_support::inject(&mut model, Topic::Status, &status, at(1_050));
        }
        let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
        assert_eq!(data.clamp.as_deref(), says, "{told_mps} {lately_mps:?}");
    }
}

#[test]
fn what_the_guard_says_of_a_turn_that_nobody_asks_for_is_not_what_holds_back() {
    let limits = |forward_mps, right_radps| {
        CollisionMonitorState::On(SpeedLimits {
            forward_mps,
            right_radps,
            ..FREE
        })
    };
    let rig = boat(
        [1.0, 0.0],
        [0.6, 0.0],
        Some(Clamp::CollisionMonitor),
        CollisionMonitorState::Off,
    );
    let mut model = rig.model();
    for (forward_mps, right_radps) in [(0.8, 0.05), (0.7, 0.2), (0.6, 0.05), (0.4, 0.2)] {
        let mut teleop = rig.teleop.clone();
        teleop.collision_monitor = limits(forward_mps, right_radps);
        let status = Status {
            teleop: Some(teleop),
            ..Status::default()
        };
        inject(&mut model, Topic::Status, &status, at(1_050));
    }
    let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
    assert_eq!(data.clamp.as_deref(), Some(SLOWS));
}
