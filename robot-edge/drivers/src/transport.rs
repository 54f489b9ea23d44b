//! Bytes to and from a device: TCP, UDP or a serial line.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

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
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Tcp(address) => write!(f, "tcp {address}"),
            Self::Udp(address) => write!(f, "udp {address}"),
            Self::UdpListen(address) => write!(f, "udp_listen {address}"),
            Self::Serial { path, baud } => write!(f, "serial {} with {baud} bit/s", path.display()),
        }
    }
}

/// An open connection.
#[derive(Debug)]
pub(crate) enum Transport {
    Tcp(TcpStream),
    Udp { socket: UdpSocket, has_peer: bool },
    Serial(SerialPort),
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
                let has_peer = false;
                Ok(Self::Udp { socket, has_peer })
            }
            Address::Serial { path, baud } => SerialPort::open(path, *baud).map(Self::Serial),
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
        }
    }

    pub(crate) async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.write_all(bytes).await,
            Self::Udp { socket, .. } => socket.send(bytes).await.map(drop),
            Self::Serial(port) => port.write(bytes).await,
        }
    }
}
