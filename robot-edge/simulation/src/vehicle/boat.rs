//! Vehicles on water.

use nalgebra::{Point3, Translation3};

use super::{Carriage, LASER_TILT_JOINT, SimulatedVehicle};
use crate::attitude::Attitude;
use crate::attitude_sensor::AttitudeSensor;
use crate::bumper::Body;
use crate::dynamics::{Drag, Drive, TwinThrusters};
use crate::gps::GpsReceiver;
use crate::hull::Hull;
use crate::laser::PlanarLaser;
use crate::range_sensor::{Post, RangeSensor};
use crate::tilt_servo::TiltServo;
use measurement::pose::Pose;

/// The boat of the hybrid perception document [HYB §2.2]: a Nacra 4.5 catamaran of 4.5 × 2.44 m, up to 3 m/s
/// and 0.2 rad/s; SICK LD-LRS2100 that a Dynamixel MX-106 tilts between 0° and 19°; Imagenex 837B Delta T;
/// `ProFlex` 800 receiver good to 2 cm; `PhidgetSpatial`.
///
/// `base_link` lies amidships on the waterline. The document calls the sonar "fixed at a 21° angle", which
/// may be off the horizontal or off its upright frame. Its §8.2.1 compares that with a sonar that points ahead
/// "just like the laser", so it is taken as 21° down from there: the fan reaches 60° to either side of a
/// middle beam that looks ahead and down.
///
/// Assumed: all places of sensors, the mast's height among them; a draught of 0.3 m; the tilt's period of 10 s (the document says
/// "similar angular velocities" of both robots) and its encoder's 50 readings a second; the MX-106's step is
/// its data sheet's, 4096 a turn. 10 Hz for the receiver is that of our experiments.
pub(super) fn riverwatch() -> SimulatedVehicle {
    let servo = TiltServo {
        joint: LASER_TILT_JOINT,
        min_rad: 0.0,
        max_rad: 19.0_f64.to_radians(),
        period_s: 10.0,
        encoder_rate_hz: 50.0,
        encoder_step_rad: std::f64::consts::TAU / 4096.0,
    };
    let sonar_attitude = Attitude {
        pitch_rad: 21.0_f64.to_radians(),
        ..Attitude::default()
    };
    SimulatedVehicle {
        name: "riverwatch",
        radius_m: 2.56, // of the corners of 4.5 × 2.44 m
        height_m: 2.0,
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
            base_from_mount: Pose::translation(0.5, 0.0, 1.9),
            tilt: Some(servo),
            own_posts: &POSTS,
        },
        further_range_sensors: vec![RangeSensor {
            name: "sonar",
            stream: "/sonar",
            planar: PlanarLaser::delta_t_837b(),
            base_from_mount: Pose::from_parts(
                Translation3::new(1.8, 0.0, -0.5),
                sonar_attitude.rotation(),
            ),
            tilt: None,
            own_posts: &[],
        }],
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

/// Two thrusters that push it as fast as the document says, 3 m/s and 0.2 rad/s [HYB §2.2], which gives no more.
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
