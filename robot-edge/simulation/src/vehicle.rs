//! The vehicles that can be simulated, by the names of their presets.

use std::collections::VecDeque;
use std::f64::consts::PI;

use measurement::pose;
use measurement::pose::Pose;
use nalgebra::{Point3, Translation3, UnitQuaternion};

use crate::attitude::Attitude;
use crate::attitude_sensor::AttitudeSensor;
use crate::bumper::{Body, ContactSensor};
use crate::chassis::Chassis;
use crate::dynamics::{Axis, Drag, Drive, TwinThrusters, WheelDrive};
use crate::gps::GpsReceiver;
use crate::laser::{PlanarLaser, Post, RangeSensor};
use crate::tilt_servo::TiltServo;
use crate::ultrasonic::UltrasonicSensor;
use crate::waves::Hull;
use crate::wheel_encoders::WheelEncoders;

/// A vehicle's simulated properties.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedVehicle {
    /// Name of the preset in `vehicles/`.
    pub name: &'static str,
    /// How often it reports its pose, hertz.
    pub odometry_rate_hz: f64,
    /// Wheels or hull.
    pub carriage: Carriage,
    /// Its drive, used when commands drive it.
    pub drive: Drive,
    /// Body for collisions.
    pub body: Body,
    /// Its AHRS, at `base_link` and with its axes.
    pub attitude_sensor: Option<AttitudeSensor>,
    /// Its satellite receiver.
    pub gps: Option<GpsReceiver>,
    /// Its main laser.
    pub laser: RangeSensor,
    /// Its other range sensors.
    pub further_range_sensors: Vec<RangeSensor>,
    /// Its ring of ultrasonic sensors.
    pub ultrasonic_sensors: Vec<UltrasonicSensor>,
    /// Its bumpers.
    pub contact_sensors: Vec<ContactSensor>,
}

/// Wheels or hull of a vehicle.
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
    pub(crate) const fn chassis(&self) -> Option<Chassis> {
        match *self {
            Self::Wheels(chassis) => Some(chassis),
            Self::Level | Self::Hull(_) => None,
        }
    }
}

impl SimulatedVehicle {
    /// Names of all vehicles.
    pub const NAMES: &[&str] = &[
        "pioneer",
        "holos",
        "holos-tilt",
        "introbot",
        "riverwatch",
        "riverwatch-lidar",
        "lidar16",
        "lidar64",
    ];

    /// The vehicle called `name`; `None` if there is none.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "pioneer" => Some(pioneer()),
            "holos" => Some(holos()),
            "holos-tilt" => Some(holos_tilt()),
            "introbot" => Some(introbot()),
            "riverwatch" => Some(riverwatch()),
            "riverwatch-lidar" => Some(riverwatch_lidar()),
            "lidar16" => Some(with_lidar(
                "lidar16",
                PlanarLaser::vlp_16(),
                rings_rad(16, 15.0),
            )),
            "lidar64" => Some(with_lidar(
                "lidar64",
                PlanarLaser::os1_64(),
                // Data sheet: 45°; the lasers of one sensor span 42.4°.
                rings_rad(64, 22.5),
            )),
            _ => None,
        }
    }

    /// The main laser first.
    pub(crate) fn range_sensors(&self) -> impl Iterator<Item = &RangeSensor> {
        std::iter::once(&self.laser).chain(&self.further_range_sensors)
    }
}

/// Name of the joint of every tilting laser.
const LASER_TILT_JOINT: &str = "laser_tilt_joint";

/// Adept `MobileRobots` Pioneer 3-DX with a Hokuyo URG-04LX-UG01, the robot of the laser range finder
/// document. Data sheet: 455 × 381 × 237 mm, swing radius 26.7 cm, underside 6 cm above the floor, wheels of
/// 19.5 cm, 1.2 m/s, 300°/s. Its firmware's acceleration is a setting; here, invented, by 2 m/s² and 6 rad/s²
/// at most, with a lag of 0.1 s.
fn pioneer() -> SimulatedVehicle {
    // The document does not give the place of its laser: here on the front of the top plate.
    let mut base_from_laser = pose::planar(0.16, 0.0, 0.0);
    base_from_laser.translation.z = 0.28;
    SimulatedVehicle {
        name: "pioneer",
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
        ultrasonic_sensors: Vec::new(),
        contact_sensors: Vec::new(),
    }
}

