//! A UDP link over loopback that can be late, lossy, disordered or gone, and that can be attacked; no privileges.
//!
//! Whoever sends to it first has a flow of their own to the target, as behind an address translator. What it does to
//! datagrams it does to those of QUIC as well, which neither end can tell from a real link.

mod channel;
mod event_loop;

use std::collections::VecDeque;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::command_thread::CommandThread;
use super::relay::Direction;
use super::{Count, Line};
use event_loop::{EventLoop, LinkCommand};

/// Datagrams of each direction that are kept for [`UdpRelay::captured`]; older ones go.
pub const CAPTURED: usize = 4096;

/// What happens to datagrams in one direction. The default lets them pass at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Rate, queue in front of it and delay. A datagram that finds the queue full is dropped. A rate of 0 holds all of
    /// them until there is another one.
    pub line: Line,
    /// The greatest delay beyond the line's; each datagram draws its own, evenly from 0. They keep their order.
    pub jitter: Duration,
    /// How likely a datagram is to get lost.
    pub loss: f64,
    /// How likely a datagram is to arrive twice.
    pub duplication: f64,
    /// How likely a datagram is to be held back at the end of the line, where others overtake it, and for how long.
    pub reordering: (f64, Duration),
    /// How likely a datagram is to arrive with one bit changed.
    pub tampering: f64,
    /// Everything is lost, what is under way too, and nobody is told.
    pub blackhole: bool,
}

/// What became of the datagrams of one direction so far, UDP payload only.
///
/// All that were sent, doubled or injected are delivered, lost, overflowed, swallowed or refused, or under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Came in.
    pub sent: Count,
    /// Copies that were made.
    pub duplicated: Count,
    /// Made by [`UdpRelay::inject`].
    pub injected: Count,
    /// Went out.
    pub delivered: Count,
    /// Drew a loss.
    pub lost: Count,
    /// Found the queue full.
    pub overflowed: Count,
    /// Went into the blackhole.
    pub blackholed: Count,
    /// Had nobody to go to.
    pub refused: Count,
    /// Were held back; they are in another count too.
    pub reordered: Count,
    /// Were changed; they are in another count too.
    pub tampered: Count,
}

/// A port of 127.0.0.1 whose datagrams go to another address. Dropping it cuts the link for good.
#[derive(Debug)]
pub struct UdpRelay {
    port: u16,
    statistics: Arc<Mutex<Statistics>>,
    command_thread: CommandThread<LinkCommand>,
}

/// What both sides of the handle see, by [`Direction::index`].
#[derive(Debug, Default)]
struct Statistics {
    traffic: [Traffic; 2],
    captured: [VecDeque<Vec<u8>>; 2],
}

impl UdpRelay {
    /// Relays a port of the kernel's choice to `target`.
    pub fn to(target: SocketAddr) -> io::Result<Self> {
        Self::seeded(0, target, 0)
    }

    /// Relays `port`, 0 for one of the kernel's choice, to `target`, with the chance of `seed`.
    pub fn seeded(port: u16, target: SocketAddr, seed: u64) -> io::Result<Self> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port))?;
        socket.set_nonblocking(true)?;
        let port = socket.local_addr()?.port();
        let statistics = Arc::default();
        let events = EventLoop::new(socket, target, seed, Arc::clone(&statistics));
        let command_thread = CommandThread::start(&format!("udp-relay-{port}"), move |inbox| {
            events.run(&inbox);
        })?;
        Ok(Self {
            port,
            statistics,
            command_thread,
        })
    }

    /// The port to send to.
    pub const fn port(&self) -> u16 {
        self.port
    }

    /// The address to send to.
    pub fn address(&self) -> SocketAddr {
        SocketAddr::from((Ipv4Addr::LOCALHOST, self.port))
    }

    /// Changes one direction. What is under way arrives when it would have.
    ///
    /// Fails where something is not a probability, or the relay has ended.
    pub fn set(&self, direction: Direction, conditions: Conditions) -> io::Result<()> {
        for (name, value) in [
            ("loss", conditions.loss),
            ("duplication", conditions.duplication),
            ("reordering", conditions.reordering.0),
            ("tampering", conditions.tampering),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(io::Error::new(
                    io::ErrorKind::InvalidInput,
                    format!("{name} {value} is not between 0 and 1"),
                ));
            }
        }
        self.command_thread
            .call(LinkCommand::Set(direction, conditions))
    }

    /// Changes both directions; see [`UdpRelay::set`].
    pub fn set_both(&self, conditions: Conditions) -> io::Result<()> {
        Direction::ALL
            .into_iter()
            .try_for_each(|direction| self.set(direction, conditions))
    }

    /// Sends datagrams as if the other side of `direction` had sent them, on the flow that was used last.
    ///
    /// They take the line as it is. Fails where nobody has sent anything yet, or the relay has ended.
    pub fn inject(&self, direction: Direction, datagrams: Vec<Vec<u8>>) -> io::Result<()> {
        self.command_thread
            .call(LinkCommand::Inject(direction, datagrams))
    }

    /// The last datagrams that came in, the oldest first, as they were sent; at most [`CAPTURED`].
    pub fn captured(&self, direction: Direction) -> Vec<Vec<u8>> {
        self.settle();
        let captured = &lock(&self.statistics).captured[direction.index()];
        captured.iter().cloned().collect()
    }

    /// What became of the datagrams of `direction` so far.
    pub fn traffic(&self, direction: Direction) -> Traffic {
        self.settle();
        lock(&self.statistics).traffic[direction.index()]
    }

    /// Waits until what has come in is counted too.
    fn settle(&self) {
        // Of a relay that has ended the counters stay as they are.
        self.command_thread.call(LinkCommand::Settle).ok();
    }
}

fn lock(statistics: &Mutex<Statistics>) -> MutexGuard<'_, Statistics> {
    statistics.lock().unwrap_or_else(PoisonError::into_inner)
}
