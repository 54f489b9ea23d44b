//! One direction of a link: a queue in front of a limited rate, then a delay. Pure: time is an argument.

use std::collections::VecDeque;
use std::time::Duration;

use measurement::time::Monotonic;

/// Bytes that one direction holds at most, queued and under way, whatever its [`Line`] allows.
const MAX_LOAD_BYTES: usize = 64 << 20;

/// Rate and delay of one direction of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// From the end of the queue to the other end of the link.
    pub delay: Duration,
    /// Bytes per second that leave the queue; `None` is no limit, 0 holds everything.
    pub rate_bytes_per_s: Option<u64>,
    /// Bytes that may wait for the rate. One packet may always wait, however large it is.
    pub queue_bytes: usize,
}

impl Default for Line {
    /// No delay, no limit; 32 KiB of queue once there is a limit.
    fn default() -> Self {
        Self {
            delay: Duration::ZERO,
            rate_bytes_per_s: None,
            queue_bytes: 32 << 10,
        }
    }
}

/// First in, first out, through a queue of limited bytes, a limited rate and a delay.
#[derive(Debug)]
pub(super) struct Bottleneck<T> {
    line: Line,
    waiting: VecDeque<Waiting<T>>,
    waiting_bytes: usize,
    /// Bytes of the first queued item that were not sent by `served_until`.
    head_remaining_bytes: f64,
    served_until: Monotonic,
    /// In the order of leaving: none overtakes another.
    in_flight: VecDeque<InFlight<T>>,
    in_flight_bytes: usize,
}

#[derive(Debug)]
struct Waiting<T> {
    bytes: usize,
    extra_delay: Duration,
    item: T,
}

#[derive(Debug)]
struct InFlight<T> {
    due: Monotonic,
    bytes: usize,
    item: T,
}

impl<T> Bottleneck<T> {
    pub(super) fn new(line: Line) -> Self {
        Self {
            line,
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            head_remaining_bytes: 0.0,
            served_until: Monotonic::default(),
            in_flight: VecDeque::new(),
            in_flight_bytes: 0,
        }
    }

    /// Changes the line. Items under way keep their arrival time.
    pub(super) fn set_line(&mut self, now: Monotonic, line: Line) {
        self.serve(now);
        self.line = line;
    }

    /// Free bytes of the queue.
    fn room_bytes(&self) -> usize {
        let load = self.waiting_bytes + self.in_flight_bytes;
        let within_memory = MAX_LOAD_BYTES.saturating_sub(load);
        if self.waiting.is_empty() {
            return within_memory;
        }
        self.line
            .queue_bytes
            .saturating_sub(self.waiting_bytes)
            .min(within_memory)
    }

    /// Queues `item`, with `extra_delay` beyond the line's; returns whether there was room for its `bytes`.
    pub(super) fn offer(
        &mut self,
        now: Monotonic,
        bytes: usize,
        extra_delay: Duration,
        item: T,
    ) -> bool {
        self.serve(now);
        if bytes > self.room_bytes() {
            return false;
        }
        if self.waiting.is_empty() {
            self.head_remaining_bytes = bytes as f64;
            self.served_until = now;
        }
        self.waiting_bytes += bytes;
        self.waiting.push_back(Waiting {
            bytes,
            extra_delay,
            item,
        });
        self.serve(now);
        true
    }

    /// The next item that has arrived by `now`.
    pub(super) fn take(&mut self, now: Monotonic) -> Option<T> {
        self.serve(now);
        let first = self.in_flight.pop_front_if(|first| first.due <= now)?;
        self.in_flight_bytes -= first.bytes;
        Some(first.item)
    }

    /// When the next item arrives or leaves the queue.
    pub(super) fn next_event(&self) -> Option<Monotonic> {
        let arrival = self.in_flight.front().map(|first| first.due);
        let departure = self.waiting.front().and_then(|_| self.first_leaves_at());
        arrival.into_iter().chain(departure).min()
    }

    /// Removes everything, queued and under way.
    pub(super) fn drain(&mut self) -> Vec<T> {
        self.waiting_bytes = 0;
        self.in_flight_bytes = 0;
        let in_flight = self.in_flight.drain(..).map(|one| one.item);
        in_flight
            .chain(self.waiting.drain(..).map(|one| one.item))
            .collect()
    }

    /// Moves what the rate allowed by `now` out of the queue.
    fn serve(&mut self, now: Monotonic) {
        while !self.waiting.is_empty() {
            let Some(leaves) = self.first_leaves_at().filter(|leaves| *leaves <= now) else {
                let served_s = now.since(self.served_until).as_secs_f64();
                let rate = self.line.rate_bytes_per_s.unwrap_or(0) as f64;
                self.head_remaining_bytes = (self.head_remaining_bytes - rate * served_s).max(0.0);
                self.served_until = self.served_until.max(now);
                return;
            };
            let Some(first) = self.waiting.pop_front() else {
                return;
            };
            self.waiting_bytes -= first.bytes;
            self.served_until = leaves;
            self.head_remaining_bytes = self.waiting.front().map_or(0.0, |next| next.bytes as f64);
            let due = leaves + self.line.delay + first.extra_delay;
            self.in_flight_bytes += first.bytes;
            self.in_flight.push_back(InFlight {
                due,
                bytes: first.bytes,
                item: first.item,
            });
        }
    }

