//! The rig for bad links, held against real sockets.

use std::io::{self, ErrorKind};

mod relay;
mod tun;
mod udp;

/// Repeats what a signal interrupts; a socket with a time-out is never restarted by the kernel.
fn uninterrupted<T>(mut call: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match call() {
            Err(err) if err.kind() == ErrorKind::Interrupted => {}
            outcome => return outcome,
        }
    }
}
