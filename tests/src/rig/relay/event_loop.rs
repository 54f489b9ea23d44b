//! The relay's one thread: it owns the sockets, and moves bytes when `poll` or the line says so.

use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use measurement::time::Monotonic;
use robot_edge::clock;
use rustix::event::{PollFd, PollFlags};

use super::connection::{Connection, Taken};
use super::{Counters, Direction, Mode};
use crate::rig::Line;
use crate::rig::bottleneck::Bottleneck;
use crate::rig::command_thread::{Inbox, Received, wait};
use crate::rig::ports::Reservation;

/// Connections open at a time; further ones wait to be accepted.
const MAX_CONNECTIONS: usize = 64;

/// What the kernel may hold for the relay to read, so that back-pressure soon reaches whoever sends.
const RECEIVE_BUFFER_BYTES: usize = 64 << 10;

/// Read at a time where there is a rate: the payload of a packet, so that connections take turns as finely as
/// on a real line.
const SEGMENT_BYTES: usize = 1460;

/// Read at a time where there is no rate.
const LARGEST_READ_BYTES: usize = 64 << 10;

/// What a caller wants.
#[derive(Clone, Copy, Debug)]
pub(super) enum Command {
    Mode(Mode),
    Line(Direction, Line),
    Delay(Duration),
    Rate(Option<u64>),
    /// Nothing: it is carried out between two rounds, when the counters agree with the sockets.
    Settle,
}

/// A port, and where its connections go.
#[derive(Debug)]
pub(super) struct Port {
    reserved: Reservation,
    target: SocketAddr,
    listener: Option<TcpListener>,
}

impl Port {
    pub(super) fn new(reserved: Reservation, target: SocketAddr) -> Self {
        Self {
            reserved,
            target,
            listener: None,
        }
    }

    pub(super) fn number(&self) -> u16 {
        self.reserved.port()
    }
}

type ConnectionId = u64;

/// What travels on a line.
#[derive(Debug)]
enum Content {
    Bytes(Vec<u8>),
    End,
    Reset,
}

/// What `poll` watches.
#[derive(Clone, Copy, Debug)]
enum Watch {
    Inbox,
    Port(usize),
    Answer(ConnectionId),
    Source(ConnectionId, Direction),
    Sink(ConnectionId, Direction),
}

#[derive(Debug)]
pub(super) struct EventLoop {
    ports: Vec<Port>,
    mode: Mode,
    connections: BTreeMap<ConnectionId, Connection>,
    next_id: ConnectionId,
    /// Who reads first, so that no connection always finds the queue filled by another.
    first_to_read: ConnectionId,
    lines: [Bottleneck<(ConnectionId, Content)>; 2],
    buffer: Vec<u8>,
    counters: Arc<Counters>,
}

impl EventLoop {
    pub(super) fn new(ports: Vec<Port>, counters: Arc<Counters>) -> Self {
        Self {
            ports,
            mode: Mode::Pass,
            connections: BTreeMap::new(),
            next_id: 0,
            first_to_read: 0,
            lines: [Line::default(); 2].map(Bottleneck::new),
            buffer: vec![0; LARGEST_READ_BYTES],
            counters,
        }
    }

    /// Listens on every port that is not listened on.
    pub(super) fn listen(&mut self) -> io::Result<()> {
        for port in &mut self.ports {
            if port.listener.is_none() {
                port.listener = Some(port.reserved.listen(RECEIVE_BUFFER_BYTES)?);
            }
        }
        Ok(())
    }

    /// Relays until the handle is dropped.
    pub(super) fn run(mut self, inbox: &Inbox<Command>) {
        loop {
            match inbox.receive() {
                Received::Command(command, done) => {
                    done.report(self.handle_command(command));
                    continue;
                }
                Received::Nothing => {}
                Received::Disconnected => break,
            }
            let now = clock::now();
            if self.mode == Mode::Pass {
                self.deliver(now);
            }
            let Ok(ready) = self.ready(inbox, now) else {
                break;
            };
            for watch in ready {
                self.handle_ready(watch);
            }
        }
        self.reset_all();
    }

    fn handle_command(&mut self, command: Command) -> io::Result<()> {
        let now = clock::now();
        for line in &mut self.lines {
            match self.mode {
                Mode::Pass => line.serve(now),
                Mode::Stall | Mode::Cut => line.skip_to(now),
            }
        }
        match command {
            Command::Mode(mode) => return self.enter(mode),
            Command::Line(direction, line) => self.lines[direction.index()].set_line(now, line),
            Command::Delay(delay) => self.change_lines(now, |line| Line { delay, ..line }),
            Command::Rate(rate_bytes_per_s) => self.change_lines(now, |line| Line {
                rate_bytes_per_s,
                ..line
            }),
            Command::Settle => {}
        }
        Ok(())
    }

    fn change_lines(&mut self, now: Monotonic, change: impl Fn(Line) -> Line) {
        for line in &mut self.lines {
            line.set_line(now, change(line.line()));
        }
    }

    fn enter(&mut self, mode: Mode) -> io::Result<()> {
        match mode {
            Mode::Pass | Mode::Stall => self.listen()?,
            Mode::Cut => {
                for port in &mut self.ports {
                    port.listener = None;
                }
                self.reset_all();
            }
        }
        self.mode = mode;
        Ok(())
    }

    fn reset_all(&mut self) {
        for (_id, connection) in std::mem::take(&mut self.connections) {
            connection.reset();
        }
        for line in &mut self.lines {
            line.drain();
        }
        self.count_connections();
    }

    fn count_connections(&self) {
        let open = self.connections.len() as u64;
        self.counters
            .open_connections
            .store(open, Ordering::Release);
    }

