//! Simulated worlds: a source of measurements whose truth is known.
//!
//! A [`World`] is a data file: solids, a vehicle, the path it drives and how noisy its sensors are. A
//! [`SimulatedSource`] drives that path, or follows commands, and yields the
//! [`Measurement`](measurement::Measurement)s that the vehicle's sensors would give, so that everything
//! downstream runs as it does on a recording.
//!
//! The frame `odom` is the world's own frame here, and `/odom` and `/tf` are the truth; wheels, AHRS, satellite
//! receiver and the encoders of tilting sensors err. The same world, options, seed and commands give the same
//! measurements, bit for bit, on every platform: trigonometry comes from `libm`, ray casting from parry with
//! `enhanced-determinism`, random bits from `ChaCha8`.

#![warn(missing_docs)]

pub mod world;

mod path;
pub mod solid;
pub mod vegetation;
pub mod vehicle;

pub mod attitude;
mod chassis;
mod motion;
mod waves;

mod bumper;
pub mod dynamics;
mod velocity;

mod attitude_sensor;
mod gps;
mod laser;
pub mod noise;
pub mod scene;
pub mod source;
pub mod tilt_servo;
mod ultrasonic;
mod wheel_encoders;

#[cfg(test)]
mod fixtures;

pub use motion::Motion;
pub use source::{DriveError, OptionError, SimulatedSource, SimulationOptions};
pub use velocity::{CommandedVelocity, PlanarVelocity};
pub use world::{World, WorldError};
