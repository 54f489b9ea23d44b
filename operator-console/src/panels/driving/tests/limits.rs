//! Monitor row and limit reason.

use CollisionMonitorState::{Off, On, Silent, Stale, UnknownSpace};

use super::*;

const UP_TO_LIMIT: &str = "Speeding up as the collision monitor allows";
const DOWN_TO_LIMIT: &str = "Slowing down as the collision monitor allows";
const LIMITED: &str = "Limited by the collision monitor";
const GO: [f32; 2] = [0.8, 0.0];
const ARC: [f32; 2] = [0.8, 0.5];
const BACK: [f32; 2] = [-0.8, 0.0];
const FREE: f32 = f32::INFINITY;
/// Limits of the boat below.
const BOAT: SpeedLimits = SpeedLimits {
    forward_mps: 3.0,
    reverse_mps: 3.0,
    left_mps: 0.0,
    right_mps: 0.0,
    left_radps: 0.2,
    right_radps: 0.2,
};

#[test]
fn monitor_row_names_the_requested_direction() {
    let (none, ramp, by_monitor) = (None, Some(Clamp::Ramp), Some(Clamp::CollisionMonitor));
    for (asked, [forward_mps, reverse_mps, left_radps, right_radps], clamp, text) in [
        ([0.0, 0.0], [0.25, 0.0, 0.0, 0.0], none, "ahead ≤ 0.25 m/s"),
        (
            [0.7, 0.5],
            [0.25, 0.0, 0.0, 0.0],
            by_monitor,
            "ahead ≤ 0.25 m/s",
        ),
        (
            BACK,
            [FREE, 0.0, FREE, FREE],
            by_monitor,
            "behind is blocked",
        ),
        (
            BACK,
            [0.0, 0.2, FREE, FREE],
            by_monitor,
            "behind ≤ 0.20 m/s",
        ),
        (BACK, [0.0, FREE, 0.0, 0.0], none, "behind is free"),
        (
            [-0.72, 0.5],
            [0.0, FREE, 0.0, FREE],
            by_monitor,
            "turning left is blocked",
        ),
        (
            [0.7, -0.5],
            [FREE, 0.0, 0.0, 0.25],
            ramp,
            "turning right ≤ 14 °/s",
        ),
        // A boat above its limit gets no thrust.
        ([0.7, 0.5], [FREE, 0.0, FREE, FREE], by_monitor, "limits it"),
        (
            [0.0, 0.5],
            [0.0, 0.0, 0.25, FREE],
            by_monitor,
            "turning left ≤ 14 °/s",
        ),
        (
            [0.0, -0.5],
            [0.0, 0.0, FREE, 0.0],
            by_monitor,
            "turning right is blocked",
        ),
        (
            [0.0, -0.5],
            [0.0, 0.0, 0.0, FREE],
            ramp,
            "turning right is free",
        ),
    ] {
        let mut rig = Rig::driving();
        rig.request(asked);
        rig.teleop.clamp = clamp;
        rig.teleop.collision_monitor = On(SpeedLimits {
            forward_mps,
            reverse_mps,
            left_mps: 0.0,
            right_mps: 0.0,
            left_radps,
            right_radps,
        });
        let expected = Some((Tone::Good, format!("On, {text}")));
        assert_eq!(rig.row("Monitor"), expected, "{asked:?}");
    }
}

/// The monitor's row after these reports (oldest first): requested speeds and state.
fn row(reports: &[([f32; 2], CollisionMonitorState)]) -> (Tone, String) {
    let rig = Rig::driving();
    let mut model = rig.model();
    for (asked, monitor) in reports {
        let mut teleop = rig.teleop.clone();
        [teleop.requested.linear_mps, teleop.requested.angular_radps] = *asked;
        teleop.collision_monitor = *monitor;
        teleop.clamp = None;
        inject(&mut model, Topic::Status, &status(&teleop), at(1_050));
    }
    let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
    let mut rows = data.rows.into_iter();
    let (tone, (_, text)) = rows.find(|(_, (name, _))| name == "Monitor").unwrap();
    (tone, text)
}

