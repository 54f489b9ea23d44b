//! Ultrasonic sensors see what the laser does not, and bumpers touch it.

use super::*;
use crate::collision_monitor::UnavailableReason;
use crate::collision_monitor::UnknownSpacePolicy;
use protocol::message::BarrierKind;

/// Points of a sensor at the front of the vehicle, whose front is at 0.4 m.
fn points(kind: ScanKind, ends: &[[f64; 2]]) -> RegisteredScan {
    let beams = (0..).zip(ends).map(|(index, &[x, y])| RegisteredBeam {
        origin_in_odom: Point3::new(0.4, 0.0, 0.3),
        end_in_odom: Point3::new(x, y, 0.3),
        outcome: BeamOutcome::Hit,
        index,
        range_m: 1.0,
    });
    RegisteredScan {
        stamp: RobotTime::from_nanos(0),
        sensor: SensorId(1),
        kind,
        beam_step_rad: 0.02,
        own_body_hits: 0,
        odom_from_base: planar(0.0, 0.0, 0.0),
        beams: beams.collect(),
    }
}

/// 1 m ahead of the front.
const ARC: [[f64; 2]; 3] = [[1.3, -0.3], [1.4, 0.0], [1.3, 0.3]];

/// A wide room whose laser sees nothing near, and one more scan.
fn scene_with(scan: &RegisteredScan) -> Scene {
    let room = vec![
        wall([-9.0, 6.0], [9.0, 6.0]),
        wall([-9.0, -6.0], [9.0, -6.0]),
        wall([9.0, -6.0], [9.0, 6.0]),
        wall([-9.0, -6.0], [-9.0, 6.0]),
    ];
    let mut scene = Scene::new(Setup::default(), Laser::ALL_DIRECTIONS, &room);
    let scan = scene.setup.obstacle_scan(scan, START);
    scene.obstacle_scans.push(scan);
    scene
}

const AHEAD: Velocity = Velocity::new(1.0, 0.0);
const BACK: Velocity = Velocity::new(-1.0, 0.0);

#[test]
fn an_arc_is_an_obstacle_that_the_laser_does_not_see() {
    let mut scene = scene_with(&points(ScanKind::Arc, &ARC));
    let limits = scene.limits(AHEAD);
    // 0.9 m to the arc's sides less the margin of 0.1 m, at 1 m/s² after 20 ms.
    assert!((1.0..1.27).contains(&limits.forward_mps), "{limits:?}");
    assert_eq!(scene.monitor.barrier(), None, "1 m/s is allowed");
    let near = ARC.map(|[x, y]| [x - 0.6, y]);
    let mut scene = scene_with(&points(ScanKind::Arc, &near));
    let limits = scene.limits(AHEAD);
    assert!((0.5..0.62).contains(&limits.forward_mps), "{limits:?}");
    assert_eq!(
        scene.monitor.barrier().map(|barrier| barrier.kind),
        Some(BarrierKind::Detected)
    );
    assert!(scene.limits(BACK).reverse_mps >= 1.0);
}

/// Nearer than the sensor measures: at the sensor, which may sit within the footprint.
#[test]
fn what_may_touch_the_sensor_allows_no_motion_towards_it() {
    for x_m in [0.4, 0.38] {
        let mut scene = scene_with(&points(ScanKind::Arc, &[[x_m, 0.0]; 3]));
        let limits = scene.limits(AHEAD);
        assert!(limits.forward_mps.abs() < 1e-9, "{limits:?}");
        assert!(scene.limits(BACK).reverse_mps >= 1.0);
    }
}

