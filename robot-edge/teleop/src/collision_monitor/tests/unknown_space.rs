//! Covered sensors, sides that no sensor has observed lately, and fields without an echo.

use std::time::Duration;

use super::*;
use crate::collision_monitor::{
    BlockageDetector, CollisionMonitor, CollisionMonitorConfig, CollisionMonitorInput,
    ObstacleScan, OdometrySample,
};
use crate::motion::Velocity;
use mapping::ground_plane::GroundPlane;
use measurement::pose::planar;

const FULL_SPEED: Velocity = Velocity::new(1.0, 0.0);

/// A second, in rounds.
const SECOND: u32 = 50;

/// With the defaults: misses prove nothing by themselves.
fn setup() -> Setup {
    Setup {
        monitor: CollisionMonitorConfig::default(),
        ..Setup::default()
    }
}

/// Two walls, 2 m to either side.
fn corridor() -> Walls {
    vec![
        wall([-50.0, 2.0], [50.0, 2.0]),
        wall([-50.0, -2.0], [50.0, -2.0]),
    ]
}

#[test]
fn a_cover_put_on_while_it_drives_is_found_within_a_second() {
    // Also where the sensors are said to tell a cover themselves.
    for treat_no_return_as_free in [false, true] {
        let mut setup = setup();
        setup.monitor.treat_no_return_as_free = treat_no_return_as_free;
        let mut drive = Drive::new(setup, corridor(), 2);
        drive.drive_for(4 * SECOND, FULL_SPEED);
        let before = (drive.motion.linear.speed, drive.limits().forward_mps);
        assert!(before.0 > 0.3 && before.1 > 0.45, "{before:?}");
        assert!(!drive.blockage.is_blocked());
        drive.covered = 0..721;
        drive.drive_for(SECOND, FULL_SPEED);
        let after = drive.limits();
        assert!(drive.blockage.is_blocked());
        assert!(creeps_ahead(&after), "{after:?}");
        // However long it lasts.
        drive.drive_for(20 * SECOND, FULL_SPEED);
        assert!(drive.limits().in_unknown_space && drive.blockage.is_blocked());
        assert!(drive.motion.linear.speed <= CREEP_MPS + 1e-9);
        drive.covered = 0..0;
        drive.drive_for(SECOND, FULL_SPEED);
        assert!(!drive.limits().in_unknown_space && !drive.blockage.is_blocked());
    }
}

#[test]
fn a_cover_over_one_part_blinds_that_part_only() {
    // A wall 6 m ahead, one behind it: what looks ahead is covered.
    let mut walls = corridor();
    walls.push(wall([9.0, -2.0], [9.0, 2.0]));
    walls.push(wall([-9.0, -2.0], [-9.0, 2.0]));
    // One sector exactly, although its neighbours still meet what is at its edges; and a wider part.
    let mut narrow = Drive::new(setup(), walls.clone(), 0);
    narrow.drive_for(2 * SECOND, Velocity::ZERO);
    narrow.covered = 361..391;
    narrow.drive_for(SECOND, Velocity::ZERO);
    assert!(narrow.blockage.is_blocked());
    let mut drive = Drive::new(setup(), walls, 0);
    drive.drive_for(2 * SECOND, Velocity::ZERO);
    drive.covered = 310..411;
    drive.drive_for(SECOND, Velocity::ZERO);
    drive.evaluate(FULL_SPEED);
    let ahead = drive.limits();
    assert!(drive.blockage.is_blocked());
    assert!(creeps_ahead(&ahead), "{ahead:?}");
    assert!(ahead.reverse_mps > 0.9, "{ahead:?}");
}

/// Past a row of pillars and out into the open: what is no longer hit was passed.
#[test]
fn what_the_motion_explains_is_no_cover() {
    let mut walls = corridor();
    for wall in &mut walls {
        wall[1].x = 6.0;
    }
    walls.extend((0..8).flat_map(|n| pillar([f64::from(n), 1.2], 0.2)));
    let mut drive = Drive::new(setup(), walls, 2);
    drive.noise = (0.01, 0.01);
    for _ in 0..20 * SECOND {
        drive.round(Some(FULL_SPEED));
        assert!(!drive.blockage.is_blocked(), "{}", drive.pose);
    }
    assert!(drive.pose.translation.vector.x > 7.0, "{}", drive.pose);
}

#[test]
fn in_the_open_it_goes_as_fast_as_echoes_of_anything_allow() {
    for (own_body_hits, no_return_speed_mps, expected_mps) in [
        (10, 0.5, 0.5),
        (10, 0.8, 0.8),
        (10, 0.0, CREEP_MPS),
        (0, 0.5, CREEP_MPS),
    ] {
        let mut setup = setup();
        setup.monitor.no_return_speed_mps = no_return_speed_mps;
        let mut drive = Drive::new(setup, vec![], 2);
        drive.own_body_hits = own_body_hits;
        drive.drive_for(4 * SECOND, FULL_SPEED);
        let open = drive.limits();
        assert!(
            (open.forward_mps - expected_mps).abs() < 1e-9,
            "{own_body_hits} {no_return_speed_mps}: {open:?}"
        );
        assert_eq!(open.in_unknown_space, expected_mps <= CREEP_MPS);
        if !open.in_unknown_space {
            drive.covered = 0..721;
            drive.drive_for(SECOND, FULL_SPEED);
            let forward_mps = drive.limits().forward_mps;
            assert!(forward_mps <= CREEP_MPS + 1e-9, "covered: {forward_mps}");
        }
    }
}

