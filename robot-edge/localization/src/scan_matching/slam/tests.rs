use super::*;
use crate::scan_matching::relocalization::{Place, Relocalizer};
use crate::scan_matching::test_world::{
    AROUND_RING, Drive, THROUGH_ROOMS, Wall, ring, two_rooms, walls, way,
};

/// The greatest error of a closure in standard deviations, squared, by the true poses.
fn worst_closure(slam: &ScanSlam, poses: &[ScanPose], way: &[Isometry2<f64>]) -> f64 {
    let mut truth: Vec<Isometry2<f64>> = Vec::new();
    for (pose, at) in poses.iter().zip(way) {
        if pose.keyframe as usize == truth.len() {
            truth.push(*at);
        }
    }
    let edges = slam.map().edges().iter().filter(|edge| edge.is_closure);
    let error = |edge: &Edge| {
        let [from, to] = [edge.from, edge.to].map(|at| truth[at as usize]);
        let step = difference(&edge.from_from_to, &from.inv_mul(&to));
        step.dot(&(edge.information * step))
    };
    edges.map(error).fold(0.0, f64::max)
}

fn final_error(slam: &ScanSlam, poses: &[ScanPose], way: &[Isometry2<f64>]) -> Vector3<f64> {
    let last = &poses[poses.len() - 1];
    let pose = slam.map().keyframes()[last.keyframe as usize] * last.keyframe_from_base;
    difference(&way[0].inv_mul(&way[way.len() - 1]), &pose)
}

#[test]
fn a_ring_closes_with_slip_and_drift_and_the_local_frame_does_not_jump() {
    let (world, way) = (ring(), way(&AROUND_RING));
    for has_odometry in [true, false] {
        let mut slam = ScanSlam::new(SlamSettings::default());
        let drive = Drive {
            world: &world,
            way: &way,
            has_odometry,
            slip: 0.1,
            drift_rad_per_m: 0.003,
            seed: 1,
        };
        let poses = drive.run(&mut slam);
        for pair in poses.windows(2) {
            let step = difference(&pair[0].local_from_base, &pair[1].local_from_base);
            assert!(step.xy().norm() < 0.25, "{step:?}");
        }
        assert!(poses.iter().all(|pose| pose.confidence == Confidence::Full));
        slam.finish();
        assert!(slam.closures().added > 10, "{:?}", slam.closures());
        assert!(worst_closure(&slam, &poses, &way) < 30.0);
        let error = final_error(&slam, &poses, &way);
        assert!(error.xy().norm() < 0.1 && error.z.abs() < 0.01, "{error:?}");
    }
}

#[test]
fn on_a_plain_the_poses_are_those_of_odometry_for_as_long_as_it_lasts() {
    let way = way(&AROUND_RING);
    let drive = Drive {
        world: &[],
        way: &way,
        has_odometry: true,
        slip: 0.0,
        drift_rad_per_m: 0.0,
        seed: 1,
    };
    let mut slam = ScanSlam::new(SlamSettings::default());
    let poses = drive.run(&mut slam);
    let last = poses.last().unwrap();
    assert_eq!(last.confidence, Confidence::OdometryOnly);
    let error = difference(&way[0].inv_mul(&way[way.len() - 1]), &last.local_from_base);
    assert!(error.norm() < 0.3, "{error}");
    assert!((last.local_from_base.rotation.norm() - 1.0).abs() < 1e-12);
}

#[test]
fn an_edge_is_as_uncertain_as_matching_and_odometry_differ() {
    let (world, way) = (ring(), way(&AROUND_RING[..2]));
    let drift_rad_per_m = 0.02;
    let drive = Drive {
        world: &world,
        way: &way,
        has_odometry: true,
        slip: 0.0,
        drift_rad_per_m,
        seed: 1,
    };
    let scans = drive.scans();
    // Odometry with each scan, and with each third one.
    for every in [1, 3] {
        let mut slam = ScanSlam::new(SlamSettings::default());
        for (at, (stamp, scan, _)) in scans.iter().enumerate() {
            slam.push(&ScanInput {
                stamp: *stamp,
                scan,
                base_from_sensor: Isometry2::identity(),
                odom_from_base: Some(scans[at - at % every].2),
                is_heading_only: false,
                is_by_clouds: false,
                is_placed: false,
                base_from_antenna: Point2::origin(),
            });
        }
        let edges = slam.map().edges().iter();
        let way_m = |edge: &Edge| edge.from_from_to.translation.vector.norm();
        let long: Vec<_> = edges
            .filter(|edge| edge.from == 0 && way_m(edge) > 5.0)
            .collect();
        assert!(long.len() > 5, "{}", long.len());
        for edge in long {
            let covariance = edge.information.try_inverse().unwrap();
            let [sigma_m, _, sigma_rad] = [0, 1, 2].map(|at| libm::sqrt(covariance[(at, at)]));
            assert!(sigma_m < 0.15, "{every}: {sigma_m}");
            let parted_rad = 0.5 * drift_rad_per_m * way_m(edge);
            let share = sigma_rad / libm::hypot(parted_rad, 1_f64.to_radians());
            assert!((0.85..1.15).contains(&share), "{every}: {share}");
        }
    }
}

