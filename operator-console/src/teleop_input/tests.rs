#![expect(clippy::float_cmp, reason = "shares of whole presses are exact")]

use proptest::prelude::*;

use super::*;

/// Input of a window with the keyboard.
fn focused_input() -> TeleopInput {
    let mut input = TeleopInput::default();
    input.apply(InputEvent::Focus(true));
    input
}

fn after(events: &[InputEvent]) -> TeleopInput {
    let mut input = focused_input();
    input.apply(InputEvent::Step(SpeedStep::new(5).unwrap()));
    for event in events {
        input.apply(*event);
    }
    input
}

fn drive_input(events: &[InputEvent]) -> [f32; 2] {
    let DriveInput {
        forward,
        sideways,
        left,
    } = after(events).drive_input();
    assert_eq!(sideways, 0.0);
    [forward, left]
}

const fn pad(is_deadman_held: bool, forward: f32) -> InputEvent {
    InputEvent::Pad(PadReading {
        is_deadman_held,
        forward,
        sideways: forward,
        left: 0.0,
    })
}

use InputEvent::{Focus, Press, Release, StillDown, Typing, Visible};

#[test]
fn keys_drive_while_they_are_held() {
    assert_eq!(drive_input(&[]), [0.0, 0.0]);
    assert_eq!(drive_input(&[Press(DriveKey::W)]), [1.0, 0.0]);
    assert_eq!(
        drive_input(&[Press(DriveKey::W), Release(DriveKey::W)]),
        [0.0, 0.0]
    );
    assert_eq!(
        drive_input(&[Press(DriveKey::W), Press(DriveKey::A)]),
        [1.0, 1.0]
    );
    assert_eq!(
        drive_input(&[Press(DriveKey::Down), Press(DriveKey::D)]),
        [-1.0, -1.0]
    );
    // Only a robot that can goes sideways.
    assert_eq!(drive_input(&[Press(DriveKey::Q)]), [0.0, 0.0]);
    for (keys, expected) in [
        (&[DriveKey::Q][..], [0.0, 1.0]),
        (&[DriveKey::E], [0.0, -1.0]),
        (&[DriveKey::E, DriveKey::W], [1.0, -1.0]),
    ] {
        let presses: Vec<_> = keys.iter().map(|&key| Press(key)).collect();
        let mut input = after(&presses);
        input.set_goes_sideways(true);
        let drive = input.drive_input();
        assert_eq!([drive.forward, drive.sideways], expected, "{keys:?}");
    }
    let both_hands = [Press(DriveKey::W), Press(DriveKey::Up)];
    assert_eq!(drive_input(&both_hands), [1.0, 0.0]);
    assert_eq!(
        drive_input(&[Press(DriveKey::W), Press(DriveKey::S)]),
        [0.0, 0.0]
    );
}

#[test]
fn opposite_keys_are_listed_although_they_cancel() {
    let mut input = after(&[Press(DriveKey::S), Press(DriveKey::W)]);
    assert!(input.drive_input().is_neutral());
    let counting: Vec<_> = input.keys().collect();
    assert_eq!(counting, [DriveKey::W, DriveKey::S]);
    input.lock_input(InputLockReason::Link);
    assert_eq!(input.keys().count(), 0, "they are down, and do not count");
}

#[test]
fn step_scales_the_input() {
    let mut input = focused_input();
    input.apply(Press(DriveKey::Left));
    assert!((input.drive_input().left - 0.4).abs() < 1e-6);
    input.apply(InputEvent::Step(SpeedStep::new(1).unwrap()));
    assert!((input.drive_input().left - 0.2).abs() < 1e-6);
}

#[test]
fn locked_key_requests_nothing_until_pressed_again() {
    for loss in [
        InputLockReason::Link,
        InputLockReason::Lease,
        InputLockReason::Stopped,
        InputLockReason::LoopStalled,
    ] {
        let mut input = after(&[Press(DriveKey::W)]);
        input.lock_input(loss);
        assert!(input.drive_input().is_neutral());
        assert_eq!(input.lock_reason(), Some(loss));
        input.apply(StillDown(DriveKey::W));
        input.apply(Press(DriveKey::W));
        assert!(input.drive_input().is_neutral(), "a repeat is no press");
        input.apply(Press(DriveKey::D));
        assert!(input.drive_input().is_neutral(), "W is still down");
        input.apply(Release(DriveKey::W));
        assert!(input.drive_input().is_neutral(), "D was pressed too early");
        input.apply(Release(DriveKey::D));
        assert_eq!(input.lock_reason(), None);
        input.apply(Press(DriveKey::W));
        assert_eq!(input.drive_input().forward, 1.0);
    }
}

