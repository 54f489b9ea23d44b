//! The guard's end of the link with an autopilot.

use std::fs::File;
use std::io;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::os::fd::{AsFd as _, BorrowedFd};
use std::time::Duration;

use super::MavlinkConfig;
use super::obstacle_pipe::{MAX_CM, ObstacleReceiver};
use crate::actuators::forward_pipe::ForwardPipe;
use crate::actuators::motor_link::{LinkStatus, MotorLink, Sharing, State};
use crate::actuators::report::ControllerFault;
use drivers::Address;
use drivers::mavlink::{Encoder, comes_from};
use measurement::time::Monotonic;
use rustix::termios::{QueueSelector, tcflush};
use teleop::Velocity;

/// Between two velocities. `ArduPilot` goes on for 3 s without.
const PERIOD: Duration = Duration::from_millis(50);

const HEARTBEAT_PERIOD: Duration = Duration::from_secs(1);

const REOPEN: Duration = Duration::from_millis(200);

/// The autopilot is in the same vehicle. While the guard waits it reports nothing, which it may for 120 ms.
const CONNECT_TIMEOUT: Duration = Duration::from_millis(60);

/// A connection over which nothing arrives for this long ends, with what waits in it: an old velocity must not come later.
const UNDELIVERED: Duration = Duration::from_millis(200);

/// Most reads in one step, a bound for a flood.
const READS: usize = 16;

/// Zeros in a row after which the vehicle counts as stopped: nothing is acknowledged, and a datagram may be lost.
const ZEROS: usize = 3;

pub struct MavlinkLink {
    address: Result<Address, ControllerFault>,
    system: u8,
    sharing: Sharing,
    encoder: Encoder,
    forward_pipe: Option<ForwardPipe>,
    obstacles: Option<ObstacleReceiver>,
    connection: Connection,
    sent: Sent,
    is_mode_requested: bool,
    reconnects: u32,
}

enum Connection {
    Closed {
        retry: Monotonic,
        fault: Option<ControllerFault>,
    },
    Open(Port),
}

enum Port {
    Tcp(TcpStream),
    /// The destination is the sender of the autopilot's newest datagram; absent before the first.
    UdpListen(UdpSocket, Option<SocketAddr>),
    Udp(UdpSocket),
    Serial(File),
}

/// What was sent on this connection.
#[derive(Clone, Copy, Default)]
struct Sent {
    velocity: Option<(Velocity, Monotonic)>,
    /// When the last velocities were sent, newest first, if they are all zero.
    zeros: [Option<Monotonic>; ZEROS],
    heartbeat: Option<Monotonic>,
}

impl MavlinkLink {
    /// Not open yet; the first [`Self::step`] tries it.
    pub fn new(
        config: &MavlinkConfig,
        sharing: Sharing,
        forward_pipe: Option<ForwardPipe>,
        now: Monotonic,
    ) -> Self {
        let ([own_system, own_component], system) = config.numbers();
        let invalid = ControllerFault::Port(rustix::io::Errno::INVAL.raw_os_error() as u8);
        Self {
            address: config.address().map_err(|_checked_before| invalid),
            system,
            sharing,
            encoder: Encoder::new((own_system, own_component), system),
            forward_pipe,
            obstacles: ObstacleReceiver::inherited(),
            connection: Connection::Closed {
                retry: now,
                fault: None,
            },
            sent: Sent::default(),
            is_mode_requested: false,
            reconnects: 0,
        }
    }