#[test]
fn monitor_row_shows_the_strictest_limit_of_the_last_1_5_s() {
    let on = |mps| On(ahead(mps));
    let unknown = |mps| UnknownSpace(ahead(mps));
    let free = || On(UNLIMITED);
    let left = || {
        On(SpeedLimits {
            left_radps: 0.1,
            ..ahead(0.9)
        })
    };
    for (reports, text) in [
        (
            vec![unknown(0.3), free(), unknown(0.3), free()],
            "Unknown ground, ahead ≤ 0.30 m/s at times",
        ),
        // Unknown space alternates, the limit does not.
        (
            vec![unknown(0.3), on(0.3), unknown(0.3), on(0.3)],
            "Unknown ground, ahead ≤ 0.30 m/s",
        ),
        (
            vec![on(0.3), on(0.7), on(0.3)],
            "On, ahead ≤ 0.30 m/s at times",
        ),
        // Late data is not a looser limit.
        (vec![on(0.3), Stale, on(0.3)], "On, ahead ≤ 0.30 m/s"),
        (
            vec![on(0.0), unknown(0.3), on(0.0), unknown(0.3)],
            "Unknown ground, ahead is blocked at times",
        ),
        (
            vec![on(0.4), on(0.0), on(0.4)],
            "On, ahead is blocked at times",
        ),
        (vec![on(0.4), on(0.0)], "On, ahead is blocked"),
        // States without limits are shown as they are.
        (vec![on(0.0), Stale], "Its data is late: nothing moves"),
        (vec![on(0.0), Off], "Off"),
        (vec![Stale, free()], "On, ahead is free"),
        (
            vec![unknown(0.3), unknown(0.3), free(), free()],
            "On, ahead is free",
        ),
        (vec![on(0.0), on(0.4)], "On, ahead ≤ 0.40 m/s"),
        // A limit that decreases does not alternate.
        (vec![on(0.7), on(0.5), on(0.49)], "On, ahead ≤ 0.49 m/s"),
    ] {
        let tone = if text.starts_with("On") {
            Tone::Good
        } else {
            Tone::Warning
        };
        let reports: Vec<_> = reports.into_iter().map(|state| (GO, state)).collect();
        assert_eq!(row(&reports), (tone, text.to_owned()), "{reports:?}");
    }
    // Each axis has its own limit.
    let arc = row(&[left(), on(0.85), left(), on(0.85)].map(|state| (ARC, state)));
    let text = "On, turning left ≤ 6 °/s at times".to_owned();
    assert_eq!(arc, (Tone::Good, text));
    // Reports of another direction do not count.
    let behind = row(&[(GO, unknown(0.0)), (BACK, free())]);
    assert_eq!(behind, (Tone::Good, "On, behind is free".to_owned()));
    let straight = row(&[(ARC, on(0.0)), (GO, free())]);
    assert_eq!(straight, (Tone::Good, "On, ahead is free".to_owned()));
}

/// A boat of 3 m/s and 0.2 rad/s with requested and applied speeds, m/s and rad/s.
fn boat(
    requested: [f32; 2],
    applied: [f32; 2],
    clamp: Option<Clamp>,
    monitor: CollisionMonitorState,
) -> Rig {
    let mut rig = Rig::driving();
    rig.is_boat = true;
    rig.teleop_client.limits = [3.0, 0.0, 0.2];
    rig.request(requested);
    [
        rig.teleop.applied.linear_mps,
        rig.teleop.applied.angular_radps,
    ] = applied;
    rig.teleop.speed_allowed_mps = 3.0;
    rig.teleop.clamp = clamp;
    rig.teleop.collision_monitor = monitor;
    rig
}

