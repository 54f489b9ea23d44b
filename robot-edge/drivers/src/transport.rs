//! Bytes to and from a device: TCP, UDP, a serial line or a pipe.

use std::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
#[cfg(target_os = "linux")]
use std::{os::fd::OwnedFd, sync::Arc};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpStream, UdpSocket};

use crate::serial::SerialPort;

/// Where a device is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Host and port to connect to.
    Tcp(String),
    /// Host and port to send datagrams to; replies come from there.
    Udp(String),
    /// Own address that the device sends datagrams to. The first sender is the device.
    UdpListen(SocketAddr),
    /// A serial line with 8 data bits, no parity and 1 stop bit.
    Serial {
        /// `/dev/serial/by-id/…`
        path: PathBuf,
        /// Bits per second.
        baud: u32,
    },
    /// The read end of a pipe. The device that writes to it may go, and another one come.
    #[cfg(target_os = "linux")]
    Pipe(PipeEnd),
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => write!(f, "tcp {address}"),
            Self::Udp(address) => write!(f, "udp {address}"),
            Self::UdpListen(address) => write!(f, "udp_listen {address}"),
            Self::Serial { path, baud } => write!(f, "serial {} with {baud} bit/s", path.display()),
            #[cfg(target_os = "linux")]
            Self::Pipe(_) => f.write_str("pipe"),
        }
    }
}

/// An open read end of a pipe.
#[cfg(target_os = "linux")]
#[derive(Clone, Debug)]
pub struct PipeEnd(pub Arc<OwnedFd>);

#[cfg(target_os = "linux")]
impl PartialEq for PipeEnd {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

#[cfg(target_os = "linux")]
impl Eq for PipeEnd {}

/// Asks for room for what a lidar sends in about half a second: the 208 KiB of Linux hold 20 ms of it, and what comes while this
/// computer does something else would be lost. Without the right to more, the kernel gives at most `net.core.rmem_max`.
#[cfg(target_os = "linux")]
fn make_room(socket: &UdpSocket) {
    use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};
    const BYTES: usize = 4 << 20;
    if set_socket_recv_buffer_size_force(socket, BYTES).is_err()
        && let Err(error) = set_socket_recv_buffer_size(socket, BYTES)
    {
        tracing::warn!(%error, "the receive buffer of a UDP port stays small: packets may be lost");
    }
}

#[cfg(not(target_os = "linux"))]
fn make_room(_socket: &UdpSocket) {}

/// An open connection.
#[derive(Debug)]
pub(crate) enum Transport {
    Tcp(TcpStream),
    Udp {
        socket: UdpSocket,
        has_peer: bool,
    },
    Serial(SerialPort),
    #[cfg(target_os = "linux")]
    Pipe(tokio::net::unix::pipe::Receiver),
}

impl Transport {
    pub(crate) async fn open(address: &Address) -> io::Result<Self> {
        match address {
            Address::Tcp(address) => {
                let stream = TcpStream::connect(address).await?;
                stream.set_nodelay(true)?;
                Ok(Self::Tcp(stream))
            }
            Address::Udp(address) => {
                let mut addresses = tokio::net::lookup_host(address).await?;
                let peer = addresses.next().ok_or(io::ErrorKind::NotFound)?;
                let any: SocketAddr = match peer {
                    SocketAddr::V4(_) => ([0; 4], 0).into(),
                    SocketAddr::V6(_) => ([0_u16; 8], 0).into(),
                };
                let socket = UdpSocket::bind(any).await?;
                socket.connect(peer).await?;
                let has_peer = true;
                Ok(Self::Udp { socket, has_peer })
            }
            Address::UdpListen(address) => {
                let socket = UdpSocket::bind(address).await?;
                make_room(&socket);
                let has_peer = false;
                Ok(Self::Udp { socket, has_peer })
            }
            Address::Serial { path, baud } => SerialPort::open(path, *baud).map(Self::Serial),
            #[cfg(target_os = "linux")]
            Address::Pipe(PipeEnd(read_end)) => {
                let receiver = read_end.try_clone()?;
                let receiver = tokio::net::unix::pipe::Receiver::from_owned_fd(receiver)?;
                // Bytes that came before are dropped, as on a serial line. It does not block any more.
                while let Ok(1..) = rustix::io::read(read_end, &mut [0; 4096]) {}
                Ok(Self::Pipe(receiver))
            }
        }
    }

    /// Waits for bytes; a datagram is read whole. 0 is the end of the connection. Can be cancelled.
    pub(crate) async fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(buffer).await,
            Self::Udp { socket, has_peer } if *has_peer => loop {
                // An empty datagram is not the end.
                match socket.recv(buffer).await? {
                    0 => {}
                    length => return Ok(length),
                }
            },
            Self::Udp { socket, has_peer } => {
                let (length, peer) = socket.recv_from(buffer).await?;
                socket.connect(peer).await?;
                *has_peer = true;
                Ok(length)
            }
            Self::Serial(port) => port.read(buffer).await,
            #[cfg(target_os = "linux")]
            Self::Pipe(receiver) => receiver.read(buffer).await,
        }
    }

    /// This computer's address on the way to the device, on a network.
    pub(crate) fn own_address(&self) -> io::Result<IpAddr> {
        let own = match self {
            Self::Tcp(stream) => stream.local_addr(),
            Self::Udp { socket, .. } => socket.local_addr(),
            Self::Serial(_) => Err(io::ErrorKind::Unsupported.into()),
            #[cfg(target_os = "linux")]
            Self::Pipe(_) => Err(io::ErrorKind::Unsupported.into()),
        };
        own.map(|own| own.ip())
    }

    /// Whose datagrams are read.
    pub(crate) fn sender(&self) -> Option<IpAddr> {
        match self {
            Self::Udp {
                socket,
                has_peer: true,
            } => Some(socket.peer_addr().ok()?.ip()),
            _ => None,
        }
    }

    pub(crate) async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.write_all(bytes).await,
            Self::Udp { socket, .. } => socket.send(bytes).await.map(drop),
            Self::Serial(port) => port.write(bytes).await,
            #[cfg(target_os = "linux")]
            Self::Pipe(_) => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
