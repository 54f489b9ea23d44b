//! The format of world files: TOML, every key known, every error with its line.
//!
//! ```toml
//! name = "yard"
//! vehicle = "pioneer"                 # a vehicle preset
//! noise = { range_m = 0.01, dropout = 0.005 }
//! start = { x_m = 0.0, y_m = 0.0, yaw_deg = 90.0 }
//!
//! [path]
//! speed_mps = 0.5                     # a waypoint may say its own
//! turn_rate_degps = 60.0
//! corner_radius_m = 0.0               # default; 0 turns on the spot; a waypoint may say its own
//! waypoints = [{ x_m = 0.0, y_m = 4.0 }, { x_m = 3.0, y_m = 4.0, speed_mps = 0.2 }]
//!
//! [[solids]]
//! shape = "wall"                      # stands on the ground, cut square at both ends
//! from_m = [-1.0, -1.0]               # ends of its centre line
//! to_m = [5.0, -1.0]
//! thickness_m = 0.15
//! height_m = 2.5
//!
//! [[solids]]
//! shape = "box"
//! name = "crate"                      # optional, for messages
//! centre_m = [2.0, 1.0, 0.4]
//! size_m = [1.2, 0.8, 0.8]            # along its own x, y, z
//! yaw_deg = 30.0                      # default 0
//! reflectivity.specular = { probability = 0.3 }   # default: reflectivity = "diffuse"
//! ```

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::fault::Fault;
use super::number::{Coordinate, NotNegative, Positive, Probability};

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

/// One `[[solids]]`, told apart by its `shape`.
#[derive(Debug)]
pub(super) enum SolidEntry {
    Box(BoxEntry),
    Wall(WallEntry),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoxEntry {
    #[serde(default)]
    pub(super) name: String,
    pub(super) centre_m: [Coordinate; 3],
    pub(super) size_m: [Positive; 3],
    #[serde(default)]
    pub(super) yaw_deg: Coordinate,
    #[serde(default)]
    pub(super) reflectivity: ReflectivityEntry,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct WallEntry {
    #[serde(default)]
    pub(super) name: String,
    pub(super) from_m: [Coordinate; 2],
    pub(super) to_m: [Coordinate; 2],
    pub(super) thickness_m: Positive,
    pub(super) height_m: Positive,
    #[serde(default)]
    pub(super) reflectivity: ReflectivityEntry,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ReflectivityEntry {
    #[default]
    Diffuse,
    Specular(SpecularEntry),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SpecularEntry {
    pub(super) probability: Probability,
}

/// Parses the text of a world file.
pub(super) fn parse(text: &str) -> Result<WorldFile, Fault> {
    let mut document = DeTable::parse(text)?;
    // Taken out first: serde's own tagged enums forget where in the text their values stood.
    let solids = match document.get_mut().remove("solids") {
        Some(solids) => parse_solids(solids)?,
        None => Vec::new(),
    };
    let header = Header::deserialize(toml::de::Deserializer::from(document))?;
    Ok(WorldFile { header, solids })
}

fn parse_solids(solids: Spanned<DeValue<'_>>) -> Result<Vec<Spanned<SolidEntry>>, Fault> {
    let (span, found) = (solids.span(), solids.get_ref().type_str());
    if let DeValue::Array(solids) = solids.into_inner() {
        solids.into_iter().map(parse_solid).collect()
    } else {
        let message = format!("expected `[[solids]]` tables, found {found}");
        Err(Fault::new(span, message))
    }
}

fn parse_solid(mut solid: Spanned<DeValue<'_>>) -> Result<Spanned<SolidEntry>, Fault> {
    let span = solid.span();
    let shape = if let DeValue::Table(table) = solid.get_mut() {
        table.remove("shape")
    } else {
        None
    };
    let Some(shape) = shape else {
        return Err(Fault::new(
            span,
            "a solid needs `shape`, which is \"box\" or \"wall\"",
        ));
    };
    let entry = match shape.get_ref().as_str() {
        Some("box") => SolidEntry::Box(deserialize(solid)?),
        Some("wall") => SolidEntry::Wall(deserialize(solid)?),
        other => {
            let name = other.map(|name| format!(" \"{name}\"")).unwrap_or_default();
            let message = format!("unknown `shape`{name}, expected \"box\" or \"wall\"");
            return Err(Fault::new(shape.span(), message));
        }
    };
    Ok(Spanned::new(span, entry))
}

fn deserialize<T: DeserializeOwned>(value: Spanned<DeValue<'_>>) -> Result<T, Fault> {
    Ok(T::deserialize(ValueDeserializer::from(value))?)
}