    fn try_step(&mut self, velocity: Velocity, now: Monotonic) -> Result<(), ControllerFault> {
        if let Connection::Closed { retry, .. } = self.connection {
            if now < retry {
                return Ok(());
            }
            let port = Port::open(self.address.as_ref().map_err(|fault| *fault)?, self.sharing);
            self.connection = Connection::Open(port.map_err(|error| fault_of(&error))?);
            self.sent = Sent::default();
        }
        let Connection::Open(port) = &mut self.connection else {
            return Ok(());
        };
        let mut buffer = [0; 4096];
        for _ in 0..READS {
            let bytes = port
                .read(&mut buffer, self.system)
                .map_err(|error| fault_of(&error))?;
            if bytes.is_empty() {
                break;
            }
            if let Some(pipe) = &mut self.forward_pipe {
                pipe.push(bytes);
                // What is longer is not written whole or not at all.
                pipe.flush();
            }
        }
        if !port.has_peer() {
            return Ok(());
        }
        let mut bytes = Vec::new();
        let is_new_stop =
            velocity.is_zero() && self.sent.velocity.is_some_and(|(last, _)| !last.is_zero());
        let is_velocity_due = is_due(self.sent.velocity.map(|(_, at)| at), PERIOD, now);
        if is_velocity_due {
            port.discard_unsent().map_err(|error| fault_of(&error))?;
        }
        if is_new_stop || is_velocity_due {
            let time_ms = (now.nanos() / 1_000_000) as u32;
            let Velocity {
                linear_mps,
                angular_radps,
                ..
            } = velocity;
            let (linear_mps, angular_radps) = (linear_mps as f32, angular_radps as f32);
            bytes.extend(self.encoder.velocity(linear_mps, angular_radps, time_ms));
            self.sent.velocity = Some((velocity, now));
            if velocity.is_zero() {
                self.sent.zeros.rotate_right(1);
                self.sent.zeros[0] = Some(now);
            } else {
                self.sent.zeros = [None; ZEROS];
            }
        }
        if is_velocity_due
            && let Some(distances) = self.obstacles.as_ref().and_then(|from| from.take(now))
        {
            let time_us = now.nanos().unsigned_abs() / 1000;
            let message = self.encoder.obstacle_distance(distances, MAX_CM, time_us);
            bytes.extend(message);
        }
        if is_due(self.sent.heartbeat, HEARTBEAT_PERIOD, now) {
            self.sent.heartbeat = Some(now);
            bytes.extend(self.encoder.heartbeat());
            bytes.extend(self.encoder.request_rate());
        }
        if std::mem::take(&mut self.is_mode_requested) {
            bytes.extend(self.encoder.request_guided());
        }
        if bytes.is_empty() {
            return Ok(());
        }
        port.write(&bytes).map_err(|error| fault_of(&error))
    }
}

fn is_due(last: Option<Monotonic>, period: Duration, now: Monotonic) -> bool {
    last.is_none_or(|last| now.since(last) >= period)
}

fn fault_of(error: &io::Error) -> ControllerFault {
    let number = error.raw_os_error().unwrap_or(match error.kind() {
        io::ErrorKind::TimedOut => rustix::io::Errno::TIMEDOUT.raw_os_error(),
        io::ErrorKind::UnexpectedEof => rustix::io::Errno::CONNRESET.raw_os_error(),
        // Another program has locked the port.
        _ => rustix::io::Errno::BUSY.raw_os_error(),
    });
    ControllerFault::Port(u8::try_from(number).unwrap_or(u8::MAX))
}

impl MotorLink for MavlinkLink {
    fn step(&mut self, velocity: Velocity, now: Monotonic) {
        if let Err(fault) = self.try_step(velocity, now) {
            if let Connection::Open(_) = self.connection {
                self.reconnects = self.reconnects.saturating_add(1);
            }
            self.connection = Connection::Closed {
                retry: now + REOPEN,
                fault: Some(fault),
            };
        }
    }

    fn deadline(&self) -> Monotonic {
        match &self.connection {
            Connection::Closed { retry, .. } => *retry,
            // Without a destination, when one may be read, or later.
            Connection::Open(_) => {
                (self.sent.velocity).map_or(Monotonic::from_nanos(u64::MAX), |(_, at)| at + PERIOD)
            }
        }
    }

    fn fd(&self) -> Option<BorrowedFd<'_>> {
        match &self.connection {
            Connection::Closed { .. } => None,
            Connection::Open(port) => Some(port.fd()),
        }
    }

    fn status(&self, _now: Monotonic) -> LinkStatus {
        LinkStatus {
            state: match &self.connection {
                Connection::Closed { fault, .. } => fault.map_or(State::Starting, State::Faulty),
                Connection::Open(port) if port.has_peer() => State::Ready,
                Connection::Open(_) => State::Starting,
            },
            applied: self.sent.velocity.map(|(velocity, _)| velocity),
            reconnects: self.reconnects,
            lost_bytes: (self.forward_pipe.as_ref()).map_or(0, ForwardPipe::lost_bytes),
            ..LinkStatus::STARTING
        }
    }

    fn has_stopped_since(&self, since: Monotonic) -> bool {
        let [.., first] = self.sent.zeros;
        first.is_some_and(|first| first >= since)
    }

    fn request_mode(&mut self) {
        self.is_mode_requested = true;
    }
}