/// The robot of the elevation map document [LOD ch. 5]: SICK LMS111 at 1.08 m tilted down by 7.5°, Xsens
/// `MTi`, two encoders of 500 pulses.
///
/// The document gives no dimension but the laser's height, nor where on the drive the encoders sit. Assumed:
/// a body of 0.9 × 0.7 m, 1.15 m high; wheels, their places and the encoders on them; the laser 0.25 m ahead
/// of the middle. Invented: a drive for 1 m/s and 1 rad/s, as in its preset, with 1.5 m/s², 3 rad/s² and a lag
/// of 0.15 s.
fn holos() -> SimulatedVehicle {
    let tilt = Attitude {
        pitch_rad: 7.5_f64.to_radians(),
        ..Attitude::default()
    };
    let base_from_laser = Pose::from_parts(Translation3::new(0.25, 0.0, 1.08), tilt.rotation());
    SimulatedVehicle {
        name: "holos",
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
        ultrasonic_sensors: Vec::new(),
        contact_sensors: Vec::new(),
    }
}

/// The Holos with its laser level on a servo that turns it from there to 55° down (\[LOD\] §6.2 asks for one).
/// Invented: a ROBOTIS XM430, 4096 steps a turn, read 50 times a second and limited to 90°/s.
fn holos_tilt() -> SimulatedVehicle {
    let holos = holos();
    let (min_rad, max_rad): (f64, f64) = (0.0, 55.0_f64.to_radians());
    let servo = TiltServo {
        joint: LASER_TILT_JOINT,
        min_rad,
        max_rad,
        // Of which 0.8 are at an even rate.
        period_s: 2.0 * 55.0 / (90.0 * 0.8),
        encoder_rate_hz: 50.0,
        encoder_step_rad: std::f64::consts::TAU / 4096.0,
        turns: VecDeque::new(),
    };
    let place = holos.laser.base_from_mount.translation;
    let base_from_laser = Pose::from_parts(place, UnitQuaternion::identity());
    SimulatedVehicle {
        name: "holos-tilt",
        laser: main_laser(PlanarLaser::lms111(), base_from_laser, Some(servo)),
        ..holos
    }
}

/// The land robot of the hybrid perception document [HYB §2.1]: 800 × 1500 × 700 mm, four wheels, up to
/// 1.5 m/s; SICK LMS111 over 270° on a Schunk PRL 60; Xsens MTi-G, which gives position and attitude.
///
/// The document gives no more numbers. Assumed: wheels of 0.4 m 1.1 m apart along and 0.65 m across; the
/// laser's optics on the tilt axis, on top of the front end, 0.65 m high; a tilt of 30° up
/// and down in 4 s, which the encoder reads to 0.01° a hundred times a second. The MTi-G's attitude errs like
/// the `MTi`'s of the other robot. Its position is `/odom`; the wheels have no encoders. Invented: 1 rad/s, as its
/// preset has it; 1.5 m/s² with a lag of 0.2 s, and 2 rad/s² with one of 0.3 s, since its wheels skid in turns; of its
/// "additional ultrasonic sensors" all numbers; the bumpers, which the document has not (§9.1 wishes for one).
fn introbot() -> SimulatedVehicle {
    let servo = TiltServo {
        joint: LASER_TILT_JOINT,
        min_rad: -30.0_f64.to_radians(),
        max_rad: 30.0_f64.to_radians(),
        period_s: 4.0,
        encoder_rate_hz: 100.0,
        encoder_step_rad: 0.01_f64.to_radians(),
        turns: VecDeque::new(),
    };
    SimulatedVehicle {
        name: "introbot",
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
        ultrasonic_sensors: RING.map(ultrasonic_sensor).into(),
        contact_sensors: vec![
            bumper("/bumper/front", pose::planar(0.75, 0.0, 0.0)),
            bumper("/bumper/rear", pose::planar(-0.75, 0.0, PI)),
        ],
    }
}

/// Name, stream, place and direction: x, y in metres, yaw in degrees.
type Place = (&'static str, &'static str, [f64; 3]);

/// Two ahead, one to each side, two astern.
const RING: [Place; 6] = [
    (
        "ultrasonic_front_left",
        "/ultrasonic/front_left",
        [0.75, 0.25, 0.0],
    ),
    (
        "ultrasonic_front_right",
        "/ultrasonic/front_right",
        [0.75, -0.25, 0.0],
    ),
    ("ultrasonic_left", "/ultrasonic/left", [0.3, 0.4, 90.0]),
    ("ultrasonic_right", "/ultrasonic/right", [0.3, -0.4, -90.0]),
    (
        "ultrasonic_rear_left",
        "/ultrasonic/rear_left",
        [-0.75, 0.25, 180.0],
    ),
    (
        "ultrasonic_rear_right",
        "/ultrasonic/rear_right",
        [-0.75, -0.25, 180.0],
    ),
];

