use proptest::prelude::*;

use super::*;
use crate::collision_monitor::CollisionMonitorConfig;
use crate::config::TeleopConfig;
use crate::motion::Velocity;
use mapping::vehicle::VehicleConfig;

fn agile(length_m: f64, width_m: f64, max_speed_mps: f64) -> VehicleConfig {
    VehicleConfig {
        max_turn_rate_radps: 1.5,
        ..vehicle(length_m, width_m, max_speed_mps)
    }
}

#[test]
fn it_stops_before_a_wall_at_any_speed_and_delay() {
    for (max_speed_mps, wall_m) in [(0.3, 1.5), (1.0, 3.0), (3.0, 13.0)] {
        for (actuator_delay_s, lag) in [(0.0, 0), (0.1, 2), (0.3, 5)] {
            let setup = Setup {
                monitor: CollisionMonitorConfig {
                    actuator_delay_s,
                    ..trusting_no_returns()
                },
                vehicle: agile(0.8, 0.6, max_speed_mps),
                teleop: TeleopConfig {
                    accel_mps2: 1.0,
                    ..TeleopConfig::default()
                },
            };
            let walls = vec![wall([wall_m, -5.0], [wall_m, 5.0])];
            let mut drive = Drive::new(setup, walls, lag);
            drive.laser.beams = 241;
            let mut top_mps = 0.0_f64;
            for _ in 0..700 {
                drive.round(Some(Velocity::new(max_speed_mps, 0.0)));
                top_mps = top_mps.max(drive.motion.linear.speed);
                let gap_m = wall_m - 0.4 - drive.pose.translation.vector.x;
                assert!(gap_m > 0.095, "{max_speed_mps} {actuator_delay_s}: {gap_m}");
            }
            assert!(top_mps > 0.95 * max_speed_mps, "{top_mps}");
            assert!((drive.gap_m() - 0.1).abs() < 0.005, "{}", drive.gap_m());
        }
    }
}

#[test]
fn it_stops_beside_a_wall_to_which_it_goes() {
    for side in [1.0, -1.0] {
        let walls = vec![wall([-5.0, 3.0 * side], [5.0, 3.0 * side])];
        let mut drive = Drive::new(Setup::default(), walls, 2);
        let mut top_mps = 0.0_f64;
        for _ in 0..700 {
            drive.round(Some(sideways(Velocity::new(0.0, side))));
            top_mps = top_mps.max(drive.motion.lateral.speed.abs());
            assert!(drive.gap_m() > 0.095, "{}", drive.gap_m());
        }
        assert!(top_mps > 0.95, "{top_mps}");
        assert!((drive.gap_m() - 0.1).abs() < 0.005, "{}", drive.gap_m());
    }
}

/// With the base frame at the rear axle, and at the front axle.
#[test]
fn an_offset_footprint_stops_equally_near_to_a_wall() {
    for footprint_offset_m in [0.35, -0.35, 0.0] {
        for speed_mps in [1.0, -1.0] {
            let setup = Setup {
                vehicle: VehicleConfig {
                    footprint_offset_m,
                    ..agile(0.8, 0.6, 1.0)
                },
                ..Setup::default()
            };
            let walls = [-3.0, 3.0].map(|wall_m| wall([wall_m, -2.0], [wall_m, 2.0]));
            let mut drive = Drive::new(setup, walls.to_vec(), 2);
            drive.laser.beams = 241;
            let case = format!("{footprint_offset_m} m at {speed_mps} m/s");
            for _ in 0..400 {
                drive.round(Some(Velocity::new(speed_mps, 0.0)));
                assert!(drive.gap_m() > 0.095, "{case}: {}", drive.gap_m());
            }
            let gap_m = drive.gap_m();
            assert!((gap_m - 0.1).abs() < 0.005, "{case}: {gap_m}");
        }
    }
}

