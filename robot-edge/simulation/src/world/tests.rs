#![expect(clippy::float_cmp, reason = "these values are exact")]

use super::*;
use crate::solid::{Reflectivity, Shape};

const SMALL: &str = r#"name = "small"
vehicle = "pioneer"
noise = { range_m = 0.01, dropout = 0.005 }
start = { x_m = 0.5, y_m = 0, yaw_deg = 90.0 }

[path]
speed_mps = 0.5
turn_rate_degps = 60.0
waypoints = [
    { x_m = 0.5, y_m = 2.0 },
]

[[solids]]
shape = "wall"
from_m = [-1.0, 3.0]
to_m = [2.0, 3.0]
thickness_m = 0.2
height_m = 2.5

[[solids]]
shape = "box"
name = "crate"
centre_m = [2.0, 1.0, 0.4]
size_m = [1.2, 0.8, 0.8]
yaw_deg = 30.0
reflectivity.specular = { probability = 0.3 }
"#;

#[test]
fn a_small_world_is_read_as_written() {
    let world = World::parse("small.toml", SMALL).unwrap();
    assert_eq!((world.name(), world.vehicle()), ("small", "pioneer"));
    assert_eq!(world.laser_errors().dropout, 0.005);
    assert!((world.path().duration_s() - 4.0).abs() < 1e-12);
    let [wall, crate_] = world.solids() else {
        panic!("{:?}", world.solids())
    };
    let Shape::Box { size_m } = wall.shape else {
        panic!("{wall:?}")
    };
    assert_eq!(size_m, [3.0, 0.2, 2.5]);
    assert_eq!(
        wall.world_from_solid.translation.vector.as_slice(),
        [0.5, 3.0, 1.25]
    );
    assert_eq!(wall.reflectivity, Reflectivity::Diffuse);
    assert_eq!(crate_.name, "crate");
    assert!(
        (measurement::pose::yaw_rad(&crate_.world_from_solid).to_degrees() - 30.0).abs() < 1e-12
    );
    assert_eq!(
        crate_.reflectivity,
        Reflectivity::Specular { probability: 0.3 }
    );
}

#[test]
fn a_world_may_say_the_columns_of_a_lidar() {
    let columns = |vehicle: &str, columns: &str| {
        let text = SMALL.replace("\"pioneer\"", &format!("\"{vehicle}\""));
        let text = text.replace("[path]", &format!("[lidar]\ncolumns = {columns}\n\n[path]"));
        let world = World::parse("small.toml", &text);
        world
            .map(|world| world.vehicle.laser.planar.beams)
            .map_err(|error| error.to_string())
    };
    assert_eq!(columns("lidar64", "2048"), Ok(2048));
    assert_eq!(
        World::load("bridge").unwrap().vehicle.laser.planar.beams,
        1024
    );
    assert_eq!(
        columns("pioneer", "2048").unwrap_err(),
        "small.toml:6: `pioneer` has no lidar"
    );
    assert!(
        columns("lidar64", "0")
            .unwrap_err()
            .starts_with("small.toml:7: `columns`: ")
    );
}

/// What is said of [`SMALL`] with `from` replaced by `to`.
fn message(from: &str, to: &str) -> String {
    assert!(SMALL.contains(from), "{from}");
    match World::parse("small.toml", &SMALL.replacen(from, to, 1)) {
        Ok(_) => panic!("{to} was accepted"),
        Err(error) => error.to_string(),
    }
}

/// What is replaced by what, and how the message begins.
const ERRORS: &str = r#"thickness_m = 0.2 => thicknes_m = 0.2
    small.toml:17: unknown field `thicknes_m`, expected one of
thickness_m = 0.2\n =>
    small.toml:13: missing field `thickness_m`
thickness_m = 0.2 => thickness_m = 0
    small.toml:17: `thickness_m`: 0 is not between 0.000001 and
height_m = 2.5 => height_m = "2.5"
    small.toml:18: `height_m`: invalid type: string "2.5", expected f64
[1.2, 0.8, 0.8] => [1.2, -0.8, 0.8]
    small.toml:24: `size_m`: -0.8 is not between
[1.2, 0.8, 0.8] => [1.2, 0.8]
    small.toml:24: `size_m`: invalid length 2
yaw_deg = 30.0 => yaw_deg = nan
    small.toml:25: `yaw_deg`: NaN is not between
