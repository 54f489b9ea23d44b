//! Power and a cable for an emulated device.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::unix::fs::symlink;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::process::setpriority_process;
use rustix::pty::OpenptFlags;
use rustix::termios::{self, OptionalActions};
use rustix::thread::gettid;
use tempfile::TempDir;

use crate::Device;

const TICK: Duration = Duration::from_millis(1);
/// What a pulled cable holds back at most: as much as a device buffers.
const MAX_HELD_BACK: usize = 64 * 1024;

/// The present, for tests.
#[expect(
    clippy::disallowed_methods,
    reason = "emulated devices have their own clocks"
)]
pub fn now() -> Instant {
    Instant::now()
}

/// A device with power and a cable.
#[derive(Debug)]
pub struct Emulator<D> {
    shared: Arc<Shared<D>>,
    thread: Option<JoinHandle<()>>,
    /// What a host connects to: `127.0.0.1:2111`, or a path.
    pub address: String,
}

#[derive(Debug)]
struct Shared<D> {
    device: Mutex<D>,
    powered_at: Mutex<Option<Instant>>,
    is_powered: AtomicBool,
    is_plugged: AtomicBool,
    is_open: AtomicBool,
    is_over: AtomicBool,
}

impl<D: Device> Emulator<D> {
    /// A device with a TCP server.
    pub fn on_tcp(device: D) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0));
        let port = listener.and_then(|listener| listener.local_addr());
        let address = port.unwrap_or_else(|error| panic!("no TCP port: {error}"));
        Self::start(device, address.to_string(), Line::Tcp(Tcp::new(address)))
    }

    /// A device on a serial line that stays when its power goes.
    pub fn on_serial(device: D) -> Self {
        Self::on_terminal(device, false)
    }

    /// A device on USB, whose port is gone without power.
    pub fn on_usb(device: D) -> Self {
        Self::on_terminal(device, true)
    }

    fn on_terminal(device: D, is_usb: bool) -> Self {
        let folder = TempDir::new().unwrap_or_else(|error| panic!("no folder: {error}"));
        let path = folder.path().join("port");
        let address = path.display().to_string();
        let terminal = Terminal {
            path,
            is_usb,
            ends: None,
            _folder: folder,
        };
        Self::start(device, address, Line::Terminal(terminal))
    }

    /// A device that replies to datagrams.
    pub fn on_udp(device: D) -> Self {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0));
        let address = socket.and_then(|socket| socket.local_addr());
        let address = address.unwrap_or_else(|error| panic!("no UDP port: {error}"));
        let udp = Udp {
            address,
            socket: None,
            peer: None,
        };
        Self::start(device, address.to_string(), Line::Udp(udp))
    }

    /// A device that sends datagrams to a host.
    pub fn to_udp(device: D, host: SocketAddr) -> Self {
        let udp = Udp {
            address: (Ipv4Addr::LOCALHOST, 0).into(),
            socket: None,
            peer: Some(host),
        };
        Self::start(device, host.to_string(), Line::Udp(udp))
    }

    fn start(device: D, address: String, line: Line) -> Self {
        let shared = Arc::new(Shared {
            device: Mutex::new(device),
            powered_at: Mutex::new(None),
            is_powered: AtomicBool::new(true),
            is_plugged: AtomicBool::new(true),
            is_open: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        });
        let thread = std::thread::spawn({
            let shared = Arc::clone(&shared);
            move || serve(&shared, line)
        });
        let give_up_at = now() + Duration::from_secs(10);
        while !shared.is_open.load(Ordering::Acquire) {
            assert!(now() < give_up_at, "{address} cannot be opened");
            std::thread::sleep(TICK);
        }
        Self {
            shared,
            thread: Some(thread),
            address,
        }
    }

    /// Switches it off and on.
    pub fn power(&self, is_on: bool) {
        self.shared.is_powered.store(is_on, Ordering::Release);
    }

    /// Pulls the cable and plugs it in. Nothing is refused meanwhile. What a device sends on TCP is held
    /// back until its buffer is full, all else is lost.
    pub fn plug(&self, is_in: bool) {
        self.shared.is_plugged.store(is_in, Ordering::Release);
    }

    /// Looks at the device, or changes it.
    pub fn with<T>(&self, act: impl FnOnce(&mut D) -> T) -> T {
        act(&mut lock(&self.shared.device))
    }

    /// Time since power came; 0 without power.
    pub fn uptime(&self) -> Duration {
        lock(&self.shared.powered_at).map_or(Duration::ZERO, |since| now().duration_since(since))
    }
}