/// When a window gets the keyboard, X11 reports pressed keys, and then sends the first repetition as a press.
#[test]
fn key_held_during_focus_loss_requests_nothing() {
    let held = [
        Press(DriveKey::W),
        Focus(false),
        Focus(true),
        StillDown(DriveKey::W),
        Press(DriveKey::W),
        StillDown(DriveKey::W),
    ];
    assert_eq!(drive_input(&held), [0.0, 0.0]);
    let left = [Press(DriveKey::W), Focus(false), Press(DriveKey::W)];
    assert_eq!(drive_input(&left), [0.0, 0.0]);
    let mut anew = held.to_vec();
    anew.extend([Release(DriveKey::W), Press(DriveKey::W)]);
    assert_eq!(drive_input(&anew), [1.0, 0.0]);
}

#[test]
fn hidden_window_or_text_field_does_not_drive() {
    for (lost, back) in [
        (Visible(false), Visible(true)),
        (Typing(true), Typing(false)),
    ] {
        let w = DriveKey::W;
        assert_eq!(drive_input(&[Press(w), lost]), [0.0, 0.0]);
        assert_eq!(drive_input(&[Press(w), lost, back]), [0.0, 0.0]);
        assert_eq!(drive_input(&[lost, Press(w), back]), [0.0, 0.0]);
        assert_eq!(
            drive_input(&[Press(w), lost, back, Release(w), Press(w)]),
            [1.0, 0.0]
        );
    }
}

#[test]
fn gamepad_drives_with_deadman_button_only() {
    assert_eq!(drive_input(&[pad(false, 1.0)]), [0.0, 0.0]);
    assert_eq!(drive_input(&[pad(true, 1.0)]), [1.0, 0.0]);
    assert_eq!(drive_input(&[pad(true, 1.0), pad(false, 1.0)]), [0.0, 0.0]);
    assert_eq!(
        drive_input(&[pad(true, 1.0), InputEvent::PadGone]),
        [0.0, 0.0]
    );
    assert_eq!(drive_input(&[pad(true, f32::NAN)]), [0.0, 0.0]);
    // Keys take precedence.
    assert_eq!(
        drive_input(&[pad(true, 1.0), Press(DriveKey::S)]),
        [-1.0, 0.0]
    );
    let mut input = after(&[pad(true, 1.0)]);
    input.lock_input(InputLockReason::Link);
    input.apply(pad(true, 0.9));
    assert!(input.drive_input().is_neutral());
    input.apply(pad(false, 0.9));
    input.apply(pad(true, 1.0));
    assert_eq!(input.drive_input().forward, 1.0);
}

#[test]
fn estop_is_reported_once_and_locks_input() {
    let mut input = after(&[Press(DriveKey::W), InputEvent::EStop]);
    assert!(input.drive_input().is_neutral());
    assert!(input.take_estop() && !input.take_estop());
    let mut unfocused = TeleopInput::default();
    unfocused.apply(InputEvent::EStop);
    assert!(
        unfocused.take_estop(),
        "it counts whatever has the keyboard"
    );
}

/// An event of input or lease.
#[derive(Clone, Copy, Debug)]
enum TestEvent {
    Input(InputEvent),
    Lock(InputLockReason),
}

fn test_event() -> impl Strategy<Value = TestEvent> {
    let key = prop::sample::select(&DriveKey::ALL);
    prop_oneof![
        8 => (key.clone(), 0..5u8).prop_map(|(key, what)| TestEvent::Input(match what {
            0 | 1 => Press(key),
            2 => StillDown(key),
            _ => Release(key),
        })),
        2 => (any::<bool>(), any::<f32>()).prop_map(|(held, forward)| TestEvent::Input(pad(held, forward))),
        1 => Just(TestEvent::Input(InputEvent::PadGone)),
        2 => any::<bool>().prop_map(|is| TestEvent::Input(Focus(is))),
        1 => any::<bool>().prop_map(|is| TestEvent::Input(Visible(is))),
        1 => any::<bool>().prop_map(|is| TestEvent::Input(Typing(is))),
        1 => Just(TestEvent::Input(InputEvent::EStop)),
        1 => prop::sample::select(vec![InputLockReason::Link, InputLockReason::Lease, InputLockReason::Stopped, InputLockReason::LoopStalled])
            .prop_map(TestEvent::Lock),
    ]
}