#[test]
fn the_same_scans_give_the_same_poses() {
    let (world, way) = (ring(), way(&AROUND_RING[..6]));
    let run = || {
        let mut slam = ScanSlam::new(SlamSettings::default());
        let drive = Drive {
            world: &world,
            way: &way,
            has_odometry: true,
            slip: 0.1,
            drift_rad_per_m: 0.003,
            seed: 2,
        };
        drive.run(&mut slam);
        slam.finish();
        slam.map().keyframes().to_vec()
    };
    assert_eq!(run(), run());
}

#[test]
fn a_corridor_without_features_is_uncertain_along_itself_and_closes_nothing_wrongly() {
    let world = [[[-40.0, -1.0], [60.0, -1.0]], [[-40.0, 1.0], [60.0, 1.0]]];
    let way = way(&[[0.0, 0.0], [11.0, 0.0], [1.0, 0.2]]);
    for seed in 0..20 {
        let mut slam = ScanSlam::new(SlamSettings::default());
        let drive = Drive {
            world: &world,
            way: &way,
            has_odometry: true,
            slip: 0.1,
            drift_rad_per_m: 0.0,
            seed,
        };
        let poses = drive.run(&mut slam);
        let is_uncertain = |pose: &&ScanPose| {
            matches!(pose.confidence, Confidence::UncertainAlong(direction) if {
                (pose.local_from_base.rotation * direction).x.abs() > 0.95
            })
        };
        let uncertain = poses.iter().filter(is_uncertain).count();
        assert!(
            uncertain > poses.len() / 2,
            "seed {seed}: {uncertain} of {}",
            poses.len()
        );
        let last = poses[poses.len() - 1].covariance;
        assert!(
            last[(0, 0)] > 0.1 * 0.1 && last[(1, 1)] < 0.02 * 0.02,
            "seed {seed}: {last}"
        );
        slam.finish();
        assert!(worst_closure(&slam, &poses, &way) < 30.0, "seed {seed}");
    }
}

#[test]
fn a_room_that_looks_like_another_is_not_taken_for_it() {
    let (world, way) = (two_rooms(), way(&THROUGH_ROOMS));
    for seed in 0..20 {
        for has_odometry in [true, false] {
            let mut slam = ScanSlam::new(SlamSettings::default());
            let drive = Drive {
                world: &world,
                way: &way,
                has_odometry,
                slip: 0.1,
                drift_rad_per_m: 0.0,
                seed,
            };
            let poses = drive.run(&mut slam);
            slam.finish();
            let worst = worst_closure(&slam, &poses, &way);
            assert!(
                worst < 30.0,
                "seed {seed}, odometry {has_odometry}: {worst}"
            );
        }
    }
}

fn drive<'a>(world: &'a [Wall], way: &'a [Isometry2<f64>], seed: u64) -> Drive<'a> {
    Drive {
        world,
        way,
        has_odometry: true,
        slip: 0.05,
        drift_rad_per_m: 0.0,
        seed,
    }
}

fn mapped(world: &[Wall], way: &[Isometry2<f64>], seed: u64) -> ScanSlam {
    let mut slam = ScanSlam::new(SlamSettings::default());
    drive(world, way, seed).run(&mut slam);
    slam.finish();
    slam
}

/// Where a vehicle is found, and the number of scans until then. `near`: the pose at its start, and half the size of the region.
fn found(
    map: &SlamMap,
    drive: &Drive<'_>,
    near: Option<(Isometry2<f64>, (f64, f64))>,
) -> (Option<(usize, Place)>, Relocalizer) {
    let settings = SlamSettings::default();
    let (mut slam, mut relocalizer) = (ScanSlam::new(settings), Relocalizer::default());
    for (at, (stamp, scan, odom_from_base)) in drive.scans().into_iter().enumerate() {
        let pose = slam.push(&ScanInput {
            stamp,
            scan: &scan,
            base_from_sensor: Isometry2::identity(),
            odom_from_base: Some(odom_from_base),
            is_heading_only: false,
            is_by_clouds: false,
            is_placed: false,
            base_from_antenna: Point2::origin(),
        });
        let local = pose.local_from_base;
        let near = near.map(|(start, half)| (start * local, half));
        let near = near.as_ref().map(|(pose, half)| (pose, *half));
        let points = || slam.surroundings();
        let place = relocalizer.update(map, &local, points, near, &settings.closure);
        if let Some(place) = place {
            return (Some((at, place)), relocalizer);
        }
    }
    (None, relocalizer)
}

