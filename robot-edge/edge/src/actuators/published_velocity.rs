//! Motors of another system that takes velocities by messages: `geometry_msgs/Twist` to ROS 2.
//!
//! Nothing below this seam is ours: where this process is killed or its machine hangs, nobody says zero, and the
//! vehicle stops if the other system stops by itself when messages cease. So this is no substitute for
//! [`super::roboteq`] behind its guard; it is what can be done for a vehicle whose motors are not ours.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::Velocity;
use crate::lock;
use measurement::time::Monotonic;
use network::clock;

/// Validity of a velocity, from its decision on; then zero is published. The same as for guarded motors.
pub const WATCHDOG: Duration = Duration::from_millis(200);

/// Period of repeating zero when there is no new velocity.
const REPEAT: Duration = Duration::from_millis(50);

/// Number of zero messages at the end: one may be lost.
const FINAL_ZERO_COUNT: usize = 3;

/// Publishes velocities to the other system. It may block.
pub trait VelocitySink: Send {
    fn publish(&mut self, velocity: Velocity);

    fn has_subscriber(&self) -> bool;
}

/// Motors at the other end of a [`VelocitySink`], which has a thread of its own.
#[derive(Debug)]
pub struct PublishedVelocity {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    latest: Mutex<VelocityDecision>,
    changed: Condvar,
    had_subscriber: AtomicBool,
}

#[derive(Clone, Copy, Debug, Default)]
struct VelocityDecision {
    velocity: Velocity,
    decided: Monotonic,
    version: u64,
    is_over: bool,
}

impl PublishedVelocity {
    /// Begins to publish.
    pub fn start(sink: Box<dyn VelocitySink>) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let thread = thread::Builder::new().name("velocity".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            move || run(sink, &shared)
        })?;
        Ok(Self {
            shared,
            thread: Some(thread),
        })
    }

    /// Asks for `velocity`, which was decided at `now`; whether anybody has ever listened. It never waits for the sink.
    pub fn apply(&self, velocity: Velocity, now: Monotonic) -> bool {
        {
            let mut latest = lock(&self.shared.latest);
            latest.velocity = velocity;
            latest.decided = now;
            latest.version += 1;
        }
        self.shared.changed.notify_one();
        self.shared.had_subscriber.load(Ordering::Relaxed)
    }
}

impl Drop for PublishedVelocity {
    fn drop(&mut self) {
        lock(&self.shared.latest).is_over = true;
        self.shared.changed.notify_one();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread that publishes velocities failed");
        }
    }
}

impl Shared {
    /// The newest decision, as soon as it is another than number `known`, or after a while.
    fn newer_than(&self, known: u64) -> VelocityDecision {
        let is_old = |latest: &mut VelocityDecision| latest.version == known && !latest.is_over;
        let waited = self
            .changed
            .wait_timeout_while(lock(&self.latest), REPEAT, is_old);
        let (latest, _) = waited.unwrap_or_else(PoisonError::into_inner);
        *latest
    }
}

fn run(mut sink: Box<dyn VelocitySink>, shared: &Shared) {
    let mut known = 0;
    loop {
        let latest = shared.newer_than(known);
        if latest.is_over {
            for _ in 0..FINAL_ZERO_COUNT {
                sink.publish(Velocity::ZERO);
            }
            return;
        }
        if !shared.had_subscriber.load(Ordering::Relaxed) && sink.has_subscriber() {
            shared.had_subscriber.store(true, Ordering::Relaxed);
        }
        let is_stale = clock::elapsed(latest.decided) > WATCHDOG;
        if is_stale {
            sink.publish(Velocity::ZERO);
        } else if latest.version != known {
            sink.publish(latest.velocity);
        }
        known = latest.version;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AHEAD: Velocity = Velocity {
        linear_mps: 0.5,
        lateral_mps: 0.0,
        angular_radps: 0.1,
    };

    #[derive(Clone, Default)]
    struct Journal(Arc<Mutex<Vec<Velocity>>>);

    impl VelocitySink for Journal {
        fn publish(&mut self, velocity: Velocity) {
            self.0.lock().unwrap().push(velocity);
        }

        fn has_subscriber(&self) -> bool {
            true
        }
    }

    impl Journal {
        fn wait_until(&self, is_so: impl Fn(&[Velocity]) -> bool) {
            let began = clock::now();
            while !is_so(&self.0.lock().unwrap()) {
                assert!(
                    clock::elapsed(began) < Duration::from_mins(1),
                    "{:?}",
                    self.0
                );
                thread::sleep(Duration::from_millis(2));
            }
        }
    }

    #[test]
    fn velocities_are_published_and_silence_ends_in_zero() {
        let journal = Journal::default();
        let motors = PublishedVelocity::start(Box::new(journal.clone())).unwrap();
        motors.apply(AHEAD, clock::now());
        journal.wait_until(|published| published.contains(&AHEAD));
        // The loop hangs.
        journal.wait_until(|published| published.last() == Some(&Velocity::ZERO));
        let published = journal.0.lock().unwrap().len();
        journal.wait_until(|now| now.len() >= published + 3);
        assert_eq!(
            journal
                .0
                .lock()
                .unwrap()
                .iter()
                .filter(|&v| *v == AHEAD)
                .count(),
            1
        );
        assert!(motors.apply(AHEAD, clock::now()), "somebody listens");
        drop(motors);
        let published = journal.0.lock().unwrap();
        assert_eq!(
            published[published.len() - FINAL_ZERO_COUNT..],
            [Velocity::ZERO; FINAL_ZERO_COUNT]
        );
    }

    #[test]
    fn what_was_decided_too_long_ago_is_not_said() {
        let journal = Journal::default();
        let motors = PublishedVelocity::start(Box::new(journal.clone())).unwrap();
        motors.apply(AHEAD, Monotonic::from_nanos(0));
        journal.wait_until(|published| !published.is_empty());
        drop(motors);
        assert!(
            journal
                .0
                .lock()
                .unwrap()
                .iter()
                .all(|v| *v == Velocity::ZERO)
        );
    }
}
