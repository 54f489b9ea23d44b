//! Roboteq AX3500: two motor channels behind an RS-232 line (9600 baud, 7 data bits, even parity, 1 stop bit, no flow
//! control: user's manual 1.9b of June 2007, section "Serial (RS-232) Controls and Operation", p. 138).
//!
//! [`wire`] encodes commands and parses replies. [`Driver`] is a state machine: bytes in, bytes out, the time as an
//! argument. It finds the controller, checks it, and then keeps sending it two speeds. `serial_link` connects the
//! driver to a real port. The AX500, AX1500 and AX2550 use the same protocol; the AX3500's manual was followed.

pub mod config;
pub mod driver;
pub mod wire;

#[cfg(target_os = "linux")]
pub mod serial_link;

#[cfg(test)]
pub(crate) mod emulator;

pub use config::RoboteqConfig;
pub use driver::Driver;