probability = 0.3 => probability = 1.5
    small.toml:26: `probability`: 1.5 is not between 0 and 1
specular => shiny
    small.toml:26: unknown variant `shiny`, expected one of `diffuse`, `specular`, `glass`
"box" => "ball"
    small.toml:21: `shape`: unknown `shape` "ball", expected "plane", "box", "wall",
shape = "wall"\n =>
    small.toml:13: a solid needs `shape`
x_m = 0.5, y_m = 2.0 => x_m = 0.5, y_m = inf
    small.toml:10: `y_m`: inf is not between
x_m = 0.5, y_m = 2.0 => x_m = 0.5, y_m = 0
    small.toml:10: `waypoints`: waypoint 0 is where the one before it is
dropout = 0.005 => dropout = -1
    small.toml:3: `dropout`: -1 is not between 0 and 1
"pioneer" => "pionier"
    small.toml:2: `vehicle`: `pionier` cannot be simulated, only pioneer
to_m = [2.0, 3.0] => to_m = [-1, 3]
    small.toml:13: a wall whose `from_m` and `to_m` are the same
speed_mps = 0.5 => speed_mps = 0.000001
    small.toml:6: the path takes 2000000 s
name = "small" => name = "small
    small.toml:1:
[[solids]]\nshape = "wall" => [solids]\nshape = "wall"
    small.toml:20:"#;

/// The cases of such a table; `\n` in it is a line break.
fn cases(table: &str) -> Vec<(String, String, &str)> {
    let lines: Vec<&str> = table.lines().collect();
    lines
        .chunks(2)
        .map(|pair| {
            let (from, to) = pair[0].split_once(" =>").unwrap();
            let text = |part: &str| part.trim_start().replace("\\n", "\n");
            (text(from), text(to), pair[1].trim_start())
        })
        .collect()
}

#[test]
fn errors_name_file_line_and_key() {
    for (from, to, expected) in cases(ERRORS) {
        let message = message(&from, &to);
        assert!(
            message.starts_with(expected),
            "{from} => {to}:\n{message}\nexpected\n{expected}"
        );
    }
}

#[test]
fn solids_must_be_an_array_of_tables() {
    let text = SMALL.split("[[solids]]").next().unwrap();
    assert_eq!(World::parse("w", text).unwrap().solids().len(), 0);
    let error = World::parse("w", &format!("solids = 3\n{text}"))
        .err()
        .unwrap();
    assert_eq!(
        error.to_string(),
        "w:1: `solids`: expected `[[solids]]` tables, found integer"
    );
}

#[test]
fn unknown_worlds_get_a_hint_and_missing_files_a_reason() {
    let message = |name| World::load(name).err().unwrap().to_string();
    assert_eq!(
        message("room"),
        "no world is called `room` (did you mean `rooms`?): there are rooms, hall, floor, ramp, street, bumps, turn, walker, \
         yard, meadow, lake, dock, bridge, thicket, jetty, or give a world file (.toml)"
    );
    assert!(message("lagoon").starts_with("no world is called `lagoon`: there are"));
    assert!(message("no/such.toml").starts_with("no/such.toml: "));
    assert!(message("such.toml").starts_with("such.toml: "));
}

#[test]
fn files_are_read_and_large_ones_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.toml");
    std::fs::write(&path, SMALL).unwrap();
    assert_eq!(World::load(path.to_str().unwrap()).unwrap().name(), "small");
    std::fs::write(&path, "#".repeat(MAX_FILE_BYTES as usize + 1)).unwrap();
    let error = World::load(path.to_str().unwrap()).err().unwrap();
    assert!(matches!(error, WorldError::TooLarge { .. }), "{error}");
    std::fs::write(&path, [0xff, 0xfe]).unwrap();
    let error = World::load(path.to_str().unwrap()).err().unwrap();
    assert!(matches!(error, WorldError::Io { .. }), "{error}");
}

#[test]
fn every_built_in_world_loads_under_its_own_name() {
    for name in World::names() {
        assert_eq!(World::load(name).unwrap().name(), *name);
    }
    assert_eq!(
        BUILT_IN.iter().map(|(name, _)| *name).collect::<Vec<_>>(),
        World::names()
    );
}

mod built_in;
mod plants;
mod solids;
