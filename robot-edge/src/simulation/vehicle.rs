//! The vehicles that can be simulated, by the names of their presets.

use nalgebra::Translation3;

use crate::pose::{self, Pose};
use crate::simulation::attitude::Attitude;
use crate::simulation::attitude_sensor::AttitudeSensor;
use crate::simulation::chassis::Chassis;
use crate::simulation::laser::PlanarLaser;
use crate::simulation::wheel_encoders::WheelEncoders;

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
    /// Its wheels and their encoders; without, it stays level at z = 0 whatever it drives over.
    pub chassis: Option<Chassis>,
    /// Its AHRS, at `base_link` and with its axes.
    pub attitude_sensor: Option<AttitudeSensor>,
    /// Its laser.
    pub laser: PlanarLaser,
}

impl SimulatedVehicle {
    /// Names of all vehicles.
    pub const NAMES: &[&str] = &["pioneer", "holos"];

    /// The vehicle called `name`; `None` where there is none.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "pioneer" => Some(pioneer()),
            "holos" => Some(holos()),
            _ => None,
        }
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
        chassis: None,
        attitude_sensor: None,
        laser: PlanarLaser::urg_04lx_ug01(base_from_laser),
    }
}

/// The robot of the elevation map document [LOD ch. 5]: SICK LMS111 at 1.08 m tilted down by 7.5°, Xsens
/// `MTi`, two encoders of 500 pulses.
///
/// The document gives no dimension but the laser's height, nor where on the drive the encoders sit. Assumed:
/// a body of 0.9 × 0.7 m, 1.15 m high; wheels, their places and the encoders on them; the laser 0.25 m ahead
/// of the middle.
fn holos() -> SimulatedVehicle {
    let tilt = Attitude {
        pitch_rad: 7.5_f64.to_radians(),
        ..Attitude::default()
    };
    let base_from_laser = Pose::from_parts(Translation3::new(0.25, 0.0, 1.08), tilt.rotation());
    SimulatedVehicle {
        name: "holos",
        radius_m: 0.571, // of the corners of the body
        height_m: 1.15,
        odometry_rate_hz: 100.0,
        chassis: Some(Chassis {
            wheelbase_m: 0.55,
            track_m: 0.60,
            wheel_radius_m: 0.125,
            encoders: Some(WheelEncoders {
                pulses_per_turn: 500,
                rate_hz: 50.0,
            }),
        }),
        attitude_sensor: Some(AttitudeSensor::xsens_mti()),
        laser: PlanarLaser::lms111(base_from_laser),
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