/// Place of the gamepad behind the keys.
const PAD: usize = DriveKey::ALL.len();

/// The rule computed from the whole history instead of a state.
fn may_move(history: &[TestEvent]) -> bool {
    let is_loss = |test_event: &TestEvent| {
        matches!(
            test_event,
            TestEvent::Lock(_)
                | TestEvent::Input(
                    Focus(false) | Visible(false) | Typing(true) | InputEvent::EStop
                )
        )
    };
    let since_loss = history
        .iter()
        .rposition(is_loss)
        .map_or(0, |index| index + 1);
    let (mut focus, mut visible, mut typing) = (false, true, false);
    let mut down = [false; PAD + 1];
    let mut all_let_go = false;
    let mut pressed_anew = [false; PAD + 1];
    for (index, test_event) in history.iter().enumerate() {
        if let TestEvent::Input(input) = test_event {
            match input {
                Focus(is) => {
                    focus = *is;
                    if !is {
                        down[..PAD].fill(false);
                    }
                }
                Visible(is) => visible = *is,
                Typing(is) => typing = *is,
                Press(key) => {
                    let is_new = !down[*key as usize];
                    down[*key as usize] = true;
                    if is_new {
                        pressed_anew[*key as usize] = all_let_go && index >= since_loss;
                    }
                }
                StillDown(key) => down[*key as usize] = true,
                Release(key) => down[*key as usize] = false,
                InputEvent::Pad(reading) => {
                    let is_new = reading.is_deadman_held && !down[PAD];
                    down[PAD] = reading.is_deadman_held;
                    if is_new {
                        pressed_anew[PAD] = all_let_go && index >= since_loss;
                    }
                }
                InputEvent::PadGone => {
                    // Removal of a gamepad in use also locks the input; requiring it here would be stricter than the
                    // code.
                    down[PAD] = false;
                }
                InputEvent::EStop | InputEvent::Step(_) => {}
            }
        }
        let is_attended = focus && visible && !typing;
        if index + 1 >= since_loss && is_attended && down == [false; PAD + 1] {
            all_let_go = true;
        }
    }
    let is_attended = focus && visible && !typing;
    is_attended && (0..=PAD).any(|key| down[key] && pressed_anew[key])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn only_a_press_after_full_release_requests_motion(
        history in prop::collection::vec(test_event(), 0..60)
    ) {
        let mut input = TeleopInput::default();
        input.set_goes_sideways(true);
        for (index, test_event) in history.iter().enumerate() {
            match *test_event {
                TestEvent::Input(event) => input.apply(event),
                TestEvent::Lock(loss) => input.lock_input(loss),
            }
            let DriveInput {
                forward,
                sideways,
                left,
            } = input.drive_input();
            prop_assert!(forward.abs() <= 1.0 && sideways.abs() <= 1.0 && left.abs() <= 1.0);
            if !input.drive_input().is_neutral() {
                prop_assert!(may_move(&history[..=index]), "{:?}", &history[..=index]);
            }
        }
    }

    #[test]
    fn full_release_requests_nothing(
        history in prop::collection::vec(test_event(), 0..60)
    ) {
        let mut input = TeleopInput::default();
        for test_event in history {
            match test_event {
                TestEvent::Input(event) => input.apply(event),
                TestEvent::Lock(loss) => input.lock_input(loss),
            }
        }
        for key in DriveKey::ALL {
            input.apply(Release(key));
        }
        input.apply(pad(false, 1.0));
        prop_assert!(input.drive_input().is_neutral());
        // From there a press drives again.
        for back in [Focus(true), Visible(true), Typing(false)] {
            input.apply(back);
        }
        prop_assert!(input.is_ready());
        input.apply(Press(DriveKey::W));
        prop_assert!(input.drive_input().forward > 0.0);
    }
}