/// With noise as of the lasers' data sheets and beams that are lost, there is nothing that is not there.
#[test]
fn through_a_corridor_it_drives_at_full_speed() {
    for clear_m in [0.1, 0.2] {
        let setup = Setup {
            vehicle: agile(0.8, 0.6, 1.0),
            ..Setup::default()
        };
        let y = 0.3 + clear_m;
        let walls = vec![wall([-9.0, y], [9.0, y]), wall([-9.0, -y], [9.0, -y])];
        let mut drive = Drive::new(setup, walls, 2);
        drive.laser = Laser {
            mount_x_m: 0.35,
            beams: 481,
            field_of_view_rad: 4.0,
            range_max_m: 8.0,
        };
        drive.noise = (0.01, 0.005);
        for round in 0..350 {
            drive.round(Some(Velocity::new(1.0, 0.0)));
            let limits = drive.limits();
            assert!(
                limits.forward_mps >= 1.0 && !limits.in_unknown_space,
                "{clear_m} {round}: {limits:?}"
            );
        }
        assert!(drive.pose.translation.vector.x > 4.5);
    }
}

/// Nothing is thinner: a thing that hides behind another that hides less than this is not missed.
const THICKNESS_M: f64 = 0.08;

fn scene() -> impl Strategy<Value = Walls> {
    let pillars = prop::collection::vec((0.6..3.5, -3.2..3.2, 0.08..0.5), 3..14);
    let walls = prop::collection::vec((0.5..3.0, -3.2..3.2, 0.2..2.5, -3.2..3.2), 0..5);
    (pillars, walls).prop_map(|(pillars, walls)| {
        let at =
            |distance: f64, angle: f64| [distance * libm::cos(angle), distance * libm::sin(angle)];
        let mut scene: Walls = pillars
            .into_iter()
            .flat_map(|(distance, angle, edge)| pillar(at(distance, angle), edge))
            .collect();
        scene.extend(
            walls
                .into_iter()
                .flat_map(|(distance, angle, length, direction)| {
                    let from = at(distance, angle);
                    let (along, across) =
                        (at(length, direction), at(THICKNESS_M, direction + 1.57));
                    let to = [from[0] + along[0], from[1] + along[1]];
                    let behind = |point: [f64; 2]| [point[0] + across[0], point[1] + across[1]];
                    [
                        wall(from, to),
                        wall(to, behind(to)),
                        wall(behind(to), behind(from)),
                        wall(behind(from), from),
                    ]
                }),
        );
        scene
    })
}

/// Sideways as fast as it should turn.
fn sideways(velocity: Velocity) -> Velocity {
    Velocity {
        lateral_mps: velocity.angular_radps,
        ..Velocity::new(velocity.linear_mps, 0.0)
    }
}

/// What is asked, each for some rounds; nothing where the arbiter stops.
fn requests() -> impl Strategy<Value = Vec<(Option<Velocity>, u32)>> {
    let velocity = prop_oneof![
        3 => (-1.5..1.5, -1.5..1.5).prop_map(|(v, w)| Some(Velocity::new(v, w))),
        1 => (-1.5..1.5).prop_map(|v| Some(Velocity::new(v, 0.0))),
        1 => (-1.5..1.5).prop_map(|w| Some(Velocity::new(0.0, w))),
        1 => Just(None),
    ];
    prop::collection::vec((velocity, 5_u32..100), 1..12)
}

fn config() -> ProptestConfig {
    let cases = std::env::var("GUARD_CASES").ok();
    let cases = cases.and_then(|cases| cases.parse().ok()).unwrap_or(24);
    ProptestConfig {
        // In one scene of six or so the vehicle would begin in a wall.
        max_global_rejects: cases.max(1024),
        ..ProptestConfig::with_cases(cases)
    }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn whatever_is_asked_nothing_is_touched(
        scene in scene(), requests in requests(),
        length_m in 0.3..1.0, width_m in 0.3..0.8, lag in 0_usize..3, is_sideways in any::<bool>(),
    ) {
        let setup = Setup {
            vehicle: agile(length_m, width_m, 1.5),
            ..Setup::default()
        };
        let mut drive = Drive::new(setup, scene, lag);
        prop_assume!(drive.gap_m() > 0.0);
        for (requested, rounds) in requests {
            let requested = requested.map(|velocity| if is_sideways { sideways(velocity) } else { velocity });
            for _ in 0..rounds {
                drive.round(requested);
                prop_assert!(drive.gap_m() > 0.0, "{:?} {:?} {:?} {:?}", drive.pose, drive.motion, drive.output, requested);
            }
        }
    }
}
