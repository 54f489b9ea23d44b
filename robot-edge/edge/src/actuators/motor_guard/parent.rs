//! The end of the teleop loop: starts the guard, hands over the newest velocity, and returns the newest report.

use std::ffi::OsString;
use std::io;
use std::io::Write as _;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::actuators::MOTOR_GUARD_COMMAND;
use crate::actuators::motor_guard::frame::nanos;
use crate::actuators::motor_guard::supervisor::Supervisor;
use crate::actuators::motor_link::MotorLinkConfig;
use crate::actuators::report::{Fault, Report};
use measurement::time::Monotonic;
use network::clock;
use teleop::Velocity;

/// A guard without a report for this long is lost, and so is the thread that communicates with it. Both do something
/// every 50 ms; a busy computer must not make a fault of that, and the motors' own watchdog acts after 1 s.
const SILENCE: Duration = Duration::from_millis(500);

#[derive(Clone, Debug)]
pub struct GuardCommand {
    pub program: PathBuf,
    pub arguments: Vec<OsString>,
    /// Added to its environment.
    pub environment: Vec<(OsString, OsString)>,
    /// Write end of the pipe for what the controller sends ([`crate::actuators::forward_pipe`]).
    pub forward_pipe: Option<Arc<OwnedFd>>,
    /// Read end of the pipe for distances of obstacles ([`crate::actuators::mavlink::obstacle_pipe`]).
    pub obstacle_pipe: Option<Arc<OwnedFd>>,
}

impl GuardCommand {
    /// This program, as a guard of motors that hang on `config`: it gets the configuration as one argument, in JSON.
    pub fn this_program(
        config: &MotorLinkConfig,
        forward_pipe: Option<Arc<OwnedFd>>,
    ) -> io::Result<Self> {
        let config = serde_json::to_string(config)?;
        Ok(Self {
            program: std::env::current_exe()?,
            arguments: vec![MOTOR_GUARD_COMMAND.into(), config.into()],
            environment: Vec::new(),
            forward_pipe,
            obstacle_pipe: None,
        })
    }
}

#[derive(Debug)]
pub struct GuardedMotors {
    shared: Arc<Shared>,
    wake: UnixStream,
    thread: Option<JoinHandle<()>>,
    silence: Duration,
    last: MotorSnapshot,
}

/// What the teleop loop and the thread beside it share; neither waits for the other.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) latest: LatestCommand,
    /// The thread holds it for as long as copying takes; the loop only tries it, and else keeps what it had.
    pub(super) snapshot: Mutex<MotorSnapshot>,
    pub(super) is_over: AtomicBool,
    /// 0 while there is none.
    pub(super) guard_pid: AtomicU32,
    /// How often a mode that obeys was requested.
    pub(super) mode_requests: AtomicU32,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct MotorSnapshot {
    pub(super) known: Result<Report, Fault>,
    pub(super) at: Monotonic,
}

impl GuardedMotors {
    /// Starts a guard and the thread that communicates with it. It does not wait for either: the first reports say
    /// [`crate::actuators::report::Readiness::Starting`].
    pub fn start(command: GuardCommand, config: MotorLinkConfig) -> io::Result<Self> {
        Self::start_with(command, config, SILENCE)
    }

    pub(super) fn start_with(
        command: GuardCommand,
        config: MotorLinkConfig,
        silence: Duration,
    ) -> io::Result<Self> {
        let now = clock::now();
        let last = MotorSnapshot {
            known: Ok(Report::unknown(now)),
            at: now,
        };
        let shared = Arc::new(Shared {
            latest: LatestCommand::default(),
            snapshot: Mutex::new(last),
            is_over: AtomicBool::new(false),
            guard_pid: AtomicU32::new(0),
            mode_requests: AtomicU32::new(0),
        });
        let (wake, woken) = UnixStream::pair()?;
        wake.set_nonblocking(true)?;
        woken.set_nonblocking(true)?;
        let thread = std::thread::Builder::new()
            .name("motors".to_owned())
            .spawn({
                let shared = Arc::clone(&shared);
                move || Supervisor::new(command, config, silence, shared, woken).run()
            })?;
        Ok(Self {
            shared,
            wake,
            thread: Some(thread),
            silence,
            last,
        })
    }

    /// Requests `velocity`, decided at `now`; returns the state of the motors. Call it in every round, also for zero: a
    /// velocity that is not repeated for [`super::WATCHDOG`] ends in a stop. It never blocks.
    pub fn apply(&mut self, velocity: Velocity, now: Monotonic) -> Result<Report, Fault> {
        let is_finite = velocity.is_finite();
        let motor_command = if is_finite { velocity } else { Velocity::ZERO };
        self.shared.latest.put(motor_command, now);
        self.wake();
        if let Ok(snapshot) = self.shared.snapshot.try_lock() {
            self.last = *snapshot;
        }
        if !is_finite {
            return Err(Fault::NotANumber);
        }
        if now.since(self.last.at) > self.silence {
            return Err(Fault::SupervisorGone);
        }
        self.last.known
    }

    /// Has the guard request once, with the next velocity, that the motors' controller obeys velocities.
    pub fn request_mode(&self) {
        self.shared.mode_requests.fetch_add(1, Ordering::Relaxed);
    }

    pub fn guard_pid(&self) -> Option<u32> {
        match self.shared.guard_pid.load(Ordering::Acquire) {
            0 => None,
            pid => Some(pid),
        }
    }

    fn wake(&self) {
        // Where there is no room, it is awake already, or gone, which shows elsewhere.
        drop((&self.wake).write(&[0]));
    }
}

impl Drop for GuardedMotors {
    /// Sends zero to the motors and waits until the guard has ended, for 3 s at most.
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            // It has panicked, or not: there is nothing left to be done about it.
            drop(thread.join());
        }
    }
}

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
                lateral_mps: 0.0,
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
            lateral_mps: 0.0,
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
                        lateral_mps: 0.0,
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
