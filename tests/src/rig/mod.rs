//! Bad links on one machine.
//!
//! [`relay`] stalls and cuts TCP connections over loopback. [`udp`] delays, loses, changes and repeats datagrams over
//! loopback, QUIC included. Neither needs privileges. [`tun`] does the same to IP packets between two network namespaces
//! and needs root.
//!
//! Each link has a tokio runtime of its own: dropping it ends every task and closes every socket.

mod channel;
pub mod relay;
pub mod tun;
pub mod udp;

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicU32, Ordering};

use tokio::runtime::{Builder, Runtime};

pub use channel::Conditions;

/// Attempts to find two adjacent ports; each begins at another port that the kernel chooses.
const ATTEMPTS: usize = 100;

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the side that connects to the relay.
    ToTarget,
    /// To the side that connects to the relay.
    FromTarget,
}

impl Direction {
    pub const ALL: [Self; 2] = [Self::ToTarget, Self::FromTarget];
}

/// The first of two adjacent free ports of loopback, for control and bulk.
///
/// Other programs may take them before the caller does: for programs under test, which bind their ports themselves.
pub fn free_pair() -> io::Result<u16> {
    let [control, _bulk] = listen_pair()?;
    Ok(control.local_addr()?.port())
}

fn listen_pair() -> io::Result<[TcpListener; 2]> {
    // Below the ports that systems give to outgoing connections (Linux from 32768, gVisor from 16000): one of these would take a
    // port while a program under test is down. Each call goes on from the last one; processes begin apart.
    static NEXT: AtomicU32 = AtomicU32::new(0);
    for _ in 0..ATTEMPTS {
        let pair = NEXT.fetch_add(1, Ordering::Relaxed) + std::process::id() * 97;
        let port = 10_000 + 2 * (pair % 3_000) as u16;
        let bind = |port| TcpListener::bind((Ipv4Addr::LOCALHOST, port));
        if let (Ok(first), Ok(second)) = (bind(port), bind(port + 1)) {
            return Ok([first, second]);
        }
    }
    Err(io::Error::other("no two adjacent ports are free"))
}

fn runtime() -> io::Result<Runtime> {
    Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
}
