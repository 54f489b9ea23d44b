//! Bad links on one machine.
//!
//! [`relay`] stalls and cuts TCP connections over loopback. [`udp`] delays, loses, changes and repeats datagrams over
//! loopback, QUIC included. Neither needs privileges. [`tun`] does the same to IP packets between two network namespaces
//! and needs root.
//!
//! Each link has a tokio runtime of its own: dropping it ends every task and closes every socket.

mod bottleneck;
mod channel;
mod namespace;
pub mod ports;

pub mod relay;
pub mod tun;
pub mod udp;

use std::io;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::runtime::{Builder, Runtime};

pub use bottleneck::Line;
pub use channel::{Conditions, Count, Traffic};

fn runtime() -> io::Result<Runtime> {
    Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
