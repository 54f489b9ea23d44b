//! The format of world files: TOML, every key known, every error with its line.
//!
//! x, y and z are those of the world, z is up. Angles are those of a sensor's mount: roll about x, then
//! pitch about y, then yaw about z; positive pitch is nose down.
//!
//! ```toml
//! name = "yard"
//! vehicle = "holos"                   # a vehicle preset
//! start = { x_m = 0.0, y_m = 0.0, yaw_deg = 90.0 }
//!
//! [noise]
//! range_m = 0.01                      # standard deviation
//! dropout = 0.005                     # probability per beam
//! mixed_pixels = 0.3                  # default 0: probability per beam whose spot straddles an edge
//! beam_divergence_mrad = 15.0         # default: of the laser's data sheet; full angle, 0 is a line
//! attitude_deg = 0.1                  # standard deviation; default: that of the vehicle's AHRS
//! encoder_scale_error = 0.048         # default 0; this one reads 4.8 % too far
//! joint_lag_s = 0.1                   # default 0: the encoders of tilting sensors lag by so much
//! laser_covered_s = [20.0, 40.0]      # default: never; from when until when no beam of the main laser has an echo
//! fix_m = 0.05                        # standard deviation, heights twice; default: that of the vehicle's receiver
//!
//! [lidar]                             # for vehicles with one
//! columns = 2048                      # of a turn; default: of the vehicle's lidar
//!
//! [waves]                             # default: none; for boats only
//! height_m = 0.1                      # significant height: of the highest third, from trough to crest
//! period_s = 2.5                      # of the strongest waves; they are 1.56 m · period² long
//! heading_deg = 90.0                  # where they run to
//! second = { height_m = 0.03, period_s = 1.5, heading_deg = 10.0 }    # optional, on top of the first
//!
//! [path]
//! speed_mps = 0.5                     # a waypoint may have its own
//! turn_rate_degps = 60.0
//! corner_radius_m = 0.0               # default; 0 turns on the spot; a waypoint may have its own
//! waypoints = [{ x_m = 0.0, y_m = 4.0 }, { x_m = 3.0, y_m = 4.0, speed_mps = 0.2 }]
//!
//! [[solids]]
//! shape = "plane"                     # ground without end: solid below it, so no hole fits in
//! point_m = [0.0, 0.0, 0.0]           # default; a point on it
//! pitch_deg = 0.0                     # default; so are yaw_deg and roll_deg
//!
//! [[solids]]
//! shape = "wall"                      # stands on z = 0, cut square at both ends
//! from_m = [-1.0, -1.0]               # ends of its centre line
//! to_m = [5.0, -1.0]
//! thickness_m = 0.15
//! height_m = 2.5
//! reflectivity.glass = { transmission = 0.9 }     # per beam
//!
//! [[solids]]
//! shape = "box"
//! name = "crate"                      # optional, for messages; for every shape
//! centre_m = [2.0, 1.0, 0.4]
//! size_m = [1.2, 0.8, 0.8]            # along its own x, y, z
//! yaw_deg = 30.0                      # default 0; so are pitch_deg and roll_deg
//! reflectivity.specular = { probability = 0.3 }   # default: "diffuse"; for every shape
//!
//! [[solids]]
//! shape = "cylinder"                  # upright
//! base_m = [4.0, 1.0, 0.0]            # centre of its bottom; or centre_m
//! radius_m = 0.25
//! height_m = 1.75
//! # For every shape: offsets from where it stands, straight in between, at rest before and after.
//! motion = [{ t_s = 2.0, x_m = 0.0, y_m = 0.0 }, { t_s = 6.0, x_m = 0.0, y_m = 5.0 }]
//! appears_s = 2.0                     # default: there from the beginning
//! leaves_s = 6.0                      # default: there until the end
//!
//! [[solids]]
//! shape = "sphere"
//! centre_m = [3.0, 2.0, 0.3]
//! radius_m = 0.3
//!
//! [[solids]]
//! shape = "mesh"                      # a surface, seen from both sides
//! vertices_m = [[0.0, 5.0, 0.0], [1.0, 5.0, 0.0], [0.0, 6.0, 0.4]]
//! triangles = [[0, 1, 2]]             # vertices, counted from 0
//!
//! [[solids]]
//! shape = "height_field"              # a surface of two triangles between four heights
//! origin_m = [5.0, 5.0, 0.0]          # of the first height
//! spacing_m = 0.5                     # between heights, along x and y
//! heights_m = [[0.0, 0.1, 0.0], [0.0, 0.2, 0.1]]  # above the origin; rows of growing y, in a row growing x
//! # For every shape: whether it is ground, what plants and vehicles stand on, or stands on the ground.
//! ground = true                       # default: planes, meshes and height fields are, all others are not
//!
//! [water]                             # default: none
//! level_m = 0.0                       # no beam returns through its surface; what is below, sonars see
//!
//! [wind]                              # default: none
//! towards_deg = 40.0                  # where it blows to, from x towards y
//! lean = 0.05                         # of a plant of stiffness 1: its top is so far off on the mean …
//! sway = 0.1                          # … and swings by so much to either side, both by its height
//! period_s = 1.5                      # of its slowest regular swinging
//!
//! [receiver]                          # what a laser makes of thin things; where there are plants
//! min_share = 0.05                  # default; of a beam's light that must come back to be noticed
//! separation_m = 0.75                 # default; echoes nearer to each other come as one: half of 5 ns · c
//!
//! [[plants]]                          # rods as thin as they are; grown from the seed
//! kind = "stems"                      # grass, canes, twigs
//! name = "reeds"                      # optional; for every kind
//! seed = 1                            # for every kind
//! rigidity = "flexible"               # or "rigid": wind does not move it; for every kind
//! stiffness = 2.0                     # default 1; by so much less does the wind move it; for every kind
//! rectangle_m = [[0.0, 0.0], [4.0, 2.0]]      # where: two corners, or polygon_m = [[x, y], …], or …
//! # along_m = [[0.0, 0.0], [4.0, 1.0]]        # … what is not farther from a line …
//! # width_m = 2.0                             # … than half of this
//! density_per_m2 = 30.0
//! tufts = { stems = 12, radius_m = 0.05 }     # default none: each stands where it happens to
//! height_m = [1.5, 2.2]               # least and greatest; above the ground, or water where that is higher
//! thickness_mm = [6.0, 12.0]          # of a blade: its width as seen from the side
//! lean_deg = 10.0                     # default 0; the most, without wind
//! shoots = { count = 3, length_m = [0.2, 0.4], thickness_mm = [5.0, 15.0] }   # default none; on every stem
//!
//! [[plants]]
//! kind = "crowns"                     # bushes, and what hangs above trunks: closed all around
//! seed = 2
//! rigidity = "rigid"
//! at_m = [[5.0, 5.0], [6.5, 5.2]]     # one crown each
//! radius_m = [0.7, 1.0]
//! bottom_m = [0.0, 0.0]               # default; its lowest point above the ground or water
//! height_m = [1.2, 1.8]               # from there to its top
//! branches = 30                       # in each
//! branch_thickness_mm = [20.0, 60.0]
//! leaves_per_m2 = 200.0               # of its surface
//! leaf_length_m = [0.05, 0.08]
//! leaf_thickness_mm = [30.0, 50.0]
//!
//! [[shores]]                          # the truth of what a boat finds there
//! name = "reeds in the north"
//! class = "dense"                     # or "sparse" or "solid"
//! polygon_m = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]
//!
//! [[docks]]                           # where a boat can land
//! name = "slipway"
//! polygon_m = [[10.0, 0.0], [16.0, 0.0], [16.0, 8.0], [10.0, 8.0]]
//! ```

