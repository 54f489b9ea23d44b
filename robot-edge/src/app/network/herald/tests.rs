use std::path::Path;

use clap::Parser as _;
use nalgebra::Translation3;

use super::*;
use crate::app::replay::{look_through, set_up};
use crate::cli::{Cli, Command};
use crate::config::VehicleConfig;
use crate::driving::lookout;
use crate::localization::placer::Placed;
use crate::localization::pose_jump::PoseJump;
use crate::mapping::elevation_config::{GroundConfig, ObstacleConfig};
use crate::mapping::ground_plane::{GroundPlane, GroundTracker};
use crate::mapping::posed_scan::SensorId;
use crate::teleop::TeleopConfig;
use crate::teleop::guard::{GuardConfig, GuardRules};

/// Of a vehicle whose heights are mapped; nobody listens.
fn herald(on_jump: OnJump) -> Herald {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let (guard, obstacle) = (GuardConfig::default(), ObstacleConfig::default());
    let rules = GuardRules::new(&guard, &teleop, &vehicle, &obstacle).unwrap();
    let ground = GroundTracker::new(&GroundConfig::default(), vehicle.wheelbase_m());
    let (lookout, _, _) = lookout(rules, 1, Some(ground));
    Herald {
        shared: Arc::new(Shared::default()),
        board: None,
        lookout: Some(lookout),
        on_jump,
        speedometer: Speedometer::new(RobotDuration::from_millis(100)),
        sensors: SensorWatch::new(Vec::new()),
        since: None,
        told_sensors: None,
        moved: None,
    }
}

fn at_height(z_m: f64) -> Pose {
    Pose::from_parts(Translation3::new(0.0, 0.0, z_m), nalgebra::one())
}

fn scan(millis: i64, odom_from_base: Pose) -> Placed {
    Placed::Scan(PosedScan {
        stamp: RobotTime::from_nanos(1_000_000 * millis),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        own_body_hits: 0,
        odom_from_base,
        beams: Vec::new(),
    })
}

/// The guard's ground is taken anew with the maps: else a step in the poses would be one in the floor.
#[test]
fn at_a_jump_that_erases_the_maps_the_guard_takes_its_ground_anew() {
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings/rooms.mcap");
    let line = ["robot-edge", "replay", rooms.to_str().unwrap()];
    let line = line.into_iter().chain(["--no-network", "--quiet"]);
    let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    let (survey, config, plan) = look_through(&command).unwrap();
    let (run, _source) = set_up(&command, true, &survey, &config, plan).unwrap();
    for (on_jump, ground_z_m) in [(OnJump::Keep, 0.0), (OnJump::Reset, 3.0)] {
        let placing = &mut run.start().unwrap().placing;
        placing.herald = Some(herald(on_jump));
        let jump = Placed::Jump(PoseJump {
            stamp: RobotTime::from_nanos(100_000_000),
            distance_m: 3.0,
        });
        let behind = scan(100, at_height(3.0));
        placing.placed = vec![scan(0, at_height(0.0)), jump, behind];
        placing.finish(&mut |_step| Ok(())).unwrap();
        let lookout = placing.herald.as_ref().and_then(|h| h.lookout.as_ref());
        let ground = GroundPlane::under(&at_height(ground_z_m));
        assert_eq!(lookout.unwrap().ground_plane(), Some(ground), "{on_jump:?}");
    }
}