impl<D> Drop for Emulator<D> {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn serve<D: Device>(shared: &Shared<D>, mut line: Line) {
    // A real device does not wait for this machine's processor; without the right, this one does.
    setpriority_process(Some(gettid()), -15).ok();
    let mut held_back: Vec<Vec<u8>> = Vec::new();
    while !shared.is_over.load(Ordering::Acquire) {
        line.wait();
        let is_powered = shared.is_powered.load(Ordering::Acquire);
        let mut device = lock(&shared.device);
        if !is_powered {
            if lock(&shared.powered_at).take().is_some() {
                line.cut();
                held_back.clear();
            }
            line.discard();
            continue;
        }
        let powered_at = *lock(&shared.powered_at);
        let uptime = match powered_at {
            Some(since) => now().duration_since(since),
            None if line.open() => {
                *lock(&shared.powered_at) = Some(now());
                shared.is_open.store(true, Ordering::Release);
                held_back.push(device.power_on());
                Duration::ZERO
            }
            None => continue,
        };
        held_back.extend(device.run(uptime));
        if shared.is_plugged.load(Ordering::Acquire) {
            if line.has_new_host() {
                // What was for the last one.
                held_back.clear();
                device.connect();
            }
            for bytes in line.read() {
                held_back.push(device.receive(&bytes, uptime));
            }
            for bytes in held_back.drain(..) {
                line.write(&bytes);
            }
            if let Line::Tcp(tcp) = &mut line
                && device.hangs_up()
            {
                tcp.stream = None;
            }
        } else if line.holds_back() {
            let mut bytes = 0;
            held_back.retain(|held| {
                bytes += held.len();
                bytes <= MAX_HELD_BACK
            });
        } else {
            held_back.clear();
            line.discard();
        }
    }
}

#[derive(Debug)]
enum Line {
    Tcp(Tcp),
    Terminal(Terminal),
    Udp(Udp),
}

impl Line {
    /// For a tick, or until bytes come on a serial line: a servo replies at once.
    fn wait(&self) {
        let Self::Terminal(Terminal {
            ends: Some((far_end, _)),
            ..
        }) = self
        else {
            return std::thread::sleep(TICK);
        };
        let tick = Timespec {
            tv_sec: 0,
            tv_nsec: TICK.subsec_nanos().into(),
        };
        let mut events = [PollFd::new(far_end, PollFlags::IN)];
        // Without it, the next tick comes sooner.
        poll(&mut events, Some(&tick)).ok();
    }

    /// With the power. Whether it is open.
    fn open(&mut self) -> bool {
        match self {
            Self::Tcp(tcp) => tcp.open(),
            Self::Terminal(terminal) => terminal.open(),
            Self::Udp(udp) => {
                let socket = udp
                    .socket
                    .take()
                    .or_else(|| UdpSocket::bind(udp.address).ok());
                udp.socket = socket.filter(|socket| socket.set_nonblocking(true).is_ok());
                udp.socket.is_some()
            }
        }
    }

    /// Without power nothing is sent, not even the end of a connection.
    fn cut(&mut self) {
        match self {
            Self::Tcp(tcp) => {
                tcp.listener = None;
                tcp.dead.extend(tcp.stream.take());
            }
            Self::Terminal(terminal) if terminal.is_usb => {
                terminal.ends = None;
                drop(std::fs::remove_file(&terminal.path));
            }
            Self::Terminal(_) => {}
            Self::Udp(udp) => udp.socket = None,
        }
    }

    /// A network's stream comes later, all other bytes never.
    fn holds_back(&self) -> bool {
        matches!(self, Self::Tcp(_))
    }

    /// Bytes to a device without power or cable are lost.
    fn discard(&mut self) {
        match self {
            Self::Terminal(_) | Self::Udp(_) => drop(self.read()),
            Self::Tcp(_) => {}
        }
    }

    fn has_new_host(&mut self) -> bool {
        match self {
            Self::Tcp(tcp) => tcp.accept(),
            Self::Terminal(_) | Self::Udp(_) => false,
        }
    }

