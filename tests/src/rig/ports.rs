//! Free ports of loopback, single or two adjacent ones for control and bulk.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, TcpListener};
use std::os::fd::OwnedFd;

use rustix::net::{self, AddressFamily, SocketFlags, SocketType, ipproto, sockopt};

/// Attempts to find two adjacent ports; each begins at another port that the kernel chooses.
const ATTEMPTS: usize = 100;

/// Connections that wait to be accepted.
const BACKLOG: i32 = 64;

/// The first of two adjacent free ports.
///
/// Other programs may take them before the caller does: for programs
/// under test, which bind their ports themselves.
pub fn free_pair() -> io::Result<u16> {
    Ok(Reservation::pair()?.0.port)
}

/// A port of 127.0.0.1 that no other program gets, with or without a listener.
///
/// The reservation is a bound socket that never listens, so that the kernel refuses connections while there is no
/// listener beside it.
#[derive(Debug)]
pub(super) struct Reservation {
    port: u16,
    _socket: OwnedFd,
}

impl Reservation {
    /// Reserves a port that the kernel chooses.
    pub(super) fn any() -> io::Result<Self> {
        Self::exclusively(0)
    }

    /// Reserves `port`, even if connections of an earlier listener have not ended.
    pub(super) fn of(port: u16) -> io::Result<Self> {
        Self::with(bound(port, true)?)
    }

    /// Reserves `port` unless it is bound, because two reservations of one port would not conflict.
    fn exclusively(port: u16) -> io::Result<Self> {
        let socket = bound(port, false)?;
        // Allows a listener beside it.
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

    /// Listens on the port; the listener does not block.
    pub(super) fn listen(&self) -> io::Result<TcpListener> {
        let socket = bound(self.port, true)?;
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
