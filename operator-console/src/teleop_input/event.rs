//! What happens to the operator's hands, as plain data: whoever reads a keyboard, a gamepad or a script makes these.

use super::gamepad::PadReading;
use super::speed_step::SpeedStep;

/// A key that drives, by where it is on the keyboard: W A S D of a QWERTY keyboard, whatever is printed there, and the
/// arrows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum DriveKey {
    /// Forward, left hand.
    W,
    /// To the left, left hand.
    A,
    /// Backward, left hand.
    S,
    /// To the right, left hand.
    D,
    /// Forward, right hand.
    Up,
    /// To the left, right hand.
    Left,
    /// Backward, right hand.
    Down,
    /// To the right, right hand.
    Right,
}

impl DriveKey {
    /// Every key that drives.
    pub const ALL: [Self; 8] = [
        Self::W,
        Self::A,
        Self::S,
        Self::D,
        Self::Up,
        Self::Left,
        Self::Down,
        Self::Right,
    ];

    /// Whether it is an arrow.
    pub const fn is_arrow(self) -> bool {
        matches!(self, Self::Up | Self::Left | Self::Down | Self::Right)
    }

    /// What it asks for: forwards and to the left, each −1, 0 or 1.
    pub(super) const fn direction(self) -> [f32; 2] {
        match self {
            Self::W | Self::Up => [1.0, 0.0],
            Self::S | Self::Down => [-1.0, 0.0],
            Self::A | Self::Left => [0.0, 1.0],
            Self::D | Self::Right => [0.0, -1.0],
        }
    }
}

/// Something that happens to the hands, or to whether they are watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InputEvent {
    /// A key goes down: a press, not a repetition of one.
    Press(DriveKey),
    /// A key is down already: an auto-repeat, or what the system tells a window that gets the keyboard. It counts for
    /// nothing, but is to be let go.
    StillDown(DriveKey),
    /// A key goes up.
    Release(DriveKey),
    /// The space bar, or the button.
    EStop,
    /// Another share of the greatest speed.
    Step(SpeedStep),
    /// The gamepad, as it is now.
    Pad(PadReading),
    /// The gamepad is gone.
    PadGone,
    /// Whether keys go to this window.
    Focus(bool),
    /// Whether the operator can see the window at all.
    Visible(bool),
    /// Whether keys are text at the moment.
    Typing(bool),
}
