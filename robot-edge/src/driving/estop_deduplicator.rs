//! Emergency stops that were asked for, to tell a late repetition from a new press.

/// Presses that are remembered.
const CAPACITY: usize = 64;

/// The last presses of emergency stops.
///
/// A console repeats a press ten times a second until it is acknowledged. What a stalled link delivers after the reset
/// must not stop the vehicle again, and a new press must.
#[derive(Clone, Debug)]
pub(super) struct EStopDeduplicator {
    recent: [Option<u64>; CAPACITY],
    next: usize,
}

impl EStopDeduplicator {
    pub(super) const fn new() -> Self {
        Self {
            recent: [None; CAPACITY],
            next: 0,
        }
    }

    /// Whether this press was seen already; now it was.
    pub(super) fn is_duplicate(&mut self, press: u64) -> bool {
        let is_known = self.recent.contains(&Some(press));
        if !is_known {
            self.recent[self.next] = Some(press);
            self.next = (self.next + 1) % CAPACITY;
        }
        is_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repetition_is_known_and_a_new_press_is_not() {
        let mut estop_deduplicator = EStopDeduplicator::new();
        assert!(!estop_deduplicator.is_duplicate(0), "any number is a press");
        assert!(estop_deduplicator.is_duplicate(0));
        for press in 1..=CAPACITY as u64 {
            assert!(!estop_deduplicator.is_duplicate(press));
        }
        assert!(
            !estop_deduplicator.is_duplicate(0),
            "forgotten: stopping is the safe side"
        );
    }
}
