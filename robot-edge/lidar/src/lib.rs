//! Packets of three-dimensional lidars, made into clouds of one revolution each.
//!
//! A [`LidarDecoder`] is fed with datagrams, live or recorded. It reads no clock and no file, and never panics: what a
//! network delivers is data. Times within a cloud are those of the sensor's clock, so that a cloud is the same live, from
//! a capture and from a recording of packets.

#![warn(missing_docs)]

pub mod livox;
pub mod ouster;
mod revolution;
#[cfg(test)]
#[path = "../../recording/src/shared_data.rs"]
mod shared_data;
#[cfg(test)]
#[path = "../../../tests/tests/all/skip.rs"]
mod skip;
pub mod velodyne;

pub use revolution::{LidarDecoder, PacketCounts, PacketError, Revolution, Sensor};
