//! A controller and its driver at the two ends of a port that may come and go.

use std::fs;
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use rustix::termios::{self, ControlModes, InputModes, OptionalActions, QueueSelector};

use crate::actuators::MOTOR_GUARD_COMMAND;
use crate::actuators::forward_pipe::ForwardPipe;
use crate::actuators::motor_link::{LinkStatus, MotorLink, Sharing, State};
use crate::actuators::report::ControllerFault;
use crate::actuators::roboteq::config::RoboteqConfig;
use crate::actuators::roboteq::driver::{Driver, EncoderQueries, Transmission};
use crate::actuators::roboteq::wire;
use measurement::time::Monotonic;
use teleop::Velocity;

const REOPEN: Duration = Duration::from_millis(200);

/// Between two attempts to open a port that another process has locked.
const LOCKED_RETRY: Duration = Duration::from_millis(50);

/// A guard without an edge ends by itself within 600 ms. One that still runs after this was stopped, and is killed.
const TAKE_OVER_AFTER: Duration = Duration::from_secs(2);

/// Well before that zero is sent to the motors of a port that was left behind.
const STOP_AFTER: Duration = Duration::from_millis(150);

/// Most reads in one step: more than a line of 960 characters a second can bring, and a bound for one that never ends.
const READS: usize = 16;

#[derive(Debug)]
pub struct SerialLink {
    config: RoboteqConfig,
    sharing: Sharing,
    connection: Connection,
    /// Gets what is received; without it no counts are asked for.
    forward_pipe: Option<ForwardPipe>,
    /// Times that a port was lost that was open, and what its drivers lost before.
    reconnects: u32,
    locked: Option<Locked>,
}

#[derive(Clone, Copy, Debug)]
struct Locked {
    since: Monotonic,
    /// Zero was sent to the motors of the port that was left behind.
    was_stopped: bool,
}

#[derive(Debug)]
enum Connection {
    Closed {
        retry: Monotonic,
        /// Absent where it was not tried yet, or may be open soon.
        fault: Option<ControllerFault>,
    },
    Open {
        port: Port,
        driver: Box<Driver>,
    },
}

impl SerialLink {
    /// Not open yet; the first [`Self::step`] tries it.
    pub const fn new(
        config: RoboteqConfig,
        sharing: Sharing,
        forward_pipe: Option<ForwardPipe>,
        now: Monotonic,
    ) -> Self {
        Self {
            config,
            sharing,
            forward_pipe,
            connection: Connection::Closed {
                retry: now,
                fault: None,
            },
            reconnects: 0,
            locked: None,
        }
    }

    fn try_step(&mut self, velocity: Velocity, now: Monotonic) -> Result<(), PortError> {
        if let Connection::Closed { retry, .. } = self.connection {
            if now < retry {
                return Ok(());
            }
            let opened = Port::open(&self.config.port, self.sharing);
            if opened.as_ref().is_err_and(PortError::is_locked) {
                self.wait_for_holder(now);
                return Ok(());
            }
            self.locked = None;
            let port = opened?;
            let queries = EncoderQueries {
                speeds: self.config.encoder_full_speed_mps.is_some(),
                counts: self.forward_pipe.is_some(),
            };
            let driver = Driver::new(queries, self.config.require_watchdog, now);
            self.connection = Connection::Open {
                port,
                driver: Box::new(driver),
            };
        }
        let Connection::Open { port, driver } = &mut self.connection else {
            return Ok(());
        };
        let lost = |source| PortError::Io {
            path: self.config.port.clone(),
            source,
        };
        let mut buffer = [0; 256];
        for _ in 0..READS {
            let bytes = port.read(&mut buffer).map_err(lost)?;
            if bytes.is_empty() {
                break;
            }
            driver.receive(bytes, now);
            if let Some(pipe) = &mut self.forward_pipe {
                pipe.push(bytes);
            }
        }
        driver.command(self.config.powers(velocity));
        while let Some(transmission) = driver.transmit(now) {
            port.send(&transmission).map_err(lost)?;
        }
        Ok(())
    }

