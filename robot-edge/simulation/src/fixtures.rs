//! Solids, paths and vehicles for tests.

use std::sync::Arc;

use measurement::pose::Pose;
use nalgebra::Point2;

use crate::attitude::Attitude;
use crate::chassis::Chassis;
use crate::motion::Motion;
use crate::path::{Path, PlanarPose, Waypoint};
use crate::scene::Scene;
use crate::solid::{Reflectivity, Shape, Solid};
use crate::vehicle::SimulatedVehicle;

/// Beginning of a world file of 5 lines.
pub(crate) const HEADER: &str = r#"name = "w"
vehicle = "pioneer"
noise = { range_m = 0.0, dropout = 0.0 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 0.0 }
path = { speed_mps = 1.0, turn_rate_degps = 60.0, waypoints = [{ x_m = 1.0, y_m = 0.0 }] }
"#;

pub(crate) fn solid(shape: Shape, world_from_solid: Pose) -> Solid {
    Solid {
        name: String::new(),
        shape,
        world_from_solid,
        reflectivity: Reflectivity::Diffuse,
        motion: None,
        is_ground: false,
    }
}

pub(crate) fn a_box([x, y, z]: [f64; 3], size_m: [f64; 3]) -> Solid {
    solid(Shape::Box { size_m }, Pose::translation(x, y, z))
}

/// A box that stands on z = 0.
pub(crate) fn block([x, y]: [f64; 2], size_m: [f64; 3]) -> Solid {
    a_box([x, y, 0.5 * size_m[2]], size_m)
}

/// A slab about the origin of its top; positive pitch falls to the front.
pub(crate) fn slope(pitch_deg: f64) -> Solid {
    let attitude = Attitude {
        pitch_rad: pitch_deg.to_radians(),
        ..Attitude::default()
    };
    let mut slab = a_box([0.0; 3], [60.0, 60.0, 1.0]);
    slab.world_from_solid.rotation = attitude.rotation();
    slab.world_from_solid *= nalgebra::Translation3::new(0.0, 0.0, -0.5);
    slab
}

pub(crate) fn vehicle(name: &str) -> SimulatedVehicle {
    SimulatedVehicle::preset(name).unwrap()
}

pub(crate) fn holos() -> Chassis {
    vehicle("holos").carriage.chassis().unwrap()
}

/// From the origin at 0.5 m/s, turning at 1 rad/s, through x, y and corner radius of each waypoint.
pub(crate) fn path(waypoints: &[[f64; 3]]) -> Arc<Path> {
    let waypoint = |&[x, y, corner_radius_m]: &[f64; 3]| Waypoint {
        position_m: Point2::new(x, y),
        speed_mps: 0.5,
        corner_radius_m,
    };
    let waypoints: Vec<Waypoint> = waypoints.iter().map(waypoint).collect();
    Arc::new(Path::new(PlanarPose::default(), 1.0, &waypoints).unwrap())
}

/// A vehicle along a path among solids, on still water if it is a boat.
pub(crate) fn motion(vehicle_name: &str, path: Arc<Path>, solids: &[Solid]) -> Motion {
    let carriage = vehicle(vehicle_name).carriage;
    let scene = Arc::new(Scene::new(solids));
    Motion::along(path, carriage, scene, Arc::default(), 0.0)
}

#[track_caller]
pub(crate) fn check<const N: usize>(found: [f64; N], expected: [f64; N], within: f64) {
    let mut pairs = found.iter().zip(expected);
    assert!(
        pairs.all(|(found, expected)| (found - expected).abs() <= within),
        "{found:?} is not {expected:?}"
    );
}
