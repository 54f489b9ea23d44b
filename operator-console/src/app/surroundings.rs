//! What the map shows around the vehicle, from what the robot tells.

use std::f64::consts::TAU;

use eframe::egui::Color32;
use protocol::message::SensorInfo;
use robot_edge::clock::Monotonic;

use crate::map_view::{LastScan, SensorField, Stopping, Surroundings};
use crate::model::ConsoleModel;

/// A sweep that was heard longer ago says nothing of now, seconds.
const FRESH_S: f64 = 2.0;
/// What a sensor that turns all around may leave out: coarse ones have steps of some degrees.
const FULL_TURN_GAP_RAD: f64 = 0.1;

/// Of the robot that is shown; `color`: its own, whoever else is there.
pub(super) fn surroundings(model: &ConsoleModel, color: Color32, now: Monotonic) -> Surroundings {
    let stopping = model.info().and_then(|info| {
        let decel_mps2 = f64::from(info.stop_decel_mps2);
        let teleop = model
            .status()
            .and_then(|(status, _)| status.teleop.as_ref());
        let age_ms = teleop.and_then(|teleop| teleop.age_ms);
        // Where nobody drives: as old as a command may be.
        let command_age_s = f64::from(age_ms.unwrap_or(info.max_command_age_ms)) * 1e-3;
        (decel_mps2 > 0.0).then_some(Stopping {
            decel_mps2,
            command_age_s,
        })
    });
    Surroundings {
        stopping,
        sensors: model.sensors().iter().filter_map(field).collect(),
        scan: scan(model, now),
        color: Some(color),
    }
}

fn field(sensor: &SensorInfo) -> Option<SensorField> {
    let (mount, view) = (sensor.mount?, sensor.view?);
    let [low_rad, high_rad] = view.angles_rad.map(f64::from);
    let [x_m, y_m, _] = mount.position_m.map(f64::from);
    let field_rad = high_rad - low_rad;
    // The last beam of a full turn is a step before the first.
    let is_full_turn = field_rad > TAU - FULL_TURN_GAP_RAD;
    Some(SensorField {
        mount_m: [x_m, y_m],
        mount_rad: f64::from(mount.yaw_rad) + 0.5 * (low_rad + high_rad),
        field_rad: if is_full_turn { TAU } else { field_rad },
        range_m: view.range_m.map(f64::from),
    })
}

/// The last sweeps of all sensors, as one.
fn scan(model: &ConsoleModel, now: Monotonic) -> Option<LastScan> {
    let fresh = || {
        let all = model.scans().map(|(_, scan)| scan);
        all.filter(|scan| now.since(scan.heard).as_secs_f64() < FRESH_S)
    };
    let age = fresh().map(|scan| now.since(scan.heard)).min()?;
    let points_m = fresh().flat_map(|scan| scan.points_m.iter().copied());
    Some(LastScan {
        points_m: points_m.collect(),
        age,
    })
}
