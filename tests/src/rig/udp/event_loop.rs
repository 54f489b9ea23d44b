//! The relay's one thread: it owns the sockets, and moves datagrams when `poll` or the line says so.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};

use robot_edge::clock;
use rustix::event::{PollFd, PollFlags};

use super::channel::{Channel, Datagram};
use super::{CAPTURED, Conditions, Statistics, lock};
use crate::rig::command_thread::{Inbox, Received, wait};
use crate::rig::relay::Direction;
use crate::rig::rng::SeededRng;

/// Flows at a time; the one that was used longest ago goes.
const MAX_FLOWS: usize = 64;

/// Datagrams read from one socket before others have their turn.
const IN_A_ROW: usize = 64;

/// Longest datagram.
const LARGEST_BYTES: usize = 1 << 16;

/// What a caller wants.
#[derive(Debug)]
pub(super) enum LinkCommand {
    Set(Direction, Conditions),
    Inject(Direction, Vec<Vec<u8>>),
    /// Nothing: it is carried out between two rounds, when the counters agree with the sockets.
    Settle,
}

/// What `poll` watches.
#[derive(Clone, Copy, Debug)]
enum Watch {
    Inbox,
    Clients,
    Target(u64),
}

/// One sender, as the target sees them.
#[derive(Debug)]
struct Flow {
    id: u64,
    client: SocketAddr,
    to_target: UdpSocket,
}

pub(super) struct EventLoop {
    socket: UdpSocket,
    target: SocketAddr,
    /// The one that was used last is the last.
    flows: Vec<Flow>,
    next_flow: u64,
    channels: [Channel; 2],
    statistics: Arc<Mutex<Statistics>>,
    buffer: Vec<u8>,
}

impl EventLoop {
    pub(super) fn new(
        socket: UdpSocket,
        target: SocketAddr,
        seed: u64,
        statistics: Arc<Mutex<Statistics>>,
    ) -> Self {
        Self {
            socket,
            target,
            flows: Vec::new(),
            next_flow: 0,
            channels: Direction::ALL
                .map(|direction| Channel::new(SeededRng::new(seed, direction.index()))),
            statistics,
            buffer: vec![0; LARGEST_BYTES],
        }
    }

    /// Relays until the handle is dropped.
    pub(super) fn run(mut self, inbox: &Inbox<LinkCommand>) {
        loop {
            match inbox.receive() {
                Received::Command(command, done) => {
                    // What came before the order fares as it would have without it.
                    self.take_in_everything();
                    self.deliver();
                    done.report(self.handle_command(command));
                    continue;
                }
                Received::Nothing => {}
                Received::Disconnected => return,
            }
            self.deliver();
            let Ok(ready) = self.ready(inbox) else {
                return;
            };
            for watch in ready {
                match watch {
                    Watch::Inbox => {}
                    Watch::Clients => self.take_from_clients(),
                    Watch::Target(flow) => self.take_from_target(flow),
                }
            }
        }
    }

    fn handle_command(&mut self, command: LinkCommand) -> io::Result<()> {
        let now = clock::now();
        match command {
            LinkCommand::Set(direction, conditions) => {
                let traffic = &mut lock(&self.statistics).traffic[direction.index()];
                self.channels[direction.index()].set(now, conditions, traffic);
            }
            LinkCommand::Inject(direction, datagrams) => {
                let flow = self.flows.last().map(|flow| flow.id);
                let flow = flow.ok_or_else(|| io::Error::other("nobody has sent anything yet"))?;
                let traffic = &mut lock(&self.statistics).traffic[direction.index()];
                for bytes in datagrams {
                    traffic.injected.add(bytes.len());
                    let datagram = Datagram { flow, bytes };
                    self.channels[direction.index()].take_in(now, datagram, traffic);
                }
            }
            LinkCommand::Settle => {}
        }
        Ok(())
    }

