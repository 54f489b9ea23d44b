//! Free ports of loopback, also two in a row: control and bulk.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpListener};
use std::os::fd::OwnedFd;

use rustix::net::{self, AddressFamily, SocketFlags, SocketType, ipproto, sockopt};

/// How often two ports in a row are looked for; each attempt begins at another port of the kernel's choice.
const ATTEMPTS: usize = 100;

/// Connections that wait to be accepted.
const BACKLOG: i32 = 64;

/// Two free ports in a row, of which the first is returned.
///
/// They are free when this returns, and nothing keeps others from taking them before the caller does: for programs
/// under test, which bind their ports themselves.
pub fn free_pair() -> io::Result<u16> {
    Ok(Reservation::pair()?.0.port)
}

/// A port of 127.0.0.1 that no other program gets, whether or not somebody listens on it now.
///
/// The reservation is a bound socket that never listens, so that the kernel refuses connections while there is no
/// listener beside it.
#[derive(Debug)]
pub(super) struct Reservation {
    port: u16,
    _socket: OwnedFd,
}

impl Reservation {
    /// Reserves a port of the kernel's choice.
    pub(super) fn any() -> io::Result<Self> {
        Self::exclusively(0)
    }

    /// Reserves `port`, even where connections of an earlier listener have not quite ended.
    pub(super) fn of(port: u16) -> io::Result<Self> {
        Self::with(bound(port, true)?)
    }

    /// Reserves `port` unless it is bound at all: two reservations of one port would not notice each other.
    fn exclusively(port: u16) -> io::Result<Self> {
        let socket = bound(port, false)?;
        // From here on a listener may be bound beside it.
        sockopt::set_socket_reuseaddr(&socket, true)?;
        Self::with(socket)
    }

    fn with(socket: OwnedFd) -> io::Result<Self> {
        let address = SocketAddr::try_from(net::getsockname(&socket)?)?;
        Ok(Self {
            port: address.port(),
            _socket: socket,
        })
    }

    /// Reserves a port and the one after it.
    pub(super) fn pair() -> io::Result<(Self, Self)> {
        let mut refusal = io::Error::other("no attempt was made");
        for _ in 0..ATTEMPTS {
            let first = Self::any()?;
            let Some(next) = first.port.checked_add(1) else {
                continue;
            };
            match Self::exclusively(next) {
                Ok(second) => return Ok((first, second)),
                Err(err) => refusal = err,
            }
        }
        Err(io::Error::new(
            refusal.kind(),
            format!("no two free ports in a row on 127.0.0.1 after {ATTEMPTS} attempts: {refusal}"),
        ))
    }

    pub(super) fn port(&self) -> u16 {
        self.port
    }

    /// Listens on the port, with buffers of `receive_buffer_bytes` for each connection; does not block.
    pub(super) fn listen(&self, receive_buffer_bytes: usize) -> io::Result<TcpListener> {
        let socket = bound(self.port, true)?;
        sockopt::set_socket_recv_buffer_size(&socket, receive_buffer_bytes)?;
        net::listen(&socket, BACKLOG)?;
        Ok(TcpListener::from(socket))
    }
}

/// A socket that does not block, bound to `port` of 127.0.0.1, beside others that `reuse` it too.
fn bound(port: u16, reuse: bool) -> io::Result<OwnedFd> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = net::socket_with(
        AddressFamily::INET,
        SocketType::STREAM,
        flags,
        Some(ipproto::TCP),
    )?;
    sockopt::set_socket_reuseaddr(&socket, reuse)?;
    net::bind(&socket, &SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)).map_err(|err| {
        let err = io::Error::from(err);
        io::Error::new(err.kind(), format!("127.0.0.1:{port}: {err}"))
    })?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use std::net::TcpStream;

    use super::*;

    #[test]
    fn pairs_are_adjacent_and_nobody_elses() {
        let pairs: Vec<_> = (0..20).map(|_| Reservation::pair().unwrap()).collect();
        let mut ports: Vec<_> = pairs
            .iter()
            .flat_map(|(first, second)| [first.port, second.port])
            .collect();
        assert!(ports.chunks(2).all(|pair| pair[1] == pair[0] + 1));
        ports.sort_unstable();
        ports.dedup();
        assert_eq!(ports.len(), 40);
        for port in ports {
            let taken = Reservation::exclusively(port).unwrap_err();
            assert_eq!(taken.kind(), io::ErrorKind::AddrInUse);
        }
    }

    #[test]
    fn refuses_without_a_listener_and_listens_again() {
        let reserved = Reservation::any().unwrap();
        let address = (Ipv4Addr::LOCALHOST, reserved.port);
        for _ in 0..3 {
            let refused = TcpStream::connect(address).unwrap_err();
            assert_eq!(refused.kind(), io::ErrorKind::ConnectionRefused);
            let _listener = reserved.listen(1 << 16).unwrap();
            let _connection = TcpStream::connect(address).unwrap();
        }
    }
}
