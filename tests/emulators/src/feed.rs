//! What a simulation gives a device to measure.

use std::collections::VecDeque;
use std::time::Duration;

/// Measurements with the device's uptime at each. Without any, a device makes its own up.
#[derive(Debug)]
pub(crate) struct Feed<T> {
    is_fed: bool,
    waiting: VecDeque<(Duration, T)>,
}

impl<T> Default for Feed<T> {
    fn default() -> Self {
        Self {
            is_fed: false,
            waiting: VecDeque::new(),
        }
    }
}

impl<T> Feed<T> {
    /// Not before the last one.
    pub(crate) fn push(&mut self, at: Duration, measured: T) {
        self.is_fed = true;
        self.waiting.push_back((at, measured));
    }

    /// Takes what was measured up to then; `None` if nothing ever was given.
    pub(crate) fn take_until(&mut self, uptime: Duration) -> Option<Vec<(Duration, T)>> {
        let due = self.waiting.partition_point(|(at, _)| *at <= uptime);
        self.is_fed.then(|| self.waiting.drain(..due).collect())
    }
}
