//! Plants, water, shores and docks.

use nalgebra::Point2;

use super::*;
use crate::vegetation::{Rigidity, is_inside};

const HEADER: &str = r#"name = "shore"
vehicle = "pioneer"
noise = { range_m = 0.01, dropout = 0.005 }
start = { x_m = 0, y_m = 0, yaw_deg = 0 }
path = { speed_mps = 0.5, turn_rate_degps = 60, waypoints = [{ x_m = 1, y_m = 0 }] }
"#;

const SHORE: &str = include_str!("shore.toml");

fn parse(text: &str) -> Result<World, WorldError> {
    World::parse("shore.toml", &format!("{HEADER}{text}"))
}

#[test]
fn plants_grow_as_the_file_says() {
    let world = parse(SHORE).unwrap();
    let vegetation = &world.scene().growth().unwrap().vegetation;
    let [canes, bush] = vegetation.patches() else {
        panic!("{:?}", vegetation.patches())
    };
    assert_eq!(
        (canes.name.as_str(), canes.rigidity),
        ("canes", Rigidity::Flexible)
    );
    assert_eq!(
        (bush.name.as_str(), bush.rigidity),
        ("bush", Rigidity::Rigid)
    );
    // 8 m² of 30 canes with 2 leaves each.
    assert_eq!(canes.stems, 0..720);
    for cane in vegetation.stems()[canes.stems.clone()].iter().step_by(3) {
        // Rooted in the bed and as high above the water as asked; stiffness 2 halves what wind does.
        assert_eq!(cane.foot_m.z, -1.0);
        assert!((1.5..=2.0).contains(&cane.top_m.z), "{}", cane.top_m.z);
        assert!((0.004..=0.006).contains(&cane.radius_m));
        let height_m = cane.top_m.z + 1.0;
        assert!((cane.reach_m[1] - 0.5 * height_m).abs() < 1e-12);
    }
    let branches = &vegetation.stems()[bush.stems.clone()];
    assert!(branches.len() > 20 && branches.iter().all(|stem| stem.reach_m == [0.0, 0.0]));
    assert!(
        branches.iter().all(|stem| stem.foot_m.z >= 0.0),
        "it stands on the water"
    );
    assert!((vegetation.wind.towards.y - 1.0).abs() < 1e-12);

    let again = parse(SHORE).unwrap();
    assert_eq!(
        vegetation.stems(),
        again.scene().growth().unwrap().vegetation.stems()
    );
    let other = parse(&SHORE.replace("seed = 1", "seed = 7")).unwrap();
    assert_ne!(
        vegetation.stems(),
        other.scene().growth().unwrap().vegetation.stems()
    );
}

#[test]
fn a_world_without_plants_and_water_has_none() {
    let world = parse("").unwrap();
    assert!(world.scene().growth().is_none());
    assert_eq!(world.water_m(), None);
    assert!(world.shores().is_empty() && world.docks().is_empty());
}

#[test]
fn receivers_are_the_files() {
    let receiver = |text: &str| {
        let world = parse(&format!("{SHORE}{text}")).unwrap();
        world.scene().growth().unwrap().receiver
    };
    let default = receiver("");
    assert_eq!((default.min_share, default.separation_m), (0.05, 0.75));
    let own = receiver("[receiver]\nmin_share = 0.1");
    assert_eq!((own.min_share, own.separation_m), (0.1, 0.75));
}

#[test]
fn shores_docks_and_water_are_the_files() {
    let world = parse(SHORE).unwrap();
    let [shore] = world.shores() else {
        panic!("{:?}", world.shores())
    };
    assert_eq!(
        (shore.name.as_str(), shore.class),
        ("reeds", ShoreClass::Dense)
    );
    assert!(
        is_inside(&shore.polygon_m, Point2::new(2.0, 1.0))
            && !is_inside(&shore.polygon_m, Point2::new(6.0, 1.0))
    );
    let dock = &world.docks()[0];
    assert!(
        is_inside(&dock.polygon_m, Point2::new(11.5, 0.5))
            && !is_inside(&dock.polygon_m, Point2::new(10.5, 1.5))
    );
    assert_eq!(world.water_m(), Some(0.0));
}

/// What is replaced by what, and what the message contains.
const ERRORS: &str = r#"kind = "stems" => kind = "tree"
    shore.toml:27: `kind`: unknown `kind` "tree", expected "stems" or "crowns"
kind = "stems" =>
    plants need `kind`
seed = 1\n =>
    missing field `seed`
seed = 1 => seed = -1
    `seed`
rigidity = "flexible" => rigidity = "soft"
    shore.toml:30: `rigidity`: unknown variant `soft`
stiffness = 2.0 => stiffness = 0.01
    `stiffness` is less than 0.1
rectangle_m = [[4.0, 2.0], [0.0, 0.0]] =>
    stems need either `rectangle_m`
rectangle_m = [[4.0, 2.0], [0.0, 0.0]] => polygon_m = [[0, 0], [1, 1]]
    at least 3 corners
rectangle_m = [[4.0, 2.0], [0.0, 0.0]] => along_m = [[0, 0]]\nwidth_m = 1
    at least 2 points
height_m = [1.5, 2.0] => height_m = [2.0, 1.5]
    `height_m`: the least, 2, is more than the most, 1.5
height_m = [1.5, 2.0] => height_m = [1.5, 200.0]
    200 is not between 0 and 20
density_per_m2 = 30.0 => density_per_m2 = 1e5
    more than 500000 stems
density_per_m2 = 30.0 => density_per_m2 = 1e6
    more than 5000000 stems
density_per_m2 => density
    unknown field `density`
lean_deg = 10.0 => lean_deg = 89.0
    `lean_deg` is more than 80
class = "dense" => class = "thick"
    `class`: unknown variant `thick`
[10.0, 0.0], [12.0, 0.0],  =>
    `polygon_m` needs at least 3 corners
name = "stone" => name = "stone"\nfloor = true
    unknown field"#;

#[test]
fn wrong_plants_are_refused_with_their_line() {
    for (from, to, expected) in cases(ERRORS) {
        assert!(SHORE.contains(&from), "{from}");
        let error = parse(&SHORE.replacen(&from, &to, 1)).err().unwrap();
        assert!(error.to_string().contains(expected), "{to}: {error}");
    }
}
