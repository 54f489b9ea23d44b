//! The solids of a world.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Point2, Point3, Vector2};
use toml::Spanned;

use super::super::fault::Fault;
use super::super::file::{
    AnySolid, BoxEntry, CylinderEntry, HeightFieldEntry, MeshEntry, PlaneEntry, ReflectivityEntry,
    ShapeEntry, SolidEntry, SphereEntry, WallEntry,
};
use super::super::number::Coordinate;
use crate::solid::mesh::Mesh;
use crate::solid::motion::{Keyframe, Motion, MotionError};
use crate::solid::{Reflectivity, Shape, Solid};
use measurement::mount::Mount;
use measurement::pose::{self, Pose};

/// The outline of the truth compares each with each.
const MAX_SOLIDS: usize = 2_000;
/// Every ray tests each of these; a crowd fits in.
const MAX_MOVING: usize = 50;
/// In all meshes and height fields together: 60 MB.
const MAX_TRIANGLES: usize = 200_000;

pub(super) fn build(entries: Vec<Spanned<SolidEntry>>) -> Result<Arc<[Solid]>, Fault> {
    if let Some(extra) = entries.get(MAX_SOLIDS) {
        let message = format!("more than {MAX_SOLIDS} solids");
        return Err(Fault::new(extra.span(), message));
    }
    let (mut moving, mut triangles) = (0, 0);
    entries
        .into_iter()
        .map(|entry| {
            let span = entry.span();
            let SolidEntry { shape, any } = entry.into_inner();
            triangles += triangles_of(&shape);
            if triangles > MAX_TRIANGLES {
                let message = format!("more than {MAX_TRIANGLES} triangles in all meshes");
                return Err(Fault::new(span, message));
            }
            let (shape, world_from_solid) = placed_shape(&shape, &span)?;
            let motion = motion(&any, &span)?;
            moving += usize::from(motion.is_some());
            if moving > MAX_MOVING {
                let message = format!("more than {MAX_MOVING} moving solids");
                return Err(Fault::new(span, message));
            }
            Ok(Solid {
                shape,
                world_from_solid,
                motion,
                reflectivity: reflectivity(&any.reflectivity),
                name: any.name,
            })
        })
        .collect()
}

/// Whether plants and vehicles stand on it.
pub(super) fn is_ground(entry: &Spanned<SolidEntry>) -> bool {
    let SolidEntry { shape, any } = entry.get_ref();
    any.ground.unwrap_or(match shape {
        ShapeEntry::Plane(_) | ShapeEntry::Mesh(_) | ShapeEntry::HeightField(_) => true,
        ShapeEntry::Box(_)
        | ShapeEntry::Wall(_)
        | ShapeEntry::Cylinder(_)
        | ShapeEntry::Sphere(_) => false,
    })
}

fn triangles_of(shape: &ShapeEntry) -> usize {
    match shape {
        ShapeEntry::Mesh(mesh) => mesh.triangles.len(),
        ShapeEntry::HeightField(field) => {
            2 * field
                .heights_m
                .get_ref()
                .iter()
                .map(Vec::len)
                .sum::<usize>()
        }
        ShapeEntry::Plane(_)
        | ShapeEntry::Box(_)
        | ShapeEntry::Wall(_)
        | ShapeEntry::Cylinder(_)
        | ShapeEntry::Sphere(_) => 0,
    }
}

fn placed_shape(entry: &ShapeEntry, span: &Range<usize>) -> Result<(Shape, Pose), Fault> {
    let or_fault = |placed: Option<(Shape, Pose)>, message: &str| {
        placed.ok_or_else(|| Fault::new(span.clone(), message))
    };
    match entry {
        ShapeEntry::Plane(entry) => or_fault(
            plane(entry),
            "a plane that is steep or upside down: its `pitch_deg` and `roll_deg` must leave it \
             within 80° of level",
        ),
        ShapeEntry::Box(entry) => Ok(a_box(entry)),
        ShapeEntry::Wall(entry) => {
            or_fault(wall(entry), "a wall whose `from_m` and `to_m` are the same")
        }
        ShapeEntry::Cylinder(entry) => or_fault(
            cylinder(entry),
            "a cylinder needs either `centre_m` or `base_m`",
        ),
        ShapeEntry::Sphere(SphereEntry { centre_m, radius_m }) => {
            let shape = Shape::Sphere {
                radius_m: radius_m.0,
            };
            Ok((shape, at(*centre_m)))
        }
        ShapeEntry::Mesh(entry) => mesh(entry, span),
        ShapeEntry::HeightField(entry) => height_field(entry),
    }
}

/// `None` where it is too steep to be ground: its edge would be higher than any coordinate.
fn plane(entry: &PlaneEntry) -> Option<(Shape, Pose)> {
    let placed = turned(
        entry.point_m,
        [entry.yaw_deg, entry.pitch_deg, entry.roll_deg],
    );
    let steepest = libm::cos(80.0_f64.to_radians());
    let normal = placed.rotation * nalgebra::Vector3::z();
    (normal.z >= steepest).then_some((Shape::Plane, placed))
}