    /// Hands on what has come through the lines.
    fn deliver(&mut self, now: Monotonic) {
        for direction in Direction::ALL {
            while let Some((id, content)) = self.lines[direction.index()].take(now) {
                // What a connection that has been reset left on the line goes nowhere.
                let Some(connection) = self.connections.get_mut(&id) else {
                    continue;
                };
                match content {
                    Content::Bytes(bytes) => connection.arrive(direction, bytes),
                    Content::End => connection.end_arrives(direction),
                    Content::Reset => {
                        self.reset(id);
                        continue;
                    }
                }
                self.write(id, direction);
            }
        }
    }

    /// Waits for something to do.
    fn ready(&self, inbox: &Inbox<Command>, now: Monotonic) -> io::Result<Vec<Watch>> {
        let mut watched = vec![(
            Watch::Inbox,
            PollFd::from_borrowed_fd(inbox.readable(), PollFlags::IN),
        )];
        let mut next_event = None;
        if self.mode == Mode::Pass {
            self.watch_sockets(&mut watched);
            next_event = self.lines.iter().filter_map(Bottleneck::next_event).min();
        }
        wait(watched, next_event.map(|moment| moment.since(now)))
    }

    fn watch_sockets<'a>(&'a self, watched: &mut Vec<(Watch, PollFd<'a>)>) {
        if self.connections.len() < MAX_CONNECTIONS {
            for (index, port) in self.ports.iter().enumerate() {
                if let Some(listener) = &port.listener {
                    watched.push((Watch::Port(index), PollFd::new(listener, PollFlags::IN)));
                }
            }
        }
        let from = self.first_to_read;
        let in_turn = self
            .connections
            .range(from..)
            .chain(self.connections.range(..from));
        for (&id, connection) in in_turn {
            if !connection.target_answered() {
                let target = connection.sink(Direction::ToTarget);
                watched.push((Watch::Answer(id), PollFd::new(target, PollFlags::OUT)));
                continue;
            }
            for direction in Direction::ALL {
                if self.readable_bytes(connection, direction) > 0 {
                    let source = connection.source(direction);
                    watched.push((
                        Watch::Source(id, direction),
                        PollFd::new(source, PollFlags::IN),
                    ));
                }
                if connection.wants_to_write(direction) {
                    let sink = connection.sink(direction);
                    watched.push((
                        Watch::Sink(id, direction),
                        PollFd::new(sink, PollFlags::OUT),
                    ));
                }
            }
        }
    }

    /// Bytes to read at once: 0 while the connection's window or the line's queue is full.
    fn readable_bytes(&self, connection: &Connection, direction: Direction) -> usize {
        let line = &self.lines[direction.index()];
        let at_once = match line.line().rate_bytes_per_s {
            Some(_) => SEGMENT_BYTES,
            None => LARGEST_READ_BYTES,
        };
        let window = connection.window_bytes(direction).unwrap_or(0);
        let bytes = at_once.min(window);
        if line.room_bytes() < bytes { 0 } else { bytes }
    }

    fn handle_ready(&mut self, watch: Watch) {
        match watch {
            Watch::Inbox => {}
            Watch::Port(index) => self.accept(index),
            Watch::Answer(id) => {
                let answer = self.connections.get_mut(&id);
                if answer.is_some_and(|connection| connection.target_writable().is_err()) {
                    self.reset(id);
                }
            }
            Watch::Source(id, direction) => self.read(id, direction),
            Watch::Sink(id, direction) => self.write(id, direction),
        }
    }

    fn accept(&mut self, port: usize) {
        let Some((listener, target)) = self
            .ports
            .get(port)
            .and_then(|port| Some((port.listener.as_ref()?, port.target)))
        else {
            return;
        };
        // A connection that was given up before it was accepted is nobody's loss.
        let Ok((client, _)) = listener.accept() else {
            return;
        };
        self.counters
            .accepted_connections
            .fetch_add(1, Ordering::AcqRel);
        if let Ok(connection) = Connection::begin(client, target, RECEIVE_BUFFER_BYTES) {
            self.connections.insert(self.next_id, connection);
            self.next_id += 1;
        }
        self.count_connections();
    }

    fn read(&mut self, id: ConnectionId, direction: Direction) {
        let Some(connection) = self.connections.get(&id) else {
            return;
        };
        let bytes = self.readable_bytes(connection, direction);
        let Some(connection) = self.connections.get_mut(&id).filter(|_| bytes > 0) else {
            return;
        };
        self.first_to_read = id + 1;
        let buffer = self.buffer.get_mut(..bytes).unwrap_or_default();
        let content = match connection.read(direction, buffer) {
            Taken::Bytes(bytes) => Content::Bytes(bytes),
            Taken::Nothing => return,
            Taken::End => Content::End,
            Taken::Broken => Content::Reset,
        };
        let size = match &content {
            Content::Bytes(bytes) => bytes.len(),
            Content::End | Content::Reset => 0,
        };
        let now = clock::now();
        let line = &mut self.lines[direction.index()];
        let taken = line.offer(now, size, Duration::ZERO, (id, content));
        debug_assert!(taken, "read no more than there is room for");
    }

    fn write(&mut self, id: ConnectionId, direction: Direction) {
        let Some(connection) = self.connections.get_mut(&id) else {
            return;
        };
        match connection.write(direction) {
            Ok(bytes) => {
                self.counters.forwarded_bytes[direction.index()]
                    .fetch_add(bytes as u64, Ordering::AcqRel);
                if connection.is_finished() {
                    self.connections.remove(&id);
                    self.count_connections();
                }
            }
            Err(_gone) => self.reset(id),
        }
    }

    fn reset(&mut self, id: ConnectionId) {
        if let Some(connection) = self.connections.remove(&id) {
            connection.reset();
        }
        self.count_connections();
    }
}
