//! The walls that a cloud shows, as a planar scan: with it, poses are found from three-dimensional lidars as from planar lasers
//! (docs/methods.md, section 0, pose source (d)).

use std::f64::consts::TAU;

use measurement::cloud::{Cloud, CloudPoint};
use measurement::pose::Pose;
use measurement::scan::Scan;
use nalgebra::Point3;

/// Directions of the scan.
const BEAMS: usize = 1440;
/// Points of one direction are on a wall if their heights differ by at least this, metres, …
const RISE_M: f64 = 0.3;
/// … and their distances by at most this: it is steeper than 60°, which no ground is that a vehicle drives on.
const DEPTH_M: f64 = 0.15;

/// The nearest wall in each direction, seen from above from the sensor's place. `level_from_sensor`: the sensor in a frame whose z
/// axis points up; angles are about that axis, from its x axis. Points for which `is_own` holds are left out.
///
/// Beams follow each other in time as the lidar turns. One that does not turn has all of them at the time of its first point.
pub(crate) fn walls(
    cloud: &Cloud,
    level_from_sensor: &Pose,
    is_own: impl Fn(&Point3<f64>) -> bool,
) -> Scan {
    let points: Vec<_> = cloud
        .points
        .iter()
        .filter_map(|point| {
            let in_sensor = Point3::from(point.position_m.map(f64::from));
            let seen = level_from_sensor.rotation * in_sensor.coords;
            let is_hit = seen.iter().all(|part| part.is_finite()) && !is_own(&in_sensor);
            is_hit.then(|| (point, libm::atan2(seen.y, seen.x), seen.xy().norm(), seen.z))
        })
        .collect();
    let turn = Turn::of(
        points
            .iter()
            .map(|(point, azimuth_rad, ..)| (*point, *azimuth_rad)),
    );
    let mut beams: Vec<Vec<(f64, f64)>> = vec![Vec::new(); BEAMS];
    for (_, azimuth_rad, range_m, z_m) in points {
        let turned = (turn.sign * (azimuth_rad - turn.start_rad)).rem_euclid(TAU);
        let beam = (turned / TAU * BEAMS as f64) as usize;
        beams[beam.min(BEAMS - 1)].push((range_m, z_m));
    }
    let ranges_m = beams.iter_mut().map(|beam| nearest_wall_m(beam));
    let step_rad = turn.sign * TAU / BEAMS as f64;
    Scan {
        // The middle of the first beam.
        angle_min_rad: (turn.start_rad + 0.5 * step_rad) as f32,
        angle_increment_rad: step_rad as f32,
        time_increment_s: turn.duration_s / BEAMS as f32,
        range_min_m: 0.0,
        range_max_m: f32::INFINITY,
        ranges_m: ranges_m.map(|range_m| range_m as f32).collect(),
    }
}

/// Range of the nearest wall among points, each with its range and height; infinite if there is none.
fn nearest_wall_m(points: &mut [(f64, f64)]) -> f64 {
    points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    for first in 0..points.len() {
        let near = points[first..].iter();
        let depth: Vec<_> = near
            .take_while(|point| point.0 - points[first].0 <= DEPTH_M)
            .collect();
        let heights = depth.iter().map(|point| point.1);
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z_m| {
            (low.min(z_m), high.max(z_m))
        });
        if high - low >= RISE_M {
            // The lowest may be on the ground in front of it.
            let of_wall = depth.iter().filter(|point| point.1 > low + 0.5 * RISE_M);
            let (sum_m, count) = of_wall.fold((0.0, 0.0), |(sum_m, count), point| {
                (sum_m + point.0, count + 1.0)
            });
            return sum_m / count;
        }
    }
    f64::INFINITY
}

/// How a lidar turns, seen from above.
struct Turn {
    start_rad: f64,
    /// Counter-clockwise: 1.
    sign: f64,
    /// Of a revolution; 0 if it does not turn.
    duration_s: f32,
}

