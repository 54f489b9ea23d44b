//! The `[[solids]]` of a world file.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::super::fault::Fault;
use super::super::number::{Coordinate, Positive, Probability};

/// One `[[solids]]`.
#[derive(Debug)]
pub(in super::super) struct SolidEntry {
    pub(in super::super) shape: ShapeEntry,
    pub(in super::super) any: AnySolid,
}

/// The keys of a solid that depend on its `shape`.
#[derive(Debug)]
pub(in super::super) enum ShapeEntry {
    Plane(PlaneEntry),
    Box(BoxEntry),
    Wall(WallEntry),
    Cylinder(CylinderEntry),
    Sphere(SphereEntry),
    Mesh(MeshEntry),
    HeightField(HeightFieldEntry),
}

/// The keys that every solid may have.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct AnySolid {
    #[serde(default)]
    pub(in super::super) name: String,
    #[serde(default)]
    pub(in super::super) reflectivity: ReflectivityEntry,
    #[serde(default)]
    pub(in super::super) motion: Vec<Spanned<KeyframeEntry>>,
    pub(in super::super) appears_s: Option<Spanned<Coordinate>>,
    pub(in super::super) leaves_s: Option<Spanned<Coordinate>>,
    pub(in super::super) ground: Option<bool>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct KeyframeEntry {
    pub(in super::super) t_s: Coordinate,
    pub(in super::super) x_m: Coordinate,
    pub(in super::super) y_m: Coordinate,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(in super::super) enum ReflectivityEntry {
    #[default]
    Diffuse,
    Specular(SpecularEntry),
    Glass(GlassEntry),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct SpecularEntry {
    pub(in super::super) probability: Probability,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct GlassEntry {
    pub(in super::super) transmission: Probability,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct PlaneEntry {
    #[serde(default)]
    pub(in super::super) point_m: [Coordinate; 3],
    #[serde(default)]
    pub(in super::super) yaw_deg: Coordinate,
    #[serde(default)]
    pub(in super::super) pitch_deg: Coordinate,
    #[serde(default)]
    pub(in super::super) roll_deg: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct BoxEntry {
    pub(in super::super) centre_m: [Coordinate; 3],
    pub(in super::super) size_m: [Positive; 3],
    #[serde(default)]
    pub(in super::super) yaw_deg: Coordinate,
    #[serde(default)]
    pub(in super::super) pitch_deg: Coordinate,
    #[serde(default)]
    pub(in super::super) roll_deg: Coordinate,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct WallEntry {
    pub(in super::super) from_m: [Coordinate; 2],
    pub(in super::super) to_m: [Coordinate; 2],
    pub(in super::super) thickness_m: Positive,
    pub(in super::super) height_m: Positive,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct CylinderEntry {
    pub(in super::super) centre_m: Option<[Coordinate; 3]>,
    pub(in super::super) base_m: Option<[Coordinate; 3]>,
    pub(in super::super) radius_m: Positive,
    pub(in super::super) height_m: Positive,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct SphereEntry {
    pub(in super::super) centre_m: [Coordinate; 3],
    pub(in super::super) radius_m: Positive,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct MeshEntry {
    pub(in super::super) vertices_m: Vec<[Coordinate; 3]>,
    pub(in super::super) triangles: Vec<Spanned<[u32; 3]>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in super::super) struct HeightFieldEntry {
    pub(in super::super) origin_m: [Coordinate; 3],
    pub(in super::super) spacing_m: Positive,
    pub(in super::super) heights_m: Spanned<Vec<Vec<Coordinate>>>,
}

const SHAPES: &str =
    "\"plane\", \"box\", \"wall\", \"cylinder\", \"sphere\", \"mesh\" or \"height_field\"";
const KEYS_OF_ANY: [&str; 6] = [
    "name",
    "reflectivity",
    "motion",
    "appears_s",
    "leaves_s",
    "ground",
];

pub(super) fn parse(solids: Spanned<DeValue<'_>>) -> Result<Vec<Spanned<SolidEntry>>, Fault> {
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
    let mut of_any = DeTable::new();
    let mut shape = None;
    if let DeValue::Table(table) = solid.get_mut() {
        shape = table.remove("shape");
        for key in KEYS_OF_ANY {
            if let Some((key, value)) = table.remove_entry(key) {
                of_any.insert(key, value);
            }
        }
    }
    let Some(shape) = shape else {
        let message = format!("a solid needs `shape`, which is {SHAPES}");
        return Err(Fault::new(span, message));
    };
    let any = deserialize(Spanned::new(span.clone(), DeValue::Table(of_any)))?;
    let shape = match shape.get_ref().as_str() {
        Some("plane") => ShapeEntry::Plane(of_shape(solid)?),
        Some("box") => ShapeEntry::Box(of_shape(solid)?),
        Some("wall") => ShapeEntry::Wall(of_shape(solid)?),
        Some("cylinder") => ShapeEntry::Cylinder(of_shape(solid)?),
        Some("sphere") => ShapeEntry::Sphere(of_shape(solid)?),
        Some("mesh") => ShapeEntry::Mesh(of_shape(solid)?),
        Some("height_field") => ShapeEntry::HeightField(of_shape(solid)?),
        other => {
            let name = other.map(|name| format!(" \"{name}\"")).unwrap_or_default();
            let message = format!("unknown `shape`{name}, expected {SHAPES}");
            return Err(Fault::new(shape.span(), message));
        }
    };
    Ok(Spanned::new(span, SolidEntry { shape, any }))
}

/// The keys that the shape's own entry does not know are taken out already: a message that lists what is
/// allowed must list them, too.
fn of_shape<T: DeserializeOwned>(solid: Spanned<DeValue<'_>>) -> Result<T, Fault> {
    deserialize(solid).map_err(|mut fault: Fault| {
        if fault.message.starts_with("unknown field") {
            fault.message += &KEYS_OF_ANY.map(|key| format!(", `{key}`")).concat();
        }
        fault
    })
}

fn deserialize<T: DeserializeOwned>(value: Spanned<DeValue<'_>>) -> Result<T, Fault> {
    Ok(T::deserialize(ValueDeserializer::from(value))?)
}