    fn ready(&self, inbox: &Inbox<LinkCommand>) -> io::Result<Vec<Watch>> {
        let mut watched = vec![
            (
                Watch::Inbox,
                PollFd::from_borrowed_fd(inbox.readable(), PollFlags::IN),
            ),
            (Watch::Clients, PollFd::new(&self.socket, PollFlags::IN)),
        ];
        for flow in &self.flows {
            let descriptor = PollFd::new(&flow.to_target, PollFlags::IN);
            watched.push((Watch::Target(flow.id), descriptor));
        }
        let next = self.channels.iter().filter_map(Channel::next_event).min();
        wait(watched, next.map(|moment| moment.since(clock::now())))
    }

    fn take_in_everything(&mut self) {
        self.take_from_clients();
        let flows: Vec<_> = self.flows.iter().map(|flow| flow.id).collect();
        for flow in flows {
            self.take_from_target(flow);
        }
    }

    fn take_from_clients(&mut self) {
        for _ in 0..IN_A_ROW {
            let (bytes, client) = match self.socket.recv_from(&mut self.buffer) {
                Ok((count, client)) => (self.buffer[..count].to_vec(), client),
                Err(err) if err.kind() == ErrorKind::WouldBlock => return,
                // One client is gone, and said so; others may have sent something.
                Err(_gone) => continue,
            };
            if let Ok(flow) = self.flow_of(client) {
                self.take_in(Direction::ToTarget, Datagram { flow, bytes });
            }
        }
    }

    fn take_from_target(&mut self, flow: u64) {
        for _ in 0..IN_A_ROW {
            let Some(from) = self.flows.iter().find(|one| one.id == flow) else {
                return;
            };
            let bytes = match from.to_target.recv(&mut self.buffer) {
                Ok(count) => self.buffer[..count].to_vec(),
                Err(err) if err.kind() == ErrorKind::WouldBlock => return,
                // Nobody listens at the target: what was sent is lost, as on a link.
                Err(_refused) => continue,
            };
            self.take_in(Direction::FromTarget, Datagram { flow, bytes });
        }
    }

    fn take_in(&mut self, direction: Direction, datagram: Datagram) {
        let mut statistics = lock(&self.statistics);
        let captured = &mut statistics.captured[direction.index()];
        if captured.len() >= CAPTURED {
            captured.pop_front();
        }
        captured.push_back(datagram.bytes.clone());
        let traffic = &mut statistics.traffic[direction.index()];
        traffic.sent.add(datagram.bytes.len());
        self.channels[direction.index()].take_in(clock::now(), datagram, traffic);
    }

    /// The flow of a client, which is then the one that was used last.
    fn flow_of(&mut self, client: SocketAddr) -> io::Result<u64> {
        if let Some(at) = self.flows.iter().position(|flow| flow.client == client) {
            let flow = self.flows.remove(at);
            let id = flow.id;
            self.flows.push(flow);
            return Ok(id);
        }
        let to_target = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
        to_target.set_nonblocking(true)?;
        to_target.connect(self.target)?;
        if self.flows.len() >= MAX_FLOWS {
            self.flows.remove(0);
        }
        self.next_flow += 1;
        self.flows.push(Flow {
            id: self.next_flow,
            client,
            to_target,
        });
        Ok(self.next_flow)
    }

    /// Hands on what has come to the other end.
    fn deliver(&mut self) {
        let now = clock::now();
        let mut statistics = lock(&self.statistics);
        for direction in Direction::ALL {
            let traffic = &mut statistics.traffic[direction.index()];
            while let Some(datagram) = self.channels[direction.index()].take(now, traffic) {
                let Datagram { flow, bytes } = datagram;
                let flow = self.flows.iter().find(|one| one.id == flow);
                let outcome = flow.map(|flow| match direction {
                    Direction::ToTarget => flow.to_target.send(&bytes),
                    Direction::FromTarget => self.socket.send_to(&bytes, flow.client),
                });
                match outcome {
                    Some(Ok(_)) => traffic.delivered.add(bytes.len()),
                    Some(Err(_)) | None => traffic.refused.add(bytes.len()),
                }
            }
        }
    }
}
