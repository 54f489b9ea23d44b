//! The rig for bad links, held against real sockets.

use std::io::{self, ErrorKind};

use foreshore_tests::rig::tun::Namespaces;

use crate::skip::skip;

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

/// An emulated link; `None`, said aloud, where this machine or user can have none.
pub(crate) fn namespaces(seed: u64) -> Option<Namespaces> {
    match Namespaces::create_seeded(seed) {
        Ok(namespaces) => Some(namespaces),
        Err(err) if err.is_for_lack_of_means() => {
            skip(
                &err.to_string(),
                "root, the kernel's TUN driver and package iproute2",
            );
            None
        }
        Err(err) => panic!("{err}"),
    }
}
