#![expect(clippy::float_cmp, reason = "shares of whole presses are exact")]

use proptest::prelude::*;

use super::*;

/// Hands on a window that has the keyboard.
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
    let DriveInput { forward, left } = after(events).drive_input();
    [forward, left]
}

const fn pad(is_deadman_held: bool, forward: f32) -> InputEvent {
    InputEvent::Pad(PadReading {
        is_deadman_held,
        forward,
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
    let both_hands = [Press(DriveKey::W), Press(DriveKey::Up)];
    assert_eq!(drive_input(&both_hands), [1.0, 0.0]);
    assert_eq!(
        drive_input(&[Press(DriveKey::W), Press(DriveKey::S)]),
        [0.0, 0.0]
    );
}

#[test]
fn keys_that_count_are_known_also_where_they_ask_for_nothing_together() {
    let mut input = after(&[Press(DriveKey::S), Press(DriveKey::W)]);
    assert!(input.drive_input().is_neutral());
    let counting: Vec<_> = input.keys().collect();
    assert_eq!(counting, [DriveKey::W, DriveKey::S]);
    input.lock_input(InputLockReason::Link);
    assert_eq!(input.keys().count(), 0, "they are down, and do not count");
}

#[test]
fn a_step_scales_what_is_asked_for() {
    let mut input = focused_input();
    input.apply(Press(DriveKey::Left));
    assert!((input.drive_input().left - 0.4).abs() < 1e-6);
    input.apply(InputEvent::Step(SpeedStep::new(1).unwrap()));
    assert!((input.drive_input().left - 0.2).abs() < 1e-6);
}

#[test]
fn after_a_loss_a_key_that_is_still_down_asks_for_nothing() {
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

/// X11 tells a window that gets the keyboard what is down, and then sends the first repetition as if it were a press.
#[test]
fn a_key_held_while_the_window_was_left_asks_for_nothing() {
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
fn a_window_that_is_hidden_or_typed_into_does_not_drive() {
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
fn a_gamepad_drives_while_its_dead_man_button_is_held() {
    assert_eq!(drive_input(&[pad(false, 1.0)]), [0.0, 0.0]);
    assert_eq!(drive_input(&[pad(true, 1.0)]), [1.0, 0.0]);
    assert_eq!(drive_input(&[pad(true, 1.0), pad(false, 1.0)]), [0.0, 0.0]);
    assert_eq!(
        drive_input(&[pad(true, 1.0), InputEvent::PadGone]),
        [0.0, 0.0]
    );
    assert_eq!(drive_input(&[pad(true, f32::NAN)]), [0.0, 0.0]);
    // Keys go before.
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
fn the_emergency_stop_is_taken_once_and_lets_nothing_go_on() {
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

/// Something that happens to the hands or to what they drive.
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

/// What the rule says, told from the whole history instead of from a state.
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
    let mut down = [false; 9];
    let mut all_let_go = false;
    let mut pressed_anew = [false; 9];
    for (index, test_event) in history.iter().enumerate() {
        if let TestEvent::Input(input) = test_event {
            match input {
                Focus(is) => {
                    focus = *is;
                    if !is {
                        down[..8].fill(false);
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
                    let is_new = reading.is_deadman_held && !down[8];
                    down[8] = reading.is_deadman_held;
                    if is_new {
                        pressed_anew[8] = all_let_go && index >= since_loss;
                    }
                }
                InputEvent::PadGone => {
                    // A pad that goes away while it drives is a loss as well; to demand that here is stricter
                    // than the code, so it is left out.
                    down[8] = false;
                }
                InputEvent::EStop | InputEvent::Step(_) => {}
            }
        }
        let is_attended = focus && visible && !typing;
        if index + 1 >= since_loss && is_attended && down == [false; 9] {
            all_let_go = true;
        }
    }
    let is_attended = focus && visible && !typing;
    is_attended && (0..9).any(|key| down[key] && pressed_anew[key])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn nothing_is_asked_for_but_by_a_press_after_all_was_let_go(
        history in prop::collection::vec(test_event(), 0..60)
    ) {
        let mut input = TeleopInput::default();
        for (index, test_event) in history.iter().enumerate() {
            match *test_event {
                TestEvent::Input(event) => input.apply(event),
                TestEvent::Lock(loss) => input.lock_input(loss),
            }
            let DriveInput { forward, left } = input.drive_input();
            prop_assert!(forward.abs() <= 1.0 && left.abs() <= 1.0);
            if !input.drive_input().is_neutral() {
                prop_assert!(may_move(&history[..=index]), "{:?}", &history[..=index]);
            }
        }
    }

    #[test]
    fn whoever_lets_go_of_everything_stands(
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
        // And from there a press drives again.
        for back in [Focus(true), Visible(true), Typing(false)] {
            input.apply(back);
        }
        prop_assert!(input.is_ready());
        input.apply(Press(DriveKey::W));
        prop_assert!(input.drive_input().forward > 0.0);
    }
}
