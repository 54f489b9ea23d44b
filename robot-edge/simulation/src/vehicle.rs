//! The vehicles that can be simulated, by the names of their presets.

mod boat;
mod land;

use crate::attitude_sensor::AttitudeSensor;
use crate::bumper::Body;
use crate::chassis::Chassis;
use crate::dynamics::Drive;
use crate::gps::GpsReceiver;
use crate::hull::Hull;
use crate::range_sensor::RangeSensor;

/// What the simulation needs to know of a vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedVehicle {
    /// Name of the preset in `vehicles/`.
    pub name: &'static str,
    /// Radius of the circle about `base_link` that holds the vehicle at any yaw, metres.
    pub radius_m: f64,
    /// Height above the ground or the water, metres.
    pub height_m: f64,
    /// How often it reports its pose, hertz.
    pub odometry_rate_hz: f64,
    /// What it moves on.
    pub carriage: Carriage,
    /// What moves it where somebody drives it.
    pub drive: Drive,
    /// What it cannot drive through walls with.
    pub body: Body,
    /// Its AHRS, at `base_link` and with its axes.
    pub attitude_sensor: Option<AttitudeSensor>,
    /// Its satellite receiver.
    pub gps: Option<GpsReceiver>,
    /// Its main laser.
    pub laser: RangeSensor,
    /// Its other range sensors.
    pub further_range_sensors: Vec<RangeSensor>,
}

/// What a vehicle moves on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Carriage {
    /// Wheels that are not simulated: it stays level at z = 0 whatever it drives over.
    Level,
    /// Wheels on uneven ground.
    Wheels(Chassis),
    /// A hull on water.
    Hull(Hull),
}

impl Carriage {
    /// The chassis, where it has one.
    pub const fn chassis(&self) -> Option<Chassis> {
        match *self {
            Self::Wheels(chassis) => Some(chassis),
            Self::Level | Self::Hull(_) => None,
        }
    }
}

impl SimulatedVehicle {
    /// Names of all vehicles.
    pub const NAMES: &[&str] = &["pioneer", "holos", "introbot", "riverwatch"];

    /// The vehicle called `name`; `None` where there is none.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "pioneer" => Some(land::pioneer()),
            "holos" => Some(land::holos()),
            "introbot" => Some(land::introbot()),
            "riverwatch" => Some(boat::riverwatch()),
            _ => None,
        }
    }

    /// All its range sensors, the main laser first.
    pub fn range_sensors(&self) -> impl Iterator<Item = &RangeSensor> {
        std::iter::once(&self.laser).chain(&self.further_range_sensors)
    }
}

/// Name of the joint of every tilting laser.
const LASER_TILT_JOINT: &str = "laser_tilt_joint";

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

    #[test]
    fn sensors_of_a_vehicle_have_names_streams_and_joints_of_their_own() {
        for name in SimulatedVehicle::NAMES {
            let vehicle = SimulatedVehicle::preset(name).unwrap();
            let mut names: Vec<_> = vehicle
                .range_sensors()
                .flat_map(|sensor| [Some(sensor.name), Some(sensor.stream), joint(sensor)])
                .flatten()
                .collect();
            let all = names.len();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), all, "{name}");
        }
    }

    fn joint(sensor: &RangeSensor) -> Option<&'static str> {
        sensor.tilt.map(|servo| servo.joint)
    }
}
