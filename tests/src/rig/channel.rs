//! Both directions of an emulated link: loss, duplication, delay and counters.

use std::array;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, VecDeque};
use std::io;
use std::sync::Mutex;
use std::time::Duration;

use measurement::time::Monotonic;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use robot_edge::clock;
use tokio::sync::Notify;
use tokio::time::sleep;

use super::bottleneck::Bottleneck;
use super::{Line, lock};

/// Datagrams of each direction that are kept.
const CAPTURED: usize = 200;

/// Datagrams held back at a time; further ones are not held back.
const MAX_REORDERED: usize = 4096;

pub(super) const MAX_DATAGRAM_BYTES: usize = 1 << 16;

/// What happens to datagrams in one direction. The default lets them pass at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Rate, queue in front of it and delay. A datagram that finds the queue full is dropped. A rate of 0 holds all of
    /// them until the rate is changed.
    pub line: Line,
    /// Greatest delay beyond the line's; each datagram draws its own, evenly from 0. They keep their order.
    pub jitter: Duration,
    /// Likelihood that a datagram is lost. A lost datagram uses its time of the rate, as on the air.
    pub loss: f64,
    /// Likelihood that a datagram arrives twice.
    pub duplication: f64,
    /// Likelihood that a datagram is held back at the end of the line, where others overtake it, and for how long.
    pub reordering: (f64, Duration),
    /// Likelihood that a datagram arrives with one bit changed.
    pub tampering: f64,
    /// Everything is lost, datagrams under way too; the sender gets no error.
    pub blackhole: bool,
}

/// Packets and their bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Count {
    /// Number of packets.
    pub packets: u64,
    /// Sum of their sizes.
    pub bytes: u64,
}

impl Count {
    fn add(&mut self, bytes: usize) {
        self.packets += 1;
        self.bytes += bytes as u64;
    }
}

/// Counters of one direction.
///
/// Datagrams that were sent, duplicated or injected are delivered, lost, overflowed, blackholed, refused or under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Received from the sender.
    pub sent: Count,
    /// Copies that were made.
    pub duplicated: Count,
    /// Added by a test.
    pub injected: Count,
    /// Sent to the receiver.
    pub delivered: Count,
    /// Lost by chance.
    pub lost: Count,
    /// Dropped, because the queue was full.
    pub overflowed: Count,
    /// Dropped, because the link was gone.
    pub blackholed: Count,
    /// Refused by the kernel when they were sent to the receiver.
    pub refused: Count,
    /// Held back; also in another count.
    pub reordered: Count,
    /// Changed; also in another count.
    pub tampered: Count,
}

/// A datagram and the flow it belongs to.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Datagram {
    pub(super) flow: usize,
    pub(super) bytes: Vec<u8>,
}

/// Both directions, shared by the tasks that receive, the task that delivers and the test.
#[derive(Debug)]
pub(super) struct Channels {
    both: Mutex<[Channel; 2]>,
    changed: Notify,
}

impl Channels {
    pub(super) fn new(seed: u64) -> Self {
        Self {
            both: Mutex::new(array::from_fn(|direction| {
                Channel::new(seed, direction as u64)
            })),
            changed: Notify::new(),
        }
    }

    /// Fails if a likelihood is not between 0 and 1.
    pub(super) fn set(&self, direction: usize, conditions: Conditions) -> io::Result<()> {
        for (name, value) in [
            ("loss", conditions.loss),
            ("duplication", conditions.duplication),
            ("reordering", conditions.reordering.0),
            ("tampering", conditions.tampering),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidInput,
                    format!("{name} {value} is not between 0 and 1"),
                ));
            }
        }
        lock(&self.both)[direction].set(clock::now(), conditions);
        self.changed.notify_one();
        Ok(())
    }

    pub(super) fn set_both(&self, conditions: Conditions) -> io::Result<()> {
        self.set(0, conditions)?;
        self.set(1, conditions)
    }

    pub(super) fn traffic(&self, direction: usize) -> Traffic {
        lock(&self.both)[direction].traffic
    }

    pub(super) fn captured(&self, direction: usize) -> Vec<Vec<u8>> {
        lock(&self.both)[direction]
            .captured
            .iter()
            .cloned()
            .collect()
    }

    /// A datagram came from its sender.
    pub(super) fn receive(&self, direction: usize, datagram: Datagram) {
        let channel = &mut lock(&self.both)[direction];
        if channel.captured.len() >= CAPTURED {
            channel.captured.pop_front();
        }
        channel.captured.push_back(datagram.bytes.clone());
        channel.traffic.sent.add(datagram.bytes.len());
        channel.take_in(clock::now(), datagram);
        self.changed.notify_one();
    }

    /// A test adds a datagram.
    pub(super) fn inject(&self, direction: usize, datagram: Datagram) {
        let channel = &mut lock(&self.both)[direction];
        channel.traffic.injected.add(datagram.bytes.len());
        channel.take_in(clock::now(), datagram);
        self.changed.notify_one();
    }

    /// Sends every datagram, with the index of its direction, when it is due. Never ends.
    pub(super) async fn deliver(&self, send: impl Fn(usize, &Datagram) -> io::Result<usize>) -> ! {
        loop {
            let next = self.deliver_due(clock::now(), &send);
            let wait = async {
                match next {
                    Some(next) => sleep(next.since(clock::now())).await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                () = wait => {}
                () = self.changed.notified() => {}
            }
        }
    }

    /// Sends all that are due; returns when the next one is.
    fn deliver_due(
        &self,
        now: Monotonic,
        send: &impl Fn(usize, &Datagram) -> io::Result<usize>,
    ) -> Option<Monotonic> {
        let mut both = lock(&self.both);
        for (direction, channel) in both.iter_mut().enumerate() {
            while let Some(datagram) = channel.take(now) {
                let size = datagram.bytes.len();
                match send(direction, &datagram) {
                    Ok(_) => channel.traffic.delivered.add(size),
                    Err(_refused) => channel.traffic.refused.add(size),
                }
            }
        }
        both.iter().filter_map(Channel::next_event).min()
    }
}

