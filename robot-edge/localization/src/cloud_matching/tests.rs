use std::f64::consts::TAU;

use measurement::MeasurementData;
use measurement::cloud::{Cloud, CloudPoint};
use measurement::pose::{Pose, planar};
use measurement::time::RobotDuration;
use nalgebra::{Point3, Translation3, Vector3};
use recording::poses::PoseFile;
use recording::{Selection, open};

use super::*;
use crate::scan_localization::MotionPrior;
use crate::shared_data::shared_data;
use crate::test_data::{about, at};

const REVOLUTION_S: f64 = 0.1;

/// What 32 rings from -25° to 6° see 1 m above level ground, between walls along y at `walls_m` and along x at `walls_m` if `is_closed`.
/// The vehicle is at `pose_at` that share of the revolution.
fn cloud(pose_at: impl Fn(f64) -> Pose, walls_m: f64, is_closed: bool) -> Cloud {
    let mut points = Vec::new();
    for column in 0..360 {
        let share = f64::from(column) / 360.0;
        let pose = pose_at(share);
        let origin = pose * Point3::new(0.0, 0.0, 1.0);
        for ring in 0..32_u16 {
            let (azimuth_rad, elevation_rad) =
                (-TAU * share, (f64::from(ring) - 25.0).to_radians());
            let along = pose.rotation
                * about(Vector3::z(), azimuth_rad)
                * about(Vector3::y(), -elevation_rad)
                * Vector3::x();
            let to = |place: f64, from: f64, way: f64| {
                let range_m = (place - from) / way;
                if range_m > 0.0 {
                    range_m
                } else {
                    f64::INFINITY
                }
            };
            let mut range_m = to(0.0, origin.z, along.z);
            for side in [-walls_m, walls_m] {
                range_m = range_m.min(to(side, origin.y, along.y));
                if is_closed {
                    range_m = range_m.min(to(side, origin.x, along.x));
                }
            }
            if range_m < 50.0 {
                let in_base = pose.inverse() * (origin + along * range_m);
                points.push(CloudPoint {
                    position_m: (in_base - Vector3::z()).cast::<f32>().into(),
                    after_s: (share * REVOLUTION_S) as f32,
                    intensity: 0.0,
                    ring: Some(ring),
                });
            }
        }
    }
    Cloud {
        points,
        without_return: 0,
    }
}

/// Takes revolutions from a way over time; `prior` is what other sensors say of it.
fn matched(
    revolutions: u32,
    (walls_m, is_closed): (f64, bool),
    (motion, has_gravity): (MotionPrior, bool),
    way: impl Fn(f64) -> Pose,
    prior: impl Fn(f64) -> Pose,
) -> Vec<CloudPose> {
    let mut matcher = CloudMatcher::default();
    let poses = (0..revolutions).map(|revolution| {
        let begin_s = f64::from(revolution) * REVOLUTION_S;
        let cloud = cloud(
            |share| way(begin_s + share * REVOLUTION_S),
            walls_m,
            is_closed,
        );
        let (begin, end) = cloud.span(at(begin_s)).unwrap();
        let prior_at = |stamp: measurement::time::RobotTime| (stamp, prior(stamp.as_secs_f64()));
        let revolution = Revolution {
            cloud: &cloud,
            stamp: at(begin_s),
            base_from_sensor: Translation3::new(0.0, 0.0, 1.0).into(),
            prior: [prior_at(begin), prior_at(end)],
            motion,
            has_gravity,
            is_stripe: false,
        };
        matcher.push(&revolution, |_| false)
    });
    poses.collect()
}

#[test]
fn a_vehicle_that_begins_to_turn_and_to_climb_is_followed_without_other_sensors() {
    let way = |secs: f64| {
        let turned_s = (secs - 1.0).max(0.0);
        let mut pose = planar(2.0 * secs - 4.0, 0.3 * turned_s, 0.5 * turned_s);
        pose.translation.z = 0.05 * turned_s;
        pose.rotation *= about(Vector3::y(), -0.1 * turned_s);
        pose
    };
    let found = matched(20, (9.0, true), (MotionPrior::None, false), way, |_| {
        Pose::identity()
    });
    for (revolution, pose) in found.iter().enumerate() {
        let truth = way(0.0).inv_mul(&way(REVOLUTION_S * revolution as f64));
        let error = truth.inv_mul(&pose.odom_from_base);
        let (error_m, error_rad) = (error.translation.vector.norm(), error.rotation.angle());
        assert!(
            error_m < 0.05 && error_rad < 0.02,
            "{revolution}: {error_m} m, {error_rad}"
        );
        assert!(pose.is_determined(), "{revolution}: {pose:?}");
    }
}

#[test]
fn along_a_corridor_and_on_a_plain_the_way_is_that_of_the_other_sensors() {
    let way = |secs: f64| planar(secs, 0.0, 0.0);
    // Wheels that slip, to the side.
    let slipped = |secs: f64| planar(1.1 * secs, 0.2 * secs, 0.0);
    for (walls_m, slip_y_m) in [(4.0, 0.0), (1e3, 0.36)] {
        let prior = (MotionPrior::Full, false);
        let found = matched(21, (walls_m, false), prior, way, slipped);
        // The first revolution alone shows few planes whole.
        let [third, .., last] = &found[2..] else {
            panic!("{found:?}");
        };
        assert!(last.is_matched && !last.is_determined(), "{last:?}");
        let moved = third.odom_from_base.inv_mul(&last.odom_from_base);
        let error_m = moved.translation.vector - Vector3::new(1.98, slip_y_m, 0.0);
        assert!(error_m.norm() < 0.03, "{walls_m}: {moved}");
        assert!(moved.rotation.angle() < 0.003, "{walls_m}: {moved}");
    }
}

