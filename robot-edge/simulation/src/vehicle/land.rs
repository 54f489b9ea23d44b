//! Vehicles on wheels.

use nalgebra::Translation3;

use super::{Carriage, LASER_TILT_JOINT, SimulatedVehicle};
use crate::attitude::Attitude;
use crate::attitude_sensor::AttitudeSensor;
use crate::bumper::Body;
use crate::chassis::Chassis;
use crate::dynamics::{Axis, Drive, WheelDrive};
use crate::laser::PlanarLaser;
use crate::range_sensor::RangeSensor;
use crate::tilt_servo::TiltServo;
use crate::wheel_encoders::WheelEncoders;
use measurement::pose::{self, Pose};

/// Adept `MobileRobots` Pioneer 3-DX with a Hokuyo URG-04LX-UG01, the robot of the laser range finder
/// document. Data sheet: 455 × 381 × 237 mm, swing radius 26.7 cm, underside 6 cm above the floor, wheels of
/// 19.5 cm, 1.2 m/s, 300°/s. Its firmware accelerates as it is told to; here, invented, by 2 m/s² and 6 rad/s²
/// at most, with a lag of 0.1 s.
pub(super) fn pioneer() -> SimulatedVehicle {
    // The document does not say where its laser sits: here on the front of the top plate.
    let mut base_from_laser = pose::planar(0.16, 0.0, 0.0);
    base_from_laser.translation.z = 0.28;
    SimulatedVehicle {
        name: "pioneer",
        radius_m: 0.27,
        height_m: 0.34,
        odometry_rate_hz: 50.0,
        carriage: Carriage::Level,
        drive: Drive::Wheels(WheelDrive {
            linear: axis(1.2, 2.0, 0.1),
            angular: axis(5.24, 6.0, 0.1),
        }),
        body: Body {
            length_m: 0.455,
            width_m: 0.381,
            lowest_m: 0.06,
            highest_m: 0.34,
        },
        attitude_sensor: None,
        gps: None,
        laser: main_laser(PlanarLaser::urg_04lx_ug01(), base_from_laser, None),
        further_range_sensors: Vec::new(),
    }
}

/// The robot of the elevation map document [LOD ch. 5]: SICK LMS111 at 1.08 m tilted down by 7.5°, Xsens
/// `MTi`, two encoders of 500 pulses.
///
/// The document gives no dimension but the laser's height, nor where on the drive the encoders sit. Assumed:
/// a body of 0.9 × 0.7 m, 1.15 m high; wheels, their places and the encoders on them; the laser 0.25 m ahead
/// of the middle. Invented: a drive for 1 m/s and 1 rad/s, as its preset says, with 1.5 m/s², 3 rad/s² and a lag
/// of 0.15 s.
pub(super) fn holos() -> SimulatedVehicle {
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
        carriage: Carriage::Wheels(Chassis {
            wheelbase_m: 0.55,
            track_m: 0.60,
            wheel_radius_m: 0.125,
            encoders: Some(WheelEncoders {
                pulses_per_turn: 500,
                rate_hz: 50.0,
            }),
        }),
        drive: Drive::Wheels(WheelDrive {
            linear: axis(1.0, 1.5, 0.15),
            angular: axis(1.0, 3.0, 0.15),
        }),
        body: Body {
            length_m: 0.9,
            width_m: 0.7,
            lowest_m: 0.125,
            highest_m: 1.15,
        },
        attitude_sensor: Some(AttitudeSensor::xsens_mti()),
        gps: None,
        laser: main_laser(PlanarLaser::lms111(), base_from_laser, None),
        further_range_sensors: Vec::new(),
    }
}

/// The land robot of the hybrid perception document [HYB §2.1]: 800 × 1500 × 700 mm, four wheels, up to
/// 1.5 m/s; SICK LMS111 over 270° on a Schunk PRL 60; Xsens MTi-G, which gives position and attitude.
///
/// The document gives no more numbers. Assumed: wheels of 0.4 m 1.1 m apart along and 0.65 m across; the
/// laser's optics on the tilt axis, on top of the front end, 0.65 m high; a tilt of 30° up
/// and down in 4 s, which the encoder tells to 0.01° a hundred times a second. The MTi-G's attitude errs like
/// the `MTi`'s of the other robot. Its position is `/odom`; the wheels have no encoders. Invented: 1 rad/s, as its
/// preset says; 1.5 m/s² with a lag of 0.2 s, and 2 rad/s² with one of 0.3 s, since its wheels skid in turns.
pub(super) fn introbot() -> SimulatedVehicle {
    let servo = TiltServo {
        joint: LASER_TILT_JOINT,
        min_rad: -30.0_f64.to_radians(),
        max_rad: 30.0_f64.to_radians(),
        period_s: 4.0,
        encoder_rate_hz: 100.0,
        encoder_step_rad: 0.01_f64.to_radians(),
    };
    SimulatedVehicle {
        name: "introbot",
        radius_m: 0.85, // of the corners of 0.8 × 1.5 m
        height_m: 0.7,
        odometry_rate_hz: 100.0,
        carriage: Carriage::Wheels(Chassis {
            wheelbase_m: 1.1,
            track_m: 0.65,
            wheel_radius_m: 0.2,
            encoders: None,
        }),
        drive: Drive::Wheels(WheelDrive {
            linear: axis(1.5, 1.5, 0.2),
            angular: axis(1.0, 2.0, 0.3),
        }),
        body: Body {
            length_m: 1.5,
            width_m: 0.8,
            lowest_m: 0.2,
            highest_m: 0.7,
        },
        attitude_sensor: Some(AttitudeSensor::xsens_mti()),
        gps: None,
        laser: main_laser(
            PlanarLaser::lms111_270_deg(),
            Pose::translation(0.65, 0.0, 0.65),
            Some(servo),
        ),
        further_range_sensors: Vec::new(),
    }
}

const fn axis(max_speed: f64, max_acceleration: f64, lag_s: f64) -> Axis {
    Axis {
        max_speed,
        max_acceleration,
        lag_s,
    }
}

fn main_laser(planar: PlanarLaser, base_from_mount: Pose, tilt: Option<TiltServo>) -> RangeSensor {
    RangeSensor {
        name: "laser",
        stream: "/scan",
        planar,
        base_from_mount,
        tilt,
        own_posts: &[],
    }
}