/// One direction. Pure: time is an argument.
#[derive(Debug)]
struct Channel {
    conditions: Conditions,
    line: Bottleneck<QueuedDatagram>,
    /// By the time at which they are due, then in the order of arrival.
    reordered: BinaryHeap<Reverse<(Monotonic, u64, Datagram)>>,
    captured: VecDeque<Vec<u8>>,
    traffic: Traffic,
    rng: ChaCha8Rng,
}

#[derive(Clone, Debug)]
struct QueuedDatagram {
    datagram: Datagram,
    is_lost: bool,
    wait: Option<Duration>,
}

impl Channel {
    fn new(seed: u64, direction: u64) -> Self {
        let conditions = Conditions::default();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(direction);
        Self {
            conditions,
            line: Bottleneck::new(conditions.line),
            reordered: BinaryHeap::new(),
            captured: VecDeque::new(),
            traffic: Traffic::default(),
            rng,
        }
    }

    fn set(&mut self, now: Monotonic, conditions: Conditions) {
        if conditions.blackhole {
            let reordered = self.reordered.drain().map(|Reverse((_, _, one))| one);
            let on_the_line = self.line.drain().into_iter().map(|queued| queued.datagram);
            for datagram in on_the_line.chain(reordered) {
                self.traffic.blackholed.add(datagram.bytes.len());
            }
        }
        self.line.set_line(now, conditions.line);
        self.conditions = conditions;
    }

    fn take_in(&mut self, now: Monotonic, mut datagram: Datagram) {
        // The number of draws is fixed, so the same datagrams are lost whatever else is set.
        let [loss, jitter, double, order, tamper, place]: [f64; 6] =
            array::from_fn(|_| (self.rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64);
        let size = datagram.bytes.len();
        let conditions = &self.conditions;
        if conditions.blackhole {
            self.traffic.blackholed.add(size);
            return;
        }
        if tamper < conditions.tampering && size > 0 {
            let bit = (place * (8 * size) as f64) as usize;
            datagram.bytes[bit / 8] ^= 1 << (bit % 8);
            self.traffic.tampered.add(size);
        }
        let queued = QueuedDatagram {
            datagram,
            is_lost: loss < conditions.loss,
            wait: (order < conditions.reordering.0).then_some(conditions.reordering.1),
        };
        let extra_delay = conditions.jitter.mul_f64(jitter);
        let copy = (double < conditions.duplication).then(|| queued.clone());
        if copy.is_some() {
            self.traffic.duplicated.add(size);
        }
        for queued in [Some(queued), copy].into_iter().flatten() {
            if !self.line.offer(now, size, extra_delay, queued) {
                self.traffic.overflowed.add(size);
            }
        }
    }

    /// The next datagram that has arrived by `now`.
    fn take(&mut self, now: Monotonic) -> Option<Datagram> {
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
                self.traffic.lost.add(size);
                continue;
            }
            match wait {
                Some(wait) if self.reordered.len() < MAX_REORDERED => {
                    self.traffic.reordered.add(size);
                    let number = self.traffic.reordered.packets;
                    self.reordered.push(Reverse((now + wait, number, datagram)));
                }
                Some(_) | None => return Some(datagram),
            }
        }
    }

    /// When the next datagram arrives or leaves the queue.
    fn next_event(&self) -> Option<Monotonic> {
        let reordered = self.reordered.peek().map(|Reverse((due, _, _))| *due);
        reordered.into_iter().chain(self.line.next_event()).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sends the numbers 0 to 99, one each millisecond; returns the time in ms and number of each arrival.
    fn sent(conditions: Conditions) -> (Vec<(u64, u8)>, Traffic) {
        let at_ms = |millis: u64| Monotonic::from_nanos(millis * 1_000_000);
        let mut channel = Channel::new(7, 0);
        channel.set(at_ms(0), conditions);
        let mut arrived = Vec::new();
        for now_ms in 0..1000 {
            if now_ms < 100 {
                let bytes = vec![now_ms as u8; 10];
                channel.take_in(at_ms(now_ms), Datagram { flow: 1, bytes });
            }
            while let Some(datagram) = channel.take(at_ms(now_ms)) {
                arrived.push((now_ms, datagram.bytes[0]));
            }
        }
        assert_eq!(channel.next_event(), None);
        (arrived, channel.traffic)
    }

    #[test]
    fn a_good_line_delivers_everything_at_once() {
        let (arrived, traffic) = sent(Conditions::default());
        assert!(arrived.into_iter().eq((0..100).map(|n| (u64::from(n), n))));
        assert_eq!(traffic, Traffic::default());
    }

    #[test]
    fn each_condition_is_applied_and_counted() {
        let (arrived, traffic) = sent(Conditions {
            reordering: (0.2, Duration::from_millis(15)),
            loss: 0.1,
            duplication: 0.2,
            tampering: 0.1,
            ..Conditions::default()
        });
        let [lost, duplicated, reordered, tampered] = [
            traffic.lost,
            traffic.duplicated,
            traffic.reordered,
            traffic.tampered,
        ]
        .map(|count| count.packets);
        assert!((3..25).contains(&lost) && (10..30).contains(&duplicated));
        assert!((10..40).contains(&reordered) && (3..25).contains(&tampered));
        assert_eq!(arrived.len() as u64, 100 + duplicated - lost);
        assert!(!arrived.iter().map(|(_, n)| n).is_sorted());
    }
}
