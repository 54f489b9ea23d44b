//! One sweep of a planar range sensor.

use crate::time::RobotDuration;

/// One sweep, with the f32 fields of `sensor_msgs/LaserScan`.
///
/// Beam `i` points at `angle_min_rad + i·angle_increment_rad` in the sensor's x-y plane (x forward,
/// y left, counter-clockwise positive) and was measured `i·time_increment_s` after the
/// measurement's stamp.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Scan {
    /// Angle of beam 0, radians.
    pub angle_min_rad: f32,
    /// Angle from a beam to the next, radians, negative for a clockwise sensor.
    pub angle_increment_rad: f32,
    /// Time from a beam to the next, seconds.
    pub time_increment_s: f32,
    /// Smallest range that is a measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or above this are misses, metres.
    pub range_max_m: f32,
    /// Ranges in beam order, metres.
    pub ranges_m: Vec<f32>,
}

/// A longer sweep is damaged data: the slowest scanners turn once in some seconds.
const MAX_SWEEP_S: f64 = 30.0;

impl Scan {
    /// Time from the first beam to the last; `None` for an invalid scan: no beams, angles or times
    /// that are not finite, negative time increment, more than two turns, no greatest range.
    pub fn sweep_duration(&self) -> Option<RobotDuration> {
        let steps = self.ranges_m.len().checked_sub(1)? as f64;
        let sweep_s = steps * f64::from(self.time_increment_s);
        let swept_rad = (steps * f64::from(self.angle_increment_rad)).abs();
        let sensible = self.angle_min_rad.is_finite()
            && swept_rad <= 4.0 * std::f64::consts::PI
            && (0.0..=MAX_SWEEP_S).contains(&sweep_s)
            && self.range_max_m > 0.0;
        sensible.then(|| RobotDuration::from_secs_f64(sweep_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn senseless_scans_are_recognised() {
        let good = Scan {
            angle_min_rad: -1.5,
            angle_increment_rad: 0.01,
            time_increment_s: 0.001,
            range_min_m: 0.0,
            range_max_m: 80.0,
            ranges_m: vec![1.0; 301],
        };
        assert_eq!(
            good.sweep_duration().map(RobotDuration::as_nanos),
            Some(300_000_014)
        );
        for bad in [
            Scan {
                ranges_m: vec![],
                ..good.clone()
            },
            Scan {
                angle_min_rad: f32::NAN,
                ..good.clone()
            },
            Scan {
                angle_increment_rad: f32::INFINITY,
                ..good.clone()
            },
            Scan {
                angle_increment_rad: 1.0,
                ..good.clone()
            },
            Scan {
                time_increment_s: -0.001,
                ..good.clone()
            },
            Scan {
                time_increment_s: f32::NAN,
                ..good.clone()
            },
            Scan {
                time_increment_s: 1.0,
                ..good.clone()
            },
            Scan {
                range_max_m: f32::NAN,
                ..good.clone()
            },
            Scan {
                range_max_m: 0.0,
                ..good.clone()
            },
        ] {
            assert_eq!(bad.sweep_duration(), None, "{bad:?}");
        }
    }
}