#[test]
fn reversing_is_free_over_recent_ground_and_creep_over_older() {
    let walls = pillar([0.0, 0.0], 26.0);
    for (stands_s, least_mps, most_mps) in [(0, 0.4, 1.0), (4, 0.0, CREEP_MPS)] {
        let mut drive = Drive::new(setup(), walls.clone(), 0);
        drive.laser = Laser::AHEAD;
        drive.drive_for(3 * SECOND, FULL_SPEED);
        while drive.motion.linear.speed > 0.0 {
            drive.round(None);
        }
        let times = (drive.now(), Duration::from_hours(1));
        drive.map = Some(drive.setup.map(&walls, &drive.pose, times));
        drive.drive_for(stands_s * SECOND, Velocity::ZERO);
        let mut top_mps = 0.0_f64;
        for _ in 0..3 * SECOND {
            drive.round(Some(FULL_SPEED.scaled(-1.0)));
            top_mps = top_mps.max(-drive.motion.linear.speed);
        }
        assert!(
            (least_mps..=most_mps + 1e-9).contains(&top_mps),
            "after {stands_s} s: {top_mps}"
        );
    }
}

/// The front laser dies, the one that looks back lives on, and the map knows all of the hall.
#[test]
fn ground_of_a_dead_sensor_expires_and_its_side_is_reported() {
    let walls = pillar([0.0, 0.0], 26.0);
    let pose = planar(0.0, 0.0, 0.0);
    let back = planar(0.0, 0.0, std::f64::consts::PI);
    for (is_boat, max_ground_age_s, limit_ms) in [
        (false, None, 3000),
        (true, None, 10_000),
        (false, Some(1.0), 1000),
    ] {
        let mut setup = setup();
        setup.teleop.is_boat = is_boat;
        setup.monitor.max_ground_age_s = max_ground_age_s;
        let rules = setup.rules();
        let mut monitor = CollisionMonitor::new(rules);
        let mut obstacle_scans = [ObstacleScan::default(), ObstacleScan::default()];
        let map = setup.map(&walls, &pose, (START, Duration::from_hours(1)));
        let mut limits = |ms: u64| {
            let now = START + Duration::from_millis(ms);
            let front_lives = ms == 0;
            for (n, heading) in [pose, back]
                .iter()
                .enumerate()
                .skip(usize::from(!front_lives))
            {
                let scan = Laser::AHEAD.scan(&walls, heading);
                let mut blockage = BlockageDetector::default();
                blockage.update(&scan, now);
                let plane = GroundPlane::under(heading);
                obstacle_scans[n].read(&scan, &plane, &rules, &blockage, (now, SCAN_PERIOD), None);
            }
            let input = CollisionMonitorInput {
                obstacle_scans: &obstacle_scans,
                map: Some(&map),
                odometry: Some(OdometrySample {
                    odom_from_base: pose,
                    measured: Velocity::ZERO,
                    measured_at: now,
                }),
                commanded: Velocity::ZERO,
                requested: FULL_SPEED,
                docking: None,
            };
            limits_of(monitor.output(&input, now))
        };
        limits(0);
        for ms in (200..limit_ms).step_by(200) {
            let limits = limits(ms);
            assert!(
                limits.forward_mps > 0.9 && !limits.in_unknown_space,
                "{ms}: {limits:?}"
            );
        }
        let old = limits(limit_ms + 100);
        assert!(creeps_ahead(&old) && old.reverse_mps > 0.9, "{old:?}");
        let [ahead, _, behind, _] = monitor.side_ground_ages();
        assert_eq!(ahead, Some(Duration::from_millis(limit_ms + 100)));
        assert_eq!(behind, Some(Duration::ZERO));
    }
}

#[test]
fn a_time_beyond_thirty_seconds_is_refused() {
    let mut monitor = CollisionMonitorConfig {
        max_ground_age_s: Some(30.0),
        ..CollisionMonitorConfig::default()
    };
    assert_eq!(monitor.check(), []);
    for max_ground_age_s in [30.1, f64::INFINITY, f64::NAN, 0.0] {
        monitor.max_ground_age_s = Some(max_ground_age_s);
        let faults = monitor.check();
        assert_eq!(faults.len(), 1, "{max_ground_age_s}");
        assert_eq!(faults[0].key, "teleop.collision_monitor.max_ground_age_s");
    }
}
