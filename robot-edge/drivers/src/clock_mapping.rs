//! A device's clock, mapped to that of the vehicle by its promptest messages.
//!
//! A device clock may start at 1970, drift, wrap, and start again with its device. Nothing of it is
//! trusted but the time between two messages.

use std::time::Duration;

use measurement::delay_window::DelayWindow;
use measurement::time::Monotonic;

/// Time of a device's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceTime {
    /// Nanoseconds since any moment, from 0 up to the period.
    pub nanos: i64,
    /// After this many nanoseconds the clock begins again.
    pub period_ns: i64,
}

impl DeviceTime {
    /// The vehicle's own clock.
    pub const fn own(time: Monotonic) -> Self {
        Self {
            nanos: time.nanos(),
            period_ns: i64::MAX,
        }
    }

    /// A counter of `bits` bits (at most 32) with ticks of `tick_ns`, at most 2²⁴ ns.
    pub const fn counter(ticks: u32, tick_ns: u32, bits: u32) -> Self {
        Self {
            nanos: ticks as i64 * tick_ns as i64,
            period_ns: (1_i64 << bits) * tick_ns as i64,
        }
    }
}

/// An older message is not used; nor is one that stands still.
pub const MAX_AGE: Duration = Duration::from_millis(200);

/// Messages that are overtaken by so much are out of order; the clock was set back if it is more.
const MAX_REORDER_NS: i64 = 1_000_000_000;
/// So late are messages after a stall at most: the supervisor ends connections that are silent.
const MAX_LATE_NS: i64 = 5_000_000_000;
/// A message that is earlier than the promptest by more comes after the clock was set forward.
const MAX_EARLY_NS: i64 = 500_000_000;

/// The mapping of one device.
#[derive(Clone, Debug, Default)]
pub struct ClockMapping {
    state: Option<State>,
    is_new_connection: bool,
    resets: u64,
}

#[derive(Clone, Debug)]
struct State {
    delays: DelayWindow,
    last: DeviceTime,
    /// [`Self::last`] without wraps.
    continued_ns: i64,
    arrived: Monotonic,
}

/// What a panel shows of a mapping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockStatus {
    /// What is added to the device's time to give the vehicle's, seconds.
    pub offset_s: f64,
    /// The greatest delay of the last 10 s or more, over that of the promptest message, seconds.
    pub spread_s: f64,
    /// How often the clock was set, or started again.
    pub resets: u64,
}

impl ClockMapping {
    /// A connection begins, or the device has started again: what it sends now is not old.
    pub const fn reconnect(&mut self) {
        self.is_new_connection = true;
    }

    /// When a message that arrives now was sent, as if it had been the promptest. `None` if the device
    /// sent it before the last one, or its time stands still.
    pub fn map(&mut self, time: DeviceTime, arrived: Monotonic) -> Option<Monotonic> {
        let is_new_connection = std::mem::take(&mut self.is_new_connection);
        let Some(state) = &mut self.state else {
            self.state = Some(State::new(time, arrived));
            return Some(arrived);
        };
        let half_ns = time.period_ns / 2;
        let raw_ns = (time.nanos - state.last.nanos).rem_euclid(time.period_ns);
        let step_ns = if raw_ns > half_ns {
            raw_ns - time.period_ns
        } else {
            raw_ns
        };
        if (-MAX_REORDER_NS..=0).contains(&step_ns) && !is_new_connection {
            return None;
        }
        let continued_ns = state.continued_ns.saturating_add(step_ns);
        let behind_ns = arrived.nanos().saturating_sub(continued_ns);
        let late_ns = behind_ns.saturating_sub(state.delays.least_ns());
        let max_late_ns = if is_new_connection {
            MAX_AGE.as_nanos() as i64
        } else {
            MAX_LATE_NS
        };
        let passed_ns = arrived.nanos().saturating_sub(state.arrived.nanos());
        let is_continued =
            step_ns > 0 && passed_ns < half_ns && (-MAX_EARLY_NS..=max_late_ns).contains(&late_ns);
        if !is_continued {
            self.resets = self.resets.saturating_add(1);
            self.state = Some(State::new(time, arrived));
            return Some(arrived);
        }
        let late_ns = state.delays.add(behind_ns, arrived);
        *state = State {
            delays: state.delays,
            last: time,
            continued_ns,
            arrived,
        };
        let sent_ns = arrived.nanos().saturating_sub(late_ns);
        Some(Monotonic::from_nanos(sent_ns.max(0).unsigned_abs()))
    }

    /// `None` before the first message with a time.
    pub fn status(&self) -> Option<ClockStatus> {
        let state = self.state.as_ref()?;
        Some(ClockStatus {
            // Of the clock as it is, not as it was continued.
            offset_s: (state.delays.least_ns() + state.continued_ns - state.last.nanos) as f64
                / 1e9,
            spread_s: state.delays.spread_ns() as f64 / 1e9,
            resets: self.resets,
        })
    }
}

