//! World files to worlds: what one value cannot say alone is checked here.

use std::sync::Arc;

use nalgebra::{Point2, Vector2};
use toml::Spanned;

use super::World;
use super::fault::Fault;
use super::file::{BoxEntry, Header, ReflectivityEntry, SolidEntry, WallEntry, WorldFile};
use crate::pose::{self, Pose};
use crate::simulation::laser::LaserErrors;
use crate::simulation::path::{Path, PlanarPose, Waypoint};
use crate::simulation::scene::Scene;
use crate::simulation::solid::{Reflectivity, Shape, Solid};
use crate::simulation::vehicle::SimulatedVehicle;

/// The outline of the truth compares each with each.
const MAX_SOLIDS: usize = 2_000;
const MAX_WAYPOINTS: usize = 10_000;
/// Ten days; stamps are good for 292 years.
const MAX_DURATION_S: f64 = 864_000.0;

pub(super) fn build(parsed: WorldFile) -> Result<World, Fault> {
    let WorldFile { header, solids } = parsed;
    let vehicle = vehicle(&header.vehicle)?;
    let path = path(&header)?;
    if let Some(extra) = solids.get(MAX_SOLIDS) {
        return Err(Fault::new(
            extra.span(),
            format!("more than {MAX_SOLIDS} solids"),
        ));
    }
    let solids: Arc<[Solid]> = solids.into_iter().map(solid).collect::<Result<_, _>>()?;
    Ok(World {
        name: header.name,
        vehicle,
        errors: LaserErrors {
            range_noise_m: header.noise.range_m.0,
            dropout: header.noise.dropout.0,
        },
        scene: Arc::new(Scene::new(&solids)),
        solids,
        path: Arc::new(path),
    })
}

fn vehicle(name: &Spanned<String>) -> Result<SimulatedVehicle, Fault> {
    SimulatedVehicle::preset(name.get_ref()).ok_or_else(|| {
        let known = SimulatedVehicle::NAMES.join(", ");
        let message = format!("`{}` cannot be simulated, only {known}", name.get_ref());
        Fault::new(name.span(), message)
    })
}

fn path(header: &Header) -> Result<Path, Fault> {
    let entry = header.path.get_ref();
    if let Some(extra) = entry.waypoints.get(MAX_WAYPOINTS) {
        return Err(Fault::new(
            extra.span(),
            format!("more than {MAX_WAYPOINTS} waypoints"),
        ));
    }
    let start = PlanarPose {
        position_m: Point2::new(header.start.x_m.0, header.start.y_m.0),
        yaw_rad: header.start.yaw_deg.0.to_radians(),
    };
    let waypoints: Vec<Waypoint> = entry
        .waypoints
        .iter()
        .map(Spanned::get_ref)
        .map(|waypoint| Waypoint {
            position_m: Point2::new(waypoint.x_m.0, waypoint.y_m.0),
            speed_mps: waypoint.speed_mps.unwrap_or(entry.speed_mps).0,
            corner_radius_m: waypoint.corner_radius_m.unwrap_or(entry.corner_radius_m).0,
        })
        .collect();
    let turn_rate_radps = entry.turn_rate_degps.0.to_radians();
    let path = Path::new(start, turn_rate_radps, &waypoints).map_err(|error| {
        let at = error
            .waypoint()
            .and_then(|index| entry.waypoints.get(index));
        Fault::new(
            at.map_or(header.path.span(), Spanned::span),
            error.to_string(),
        )
    })?;
    if path.duration_s() > MAX_DURATION_S {
        let message = format!(
            "the path takes {:.0} s, more than {MAX_DURATION_S} s",
            path.duration_s()
        );
        return Err(Fault::new(header.path.span(), message));
    }
    Ok(path)
}

fn solid(entry: Spanned<SolidEntry>) -> Result<Solid, Fault> {
    let span = entry.span();
    match entry.into_inner() {
        SolidEntry::Box(entry) => Ok(box_solid(entry)),
        SolidEntry::Wall(entry) => wall_solid(entry)
            .ok_or_else(|| Fault::new(span, "a wall whose `from_m` and `to_m` are the same")),
    }
}

fn box_solid(entry: BoxEntry) -> Solid {
    let [x, y, z] = entry.centre_m.map(|coordinate| coordinate.0);
    Solid {
        name: entry.name,
        shape: Shape::Box {
            size_m: entry.size_m.map(|length| length.0),
        },
        world_from_solid: raised(pose::planar(x, y, entry.yaw_deg.0.to_radians()), z),
        reflectivity: reflectivity(&entry.reflectivity),
    }
}

/// `None` where the wall has no length.
fn wall_solid(entry: WallEntry) -> Option<Solid> {
    let from_m = Point2::from(entry.from_m.map(|coordinate| coordinate.0));
    let to_m = Point2::from(entry.to_m.map(|coordinate| coordinate.0));
    let along: Vector2<f64> = to_m - from_m;
    let centre_m = nalgebra::center(&from_m, &to_m);
    let yaw_rad = libm::atan2(along.y, along.x);
    let height_m = entry.height_m.0;
    (along.norm() > 0.0).then(|| Solid {
        name: entry.name,
        shape: Shape::Box {
            size_m: [along.norm(), entry.thickness_m.0, height_m],
        },
        world_from_solid: raised(
            pose::planar(centre_m.x, centre_m.y, yaw_rad),
            0.5 * height_m,
        ),
        reflectivity: reflectivity(&entry.reflectivity),
    })
}

fn raised(mut pose: Pose, z_m: f64) -> Pose {
    pose.translation.z = z_m;
    pose
}

fn reflectivity(entry: &ReflectivityEntry) -> Reflectivity {
    match entry {
        ReflectivityEntry::Diffuse => Reflectivity::Diffuse,
        ReflectivityEntry::Specular(specular) => Reflectivity::Specular {
            probability: specular.probability.0,
        },
    }
}
