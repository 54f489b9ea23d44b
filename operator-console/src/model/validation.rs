//! Whether what a robot says of itself can be shown: as many numbers as there may be, and all of them finite.

use protocol::message::{Info, MAX_SENSORS, SensorInfo, Status};

pub(super) fn is_info_valid(info: &Info) -> bool {
    let numbers = info.footprint_m.iter().chain(&info.limits).chain([
        &info.stop_decel_mps2,
        &info.stop_decel_radps2,
        &info.footprint_offset_m,
    ]);
    info.sensors.len() <= MAX_SENSORS
        && all_finite(numbers)
        && info.sensors.iter().all(is_sensor_valid)
}

fn is_sensor_valid(sensor: &SensorInfo) -> bool {
    let mount = sensor.mount.iter();
    let place = mount.flat_map(|mount| mount.position_m.iter().chain([&mount.yaw_rad]));
    let view = sensor.view.iter();
    let view = view.flat_map(|view| view.angles_rad.iter().chain(&view.range_m));
    all_finite(place.chain(view).chain(&sensor.rate_hz))
}

pub(super) fn is_status_valid(status: &Status) -> bool {
    status.sensors.len() <= MAX_SENSORS
        && all_finite(status.sensors.iter().map(|sensor| &sensor.rate_hz))
}

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> bool {
    numbers.into_iter().all(|number| number.is_finite())
}
