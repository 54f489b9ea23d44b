//! A world of walls, a vehicle with a laser, and odometry that slips, for tests.

use measurement::scan::Scan;
use measurement::time::{RobotDuration, RobotTime};
use nalgebra::{Isometry2, Point2, Vector2};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::slam::{ScanInput, ScanPose, ScanSlam};

/// Ends of a wall, metres.
pub(crate) type Wall = [[f64; 2]; 2];

pub(crate) const RANGE_MAX_M: f32 = 12.0;

/// Walls along these corners.
pub(crate) fn walls(corners: &[[f64; 2]]) -> impl Iterator<Item = Wall> {
    corners.windows(2).map(|pair| [pair[0], pair[1]])
}

/// A scan of 270°, 271 beams, with noise of 1 cm.
pub(crate) fn scan(world: &[Wall], pose: &Isometry2<f64>, random: &mut ChaCha8Rng) -> Scan {
    let mut scan = Scan {
        angle_min_rad: -135_f32.to_radians(),
        angle_increment_rad: 1_f32.to_radians(),
        time_increment_s: 0.0,
        range_min_m: 0.0,
        range_max_m: RANGE_MAX_M,
        ranges_m: Vec::new(),
    };
    let origin = pose.translation.vector;
    for beam in 0..271 {
        let angle_rad = f64::from(scan.angle_min_rad + beam as f32 * scan.angle_increment_rad);
        let direction = pose.rotation * Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
        let hit = |[from, to]: &Wall| {
            let (from, to) = (Vector2::from(*from), Vector2::from(*to));
            let along = to - from;
            let cross = direction.perp(&along);
            let range = (from - origin).perp(&along) / cross;
            let share = (from - origin).perp(&direction) / cross;
            (range > 0.0 && (0.0..=1.0).contains(&share)).then_some(range)
        };
        let range = world.iter().filter_map(hit).fold(f64::INFINITY, f64::min);
        scan.ranges_m.push((range + 0.01 * normal(random)) as f32);
    }
    scan
}

/// About normal, standard deviation 1.
fn normal(random: &mut ChaCha8Rng) -> f64 {
    let uniform =
        |random: &mut ChaCha8Rng| f64::from(random.next_u32()) / f64::from(u32::MAX) - 0.5;
    (0..12).map(|_| uniform(random)).sum()
}

/// A way along these points, a pose each 0.15 m and 10°; it turns in place.
pub(crate) fn way(points: &[[f64; 2]]) -> Vec<Isometry2<f64>> {
    let mut poses: Vec<Isometry2<f64>> = Vec::new();
    for pair in points.windows(2) {
        let (from, to) = (Point2::from(pair[0]), Point2::from(pair[1]));
        let along = to - from;
        let heading_rad = libm::atan2(along.y, along.x);
        let goal = nalgebra::UnitComplex::new(heading_rad);
        if let Some(last) = poses.last().copied() {
            let turn_rad = last.rotation.angle_to(&goal);
            let steps = (turn_rad.abs() / 10_f64.to_radians()).ceil();
            for step in 1..steps as u32 {
                let turned = last.rotation.angle() + turn_rad * f64::from(step) / steps;
                poses.push(Isometry2::new(last.translation.vector, turned));
            }
        }
        let steps = (along.norm() / 0.15).ceil();
        for step in 0..=steps as u32 {
            let place = from + along * (f64::from(step) / steps);
            poses.push(Isometry2::new(place.coords, heading_rad));
        }
    }
    poses
}

/// Drives along a way. Of the odometry, ways are too long by `slip`, and it turns by `drift_rad_per_m`.
pub(crate) struct Drive<'a> {
    pub(crate) world: &'a [Wall],
    pub(crate) way: &'a [Isometry2<f64>],
    pub(crate) has_odometry: bool,
    pub(crate) slip: f64,
    pub(crate) drift_rad_per_m: f64,
    pub(crate) seed: u64,
}

