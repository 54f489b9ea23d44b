//! The last sweep of a sensor, for people to see.

use serde::{Deserialize, Serialize};

/// Points in one [`Scan`] at most.
pub const MAX_SCAN_POINTS: usize = 360;
/// How far a point may be from the origin of its [`Scan`], centimetres along x and y.
pub const MAX_SCAN_REACH_CM: i32 = 100_000;

const CM_PER_M: f64 = 100.0;

/// `scan`: where the beams of a sensor's last sweep ended, thinned out, for display. The header has its stamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scan {
    /// The sensor's name, as in [`SensorInfo`](super::SensorInfo).
    pub sensor: String,
    /// Where the sensor was, x and y in `odom`, metres.
    pub origin_m: [f64; 2],
    /// The points in the order of the beams, centimetres along x and y of `odom`: the first from the origin, each of
    /// the others from the one before.
    pub steps_cm: Vec<(i32, i32)>,
}

impl Scan {
    /// The scan of these points, x and y in `odom`, metres. Points that are not finite or out of reach are left out, and
    /// so are those beyond the greatest number.
    pub fn of_points(
        sensor: String,
        origin_m: [f64; 2],
        points_m: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        let in_cm = |[x, y]: [f64; 2]| {
            let cm = [x - origin_m[0], y - origin_m[1]].map(|metres| (metres * CM_PER_M).round());
            let reach = f64::from(MAX_SCAN_REACH_CM);
            cm.iter()
                .all(|cm| cm.abs() <= reach)
                .then(|| cm.map(|cm| cm as i32))
        };
        let mut last = [0, 0];
        let steps_cm = points_m
            .into_iter()
            .filter_map(in_cm)
            .take(MAX_SCAN_POINTS)
            .map(|[x, y]| {
                let step = (x - last[0], y - last[1]);
                last = [x, y];
                step
            })
            .collect();
        Self {
            sensor,
            origin_m,
            steps_cm,
        }
    }

    /// The points, x and y in `odom`, metres; `None` where there are too many, or one is out of reach, or the origin is
    /// not finite.
    pub fn points_m(&self) -> Option<Vec<[f64; 2]>> {
        let is_sound = self.steps_cm.len() <= MAX_SCAN_POINTS
            && self.origin_m.iter().all(|metres| metres.is_finite());
        if !is_sound {
            return None;
        }
        let mut at = [0i32; 2];
        let point = |&(dx, dy): &(i32, i32)| {
            at = [at[0].checked_add(dx)?, at[1].checked_add(dy)?];
            let is_near = at
                .iter()
                .all(|cm| cm.unsigned_abs() <= MAX_SCAN_REACH_CM.unsigned_abs());
            let metres = |axis: usize| self.origin_m[axis] + f64::from(at[axis]) / CM_PER_M;
            is_near.then(|| [metres(0), metres(1)])
        };
        self.steps_cm.iter().map(point).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn points_come_back_to_the_centimetre() {
        let points = [[12.344, -3.0], [12.5, -2.75], [-500.0, 900.0]];
        let scan = Scan::of_points("laser".to_owned(), [10.0, -5.0], points);
        assert_eq!(scan.steps_cm, [(234, 200), (16, 25), (-51_250, 90_275)]);
        let back = scan.points_m().unwrap();
        for (back, point) in back.iter().zip(points) {
            for axis in [0, 1] {
                assert!((back[axis] - point[axis]).abs() <= 0.005 + 1e-9, "{back:?}");
            }
        }
        assert_eq!(back.len(), 3);
    }

    #[test]
    fn what_nobody_could_draw_is_left_out_and_refused() {
        let far = [[f64::NAN, 0.0], [0.0, f64::INFINITY], [1000.01, 0.0]];
        let scan = Scan::of_points(String::new(), [0.0; 2], far);
        assert_eq!(scan.steps_cm, []);
        let many = vec![[1.0, 1.0]; MAX_SCAN_POINTS + 1];
        let scan = Scan::of_points(String::new(), [0.0; 2], many);
        assert_eq!(scan.points_m().unwrap().len(), MAX_SCAN_POINTS);

        let refused = |origin_m, steps_cm| {
            let sensor = String::new();
            let scan = Scan {
                sensor,
                origin_m,
                steps_cm,
            };
            assert_eq!(scan.points_m(), None);
        };
        refused([f64::NAN, 0.0], Vec::new());
        refused([0.0; 2], vec![(0, 0); MAX_SCAN_POINTS + 1]);
        refused([0.0; 2], vec![(60_000, 0), (60_000, 0)]);
        refused([0.0; 2], vec![(i32::MAX, 0), (i32::MAX, 0)]);
        refused([0.0; 2], vec![(0, i32::MIN)]);
    }

    proptest! {
        #[test]
        fn whatever_came_is_refused_or_near(
            steps_cm in prop::collection::vec((any::<i32>(), -200_000i32..200_000), 0..400),
            origin_m in prop::array::uniform2(any::<f64>()),
        ) {
            let scan = Scan { sensor: String::new(), origin_m, steps_cm };
            if let Some(points) = scan.points_m() {
                prop_assert!(points.len() <= MAX_SCAN_POINTS);
                prop_assert!(points.iter().flatten().all(|metres| metres.is_finite()));
            }
        }
    }
}
