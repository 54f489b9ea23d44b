//! Emergency stops that were asked for, to tell a late repetition from a new press.

/// Presses that are remembered.
const REMEMBERED: usize = 64;

/// The last presses of emergency stops.
///
/// A console repeats a press ten times a second until it is acknowledged. What a stalled link delivers after the reset
/// must not stop the vehicle again, and a new press must.
#[derive(Clone, Debug)]
pub(super) struct Presses {
    seen: [Option<u64>; REMEMBERED],
    next: usize,
}

impl Presses {
    pub(super) const fn new() -> Self {
        Self {
            seen: [None; REMEMBERED],
            next: 0,
        }
    }

    /// Whether this press was seen already; now it was.
    pub(super) fn was_seen(&mut self, press: u64) -> bool {
        let is_known = self.seen.contains(&Some(press));
        if !is_known {
            self.seen[self.next] = Some(press);
            self.next = (self.next + 1) % REMEMBERED;
        }
        is_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repetition_is_known_and_a_new_press_is_not() {
        let mut presses = Presses::new();
        assert!(!presses.was_seen(0), "any number is a press");
        assert!(presses.was_seen(0));
        for press in 1..=REMEMBERED as u64 {
            assert!(!presses.was_seen(press));
        }
        assert!(!presses.was_seen(0), "forgotten: stopping is the safe side");
    }
}
