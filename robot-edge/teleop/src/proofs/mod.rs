//! The properties P1 to P12 of the design, held against the arbiter.
//!
//! [`monitor`] says what must hold, in its own words and with its own memory. [`properties`] has it watch random
//! sequences of events on an adversarial network ([`world`]), [`model`] every sequence on a small one;
//! [`shaped_link`] shows that a live operator gets to drive.

mod licence;
mod model;
mod monitor;
mod moves;
mod properties;
mod shaped_link;
mod world;

use std::time::Duration;

use super::config::{Rules, TeleopConfig};
use mapping::vehicle::VehicleConfig;

/// The rules of the design's defaults, for a vehicle of 1 m/s and 1 rad/s.
fn rules() -> Rules {
    Rules::new(&TeleopConfig::default(), &VehicleConfig::default()).unwrap()
}

const fn millis(millis: u64) -> Duration {
    Duration::from_millis(millis)
}
