//! Two network namespaces, and between them a link that can be late, lossy, slow or gone. Needs root.
//!
//! Each namespace has one way out, a TUN device, and this process holds the other side of both: whole IPv4
//! packets go in on one side and come out on the other as the [`Conditions`] have it, whatever protocol is in
//! them. This takes no kernel module for traffic control, and nothing of it is seen outside of the two
//! namespaces.

mod emulator;
mod namespace;

use std::ffi::OsStr;
use std::io;
use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::command_thread::CommandThread;
use super::{Count, Line};
use emulator::{Emulator, LinkCommand};
use namespace::Namespace;
pub use namespace::Unavailable;

/// Largest packet that a namespace sends, its IP header included; what is larger is cut up by its kernel.
pub const MTU_BYTES: u16 = 1500;

/// One end of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The one, 10.73.0.1.
    A,
    /// The other, 10.73.0.2.
    B,
}

impl Side {
    /// Both.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// The side across the link.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    /// The address of this side, inside of the namespaces only.
    pub const fn address(self) -> Ipv4Addr {
        match self {
            Self::A => Ipv4Addr::new(10, 73, 0, 1),
            Self::B => Ipv4Addr::new(10, 73, 0, 2),
        }
    }

    const fn index(self) -> usize {
        match self {
            Self::A => 0,
            Self::B => 1,
        }
    }
}

/// What happens to packets in one direction. The default lets them pass at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conditions {
    /// Rate, queue in front of it and delay. A packet that finds the queue full is dropped.
    pub line: Line,
    /// The greatest delay beyond the line's; each packet draws its own, evenly from 0. Packets keep their order.
    pub jitter: Duration,
    /// How likely a packet is to get lost on the way, from 0 to 1. As on the air, it has used its time of the rate.
    pub loss: f64,
    /// Everything is lost, what is under way too, and nobody is told.
    pub blackhole: bool,
}

/// What became of the packets of one direction so far, IP headers included. What was sent and is in no other count is
/// under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Sent into the link.
    pub sent: Count,
    /// Came out of it.
    pub delivered: Count,
    /// Drew a loss.
    pub lost: Count,
    /// Found the queue full.
    pub overflowed: Count,
    /// Went into the blackhole.
    pub blackholed: Count,
    /// Were refused by the kernel at the far end.
    pub refused: Count,
}

/// Two namespaces and the link between them; dropping it removes all three.
///
/// Their names hold the process id, and a process that creates some first removes those of processes that were
/// killed.
#[derive(Debug)]
pub struct Namespaces {
    // Before the namespaces: the devices close first.
    emulator: CommandThread<LinkCommand>,
    traffic: Arc<Mutex<[Traffic; 2]>>,
    sides: [Namespace; 2],
}

impl Namespaces {
    /// Creates both, with a link that does no harm yet. Fails where something is missing, and says what.
    pub fn create() -> Result<Self, Unavailable> {
        Self::create_seeded(0)
    }

    /// As [`Namespaces::create`], with losses and jitter of another `seed`.
    pub fn create_seeded(seed: u64) -> Result<Self, Unavailable> {
        namespace::check()?;
        namespace::remove_abandoned();
        let (a, device_a) = Namespace::create(Side::A)?;
        let (b, device_b) = Namespace::create(Side::B)?;
        let traffic = Arc::default();
        let link = Emulator::new([device_a, device_b], seed, Arc::clone(&traffic));
        let emulator = CommandThread::start("link-emulator", move |inbox| link.run(&inbox))
            .map_err(|err| Unavailable::failed("starting the emulator's thread", &err))?;
        Ok(Self {
            emulator,
            traffic,
            sides: [a, b],
        })
    }

    /// Changes what happens to packets from `side`. Packets under way keep the time at which they arrive.
    ///
    /// Fails where `loss` is not a probability, or the emulator has ended.
    pub fn set(&self, side: Side, conditions: Conditions) -> io::Result<()> {
        if !(0.0..=1.0).contains(&conditions.loss) {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("loss {} is not between 0 and 1", conditions.loss),
            ));
        }
        self.emulator.call(LinkCommand::Set(side, conditions))
    }

    /// Changes both directions; see [`Namespaces::set`].
    pub fn set_both(&self, conditions: Conditions) -> io::Result<()> {
        Side::ALL
            .into_iter()
            .try_for_each(|side| self.set(side, conditions))
    }

    /// What became of the packets from `side` so far.
    pub fn traffic_from(&self, side: Side) -> Traffic {
        // Of an emulator that has ended the counters stay as they are.
        self.emulator.call(LinkCommand::Settle).ok();
        let traffic = self.traffic.lock().unwrap_or_else(PoisonError::into_inner);
        traffic[side.index()]
    }

    /// The namespace's name, as `ip netns` shows it.
    pub fn name(&self, side: Side) -> &str {
        self.sides[side.index()].name()
    }

    /// `program`, to be started inside of the namespace. It must be ended by whoever starts it.
    pub fn command(&self, side: Side, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", self.name(side)])
            .arg(program);
        command
    }

    /// Runs `task` on a thread inside of the namespace.
    ///
    /// Sockets that it opens stay there and may be used anywhere. Fails where the namespace cannot be entered.
    pub fn within<T: Send>(&self, side: Side, task: impl FnOnce() -> T + Send) -> io::Result<T> {
        self.sides[side.index()].within(task)
    }
}