fn a_box(entry: &BoxEntry) -> (Shape, Pose) {
    let shape = Shape::Box {
        size_m: entry.size_m.map(|length| length.0),
    };
    let angles = [entry.yaw_deg, entry.pitch_deg, entry.roll_deg];
    (shape, turned(entry.centre_m, angles))
}

/// `None` where the wall has no length.
fn wall(entry: &WallEntry) -> Option<(Shape, Pose)> {
    let from_m = Point2::from(entry.from_m.map(|coordinate| coordinate.0));
    let to_m = Point2::from(entry.to_m.map(|coordinate| coordinate.0));
    let along: Vector2<f64> = to_m - from_m;
    let centre_m = nalgebra::center(&from_m, &to_m);
    let yaw_rad = libm::atan2(along.y, along.x);
    let height_m = entry.height_m.0;
    let shape = Shape::Box {
        size_m: [along.norm(), entry.thickness_m.0, height_m],
    };
    let placed = raised(
        pose::planar(centre_m.x, centre_m.y, yaw_rad),
        0.5 * height_m,
    );
    (along.norm() > 0.0).then_some((shape, placed))
}

/// `None` where it stands at two places or at none.
fn cylinder(entry: &CylinderEntry) -> Option<(Shape, Pose)> {
    let height_m = entry.height_m.0;
    let placed = match (entry.centre_m, entry.base_m) {
        (Some(centre_m), None) => at(centre_m),
        (None, Some([x, y, z])) => raised(at([x, y, z]), z.0 + 0.5 * height_m),
        (Some(_), Some(_)) | (None, None) => return None,
    };
    let shape = Shape::Cylinder {
        radius_m: entry.radius_m.0,
        height_m,
    };
    Some((shape, placed))
}

fn mesh(entry: &MeshEntry, span: &Range<usize>) -> Result<(Shape, Pose), Fault> {
    let vertices_m: Vec<Point3<f64>> = entry
        .vertices_m
        .iter()
        .map(|vertex| Point3::from(vertex.map(|coordinate| coordinate.0)))
        .collect();
    let triangles = entry.triangles.iter().map(|t| *t.get_ref()).collect();
    let mesh = Mesh::new(&vertices_m, triangles).map_err(|error| {
        let at_fault = error.triangle().and_then(|n| entry.triangles.get(n));
        Fault::new(
            at_fault.map_or(span.clone(), Spanned::span),
            error.to_string(),
        )
    })?;
    Ok((Shape::Mesh(mesh), Pose::identity()))
}

fn height_field(entry: &HeightFieldEntry) -> Result<(Shape, Pose), Fault> {
    let heights_m: Vec<Vec<f64>> = entry
        .heights_m
        .get_ref()
        .iter()
        .map(|row| row.iter().map(|height| height.0).collect())
        .collect();
    let mesh = Mesh::of_heights(entry.spacing_m.0, &heights_m)
        .map_err(|error| Fault::new(entry.heights_m.span(), error.to_string()))?;
    Ok((Shape::Mesh(mesh), at(entry.origin_m)))
}

fn motion(entry: &AnySolid, span: &Range<usize>) -> Result<Option<Motion>, Fault> {
    if entry.motion.is_empty() && entry.appears_s.is_none() && entry.leaves_s.is_none() {
        return Ok(None);
    }
    let keyframes = entry
        .motion
        .iter()
        .map(Spanned::get_ref)
        .map(|keyframe| Keyframe {
            time_s: keyframe.t_s.0,
            offset_m: Vector2::new(keyframe.x_m.0, keyframe.y_m.0),
        })
        .collect();
    let appears_s = time(entry.appears_s.as_ref(), f64::NEG_INFINITY);
    let leaves_s = time(entry.leaves_s.as_ref(), f64::INFINITY);
    Motion::new(keyframes, appears_s, leaves_s)
        .map(Some)
        .map_err(|error| {
            let at_fault = match error {
                MotionError::NotLater { keyframe } => entry.motion.get(keyframe).map(Spanned::span),
                MotionError::NeverThere => entry.leaves_s.as_ref().map(Spanned::span),
            };
            Fault::new(at_fault.unwrap_or(span.clone()), error.to_string())
        })
}

fn time(entry: Option<&Spanned<Coordinate>>, otherwise_s: f64) -> f64 {
    entry.map_or(otherwise_s, |time_s| time_s.get_ref().0)
}

fn reflectivity(entry: &ReflectivityEntry) -> Reflectivity {
    match entry {
        ReflectivityEntry::Diffuse => Reflectivity::Diffuse,
        ReflectivityEntry::Specular(specular) => Reflectivity::Specular {
            probability: specular.probability.0,
        },
        ReflectivityEntry::Glass(glass) => Reflectivity::Glass {
            transmission: glass.transmission.0,
        },
    }
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
