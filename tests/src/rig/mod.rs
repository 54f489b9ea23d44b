//! Bad links, made on one machine.
//!
//! [`relay`] spoils TCP connections over loopback, and [`udp`] spoils datagrams there, QUIC's too, and attacks them:
//! both need no privileges. [`tun`] spoils whole IP packets between two network namespaces and needs root. All change
//! while traffic runs, all count what they pass, and all run one thread that waits in `poll` and owns everything: a
//! setting has taken effect when the call that makes it returns.

mod bottleneck;
mod command_thread;
mod count;
pub mod ports;
mod rng;

pub mod relay;
pub mod tun;
pub mod udp;

pub use bottleneck::Line;
pub use count::Count;
