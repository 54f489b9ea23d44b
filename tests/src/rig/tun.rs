//! Two network namespaces, and between them a link that can be late, lossy, slow or gone. Needs root and the program `ip`.
//!
//! The only route out of each namespace is a TUN device, and this process holds both: IPv4 packets of any protocol go from
//! one to the other under [`Conditions`]. This takes no kernel module for traffic control, and the machine's own network is
//! not affected.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, ErrorKind, Write};
use std::net::Ipv4Addr;
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::{panic, process, thread};

use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use tokio::io::unix::AsyncFd;
use tokio::runtime::Runtime;
use tun_rs::{DeviceBuilder, SyncDevice};

use super::channel::{Channel, Datagram};
use super::{Conditions, runtime};

/// Largest packet, IP header included.
const MTU_BYTES: u16 = 1500;

/// The device's name in its namespace.
const DEVICE: &str = "tun0";

/// One end of the link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// 10.73.0.1
    A,
    /// 10.73.0.2
    B,
}

impl Side {
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
    /// By the side that sends.
    channels: [Arc<Channel>; 2],
    sides: [Namespace; 2],
}

impl Namespaces {
    /// Creates both, with a good link. `seed` decides which packets are lost. Fails if this machine or user lacks a right, the
    /// kernel's TUN driver or `ip`.
    pub fn create(seed: u64) -> io::Result<Self> {
        let (a, device_a) = Namespace::create(Side::A)?;
        let (b, device_b) = Namespace::create(Side::B)?;
        let tasks = runtime()?;
        let context = tasks.enter();
        #[expect(
            deprecated,
            reason = "`register` is unsafe; a device keeps its descriptor open for as long as it lives"
        )]
        let [device_a, device_b] = [device_a, device_b].map(AsyncFd::new);
        let devices = [Arc::new(device_a?), Arc::new(device_b?)];
        let channels = Side::ALL.map(|side| {
            let other = Arc::clone(&devices[1 - side as usize]);
            Channel::start(seed.wrapping_add(side as u64), move |packet: &Datagram| {
                // The kernel may refuse a packet; then it is lost.
                drop(other.get_ref().send(&packet.bytes));
            })
        });
        for (device, channel) in devices.into_iter().zip(&channels) {
            tokio::spawn(receive(device, Arc::clone(channel)));
        }
        drop(context);
        Ok(Self {
            _tasks: tasks,
            channels,
            sides: [a, b],
        })
    }

    /// Changes both directions. Packets under way keep their arrival time.
    pub fn set_both(&self, conditions: Conditions) {
        for channel in &self.channels {
            channel.set(conditions);
        }
    }

    /// Bytes of the packets from each side, IP headers included.
    pub fn sent_bytes(&self) -> [u64; 2] {
        self.channels
            .each_ref()
            .map(|channel| channel.received_bytes())
    }

    /// `program`, to be started in the namespace. The caller must end it.
    pub fn command(&self, side: Side, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", &self.sides[side as usize].name])
            .arg(program);
        command
    }
}

/// Receives packets until the device is gone.
async fn receive(device: Arc<AsyncFd<SyncDevice>>, channel: Arc<Channel>) -> io::Result<()> {
    let mut buffer = [0; MTU_BYTES as usize];
    loop {
        let mut ready = device.readable().await?;
        match ready.try_io(|device| device.get_ref().recv(&mut buffer)) {
            Ok(Ok(count)) => {
                let bytes = buffer[..count].to_vec();
                channel.receive(Datagram { flow: 0, bytes });
            }
            Ok(Err(err)) if err.kind() == ErrorKind::Interrupted => {}
            Ok(Err(err)) => return Err(err),
            Err(_would_block) => {}
        }
    }
}

/// A network namespace, removed when this is dropped.
#[derive(Debug)]
struct Namespace {
    name: String,
}

impl Namespace {
    /// Creates a namespace in which there is loopback and a TUN device, and opens the device.
    fn create(side: Side) -> io::Result<(Self, SyncDevice)> {
        static CREATED: AtomicU32 = AtomicU32::new(0);
        let number = CREATED.fetch_add(1, Ordering::Relaxed);
        let name = format!("foreshore-rig-{}-{number}", process::id());
        ip(&["netns", "add", &name], "")?;
        let namespace = Self { name };
        let device = namespace.open_device()?;
        // Without `addrgenmode none` the kernel sends IPv6 packets, which would be counted.
        let setup = format!(
            "link set lo up\n\
             link set {DEVICE} mtu {MTU_BYTES} addrgenmode none\n\
             addr add {}/30 dev {DEVICE}\n\
             link set {DEVICE} up\n",
            side.address()
        );
        ip(&["-n", &namespace.name, "-batch", "-"], &setup)?;
        Ok((namespace, device))
    }

    /// Created inside the namespace, the device never belongs to the machine.
    fn open_device(&self) -> io::Result<SyncDevice> {
        let namespace = File::open(PathBuf::from("/var/run/netns").join(&self.name))?;
        // On a thread of its own, because a thread cannot leave the namespace.
        let opened = thread::spawn(move || {
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network))?;
            let device = DeviceBuilder::new().name(DEVICE).enable(false);
            let device = device.build_sync()?;
            device.set_nonblocking(true)?;
            Ok(device)
        });
        opened
            .join()
            .unwrap_or_else(|panicked| panic::resume_unwind(panicked))
    }
}

impl Drop for Namespace {
    fn drop(&mut self) {
        ip(&["netns", "del", &self.name], "").ok();
    }
}

fn ip(arguments: &[&str], input: &str) -> io::Result<()> {
    let call = format!("`ip {}`", arguments.join(" "));
    let mut child = Command::new("ip")
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    if let Some(mut stdin) = child.stdin.take() {
        // If it stops reading, it reports why.
        stdin.write_all(input.as_bytes()).ok();
    }
    let output = child.wait_with_output()?;
    if output.status.success() {
        return Ok(());
    }
    let message = String::from_utf8_lossy(&output.stderr);
    Err(io::Error::other(format!("{call}: {}", message.trim())))
}