#[test]
fn roll_and_pitch_come_to_those_of_the_attitude_sensor_and_the_vehicle_stays_where_it_is() {
    let tilt_rad = |secs: f64| 0.05 * (secs - 1.0).clamp(0.0, 2.0);
    let attitude = |secs: f64| {
        let rotation = about(Vector3::y(), tilt_rad(secs));
        Pose::from_parts(Translation3::identity(), rotation)
    };
    for has_gravity in [true, false] {
        let prior = (MotionPrior::Heading, has_gravity);
        let found = matched(200, (6.0, true), prior, |_| Pose::identity(), attitude);
        let mut left_rad = 0.0;
        for revolution in 1..200 {
            let middle_s = (f64::from(revolution) + 0.5) * REVOLUTION_S;
            left_rad += tilt_rad(middle_s) - tilt_rad(middle_s - REVOLUTION_S);
            if has_gravity {
                left_rad *= 1.0 - REVOLUTION_S / 20.0;
            }
        }
        let last = found.last().unwrap().odom_from_base;
        let turned = last.rotation.inverse() * about(Vector3::y(), 0.1);
        let error_rad = turned.angle() - left_rad;
        assert!(error_rad.abs() < 0.002, "{has_gravity}: {error_rad}");
        assert!(last.translation.vector.norm() < 0.01, "{last}");
    }
}

#[test]
fn a_map_that_does_not_fit_any_more_begins_anew() {
    // To another floor.
    let lifted =
        |secs: f64| Translation3::new(0.0, 0.0, if secs < 0.9999 { 0.0 } else { 3.0 }).into();
    let alone = (MotionPrior::None, false);
    let found = matched(16, (1e3, false), alone, lifted, |_| Pose::identity());
    let is_matched: Vec<_> = found.iter().map(|pose| pose.is_matched).collect();
    let count = is_matched.iter().filter(|is_matched| !**is_matched).count();
    assert!((1..=3).contains(&count), "{is_matched:?}");
    assert!(is_matched[..10].iter().all(|is_matched| *is_matched));
    assert!(is_matched[13..].iter().all(|is_matched| *is_matched));
}

#[test]
fn damaged_clouds_are_no_motion() {
    let mut matcher = CloudMatcher::default();
    let room = cloud(|_| Pose::identity(), 5.0, true);
    let mut damaged = room.clone();
    for point in &mut damaged.points {
        point.position_m[1] = f32::NAN;
    }
    let few = Cloud {
        points: room.points[..20].to_vec(),
        without_return: 0,
    };
    for (secs, cloud) in [
        (0.0, &room),
        (0.1, &damaged),
        (0.1, &few),
        (0.2, &Cloud::default()),
        (0.3, &room),
    ] {
        let stamp = at(secs);
        let end = stamp + RobotDuration::from_millis(100);
        let found = matcher.push(
            &Revolution {
                cloud,
                stamp,
                base_from_sensor: Translation3::new(0.0, 0.0, 1.0).into(),
                prior: [(stamp, Pose::identity()), (end, Pose::identity())],
                motion: MotionPrior::None,
                has_gravity: false,
                is_stripe: false,
            },
            |_| false,
        );
        assert_eq!(found.is_matched, *cloud == room, "{secs}");
        assert!(
            found.odom_from_base.translation.vector.norm() < 1e-3,
            "{found:?}"
        );
    }
}

/// A car with an OS1-128 in a street, and the poses that came with it.
#[test]
fn revolutions_of_a_car_lie_where_the_poses_say_that_came_with_them() {
    let Some(folder) = shared_data("ouster") else {
        return;
    };
    let Ok(PoseFile::ForEachCloud(given)) =
        PoseFile::read(&folder.join("os1-128_fw2.3_3scans.poses.txt"))
    else {
        panic!("no poses");
    };
    let mut reader = open(&folder.join("os1-128_fw2.3_3scans.pcap"), Selection::All).unwrap();
    let mut matcher = CloudMatcher::default();
    let mut found = Vec::new();
    while let Some(measurement) = reader.next_measurement().unwrap() {
        if let MeasurementData::Cloud(cloud) = &measurement.data {
            let (begin, end) = cloud.span(measurement.stamp).unwrap();
            let pose = matcher.push(
                &Revolution {
                    cloud,
                    stamp: measurement.stamp,
                    base_from_sensor: Pose::identity(),
                    prior: [(begin, Pose::identity()), (end, Pose::identity())],
                    motion: MotionPrior::None,
                    has_gravity: false,
                    is_stripe: false,
                },
                |_| false,
            );
            assert!(pose.is_determined(), "{pose:?}");
            found.push(pose.odom_from_base);
        }
    }
    assert_eq!((found.len(), given.len()), (3, 3));
    for at in 1..3 {
        let moved = found[at - 1].inv_mul(&found[at]);
        let error = given[at - 1].inv_mul(&given[at]).inv_mul(&moved);
        let (error_m, error_deg) = (
            error.translation.vector.norm(),
            error.rotation.angle().to_degrees(),
        );
        println!("{at}: {error_m:.4} m, {error_deg:.3}°");
        assert!(
            error_m < 0.03 && error_deg < 0.1,
            "{at}: {error_m} m, {error_deg}°"
        );
    }
}