#[test]
fn slowing_down_to_the_monitors_limit() {
    let ahead = |forward_mps| SpeedLimits {
        forward_mps,
        ..BOAT
    };
    let behind = SpeedLimits {
        reverse_mps: 0.4,
        ..BOAT
    };
    let monitor = Some(Clamp::CollisionMonitor);
    for (requested_mps, applied_mps, clamp, limits, reason) in [
        (1.8, 1.08, monitor, On(ahead(0.4)), Some(DOWN_TO_LIMIT)),
        (
            1.8,
            1.78,
            None,
            UnknownSpace(ahead(0.3)),
            Some(DOWN_TO_LIMIT),
        ),
        (-1.8, -1.08, monitor, On(behind), Some(DOWN_TO_LIMIT)),
        (1.8, 0.404, monitor, On(ahead(0.4)), Some(LIMITED)),
        (1.8, 1.08, monitor, On(behind), Some(LIMITED)),
        (1.8, 1.78, None, Off, None),
    ] {
        let mut rig = boat([requested_mps, 0.0], [applied_mps, 0.0], clamp, limits);
        assert_eq!(
            rig.data().clamp.as_deref(),
            reason,
            "{applied_mps} {limits:?}"
        );
        rig.teleop.state = TeleopState::Stopping(StopReason::Released);
        rig.teleop.clamp = None;
        assert_eq!(rig.data().clamp, None);
    }
    let left = SpeedLimits {
        left_radps: 0.1,
        ..BOAT
    };
    let turning = boat([0.0, 0.2], [0.0, 0.19], monitor, On(left));
    assert_eq!(turning.data().clamp.as_deref(), Some(DOWN_TO_LIMIT));
}

#[test]
fn speeding_up_to_a_limit_names_the_limit() {
    let left = SpeedLimits {
        left_radps: 0.15,
        ..BOAT
    };
    for (applied, limits, allowed_mps, reason) in [
        ([1.44, 0.2], BOAT, 3.0, "Speeding up"),
        // The turn slows the whole arc: to 2.25 m/s.
        ([1.44, 0.05], left, 3.0, UP_TO_LIMIT),
        ([2.25, 0.15], left, 3.0, LIMITED),
        (
            [1.44, 0.1],
            BOAT,
            1.5,
            "Speeding up as the age of commands allows",
        ),
        ([-0.5, 0.0], left, 3.0, "Changing direction"),
    ] {
        let mut rig = boat([3.0, 0.2], applied, Some(Clamp::Ramp), On(limits));
        rig.teleop.speed_allowed_mps = allowed_mps;
        assert_eq!(rig.data().clamp.as_deref(), Some(reason), "{applied:?}");
    }
}

#[test]
fn a_stuck_vehicle_is_limited_by_the_monitor_only() {
    for (clamp, reason) in [
        (Clamp::Ramp, None),
        (Clamp::Age, None),
        (Clamp::CollisionMonitor, Some(LIMITED)),
    ] {
        let mut rig = boat([3.0, 0.0], [1.44, 0.0], Some(clamp), On(BOAT));
        rig.velocity = [0.0; 2];
        let mut model = rig.model();
        let (status, _) = model.status().unwrap().clone();
        let (pose, _) = model.vehicle().pose().unwrap();
        inject(&mut model, Topic::Pose, &pose, at(4_000));
        inject(&mut model, Topic::Status, &status, at(4_000));
        let data = DrivingData::new(&model, &rig.teleop_client, at(4_100)).unwrap();
        let shown = (data.headline.as_str(), data.clamp.as_deref());
        assert_eq!(shown, ("Not moving", reason), "{clamp:?}");
    }
}

#[test]
fn an_alternating_limit_is_shown_as_the_limit() {
    let ahead = |forward_mps| {
        UnknownSpace(SpeedLimits {
            forward_mps,
            ..BOAT
        })
    };
    let ramp = Some(Clamp::Ramp);
    for (applied_mps, recent_mps, reason) in [
        (0.08, &[0.05, 0.5, 0.05, 0.5][..], Some(LIMITED)),
        (0.08, &[0.5, 0.05, 0.5, 0.05], Some(LIMITED)),
        (0.01, &[0.0, 0.3, 0.0, 0.3], Some(LIMITED)),
        (0.01, &[0.0, 0.0, 0.3], Some(UP_TO_LIMIT)),
        (0.08, &[0.4, 0.5], Some(UP_TO_LIMIT)),
        (0.5, &[0.8, 0.6, 0.3], Some(DOWN_TO_LIMIT)),
    ] {
        let rig = boat([1.0, 0.0], [applied_mps, 0.0], ramp, ahead(recent_mps[0]));
        let mut model = rig.model();
        for allowed_mps in recent_mps {
            let mut teleop = rig.teleop.clone();
            teleop.collision_monitor = ahead(*allowed_mps);
            inject(&mut model, Topic::Status, &status(&teleop), at(1_050));
        }
        let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
        assert_eq!(
            data.clamp.as_deref(),
            reason,
            "{applied_mps} {recent_mps:?}"
        );
    }
}