impl Port {
    fn open(address: &Address, sharing: Sharing) -> io::Result<Self> {
        let invalid = |_| io::Error::from_raw_os_error(rustix::io::Errno::INVAL.raw_os_error());
        Ok(match address {
            Address::Tcp(peer) => {
                let peer = peer.parse().map_err(invalid)?;
                let stream = TcpStream::connect_timeout(&peer, CONNECT_TIMEOUT)?;
                stream.set_nodelay(true)?;
                let timeout_ms = UNDELIVERED.as_millis() as u32;
                rustix::net::sockopt::set_tcp_user_timeout(&stream, timeout_ms)?;
                stream.set_nonblocking(true)?;
                Self::Tcp(stream)
            }
            Address::Udp(peer) => {
                let peer: SocketAddr = peer.parse().map_err(invalid)?;
                let any: SocketAddr = if peer.is_ipv4() {
                    ([0; 4], 0).into()
                } else {
                    ([0_u16; 8], 0).into()
                };
                let socket = UdpSocket::bind(any)?;
                socket.connect(peer)?;
                socket.set_nonblocking(true)?;
                Self::Udp(socket)
            }
            Address::UdpListen(own) => {
                let socket = UdpSocket::bind(own)?;
                socket.set_nonblocking(true)?;
                Self::UdpListen(socket, None)
            }
            Address::Serial { path, baud } => {
                let is_exclusive = sharing == Sharing::Exclusive;
                Self::Serial(drivers::open_serial(path, *baud, is_exclusive)?.into())
            }
            Address::Pipe(_) => return Err(io::ErrorKind::Unsupported.into()),
        })
    }

    fn has_peer(&self) -> bool {
        !matches!(self, Self::UdpListen(_, None))
    }

    /// What has come in, without waiting; empty where nothing has. `system`: whose datagrams say where to send.
    fn read<'a>(&mut self, buffer: &'a mut [u8], system: u8) -> io::Result<&'a [u8]> {
        let read = match self {
            Self::Tcp(stream) => stream.read(buffer).and_then(not_closed),
            Self::Serial(port) => port.read(buffer).and_then(not_closed),
            Self::Udp(socket) => socket.recv(buffer),
            Self::UdpListen(socket, peer) => socket.recv_from(buffer).map(|(length, sender)| {
                if comes_from(system, buffer.get(..length).unwrap_or_default()) {
                    *peer = Some(sender);
                }
                length
            }),
        };
        match read {
            Ok(length) => Ok(buffer.get(..length).unwrap_or_default()),
            Err(error) if is_passing(&error) => Ok(&[]),
            // Nobody receives the datagrams yet.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => Ok(&[]),
            Err(error) => Err(error),
        }
    }

    /// A serial port that takes nothing, as a stalled USB device, keeps no velocity for later.
    fn discard_unsent(&self) -> io::Result<()> {
        if let Self::Serial(port) = self {
            tcflush(port, QueueSelector::OFlush)?;
        }
        Ok(())
    }

    /// Sends without waiting. What does not fit is lost: the next velocity follows.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let written = match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Serial(port) => port.write(bytes),
            Self::Udp(socket) => socket.send(bytes),
            Self::UdpListen(socket, Some(peer)) => socket.send_to(bytes, *peer),
            Self::UdpListen(_, None) => Ok(0),
        };
        match written {
            Err(error)
                if !is_passing(&error) && error.kind() != io::ErrorKind::ConnectionRefused =>
            {
                Err(error)
            }
            Ok(_) | Err(_) => Ok(()),
        }
    }

    fn fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Tcp(stream) => stream.as_fd(),
            Self::Serial(port) => port.as_fd(),
            Self::Udp(socket) | Self::UdpListen(socket, _) => socket.as_fd(),
        }
    }
}

