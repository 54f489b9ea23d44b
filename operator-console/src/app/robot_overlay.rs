//! What the map shows around the vehicle.

use std::f64::consts::TAU;
use std::time::Duration;

use eframe::egui::Color32;
use measurement::time::Monotonic;
use protocol::message::SensorInfo;

use crate::map_view::{LastScan, RobotOverlay, SensorField, Stopping};
use crate::model::{self, ConsoleModel};
use crate::playback::is_recording;

const FRESH: Duration = Duration::from_secs(2);
/// Allowed gap of a sensor with a full turn: coarse ones have steps of some degrees.
const FULL_TURN_GAP_RAD: f64 = 0.1;

pub(super) fn robot_overlay_data(
    model: &ConsoleModel,
    color: Color32,
    now: Monotonic,
) -> RobotOverlay {
    let stopping = model.info().and_then(|info| {
        let decel_mps2 = f64::from(info.stop_decel_mps2);
        let teleop = model
            .status()
            .and_then(|(status, _)| status.teleop.as_ref());
        let age_ms = teleop.and_then(|teleop| teleop.age_ms);
        // Without an operator: the greatest allowed age.
        let command_age_s = f64::from(age_ms.unwrap_or(info.max_command_age_ms)) * 1e-3;
        (decel_mps2 > 0.0).then_some(Stopping {
            decel_mps2,
            command_age_s,
        })
    });
    RobotOverlay {
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
    // The last beam of a full turn is one step before the first.
    let is_full_turn = field_rad > TAU - FULL_TURN_GAP_RAD;
    Some(SensorField {
        mount_m: [x_m, y_m],
        mount_rad: f64::from(mount.yaw_rad) + 0.5 * (low_rad + high_rad),
        field_rad: if is_full_turn { TAU } else { field_rad },
        range_m: view.range_m.map(f64::from),
    })
}

fn scan(model: &ConsoleModel, now: Monotonic) -> Option<LastScan> {
    let fresh = || {
        let all = model.scans().map(|(_, scan)| (scan, age(model, scan, now)));
        all.filter(|(_, age)| *age < FRESH)
    };
    let age = fresh().map(|(_, age)| age).min()?;
    let points_m = fresh().flat_map(|(scan, _)| scan.points_m.iter().copied());
    Some(LastScan {
        points_m: points_m.collect(),
        age,
    })
}

/// In a recording or at the end of the data time may stand still: then at most by stamp and displayed time.
fn age(model: &ConsoleModel, scan: &model::LastScan, now: Monotonic) -> Duration {
    let here = now.since(scan.received_at);
    let may_stand = is_recording(model.robot()) || model.reports_ended();
    match model.vehicle().stamp_ns().filter(|_| may_stand) {
        Some(shown_ns) => here.min(Duration::from_nanos(shown_ns.abs_diff(scan.stamp_ns))),
        None => here,
    }
}

#[cfg(test)]
mod tests {
    use protocol::keys::Topic;
    use protocol::message::Scan;

    use super::*;
    use crate::test_support::{at, console, ended_status, inject_at, pose_at_rest};

    const SECOND_NS: i64 = 1_000_000_000;

    /// A scan at 58 s of the robot's data, received at 1 s.
    fn swept(robot: &str) -> ConsoleModel {
        let mut model = console(robot, &[]);
        model.want_scan(true);
        let sweep = Scan::of_points("laser".to_owned(), [0.0; 2], [[1.0, 2.0]]);
        inject_at(&mut model, 58 * SECOND_NS, Topic::Scan, &sweep, at(1_000));
        model
    }

    fn stands_at(model: &mut ConsoleModel, stamp_ns: i64, ms: u64) {
        inject_at(model, stamp_ns, Topic::Pose, &pose_at_rest(), at(ms));
    }

    fn age_ms(model: &ConsoleModel, ms: u64) -> Option<u128> {
        scan(model, at(ms)).map(|scan| scan.age.as_millis())
    }

    #[test]
    fn scan_stays_in_paused_recording_and_fades_live() {
        let [mut recording, mut robot] = ["recording-1a2b3c", "scout"].map(swept);
        for model in [&mut recording, &mut robot] {
            stands_at(model, 58 * SECOND_NS + SECOND_NS / 10, 1_050);
        }
        assert_eq!(age_ms(&recording, 61_000), Some(100));
        assert_eq!(age_ms(&robot, 2_500), Some(1_500));
        assert_eq!(age_ms(&robot, 61_000), None);
        let ended = ended_status();
        inject_at(&mut robot, 0, Topic::Status, &ended, at(61_000));
        assert_eq!(age_ms(&robot, 62_000), Some(100), "nothing follows it");
        // After a seek, before another scan.
        stands_at(&mut recording, 20 * SECOND_NS, 61_000);
        assert_eq!(age_ms(&recording, 62_000), None);
    }
}
