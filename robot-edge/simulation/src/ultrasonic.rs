//! An ultrasonic sensor: the range of the nearest echo in a cone.

use std::f64::consts::TAU;

use measurement::RangeReading;
use measurement::pose::Pose;
use nalgebra::{Point3, Vector3};

use crate::scene::Scene;

/// An ultrasonic sensor on its mount, whose x axis is that of the cone.
#[derive(Clone, Debug, PartialEq)]
pub struct UltrasonicSensor {
    /// Its frame.
    pub name: &'static str,
    pub stream: &'static str,
    pub base_from_sensor: Pose,
    /// Full angle of the cone.
    pub field_of_view_rad: f32,
    pub range_min_m: f32,
    pub range_max_m: f32,
    pub rate_hz: f64,
}

/// Rays of sound are cast along the axis and along so many cones within the cone, …
const RINGS: u32 = 4;
/// … so many along each.
const RAYS_OF_RING: u32 = 16;

/// A surface that is tilted farther, radians, mirrors the sound away; assumed. So the ground gives no echo.
const MAX_INCIDENCE_RAD: f64 = std::f64::consts::FRAC_PI_4;

impl UltrasonicSensor {
    /// What it reads at `time_s`, without errors. Sound returns from glass and mirrors too; plants are not met.
    pub(crate) fn read(
        &self,
        scene: &Scene,
        world_from_sensor: &Pose,
        time_s: f64,
    ) -> RangeReading {
        let origin = Point3::from(world_from_sensor.translation.vector);
        let max_m = f64::from(self.range_max_m);
        let echo_m = |direction: Vector3<f64>| {
            let direction = world_from_sensor.rotation * direction;
            let hit = scene.cast(origin, direction, max_m, time_s)?;
            let is_within = hit.normal == Vector3::zeros();
            let returns = -direction.dot(&hit.normal) >= libm::cos(MAX_INCIDENCE_RAD);
            (is_within || returns).then_some(hit.distance_m)
        };
        let nearest_m = self.directions().filter_map(echo_m).min_by(f64::total_cmp);
        // REP 117.
        let range_m = match nearest_m.map(|nearest_m| nearest_m as f32) {
            Some(range_m) if range_m < self.range_min_m => f32::NEG_INFINITY,
            Some(range_m) if range_m < self.range_max_m => range_m,
            Some(_) | None => f32::INFINITY,
        };
        RangeReading {
            radiation_type: 0,
            field_of_view_rad: self.field_of_view_rad,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            range_m,
        }
    }

    fn directions(&self) -> impl Iterator<Item = Vector3<f64>> {
        let half_rad = 0.5 * f64::from(self.field_of_view_rad);
        let rays = (1..=RINGS).flat_map(|ring| (0..RAYS_OF_RING).map(move |ray| (ring, ray)));
        let around = rays.map(move |(ring, ray)| {
            let off_rad = half_rad * f64::from(ring) / f64::from(RINGS);
            let turn_rad = TAU * f64::from(ray) / f64::from(RAYS_OF_RING);
            let across = libm::sin(off_rad);
            Vector3::new(
                libm::cos(off_rad),
                across * libm::cos(turn_rad),
                across * libm::sin(turn_rad),
            )
        });
        std::iter::once(Vector3::x()).chain(around)
    }
}

#[cfg(test)]
mod tests {
    use measurement::pose;

    use super::*;
    use crate::fixtures::{HEADER, block};
    use crate::world::World;

    fn sensor() -> UltrasonicSensor {
        UltrasonicSensor {
            name: "ultrasonic",
            stream: "/ultrasonic",
            base_from_sensor: Pose::identity(),
            field_of_view_rad: 30.0_f32.to_radians(),
            range_min_m: 0.2,
            range_max_m: 3.0,
            rate_hz: 10.0,
        }
    }

    #[test]
    fn it_reads_the_nearest_surface_that_faces_it_and_follows_rep_117() {
        // Its face is the plane x = 2, 0.4 m wide.
        let post = Scene::new(&[block([2.5, 0.0], [1.0, 0.4, 2.0])]);
        let read = |x_m: f64, y_m: f64, yaw_deg: f64| {
            let mut at = pose::planar(x_m, y_m, yaw_deg.to_radians());
            at.translation.z = 0.5;
            sensor().read(&post, &at, 0.0).range_m
        };
        for (x_m, y_m, yaw_deg, expected_m) in [
            (0.0, 0.0, 0.0, 2.0),
            (1.0, 0.0, 14.0, 1.0),           // within the cone, off its axis
            (1.0, 0.0, 60.0, f32::INFINITY), // out of the cone
            (-1.1, 0.0, 0.0, f32::INFINITY), // too far
            (1.85, 0.0, 0.0, f32::NEG_INFINITY), // too near
            (2.5, 0.0, 0.0, f32::NEG_INFINITY), // within it
        ] {
            let range_m = read(x_m, y_m, yaw_deg);
            let is_expected =
                range_m.total_cmp(&expected_m).is_eq() || (range_m - expected_m).abs() < 2e-3;
            assert!(is_expected, "{x_m} {y_m} {yaw_deg}: {range_m}");
        }
    }

    #[test]
    fn glass_returns_sound_and_the_ground_does_not() {
        let world = |solid: &str| {
            let text = format!("{HEADER}\n[[solids]]\n{solid}\n");
            World::parse("w.toml", &text).unwrap()
        };
        let mut at = Pose::identity();
        at.translation.z = 0.3;
        let read = |solid: &str| sensor().read(world(solid).scene(), &at, 0.0).range_m;
        let pane = "shape = \"box\"\ncentre_m = [1.5, 0, 1]\nsize_m = [0.01, 4, 2]\n\
                    reflectivity.glass = { transmission = 0.99 }";
        assert!((read(pane) - 1.495).abs() < 1e-3, "{}", read(pane));
        assert_eq!(read("shape = \"plane\"").to_bits(), f32::INFINITY.to_bits());
    }
}