    fn read(&mut self) -> Vec<Vec<u8>> {
        let mut buffer = vec![0; 64 * 1024];
        let mut pieces = Vec::new();
        for _ in 0..16 {
            let length = match self {
                Self::Tcp(tcp) => tcp.read(&mut buffer),
                Self::Terminal(terminal) => match &mut terminal.ends {
                    Some((far_end, _)) => far_end.read(&mut buffer).unwrap_or(0),
                    None => 0,
                },
                Self::Udp(udp) => match udp
                    .socket
                    .as_ref()
                    .map(|socket| socket.recv_from(&mut buffer))
                {
                    Some(Ok((length, peer))) => {
                        udp.peer = Some(peer);
                        length
                    }
                    Some(Err(_)) | None => 0,
                },
            };
            if length == 0 {
                break;
            }
            pieces.push(buffer[..length].to_vec());
        }
        pieces
    }

    /// What cannot be sent is lost.
    fn write(&mut self, bytes: &[u8]) {
        if bytes.is_empty() {
            return;
        }
        match self {
            Self::Tcp(tcp) => tcp.write(bytes),
            Self::Terminal(terminal) => {
                if let Some((far_end, _)) = &mut terminal.ends {
                    drop(far_end.write(bytes));
                }
            }
            Self::Udp(udp) => {
                if let (Some(socket), Some(peer)) = (&udp.socket, udp.peer) {
                    drop(socket.send_to(bytes, peer));
                }
            }
        }
    }
}

/// One host at a time: a new one replaces the last.
#[derive(Debug)]
struct Tcp {
    address: SocketAddr,
    listener: Option<TcpListener>,
    stream: Option<TcpStream>,
    /// Connections of before the power went.
    dead: Vec<TcpStream>,
}

impl Tcp {
    fn new(address: SocketAddr) -> Self {
        Self {
            address,
            listener: None,
            stream: None,
            dead: Vec::new(),
        }
    }

    fn open(&mut self) -> bool {
        self.dead.clear();
        let listener = TcpListener::bind(self.address).ok();
        self.listener = listener.filter(|listener| listener.set_nonblocking(true).is_ok());
        self.listener.is_some()
    }

    fn accept(&mut self) -> bool {
        let Some(Ok((stream, _))) = self.listener.as_ref().map(TcpListener::accept) else {
            return false;
        };
        drop(stream.set_nodelay(true));
        drop(stream.set_nonblocking(true));
        self.stream = Some(stream);
        true
    }

    fn read(&mut self, buffer: &mut [u8]) -> usize {
        let Some(stream) = &mut self.stream else {
            return 0;
        };
        match stream.read(buffer) {
            Ok(0) => {
                self.stream = None;
                0
            }
            Ok(length) => length,
            Err(error) => {
                if error.kind() != ErrorKind::WouldBlock {
                    self.stream = None;
                }
                0
            }
        }
    }

    fn write(&mut self, mut bytes: &[u8]) {
        let give_up_at = now() + Duration::from_millis(100);
        while let Some(stream) = &mut self.stream
            && !bytes.is_empty()
        {
            match stream.write(bytes) {
                Ok(written) => bytes = &bytes[written..],
                Err(error) if error.kind() == ErrorKind::WouldBlock && now() < give_up_at => {
                    std::thread::sleep(TICK);
                }
                Err(_) => self.stream = None,
            }
        }
    }
}

#[derive(Debug)]
struct Terminal {
    /// A link to the port, as udev makes them.
    path: PathBuf,
    is_usb: bool,
    /// The far end, and the near one: held open, or the terminal would hang up between two hosts.
    ends: Option<(File, File)>,
    _folder: TempDir,
}

impl Terminal {
    fn open(&mut self) -> bool {
        if self.ends.is_none() {
            self.ends = self.new_ends().ok();
        }
        self.ends.is_some()
    }

    fn new_ends(&self) -> std::io::Result<(File, File)> {
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let far_end = rustix::pty::openpt(flags)?;
        rustix::pty::grantpt(&far_end)?;
        rustix::pty::unlockpt(&far_end)?;
        let name = rustix::pty::ptsname(&far_end, Vec::new())?;
        let name = name.into_string().map_err(std::io::Error::other)?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let near_end = rustix::fs::open(&name, flags, Mode::empty())?;
        let mut settings = termios::tcgetattr(&near_end)?;
        settings.make_raw();
        termios::tcsetattr(&near_end, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&far_end, true)?;
        symlink(&name, &self.path)?;
        Ok((File::from(far_end), File::from(near_end)))
    }
}

#[derive(Debug)]
struct Udp {
    address: SocketAddr,
    socket: Option<UdpSocket>,
    peer: Option<SocketAddr>,
}
