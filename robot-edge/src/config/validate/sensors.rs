//! Which values make sense for sensors.

use crate::config::checks::{Allowed, Checks, as_toml};
use crate::config::layer::quoted;
use crate::config::sensors::{
    ImuConfig, LaserScanConfig, Mount, SensorConfig, WheelEncodersConfig,
};

pub(super) fn sensor(checks: &mut Checks, name: &str, sensor: &SensorConfig) {
    let path = format!("sensors.{name}");
    if let Some(topic) = sensor.topic() {
        let key = format!("{path}.topic");
        checks.name(&key, topic, "no stream can have this name");
    }
    match sensor {
        SensorConfig::LaserScan(laser) => laser_scan(checks, &path, laser),
        SensorConfig::WheelEncoders(encoders) => wheel_encoders(checks, &path, encoders),
        SensorConfig::Imu(imu) => attitude(checks, &path, imu),
    }
}

fn laser_scan(checks: &mut Checks, path: &str, laser: &LaserScanConfig) {
    let key = |name: &str| format!("{path}.{name}");
    let ranges = "ranges are metres along a beam";
    if let Some(range_min_m) = laser.range_min_m {
        checks.number(
            &key("range_min_m"),
            range_min_m,
            Allowed::Within(0.0, 10_000.0),
            ranges,
        );
    }
    if let Some(range_max_m) = laser.range_max_m {
        checks.number(
            &key("range_max_m"),
            range_max_m,
            Allowed::PositiveUpTo(10_000.0),
            ranges,
        );
    }
    if let (Some(range_min_m), Some(range_max_m)) = (laser.range_min_m, laser.range_max_m)
        && range_min_m >= range_max_m
    {
        let why = "no range could be a hit";
        checks.fault(
            &key("range_max_m"),
            as_toml(range_max_m),
            why,
            format!("above range_min_m = {range_min_m}"),
        );
    }
    time_offset(checks, path, laser.time_offset_s);
    mount(checks, path, &laser.mount);
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
        checks.fault(
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

fn attitude(checks: &mut Checks, path: &str, imu: &ImuConfig) {
    time_offset(checks, path, imu.time_offset_s);
    mount(checks, path, &imu.mount);
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