    /// The port is locked: by the guard of an edge that was killed just now, as a rule.
    fn wait_for_holder(&mut self, now: Monotonic) {
        let new = Locked {
            since: now,
            was_stopped: false,
        };
        let locked = self.locked.get_or_insert(new);
        let waited = now.since(locked.since);
        let holder = LockHolder::of(&self.config.port);
        let orphan = holder.filter(|holder| holder.is_orphaned_guard());
        if orphan.is_some() && waited >= STOP_AFTER && !locked.was_stopped {
            locked.was_stopped = true;
            // If it cannot be sent now, it is sent when the port is open.
            drop(Port::stop_without_reply(&self.config.port));
        }
        let is_ended =
            |orphan: LockHolder| waited < 2 * TAKE_OVER_AFTER && orphan.kill_orphaned_guard();
        let (retry, fault) = if waited < TAKE_OVER_AFTER || orphan.is_some_and(is_ended) {
            (LOCKED_RETRY, None)
        } else {
            let pid = holder.map_or(0, |holder| holder.pid);
            (REOPEN, Some(ControllerFault::Held(pid)))
        };
        self.connection = Connection::Closed {
            retry: now + retry,
            fault,
        };
    }
}

impl MotorLink for SerialLink {
    fn step(&mut self, velocity: Velocity, now: Monotonic) {
        let outcome = self.try_step(velocity, now);
        // After everything that the motors wait for.
        if let Some(pipe) = &mut self.forward_pipe {
            pipe.flush();
        }
        if let Err(lost) = outcome {
            if let Connection::Open { driver, .. } = &self.connection {
                let before = driver.status(now).reconnects;
                self.reconnects = self.reconnects.saturating_add(before).saturating_add(1);
            }
            self.connection = Connection::Closed {
                retry: now + REOPEN,
                fault: Some(lost.fault()),
            };
        }
    }

