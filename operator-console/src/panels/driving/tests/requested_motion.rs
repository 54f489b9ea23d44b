//! What is said of what is asked for, and what is told to whoever points at a word.

use std::collections::BTreeMap;

use super::*;

const FREE: f32 = f32::INFINITY;

#[test]
fn the_guard_speaks_of_the_way_that_is_asked_for() {
    let guard = Some(Clamp::CollisionMonitor);
    for (asked, [forward_mps, reverse_mps, left_radps, right_radps], clamp, says) in [
        // Nothing is.
        ([0.0, 0.0], [0.25, 0.0, 0.0, 0.0], None, "ahead ≤ 0.25 m/s"),
        ([0.7, 0.5], [0.25, 0.0, 0.0, 0.0], guard, "ahead ≤ 0.25 m/s"),
        (
            [-0.72, 0.0],
            [FREE, 0.0, FREE, FREE],
            guard,
            "behind is blocked",
        ),
        (
            [-0.72, 0.0],
            [0.0, 0.2, FREE, FREE],
            guard,
            "behind ≤ 0.20 m/s",
        ),
        ([-0.72, 0.0], [0.0, FREE, 0.0, 0.0], None, "behind is free"),
        // The turn beside it is not.
        (
            [-0.72, 0.5],
            [0.0, FREE, 0.0, FREE],
            guard,
            "turning left is blocked",
        ),
        (
            [0.7, -0.5],
            [FREE, 0.0, 0.0, 0.25],
            Some(Clamp::Ramp),
            "turning right ≤ 14 °/s",
        ),
        // Nothing that it allows is less than what is asked for: a boat that is too fast gets no thrust.
        ([0.7, 0.5], [FREE, 0.0, FREE, FREE], guard, "holds it back"),
        (
            [0.0, 0.5],
            [0.0, 0.0, 0.25, FREE],
            guard,
            "turning left ≤ 14 °/s",
        ),
        (
            [0.0, -0.5],
            [0.0, 0.0, FREE, 0.0],
            guard,
            "turning right is blocked",
        ),
        (
            [0.0, -0.5],
            [0.0, 0.0, 0.0, FREE],
            Some(Clamp::Ramp),
            "turning right is free",
        ),
    ] {
        let mut rig = Rig::driving();
        [
            rig.teleop.requested.linear_mps,
            rig.teleop.requested.angular_radps,
        ] = asked;
        rig.teleop.clamp = clamp;
        rig.teleop.collision_monitor = CollisionMonitorState::On(SpeedLimits {
            forward_mps,
            reverse_mps,
            left_radps,
            right_radps,
        });
        let expected = Some((Tone::Good, format!("On, {says}")));
        assert_eq!(rig.row("Guard"), expected, "{asked:?}");
    }
}

#[test]
fn the_same_words_always_have_the_same_mark() {
    let mut marks = BTreeMap::new();
    for (state, is_drifting, speed_mps) in [
        (TeleopState::Idle, false, 0.55),
        (TeleopState::Idle, false, 1.5),
        (TeleopState::Idle, true, 1.5),
        (TeleopState::SafeBoot, false, 0.55),
        (TeleopState::Held, false, 0.55),
        (TeleopState::EStop, false, 0.55),
    ] {
        let mut rig = Rig::new();
        rig.teleop.state = state;
        rig.teleop.is_drifting = is_drifting;
        rig.velocity = [speed_mps, 0.0];
        let data = rig.data();
        assert!(data.hint.is_some(), "{state:?}");
        let mark = marks.entry(data.headline.clone()).or_insert(data.tone);
        assert_eq!(*mark, data.tone, "{}", data.headline);
    }
    let words: Vec<_> = marks.keys().map(String::as_str).collect();
    let expected = [
        "Emergency stop",
        "Moving by itself",
        "Moving or adrift",
        "Moving without command",
    ];
    assert_eq!(words, expected);
}

/// The panel, in a window with room for hints, with the pointer on this label.
fn pointed_at(rig: &Rig, label: &str) -> Harness<'static> {
    let data = rig.data();
    let mut window = Harness::builder()
        .with_size(vec2(560.0, 800.0))
        .build_ui(move |ui| {
            driving_ui(ui, &data, &mut DrivingEntry::default());
        });
    crate::theme::set(&window.ctx);
    window.run_steps(3);
    let place = window.get_by_label(label).rect();
    window.hover_at(place.center());
    window.run_steps(60);
    window
}

#[test]
fn words_that_are_not_plain_are_explained_to_whoever_points_at_them() {
    let mut rig = Rig::new();
    rig.velocity = [0.55, 0.0];
    for (label, says) in [
        ("Age limit", "The older commands are, the slower"),
        ("0.38 m/s", "the oldest that it would obey"),
        ("Guard", "before unknown ground"),
        (
            "Moving by itself",
            "Something other than an operator moves it",
        ),
    ] {
        let told = |pointed: &str| {
            let window = pointed_at(&rig, pointed);
            window.query_all_by_label_contains(says).count()
        };
        // Whoever hears the window may hear it all the time.
        assert!(told(label) > told("Linear speed"), "{label}");
    }
}

#[test]
fn a_step_says_how_fast_it_is_and_hides_no_speed_below_it() {
    let mut rig = Rig::new();
    rig.teleop_client.limits = [1.2, 1.5];
    for (step, says) in [
        ("1", "1: 20 % of its top speed, 0.24 m/s"),
        ("3", "3: 60 % of its top speed, 0.72 m/s"),
        ("5", "5: 100 % of its top speed, 1.20 m/s"),
    ] {
        let window = pointed_at(&rig, step);
        let hint = window.get_by_label(says).rect();
        let button = window.get_by_label(step).rect();
        let speeds = window.get_by_label("Linear speed").rect();
        assert!(hint.bottom() <= button.top(), "{step}: {hint} {button}");
        assert!(hint.bottom() <= speeds.top(), "{step}: {hint} {speeds}");
    }
    // Nothing is known of the robot yet.
    rig.teleop_client.limits = [0.0; 2];
    pointed_at(&rig, "3").get_by_label("3: 60 % of its top speed");
}
