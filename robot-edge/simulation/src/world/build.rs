//! World files to worlds: what one value cannot say alone is checked here.

mod plants;
mod solids;

use std::sync::Arc;

use nalgebra::Point2;
use toml::Spanned;

use super::World;
use super::fault::Fault;
use super::file::{DockEntry, Header, ShoreClassEntry, ShoreEntry, WaveTrainEntry, WorldFile};
use super::number::Coordinate;
use crate::laser::LaserErrors;
use crate::path::{Path, PlanarPose, Waypoint};
use crate::scene::Scene;
use crate::solid::Solid;
use crate::truth::shores::{Dock, Shore, ShoreClass};
use crate::vehicle::{Carriage, SimulatedVehicle};
use crate::waves::{WaveTrain, Waves};

const MAX_WAYPOINTS: usize = 10_000;
/// Ten days; stamps are good for 292 years.
const MAX_DURATION_S: f64 = 864_000.0;

pub(super) fn build(parsed: WorldFile) -> Result<World, Fault> {
    let WorldFile {
        header,
        solids,
        plants,
    } = parsed;
    let mut vehicle = vehicle(&header.vehicle)?;
    if let Some(divergence) = header.noise.beam_divergence_mrad {
        vehicle.laser.planar.beam_divergence_rad = 1e-3 * divergence.0;
    }
    let path = path(&header)?;
    let waves = waves(&header, &vehicle)?;
    let is_ground: Arc<[bool]> = solids.iter().map(solids::is_ground).collect();
    let solids = solids::build(solids)?;
    let ground = Scene::new(&ground_of(&solids, &is_ground));
    let mut scene = Scene::new(&solids);
    if let Some(growth) = plants::build(&plants, &header, &ground)? {
        scene = scene.with_growth(growth);
    }
    let water_m = header.water.as_ref().map(|water| water.level_m.0);
    if let Some(level_m) = water_m {
        scene = scene.with_water(level_m);
    }
    let shores = shores(&header.shores)?;
    let docks = docks(&header.docks)?;
    let own_attitude_noise_rad = vehicle.attitude_sensor.map_or(0.0, |ahrs| ahrs.noise_rad);
    let own_fix_noise_m = vehicle.gps.map_or(0.0, |receiver| receiver.noise_m);
    Ok(World {
        name: header.name,
        attitude_noise_rad: header
            .noise
            .attitude_deg
            .map_or(own_attitude_noise_rad, |deg| deg.0.to_radians()),
        encoder_scale_error: header.noise.encoder_scale_error.0,
        joint_lag_s: header.noise.joint_lag_s.0,
        laser_covered_s: header
            .noise
            .laser_covered_s
            .map(|span_s| span_s.map(|at_s| at_s.0)),
        fix_noise_m: header.noise.fix_m.map_or(own_fix_noise_m, |fix_m| fix_m.0),
        vehicle,
        errors: LaserErrors {
            range_noise_m: header.noise.range_m.0,
            dropout: header.noise.dropout.0,
            mixed_pixels: header.noise.mixed_pixels.0,
        },
        scene: Arc::new(scene),
        solids,
        is_ground,
        water_m,
        shores,
        docks,
        path: Arc::new(path),
        waves: Arc::new(waves),
    })
}

/// What is ground and stands still.
fn ground_of(solids: &[Solid], is_ground: &[bool]) -> Vec<Solid> {
    let still_ground = |(solid, is_ground): &(&Solid, &bool)| **is_ground && solid.motion.is_none();
    solids
        .iter()
        .zip(is_ground)
        .filter(still_ground)
        .map(|(solid, _)| solid.clone())
        .collect()
}

fn shores(entries: &[ShoreEntry]) -> Result<Arc<[Shore]>, Fault> {
    let shore = |entry: &ShoreEntry| {
        Ok(Shore {
            name: entry.name.clone(),
            class: match entry.class {
                ShoreClassEntry::Sparse => ShoreClass::Sparse,
                ShoreClassEntry::Dense => ShoreClass::Dense,
                ShoreClassEntry::Solid => ShoreClass::Solid,
            },
            polygon_m: polygon(&entry.polygon_m)?,
        })
    };
    entries.iter().map(shore).collect()
}

fn docks(entries: &[DockEntry]) -> Result<Arc<[Dock]>, Fault> {
    let dock = |entry: &DockEntry| {
        Ok(Dock {
            name: entry.name.clone(),
            polygon_m: polygon(&entry.polygon_m)?,
        })
    };
    entries.iter().map(dock).collect()
}

fn polygon(corners: &Spanned<Vec<[Coordinate; 2]>>) -> Result<Vec<Point2<f64>>, Fault> {
    plants::polygon(corners.get_ref()).map_err(|message| Fault::new(corners.span(), message))
}

fn vehicle(name: &Spanned<String>) -> Result<SimulatedVehicle, Fault> {
    SimulatedVehicle::preset(name.get_ref()).ok_or_else(|| {
        let known = SimulatedVehicle::NAMES.join(", ");
        let message = format!("`{}` cannot be simulated, only {known}", name.get_ref());
        Fault::new(name.span(), message)
    })
}

fn waves(header: &Header, vehicle: &SimulatedVehicle) -> Result<Waves, Fault> {
    let Some(entry) = &header.waves else {
        return Ok(Waves::default());
    };
    if !matches!(vehicle.carriage, Carriage::Hull(_)) {
        let message = format!("waves move boats only, and `{}` is none", vehicle.name);
        return Err(Fault::new(entry.span(), message));
    }
    let entry = entry.get_ref();
    let first = WaveTrainEntry {
        height_m: entry.height_m.clone(),
        period_s: entry.period_s,
        heading_deg: entry.heading_deg,
    };
    let trains: Vec<WaveTrain> = std::iter::once(&first)
        .chain(&entry.second)
        .map(wave_train)
        .collect::<Result<_, _>>()?;
    Ok(Waves::new(&trains))
}

fn wave_train(entry: &WaveTrainEntry) -> Result<WaveTrain, Fault> {
    let train = WaveTrain {
        height_m: entry.height_m.get_ref().0,
        period_s: entry.period_s.0,
        heading_rad: entry.heading_deg.0.to_radians(),
    };
    let most_m = train.greatest_height_m();
    if train.height_m > most_m {
        let message = format!(
            "waves of {} s break above {most_m:.2} m, a seventh of their length",
            train.period_s
        );
        return Err(Fault::new(entry.height_m.span(), message));
    }
    Ok(train)
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