use std::num::NonZeroU16;
use std::sync::Arc;

use nalgebra::Point2;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeTable;

use super::values::{
    Coordinate, Fault, MILLION, NotNegative, Positive, Probability, Within, tables,
};
use super::{Dock, Shore};
use super::{World, plants, solids};
use crate::laser::LaserErrors;
use crate::path::{Path, PlanarPose, Waypoint};
use crate::scene::{Growth, Receiver, Scene};
use crate::source::SensorErrors;
use crate::vegetation::Wind;
use crate::vehicle::{Carriage, SimulatedVehicle};
use crate::waves::{WaveTrain, Waves};
use crate::wheel_encoders::WheelErrors;

/// All but the solids and plants.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    name: String,
    vehicle: Spanned<String>,
    noise: NoiseEntry,
    lidar: Option<Spanned<LidarEntry>>,
    waves: Option<Spanned<WavesEntry>>,
    start: StartEntry,
    path: Spanned<PathEntry>,
    water: Option<WaterEntry>,
    #[serde(default)]
    wind: Wind,
    #[serde(default)]
    receiver: Receiver,
    #[serde(default)]
    shores: Vec<Shore>,
    #[serde(default)]
    docks: Vec<Dock>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WaterEntry {
    level_m: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NoiseEntry {
    range_m: NotNegative,
    dropout: Probability,
    #[serde(default)]
    mixed_pixels: Probability,
    beam_divergence_mrad: Option<NotNegative>,
    attitude_deg: Option<Within<0, { 180 * MILLION }>>,
    /// Below −0.9 it would hardly read anything.
    #[serde(default)]
    encoder_scale_error: Within<-900_000, { 10 * MILLION }>,
    /// More than 10 s is no lag.
    #[serde(default)]
    joint_lag_s: Within<0, { 10 * MILLION }>,
    fix_m: Option<NotNegative>,
    laser_covered_s: Option<[NotNegative; 2]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LidarEntry {
    columns: NonZeroU16,
}

/// Waves of shorter than 0.3 s are ripples that surface tension drives; no wind makes those of longer than 30 s.
type WavePeriod = Within<300_000, { 30 * MILLION }>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WavesEntry {
    height_m: Spanned<NotNegative>,
    period_s: WavePeriod,
    heading_deg: Coordinate,
    second: Option<WaveTrainEntry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WaveTrainEntry {
    height_m: Spanned<NotNegative>,
    period_s: WavePeriod,
    heading_deg: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StartEntry {
    x_m: Coordinate,
    y_m: Coordinate,
    yaw_deg: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PathEntry {
    speed_mps: Positive,
    turn_rate_degps: Positive,
    #[serde(default)]
    corner_radius_m: NotNegative,
    waypoints: Vec<Spanned<WaypointEntry>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WaypointEntry {
    x_m: Coordinate,
    y_m: Coordinate,
    speed_mps: Option<Positive>,
    corner_radius_m: Option<NotNegative>,
}

const MAX_WAYPOINTS: usize = 10_000;
/// Ten days; stamps are good for 292 years.
const MAX_DURATION_S: f64 = 864_000.0;

/// The world of the text of a world file.
pub(super) fn parse(text: &str) -> Result<World, Fault> {
    let mut document = DeTable::parse(text)?;
    // Taken out first: serde's own tagged enums lose the place of their values.
    let solids = tables(document.get_mut(), "solids")?;
    let plants = tables(document.get_mut(), "plants")?;
    let header = Header::deserialize(toml::de::Deserializer::from(document))?;
    let mut vehicle = vehicle(&header.vehicle)?;
    if let Some(divergence) = header.noise.beam_divergence_mrad {
        vehicle.laser.planar.beam_divergence_rad = 1e-3 * divergence.0;
    }
    if let Some(lidar) = &header.lidar {
        if vehicle.laser.rings_rad.is_empty() {
            let message = format!("`{}` has no lidar", vehicle.name);
            return Err(Fault::new(lidar.span(), message));
        }
        let columns = lidar.get_ref().columns.get();
        vehicle.laser.planar = vehicle.laser.planar.turning(columns.into());
    }
    let path = path(&header)?;
    let waves = waves(header.waves.as_ref(), &vehicle)?;
    let solids = solids::parse(solids)?;
    let water_m = header.water.map(|water| water.level_m.0);
    let still_ground = solids.iter().filter(|s| s.is_ground && s.motion.is_none());
    let ground = Scene::new(still_ground);
    let mut scene = Scene::new(&solids);
    if let Some(vegetation) = plants::parse(plants, &ground, water_m, header.wind)? {
        scene = scene.with_growth(Growth {
            vegetation,
            receiver: header.receiver,
        });
    }
    if let Some(level_m) = water_m {
        scene = scene.with_water(level_m);
    }
    Ok(World {
        name: header.name,
        errors: errors(&header.noise, &vehicle),
        vehicle,
        scene: Arc::new(scene),
        solids,
        water_m,
        shores: header.shores,
        docks: header.docks,
        path: Arc::new(path),
        waves: Arc::new(waves),
    })
}

fn errors(noise: &NoiseEntry, vehicle: &SimulatedVehicle) -> SensorErrors {
    let own_attitude_noise_rad = vehicle.attitude_sensor.map_or(0.0, |ahrs| ahrs.noise_rad);
    let own_fix_noise_m = vehicle.gps.map_or(0.0, |receiver| receiver.noise_m);
    SensorErrors {
        laser: LaserErrors {
            range_noise_m: noise.range_m.0,
            dropout: noise.dropout.0,
            mixed_pixels: noise.mixed_pixels.0,
        },
        wheels: WheelErrors {
            scale_error: noise.encoder_scale_error.0,
            slip: 0.0,
        },
        attitude_noise_rad: noise
            .attitude_deg
            .map_or(own_attitude_noise_rad, |deg| deg.0.to_radians()),
        joint_lag_s: noise.joint_lag_s.0,
        fix_noise_m: noise.fix_m.map_or(own_fix_noise_m, |fix_m| fix_m.0),
        laser_covered_s: noise
            .laser_covered_s
            .map(|span_s| span_s.map(|at_s| at_s.0)),
    }
}

fn vehicle(name: &Spanned<String>) -> Result<SimulatedVehicle, Fault> {
    SimulatedVehicle::preset(name.get_ref()).ok_or_else(|| {
        let known = SimulatedVehicle::NAMES.join(", ");
        let message = format!("`{}` cannot be simulated, only {known}", name.get_ref());
        Fault::new(name.span(), message)
    })
}

fn waves(entry: Option<&Spanned<WavesEntry>>, vehicle: &SimulatedVehicle) -> Result<Waves, Fault> {
    let Some(entry) = entry else {
        return Ok(Waves::default());
    };
    if !matches!(vehicle.carriage, Carriage::Hull(_)) {
        let message = format!("waves move boats only, and `{}` is none", vehicle.name);
        return Err(Fault::new(entry.span(), message));
    }
    let first = entry.get_ref();
    let mut trains = vec![wave_train(
        &first.height_m,
        first.period_s,
        first.heading_deg,
    )?];
    if let Some(second) = &first.second {
        trains.push(wave_train(
            &second.height_m,
            second.period_s,
            second.heading_deg,
        )?);
    }
    Ok(Waves::new(&trains))
}

fn wave_train(
    height_m: &Spanned<NotNegative>,
    period_s: WavePeriod,
    heading_deg: Coordinate,
) -> Result<WaveTrain, Fault> {
    let train = WaveTrain {
        height_m: height_m.get_ref().0,
        period_s: period_s.0,
        heading_rad: heading_deg.0.to_radians(),
    };
    let most_m = train.greatest_height_m();
    if train.height_m > most_m {
        let message = format!(
            "waves of {} s break above {most_m:.2} m, a seventh of their length",
            train.period_s
        );
        return Err(Fault::new(height_m.span(), message));
    }
    Ok(train)
}

fn path(header: &Header) -> Result<Path, Fault> {
    let entry = header.path.get_ref();
    if let Some(extra) = entry.waypoints.get(MAX_WAYPOINTS) {
        let message = format!("more than {MAX_WAYPOINTS} waypoints");
        return Err(Fault::new(extra.span(), message));
    }
    let start = PlanarPose {
        position_m: Point2::new(header.start.x_m.0, header.start.y_m.0),
        yaw_rad: header.start.yaw_deg.0.to_radians(),
    };
    let waypoints = entry.waypoints.iter().map(Spanned::get_ref);
    let waypoints: Vec<Waypoint> = waypoints
        .map(|waypoint| Waypoint {
            position_m: Point2::new(waypoint.x_m.0, waypoint.y_m.0),
            speed_mps: waypoint.speed_mps.unwrap_or(entry.speed_mps).0,
            corner_radius_m: waypoint.corner_radius_m.unwrap_or(entry.corner_radius_m).0,
        })
        .collect();
    let turn_rate_radps = entry.turn_rate_degps.0.to_radians();
    let path = Path::new(start, turn_rate_radps, &waypoints)
        .map_err(|error| error.fault(&entry.waypoints, header.path.span()))?;
    let duration_s = path.duration_s();
    if duration_s > MAX_DURATION_S {
        let message = format!("the path takes {duration_s:.0} s, more than {MAX_DURATION_S} s");
        return Err(Fault::new(header.path.span(), message));
    }
    Ok(path)
}