    /// When the last byte of the first item has left the queue; never at a rate of 0.
    fn first_leaves_at(&self) -> Option<Monotonic> {
        let seconds = match self.line.rate_bytes_per_s {
            None => 0.0,
            Some(0) if self.head_remaining_bytes > 0.0 => return None,
            Some(rate) => self.head_remaining_bytes / (rate.max(1) as f64),
        };
        Some(self.served_until + Duration::from_secs_f64(seconds))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at_ms(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    fn line(delay_ms: u64, rate_bytes_per_s: Option<u64>, queue_bytes: usize) -> Line {
        Line {
            delay: Duration::from_millis(delay_ms),
            rate_bytes_per_s,
            queue_bytes,
        }
    }

    #[test]
    fn rate_and_delay_add_up() {
        let mut link = Bottleneck::new(line(50, Some(1000), 1000));
        assert!(link.offer(at_ms(0), 100, Duration::ZERO, 'a'));
        assert!(link.offer(at_ms(0), 200, Duration::from_millis(7), 'b'));
        assert_eq!(link.next_event(), Some(at_ms(100)), "a has left the queue");
        assert_eq!(link.take(at_ms(149)), None);
        assert_eq!(link.take(at_ms(150)), Some('a'));
        assert_eq!(link.take(at_ms(356)), None);
        assert_eq!(link.take(at_ms(357)), Some('b'));
        assert_eq!(link.next_event(), None);
    }

    #[test]
    fn a_full_queue_refuses_and_an_empty_queue_accepts() {
        let mut link = Bottleneck::new(line(0, Some(1000), 150));
        assert!(link.offer(at_ms(0), 400, Duration::ZERO, 0));
        assert!(!link.offer(at_ms(0), 1, Duration::ZERO, 1));
        assert!(link.offer(at_ms(400), 100, Duration::ZERO, 2));
        assert!(!link.offer(at_ms(400), 51, Duration::ZERO, 3));
        assert_eq!(link.room_bytes(), 50);
        assert!(!link.offer(at_ms(500), MAX_LOAD_BYTES, Duration::ZERO, 4));
    }

    #[test]
    fn a_new_rate_applies_to_queued_items() {
        let mut link = Bottleneck::new(line(0, Some(100), 1000));
        assert!(link.offer(at_ms(0), 100, Duration::ZERO, ()));
        link.set_line(at_ms(500), line(0, Some(0), 1000));
        assert_eq!(link.next_event(), None);
        link.set_line(at_ms(9_000), line(0, Some(1000), 1000));
        assert_eq!(link.next_event(), Some(at_ms(9_050)));
    }

    proptest! {
        /// Nothing is lost, doubled, overtaken, early or faster than the rate.
        #[test]
        fn keeps_order_delay_and_rate(
            offers in prop::collection::vec((0_u64..50, 0_usize..2000, 0_u64..30), 1..100),
            rate in 1_u64..200_000,
            delay_ms in 0_u64..100,
            queue_bytes in 0_usize..20_000,
            step_ms in 1_u64..40,
        ) {
            let mut link = Bottleneck::new(line(delay_ms, Some(rate), queue_bytes));
            let (mut now_ms, mut taken, mut arrived) = (1000, Vec::new(), Vec::new());
            for (index, (gap_ms, bytes, jitter_ms)) in offers.iter().enumerate() {
                now_ms += gap_ms;
                if link.offer(at_ms(now_ms), *bytes, Duration::from_millis(*jitter_ms), index) {
                    taken.push((index, now_ms, *bytes));
                }
            }
            let start_ms = taken.first().map_or(0, |first| first.1);
            let mut clock_ms = start_ms;
            while link.next_event().is_some() {
                clock_ms += step_ms;
                while let Some(index) = link.take(at_ms(clock_ms)) {
                    arrived.push((index, clock_ms));
                }
            }
            prop_assert_eq!(arrived.len(), taken.len());
            let mut sent_bytes = 0;
            for ((index, offered_ms, bytes), (same, arrived_ms)) in taken.iter().zip(&arrived) {
                prop_assert_eq!(index, same);
                prop_assert!(arrived_ms - offered_ms >= delay_ms);
                sent_bytes += bytes;
                let allowed = rate as f64 * (arrived_ms - start_ms - delay_ms) as f64 / 1000.0;
                prop_assert!(sent_bytes as f64 <= allowed + 1.0, "{sent_bytes} of {allowed} bytes");
            }
            prop_assert_eq!(link.room_bytes(), MAX_LOAD_BYTES);
        }
    }
}
