//! Devices that talk like the real ones, over TCP, UDP and pseudo-terminals.
//!
//! Most make their measurements up; a simulation can give them to some (`feed`), and they send them as the device
//! would: in its units and steps, by its own clock and after its own delay.
//!
//! Each is written from the documents that it names, not from the codecs in `robot-edge/drivers`. An
//! [`Emulator`] gives it power and a cable, and takes them away.

#![cfg(target_os = "linux")]
#![warn(missing_docs)]

pub mod deltat;
pub mod dynamixel;
mod emulator;
mod feed;
pub mod hokuyo;
pub mod imagenex852;
pub mod ldlrs;
pub mod livox;
pub mod lms111;
pub mod mti;
pub mod nmea;
pub mod ntrip;
pub mod packets;
pub mod ping1d;
pub mod rplidar;
pub mod ublox;

pub use emulator::{Emulator, now};

use std::time::Duration;

/// A device: bytes come and go; the time since power-on is an argument.
pub trait Device: Send + 'static {
    /// Power comes. What is not kept in its memory is forgotten. Bytes that it sends then.
    fn power_on(&mut self) -> Vec<u8> {
        Vec::new()
    }

    /// A host connects; another one is gone.
    fn connect(&mut self) {}

    /// What it replies.
    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8>;

    /// It ends the connection once its reply is sent.
    fn hangs_up(&mut self) -> bool {
        false
    }

    /// What it sends by itself since the last call. Each item is sent at once: a datagram, if so.
    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>>;
}

/// Counts periods: how often something is due.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ticks(u64);

impl Ticks {
    pub(crate) fn restart(&mut self) {
        self.0 = 0;
    }

    /// Periods have another length from now on.
    pub(crate) fn change_period(&mut self, uptime: Duration, period: Duration) {
        self.restart();
        self.due(uptime, period);
    }

    /// Numbers of the periods that have ended since the last call; at most 1000 are made up for.
    pub(crate) fn due(&mut self, uptime: Duration, period: Duration) -> std::ops::Range<u64> {
        let ended = (uptime.as_nanos() / period.as_nanos().max(1)) as u64;
        let from = self.0.max(ended.saturating_sub(1000));
        self.0 = ended.max(self.0);
        from..ended.max(from)
    }
}

/// Takes the first whole request out of a buffer, by the length that `find` returns: how many bytes to
/// skip and how many the request has. `None` if it is not whole.
pub(crate) fn take_request(
    buffer: &mut Vec<u8>,
    find: impl Fn(&[u8]) -> Option<(usize, usize)>,
) -> Option<Vec<u8>> {
    let (skip, length) = find(buffer)?;
    let rest = buffer.split_off((skip + length).min(buffer.len()));
    let request = std::mem::replace(buffer, rest);
    request.get(skip..).map(<[u8]>::to_vec)
}
