use std::path::Path;

use clap::Parser as _;
use nalgebra::Translation3;

use super::*;
use crate::cli::{Cli, Command};
use crate::driving::monitor_input;
use crate::runtime::replay::{create_run, survey_recording};
use localization::pose_buffer::PoseJump;
use localization::registration::RegistrationOutput;
use mapping::ground_plane::GroundConfig;
use mapping::ground_plane::{GroundPlane, GroundTracker};
use mapping::obstacle::ObstacleConfig;
use mapping::registered_scan::SensorId;
use mapping::vehicle::VehicleConfig;
use teleop::TeleopConfig;
use teleop::collision_monitor::{CollisionMonitorConfig, CollisionMonitorRules};

/// Of a vehicle whose heights are mapped; nobody listens.
fn state_publisher(on_jump: OnJump) -> StatePublisher {
    let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
    let (guard, obstacle) = (CollisionMonitorConfig::default(), ObstacleConfig::default());
    let rules = CollisionMonitorRules::new(&guard, &teleop, &vehicle, &obstacle).unwrap();
    let ground = GroundTracker::new(&GroundConfig::default(), vehicle.wheelbase_m());
    let (monitor_input, _, _) = monitor_input(rules, 1, Some(ground));
    StatePublisher {
        publish_state: Arc::new(PublishState::default()),
        drive_state: None,
        monitor_input: Some(monitor_input),
        on_jump,
        velocity_estimator: VelocityEstimator::new(RobotDuration::from_millis(100)),
        sensors: SensorMonitor::new(Vec::new()),
        since: None,
        published_sensors: None,
        last_pose_stamp: None,
    }
}

fn at_height(z_m: f64) -> Pose {
    Pose::from_parts(Translation3::new(0.0, 0.0, z_m), nalgebra::one())
}

fn scan(millis: i64, odom_from_base: Pose) -> RegistrationOutput {
    RegistrationOutput::Scan(RegisteredScan {
        stamp: RobotTime::from_nanos(1_000_000 * millis),
        sensor: SensorId(0),
        beam_step_rad: 0.01,
        own_body_hits: 0,
        odom_from_base,
        beams: Vec::new(),
    })
}

/// The collision monitor's ground plane restarts with the maps: otherwise a pose jump would look like a step in the floor.
#[test]
fn a_jump_that_erases_the_maps_resets_the_monitors_ground() {
    let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/rooms.mcap");
    let line = ["robot-edge", "replay", rooms.to_str().unwrap()];
    let line = line.into_iter().chain(["--no-network", "--quiet"]);
    let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
        unreachable!("it says so");
    };
    let (survey, config, plan) = survey_recording(&command).unwrap();
    let (run, _source) = create_run(&command, true, &survey, &config, plan).unwrap();
    for (on_jump, ground_z_m) in [(OnJump::Keep, 0.0), (OnJump::Reset, 3.0)] {
        let localization = &mut run.start().unwrap().localization;
        localization.state_publisher = Some(state_publisher(on_jump));
        let jump = RegistrationOutput::Jump(PoseJump {
            stamp: RobotTime::from_nanos(100_000_000),
            distance_m: 3.0,
        });
        let behind = scan(100, at_height(3.0));
        localization.registered = vec![scan(0, at_height(0.0)), jump, behind];
        localization.finish(&mut |_step| Ok(())).unwrap();
        let monitor_input = localization
            .state_publisher
            .as_ref()
            .and_then(|h| h.monitor_input.as_ref());
        let ground = GroundPlane::under(&at_height(ground_z_m));
        assert_eq!(
            monitor_input.unwrap().ground_plane(),
            Some(ground),
            "{on_jump:?}"
        );
    }
}
