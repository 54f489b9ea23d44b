//! The line to the controller: a serial port that never blocks.

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, Mode, OFlags};
use rustix::termios::{self, ControlModes, InputModes, OptionalActions, QueueSelector};

use super::driver::Transmission;
use super::wire;
use crate::actuators::report::ControllerFault;

/// Why a port could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The port.
        path: PathBuf,
        /// What it said.
        source: io::Error,
    },
    /// The adapter cannot do 7 data bits with even parity, and would send something else.
    #[error("{path}: this port cannot do 9600 baud, 7 data bits, even parity, 1 stop bit", path = path.display())]
    Settings {
        /// The port.
        path: PathBuf,
    },
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

    /// Whether another process holds the port's lock.
    pub fn is_locked(&self) -> bool {
        match self {
            Self::Io { source, .. } => source.kind() == io::ErrorKind::WouldBlock,
            Self::Settings { .. } => false,
        }
    }
}

/// Who else may have the port open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sharing {
    /// Nobody who asks as well (`flock`): two owners would command the motors in turn.
    Exclusive,
    /// Anybody: to stop motors whose owner is lost, and may still hold the port.
    Shared,
}

/// An open serial port.
#[derive(Debug)]
pub struct Port(File);

impl Port {
    /// Opens `path` with the AX3500's settings (manual, p. 138): 9600 baud, 7 data bits, even parity, 1 stop bit, no flow
    /// control. It waits neither for a carrier nor for anybody else.
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

    /// Tells the motors at `path` zero once, whoever holds the port, without waiting for an answer.
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
    /// driver then begins anew.
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
    ///
    /// # Errors
    /// The port is gone: an adapter was unplugged.
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
