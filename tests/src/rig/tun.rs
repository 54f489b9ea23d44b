//! Two network namespaces, and between them a link that can be late, lossy, slow or gone. Needs root.
//!
//! The only route out of each namespace is a TUN device, and this process holds both: IPv4 packets of any protocol go from
//! one to the other under [`Conditions`]. This takes no kernel module for traffic control, and the machine's own network is
//! not affected.

use std::ffi::OsStr;
use std::io::{self, ErrorKind};
use std::net::Ipv4Addr;
use std::process::Command;
use std::sync::Arc;

use tokio::io::unix::AsyncFd;
use tokio::runtime::Runtime;
use tun_rs::SyncDevice;

use super::channel::{Channels, Datagram};
pub use super::namespace::Unavailable;
use super::namespace::{self, Namespace};
use super::{Conditions, Traffic, runtime};

/// Largest packet, IP header included.
pub(super) const MTU_BYTES: u16 = 1500;

/// One end of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// 10.73.0.1
    A,
    /// 10.73.0.2
    B,
}

impl Side {
    /// Both.
    pub const ALL: [Self; 2] = [Self::A, Self::B];

    /// The address of this side, valid inside the namespaces only.
    pub const fn address(self) -> Ipv4Addr {
        match self {
            Self::A => Ipv4Addr::new(10, 73, 0, 1),
            Self::B => Ipv4Addr::new(10, 73, 0, 2),
        }
    }
}

/// Two namespaces and the link between them; dropping it removes all three.
#[derive(Debug)]
pub struct Namespaces {
    // Before the namespaces: the devices close first.
    _tasks: Runtime,
    channels: Arc<Channels>,
    sides: [Namespace; 2],
}

impl Namespaces {
    /// Creates both, with a good link. `seed` decides which packets are lost. Fails if the machine lacks something.
    pub fn create(seed: u64) -> Result<Self, Unavailable> {
        namespace::check()?;
        namespace::remove_abandoned();
        let (a, device_a) = Namespace::create(Side::A)?;
        let (b, device_b) = Namespace::create(Side::B)?;
        let channels = Arc::new(Channels::new(seed));
        let tasks = carry([device_a, device_b], &channels)
            .map_err(|err| Unavailable::failed("starting the link", &err))?;
        Ok(Self {
            _tasks: tasks,
            channels,
            sides: [a, b],
        })
    }

    /// Changes both directions. Packets under way keep their arrival time.
    ///
    /// Fails if a likelihood is not between 0 and 1.
    pub fn set_both(&self, conditions: Conditions) -> io::Result<()> {
        self.channels.set_both(conditions)
    }

    /// Counters of the packets from `side`, IP headers included.
    pub fn traffic_from(&self, side: Side) -> Traffic {
        self.channels.traffic(side as usize)
    }

    /// The namespace's name, as `ip netns` shows it.
    pub fn name(&self, side: Side) -> &str {
        self.sides[side as usize].name()
    }

    /// `program`, to be started in the namespace. The caller must end it.
    pub fn command(&self, side: Side, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", self.name(side)])
            .arg(program);
        command
    }

    /// Runs `task` on a thread in the namespace. Sockets that it opens belong to the namespace for good.
    pub fn within<T: Send>(&self, side: Side, task: impl FnOnce() -> T + Send) -> io::Result<T> {
        self.sides[side as usize].within(task)
    }
}

/// Starts the tasks that carry packets between the devices.
fn carry(devices: [SyncDevice; 2], channels: &Arc<Channels>) -> io::Result<Runtime> {
    let tasks = runtime()?;
    let context = tasks.enter();
    #[expect(
        deprecated,
        reason = "`register` is unsafe; a device keeps its descriptor open for as long as it lives"
    )]
    let [a, b] = devices.map(AsyncFd::new);
    let devices = Arc::new([a?, b?]);
    drop(context);
    for side in Side::ALL {
        tasks.spawn(receive(side, Arc::clone(&devices), Arc::clone(channels)));
    }
    let channels = Arc::clone(channels);
    tasks.spawn(async move {
        let send = |side: usize, packet: &Datagram| devices[1 - side].get_ref().send(&packet.bytes);
        channels.deliver(send).await
    });
    Ok(tasks)
}

/// Receives packets from `side` until its device is gone.
async fn receive(
    side: Side,
    devices: Arc<[AsyncFd<SyncDevice>; 2]>,
    channels: Arc<Channels>,
) -> io::Result<()> {
    let mut buffer = [0; MTU_BYTES as usize];
    loop {
        let mut ready = devices[side as usize].readable().await?;
        match ready.try_io(|device| device.get_ref().recv(&mut buffer)) {
            Ok(Ok(count)) => {
                let bytes = buffer[..count].to_vec();
                channels.receive(side as usize, Datagram { flow: 0, bytes });
            }
            Ok(Err(err)) if err.kind() == ErrorKind::Interrupted => {}
            Ok(Err(err)) => return Err(err),
            Err(_would_block) => {}
        }
    }
}
