//! The pose and the trail of the vehicle, and the last scans of its sensors.

use std::collections::{BTreeMap, VecDeque};

use measurement::time::Monotonic;
use protocol::export::{Poses, StampedPose};
use protocol::message::{MAX_SENSORS, Pose, Scan};

use super::handle_message::{has_moved, pose_changed};
use super::messages::RejectReason;

/// Poses kept for the export; a longer run is thinned by half, repeatedly.
const MAX_POSES: usize = 500_000;
/// From one of them to the next, nanoseconds, at least: of a driven vehicle come 50 a second, else 5, and some a little early.
const KEPT_PERIOD_NS: u64 = 180_000_000;
/// So far, in metres, and as a quaternion component, half an angle: more than the noise of a vehicle that stands.
const KEPT_STEP: (f64, f32) = (0.01, 5e-3);

#[derive(Clone, Debug, Default)]
pub struct Vehicle {
    pose: Option<(Pose, i64, Monotonic)>,
    trail: Trail,
    poses: Poses,
    kept: Option<(Pose, i64)>,
    /// How often the poses were thinned by half.
    thinned: u32,
    drawn: Option<Pose>,
}

impl Vehicle {
    pub fn pose(&self) -> Option<(Pose, Monotonic)> {
        self.pose.map(|(pose, _, at)| (pose, at))
    }

    pub fn stamp_ns(&self) -> Option<i64> {
        self.pose.map(|(_, stamp_ns, _)| stamp_ns)
    }

    /// Angle of the vehicle's x axis in `odom`, radians, counter-clockwise from x.
    pub fn heading_rad(&self) -> Option<f64> {
        self.pose.map(|(pose, _, _)| {
            let [x, y, z, w] = pose.quaternion_xyzw.map(f64::from);
            libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        })
    }

    pub const fn trail(&self) -> &VecDeque<[f64; 2]> {
        &self.trail.points_m
    }

    /// Some five a second at most, each a centimetre or half a degree from the one before, oldest first.
    pub const fn poses(&self) -> &Poses {
        &self.poses
    }

    pub(super) fn take(&mut self, pose: Pose, stamp_ns: i64, now: Monotonic) -> bool {
        self.pose = Some((pose, stamp_ns, now));
        let [x, y, _] = pose.position_m;
        self.trail.add(stamp_ns, [x, y]);
        let pose_changed = self.drawn.is_none_or(|drawn| pose_changed(&drawn, &pose));
        if pose_changed {
            self.drawn = Some(pose);
        }
        self.keep(pose, stamp_ns);
        pose_changed
    }

    pub(super) fn show_trail(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.trail.replace(points_m);
    }

    /// Adds missing points to the trail: stamps, nanoseconds, and metres in `odom`, oldest first.
    pub(super) fn fill_trail(&mut self, known: &[(i64, [f64; 2])]) {
        let newest_ns = self.pose.map_or(i64::MAX, |(_, stamp_ns, _)| stamp_ns);
        self.trail.fill(known, newest_ns);
    }

    pub(super) fn forget(&mut self) {
        *self = Self::default();
    }

    fn keep(&mut self, pose: Pose, stamp_ns: i64) {
        let period_ns = KEPT_PERIOD_NS << self.thinned;
        let is_next = |(kept, kept_ns): (Pose, i64)| {
            stamp_ns.abs_diff(kept_ns) >= period_ns && has_moved(&kept, &pose, KEPT_STEP)
        };
        if !self.kept.is_none_or(is_next) {
            return;
        }
        self.kept = Some((pose, stamp_ns));
        if self.poses.len() >= MAX_POSES {
            self.poses = self.poses.every(2, 0).collect();
            self.thinned += 1;
        }
        self.poses.push(StampedPose::new(
            stamp_ns,
            pose.position_m,
            pose.quaternion_xyzw.map(f64::from),
        ));
    }
}

const STEP_M: f64 = 0.1;
/// Beyond this limit the older half of the points is thinned by half.
const MAX_POINTS: usize = 10_000;

#[derive(Clone, Debug, Default)]
pub(super) struct Trail {
    points_m: VecDeque<[f64; 2]>,
    stamps_ns: VecDeque<i64>,
}

