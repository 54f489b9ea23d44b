//! When a session that has lost its link is better opened anew.

use std::time::Duration;

use measurement::time::Monotonic;

/// Zenoh reconnects by itself, but only by the way by which the session was opened: where a network swallows UDP from now on,
/// that way never comes back. What is gone for so long is opened anew, by whatever way answers.
const LOST_FOR: Duration = Duration::from_secs(1);

/// Since when there is no link.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LostLink {
    since: Option<Monotonic>,
}

impl LostLink {
    /// Looks at whether there is a link at `now`; whether it has been lost for too long.
    pub(super) fn update(&mut self, has_link: bool, now: Monotonic) -> bool {
        if has_link {
            self.since = None;
            return false;
        }
        now.since(*self.since.get_or_insert(now)) >= LOST_FOR
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_that_comes_back_soon_is_left_alone() {
        const fn at(ms: u64) -> Monotonic {
            Monotonic::from_nanos(ms * 1_000_000)
        }
        let mut lost = LostLink::default();
        for (ms, has_link, is_over) in [
            (10_000, true, false),
            (10_500, false, false),
            (11_400, false, false),
            (11_450, true, false),
            (11_600, false, false),
            (12_500, false, false),
            (12_600, false, true),
            (12_700, true, false),
            (12_800, false, false),
        ] {
            assert_eq!(lost.update(has_link, at(ms)), is_over, "{ms} ms");
        }
    }
}
