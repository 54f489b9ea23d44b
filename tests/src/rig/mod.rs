//! Bad links, made on one machine.
//!
//! [`relay`] spoils TCP connections over loopback and needs no privileges; [`tun`] spoils whole IP packets, and
//! so UDP and QUIC too, between two network namespaces and needs root. Both change while traffic runs, both
//! count what they pass, and both run one thread that waits in `poll` and owns everything: a setting has taken
//! effect when the call that makes it returns.

mod bottleneck;
pub mod ports;
mod remote;

pub mod relay;
pub mod tun;

pub use bottleneck::Line;