impl Trail {
    pub(super) fn add(&mut self, stamp_ns: i64, point_m: [f64; 2]) {
        let last = self.points_m.back();
        if last.is_none_or(|last| is_far(*last, point_m)) {
            self.push((stamp_ns, point_m));
            if self.points_m.len() > MAX_POINTS {
                self.thin();
            }
        }
    }

    /// Inserts known points, oldest first, up to a stamp, if they are far enough from their neighbours. If the data's
    /// clock restarted, only the points since then are considered.
    pub(super) fn fill(&mut self, known: &[(i64, [f64; 2])], newest_ns: i64) {
        let known = &known[since_last_fall(known, |(stamp_ns, _)| *stamp_ns)..];
        let Some((first_ns, _)) = known.first() else {
            return;
        };
        let restart = since_last_fall(self.stamps_ns.make_contiguous(), |stamp_ns| *stamp_ns);
        let here = self.stamps_ns.range(restart..);
        let from = restart + here.take_while(|stamp_ns| *stamp_ns <= first_ns).count();
        // Of a long trail a copy takes half a megabyte, so what is older than the gap stays where it is.
        let newer = self.stamps_ns.split_off(from).into_iter();
        let mut newer = newer.zip(self.points_m.split_off(from)).peekable();
        for &(stamp_ns, point_m) in known {
            if stamp_ns > newest_ns {
                break;
            }
            while let Some(earlier) = newer.next_if(|(here_ns, _)| *here_ns <= stamp_ns) {
                self.push(earlier);
            }
            let before = self.points_m.range(restart..).next_back();
            let after = newer.peek().map(|(_, after)| after);
            let mut neighbours = before.into_iter().chain(after);
            if neighbours.all(|other| is_far(*other, point_m)) {
                self.push((stamp_ns, point_m));
            }
        }
        newer.for_each(|later| self.push(later));
        while self.points_m.len() > MAX_POINTS {
            self.thin();
        }
    }

    fn push(&mut self, (stamp_ns, point_m): (i64, [f64; 2])) {
        self.stamps_ns.push_back(stamp_ns);
        self.points_m.push_back(point_m);
    }

    pub(super) fn replace(&mut self, points_m: impl IntoIterator<Item = [f64; 2]>) {
        self.points_m = points_m.into_iter().take(MAX_POINTS).collect();
        self.stamps_ns = std::iter::repeat_n(i64::MIN, self.points_m.len()).collect();
    }

    fn thin(&mut self) {
        let old = self.points_m.len() / 2;
        let is_kept = |index: usize| index >= old || index.is_multiple_of(2);
        let mut index = 0..;
        self.points_m.retain(|_| index.next().is_none_or(is_kept));
        let mut index = 0..;
        self.stamps_ns.retain(|_| index.next().is_none_or(is_kept));
    }
}

/// Index of the last run of rising stamps.
fn since_last_fall<T>(points: &[T], stamp_ns: impl Fn(&T) -> i64) -> usize {
    let falls = points
        .windows(2)
        .rposition(|pair| stamp_ns(&pair[1]) < stamp_ns(&pair[0]));
    falls.map_or(0, |index| index + 1)
}

