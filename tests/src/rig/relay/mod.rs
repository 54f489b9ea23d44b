//! A TCP link over loopback that can be slow, stalled or cut, without privileges.
//!
//! It relays bytes between two TCP connections, so what it makes is a bad link as TCP programs see one: late,
//! slow, stuck or gone, but never lossy or out of order. Connections themselves are made by the kernel, at once;
//! the line's delay is that of bytes and of the end of a connection. See [`super::tun`] for packets.

mod connection;
mod event_loop;

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use super::Line;
use super::command_thread::CommandThread;
use super::ports::Reservation;
use event_loop::{Command, EventLoop, Port};

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From whoever connected to the relay.
    ToTarget,
    /// To whoever connected to the relay.
    FromTarget,
}

impl Direction {
    /// Both.
    pub const ALL: [Self; 2] = [Self::ToTarget, Self::FromTarget];

    pub(in crate::rig) const fn index(self) -> usize {
        match self {
            Self::ToTarget => 0,
            Self::FromTarget => 1,
        }
    }
}

/// What becomes of connections and bytes, beyond the [`Line`]s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// They pass.
    Pass,
    /// Sockets stay open, and not a byte is taken or handed on. A connection that is made meanwhile waits.
    Stall,
    /// Every connection is reset, with what it held, and new ones are refused.
    Cut,
}

/// A link of one or two ports of 127.0.0.1, each to a port of its own at the other end.
///
/// All connections share the two [`Line`]s: they queue for one rate. Dropping it cuts the link for good.
#[derive(Debug)]
pub struct Relay {
    port: u16,
    counters: Arc<Counters>,
    command_thread: CommandThread<Command>,
}

#[derive(Debug, Default)]
struct Counters {
    forwarded_bytes: [AtomicU64; 2],
    open_connections: AtomicU64,
    accepted_connections: AtomicU64,
}

impl Relay {
    /// Relays a port of the kernel's choice to `target`.
    pub fn to(target: SocketAddr) -> io::Result<Self> {
        Self::start(vec![Port::new(Reservation::any()?, target)])
    }

    /// Relays `port` to `target`.
    pub fn at(port: u16, target: SocketAddr) -> io::Result<Self> {
        Self::start(vec![Port::new(Reservation::of(port)?, target)])
    }

    /// Relays two ports in a row, control and bulk, to `target_control_port` of loopback and to the one after it.
    pub fn pair(target_control_port: u16) -> io::Result<Self> {
        let (control, bulk) = Reservation::pair()?;
        let target_bulk_port = following(target_control_port)?;
        Self::start(vec![
            Port::new(control, loopback(target_control_port)),
            Port::new(bulk, loopback(target_bulk_port)),
        ])
    }

    /// As [`Relay::pair`], on `control_port` and the one after it.
    pub fn pair_at(control_port: u16, target_control_port: u16) -> io::Result<Self> {
        let bulk_port = following(control_port)?;
        let target_bulk_port = following(target_control_port)?;
        Self::start(vec![
            Port::new(
                Reservation::of(control_port)?,
                loopback(target_control_port),
            ),
            Port::new(Reservation::of(bulk_port)?, loopback(target_bulk_port)),
        ])
    }

    fn start(ports: Vec<Port>) -> io::Result<Self> {
        let port = ports.first().map_or(0, Port::number);
        let counters = Arc::new(Counters::default());
        let mut events = EventLoop::new(ports, Arc::clone(&counters));
        events.listen()?;
        let command_thread =
            CommandThread::start(&format!("relay-{port}"), move |inbox| events.run(&inbox))?;
        Ok(Self {
            port,
            counters,
            command_thread,
        })
    }

    /// The port to connect to; of two, the first.
    pub fn port(&self) -> u16 {
        self.port
    }

    /// The address to connect to; of two, the first.
    pub fn address(&self) -> SocketAddr {
        loopback(self.port)
    }

    /// The address to connect to as Zenoh writes it: `tcp/127.0.0.1:7447`.
    pub fn endpoint(&self) -> String {
        format!("tcp/{}", self.address())
    }

    /// Lets everything pass, after a stall or a cut too.
    ///
    /// Fails where the ports cannot be listened on again, or the relay has ended.
    pub fn pass(&self) -> io::Result<()> {
        self.command_thread.call(Command::Mode(Mode::Pass))
    }

    /// Holds everything: see [`Mode::Stall`]. Fails where the relay has ended.
    pub fn stall(&self) -> io::Result<()> {
        self.command_thread.call(Command::Mode(Mode::Stall))
    }

    /// Ends every connection: see [`Mode::Cut`]. Fails where the relay has ended.
    pub fn cut(&self) -> io::Result<()> {
        self.command_thread.call(Command::Mode(Mode::Cut))
    }

    /// Changes one direction; what is under way arrives when it would have. Fails where the relay has ended.
    pub fn set_line(&self, direction: Direction, line: Line) -> io::Result<()> {
        self.command_thread.call(Command::Line(direction, line))
    }

    /// Changes the delay of both directions and nothing else. Fails where the relay has ended.
    pub fn set_delay(&self, one_way: Duration) -> io::Result<()> {
        self.command_thread.call(Command::Delay(one_way))
    }

    /// Changes the rate of each direction and nothing else. Fails where the relay has ended.
    pub fn set_rate(&self, bytes_per_s: Option<u64>) -> io::Result<()> {
        self.command_thread.call(Command::Rate(bytes_per_s))
    }

    /// Bytes of TCP payload handed on so far in `direction`.
    pub fn bytes_forwarded(&self, direction: Direction) -> u64 {
        self.settle();
        self.counters.forwarded_bytes[direction.index()].load(Ordering::Acquire)
    }

    /// Connections that are open now.
    pub fn connections(&self) -> u64 {
        self.settle();
        self.counters.open_connections.load(Ordering::Acquire)
    }

    /// Connections accepted so far.
    pub fn connections_accepted(&self) -> u64 {
        self.settle();
        self.counters.accepted_connections.load(Ordering::Acquire)
    }

    /// Waits until what is handed on is counted too: a receiver may see bytes a moment earlier.
    fn settle(&self) {
        // Of a relay that has ended the counters stay as they are.
        self.command_thread.call(Command::Settle).ok();
    }
}

fn loopback(port: u16) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, port))
}

/// The port of bulk data that belongs to a control port.
fn following(control_port: u16) -> io::Result<u16> {
    control_port.checked_add(1).ok_or_else(|| {
        io::Error::new(
            io::ErrorKind::InvalidInput,
            format!("control port {control_port} leaves none after it for bulk data"),
        )
    })
}
