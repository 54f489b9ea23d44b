//! Sensors and controllers without a middleware.
//!
//! Each device has a module with its codec: a [`Decoder`] that turns received bytes into messages,
//! and functions that make requests. A codec reads no clock, opens no file or socket, and never
//! panics: what a device or a bad cable sends is data. Beside it a [`device::Device`] says what to ask
//! of the device and what its messages mean.
//!
//! [`Drivers`] runs them: a [`supervisor`] for each device connects, configures, reads, and begins again
//! for ever. Measurements come through one channel, stamped with the vehicle's steady clock.

#![warn(missing_docs)]

pub mod beam_selection;
pub mod clock_mapping;
pub mod config;
pub mod device;
mod drivers;
pub mod dynamixel;
pub mod frames;
pub mod gnss;
pub mod hokuyo;
pub mod imagenex;
pub mod imagenex_deltat;
pub mod joint_goal;
pub mod mavlink;
pub mod nmea;
pub mod ntrip;
pub mod packet_lidar;
pub mod ping;
mod read_buffer;
pub mod roboteq_encoders;
pub mod rplidar;
mod serial;
#[cfg(test)]
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
pub mod sick_cola;
pub mod sick_ldlrs;
mod single_beam;
#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
pub mod status;
pub mod supervisor;
#[cfg(test)]
mod test_decoding;
mod transport;
pub mod ublox;
pub mod xsens;

pub use drivers::{Drivers, StartError};
pub use frames::{Decoder, DropReason, Dropped};
#[cfg(target_os = "linux")]
pub use serial::open_serial;
pub use transport::Address;
#[cfg(target_os = "linux")]
pub use transport::PipeEnd;
