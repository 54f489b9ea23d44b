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
//!
//! [path]
//! speed_mps = 0.5                     # a waypoint may say its own
//! turn_rate_degps = 60.0
//! corner_radius_m = 0.0               # default; 0 turns on the spot; a waypoint may say its own
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
//! ```

mod solids;

use serde::Deserialize;
use toml::Spanned;
use toml::de::DeTable;

use super::fault::Fault;
use super::number::{Coordinate, HalfTurnDegrees, NotNegative, Positive, Probability, ScaleError};

pub(super) use solids::{
    AnySolid, BoxEntry, CylinderEntry, HeightFieldEntry, MeshEntry, PlaneEntry, ReflectivityEntry,
    ShapeEntry, SolidEntry, SphereEntry, WallEntry,
};

/// A parsed file: the numbers are finite and within their bounds, nothing else is checked.
#[derive(Debug)]
pub(super) struct WorldFile {
    pub(super) header: Header,
    pub(super) solids: Vec<Spanned<SolidEntry>>,
}

/// All but the solids.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    pub(super) name: String,
    pub(super) vehicle: Spanned<String>,
    pub(super) noise: NoiseEntry,
    pub(super) start: StartEntry,
    pub(super) path: Spanned<PathEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoiseEntry {
    pub(super) range_m: NotNegative,
    pub(super) dropout: Probability,
    #[serde(default)]
    pub(super) mixed_pixels: Probability,
    pub(super) beam_divergence_mrad: Option<NotNegative>,
    pub(super) attitude_deg: Option<HalfTurnDegrees>,
    #[serde(default)]
    pub(super) encoder_scale_error: ScaleError,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StartEntry {
    pub(super) x_m: Coordinate,
    pub(super) y_m: Coordinate,
    pub(super) yaw_deg: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathEntry {
    pub(super) speed_mps: Positive,
    pub(super) turn_rate_degps: Positive,
    #[serde(default)]
    pub(super) corner_radius_m: NotNegative,
    pub(super) waypoints: Vec<Spanned<WaypointEntry>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WaypointEntry {
    pub(super) x_m: Coordinate,
    pub(super) y_m: Coordinate,
    pub(super) speed_mps: Option<Positive>,
    pub(super) corner_radius_m: Option<NotNegative>,
}

/// Parses the text of a world file.
pub(super) fn parse(text: &str) -> Result<WorldFile, Fault> {
    let mut document = DeTable::parse(text)?;
    // Taken out first: serde's own tagged enums forget where in the text their values stood.
    let solids = match document.get_mut().remove("solids") {
        Some(solids) => solids::parse(solids)?,
        None => Vec::new(),
    };
    let header = Header::deserialize(toml::de::Deserializer::from(document))?;
    Ok(WorldFile { header, solids })
}
