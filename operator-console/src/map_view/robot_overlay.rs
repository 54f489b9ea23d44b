//! What is drawn on the map and is not in it: plain data, from whoever knows it.

use std::time::Duration;

use eframe::egui::Color32;

/// Around and about the vehicle that is shown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RobotOverlay {
    /// How it would stop; without it nothing is said of that.
    pub stopping: Option<Stopping>,
    /// What its sensors see.
    pub sensors: Vec<SensorField>,
    /// The newest scan.
    pub scan: Option<LastScan>,
    /// The colour of the robot that is shown, where there are several.
    pub color: Option<Color32>,
}

/// What decides how far a vehicle still goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stopping {
    /// How hard it brakes, m/s².
    pub decel_mps2: f64,
    /// How old the command is that it obeys, seconds.
    pub command_age_s: f64,
}

/// A sensor on the vehicle.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorField {
    /// Where it is in the vehicle's frame: along x and y, metres.
    pub mount_m: [f64; 2],
    /// Where its middle looks, radians, counter-clockwise from the vehicle's x.
    pub mount_rad: f64,
    /// The whole angle that it sees, radians; a full circle or more is a circle.
    pub field_rad: f64,
    /// The nearest and the farthest that it sees, metres.
    pub range_m: [f64; 2],
}

/// Where beams hit.
#[derive(Clone, Debug, PartialEq)]
pub struct LastScan {
    /// Metres in `odom`.
    pub points_m: Vec<[f64; 2]>,
    /// Since the scan was taken.
    pub age: Duration,
}
