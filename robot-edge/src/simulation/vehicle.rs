//! The vehicles that can be simulated, by the names of their presets.

use crate::pose;
use crate::simulation::laser::PlanarLaser;

/// What the simulation needs to know of a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedVehicle {
    /// Name of the preset in `vehicles/`.
    pub name: &'static str,
    /// Radius of the circle about `base_link` that holds the vehicle at any yaw, metres.
    pub radius_m: f64,
    /// Height above the ground, metres.
    pub height_m: f64,
    /// How often it reports its pose, hertz.
    pub odometry_rate_hz: f64,
    /// Its laser.
    pub laser: PlanarLaser,
}

impl SimulatedVehicle {
    /// Names of all vehicles.
    pub const NAMES: &[&str] = &["pioneer"];

    /// The vehicle called `name`; `None` where there is none.
    pub fn preset(name: &str) -> Option<Self> {
        (name == "pioneer").then(pioneer)
    }
}

/// Adept `MobileRobots` Pioneer 3-DX with a Hokuyo URG-04LX-UG01, the robot of the laser range finder
/// document. Data sheet: 455 × 381 × 237 mm, swing radius 26.7 cm.
fn pioneer() -> SimulatedVehicle {
    // The document does not say where its laser sits: here on the front of the top plate.
    let mut base_from_laser = pose::planar(0.16, 0.0, 0.0);
    base_from_laser.translation.z = 0.28;
    SimulatedVehicle {
        name: "pioneer",
        radius_m: 0.27,
        height_m: 0.34,
        odometry_rate_hz: 50.0,
        laser: PlanarLaser::urg_04lx_ug01(base_from_laser),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_a_vehicle_of_that_name() {
        for name in SimulatedVehicle::NAMES {
            assert_eq!(SimulatedVehicle::preset(name).unwrap().name, *name);
        }
        assert_eq!(SimulatedVehicle::preset("Pioneer"), None);
    }
}