#[test]
fn an_alternating_limit_of_another_axis_is_no_reason() {
    let limits = |forward_mps, right_radps| {
        On(SpeedLimits {
            forward_mps,
            right_radps,
            ..BOAT
        })
    };
    let rig = boat([1.0, 0.0], [0.6, 0.0], Some(Clamp::CollisionMonitor), Off);
    let mut model = rig.model();
    for (forward_mps, right_radps) in [(0.8, 0.05), (0.7, 0.2), (0.6, 0.05), (0.4, 0.2)] {
        let mut teleop = rig.teleop.clone();
        teleop.collision_monitor = limits(forward_mps, right_radps);
        inject(&mut model, Topic::Status, &status(&teleop), at(1_050));
    }
    let data = DrivingData::new(&model, &rig.teleop_client, rig.now).unwrap();
    assert_eq!(data.clamp.as_deref(), Some(DOWN_TO_LIMIT));
}

#[test]
fn monitor_and_last_stop_rows() {
    for (monitor, tone, words) in [
        (Off, Tone::Warning, "Off"),
        (Silent, Tone::Warning, "Silent: nothing moves"),
        (On(ahead(0.25)), Tone::Good, "On, ahead ≤ 0.25 m/s"),
        (On(ahead(1.0)), Tone::Good, "On, ahead is free"),
        (On(UNLIMITED), Tone::Good, "On, ahead is free"),
        (On(ahead(0.0)), Tone::Good, "On, ahead is blocked"),
        (
            UnknownSpace(ahead(0.25)),
            Tone::Warning,
            "Unknown ground, ahead ≤ 0.25 m/s",
        ),
        (UnknownSpace(ahead(1.0)), Tone::Warning, "Unknown ground"),
        (Stale, Tone::Warning, "Its data is late: nothing moves"),
    ] {
        let mut rig = Rig::new();
        rig.teleop.state = TeleopState::Held;
        rig.teleop.collision_monitor = monitor;
        rig.teleop.last_stop = Some(StopReason::Age);
        assert_eq!(rig.row("Monitor"), Some((tone, words.to_owned())));
        let stop = Some(warning("commands too old"));
        assert_eq!(rig.row("Last stop"), stop);
        rig.teleop.state = TeleopState::Idle;
        let label = rig.row("Monitor").unwrap().1;
        let undriven = if words.ends_with("m/s") || words.ends_with("blocked") {
            format!("{words} for operators")
        } else {
            words.trim_end_matches(": nothing moves").to_owned()
        };
        assert_eq!(label, undriven);
    }
}

#[test]
fn obstacle_row_is_shown_to_the_driver_only() {
    for (kind, words) in [
        (BarrierKind::Detected, "detected now (ringed)"),
        (BarrierKind::Mapped, "on the map (ringed)"),
        (BarrierKind::Unknown, "unknown ground (ringed)"),
        (BarrierKind::Shallow, "too shallow (ringed)"),
        (BarrierKind::NoReturn, "no echo (ringed)"),
        (BarrierKind::Contact, "touched (ringed)"),
        (BarrierKind::Vegetation, "vegetation of the site (ringed)"),
    ] {
        let mut rig = Rig::driving();
        assert_eq!(rig.row("Obstacle"), Some((Tone::Waiting, "–".to_owned())));
        let position_m = [3.0, 1.0];
        rig.teleop.barrier = Some(Barrier { position_m, kind });
        assert_eq!(rig.row("Obstacle"), Some(warning(words)));
        rig.teleop_client.lease = Lease::None;
        assert_eq!(rig.row("Obstacle"), None);
    }
}

#[test]
fn last_observed_row() {
    let mut rig = Rig::driving();
    rig.teleop.ground_age_ms = [Some(40), Some(2_900), Some(61_000), None];
    let words = "ahead now, left 2 s, behind 61 s, right never".to_owned();
    for (monitor, row) in [
        (Off, None),
        (UnknownSpace(ahead(1.0)), Some((Tone::Good, words))),
    ] {
        rig.teleop.collision_monitor = monitor;
        assert_eq!(rig.row("Last observed"), row, "{monitor:?}");
    }
}
