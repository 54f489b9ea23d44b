//! Registers a scan from a moving vehicle: each beam is placed with the pose of its own time.
//!
//! `cargo run -p localization --example deskew`
#![expect(clippy::print_stdout, reason = "the output of the example")]

use localization::beam_projection::{BeamProjector, BodyBox, SensorSettings, ZeroRange};
use localization::pose_buffer::{InterpolationLimits, JumpLimit, PoseBuffer};
use mapping::registered_scan::{ScanKind, SensorId};
use measurement::drops::DropReason;
use measurement::pose::planar;
use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};

fn main() -> Result<(), DropReason> {
    let ms = |ms: i64| RobotTime::from_nanos(ms * 1_000_000);
    let limits = InterpolationLimits {
        max_gap: RobotDuration::from_millis(500),
        max_extrapolation: RobotDuration::from_millis(100),
        jump: JumpLimit {
            slack_m: 1.0,
            speed_mps: 20.0,
        },
    };
    let mut poses = PoseBuffer::default();
    poses.insert(ms(0), planar(0.0, 0.0, 0.0)); // 2 m/s along x
    poses.insert(ms(100), planar(0.2, 0.0, 0.0));

    let sensor = SensorSettings {
        id: SensorId(0),
        kind: ScanKind::Beams,
        range_min_m: None,
        range_max_m: None,
        zero_range: ZeroRange::Invalid,
        time_offset: RobotDuration::ZERO,
        thin_m: 0.0,
        base_from_sensor: planar(0.0, 0.0, 0.0),
    };
    let body = BodyBox {
        length_m: 0.5,
        width_m: 0.5,
        offset_m: 0.0,
        lowest_m: 0.0,
        highest_m: 0.5,
    };
    let scan = Scan {
        time_increment_s: 0.025,
        range_min_m: 0.1,
        range_max_m: 20.0,
        ranges_m: vec![5.0; 5], // five beams straight ahead, 25 ms apart
        ..Scan::default()
    };
    let pose_at = |stamp| Ok(poses.segment(stamp, &limits)?.pose_at(stamp));
    let registered =
        BeamProjector::new(sensor, body).project(&scan, ms(0), pose_at(ms(0))?, pose_at)?;
    for beam in registered.beams {
        println!(
            "beam {} ends at x = {:.3} m",
            beam.index, beam.end_in_odom.x
        );
    }
    Ok(())
}
