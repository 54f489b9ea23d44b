//! The pipe through which the motor guard forwards what it receives, unparsed, to the edge's reader: of encoders, or of an
//! autopilot.
//!
//! The guard never waits for it, and nothing comes back. The edge makes it once and keeps both ends; each guard inherits
//! the write end. Without the pipe the guard asks for no counts, and drives as ever.

use std::io;
use std::os::fd::OwnedFd;

use rustix::fs::{Mode, OFlags};
use rustix::pipe::PipeFlags;

/// In the guard's environment: the number of the inherited write end.
pub const VARIABLE: &str = "FORESHORE_FORWARD_PIPE";

/// Capacity for encoders: some 8 s of what a controller sends. What has waited longer is lost, not read. It is the least
/// that Linux has.
pub const LEAST_BYTES: usize = 4096;

/// Stands where bytes were lost, so that no number is made of the halves of two: no line has such a character, and no
/// `MAVLink` frame begins with one.
const GAP: &[u8] = b"\0\r";

/// A read end and a write end, with room for `capacity` bytes.
pub fn pipe(capacity: usize) -> io::Result<(OwnedFd, OwnedFd)> {
    let (read_end, write_end) = rustix::pipe::pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
    rustix::pipe::fcntl_setpipe_size(&write_end, capacity)?;
    Ok((read_end, write_end))
}

/// The end whose number is in a variable of the environment, if the edge has passed it on.
pub fn inherited(variable: &str, access: OFlags) -> Option<OwnedFd> {
    let number: u32 = std::env::var(variable).ok()?.parse().ok()?;
    // Opened anew, so that nobody else can make it wait.
    let flags = access | OFlags::NONBLOCK | OFlags::CLOEXEC;
    rustix::fs::open(format!("/proc/self/fd/{number}"), flags, Mode::empty()).ok()
}

/// The guard's end.
#[derive(Debug)]
pub struct ForwardPipe {
    write_end: OwnedFd,
    received: Vec<u8>,
    has_gap: bool,
    lost_bytes: u32,
}

impl ForwardPipe {
    fn new(write_end: OwnedFd) -> Self {
        Self {
            write_end,
            received: Vec::new(),
            has_gap: false,
            lost_bytes: 0,
        }
    }

    /// The one that the edge has passed on, if it has.
    pub fn inherited() -> Option<Self> {
        inherited(VARIABLE, OFlags::WRONLY).map(Self::new)
    }

    pub fn push(&mut self, bytes: &[u8]) {
        self.received.extend_from_slice(bytes);
    }

    /// Writes what was pushed, or loses it: where the pipe is full, and where nobody has its other end.
    pub fn flush(&mut self) {
        if self.received.is_empty() {
            return;
        }
        let gap = if self.has_gap { GAP } else { &[] };
        let bytes = [gap, &self.received].concat();
        // Up to `PIPE_BUF` bytes are written whole or not at all (pipe(7)). The standard library ignores SIGPIPE.
        self.has_gap = rustix::io::write(&self.write_end, &bytes) != Ok(bytes.len());
        if self.has_gap {
            let lost = u32::try_from(self.received.len()).unwrap_or(u32::MAX);
            self.lost_bytes = self.lost_bytes.saturating_add(lost);
        }
        self.received.clear();
    }

    pub const fn lost_bytes(&self) -> u32 {
        self.lost_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(read_end: &OwnedFd) -> Vec<u8> {
        let mut buffer = vec![0; 2 * LEAST_BYTES];
        let length = rustix::io::read(read_end, &mut buffer).unwrap();
        buffer[..length].to_vec()
    }

    #[test]
    fn a_full_pipe_loses_bytes_and_a_gap_stands_for_them() {
        let (read_end, write_end) = pipe(LEAST_BYTES).unwrap();
        let mut pipe = ForwardPipe::new(write_end);
        let mut send = |bytes: &[u8]| {
            pipe.push(bytes);
            pipe.flush();
            pipe.lost_bytes()
        };
        for _ in 0..LEAST_BYTES / 16 {
            assert_eq!(send(b"?Q0\r12345678\r+\r\r"), 0);
        }
        assert_eq!(send(b"?Q1\r12"), 6);
        assert_eq!(send(b"34\r"), 9);
        assert_eq!(read(&read_end).len(), LEAST_BYTES);
        assert_eq!(send(b"56\r"), 9);
        assert_eq!(send(b"?Q0\r"), 9);
        assert_eq!(read(&read_end), b"\0\r56\r?Q0\r");
        drop(read_end);
        assert_eq!(send(b"7\r"), 11);
        assert_eq!(send(b""), 11);
    }
}