#[test]
fn an_arc_holds_until_the_next_reading_or_until_ground_is_too_old() {
    let near = ARC.map(|[x, y]| [x - 0.6, y]);
    let mut scene = scene_with(&points(ScanKind::Arc, &near));
    let forward_mps = |scene: &mut Scene, millis: u64| {
        scene.wait(millis);
        // The laser goes on.
        let laser = Laser::ALL_DIRECTIONS.scan(&vec![], &planar(0.0, 0.0, 0.0));
        scene.obstacle_scans[0] = scene.setup.obstacle_scan(&laser, scene.now);
        scene.limits(AHEAD).forward_mps
    };
    assert!(forward_mps(&mut scene, 2900) < 0.62);
    assert!(forward_mps(&mut scene, 3100) >= 1.0, "forgotten");
    let empty = points(ScanKind::Arc, &[]);
    scene.obstacle_scans[1] = scene.setup.obstacle_scan(&empty, START);
    assert!(forward_mps(&mut scene, 100) >= 1.0, "no echo");
}

#[test]
fn arcs_and_contacts_show_no_free_ground() {
    for kind in [ScanKind::Arc, ScanKind::Contact { width_m: 0.6 }] {
        for ends in [&ARC[..], &[]] {
            let mut scene = scene_with(&points(kind, ends));
            // The laser is gone.
            scene.obstacle_scans.remove(0);
            let limits = scene.limits(AHEAD);
            assert!(limits.in_unknown_space, "{kind:?} {limits:?}");
            assert!(limits.forward_mps <= CREEP_MPS + 1e-9);
            scene.setup.monitor.unknown_space_policy = UnknownSpacePolicy::Stop;
            assert_eq!(scene.output(AHEAD), CollisionMonitorOutput::Stale);
            let reason = scene.monitor.unavailable_reason();
            assert_eq!(reason, Some(UnavailableReason::ScansTooOld));
        }
    }
}

#[test]
fn a_pressed_bumper_allows_no_motion_towards_it_and_every_motion_away() {
    let contact = ScanKind::Contact { width_m: 0.6 };
    // At the edge of the footprint, 1 cm within it where the vehicle file is that wrong, and lower than an obstacle.
    for (x_m, z_m) in [(0.4, 0.3), (0.39, 0.3), (0.4, 0.02)] {
        let ends = [-0.3, -0.15, 0.0, 0.15, 0.3].map(|y| [x_m, y]);
        let mut pressed = points(contact, &ends);
        for beam in &mut pressed.beams {
            beam.end_in_odom.z = z_m;
            beam.origin_in_odom.z = z_m;
        }
        let mut scene = scene_with(&pressed);
        let limits = scene.limits(AHEAD);
        assert!(limits.forward_mps.abs() < 1e-9, "{x_m} {z_m} {limits:?}");
        let barrier = scene.monitor.barrier().unwrap();
        assert_eq!(barrier.kind, BarrierKind::Contact);
        let [x, y] = barrier.position_in_odom;
        assert!((x - x_m).abs() + y.abs() < 1e-9, "{barrier:?}");
        assert!(scene.limits(BACK).reverse_mps >= 1.0);
        // As long as it is pressed, however long ago it said so.
        scene.wait(60_000);
        assert!(scene.limits(AHEAD).forward_mps.abs() < 1e-9);
        // What is touched at the front also stops a turn on the spot, which would press a corner into it.
        let turn = scene.limits(Velocity::new(0.0, 0.5));
        assert!(turn.left_radps.abs() < 1e-9 && turn.right_radps.abs() < 1e-9);
        let released = scene.setup.obstacle_scan(&points(contact, &[]), START);
        scene.obstacle_scans[1] = released;
        scene.wait(0);
        assert!(scene.limits(AHEAD).forward_mps >= 1.0);
    }
}

#[test]
fn a_hit_of_an_arc_leaves_the_mapped_cell_as_it_is() {
    let wall_ahead = vec![wall([0.85, -2.0], [0.85, 2.0])];
    let mut scene = scene_with(&points(ScanKind::Arc, &[[0.89, 0.0]]));
    let map = scene.setup.map(
        &wall_ahead,
        &planar(0.0, 0.0, 0.0),
        (START, Duration::from_millis(200)),
    );
    scene.map = Some(map);
    scene.limits(AHEAD);
    assert_eq!(
        scene.monitor.barrier().map(|barrier| barrier.kind),
        Some(BarrierKind::Mapped)
    );
}
