//! World files to worlds: what one value cannot say alone is checked here.

mod solids;

use std::sync::Arc;

use nalgebra::Point2;
use toml::Spanned;

use super::World;
use super::fault::Fault;
use super::file::{Header, WorldFile};
use crate::simulation::laser::LaserErrors;
use crate::simulation::path::{Path, PlanarPose, Waypoint};
use crate::simulation::scene::Scene;
use crate::simulation::vehicle::SimulatedVehicle;

const MAX_WAYPOINTS: usize = 10_000;
/// Ten days; stamps are good for 292 years.
const MAX_DURATION_S: f64 = 864_000.0;

pub(super) fn build(parsed: WorldFile) -> Result<World, Fault> {
    let WorldFile { header, solids } = parsed;
    let mut vehicle = vehicle(&header.vehicle)?;
    if let Some(divergence) = header.noise.beam_divergence_mrad {
        vehicle.laser.beam_divergence_rad = 1e-3 * divergence.0;
    }
    let path = path(&header)?;
    let solids = solids::build(solids)?;
    let own_attitude_noise_rad = vehicle.attitude_sensor.map_or(0.0, |ahrs| ahrs.noise_rad);
    Ok(World {
        name: header.name,
        attitude_noise_rad: header
            .noise
            .attitude_deg
            .map_or(own_attitude_noise_rad, |deg| deg.0.to_radians()),
        encoder_scale_error: header.noise.encoder_scale_error.0,
        vehicle,
        errors: LaserErrors {
            range_noise_m: header.noise.range_m.0,
            dropout: header.noise.dropout.0,
            mixed_pixels: header.noise.mixed_pixels.0,
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
