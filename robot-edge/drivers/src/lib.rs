//! Sensors and controllers without a middleware.
//!
//! Each device has a module with its codec: a [`Decoder`] that turns received bytes into messages,
//! and functions that make requests. A codec reads no clock, opens no file or socket, and never
//! panics: what a device or a bad cable sends is data.

#![warn(missing_docs)]

pub mod dynamixel;
pub mod frames;
pub mod gnss;
pub mod hokuyo;
pub mod imagenex;
pub mod imagenex_deltat;
pub mod nmea;
pub mod ntrip;
pub mod ping;
mod read_buffer;
pub mod roboteq_encoders;
pub mod rplidar;
#[cfg(test)]
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
pub mod sick_cola;
pub mod sick_ldlrs;
#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
#[cfg(test)]
mod test_decoding;
pub mod ublox;
pub mod xsens;

pub use frames::{Decoder, DropReason, Dropped};
