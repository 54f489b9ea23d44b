//! The last sweeps of the robot's sensors, for people to see.

use std::collections::BTreeMap;

use measurement::time::Monotonic;
use protocol::message::{MAX_SENSORS, Scan};

use super::reject_reason::RejectReason;

/// The last sweep of a sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct LastScan {
    /// Where the sensor was, x and y in `odom`, metres.
    pub origin_m: [f64; 2],
    /// What its beams hit, x and y in `odom`, metres, in the order of the beams.
    pub points_m: Vec<[f64; 2]>,
    /// When it was measured, nanoseconds on the robot's sensor clock.
    pub stamp_ns: i64,
    /// When it was heard.
    pub received_at: Monotonic,
}

/// One sweep a sensor, the newest.
#[derive(Clone, Debug, Default)]
pub(super) struct Scans(BTreeMap<String, LastScan>);

impl Scans {
    /// Takes a sweep.
    ///
    /// # Errors
    /// Where nobody could draw it, or there are more sensors than a robot has.
    pub(super) fn take(
        &mut self,
        scan: Scan,
        stamp_ns: i64,
        received_at: Monotonic,
    ) -> Result<(), RejectReason> {
        let points_m = scan.points_m().ok_or(RejectReason::Malformed)?;
        if self.0.len() >= MAX_SENSORS && !self.0.contains_key(&scan.sensor) {
            return Err(RejectReason::Malformed);
        }
        let last = LastScan {
            origin_m: scan.origin_m,
            points_m,
            stamp_ns,
            received_at,
        };
        self.0.insert(scan.sensor, last);
        Ok(())
    }

    /// By the sensor's name.
    pub(super) fn iter(&self) -> impl Iterator<Item = (&str, &LastScan)> {
        self.0.iter().map(|(sensor, scan)| (sensor.as_str(), scan))
    }

    /// Another run of the robot has begun, or nobody wants to see them any more.
    pub(super) fn forget(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(sensor: &str, points_m: &[[f64; 2]]) -> Scan {
        Scan::of_points(sensor.to_owned(), [1.0, 2.0], points_m.iter().copied())
    }

    #[test]
    fn the_newest_of_each_sensor_is_kept_and_robots_have_few() {
        let mut scans = Scans::default();
        let at = Monotonic::from_nanos;
        assert_eq!(scans.take(scan("laser", &[[3.0, 2.0]]), 1, at(10)), Ok(()));
        assert_eq!(scans.take(scan("laser", &[[1.0, 5.5]]), 2, at(20)), Ok(()));
        let held: Vec<_> = scans.iter().collect();
        let expected = LastScan {
            origin_m: [1.0, 2.0],
            points_m: vec![[1.0, 5.5]],
            stamp_ns: 2,
            received_at: at(20),
        };
        assert_eq!(held, [("laser", &expected)]);
        for n in 1..MAX_SENSORS {
            assert_eq!(scans.take(scan(&n.to_string(), &[]), 3, at(30)), Ok(()));
        }
        let refused = Err(RejectReason::Malformed);
        assert_eq!(scans.take(scan("one more", &[]), 4, at(40)), refused);
        assert_eq!(scans.take(scan("laser", &[]), 4, at(40)), Ok(()));
        let mut senseless = scan("laser", &[]);
        senseless.origin_m = [f64::NAN, 0.0];
        assert_eq!(scans.take(senseless, 5, at(50)), refused);
        scans.forget();
        assert_eq!(scans.iter().count(), 0);
    }
}
