//! The `[[solids]]` of a world file.

use measurement::mount::Mount;
use measurement::pose::{self, Pose};
use nalgebra::{Point3, Vector2, Vector3};
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::values::{Coordinate, Fault, Positive, Probability, Tagged, point};
use crate::solid::{Keyframe, Mesh, Motion, Reflectivity, Shape, Solid};

/// The keys that every solid may have.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CommonKeys {
    #[serde(default)]
    name: String,
    #[serde(default)]
    reflectivity: ReflectivityEntry,
    #[serde(default)]
    motion: Vec<Spanned<KeyframeEntry>>,
    appears_s: Option<Spanned<Coordinate>>,
    leaves_s: Option<Spanned<Coordinate>>,
    ground: Option<bool>,
}

const COMMON_KEYS: &[&str] = &[
    "name",
    "reflectivity",
    "motion",
    "appears_s",
    "leaves_s",
    "ground",
];

#[derive(Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ReflectivityEntry {
    #[default]
    Diffuse,
    Specular(SpecularEntry),
    Glass(GlassEntry),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SpecularEntry {
    probability: Probability,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GlassEntry {
    transmission: Probability,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyframeEntry {
    t_s: Coordinate,
    x_m: Coordinate,
    y_m: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PlaneEntry {
    #[serde(default)]
    point_m: [Coordinate; 3],
    #[serde(default)]
    yaw_deg: Coordinate,
    #[serde(default)]
    pitch_deg: Coordinate,
    #[serde(default)]
    roll_deg: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxEntry {
    centre_m: [Coordinate; 3],
    size_m: [Positive; 3],
    #[serde(default)]
    yaw_deg: Coordinate,
    #[serde(default)]
    pitch_deg: Coordinate,
    #[serde(default)]
    roll_deg: Coordinate,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WallEntry {
    from_m: [Coordinate; 2],
    to_m: [Coordinate; 2],
    thickness_m: Positive,
    height_m: Positive,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CylinderEntry {
    centre_m: Option<[Coordinate; 3]>,
    base_m: Option<[Coordinate; 3]>,
    radius_m: Positive,
    height_m: Positive,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereEntry {
    centre_m: [Coordinate; 3],
    radius_m: Positive,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshEntry {
    vertices_m: Vec<[Coordinate; 3]>,
    triangles: Vec<Spanned<[u32; 3]>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HeightFieldEntry {
    origin_m: [Coordinate; 3],
    spacing_m: Positive,
    heights_m: Spanned<Vec<Vec<Coordinate>>>,
}

const SHAPES: &str =
    "\"plane\", \"box\", \"wall\", \"cylinder\", \"sphere\", \"mesh\" or \"height_field\"";

/// The outline of the truth compares each with each.
const MAX_SOLIDS: usize = 2_000;
/// Every ray tests each of these; a crowd fits in.
const MAX_MOVING: usize = 50;
/// In all meshes and height fields together: 60 MB.
const MAX_TRIANGLES: usize = 200_000;

type TaggedSolid<'a> = Tagged<'a, CommonKeys>;

pub(super) fn parse(tables: Vec<Spanned<DeValue<'_>>>) -> Result<Vec<Solid>, Fault> {
    if let Some(extra) = tables.get(MAX_SOLIDS) {
        let message = format!("more than {MAX_SOLIDS} solids");
        return Err(Fault::new(extra.span(), message));
    }
    let missing = format!("a solid needs `shape`, which is {SHAPES}");
    let (mut moving, mut triangles) = (0, 0);
    tables
        .into_iter()
        .map(|table| {
            let mut table = TaggedSolid::split(table, "shape", COMMON_KEYS, &missing)?;
            let (shape, world_from_solid) = shape(&mut table, &mut triangles)?;
            let motion = motion(&table)?;
            moving += usize::from(motion.is_some());
            if moving > MAX_MOVING {
                return Err(table.fault(format!("more than {MAX_MOVING} moving solids")));
            }
            let is_usually_ground = matches!(shape, Shape::Plane | Shape::Mesh(_));
            Ok(Solid {
                name: table.common.name,
                shape,
                world_from_solid,
                reflectivity: match table.common.reflectivity {
                    ReflectivityEntry::Diffuse => Reflectivity::Diffuse,
                    ReflectivityEntry::Specular(entry) => Reflectivity::Specular {
                        probability: entry.probability.0,
                    },
                    ReflectivityEntry::Glass(entry) => Reflectivity::Glass {
                        transmission: entry.transmission.0,
                    },
                },
                motion,
                is_ground: table.common.ground.unwrap_or(is_usually_ground),
            })
        })
        .collect()
}

/// The shape and its place; `triangles` counts those of all solids.
fn shape(table: &mut TaggedSolid<'_>, triangles: &mut usize) -> Result<(Shape, Pose), Fault> {
    match table.tag() {
        "plane" => plane(table),
        "box" => {
            let keys: BoxEntry = table.keys()?;
            let size_m = keys.size_m.map(|length| length.0);
            let angles_deg = [keys.yaw_deg, keys.pitch_deg, keys.roll_deg];
            Ok((Shape::Box { size_m }, turned(keys.centre_m, angles_deg)))
        }
        "wall" => wall(table),
        "cylinder" => cylinder(table),
        "sphere" => {
            let keys: SphereEntry = table.keys()?;
            let radius_m = keys.radius_m.0;
            Ok((Shape::Sphere { radius_m }, at(keys.centre_m)))
        }
        "mesh" => mesh(table, triangles),
        "height_field" => height_field(table, triangles),
        _ => Err(table.unknown_tag("shape", SHAPES)),
    }
}

/// Within 80° of level: the edge of a steeper one would be higher than any coordinate.
fn plane(table: &mut TaggedSolid<'_>) -> Result<(Shape, Pose), Fault> {
    let keys: PlaneEntry = table.keys()?;
    let placed = turned(keys.point_m, [keys.yaw_deg, keys.pitch_deg, keys.roll_deg]);
    let steepest = libm::cos(80.0_f64.to_radians());
    if (placed.rotation * Vector3::z()).z < steepest {
        return Err(table.fault(
            "a plane that is steep or upside down: its `pitch_deg` and `roll_deg` must leave it \
             within 80° of level",
        ));
    }
    Ok((Shape::Plane, placed))
}

fn wall(table: &mut TaggedSolid<'_>) -> Result<(Shape, Pose), Fault> {
    let keys: WallEntry = table.keys()?;
    let (from_m, to_m) = (point(keys.from_m), point(keys.to_m));
    let along = to_m - from_m;
    if along.norm() <= 0.0 {
        return Err(table.fault("a wall whose `from_m` and `to_m` are the same"));
    }
    let centre_m = nalgebra::center(&from_m, &to_m);
    let yaw_rad = libm::atan2(along.y, along.x);
    let height_m = keys.height_m.0;
    let size_m = [along.norm(), keys.thickness_m.0, height_m];
    let planar = pose::planar(centre_m.x, centre_m.y, yaw_rad);
    Ok((Shape::Box { size_m }, raised(planar, 0.5 * height_m)))
}

fn cylinder(table: &mut TaggedSolid<'_>) -> Result<(Shape, Pose), Fault> {
    let keys: CylinderEntry = table.keys()?;
    let (radius_m, height_m) = (keys.radius_m.0, keys.height_m.0);
    let placed = match (keys.centre_m, keys.base_m) {
        (Some(centre_m), None) => at(centre_m),
        (None, Some(base_m)) => raised(at(base_m), base_m[2].0 + 0.5 * height_m),
        (Some(_), Some(_)) | (None, None) => {
            return Err(table.fault("a cylinder needs either `centre_m` or `base_m`"));
        }
    };
    Ok((Shape::Cylinder { radius_m, height_m }, placed))
}

fn mesh(table: &mut TaggedSolid<'_>, triangles: &mut usize) -> Result<(Shape, Pose), Fault> {
    let keys: MeshEntry = table.keys()?;
    count(table, triangles, keys.triangles.len())?;
    let vertices_m: Vec<Point3<f64>> = keys
        .vertices_m
        .iter()
        .map(|vertex| Point3::from(vertex.map(|coordinate| coordinate.0)))
        .collect();
    let corners = keys.triangles.iter().map(|t| *t.get_ref()).collect();
    let mesh = Mesh::new(&vertices_m, corners)
        .map_err(|error| error.fault(&keys.triangles, table.span.clone()))?;
    Ok((Shape::Mesh(mesh), Pose::identity()))
}

fn height_field(
    table: &mut TaggedSolid<'_>,
    triangles: &mut usize,
) -> Result<(Shape, Pose), Fault> {
    let keys: HeightFieldEntry = table.keys()?;
    let rows = keys.heights_m.get_ref();
    count(
        table,
        triangles,
        2 * rows.iter().map(Vec::len).sum::<usize>(),
    )?;
    let heights_m: Vec<Vec<f64>> = rows
        .iter()
        .map(|row| row.iter().map(|height| height.0).collect())
        .collect();
    let mesh = Mesh::of_heights(keys.spacing_m.0, &heights_m)
        .map_err(|error| Fault::new(keys.heights_m.span(), error.message))?;
    Ok((Shape::Mesh(mesh), at(keys.origin_m)))
}

fn count(table: &TaggedSolid<'_>, triangles: &mut usize, more: usize) -> Result<(), Fault> {
    *triangles += more;
    if *triangles > MAX_TRIANGLES {
        return Err(table.fault(format!("more than {MAX_TRIANGLES} triangles in all meshes")));
    }
    Ok(())
}

fn motion(table: &TaggedSolid<'_>) -> Result<Option<Motion>, Fault> {
    let keys = &table.common;
    if keys.motion.is_empty() && keys.appears_s.is_none() && keys.leaves_s.is_none() {
        return Ok(None);
    }
    let keyframes = keys.motion.iter().map(Spanned::get_ref);
    let keyframes = keyframes.map(|keyframe| Keyframe {
        time_s: keyframe.t_s.0,
        offset_m: Vector2::new(keyframe.x_m.0, keyframe.y_m.0),
    });
    let time_s = |key: &Option<Spanned<Coordinate>>| key.as_ref().map(|time_s| time_s.get_ref().0);
    let appears_s = time_s(&keys.appears_s).unwrap_or(f64::NEG_INFINITY);
    let leaves_s = time_s(&keys.leaves_s).unwrap_or(f64::INFINITY);
    let last = keys
        .leaves_s
        .as_ref()
        .map_or(table.span.clone(), Spanned::span);
    let motion = Motion::new(keyframes.collect(), appears_s, leaves_s)
        .map_err(|error| error.fault(&keys.motion, last))?;
    Ok(Some(motion))
}

fn at(point_m: [Coordinate; 3]) -> Pose {
    let [x, y, z] = point_m.map(|coordinate| coordinate.0);
    raised(pose::planar(x, y, 0.0), z)
}

fn turned(point_m: [Coordinate; 3], angles_deg: [Coordinate; 3]) -> Pose {
    let [x_m, y_m, z_m] = point_m.map(|coordinate| coordinate.0);
    let [yaw_deg, pitch_deg, roll_deg] = angles_deg.map(|angle| angle.0);
    Mount {
        x_m,
        y_m,
        z_m,
        roll_deg,
        pitch_deg,
        yaw_deg,
    }
    .base_from_sensor()
}

fn raised(mut pose: Pose, z_m: f64) -> Pose {
    pose.translation.z = z_m;
    pose
}
