//! Which values make sense for sensors.

use crate::config::checks::{Allowed, Checks, as_toml};
use crate::config::layer::quoted;
use crate::config::sensors::{RangeSensorConfig, SensorConfig, TiltConfig, WheelEncodersConfig};
use measurement::mount::Mount;

pub(super) fn sensor(checks: &mut Checks, name: &str, sensor: &SensorConfig) {
    let path = format!("sensors.{name}");
    if let Some(topic) = sensor.topic() {
        let key = format!("{path}.topic");
        checks.name(&key, topic, "no stream can have this name");
    }
    match sensor {
        SensorConfig::LaserScan(range) | SensorConfig::Sonar(range) => {
            ranges(checks, &path, range);
            octree_model(checks, &path, range);
            if let Some(servo) = &range.tilt {
                tilt(checks, &path, servo);
            }
            placed(checks, &path, range.time_offset_s, &range.mount);
        }
        SensorConfig::WheelEncoders(encoders) => wheel_encoders(checks, &path, encoders),
        SensorConfig::Imu(imu) => placed(checks, &path, imu.time_offset_s, &imu.mount),
        SensorConfig::Gps(gps) => placed(checks, &path, gps.time_offset_s, &gps.mount),
    }
}

fn ranges(checks: &mut Checks, path: &str, laser: &RangeSensorConfig) {
    let key = |name: &str| format!("{path}.{name}");
    let along = "ranges are metres along a beam";
    if let Some(range_min_m) = laser.range_min_m {
        checks.number(
            &key("range_min_m"),
            range_min_m,
            Allowed::Within(0.0, 10_000.0),
            along,
        );
    }
    if let Some(range_max_m) = laser.range_max_m {
        checks.number(
            &key("range_max_m"),
            range_max_m,
            Allowed::PositiveUpTo(10_000.0),
            along,
        );
    }
    if let (Some(range_min_m), Some(range_max_m)) = (laser.range_min_m, laser.range_max_m)
        && range_min_m >= range_max_m
    {
        let why = "no range could be a hit";
        checks.issue(
            &key("range_max_m"),
            as_toml(range_max_m),
            why,
            format!("above range_min_m = {range_min_m}"),
        );
    }
    if let Some(model) = &laser.model {
        checks.name(&key("model"), model, "a device has a name");
    }
    if let Some(beams) = laser.beams {
        checks.whole(
            &key("beams"),
            beams.into(),
            1,
            100_000,
            "every beam takes memory and time",
        );
    }
    if let Some(field_of_view_deg) = laser.field_of_view_deg {
        let why = "a planar sensor sweeps at most one turn";
        checks.number(
            &key("field_of_view_deg"),
            field_of_view_deg,
            Allowed::PositiveUpTo(360.0),
            why,
        );
    }
    if let Some(rate_hz) = laser.rate_hz {
        let why = "sweeps take time";
        checks.number(&key("rate_hz"), rate_hz, Allowed::PositiveUpTo(1000.0), why);
    }
}

fn wheel_encoders(checks: &mut Checks, path: &str, encoders: &WheelEncodersConfig) {
    let key = |name: &str| format!("{path}.{name}");
    let joint = "no joint can have this name";
    checks.name(&key("left_joint"), &encoders.left_joint, joint);
    checks.name(&key("right_joint"), &encoders.right_joint, joint);
    if encoders.left_joint == encoders.right_joint {
        let why = "the vehicle moves by the mean of two wheels";
        checks.issue(
            &key("right_joint"),
            format!("\"{}\"", quoted(&encoders.right_joint)),
            why,
            "a joint other than left_joint".to_owned(),
        );
    }
    checks.number(
        &key("wheel_radius_m"),
        encoders.wheel_radius_m,
        Allowed::PositiveUpTo(10.0),
        "it turns the wheels' angles into metres",
    );
    time_offset(checks, path, encoders.time_offset_s);
}

/// Most neighbours that a hit has: two beams on either side, and the same five of the scan before.
const MOST_NEIGHBOURS: u64 = 9;

fn octree_model(checks: &mut Checks, path: &str, range: &RangeSensorConfig) {
    let key = |name: &str| format!("{path}.{name}");
    if let Some(p_hit) = range.p_hit {
        let why = "a hit must make a voxel more likely to be occupied";
        let allowed = Allowed::Within(0.501, 0.999);
        checks.number(&key("p_hit"), p_hit, allowed, why);
    }
    if let Some(p_miss) = range.p_miss {
        let why = "seeing through a voxel must make it less likely to be occupied";
        let allowed = Allowed::Within(0.001, 0.499);
        checks.number(&key("p_miss"), p_miss, allowed, why);
    }
    if let Some(divergence) = range.divergence_mrad {
        let why = "it is the full angle of a beam's cone";
        let allowed = Allowed::Within(0.0, 500.0);
        checks.number(&key("divergence_mrad"), divergence, allowed, why);
    }
    if let Some(least) = range.min_neighbours {
        let why = "a hit has no more neighbours";
        let name = key("min_neighbours");
        checks.whole(&name, least.into(), 0, MOST_NEIGHBOURS, why);
    }
}

fn tilt(checks: &mut Checks, path: &str, tilt: &TiltConfig) {
    let path = format!("{path}.tilt");
    let key = |name: &str| format!("{path}.{name}");
    if let Some(topic) = &tilt.topic {
        checks.name(&key("topic"), topic, "no stream can have this name");
    }
    checks.name(&key("joint"), &tilt.joint, "no joint can have this name");
    if tilt.scale == 0.0 {
        let why = "the sensor would not tilt";
        let allowed = "-100 to 100, not 0".to_owned();
        checks.issue(&key("scale"), as_toml(tilt.scale), why, allowed);
    } else {
        let why = "it is the gear between joint and sensor";
        checks.number(
            &key("scale"),
            tilt.scale,
            Allowed::Within(-100.0, 100.0),
            why,
        );
    }
    checks.number(
        &key("offset_deg"),
        tilt.offset_deg,
        Allowed::Within(-360.0, 360.0),
        "angles are degrees, at most one turn",
    );
    time_offset(checks, &path, tilt.time_offset_s);
}

fn placed(checks: &mut Checks, path: &str, time_offset_s: f64, on_vehicle: &Mount) {
    time_offset(checks, path, time_offset_s);
    mount(checks, path, on_vehicle);
}

fn time_offset(checks: &mut Checks, path: &str, time_offset_s: f64) {
    let offset = "it makes up for latency; clocks that differ by more cannot be reconciled";
    checks.number(
        &format!("{path}.time_offset_s"),
        time_offset_s,
        Allowed::Within(-3600.0, 3600.0),
        offset,
    );
}

fn mount(checks: &mut Checks, path: &str, mount: &Mount) {
    let key = |name: &str| format!("{path}.mount.{name}");
    for (name, value) in [("x_m", mount.x_m), ("y_m", mount.y_m), ("z_m", mount.z_m)] {
        let why = "a sensor sits on its vehicle";
        checks.number(&key(name), value, Allowed::Within(-100.0, 100.0), why);
    }
    for (name, value) in [
        ("roll_deg", mount.roll_deg),
        ("pitch_deg", mount.pitch_deg),
        ("yaw_deg", mount.yaw_deg),
    ] {
        let why = "angles are degrees, at most one turn";
        checks.number(&key(name), value, Allowed::Within(-360.0, 360.0), why);
    }
}