impl State {
    const fn new(time: DeviceTime, arrived: Monotonic) -> Self {
        Self {
            delays: DelayWindow::new(arrived.nanos().saturating_sub(time.nanos), arrived),
            last: time,
            continued_ns: time.nanos,
            arrived,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MS: i64 = 1_000_000;

    fn at(ms: i64) -> Monotonic {
        Monotonic::from_nanos((ms * MS).unsigned_abs())
    }

    /// A counter of milliseconds, 16 bits: it wraps after 65.536 s.
    fn device(ms: i64) -> DeviceTime {
        DeviceTime::counter((ms % 65_536) as u32, 1_000_000, 16)
    }

    #[test]
    fn late_messages_are_old_and_clocks_wrap() {
        let mut mapping = ClockMapping::default();
        // Four minutes with jitter of 0 to 6 ms; every fourth message is prompt. The offset is 500 ms.
        for tick in 0..2400 {
            let jitter = 2 * (tick % 4);
            let sent = mapping.map(device(100 * tick), at(500 + 100 * tick + jitter));
            assert_eq!(sent, Some(at(500 + 100 * tick)), "{tick}");
        }
        assert_eq!(mapping.map(device(240_000), at(242_000)), Some(at(240_500)));
        let status = mapping.status().unwrap();
        assert!((status.spread_s - 1.5).abs() < 1e-9, "{status:?}");
        assert_eq!(status.resets, 0);
        let offset_s = 240.5 - f64::from(240_000 % 65_536) / 1000.0;
        assert!((status.offset_s - offset_s).abs() < 1e-9, "{status:?}");
    }

    #[test]
    fn drift_is_followed() {
        let mut mapping = ClockMapping::default();
        for tick in 0..360_000_i64 {
            let arrived_ns = tick * (10 * MS + 1_000); // 100 µs/s slow
            let arrived = Monotonic::from_nanos(arrived_ns.unsigned_abs());
            let sent = mapping.map(device(10 * tick), arrived).unwrap();
            assert!(arrived.since(sent) < Duration::from_millis(3), "{tick}");
        }
        assert_eq!(mapping.status().unwrap().resets, 0);
    }

    #[test]
    fn repeated_and_overtaken_messages_are_refused() {
        let mut mapping = ClockMapping::default();
        assert_eq!(mapping.map(device(1000), at(5000)), Some(at(5000)));
        for repeated in [1000, 999, 1] {
            assert_eq!(mapping.map(device(repeated), at(5010)), None, "{repeated}");
        }
        assert_eq!(mapping.map(device(1020), at(5020)), Some(at(5020)));
    }

    #[test]
    fn a_clock_that_was_set_is_followed_at_once() {
        for (device_ms, resets) in [
            (10_050, 0),
            (12_000, 1), // forward by 1.95 s
            (8000, 1),   // back by 2.05 s
            (100, 1),
            (40_000, 1), // half a period away
        ] {
            let mut mapping = ClockMapping::default();
            for ms in (0..=10_000).step_by(50) {
                mapping.map(device(ms), at(100_000 + ms)).unwrap();
            }
            let sent = mapping.map(device(device_ms), at(110_050));
            assert_eq!(sent, Some(at(110_050)), "{device_ms}");
            assert_eq!(mapping.status().unwrap().resets, resets, "{device_ms}");
        }
    }

    #[test]
    fn a_device_that_started_again_is_not_old() {
        // Up for 3 s, off for 1 s; its clock is at any place then.
        for first_ms in [0, 20, 2990, 3000, 3010, 3500] {
            let mut mapping = ClockMapping::default();
            for ms in (0..=3000).step_by(50) {
                mapping.map(device(ms), at(1000 + ms)).unwrap();
            }
            mapping.reconnect();
            assert_eq!(mapping.map(device(first_ms), at(5000)), Some(at(5000)));
        }
        // The device did not start again: the mapping goes on.
        let mut mapping = ClockMapping::default();
        mapping.map(device(0), at(1000)).unwrap();
        mapping.reconnect();
        assert_eq!(mapping.map(device(1000), at(2030)), Some(at(2000)));
        // Old data in the same connection is old.
        assert_eq!(mapping.map(device(1050), at(3000)), Some(at(2050)));
    }

    #[test]
    fn after_half_a_period_the_time_is_not_known() {
        let mut mapping = ClockMapping::default();
        mapping.map(device(0), at(0)).unwrap();
        assert_eq!(mapping.map(device(5), at(65_000)), Some(at(65_000)));
        assert_eq!(mapping.status().unwrap().resets, 1);
    }

    proptest! {
        /// Whatever a device says: nothing is sent after it arrived, and nothing overflows.
        #[test]
        fn no_message_is_from_the_future(
            messages in prop::collection::vec((any::<u32>(), 0..3_000_u64, any::<bool>()), 1..100),
        ) {
            let mut mapping = ClockMapping::default();
            let mut now = Monotonic::from_nanos(0);
            for (ticks, passed_ms, is_new) in messages {
                now = now + Duration::from_millis(passed_ms);
                if is_new {
                    mapping.reconnect();
                }
                let time = DeviceTime::counter(ticks, 100_000, 32);
                if let Some(sent) = mapping.map(time, now) {
                    prop_assert!(sent <= now);
                    prop_assert!(now.since(sent) <= Duration::from_secs(5));
                }
            }
        }
    }
}
