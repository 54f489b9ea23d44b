//! Roboteq AX3500: two motor channels behind an RS-232 line (9600 baud, 7 data bits, even parity, 1 stop bit, no flow
//! control: user's manual 1.9b of June 2007, section "Serial (RS-232) Controls and Operation", p. 138).
//!
//! [`wire`] is what is said on the line, [`Driver`] says it: a state machine with bytes in, bytes out and the time as
//! an argument, which finds the controller, checks it, and then keeps telling it two speeds. [`port`] is the thin shell
//! around a real line. The AX500, AX1500 and AX2550 speak the same language; only the AX3500's manual was followed.

pub mod config;
pub mod wire;

mod exchange;
mod scheduler;

pub mod driver;

#[cfg(target_os = "linux")]
mod lock_holder;
#[cfg(target_os = "linux")]
pub mod port;
#[cfg(target_os = "linux")]
pub mod serial_link;

#[cfg(test)]
pub(crate) mod emulator;

pub use config::RoboteqConfig;
pub use driver::Driver;