fn is_far([ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> bool {
    let (dx, dy) = (bx - ax, by - ay);
    dx * dx + dy * dy >= STEP_M * STEP_M
}

#[derive(Clone, Debug, PartialEq)]
pub struct LastScan {
    /// Position of the sensor, x and y in `odom`, metres.
    pub origin_m: [f64; 2],
    /// Hits in the order of the beams, x and y in `odom`, metres.
    pub points_m: Vec<[f64; 2]>,
    /// Nanoseconds on the robot's sensor clock.
    pub stamp_ns: i64,
    pub received_at: Monotonic,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Scans {
    pub(super) by_sensor: BTreeMap<String, LastScan>,
    pub(super) is_wanted: bool,
}

impl Scans {
    /// Returns whether scans were wanted and are no longer.
    pub(super) fn want(&mut self, is_wanted: bool) -> bool {
        let is_ended = std::mem::replace(&mut self.is_wanted, is_wanted) && !is_wanted;
        if is_ended {
            self.by_sensor.clear();
        }
        is_ended
    }

    pub(super) fn take(
        &mut self,
        scan: Scan,
        stamp_ns: i64,
        received_at: Monotonic,
    ) -> Result<(), RejectReason> {
        let points_m = scan.points_m().ok_or(RejectReason::Malformed)?;
        if self.by_sensor.len() >= MAX_SENSORS && !self.by_sensor.contains_key(&scan.sensor) {
            return Err(RejectReason::Malformed);
        }
        let last = LastScan {
            origin_m: scan.origin_m,
            points_m,
            stamp_ns,
            received_at,
        };
        self.by_sensor.insert(scan.sensor, last);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64, z: f32, w: f32) -> Pose {
        Pose {
            position_m: [x, 0.0, 0.0],
            quaternion_xyzw: [0.0, 0.0, z, w],
            ..crate::test_support::pose_at_rest()
        }
    }

    #[test]
    fn export_keeps_poses_that_the_trail_skips() {
        let mut vehicle = Vehicle::default();
        let now = Monotonic::default();
        for (x, ms, is_changed) in [
            (0.0, 0, true),
            (0.0, 200, false),
            (0.03, 400, true),
            (0.04, 450, true),
            (0.05, 590, true),
            // Where it comes to rest is kept, too, and then its noise is not.
            (0.07, 650, true),
            (0.07, 850, false),
            (0.073, 1050, true),
        ] {
            let changed = vehicle.take(pose(x, 0.0, 1.0), ms * 1_000_000, now);
            assert_eq!(changed, is_changed, "{ms} ms");
        }
        assert_eq!(vehicle.trail().len(), 1);
        let kept = vehicle.poses().iter_from(0);
        let kept: Vec<_> = kept.map(|pose| pose.stamp_ns / 1_000_000).collect();
        assert_eq!(kept, [0, 400, 590, 850]);
    }

    #[test]
    fn poses_of_a_long_run_are_thinned_by_half_again_and_again() {
        let mut vehicle = Vehicle::default();
        let most = i64::try_from(MAX_POSES).unwrap();
        let fifths = 3 * most;
        for fifth in 0..fifths {
            let at = pose(0.02 * fifth as f64, 0.0, 1.0);
            vehicle.take(at, fifth * 200_000_000, Monotonic::default());
        }
        let kept = vehicle.poses().iter_from(0);
        let kept: Vec<_> = kept.map(|pose| pose.stamp_ns / 200_000_000).collect();
        let expected: Vec<_> = (0..fifths).step_by(4).collect();
        assert_eq!(kept, expected);
    }

    #[test]
    fn small_steps_accumulate_to_a_visible_change() {
        let mut vehicle = Vehicle::default();
        let now = Monotonic::default();
        let seen = (0..10).filter(|step| {
            let x = 0.0005 * f64::from(*step);
            vehicle.take(pose(x, 0.0, 1.0), i64::from(*step), now)
        });
        // At 0, 2 and 4 mm.
        assert_eq!(seen.collect::<Vec<_>>(), [0, 4, 8]);
    }

    #[test]
    fn heading_is_the_yaw_of_the_quaternion() {
        let mut vehicle = Vehicle::default();
        let half = std::f32::consts::FRAC_1_SQRT_2;
        vehicle.take(pose(0.0, half, half), 0, Monotonic::default());
        let heading_rad = vehicle.heading_rad().unwrap();
        assert!((heading_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
    }

    fn along_x(xs: impl IntoIterator<Item = i64>) -> impl Iterator<Item = (i64, [f64; 2])> {
        xs.into_iter().map(|x| (x, [x as f64, 0.0]))
    }

    fn of(xs: impl IntoIterator<Item = i64>) -> Trail {
        let mut trail = Trail::default();
        along_x(xs).for_each(|(stamp_ns, point_m)| trail.add(stamp_ns, point_m));
        trail
    }

    fn xs(trail: &Trail) -> Vec<i64> {
        trail.points_m.iter().map(|[x, _]| *x as i64).collect()
    }

    fn fill(trail: &mut Trail, known: impl IntoIterator<Item = i64>) {
        trail.fill(&along_x(known).collect::<Vec<_>>(), 22);
    }

    #[test]
    fn clock_restart_draws_no_line_across_the_map() {
        // The clock stepped back by 100.
        let mut trail = of([100, 101, 102]);
        for x in [3, 7] {
            trail.add(x, [100.0 + x as f64, 0.0]);
        }
        let known = [101, 102, 4, 5].map(|stamp_ns| (stamp_ns, [100.0 + stamp_ns as f64, 0.0]));
        trail.fill(&known, 7);
        assert_eq!(xs(&trail), [100, 101, 102, 103, 104, 105, 107]);
        // Points from before the step alone.
        trail.fill(&[(100, [90.0, 0.0]), (101, [91.0, 0.0])], 7);
        assert_eq!(trail.points_m.len(), 7);
    }

    #[test]
    fn trail_is_thinned_and_keeps_its_ends() {
        let mut trail = of([0]);
        trail.add(1, [0.05, 0.0]);
        assert_eq!(trail.points_m.len(), 1);
        let trail = of(0..100_000);
        assert!(trail.points_m.len() <= MAX_POINTS);
        assert_eq!(trail.points_m.len(), trail.stamps_ns.len());
        assert_eq!((trail.points_m[0], trail.stamps_ns[0]), ([0.0, 0.0], 0));
        assert_eq!(trail.points_m.back(), Some(&[99_999.0, 0.0]));
    }

    #[test]
    fn gaps_are_filled_and_known_points_stay() {
        let mut trail = of([10, 11, 12, 20, 21]);
        fill(&mut trail, [0, 5, 10, 15, 20, 22, 30]);
        assert_eq!(xs(&trail), [0, 5, 10, 11, 12, 15, 20, 21, 22]);
        let stamps: Vec<_> = trail.stamps_ns.iter().copied().collect();
        assert_eq!(stamps, xs(&trail));
        trail.fill(&[(13, [12.05, 0.0]), (14, [14.95, 0.0])], 22);
        assert_eq!(xs(&trail).len(), 9);
        fill(&mut trail, -50_000..0);
        assert!(trail.points_m.len() <= MAX_POINTS);
        assert_eq!(trail.points_m.back(), Some(&[22.0, 0.0]));
    }

    #[test]
    fn a_gap_leaves_what_is_older_where_it_is() {
        let mut trail = of((0..9000).chain(9100..9110));
        let place = trail.points_m.as_slices().0.as_ptr();
        trail.fill(&along_x(8990..9105).collect::<Vec<_>>(), 9109);
        assert_eq!(xs(&trail), (0..9110).collect::<Vec<_>>());
        assert_eq!(trail.points_m.as_slices().0.as_ptr(), place);
    }

    #[test]
    fn empty_trail_is_filled_completely() {
        let mut trail = Trail::default();
        fill(&mut trail, [0, 1, 2]);
        assert_eq!(xs(&trail), [0, 1, 2]);
        trail.replace([[7.0, 0.0]]);
        trail.add(9, [8.0, 0.0]);
        assert_eq!(xs(&trail), [7, 8]);
    }

    fn scan(sensor: &str, points_m: &[[f64; 2]]) -> Scan {
        Scan::of_points(sensor.to_owned(), [1.0, 2.0], points_m.iter().copied())
    }

    #[test]
    fn newest_scan_of_a_bounded_number_of_sensors() {
        let mut scans = Scans::default();
        let at = Monotonic::from_nanos;
        assert_eq!(scans.take(scan("laser", &[[3.0, 2.0]]), 1, at(10)), Ok(()));
        assert_eq!(scans.take(scan("laser", &[[1.0, 5.5]]), 2, at(20)), Ok(()));
        let held = &scans.by_sensor;
        let expected = LastScan {
            origin_m: [1.0, 2.0],
            points_m: vec![[1.0, 5.5]],
            stamp_ns: 2,
            received_at: at(20),
        };
        assert_eq!(*held, [("laser".to_owned(), expected)].into());
        for n in 1..MAX_SENSORS {
            assert_eq!(scans.take(scan(&n.to_string(), &[]), 3, at(30)), Ok(()));
        }
        let refused = Err(RejectReason::Malformed);
        assert_eq!(scans.take(scan("one more", &[]), 4, at(40)), refused);
        assert_eq!(scans.take(scan("laser", &[]), 4, at(40)), Ok(()));
        let mut senseless = scan("laser", &[]);
        senseless.origin_m = [f64::NAN, 0.0];
        assert_eq!(scans.take(senseless, 5, at(50)), refused);
    }
}
