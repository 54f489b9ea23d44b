//! What can be asked of a recording, and the keys that ask for it.

use eframe::egui::{Event, Key, Modifiers, Ui};
use robot_edge::pacer::Rate;
use robot_edge::replay_control::{ReplaySight, ReplayState};
use robot_edge::robot_time::RobotDuration;

/// Speeds to choose from, slowest first.
pub const RATES: [Rate; 7] = [
    Rate::Times(0.25),
    Rate::Times(0.5),
    Rate::Times(1.0),
    Rate::Times(2.0),
    Rate::Times(5.0),
    Rate::Times(10.0),
    Rate::Max,
];

/// What the operator asks of a recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlaybackCommand {
    /// Go on; at the end, from the beginning.
    Play,
    /// Stand still.
    Pause,
    /// Go on at this rate.
    SetRate(Rate),
    /// Begin anew at the end, or do not.
    SetLooping(bool),
    /// Show this time of the data, from the first scan.
    Seek(RobotDuration),
    /// Show a time so much later, or earlier where negative.
    Step(RobotDuration),
    /// Close the recording.
    Close,
}

impl PlaybackCommand {
    /// Pause what plays, play what stands still.
    pub(crate) fn toggle(sight: &ReplaySight, is_paused: bool) -> Self {
        match sight.state {
            ReplayState::Ended => Self::Play,
            ReplayState::Opening
            | ReplayState::Playing
            | ReplayState::Paused
            | ReplayState::Seeking { .. } => {
                if is_paused {
                    Self::Play
                } else {
                    Self::Pause
                }
            }
        }
    }
}

/// The speed before or behind this one.
fn neighbour(rate: Rate, is_faster: bool) -> Rate {
    let speed = |rate: Rate| match rate {
        Rate::Times(times) => times,
        Rate::Max => f64::INFINITY,
    };
    let next = if is_faster {
        RATES.into_iter().find(|other| speed(*other) > speed(rate))
    } else {
        let mut slower = RATES.into_iter().rev();
        slower.find(|other| speed(*other) < speed(rate))
    };
    next.unwrap_or(rate)
}

/// What the keys ask for that were pressed since the last frame: nothing while text is typed.
pub fn asked_for(ui: &Ui, sight: &ReplaySight) -> Option<PlaybackCommand> {
    if ui.ctx().text_edit_focused() {
        return None;
    }
    ui.input(|input| {
        input.events.iter().rev().find_map(|event| {
            let Event::Key {
                key,
                physical_key,
                pressed: true,
                repeat,
                modifiers,
            } = event
            else {
                return None;
            };
            let keys = [Some(*key), *physical_key];
            by_key(keys, *repeat, *modifiers, sight)
        })
    })
}

/// `keys`: by what is printed on it, and by its place, which is what counts with Shift.
fn by_key(
    keys: [Option<Key>; 2],
    is_repeated: bool,
    modifiers: Modifiers,
    sight: &ReplaySight,
) -> Option<PlaybackCommand> {
    if modifiers.any() && !modifiers.shift_only() {
        return None;
    }
    let is = |key: Key| keys.contains(&Some(key));
    let step_s = if modifiers.shift { 10 } else { 1 };
    let step = |sign: i64| PlaybackCommand::Step(RobotDuration::from_millis(sign * step_s * 1000));
    if is(Key::Comma) {
        return Some(step(-1));
    }
    if is(Key::Period) {
        return Some(step(1));
    }
    if modifiers.shift || is_repeated {
        return None;
    }
    match keys[0] {
        Some(Key::P) => Some(PlaybackCommand::toggle(sight, sight.is_paused)),
        Some(Key::L) => Some(PlaybackCommand::SetLooping(!sight.is_looping)),
        Some(Key::OpenBracket) => Some(PlaybackCommand::SetRate(neighbour(sight.rate, false))),
        Some(Key::CloseBracket) => Some(PlaybackCommand::SetRate(neighbour(sight.rate, true))),
        Some(_) | None => None,
    }
}

#[cfg(test)]
mod tests {
    use robot_edge::replay_control::ReplayControl;

    use super::*;

    fn press(key: Key, modifiers: Modifiers, sight: &ReplaySight) -> Option<PlaybackCommand> {
        by_key([Some(key), Some(key)], false, modifiers, sight)
    }

    #[test]
    fn keys_play_pause_step_and_pace() {
        let control = ReplayControl::new(Rate::Times(1.0));
        let sight = control.sight();
        let step = |s: i64| Some(PlaybackCommand::Step(RobotDuration::from_millis(1000 * s)));
        for (key, modifiers, expected) in [
            (Key::P, Modifiers::NONE, Some(PlaybackCommand::Pause)),
            (Key::P, Modifiers::SHIFT, None),
            (Key::P, Modifiers::CTRL, None),
            (Key::Comma, Modifiers::NONE, step(-1)),
            (Key::Period, Modifiers::NONE, step(1)),
            (Key::Comma, Modifiers::SHIFT, step(-10)),
            (Key::Period, Modifiers::SHIFT, step(10)),
            (Key::Period, Modifiers::CTRL, None),
            (
                Key::L,
                Modifiers::NONE,
                Some(PlaybackCommand::SetLooping(true)),
            ),
            (
                Key::CloseBracket,
                Modifiers::NONE,
                Some(PlaybackCommand::SetRate(Rate::Times(2.0))),
            ),
            (Key::Space, Modifiers::NONE, None),
        ] {
            assert_eq!(press(key, modifiers, &sight), expected, "{key:?}");
        }
        control.pause();
        let pressed = press(Key::P, Modifiers::NONE, &control.sight());
        assert_eq!(pressed, Some(PlaybackCommand::Play));
    }

    #[test]
    fn shift_may_change_what_a_key_is_called() {
        let sight = ReplayControl::new(Rate::Max).sight();
        let keys = [Some(Key::Semicolon), Some(Key::Comma)];
        let back = PlaybackCommand::Step(RobotDuration::from_millis(-10_000));
        assert_eq!(by_key(keys, false, Modifiers::SHIFT, &sight), Some(back));
    }

    #[test]
    fn speeds_have_neighbours() {
        let chain = |is_faster: bool, mut rate: Rate| {
            for _ in 0..10 {
                rate = neighbour(rate, is_faster);
            }
            rate
        };
        assert_eq!(chain(true, RATES[0]), Rate::Max);
        assert_eq!(chain(false, Rate::Max), RATES[0]);
        assert_eq!(neighbour(Rate::Times(3.0), true), Rate::Times(5.0));
        assert_eq!(neighbour(Rate::Times(3.0), false), Rate::Times(2.0));
    }
}