#[test]
fn the_vehicle_is_found_in_a_map_and_goes_on_in_it() {
    let (world, whole) = (ring(), way(&AROUND_RING));
    let first = mapped(&world, &whole, 1);
    let later = way(&[[13.0, 6.5], [13.0, 9.0], [8.0, 9.0]]);
    let driven = drive(&world, &later, 2);
    // By an approximate pose at once; else after 4 m, and no more than an update later.
    let about = whole[0].inv_mul(&later[0]) * Isometry2::new(Vector2::new(0.8, -0.5), 0.3);
    for (near, within_m) in [(Some((about, (1.5, 0.6))), 0.0..0.1), (None, 3.9..5.3)] {
        let (Some((at, place)), _) = found(first.map(), &driven, near) else {
            panic!("not found");
        };
        let error = difference(&whole[0].inv_mul(&later[at]), &place.map_from_base);
        assert!(
            error.xy().norm() < 0.05 && error.z.abs() < 0.02,
            "{error:?}"
        );
        assert!(place.explained > 0.95, "{place:?}");
        // Poses are 0.15 m apart, and the vehicle turns in place.
        let before = &later[..=at];
        let driven_m: f64 = before
            .windows(2)
            .map(|pair| difference(&pair[0], &pair[1]).xy().norm())
            .sum();
        assert!(within_m.contains(&driven_m), "{driven_m}");
        // From there it goes on.
        let on = [&later[at..], &way(&[[8.0, 9.0], [1.0, 9.0], [1.0, 5.0]])].concat();
        let settings = SlamSettings::default();
        let mut resumed = ScanSlam::resume(settings, first.map().clone(), &place);
        let poses = drive(&world, &on, 3).run(&mut resumed);
        resumed.finish();
        let last = &poses[poses.len() - 1];
        let pose = resumed.map().keyframes()[last.keyframe as usize] * last.keyframe_from_base;
        let error = difference(&whole[0].inv_mul(&on[on.len() - 1]), &pose);
        assert!(
            error.xy().norm() < 0.08 && error.z.abs() < 0.02,
            "{error:?}"
        );
    }
}

#[test]
fn the_vehicle_is_found_neither_in_one_of_two_rooms_alike_nor_in_another_world() {
    let (world, through) = (two_rooms(), way(&THROUGH_ROOMS));
    let first = mapped(&world, &through, 4);
    let circle = [[2.0, 1.2], [2.6, 2.2], [1.8, 1.0]];
    let inside = way(&[circle, circle, circle].concat());
    let (found_at, relocalizer) = found(first.map(), &drive(&world, &inside, 5), None);
    assert_eq!(found_at, None);
    let [best, next] = [0, 1].map(|at| relocalizer.places()[at]);
    let apart_m = difference(&best.map_from_base, &next.map_from_base)
        .xy()
        .norm();
    // Between them the map has the slip of odometry.
    assert!((apart_m - 9.0).abs() < 0.6, "{apart_m}");
    assert!(next.explained > 0.95, "{next:?}");

    let elsewhere = way(&AROUND_RING[..4]);
    let (found_at, _) = found(first.map(), &drive(&ring(), &elsewhere, 6), None);
    assert_eq!(found_at, None);
}

#[test]
fn each_keyframe_is_searched_around_in_one_submap() {
    let slam = mapped(&ring(), &way(&AROUND_RING), 1);
    let map = slam.map();
    assert!(map.submap_count() > 4);
    let cores = (0..map.submap_count()).flat_map(|index| map.core(index));
    let cores: Vec<_> = cores.copied().collect();
    assert_eq!(cores, map.keyframes());
}