/// 0.4 m above the ground, a cone of 30°, 0.2 to 3 m, ten readings a second.
fn ultrasonic_sensor((name, stream, [x_m, y_m, yaw_deg]): Place) -> UltrasonicSensor {
    let mut base_from_sensor = pose::planar(x_m, y_m, yaw_deg.to_radians());
    base_from_sensor.translation.z = 0.4;
    UltrasonicSensor {
        name,
        stream,
        base_from_sensor,
        field_of_view_rad: 30.0_f32.to_radians(),
        range_min_m: 0.2,
        range_max_m: 3.0,
        rate_hz: 10.0,
    }
}

fn bumper(stream: &'static str, base_from_face: Pose) -> ContactSensor {
    ContactSensor {
        stream,
        base_from_face,
        width_m: 0.8,
        rate_hz: 20.0,
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
        rings_rad: Vec::new(),
        base_from_mount,
        tilt,
        own_posts: &[],
    }
}

fn lidar(planar: PlanarLaser, rings_rad: Vec<f64>, base_from_mount: Pose) -> RangeSensor {
    RangeSensor {
        name: "lidar",
        stream: "/points",
        planar,
        rings_rad,
        base_from_mount,
        tilt: None,
        own_posts: &[],
    }
}

/// So many lasers at equal steps from as far below the level to as far above it.
fn rings_rad(rings: u32, highest_deg: f64) -> Vec<f64> {
    let step_deg = 2.0 * highest_deg / f64::from(rings - 1);
    let ring_deg = |ring| f64::from(ring) * step_deg - highest_deg;
    (0..rings).map(|ring| ring_deg(ring).to_radians()).collect()
}

/// A Clearpath Husky A200 with a rotating lidar on a mast. User manual: 990 × 670 × 390 mm, 130 mm of ground clearance, 1.0 m/s; its URDF:
/// wheels of 0.33 m, 0.512 m apart along and 0.571 m across.
///
/// Assumed: the mast, by which the lidar looks from 0.8 m and the top is at 0.9 m. Invented: 1 rad/s, as its preset has it; 2 m/s² and
/// 3 rad/s² with a lag of 0.2 s.
fn with_lidar(name: &'static str, planar: PlanarLaser, rings_rad: Vec<f64>) -> SimulatedVehicle {
    SimulatedVehicle {
        name,
        odometry_rate_hz: 100.0,
        carriage: Carriage::Wheels(Chassis {
            wheelbase_m: 0.512,
            track_m: 0.571,
            wheel_radius_m: 0.165,
            encoders: None,
        }),
        drive: Drive::Wheels(WheelDrive {
            linear: axis(1.0, 2.0, 0.2),
            angular: axis(1.0, 3.0, 0.2),
        }),
        body: Body {
            length_m: 0.99,
            width_m: 0.67,
            lowest_m: 0.13,
            highest_m: 0.9,
        },
        attitude_sensor: None,
        gps: None,
        laser: lidar(planar, rings_rad, Pose::translation(0.0, 0.0, 0.8)),
        further_range_sensors: Vec::new(),
        ultrasonic_sensors: Vec::new(),
        contact_sensors: Vec::new(),
    }
}

