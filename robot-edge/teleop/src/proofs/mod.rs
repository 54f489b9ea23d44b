//! The properties P1 to P13 of `docs/safety.md`, held against the arbiter.
//!
//! [`invariants`] is the one list of what must hold after every step. [`properties`] checks it over random sequences of
//! inputs on an adversarial network ([`world`]), [`model`] over every sequence on a small one; [`shaped_link`] shows
//! that a live operator can drive.

mod invariants;
mod model;
mod permission;
mod properties;
mod shaped_link;
mod world;

use std::time::Duration;

use super::config::{Rules, TeleopConfig};
use crate::lease::{Caller, OperatorId, RequestId, Role};
use crate::locomotion::LocomotionConfig;
use mapping::vehicle::VehicleConfig;
use protocol::message::MapPose;

/// Operator, supervisor and a stranger who may only watch.
const ROLES: [Role; 3] = [Role::Operator, Role::Supervisor, Role::Observer];

fn caller(who: u8) -> Caller {
    Caller {
        operator: OperatorId(who.into()),
        role: ROLES[usize::from(who)],
        request: RequestId(0),
    }
}

const GOAL: MapPose = MapPose {
    x_mm: 1,
    y_mm: 2,
    yaw_mrad: 3,
};

/// The rules of the defaults, for a vehicle of 1 m/s and 1 rad/s with a planner.
fn rules() -> Rules {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let rules = Rules::new(&teleop, &vehicle, &LocomotionConfig::default());
    rules.unwrap().with_planner(millis(200))
}

const fn millis(millis: u64) -> Duration {
    Duration::from_millis(millis)
}
