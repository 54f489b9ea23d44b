//! The two sockets of one relayed connection, and what each direction holds between them.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, ipproto, sockopt};

use super::Direction;

/// Bytes that one direction of a connection holds at most: queued, under way, and not taken by the receiver.
pub(super) const WINDOW_BYTES: usize = 1 << 20;

/// One connection from whoever connected to the relay to its target.
#[derive(Debug)]
pub(super) struct Connection {
    client: TcpStream,
    target: TcpStream,
    target_answered: bool,
    halves: [Half; 2],
}

#[derive(Debug, Default)]
struct Half {
    /// Bytes read and not yet written, wherever they are.
    held_bytes: usize,
    /// What has come through the line and waits for the receiver.
    arrived: VecDeque<Vec<u8>>,
    /// Of the first of `arrived`, bytes that are written.
    written_bytes: usize,
    source_ended: bool,
    /// The end of the stream has come through the line.
    end_arrived: bool,
    finished: bool,
}

/// What reading brought.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Taken {
    /// Bytes, at least one.
    Bytes(Vec<u8>),
    /// Nothing now.
    Nothing,
    /// The source ended its stream.
    End,
    /// The connection broke.
    Broken,
}

impl Connection {
    /// Begins to connect `client` to `target`, without waiting for it.
    pub(super) fn begin(
        client: TcpStream,
        target: SocketAddr,
        receive_buffer_bytes: usize,
    ) -> io::Result<Self> {
        client.set_nonblocking(true)?;
        client.set_nodelay(true)?;
        let family = match target {
            SocketAddr::V4(_) => AddressFamily::INET,
            SocketAddr::V6(_) => AddressFamily::INET6,
        };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket =
            rustix::net::socket_with(family, SocketType::STREAM, flags, Some(ipproto::TCP))?;
        sockopt::set_socket_recv_buffer_size(&socket, receive_buffer_bytes)?;
        match rustix::net::connect(&socket, &target) {
            Ok(()) | Err(Errno::INPROGRESS) => {}
            Err(err) => {
                reset(&client);
                return Err(err.into());
            }
        }
        let target = TcpStream::from(socket);
        target.set_nodelay(true)?;
        Ok(Self {
            client,
            target,
            target_answered: false,
            halves: Default::default(),
        })
    }

    /// Whether the target has accepted; until then nothing is read.
    pub(super) fn target_answered(&self) -> bool {
        self.target_answered
    }

    /// To be called when the target becomes writable first. Fails where it refused.
    pub(super) fn target_writable(&mut self) -> io::Result<()> {
        if let Some(refusal) = self.target.take_error()? {
            return Err(refusal);
        }
        self.target_answered = true;
        Ok(())
    }

    pub(super) fn source(&self, direction: Direction) -> &TcpStream {
        match direction {
            Direction::ToTarget => &self.client,
            Direction::FromTarget => &self.target,
        }
    }

    pub(super) fn sink(&self, direction: Direction) -> &TcpStream {
        match direction {
            Direction::ToTarget => &self.target,
            Direction::FromTarget => &self.client,
        }
    }

    /// Bytes that may be read in `direction`; `None` once its source has ended.
    pub(super) fn window_bytes(&self, direction: Direction) -> Option<usize> {
        let half = &self.halves[direction.index()];
        (!half.source_ended).then(|| WINDOW_BYTES.saturating_sub(half.held_bytes))
    }

    /// Whether something waits for the receiver.
    pub(super) fn wants_to_write(&self, direction: Direction) -> bool {
        !self.halves[direction.index()].arrived.is_empty()
    }

    /// Whether both streams have ended and everything is delivered.
    pub(super) fn is_finished(&self) -> bool {
        self.halves.iter().all(|half| half.finished)
    }

    /// Reads up to `buffer.len()` bytes.
    pub(super) fn read(&mut self, direction: Direction, buffer: &mut [u8]) -> Taken {
        let count = match self.source(direction).read(buffer) {
            Ok(count) => count,
            Err(err) if is_for_later(&err) => return Taken::Nothing,
            Err(_broken) => {
                self.halves[direction.index()].source_ended = true;
                return Taken::Broken;
            }
        };
        let half = &mut self.halves[direction.index()];
        if count == 0 {
            half.source_ended = true;
            return Taken::End;
        }
        half.held_bytes += count;
        Taken::Bytes(buffer.get(..count).unwrap_or_default().to_vec())
    }

    /// Bytes have come through the line.
    pub(super) fn arrive(&mut self, direction: Direction, bytes: Vec<u8>) {
        self.halves[direction.index()].arrived.push_back(bytes);
    }

    /// The end of the stream has come through the line.
    pub(super) fn end_arrives(&mut self, direction: Direction) {
        self.halves[direction.index()].end_arrived = true;
    }

    /// Hands on what has arrived, as far as the receiver takes it; returns how many bytes that were.
    pub(super) fn write(&mut self, direction: Direction) -> io::Result<usize> {
        let mut total = 0;
        let mut sink = match direction {
            Direction::ToTarget => &self.target,
            Direction::FromTarget => &self.client,
        };
        let half = &mut self.halves[direction.index()];
        while let Some(first) = half.arrived.front() {
            let rest = first.get(half.written_bytes..).unwrap_or_default();
            let count = match sink.write(rest) {
                Ok(count) => count,
                Err(err) if is_for_later(&err) => return Ok(total),
                Err(err) => return Err(err),
            };
            total += count;
            half.held_bytes -= count;
            half.written_bytes += count;
            if count == rest.len() {
                half.arrived.pop_front();
                half.written_bytes = 0;
            }
        }
        if half.end_arrived && !half.finished {
            sink.shutdown(Shutdown::Write)?;
            half.finished = true;
        }
        Ok(total)
    }

    /// Ends both sides at once, as a router does that has forgotten the connection.
    pub(super) fn reset(self) {
        reset(&self.client);
        reset(&self.target);
    }
}

/// Makes the close of `socket` a reset; where that fails it is an ordinary close.
fn reset(socket: &TcpStream) {
    sockopt::set_socket_linger(socket, Some(Duration::ZERO)).ok();
}

fn is_for_later(err: &io::Error) -> bool {
    matches!(err.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}
