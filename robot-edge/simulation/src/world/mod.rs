//! A world: loaded from a file, checked, ready to be simulated.

pub mod file;

mod plants;
mod solids;
pub(crate) mod values;

use std::fs::File;
use std::io::Read;
use std::path::Path as FilePath;
use std::sync::Arc;

use nalgebra::Point2;
use serde::Deserialize;

use crate::laser::LaserErrors;
use crate::path::Path;
use crate::scene::Scene;
use crate::solid::Solid;
use crate::source::SensorErrors;
use crate::vegetation;
use crate::vehicle::SimulatedVehicle;
use crate::waves::Waves;

/// Solids, a vehicle among them and the path it drives.
#[derive(Clone)]
pub struct World {
    name: String,
    vehicle: SimulatedVehicle,
    errors: SensorErrors,
    solids: Vec<Solid>,
    water_m: Option<f64>,
    shores: Vec<Shore>,
    docks: Vec<Dock>,
    scene: Arc<Scene>,
    path: Arc<Path>,
    waves: Arc<Waves>,
}

/// How a shore receives a boat [HYB §7, table 8.1].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShoreClass {
    /// Scattered flexible plants.
    Sparse,
    /// A closed field of flexible plants.
    Dense,
    /// Bushes, trunks, rocks.
    Solid,
}

/// A stretch of shore.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Shore {
    /// Name in the world file.
    pub name: String,
    /// What stands there.
    pub class: ShoreClass,
    /// Outline, metres.
    #[serde(deserialize_with = "values::polygon")]
    pub polygon_m: Vec<Point2<f64>>,
}

impl Shore {
    /// Whether a point is in it.
    pub fn contains(&self, at: Point2<f64>) -> bool {
        vegetation::is_inside(&self.polygon_m, at)
    }
}

/// A place where a boat can land.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
pub struct Dock {
    /// Name in the world file.
    pub name: String,
    /// Outline, metres.
    #[serde(deserialize_with = "values::polygon")]
    pub polygon_m: Vec<Point2<f64>>,
}

impl Dock {
    /// Whether a point is in it.
    pub fn contains(&self, at: Point2<f64>) -> bool {
        vegetation::is_inside(&self.polygon_m, at)
    }
}

/// Why a world cannot be loaded.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// No world has this name, and it does not look like a file.
    #[error("no world is called `{name}`{hint}: there are {known}, or give a world file (.toml)",
            hint = nearest.map(|n| format!(" (did you mean `{n}`?)")).unwrap_or_default(),
            known = World::names().join(", "))]
    Unknown {
        /// The requested name.
        name: String,
        /// The name that it resembles.
        nearest: Option<&'static str>,
    },
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Io {
        /// The file.
        file: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is larger than any world.
    #[error("{file}: not a world file: it is larger than {limit_bytes} bytes")]
    TooLarge {
        /// The file.
        file: String,
        /// The limit.
        limit_bytes: u64,
    },
    /// The file is not a valid world.
    #[error("{file}:{line}: {key}{message}", key = key.as_ref().map(|k| format!("`{k}`: ")).unwrap_or_default())]
    Invalid {
        /// The file, or the built-in world's name.
        file: String,
        /// Counted from 1.
        line: usize,
        /// The key of the wrong value, if there is one.
        key: Option<String>,
        /// What is wrong.
        message: String,
    },
}

/// Name and text of the built-in worlds.
const BUILT_IN: &[(&str, &str)] = &[
    ("rooms", include_str!("../../worlds/rooms.toml")),
    ("hall", include_str!("../../worlds/hall.toml")),
    ("floor", include_str!("../../worlds/floor.toml")),
    ("ramp", include_str!("../../worlds/ramp.toml")),
    ("street", include_str!("../../worlds/street.toml")),
    ("bumps", include_str!("../../worlds/bumps.toml")),
    ("turn", include_str!("../../worlds/turn.toml")),
    ("walker", include_str!("../../worlds/walker.toml")),
    ("yard", include_str!("../../worlds/yard.toml")),
    ("meadow", include_str!("../../worlds/meadow.toml")),
    ("lake", include_str!("../../worlds/lake.toml")),
    ("dock", include_str!("../../worlds/dock.toml")),
    ("bridge", include_str!("../../worlds/bridge.toml")),
    ("thicket", include_str!("../../worlds/thicket.toml")),
    ("jetty", include_str!("../../worlds/jetty.toml")),
];
const BUILT_IN_NAMES: &[&str] = &[
    "rooms", "hall", "floor", "ramp", "street", "bumps", "turn", "walker", "yard", "meadow",
    "lake", "dock", "bridge", "thicket", "jetty",
];

