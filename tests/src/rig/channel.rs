//! One direction of an emulated link: a queue before a limited rate, loss, changes, then a delay.

use std::array;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};

/// Datagrams that are kept for [`Channel::captured`].
const CAPTURED: usize = 200;

/// Datagrams that wait in each part of a channel; further ones are dropped.
const CAPACITY: usize = 1 << 14;

pub(super) const MAX_DATAGRAM_BYTES: usize = 1 << 16;

/// What happens to datagrams in one direction. The default lets them pass at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// From the end of the queue to the other end of the link.
    pub delay: Duration,
    /// Greatest delay beyond that; each datagram draws its own, evenly from 0. They keep their order.
    pub jitter: Duration,
    /// Bytes per second that leave the queue; `None` is no limit, 0 holds everything.
    pub rate_bytes_per_s: Option<u64>,
    /// Bytes that may wait for the rate. One datagram may always wait.
    pub queue_bytes: usize,
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

/// A datagram and the flow it belongs to.
#[derive(Clone, Debug)]
pub(super) struct Datagram {
    pub(super) flow: usize,
    pub(super) bytes: Vec<u8>,
}

#[derive(Debug)]
pub(super) struct Channel {
    conditions: watch::Sender<Conditions>,
    queue: mpsc::Sender<Datagram>,
    queued_bytes: AtomicUsize,
    received_bytes: AtomicU64,
    blackholed: AtomicU64,
    captured: Mutex<VecDeque<Vec<u8>>>,
}

impl Channel {
    /// Starts its tasks on the current runtime; `send` gets each datagram when it is due. `seed` decides which are lost or
    /// changed.
    pub(super) fn start<S>(seed: u64, send: S) -> Arc<Self>
    where
        S: Fn(&Datagram) + Clone + Send + 'static,
    {
        let (queue, queued) = mpsc::channel(CAPACITY);
        let channel = Arc::new(Self {
            conditions: watch::Sender::default(),
            queue,
            queued_bytes: AtomicUsize::default(),
            received_bytes: AtomicU64::default(),
            blackholed: AtomicU64::default(),
            captured: Mutex::default(),
        });
        let rng = ChaCha8Rng::seed_from_u64(seed);
        tokio::spawn(Arc::clone(&channel).serve(queued, rng, send));
        channel
    }

    /// Datagrams under way keep their arrival time.
    pub(super) fn set(&self, conditions: Conditions) {
        self.conditions.send_replace(conditions);
    }

    /// Bytes that came from the sender.
    pub(super) fn received_bytes(&self) -> u64 {
        self.received_bytes.load(Ordering::Relaxed)
    }

    /// Datagrams that were dropped because the link was gone.
    pub(super) fn blackholed(&self) -> u64 {
        self.blackholed.load(Ordering::Relaxed)
    }

    /// The last datagrams from the sender, unchanged, the oldest first.
    pub(super) fn captured(&self) -> Vec<Vec<u8>> {
        let captured = self.captured.lock();
        let captured = captured.unwrap_or_else(PoisonError::into_inner);
        captured.iter().cloned().collect()
    }

    /// A datagram comes from its sender.
    pub(super) fn receive(&self, datagram: Datagram) {
        let bytes = &datagram.bytes;
        self.received_bytes
            .fetch_add(bytes.len() as u64, Ordering::Relaxed);
        {
            let captured = self.captured.lock();
            let mut captured = captured.unwrap_or_else(PoisonError::into_inner);
            if captured.len() >= CAPTURED {
                captured.pop_front();
            }
            captured.push_back(bytes.clone());
        }
        self.inject(datagram);
    }

    /// Puts a datagram into the queue, unless that is full.
    pub(super) fn inject(&self, datagram: Datagram) {
        let conditions = *self.conditions.borrow();
        if conditions.blackhole {
            self.blackholed.fetch_add(1, Ordering::Relaxed);
            return;
        }
        let bytes = datagram.bytes.len();
        let queued_bytes = self.queued_bytes.load(Ordering::Relaxed);
        let is_full = queued_bytes > 0 && queued_bytes + bytes > conditions.queue_bytes;
        if conditions.rate_bytes_per_s.is_some() && is_full {
            return;
        }
        self.queued_bytes.fetch_add(bytes, Ordering::Relaxed);
        if self.queue.try_send(datagram).is_err() {
            self.queued_bytes.fetch_sub(bytes, Ordering::Relaxed);
        }
    }

    async fn serve<S>(
        self: Arc<Self>,
        mut queued: mpsc::Receiver<Datagram>,
        mut rng: ChaCha8Rng,
        send: S,
    ) where
        S: Fn(&Datagram) + Clone + Send + 'static,
    {
        let (line, delayed) = mpsc::channel(CAPACITY);
        tokio::spawn(Arc::clone(&self).deliver(delayed, send.clone()));
        let mut conditions = self.conditions.subscribe();
        let (mut free_at, mut last_due) = (Instant::now(), Instant::now());
        while let Some(mut datagram) = queued.recv().await {
            let passes = |conditions: &Conditions| conditions.rate_bytes_per_s != Some(0);
            let Ok(conditions) = conditions.wait_for(passes).await.map(|now| *now) else {
                return;
            };
            let size = datagram.bytes.len();
            if let Some(rate) = conditions.rate_bytes_per_s {
                let takes = Duration::from_secs_f64(size as f64 / rate as f64);
                free_at = free_at.max(Instant::now()) + takes;
                sleep_until(free_at).await;
            }
            self.queued_bytes.fetch_sub(size, Ordering::Relaxed);
            let [loss, jitter, double, order, tamper, place]: [f64; 6] =
                array::from_fn(|_| (rng.next_u64() >> 11) as f64 / (1_u64 << 53) as f64);
            if loss < conditions.loss {
                continue;
            }
            if tamper < conditions.tampering && size > 0 {
                let bit = (place * (8 * size) as f64) as usize;
                datagram.bytes[bit / 8] ^= 1 << (bit % 8);
            }
            let delay = conditions.delay + conditions.jitter.mul_f64(jitter);
            last_due = last_due.max(Instant::now() + delay);
            let (reordered, wait) = conditions.reordering;
            let copies = 1 + usize::from(double < conditions.duplication);
            for copy in std::iter::repeat_n(datagram, copies) {
                if order < reordered {
                    let (due, send) = (last_due + wait, send.clone());
                    let channel = Arc::clone(&self);
                    tokio::spawn(async move {
                        sleep_until(due).await;
                        if !channel.conditions.borrow().blackhole {
                            send(&copy);
                        }
                    });
                } else {
                    drop(line.try_send((last_due, copy)));
                }
            }
        }
    }

    async fn deliver(
        self: Arc<Self>,
        mut delayed: mpsc::Receiver<(Instant, Datagram)>,
        send: impl Fn(&Datagram),
    ) {
        while let Some((due, datagram)) = delayed.recv().await {
            sleep_until(due).await;
            if !self.conditions.borrow().blackhole {
                send(&datagram);
            }
        }
    }
}
