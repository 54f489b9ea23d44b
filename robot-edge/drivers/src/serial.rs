//! A serial port on tokio.

#[cfg(target_os = "linux")]
pub(crate) use linux::SerialPort;
#[cfg(target_os = "linux")]
pub use linux::open_serial;
#[cfg(not(target_os = "linux"))]
pub(crate) use other::SerialPort;

#[cfg(target_os = "linux")]
mod linux {
    use std::io;
    use std::os::fd::OwnedFd;
    use std::path::Path;

    use rustix::fs::{FlockOperation, Mode, OFlags};
    use rustix::io::Errno;
    use rustix::termios::{self, ControlModes, InputModes, OptionalActions, QueueSelector};
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::unix::pipe::{Receiver, Sender};

    /// An open port. To tokio it is a pair of pipes: it has no type for terminals.
    #[derive(Debug)]
    pub(crate) struct SerialPort {
        input: Receiver,
        output: Sender,
    }

    /// Opens a port with 8 data bits, no parity, 1 stop bit, no flow control, for reads and writes that do not wait.
    /// It waits for no carrier. An exclusive port is locked (`flock`): two programs would take bytes from each other.
    /// Bytes that came before are dropped.
    ///
    /// # Errors
    /// Those of the system; another program has locked the port.
    pub fn open_serial(path: &Path, baud: u32, is_exclusive: bool) -> io::Result<OwnedFd> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let port = rustix::fs::open(path, flags, Mode::empty())?;
        if is_exclusive {
            let lock = rustix::fs::flock(&port, FlockOperation::NonBlockingLockExclusive);
            lock.map_err(|errno| match errno {
                Errno::AGAIN => io::Error::other("another program uses this port"),
                errno => errno.into(),
            })?;
        }
        let mut settings = termios::tcgetattr(&port)?;
        settings.make_raw();
        let unwanted = ControlModes::CSTOPB | ControlModes::CRTSCTS | ControlModes::HUPCL;
        settings.control_modes &= !unwanted;
        settings.control_modes |= ControlModes::CREAD | ControlModes::CLOCAL;
        settings.input_modes &= !(InputModes::IXON | InputModes::IXOFF | InputModes::IXANY);
        settings.set_speed(baud)?;
        termios::tcsetattr(&port, OptionalActions::Now, &settings)?;
        termios::tcflush(&port, QueueSelector::IOFlush)?;
        Ok(port)
    }

    impl SerialPort {
        /// Locked, as [`open_serial`] does.
        pub(crate) fn open(path: &Path, baud: u32) -> io::Result<Self> {
            let port = open_serial(path, baud, true)?;
            Ok(Self {
                output: Sender::from_owned_fd_unchecked(port.try_clone()?)?,
                input: Receiver::from_owned_fd_unchecked(port)?,
            })
        }

        pub(crate) async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.input.read(buffer).await
        }

        pub(crate) async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
            self.output.write_all(bytes).await
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod other {
    use std::io;
    use std::path::Path;

    /// There is none.
    #[derive(Debug)]
    pub(crate) enum SerialPort {}

    impl SerialPort {
        pub(crate) fn open(_path: &Path, _baud: u32) -> io::Result<Self> {
            Err(io::ErrorKind::Unsupported.into())
        }

        pub(crate) async fn read(&mut self, _buffer: &mut [u8]) -> io::Result<usize> {
            match *self {}
        }

        pub(crate) async fn write(&mut self, _bytes: &[u8]) -> io::Result<()> {
            match *self {}
        }
    }
}
