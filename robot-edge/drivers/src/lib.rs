//! Sensors and controllers without a middleware.
//!
//! Each device has a module with its codec: a [`Decoder`] that turns received bytes into messages,
//! and functions that make requests. A codec reads no clock, opens no file or socket, and never
//! panics: what a device or a bad cable sends is data.

#![warn(missing_docs)]

pub mod frames;
mod read_buffer;
pub mod sick_cola;

pub use frames::{Decoder, DropReason, Dropped};
