//! Waves and errors of a boat's world that make no sense.

use super::*;

#[test]
fn senseless_waves_and_errors_are_refused() {
    let refused = |from: &str, to: &str| {
        let text = LAKE.replace(from, to);
        World::parse("lake.toml", &text).err().unwrap().to_string()
    };
    let waves = |height: &str, second: &str| {
        format!("[waves]\n{height}\nperiod_s = 2.0\nheading_deg = 0.0\n{second}\n\n[path]")
    };
    assert_eq!(
        refused("[path]", &waves("height_m = 1.0", "")),
        "lake.toml:7: `height_m`: waves of 2 s break above 0.89 m, a seventh of their length"
    );
    assert_eq!(
        refused(
            "[path]",
            &waves(
                "height_m = 0.1",
                "second = { height_m = 9.0, period_s = 5.0, heading_deg = 1.0 }"
            )
        ),
        "lake.toml:10: `height_m`: waves of 5 s break above 5.57 m, a seventh of their length"
    );
    assert_eq!(
        refused("[path]", &waves("height_m = -0.1", "")),
        "lake.toml:7: `height_m`: -0.1 is not between 0 and 1000000"
    );
    let on_land = format!("{}\n", waves("height_m = 0.1", ""));
    let text = LAKE
        .replace("riverwatch", "introbot")
        .replace("[path]", &on_land);
    let error = World::parse("lake.toml", &text).err().unwrap().to_string();
    assert!(
        error.ends_with("waves move boats only, and `introbot` is none"),
        "{error}"
    );
    assert_eq!(
        refused("dropout = 0.0", "dropout = 0.0, joint_lag_s = 11.0"),
        "lake.toml:3: `joint_lag_s`: 11 is not between 0 and 10"
    );
    assert_eq!(
        refused("dropout = 0.0", "dropout = 0.0, fix_m = -1.0"),
        "lake.toml:3: `fix_m`: -1 is not between 0 and 1000000"
    );
    for options in [
        SimulationOptions {
            joint_lag_s: Some(-0.1),
            ..seeded(1)
        },
        SimulationOptions {
            fix_noise_m: Some(f64::NAN),
            ..seeded(1)
        },
    ] {
        assert!(SimulatedSource::new(&world_with(&[]), options).is_err());
    }
}
