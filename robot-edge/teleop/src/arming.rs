//! Neutral, then a press: what must be seen before anything moves.
//!
//! "After any loss, focus change, reconnect, restart or e-stop a key that is still down moves nothing until released
//! and pressed again" (and P6).

use std::time::Duration;

use measurement::time::Monotonic;

/// How far an operator has come towards driving.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Arming {
    /// Nothing was seen that counts; a key that is down now stays without effect.
    #[default]
    Locked,
    /// Nothing has been pressed since then, and commands have kept coming.
    Neutral {
        /// When the first neutral command came.
        since: Monotonic,
    },
    /// A key went down after enough of neutral, and has not been released.
    Pressed,
}

impl Arming {
    /// After a command with nothing pressed.
    #[must_use]
    pub const fn after_neutral(self, now: Monotonic) -> Self {
        match self {
            Self::Neutral { .. } => self,
            Self::Locked | Self::Pressed => Self::Neutral { since: now },
        }
    }

    /// After a command with something pressed, where `neutral` is how long nothing must have been.
    #[must_use]
    pub fn after_press(self, now: Monotonic, neutral: Duration) -> Self {
        match self {
            Self::Neutral { since } if now.since(since) >= neutral => Self::Pressed,
            Self::Neutral { .. } | Self::Locked => Self::Locked,
            Self::Pressed => Self::Pressed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NEUTRAL: Duration = Duration::from_millis(200);

    fn at(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn a_press_counts_after_enough_of_neutral() {
        let neutral = Arming::Locked.after_neutral(at(100)).after_neutral(at(299));
        assert_eq!(neutral, Arming::Neutral { since: at(100) });
        assert_eq!(neutral.after_press(at(300), NEUTRAL), Arming::Pressed);
        assert_eq!(neutral.after_press(at(299), NEUTRAL), Arming::Locked);
    }

    #[test]
    fn a_key_that_stays_down_counts_as_it_did() {
        let pressed = Arming::Pressed.after_press(at(300), NEUTRAL);
        assert_eq!(pressed, Arming::Pressed);
        let locked = Arming::Locked.after_press(at(10_000), NEUTRAL);
        assert_eq!(locked, Arming::Locked);
    }
}
