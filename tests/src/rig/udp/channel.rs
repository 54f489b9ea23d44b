//! One direction: what chance does to a datagram, and when it is at the other end.
//!
//! Pure: time is an argument.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::time::Duration;

use measurement::time::Monotonic;

use super::{Conditions, Traffic};
use crate::rig::bottleneck::Bottleneck;
use crate::rig::rng::SeededRng;

/// Datagrams held back at a time; further ones are not.
const MAX_REORDERED: usize = 4096;

/// A datagram, and whose it is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Datagram {
    pub(super) flow: u64,
    pub(super) bytes: Vec<u8>,
}

#[derive(Debug)]
pub(super) struct Channel {
    conditions: Conditions,
    line: Bottleneck<QueuedDatagram>,
    /// By the moment at which it goes on, then in the order of arrival.
    reordered: BinaryHeap<Reverse<(Monotonic, u64, Datagram)>>,
    number: u64,
    rng: SeededRng,
}

#[derive(Clone, Debug)]
struct QueuedDatagram {
    datagram: Datagram,
    is_lost: bool,
    wait: Option<Duration>,
}

impl Channel {
    pub(super) fn new(rng: SeededRng) -> Self {
        let conditions = Conditions::default();
        Self {
            conditions,
            line: Bottleneck::new(conditions.line),
            reordered: BinaryHeap::new(),
            number: 0,
            rng,
        }
    }

    pub(super) fn set(&mut self, now: Monotonic, conditions: Conditions, traffic: &mut Traffic) {
        if conditions.blackhole {
            let reordered = self.reordered.drain().map(|Reverse((_, _, one))| one);
            let on_the_line = self.line.drain().into_iter().map(|queued| queued.datagram);
            for datagram in on_the_line.chain(reordered) {
                traffic.blackholed.add(datagram.bytes.len());
            }
        }
        self.line.set_line(now, conditions.line);
        self.conditions = conditions;
    }

    /// Takes a datagram that has been counted already.
    pub(super) fn take_in(
        &mut self,
        now: Monotonic,
        mut datagram: Datagram,
        traffic: &mut Traffic,
    ) {
        // Always as many draws, so that the same datagrams fare the same whatever else is set.
        let [loss, jitter, double, order, tamper, place]: [f64; 6] =
            std::array::from_fn(|_| self.rng.draw());
        let size = datagram.bytes.len();
        let conditions = &self.conditions;
        if conditions.blackhole {
            traffic.blackholed.add(size);
            return;
        }
        if tamper < conditions.tampering && size > 0 {
            let bit = (place * (8 * size) as f64) as usize;
            if let Some(byte) = datagram.bytes.get_mut(bit / 8) {
                *byte ^= 1 << (bit % 8);
                traffic.tampered.add(size);
            }
        }
        let queued = QueuedDatagram {
            datagram,
            is_lost: loss < conditions.loss,
            wait: (order < conditions.reordering.0).then_some(conditions.reordering.1),
        };
        let extra_delay = conditions.jitter.mul_f64(jitter);
        let copy = (double < conditions.duplication).then(|| queued.clone());
        if copy.is_some() {
            traffic.duplicated.add(size);
        }
        for queued in [Some(queued), copy].into_iter().flatten() {
            if !self.line.offer(now, size, extra_delay, queued) {
                traffic.overflowed.add(size);
            }
        }
    }

    /// The next that is at the other end by `now`.
    pub(super) fn take(&mut self, now: Monotonic, traffic: &mut Traffic) -> Option<Datagram> {
        loop {
            let is_due = |Reverse((due, _, _)): &Reverse<(Monotonic, u64, Datagram)>| *due <= now;
            if self.reordered.peek().is_some_and(is_due) {
                return self.reordered.pop().map(|Reverse((_, _, one))| one);
            }
            let QueuedDatagram {
                datagram,
                is_lost,
                wait,
            } = self.line.take(now)?;
            let size = datagram.bytes.len();
            if is_lost {
                traffic.lost.add(size);
                continue;
            }
            match wait {
                Some(wait) if self.reordered.len() < MAX_REORDERED => {
                    traffic.reordered.add(size);
                    self.number += 1;
                    self.reordered
                        .push(Reverse((now + wait, self.number, datagram)));
                }
                Some(_) | None => return Some(datagram),
            }
        }
    }

