//! Every shape, surface and motion of a world file.

use nalgebra::{Point3, Vector2, Vector3};

use super::*;
use crate::solid::{Reflectivity, Shape, Solid};

const HEADER: &str = r#"name = "solids"
vehicle = "pioneer"
noise = { range_m = 0.01, dropout = 0.005, mixed_pixels = 0.25, beam_divergence_mrad = 12.5 }
start = { x_m = 0.0, y_m = 0.0, yaw_deg = 0.0 }
path = { speed_mps = 1.0, turn_rate_degps = 60.0, waypoints = [{ x_m = 1.0, y_m = 0.0 }] }

"#;

/// The world of one solid, whose `[[solids]]` stands in line 7.
fn parse(solid: &str) -> Result<World, WorldError> {
    World::parse("solids.toml", &format!("{HEADER}[[solids]]\n{solid}"))
}

fn solid(text: &str) -> Solid {
    parse(text).unwrap().solids()[0].clone()
}

fn place(solid: &Solid) -> [f64; 3] {
    solid.world_from_solid.translation.vector.into()
}

#[test]
fn the_noise_may_say_how_wide_and_mixed_beams_are() {
    let world = parse("shape = \"plane\"").unwrap();
    assert_eq!(world.laser_errors().mixed_pixels, 0.25);
    assert_eq!(
        world.simulated_vehicle().laser.planar.beam_divergence_rad,
        0.0125
    );
    let plain = HEADER.replace(", mixed_pixels = 0.25, beam_divergence_mrad = 12.5", "");
    let world = World::parse("solids.toml", &plain).unwrap();
    assert_eq!(world.laser_errors().mixed_pixels, 0.0);
    assert_eq!(
        world.simulated_vehicle().laser.planar.beam_divergence_rad,
        0.01
    );
}

#[test]
fn every_shape_is_read_as_written() {
    let plane = solid("shape = \"plane\"\npoint_m = [1, 2, 3]\npitch_deg = 10");
    assert_eq!(
        (&plane.shape, place(&plane)),
        (&Shape::Plane, [1.0, 2.0, 3.0])
    );
    // Positive pitch is nose down: the ground falls to the front.
    let normal = plane.world_from_solid.rotation * Vector3::z();
    assert!((normal.x - libm::sin(10.0_f64.to_radians())).abs() < 1e-12);

    let ramp = solid(
        "shape = \"box\"\ncentre_m = [0, 0, 1]\nsize_m = [4, 2, 1]\nyaw_deg = 90\npitch_deg = -30",
    );
    let nose = ramp.world_from_solid * Point3::new(2.0, 0.0, 0.0);
    let expected = Point3::new(0.0, 2.0 * libm::sqrt(0.75), 2.0);
    assert!((nose - expected).norm() < 1e-12, "{nose}");
    let rolled = solid("shape = \"box\"\ncentre_m = [0, 0, 0]\nsize_m = [4, 2, 1]\nroll_deg = 30");
    let left = rolled.world_from_solid * Point3::new(0.0, 1.0, 0.0);
    assert!((left.z - 0.5).abs() < 1e-12, "{left}");

    let by_base =
        solid("shape = \"cylinder\"\nbase_m = [1, 2, 0.5]\nradius_m = 0.25\nheight_m = 1.5");
    let by_centre =
        solid("shape = \"cylinder\"\ncentre_m = [1, 2, 1.25]\nradius_m = 0.25\nheight_m = 1.5");
    assert_eq!(by_base, by_centre);
    assert_eq!(
        by_base.shape,
        Shape::Cylinder {
            radius_m: 0.25,
            height_m: 1.5
        }
    );
    assert_eq!(place(&by_base), [1.0, 2.0, 1.25]);

    let ball = solid("shape = \"sphere\"\ncentre_m = [1, 2, 3]\nradius_m = 0.5");
    assert_eq!(
        (ball.shape.clone(), place(&ball)),
        (Shape::Sphere { radius_m: 0.5 }, [1.0, 2.0, 3.0])
    );

    let mesh = solid(
        "shape = \"mesh\"\nvertices_m = [[0, 0, 1], [1, 0, 1], [0, 1, 2]]\ntriangles = [[0, 1, 2]]",
    );
    let Shape::Mesh(mesh) = &mesh.shape else {
        panic!("{mesh:?}")
    };
    assert_eq!(
        mesh.triangles_m().next().unwrap()[2],
        Point3::new(0.0, 1.0, 2.0)
    );

    let field = solid(
        "shape = \"height_field\"\norigin_m = [1, 2, 3]\nspacing_m = 0.5\nheights_m = [[0, 1], [2, 3], [4, 5]]",
    );
    assert_eq!(place(&field), [1.0, 2.0, 3.0]);
    let Shape::Mesh(mesh) = &field.shape else {
        panic!("{field:?}")
    };
    assert_eq!(
        mesh.triangles_m().last().unwrap()[1],
        Point3::new(0.5, 1.0, 5.0)
    );
}