const MAX_FILE_BYTES: u64 = 4 << 20;

impl World {
    /// Loads a built-in world by its name, or a world file by its path (with a directory, or ending in
    /// `.toml`).
    pub fn load(name_or_path: &str) -> Result<Self, WorldError> {
        if let Some((name, text)) = BUILT_IN.iter().find(|(name, _)| *name == name_or_path) {
            return Self::parse(name, text);
        }
        let path = FilePath::new(name_or_path);
        let is_path = path.components().count() > 1
            || path
                .extension()
                .is_some_and(|extension| extension == "toml");
        if !is_path {
            return Err(WorldError::Unknown {
                name: name_or_path.to_owned(),
                nearest: nearest_name(name_or_path),
            });
        }
        let text = read_text(path)?;
        Self::parse(name_or_path, &text)
    }

    /// Makes a world of the text of a world file; `file` is its name in messages.
    pub fn parse(file: &str, text: &str) -> Result<Self, WorldError> {
        file::parse(text).map_err(|fault| WorldError::Invalid {
            file: file.to_owned(),
            line: fault.line_in(text),
            key: fault.key_in(text),
            message: fault.message,
        })
    }

    /// Names of the built-in worlds.
    pub fn names() -> &'static [&'static str] {
        BUILT_IN_NAMES
    }

    /// Name in the file.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name of the vehicle preset.
    pub fn vehicle(&self) -> &'static str {
        self.vehicle.name
    }

    /// The simulated vehicle.
    pub fn simulated_vehicle(&self) -> &SimulatedVehicle {
        &self.vehicle
    }

    /// The same, to give its sensors the steps of other devices.
    pub fn simulated_vehicle_mut(&mut self) -> &mut SimulatedVehicle {
        &mut self.vehicle
    }

    /// Errors of its laser, unless the options override them.
    pub fn laser_errors(&self) -> LaserErrors {
        self.errors.laser
    }

    /// Standard deviation of its AHRS's roll, pitch and yaw unless the options override it, radians.
    pub fn attitude_noise_rad(&self) -> f64 {
        self.errors.attitude_noise_rad
    }

    /// Errors of its sensors, unless the options override them.
    pub(crate) fn errors(&self) -> SensorErrors {
        self.errors
    }

    /// Its solids, in the file's order.
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// Those of the solids that are ground, with the others apart: first what is driven on, then what
    /// stands on it.
    pub fn ground_and_objects(&self) -> [Vec<Solid>; 2] {
        let solids = self.solids.iter().cloned();
        let (ground, objects) = solids.partition(|solid| solid.is_ground);
        [ground, objects]
    }

    /// Height of the water's surface above z = 0, metres; `None` if there is no water.
    pub fn water_m(&self) -> Option<f64> {
        self.water_m
    }

    /// True shores.
    pub fn shores(&self) -> &[Shore] {
        &self.shores
    }

    /// True docking sites.
    pub fn docks(&self) -> &[Dock] {
        &self.docks
    }

    /// Solids, plants and water.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// The vehicle's path.
    pub fn path(&self) -> &Arc<Path> {
        &self.path
    }

    pub(crate) fn waves(&self) -> &Arc<Waves> {
        &self.waves
    }
}

fn read_text(path: &FilePath) -> Result<String, WorldError> {
    let file = path.display().to_string();
    let mut text = String::new();
    let read = File::open(path)
        .and_then(|opened| opened.take(MAX_FILE_BYTES + 1).read_to_string(&mut text));
    match read {
        Ok(bytes) if bytes as u64 > MAX_FILE_BYTES => Err(WorldError::TooLarge {
            file,
            limit_bytes: MAX_FILE_BYTES,
        }),
        Ok(_) => Ok(text),
        Err(source) => Err(WorldError::Io { file, source }),
    }
}

/// The built-in name within two edits of `name`.
fn nearest_name(name: &str) -> Option<&'static str> {
    World::names()
        .iter()
        .map(|known| (strsim::damerau_levenshtein(name, known), *known))
        .filter(|(edits, _)| *edits <= 2)
        .min()
        .map(|(_, known)| known)
}

#[cfg(test)]
mod tests;