    /// When something happens next of its own accord.
    pub(super) fn next_event(&self) -> Option<Monotonic> {
        let reordered = self.reordered.peek().map(|Reverse((due, _, _))| *due);
        reordered.into_iter().chain(self.line.next_event()).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::Line;

    fn at_ms(millis: u64) -> Monotonic {
        Monotonic::from_nanos(millis * 1_000_000)
    }

    /// Numbers 0 to 99, sent a millisecond apart; what arrives, and when.
    fn sent(conditions: Conditions) -> (Vec<(u64, u8)>, Traffic) {
        let (mut channel, mut traffic) = (Channel::new(SeededRng::new(7, 0)), Traffic::default());
        channel.set(at_ms(0), conditions, &mut traffic);
        let mut arrived = Vec::new();
        for now_ms in 0..1000 {
            if let Ok(number) = u8::try_from(now_ms)
                && number < 100
            {
                let bytes = vec![number; 10];
                channel.take_in(at_ms(now_ms), Datagram { flow: 1, bytes }, &mut traffic);
            }
            while let Some(datagram) = channel.take(at_ms(now_ms), &mut traffic) {
                arrived.push((now_ms, datagram.bytes[0]));
            }
        }
        assert_eq!(channel.next_event(), None);
        (arrived, traffic)
    }

    #[test]
    fn nothing_happens_to_datagrams_of_a_good_line() {
        let (arrived, traffic) = sent(Conditions::default());
        let in_order: Vec<_> = (0..100).map(|n| (u64::from(n), n)).collect();
        assert_eq!(arrived, in_order);
        assert_eq!(traffic, Traffic::default());
    }

    #[test]
    fn what_is_held_back_is_overtaken_and_comes() {
        let (arrived, traffic) = sent(Conditions {
            reordering: (0.2, Duration::from_millis(15)),
            ..Conditions::default()
        });
        let reordered = traffic.reordered.packets as usize;
        assert!((10..30).contains(&reordered), "{reordered}");
        let late = arrived.iter().filter(|(at, n)| *at == u64::from(*n) + 15);
        assert_eq!(late.count(), reordered);
        let mut numbers: Vec<_> = arrived.iter().map(|(_, n)| *n).collect();
        assert!(!numbers.is_sorted());
        numbers.sort_unstable();
        assert!(numbers.into_iter().eq(0..100), "each once");
    }

    #[test]
    fn losses_and_copies_are_counted() {
        let (arrived, traffic) = sent(Conditions {
            loss: 0.1,
            duplication: 0.2,
            ..Conditions::default()
        });
        let [lost, duplicated] = [traffic.lost, traffic.duplicated].map(|count| count.packets);
        assert!((5..25).contains(&lost) && (10..30).contains(&duplicated));
        assert_eq!(arrived.len() as u64, 100 + duplicated - lost);
    }

    #[test]
    fn one_bit_is_changed() {
        let (mut channel, mut traffic) = (Channel::new(SeededRng::new(3, 1)), Traffic::default());
        channel.set(
            at_ms(0),
            Conditions {
                tampering: 1.0,
                ..Conditions::default()
            },
            &mut traffic,
        );
        let mut changed = [false; 32];
        for _ in 0..500 {
            let bytes = vec![0; 4];
            channel.take_in(at_ms(0), Datagram { flow: 1, bytes }, &mut traffic);
            let datagram = channel.take(at_ms(0), &mut traffic).unwrap();
            let bits = u32::from_le_bytes(datagram.bytes.try_into().unwrap());
            assert_eq!(bits.count_ones(), 1);
            changed[bits.trailing_zeros() as usize] = true;
        }
        assert_eq!(changed, [true; 32], "any bit may be");
        assert_eq!(traffic.tampered.packets, 500);
    }

    #[test]
    fn a_line_without_a_rate_holds_and_then_lets_go() {
        let (mut channel, mut traffic) = (Channel::new(SeededRng::new(3, 1)), Traffic::default());
        let held = Conditions {
            line: Line {
                rate_bytes_per_s: Some(0),
                queue_bytes: 1000,
                ..Line::default()
            },
            ..Conditions::default()
        };
        channel.set(at_ms(0), held, &mut traffic);
        for now_ms in 0..150 {
            let bytes = vec![7; 10];
            channel.take_in(at_ms(now_ms), Datagram { flow: 1, bytes }, &mut traffic);
        }
        assert_eq!(channel.take(at_ms(10_000), &mut traffic), None);
        channel.set(at_ms(10_000), Conditions::default(), &mut traffic);
        let mut count = 0;
        while channel.take(at_ms(10_000), &mut traffic).is_some() {
            count += 1;
        }
        assert_eq!((count, traffic.overflowed.packets), (100, 50));
    }
}