#[test]
fn scans_that_do_not_fit_are_lost_and_a_new_map_begins() {
    let room = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0], [0.0, 0.0]];
    let other = [
        [20.0, 0.0],
        [27.0, 1.0],
        [28.0, 6.0],
        [22.0, 8.0],
        [18.0, 4.0],
        [20.0, 0.0],
    ];
    let world: Vec<_> = walls(&room).chain(walls(&other)).collect();
    let mut way = way(&[[1.0, 1.0], [3.0, 1.5]]);
    // It is carried away.
    way.extend(self::way(&[[22.5, 2.4], [25.0, 3.5]]));
    let mut slam = ScanSlam::new(SlamSettings::default());
    let drive = Drive {
        world: &world,
        way: &way,
        has_odometry: false,
        slip: 0.0,
        drift_rad_per_m: 0.0,
        seed: 1,
    };
    let poses = drive.run(&mut slam);
    let lost = poses
        .iter()
        .filter(|pose| pose.confidence == Confidence::Lost)
        .count();
    assert!((1..=6).contains(&lost), "{lost}");
    assert_eq!(poses[poses.len() - 1].confidence, Confidence::Full);
    assert!(slam.map().submap_count() >= 2);
}

/// Errors of a receiver at a scan, metres.
type ReceiverError = fn(usize) -> [f64; 2];

/// Of 2 cm to the east and north, by turns.
fn of_rtk(scan: usize) -> [f64; 2] {
    let sign = if scan.is_multiple_of(2) { 0.02 } else { -0.02 };
    [sign, -sign]
}

/// A corridor of 90 m with pillars, which no loop closes, and where the map in that of the positions ends; errors in metres and
/// radians at the ends of the way.
fn along_corridor(sigma_m: f64, receiver: ReceiverError) -> (ScanSlam, [Vector3<f64>; 2]) {
    let mut world: Vec<Wall> =
        walls(&[[0.0, 0.0], [92.0, 0.0], [92.0, 3.0], [0.0, 3.0], [0.0, 0.0]]).collect();
    for pillar in 0..22 {
        // At distances that differ.
        let x = 4.1 * f64::from(pillar) + f64::from(pillar * pillar % 7) * 0.3;
        let y = f64::from(pillar % 2) * 2.7;
        world.extend(walls(&[
            [x, y],
            [x + 0.3, y],
            [x + 0.3, y + 0.3],
            [x, y + 0.3],
            [x, y],
        ]));
    }
    let way = way(&[[1.0, 1.5], [91.0, 1.5]]);
    let earth_from_world = Isometry2::new(Vector2::new(500.0, -300.0), 1.2);
    let antenna = Point2::new(-0.4, 0.2);
    let drive = Drive {
        world: &world,
        way: &way,
        has_odometry: true,
        slip: 0.03,
        drift_rad_per_m: 0.004,
        seed: 3,
    };
    let mut slam = ScanSlam::new(SlamSettings::default());
    let mut poses = Vec::new();
    for (number, (stamp, scan, odom_from_base)) in drive.scans().into_iter().enumerate() {
        slam.push_position(AntennaPosition {
            stamp,
            antenna: earth_from_world * way[number] * antenna + Vector2::from(receiver(number)),
            sigma_m,
        });
        poses.push(slam.push(&ScanInput {
            stamp,
            scan: &scan,
            base_from_sensor: Isometry2::identity(),
            odom_from_base: Some(odom_from_base),
            is_heading_only: false,
            is_by_clouds: false,
            is_placed: false,
            base_from_antenna: antenna,
        }));
    }
    slam.finish();
    let errors = [40, way.len() - 1].map(|at| {
        let pose = &poses[at];
        let found = slam.map().keyframes()[pose.keyframe as usize] * pose.keyframe_from_base;
        let truth = earth_from_world * way[at];
        difference(&truth, &found)
    });
    (slam, errors)
}

#[test]
fn positions_on_earth_hold_a_map_in_place_and_those_that_leap_do_not() {
    // Without them the end of the corridor is a metre off.
    let echo: ReceiverError = |scan| {
        let [east, north] = of_rtk(scan);
        // 8 m off for a sixth of the way: as an echo from a wall.
        if (200..300).contains(&scan) {
            [east + 8.0, north]
        } else {
            [east, north]
        }
    };
    let leaps: ReceiverError = |scan| {
        if scan % 5 == 3 {
            [40.0, -60.0]
        } else {
            of_rtk(scan)
        }
    };
    for (name, receiver) in [
        ("rtk", of_rtk as ReceiverError),
        ("echo", echo),
        ("leaps", leaps),
    ] {
        let (slam, errors) = along_corridor(0.05, receiver);
        let (positions, contradicted) = slam.positions();
        assert!(
            slam.map().is_on_earth() && positions > 35,
            "{name}: {positions}"
        );
        assert_eq!(contradicted > 0, name != "rtk", "{name}: {contradicted}");
        for error in errors {
            assert!(
                error.xy().norm() < 0.15 && error.z.abs() < 0.01,
                "{name}: {errors:?}"
            );
        }
    }
}