fn not_closed(length: usize) -> io::Result<usize> {
    if length == 0 {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(length)
}

fn is_passing(error: &io::Error) -> bool {
    let kind = error.kind();
    kind == io::ErrorKind::WouldBlock || kind == io::ErrorKind::Interrupted
}

#[cfg(test)]
mod tests {
    use drivers::Decoder as _;
    use drivers::mavlink::MavlinkDecoder;

    use super::*;

    const AHEAD: Velocity = Velocity {
        linear_mps: 0.5,
        lateral_mps: 0.0,
        angular_radps: 0.0,
    };

    /// A heartbeat of system 1, component 1, by pymavlink.
    const HEARTBEAT: [u8; 21] = [
        0xfd, 9, 0, 0, 0, 1, 1, 0, 0, 0, 15, 0, 0, 0, 11, 3, 0x81, 4, 3, 0x30, 0x6e,
    ];

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos((1_000_000 + ms) * 1_000_000)
    }

    fn link(keys: &str) -> MavlinkLink {
        let config = toml::from_str(keys).unwrap();
        MavlinkLink::new(&config, Sharing::Exclusive, None, at(0))
    }

    /// A socket whose reads wait, and its address.
    fn socket() -> (UdpSocket, SocketAddr) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket
            .set_read_timeout(Some(Duration::from_secs(10)))
            .unwrap();
        let address = socket.local_addr().unwrap();
        (socket, address)
    }

    /// Speeds ahead in the next datagram; none where it has no velocity.
    fn received(socket: &UdpSocket) -> Vec<f32> {
        let mut buffer = [0; 2048];
        let length = socket.recv(&mut buffer).unwrap();
        let mut decoder = MavlinkDecoder::default();
        decoder.push(&buffer[..length]);
        let messages = std::iter::from_fn(|| decoder.next_message());
        let speeds = messages.filter_map(|message| message.velocity().map(|[speed, _]| speed));
        speeds.collect()
    }

    #[test]
    fn velocities_are_sent_at_a_rate_and_a_stop_at_once() {
        let (autopilot, address) = socket();
        let mut link = link(&format!("udp = \"{address}\""));
        link.step(AHEAD, at(0));
        assert_eq!(received(&autopilot), [0.5]);
        assert_eq!(link.status(at(0)).applied, Some(AHEAD));
        // Too early for another one; the stop is not.
        link.step(AHEAD, at(49));
        link.step(Velocity::ZERO, at(49));
        assert_eq!(received(&autopilot), [0.0]);
        assert!(!link.has_stopped_since(at(49)));
        for ms in [50, 99, 149] {
            assert_eq!(link.deadline(), at(if ms < 149 { 99 } else { 149 }));
            link.step(Velocity::ZERO, at(ms));
        }
        assert!(link.has_stopped_since(at(49)) && !link.has_stopped_since(at(50)));
        assert_eq!(
            (received(&autopilot), received(&autopilot)),
            (vec![0.0], vec![0.0])
        );
        link.step(AHEAD, at(199));
        assert!(!link.has_stopped_since(at(49)));
    }

    #[test]
    fn the_destination_is_who_sends_frames_of_the_autopilot() {
        let (other, _) = socket();
        let (autopilot, _) = socket();
        let own = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let mut link = link(&format!("udp_listen = \"{own}\""));
        link.step(Velocity::ZERO, at(0));
        let mut of_other_system = HEARTBEAT;
        of_other_system[5] = 2;
        other.send_to(&of_other_system, own).unwrap();
        let in_order = rustix::event::PollFlags::IN;
        let readable = rustix::event::PollFd::from_borrowed_fd(link.fd().unwrap(), in_order);
        rustix::event::poll(&mut [readable], None).unwrap();
        link.step(Velocity::ZERO, at(100));
        assert_eq!(link.status(at(100)).state, State::Starting);
        autopilot.send_to(&HEARTBEAT, own).unwrap();
        let began = network::clock::now();
        while link.status(at(200)).state != State::Ready {
            assert!(network::clock::elapsed(began) < Duration::from_secs(10));
            link.step(Velocity::ZERO, at(200));
        }
        assert_eq!(received(&autopilot), [0.0]);
    }

    #[test]
    fn a_link_that_cannot_be_opened_is_tried_again() {
        let closed = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let mut link = link(&format!("tcp = \"{closed}\""));
        link.step(Velocity::ZERO, at(0));
        let refused = rustix::io::Errno::CONNREFUSED.raw_os_error() as u8;
        let fault = State::Faulty(ControllerFault::Port(refused));
        assert_eq!(link.status(at(0)).state, fault);
        assert_eq!(link.deadline(), at(200));
        let listener = std::net::TcpListener::bind(closed).unwrap();
        link.step(Velocity::ZERO, at(200));
        assert_eq!(link.status(at(200)).state, State::Ready);
        drop(listener.accept().unwrap());
        let began = network::clock::now();
        while link.status(at(400)).state == State::Ready {
            assert!(network::clock::elapsed(began) < Duration::from_secs(10));
            link.step(Velocity::ZERO, at(400));
        }
        assert_eq!(link.status(at(400)).reconnects, 1);
    }
}