#[test]
fn any_shape_may_be_glass_and_move() {
    let walker = solid(
        r#"shape = "sphere"
centre_m = [1, 2, 3]
radius_m = 0.5
name = "balloon"
reflectivity.glass = { transmission = 0.75 }
motion = [{ t_s = 1, x_m = 0, y_m = 0 }, { t_s = 3, x_m = 4, y_m = -2 }]
leaves_s = 5"#,
    );
    assert_eq!(walker.name, "balloon");
    assert_eq!(
        walker.reflectivity,
        Reflectivity::Glass { transmission: 0.75 }
    );
    let motion = walker.motion.as_ref().unwrap();
    assert_eq!(motion.offset_m(2.0), Some(Vector2::new(2.0, -1.0)));
    assert_eq!(motion.offset_m(5.0), None);
    let still = walker.at(2.0).unwrap();
    assert_eq!(
        (still.motion.as_ref(), place(&still)),
        (None, [3.0, 1.0, 3.0])
    );
    assert_eq!(walker.at(5.0), None);
    let leaving = solid("shape = \"plane\"\nappears_s = 1");
    assert!(leaving.at(0.9).is_none() && leaving.at(1e9).is_some());
}

/// The keys of a solid, and how the message begins.
const ERRORS: &str = r#"shape = "plane"\nheight_m = 1
    9: unknown field `height_m`, expected one of `point_m`, `yaw_deg`, `pitch_deg`, `roll_deg`, `name`, `reflectivity`, `motion`
shape = "plane"\npitch_deg = 95
    7: a plane that is steep or upside down
shape = "box"\ncentre_m = [0, 0, 0]\nsize_m = [1, 1, 1]\nroll_deg = inf
    11: `roll_deg`: inf is not between
shape = "cylinder"\nradius_m = 1\nheight_m = 1
    7: a cylinder needs either `centre_m` or `base_m`
shape = "cylinder"\nradius_m = 1\nheight_m = 1\nbase_m = [0, 0, 0]\ncentre_m = [0, 0, 0]
    7: a cylinder needs either
shape = "cylinder"\nbase_m = [0, 0, 0]\nradius_m = 0\nheight_m = 1
    10: `radius_m`: 0 is not between
shape = "sphere"\ncentre_m = [0, 0]\nradius_m = 1
    9: `centre_m`: invalid length 2
shape = "mesh"\nvertices_m = [\n  [0, 0, 0],\n  [nan, 0, 0],\n]\ntriangles = []
    11: `vertices_m`: NaN is not between
shape = "mesh"\nvertices_m = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]\ntriangles = [\n  [0, 1, 2],\n  [0, 1, 3],\n]
    12: `triangles`: triangle 1 has vertex 3, but there are 3
shape = "mesh"\nvertices_m = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]\ntriangles = [[0, 1, 2]]
    10: `triangles`: triangle 0 has no area
shape = "mesh"\nvertices_m = []\ntriangles = []
    7: a mesh needs at least one triangle
shape = "mesh"\nvertices_m = []\ntriangles = [[0, -1, 2]]
    10: `triangles`: invalid value: integer `-1`
shape = "height_field"\norigin_m = [0, 0, 0]\nspacing_m = 1\nheights_m = [[0, 0], [0]]
    11: `heights_m`: row 1 has 1 heights, the first row has 2
shape = "height_field"\norigin_m = [0, 0, 0]\nspacing_m = 1\nheights_m = [[0, 0]]
    11: `heights_m`: a height field needs at least 2 rows
shape = "plane"\nreflectivity.glass = { transmission = 1.1 }
    9: `transmission`: 1.1 is not between 0 and 1
shape = "plane"\nreflectivity.glass = { probability = 1 }
    9: unknown field `probability`, expected `transmission`
shape = "plane"\nmotion = [{ t_s = 1, x_m = 0, y_m = 0 },\n  { t_s = 1, x_m = 0, y_m = 0 }]
    10: keyframe 1 is not later
shape = "plane"\nmotion = [{ t_s = 1, x_m = nan, y_m = 0 }]
    9: `x_m`: NaN is not between
shape = "plane"\nmotion = [{ t_s = 1, x_m = 0 }]
    9: `motion`: missing field `y_m`
shape = "plane"\nappears_s = 2\nleaves_s = 1
    10: `leaves_s`: `leaves_s` is not later than `appears_s`"#;

#[test]
fn errors_name_file_line_and_key() {
    let lines: Vec<&str> = ERRORS.lines().collect();
    for pair in lines.chunks(2) {
        let (text, expected) = (pair[0].replace("\\n", "\n"), pair[1].trim_start());
        let message = match parse(&text) {
            Ok(_) => panic!("{text} was accepted"),
            Err(error) => error.to_string(),
        };
        let expected = format!("solids.toml:{expected}");
        assert!(
            message.starts_with(&expected),
            "{text}\n{message}\nexpected\n{expected}"
        );
    }
}

#[test]
fn worlds_are_bounded() {
    let heights = format!("[{}]", vec!["0"; 1000].join(","));
    let rows = vec![heights; 101].join(",");
    let text = format!(
        "shape = \"height_field\"\norigin_m = [0, 0, 0]\nspacing_m = 1\nheights_m = [{rows}]"
    );
    let message = parse(&text).err().unwrap().to_string();
    assert_eq!(
        message,
        "solids.toml:7: more than 200000 triangles in all meshes"
    );
    let crowd = vec!["shape = \"plane\"\nappears_s = 1"; 51].join("\n[[solids]]\n");
    let message = parse(&crowd).err().unwrap().to_string();
    assert_eq!(message, "solids.toml:157: more than 50 moving solids");
}