/// The boat of the hybrid perception document [HYB §2.2]: a Nacra 4.5 catamaran of 4.5 × 2.44 m, up to 3 m/s
/// and 0.2 rad/s; SICK LD-LRS2100 that a Dynamixel MX-106 tilts between 0° and 19°; Imagenex 837B Delta T;
/// `ProFlex` 800 receiver good to 2 cm; `PhidgetSpatial`.
///
/// `base_link` lies amidships on the waterline. The document calls the sonar "fixed at a 21° angle", which
/// may be off the horizontal or off its upright frame. Its §8.2.1 compares that with a sonar that points ahead
/// "just like the laser", so it is taken as 21° down from there: the fan reaches 60° to either side of a
/// middle beam that looks ahead and down.
///
/// Assumed: all places of sensors, the mast's height among them; a draught of 0.3 m; the tilt's period of 10 s (the document has
/// "similar angular velocities" of both robots) and its encoder's 50 readings a second; the MX-106's step is
/// its data sheet's, 4096 a turn. 10 Hz for the receiver is that of our experiments.
fn riverwatch() -> SimulatedVehicle {
    let servo = TiltServo {
        joint: LASER_TILT_JOINT,
        min_rad: 0.0,
        max_rad: 19.0_f64.to_radians(),
        period_s: 10.0,
        encoder_rate_hz: 50.0,
        encoder_step_rad: std::f64::consts::TAU / 4096.0,
        turns: VecDeque::new(),
    };
    let sonar_attitude = Attitude {
        pitch_rad: 21.0_f64.to_radians(),
        ..Attitude::default()
    };
    SimulatedVehicle {
        name: "riverwatch",
        odometry_rate_hz: 50.0,
        carriage: Carriage::Hull(Hull {
            length_m: 4.5,
            width_m: 2.44,
        }),
        drive: Drive::Thrusters(thrusters()),
        body: Body {
            length_m: 4.5,
            width_m: 2.44,
            lowest_m: -0.3,
            highest_m: 2.0,
        },
        attitude_sensor: Some(AttitudeSensor::phidget_spatial()),
        gps: Some(GpsReceiver {
            rate_hz: 10.0,
            antenna_m: Point3::new(-0.5, 0.0, 1.5),
            noise_m: 0.02,
        }),
        laser: RangeSensor {
            name: "laser",
            stream: "/scan",
            planar: PlanarLaser::ld_lrs2100(),
            rings_rad: Vec::new(),
            base_from_mount: Pose::translation(0.5, 0.0, 1.9),
            tilt: Some(servo),
            own_posts: &POSTS,
        },
        further_range_sensors: vec![RangeSensor {
            name: "sonar",
            stream: "/sonar",
            planar: PlanarLaser::delta_t_837b(),
            rings_rad: Vec::new(),
            base_from_mount: Pose::from_parts(
                Translation3::new(1.8, 0.0, -0.5),
                sonar_attitude.rotation(),
            ),
            tilt: None,
            own_posts: &[],
        }],
        ultrasonic_sensors: Vec::new(),
        contact_sensors: Vec::new(),
    }
}

/// The boat with a Velodyne VLP-16 on its mast, in place of laser and sonar.
fn riverwatch_lidar() -> SimulatedVehicle {
    let boat = riverwatch();
    SimulatedVehicle {
        name: "riverwatch-lidar",
        laser: lidar(
            PlanarLaser::vlp_16(),
            rings_rad(16, 15.0),
            boat.laser.base_from_mount,
        ),
        further_range_sensors: Vec::new(),
        ..boat
    }
}

/// Beside the laser, which sees them at every tilt: its axis points at them. Invented; the lights of a boat stand there. By
/// their echoes the collision monitor knows on open water that the laser is not covered.
const POSTS: [Post; 2] = [post(1.15), post(-1.15)];

const fn post(y_m: f64) -> Post {
    Post {
        at_m: [0.5, y_m],
        radius_m: 0.025,
        heights_m: [0.3, 2.0],
    }
}

/// Two thrusters that push it as fast as in the document, 3 m/s and 0.2 rad/s [HYB §2.2], which gives no more.
///
/// What resists is that of a catamaran of the same size, the 4.9 m × 2.4 m WAM-V as Virtual `RobotX` simulates it:
/// 180 kg, 446 kg m², drag of 51.3 and 72.4 (surge, linear and squared) and 400 (yaw, linear) in SI units, hulls
/// 1.03 m from the middle. Invented: three times the drag sideways, since its 40 is far less than that ahead; half
/// of the thrust astern; a lag of 0.3 s.
fn thrusters() -> TwinThrusters {
    let (mass_kg, inertia_kgm2) = (180.0, 446.0);
    let surge_drag = Drag {
        linear_per_s: 51.3 / mass_kg,
        quadratic: 72.4 / mass_kg,
    };
    TwinThrusters {
        max_speed_mps: 3.0,
        max_turn_rate_radps: 0.2,
        surge_drag,
        sway_drag: Drag {
            linear_per_s: 3.0 * surge_drag.linear_per_s,
            quadratic: 3.0 * surge_drag.quadratic,
        },
        yaw_drag: Drag {
            linear_per_s: 400.0 / inertia_kgm2,
            quadratic: 0.0,
        },
        lever_radpm: 1.03 * mass_kg / inertia_kgm2,
        astern: 0.5,
        lag_s: 0.3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_streams_and_joints_of_a_vehicle_are_unique() {
        for name in SimulatedVehicle::NAMES {
            let vehicle = SimulatedVehicle::preset(name).unwrap();
            assert_eq!(vehicle.name, *name);
            let sensors = vehicle.range_sensors();
            let mut names: Vec<_> = sensors
                .flat_map(|s| {
                    [
                        Some(s.name),
                        Some(s.stream),
                        s.tilt.as_ref().map(|servo| servo.joint),
                    ]
                })
                .flatten()
                .collect();
            let all = names.len();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), all, "{name}");
        }
    }
}