impl Turn {
    fn of<'a>(points: impl Iterator<Item = (&'a CloudPoint, f64)>) -> Self {
        let mut last: [Option<f64>; 256] = [None; 256];
        let (mut steps, mut to_left) = (0_u32, 0_u32);
        let (mut first, mut end_s) = (None::<(f32, f64)>, f32::MIN);
        for (point, azimuth_rad) in points {
            let ring = usize::from(point.ring.unwrap_or_default()) % last.len();
            if let Some(before_rad) = last[ring].replace(azimuth_rad) {
                let step_rad = (azimuth_rad - before_rad + 0.5 * TAU).rem_euclid(TAU) - 0.5 * TAU;
                steps += 1;
                to_left += u32::from(step_rad > 0.0);
            }
            if first.is_none_or(|(after_s, _)| point.after_s < after_s) {
                first = Some((point.after_s, azimuth_rad));
            }
            end_s = end_s.max(point.after_s);
        }
        let (begin_s, start_rad) = first.unwrap_or_default();
        let sign = if 2 * to_left > steps { 1.0 } else { -1.0 };
        let agree = if sign > 0.0 { to_left } else { steps - to_left };
        let is_turning = 10 * u64::from(agree) > 9 * u64::from(steps);
        Self {
            start_rad,
            sign,
            duration_s: if is_turning {
                (end_s - begin_s).max(0.0)
            } else {
                0.0
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::FRAC_PI_2;

    use measurement::pose;
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;

    /// 16 rings from -15° to 15°, clockwise, 1 m above a ground that rises by 10 % ahead, in a round room of 10 m; a post of 0.3 m
    /// across stands 4 m to the left.
    fn cloud() -> Cloud {
        let mut points = Vec::new();
        for column in 0..1800 {
            let azimuth_rad = -TAU * f64::from(column) / 1800.0;
            for ring in 0..16_u16 {
                let elevation_rad = (2.0 * f64::from(ring) - 15.0).to_radians();
                let (sin, cos) = (libm::sin(azimuth_rad), libm::cos(azimuth_rad));
                let rise = libm::tan(elevation_rad) - 0.1 * cos;
                let of_ground_m = if rise < 0.0 {
                    -1.0 / rise
                } else {
                    f64::INFINITY
                };
                let is_post = sin > 0.0 && (4.0 * cos).abs() < 0.15;
                let of_wall_m = if is_post { 4.0 } else { 10.0 };
                let range_m = of_ground_m.min(of_wall_m);
                let z_m = range_m * libm::tan(elevation_rad);
                points.push(CloudPoint {
                    position_m: [range_m * cos, range_m * sin, z_m].map(|part| part as f32),
                    after_s: 0.1 * column as f32 / 1800.0,
                    intensity: 0.0,
                    ring: Some(ring),
                });
            }
        }
        Cloud {
            points,
            without_return: 0,
        }
    }

    #[test]
    fn walls_and_posts_are_seen_and_the_ground_is_not() {
        let cloud = cloud();
        let scan = walls(&cloud, &Pose::identity(), |_| false);
        assert_eq!(scan.ranges_m.len(), BEAMS);
        assert!(scan.angle_increment_rad < 0.0);
        assert!((f64::from(scan.time_increment_s) * 1440.0 - 0.1).abs() < 1e-3);
        let mut posts = 0;
        for (beam, range_m) in scan.ranges_m.iter().enumerate() {
            let angle_rad = scan.angle_min_rad + beam as f32 * scan.angle_increment_rad;
            let of_post = (range_m - 4.0).abs() < 0.01;
            posts += usize::from(of_post);
            assert!(
                of_post || (range_m - 10.0).abs() < 0.01,
                "{angle_rad}: {range_m}"
            );
            assert!(
                !of_post || (angle_rad.rem_euclid(std::f32::consts::TAU) - FRAC_PI_2).abs() < 0.05
            );
        }
        assert!((16..=20).contains(&posts), "{posts}");
    }

    #[test]
    fn a_tilted_sensor_sees_the_same_walls() {
        let (cloud, tilt) = (cloud(), UnitQuaternion::from_euler_angles(0.1, -0.08, 0.0));
        let tilted = Cloud {
            points: cloud
                .points
                .iter()
                .map(|point| CloudPoint {
                    position_m: (tilt.inverse() * Point3::from(point.position_m.map(f64::from)))
                        .cast()
                        .into(),
                    ..*point
                })
                .collect(),
            ..cloud
        };
        let level_from_sensor = Pose::from_parts(Translation3::new(0.3, 0.0, 1.0), tilt);
        let scan = walls(&tilted, &level_from_sensor, |_| false);
        let near = scan
            .ranges_m
            .iter()
            .filter(|range_m| **range_m < 9.9)
            .count();
        assert!((16..=20).contains(&near), "{near}");
        let own = walls(&tilted, &pose::planar(0.0, 0.0, 0.0), |point| {
            point.coords.norm() < 20.0
        });
        assert!(own.ranges_m.iter().all(|range_m| range_m.is_infinite()));
    }
}
