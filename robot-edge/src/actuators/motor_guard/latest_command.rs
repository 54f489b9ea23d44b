//! Hands the newest velocity from the teleop loop to the thread that speaks to the guard. Neither ever waits.

use std::sync::atomic::{AtomicU64, Ordering, fence};

use super::frame::nanos;
use measurement::time::Monotonic;
use teleop::Velocity;

/// How often a reader looks again that was disturbed. Writing is four stores: it meets them seldom, and then comes
/// back at its next turn.
const ATTEMPTS: usize = 8;

/// One velocity and its moment of decision, in the manner of a sequence lock: the version is odd while they are
/// written. One thread writes.
#[derive(Debug, Default)]
pub(super) struct LatestCommand {
    version: AtomicU64,
    decided_at: AtomicU64,
    linear: AtomicU64,
    angular: AtomicU64,
}

impl LatestCommand {
    /// Replaces what is there.
    pub(super) fn put(&self, velocity: Velocity, decided_at: Monotonic) {
        let version = self.version.load(Ordering::Relaxed);
        self.version
            .store(version.wrapping_add(1), Ordering::Relaxed);
        // Orders the odd version before the values; the last store orders the values before the even one.
        fence(Ordering::Release);
        self.decided_at.store(nanos(decided_at), Ordering::Relaxed);
        self.linear
            .store(velocity.linear_mps.to_bits(), Ordering::Relaxed);
        self.angular
            .store(velocity.angular_radps.to_bits(), Ordering::Relaxed);
        self.version
            .store(version.wrapping_add(2), Ordering::Release);
    }

    /// What is there, if it is not of the version `known`; with its own version.
    pub(super) fn newer_than(&self, known: u64) -> Option<(u64, Velocity, Monotonic)> {
        for _ in 0..ATTEMPTS {
            let version = self.version.load(Ordering::Acquire);
            if version == known {
                return None;
            }
            let decided_at = Monotonic::from_nanos(self.decided_at.load(Ordering::Relaxed));
            let velocity = Velocity {
                linear_mps: f64::from_bits(self.linear.load(Ordering::Relaxed)),
                angular_radps: f64::from_bits(self.angular.load(Ordering::Relaxed)),
            };
            fence(Ordering::Acquire);
            let is_whole =
                version.is_multiple_of(2) && self.version.load(Ordering::Relaxed) == version;
            if is_whole {
                return Some((version, velocity, decided_at));
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use super::*;

    #[test]
    fn only_what_is_new_is_handed_over() {
        let latest = LatestCommand::default();
        assert!(latest.newer_than(0).is_none());
        let velocity = Velocity {
            linear_mps: 1.0,
            angular_radps: -2.0,
        };
        latest.put(Velocity::ZERO, Monotonic::from_nanos(1));
        latest.put(velocity, Monotonic::from_nanos(2));
        let (version, handed, at) = latest.newer_than(0).unwrap();
        assert_eq!((handed, at), (velocity, Monotonic::from_nanos(2)));
        assert!(latest.newer_than(version).is_none());
    }

    #[test]
    fn what_is_being_written_is_not_handed_over() {
        let latest = LatestCommand::default();
        latest.put(Velocity::ZERO, Monotonic::from_nanos(1));
        latest.version.fetch_add(1, Ordering::Relaxed);
        assert!(latest.newer_than(0).is_none());
        latest.version.fetch_add(1, Ordering::Relaxed);
        assert!(latest.newer_than(0).is_some());
    }

    #[test]
    fn what_is_handed_over_belongs_together() {
        let latest = Arc::new(LatestCommand::default());
        let is_over = Arc::new(AtomicBool::new(false));
        let writer = std::thread::spawn({
            let (latest, is_over) = (Arc::clone(&latest), Arc::clone(&is_over));
            move || {
                for number in 1.. {
                    let velocity = Velocity {
                        linear_mps: number as f64,
                        angular_radps: -(number as f64),
                    };
                    latest.put(velocity, Monotonic::from_nanos(number));
                    if is_over.load(Ordering::Relaxed) {
                        return;
                    }
                    // Without any pause between two, no reader ever finds one whole.
                    (0..number % 64).for_each(|_| std::hint::spin_loop());
                }
            }
        });
        let (mut known, mut newest, mut handed) = (0, 0.0, 0);
        while handed < 300 {
            if let Some((version, velocity, at)) = latest.newer_than(known) {
                assert!(velocity.linear_mps >= newest, "never backwards");
                assert_eq!(
                    velocity.linear_mps.to_bits(),
                    (-velocity.angular_radps).to_bits()
                );
                assert_eq!(velocity.linear_mps.to_bits(), (nanos(at) as f64).to_bits());
                (known, newest) = (version, velocity.linear_mps);
                handed += 1;
            }
        }
        is_over.store(true, Ordering::Relaxed);
        writer.join().unwrap();
    }
}
