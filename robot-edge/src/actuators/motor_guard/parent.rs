//! The edge's end: asks the guard, listens to it, and takes over where it is lost.

use std::ffi::OsString;
use std::io;
use std::io::Write as _;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use super::latest_command::LatestCommand;
use super::supervisor::Supervisor;
use crate::actuators::MOTOR_GUARD_COMMAND;
use crate::actuators::report::{Fault, Report};
use crate::actuators::roboteq::RoboteqConfig;
use crate::clock;
use measurement::time::Monotonic;
use teleop::Velocity;

/// A guard that has told nothing for this long is lost, and so is the thread that speaks to it. Both do something every
/// 50 ms; a busy computer must not make a fault of that, and the motors' own watchdog acts after 1 s.
const SILENCE: Duration = Duration::from_millis(500);

/// How the guard's process is started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuardCommand {
    /// The program.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<OsString>,
    /// Added to its environment.
    pub environment: Vec<(OsString, OsString)>,
}

impl GuardCommand {
    /// This program, as a guard of motors that hang on `config`: it gets the configuration as one argument, in JSON.
    ///
    /// # Errors
    /// The system does not say which program this is, or the port's name is not UTF-8.
    pub fn this_program(config: &RoboteqConfig) -> io::Result<Self> {
        let config = serde_json::to_string(config)?;
        Ok(Self {
            program: std::env::current_exe()?,
            arguments: vec![MOTOR_GUARD_COMMAND.into(), config.into()],
            environment: Vec::new(),
        })
    }
}

/// Motors behind a guard.
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
}

/// What is known, and when that was.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorSnapshot {
    pub(super) known: Result<Report, Fault>,
    pub(super) at: Monotonic,
}

impl GuardedMotors {
    /// Starts a guard and the thread that speaks to it. It does not wait for either: the first reports say
    /// [`crate::actuators::report::Readiness::Starting`].
    ///
    /// # Errors
    /// The system has no more threads or sockets.
    pub fn start(command: GuardCommand, config: RoboteqConfig) -> io::Result<Self> {
        Self::start_with(command, config, SILENCE)
    }

    pub(super) fn start_with(
        command: GuardCommand,
        config: RoboteqConfig,
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

    /// As [`crate::actuators::Actuator::apply`].
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

    /// The guard's process, while there is one.
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
    /// Tells the motors zero and waits until the guard has ended, for 3 s at most.
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.wake();
        if let Some(thread) = self.thread.take() {
            // It has panicked, or not: there is nothing left to be done about it.
            drop(thread.join());
        }
    }
}