impl Drive<'_> {
    /// Stamps, scans and odometry.
    pub(crate) fn scans(&self) -> Vec<(RobotTime, Scan, Isometry2<f64>)> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        let mut odom_from_base = Isometry2::identity();
        let mut scans = Vec::new();
        for (pose, number) in self.way.iter().zip(0..) {
            if number > 0 {
                let step = self.way[number as usize - 1].inv_mul(pose);
                let way_m = step.translation.vector.norm();
                odom_from_base *= Isometry2::new(
                    step.translation.vector * (1.0 + self.slip + 0.02 * normal(&mut random)),
                    step.rotation.angle() * (1.0 + 0.02 * normal(&mut random))
                        + self.drift_rad_per_m * way_m,
                );
            }
            let stamp = RobotTime::from_nanos(0) + RobotDuration::from_millis(200 * number);
            let scan = scan(self.world, pose, &mut random);
            scans.push((stamp, scan, odom_from_base));
        }
        scans
    }

    /// The poses of the scans.
    pub(crate) fn run(&self, slam: &mut ScanSlam) -> Vec<ScanPose> {
        let scans = self.scans().into_iter();
        let poses = scans.map(|(stamp, scan, odom_from_base)| {
            slam.push(&ScanInput {
                stamp,
                scan: &scan,
                base_from_sensor: Isometry2::identity(),
                odom_from_base: self.has_odometry.then_some(odom_from_base),
                is_heading_only: false,
                is_by_clouds: false,
                is_placed: false,
                base_from_antenna: Point2::origin(),
            })
        });
        poses.collect()
    }
}

/// A corridor around a block, with niches that make its four sides different.
pub(crate) fn ring() -> Vec<Wall> {
    let outer = [
        [0.0, 0.0],
        [4.0, 0.0],
        [4.0, -0.6],
        [5.0, -0.6],
        [5.0, 0.0],
        [15.4, 0.0],
        [15.4, 3.0],
        [16.0, 3.0],
        [16.0, 5.5],
        [15.4, 5.5],
        [15.4, 10.7],
        [9.0, 10.7],
        [9.0, 11.5],
        [7.5, 11.5],
        [7.5, 10.7],
        [0.0, 10.0],
        [0.0, 7.0],
        [-0.4, 7.0],
        [-0.4, 6.0],
        [0.0, 6.0],
        [0.0, 0.0],
    ];
    let inner = [
        [2.0, 2.0],
        [6.0, 2.0],
        [6.0, 2.3],
        [7.0, 2.3],
        [7.0, 2.0],
        [12.0, 2.0],
        [12.0, 8.0],
        [5.0, 8.0],
        [5.0, 7.6],
        [4.5, 7.6],
        [4.5, 8.0],
        [2.0, 8.0],
        [2.0, 2.0],
    ];
    walls(&outer).chain(walls(&inner)).collect()
}

/// Once around the ring and on to the first corner again.
pub(crate) const AROUND_RING: [[f64; 2]; 7] = [
    [1.0, 1.0],
    [13.0, 1.0],
    [13.0, 9.0],
    [1.0, 9.0],
    [1.0, 1.0],
    [13.0, 1.0],
    [13.0, 4.0],
];

/// Two rooms that look the same, 4 m × 3 m with a table, on one side of a corridor without features; their doors are 9 m
/// apart. With a third that differs, at its end.
pub(crate) fn two_rooms() -> Vec<Wall> {
    let room = |x: f64| {
        let walls_of = [
            [x + 1.5, 0.0],
            [x, 0.0],
            [x, 3.0],
            [x + 4.0, 3.0],
            [x + 4.0, 0.0],
            [x + 2.5, 0.0],
        ];
        let table = [
            [x + 0.5, 2.0],
            [x + 1.3, 2.0],
            [x + 1.3, 2.6],
            [x + 0.5, 2.6],
            [x + 0.5, 2.0],
        ];
        walls(&walls_of).chain(walls(&table)).collect::<Vec<_>>()
    };
    let corridor = [
        [1.5, 0.0],
        [-12.0, 0.0],
        [-12.0, -2.0],
        [25.0, -2.0],
        [25.0, 0.0],
        [11.5, 0.0],
    ];
    let between = [[2.5, 0.0], [10.5, 0.0]];
    let mut world = room(0.0);
    world.extend(room(9.0));
    world.extend(walls(&corridor));
    world.extend(walls(&between));
    world
}

/// From inside the first room to the second.
pub(crate) const THROUGH_ROOMS: [[f64; 2]; 8] = [
    [2.0, 1.0],
    [3.0, 2.0],
    [2.0, 1.0],
    [2.0, -1.0],
    [11.0, -1.0],
    [11.0, 1.0],
    [12.0, 2.0],
    [11.0, 1.0],
];