    fn deadline(&self) -> Monotonic {
        match &self.connection {
            Connection::Closed { retry, .. } => *retry,
            Connection::Open { driver, .. } => driver.deadline(),
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        match &self.connection {
            Connection::Closed { .. } => None,
            Connection::Open { port, .. } => Some(port.as_fd()),
        }
    }

    fn status(&self, now: Monotonic) -> LinkStatus {
        let common = LinkStatus {
            reconnects: self.reconnects,
            lost_bytes: self
                .forward_pipe
                .as_ref()
                .map_or(0, ForwardPipe::lost_bytes),
            ..LinkStatus::STARTING
        };
        match &self.connection {
            Connection::Closed { fault, .. } => LinkStatus {
                state: fault.map_or(State::Starting, State::Faulty),
                ..common
            },
            Connection::Open { driver, .. } => {
                let status = driver.status(now);
                LinkStatus {
                    state: status.state,
                    // What the vehicle does where the channels do what they have acknowledged.
                    applied: (status.acknowledged)
                        .map(|powers| self.config.velocity_of_powers(powers)),
                    measured: (status.encoders)
                        .and_then(|speeds| self.config.velocity_of_encoders(speeds)),
                    battery_v: status.battery_v,
                    flags: status.flags,
                    watchdog: status.watchdog,
                    reconnects: self.reconnects.saturating_add(status.reconnects),
                    ..common
                }
            }
        }
    }

    fn has_stopped_since(&self, since: Monotonic) -> bool {
        match &self.connection {
            Connection::Closed { .. } => false,
            Connection::Open { driver, .. } => driver.has_stopped_since(since),
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum PortError {
    #[error("{path}: {source}", path = path.display())]
    Io { path: PathBuf, source: io::Error },
    /// The adapter cannot do 7 data bits with even parity, and would send something else.
    #[error("{path}: this port cannot do 9600 baud, 7 data bits, even parity, 1 stop bit", path = path.display())]
    Settings { path: PathBuf },
}

impl PortError {
    /// By the system's number for it, `EINVAL` for settings that the port cannot do.
    pub fn fault(&self) -> ControllerFault {
        let number = match self {
            Self::Io { source, .. } => source.raw_os_error().unwrap_or(0),
            Self::Settings { .. } => rustix::io::Errno::INVAL.raw_os_error(),
        };
        ControllerFault::Port(u8::try_from(number).unwrap_or(u8::MAX))
    }

    pub fn is_locked(&self) -> bool {
        match self {
            Self::Io { source, .. } => source.kind() == io::ErrorKind::WouldBlock,
            Self::Settings { .. } => false,
        }
    }
}

#[derive(Debug)]
pub struct Port(File);

impl Port {
    /// Opens `path` with the AX3500's settings (manual, p. 138): 9600 baud, 7 data bits, even parity, 1 stop bit, no
    /// flow control. It waits neither for a carrier nor for anybody else.
    pub fn open(path: &Path, sharing: Sharing) -> Result<Self, PortError> {
        let io = |source: rustix::io::Errno| PortError::Io {
            path: path.to_owned(),
            source: source.into(),
        };
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(io)?;
        match sharing {
            Sharing::Exclusive => {
                rustix::fs::flock(&fd, FlockOperation::NonBlockingLockExclusive).map_err(io)?;
            }
            Sharing::Shared => {}
        }
        if apply_settings(&fd).map_err(io)? || is_pseudo_terminal(&fd).map_err(io)? {
            Ok(Self(File::from(fd)))
        } else {
            Err(PortError::Settings {
                path: path.to_owned(),
            })
        }
    }

    /// Sends zero once to the motors at `path`, also if another process holds the port, without waiting for a reply.
    pub fn stop_without_reply(path: &Path) -> Result<(), PortError> {
        let stop = Transmission {
            bytes: wire::stop_without_reply(),
            flush: true,
        };
        let sent = Self::open(path, Sharing::Shared)?.send(&stop);
        sent.map_err(|source| PortError::Io {
            path: path.to_owned(),
            source,
        })
    }

    /// Sends without waiting. What does not fit into the port's buffer is lost: the controller will not answer, and the
    /// driver then begins again.
    pub fn send(&self, transmission: &Transmission) -> io::Result<()> {
        if transmission.flush {
            termios::tcflush(&self.0, QueueSelector::IOFlush)?;
        }
        match rustix::io::write(&self.0, transmission.bytes.as_bytes()) {
            Ok(_) | Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(()),
            Err(errno) => Err(errno.into()),
        }
    }

    /// What has come in, without waiting; empty where nothing has.
    pub fn read<'a>(&self, buffer: &'a mut [u8]) -> io::Result<&'a [u8]> {
        match rustix::io::read(&self.0, &mut *buffer) {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(count) => Ok(buffer.get(..count).unwrap_or_default()),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => Ok(&[]),
            Err(errno) => Err(errno.into()),
        }
    }
}

impl AsFd for Port {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

/// Returns whether the port took them; a port may say yes and do something else.
fn apply_settings(fd: &OwnedFd) -> rustix::io::Result<bool> {
    let mut settings = termios::tcgetattr(fd)?;
    settings.make_raw();
    let frame =
        ControlModes::CSIZE | ControlModes::PARENB | ControlModes::PARODD | ControlModes::CSTOPB;
    let wanted = ControlModes::CS7 | ControlModes::PARENB;
    settings.control_modes &= !(frame | ControlModes::CRTSCTS | ControlModes::HUPCL);
    settings.control_modes |= wanted | ControlModes::CREAD | ControlModes::CLOCAL;
    settings.input_modes &= !(InputModes::IXON | InputModes::IXOFF | InputModes::IXANY);
    // A character with a parity error is dropped: its command is then refused, or its echo differs.
    settings.input_modes |= InputModes::INPCK | InputModes::IGNPAR;
    settings.set_speed(termios::speed::B9600)?;
    termios::tcsetattr(fd, OptionalActions::Now, &settings)?;
    let taken = termios::tcgetattr(fd)?;
    Ok(taken.control_modes & frame == wanted
        && taken.output_speed() == termios::speed::B9600
        && taken.input_speed() == termios::speed::B9600)
}

/// Pseudo-terminals carry bytes, whatever the settings; an emulated controller hangs on one.
fn is_pseudo_terminal(fd: &OwnedFd) -> rustix::io::Result<bool> {
    // Linux, Documentation/admin-guide/devices.txt: Unix98 PTY slaves are 136–143.
    let major = rustix::fs::major(rustix::fs::fstat(fd)?.st_rdev);
    Ok((136..=143).contains(&major))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LockHolder {
    pub(super) pid: u32,
}

impl LockHolder {
    pub(super) fn of(port: &Path) -> Option<Self> {
        let file = fs::metadata(port).ok()?;
        let locks = fs::read_to_string("/proc/locks").ok()?;
        holder_in(&locks, file.dev(), file.ino()).map(|pid| Self { pid })
    }

    /// Whether it is a motor guard without an edge. A guard's parent runs the same program; after the parent's death, the
    /// guard is a child of another process.
    pub(super) fn is_orphaned_guard(self) -> bool {
        let command = fs::read(format!("/proc/{}/cmdline", self.pid)).unwrap_or_default();
        let is_guard =
            command.split(|&byte| byte == 0).nth(1) == Some(MOTOR_GUARD_COMMAND.as_bytes());
        let (Some(own), Some(parent)) = (program(self.pid), parent(self.pid)) else {
            return false;
        };
        is_guard && program(parent) != Some(own)
    }

    /// Ends it, stopped or not, if it still is an orphaned guard; returns whether it was signalled.
    pub(super) fn kill_orphaned_guard(self) -> bool {
        let pid = i32::try_from(self.pid).ok().and_then(Pid::from_raw);
        // Open before the check: the number cannot be another process's then.
        let process = pid.and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
        process.is_some_and(|process| {
            self.is_orphaned_guard() && pidfd_send_signal(&process, Signal::KILL).is_ok()
        })
    }
}

/// In the text of `/proc/locks` (proc(5)), who holds the `flock` of a file.
fn holder_in(locks: &str, device: u64, inode: u64) -> Option<u32> {
    let (major, minor) = (rustix::fs::major(device), rustix::fs::minor(device));
    let file = format!("{major:02x}:{minor:02x}:{inode}");
    locks.lines().find_map(|line| {
        let mut fields = line.split_ascii_whitespace().skip(1);
        // Who waits for a lock has an arrow in its place.
        let is_held = fields.next() == Some("FLOCK");
        let pid = fields.nth(2)?;
        (is_held && fields.next() == Some(file.as_str()))
            .then(|| pid.parse().ok())
            .flatten()
    })
}

/// The file that a process runs, also where it has been replaced since.
fn program(pid: u32) -> Option<(u64, u64)> {
    let file = fs::metadata(format!("/proc/{pid}/exe")).ok()?;
    Some((file.dev(), file.ino()))
}

fn parent(pid: u32) -> Option<u32> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses before it may hold anything.
    let (_, fields) = stat.rsplit_once(')')?;
    fields.split_ascii_whitespace().nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuators::roboteq::emulator::on_terminal::EmulatorOnTerminal;

    #[test]
    fn a_lock_is_found_by_device_and_inode() {
        let locks = "1: POSIX  ADVISORY  WRITE 5 00:1c:5 0 EOF\n\
                     2: FLOCK  ADVISORY  WRITE 77 00:1c:5 0 EOF\n\
                     2: -> FLOCK  ADVISORY  WRITE 78 00:1c:6 0 EOF\n";
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1c), 5), Some(77));
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1c), 6), None);
        assert_eq!(holder_in(locks, rustix::fs::makedev(0, 0x1d), 5), None);
    }

    #[test]
    fn a_holder_that_is_no_guard_is_not_killed() {
        let controller = EmulatorOnTerminal::start(|_| {});
        assert_eq!(LockHolder::of(controller.path()), None);
        let _port = Port::open(controller.path(), Sharing::Exclusive).unwrap();
        let holder = LockHolder::of(controller.path()).unwrap();
        assert_eq!(holder.pid, std::process::id());
        assert!(!holder.kill_orphaned_guard());
    }
}
