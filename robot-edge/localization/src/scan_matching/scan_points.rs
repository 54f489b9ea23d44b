//! The hits of a scan as points in the plane, de-skewed by the motion and thinned.

use measurement::scan::Scan;
use nalgebra::{Isometry2, Point2, UnitVector2, Vector2};

/// One hit in the frame of the vehicle at the scan's stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanPoint {
    /// Metres.
    pub position: Point2<f64>,
    /// Direction of the beam.
    pub view: UnitVector2<f64>,
}

impl ScanPoint {
    /// The point in another frame.
    #[must_use]
    pub fn in_frame(&self, frame_from_own: &Isometry2<f64>) -> Self {
        Self {
            position: frame_from_own * self.position,
            view: frame_from_own.rotation * self.view,
        }
    }
}

/// Limits of the hits that are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLimits {
    /// Nearest hit, metres.
    pub min_range_m: f64,
    /// Farthest hit, metres.
    pub max_range_m: f64,
    /// Least distance of consecutive points, metres.
    pub spacing_m: f64,
}

/// The hits of `scan` in the frame of the vehicle at its stamp. The vehicle moves by `motion` in
/// `motion_s` seconds: each beam is placed at its own time, by linear interpolation.
pub fn scan_points(
    scan: &Scan,
    base_from_sensor: &Isometry2<f64>,
    (motion, motion_s): (&Isometry2<f64>, f64),
    limits: &PointLimits,
) -> Vec<ScanPoint> {
    let mut points: Vec<ScanPoint> = Vec::with_capacity(scan.ranges_m.len());
    let turn_rad = motion.rotation.angle();
    for (beam, &range_m) in scan.ranges_m.iter().enumerate() {
        let range = f64::from(range_m);
        // Not a number fails both comparisons.
        if !(range >= limits.min_range_m.max(scan.range_min_m.into())
            && range <= limits.max_range_m
            && range_m < scan.range_max_m)
        {
            continue;
        }
        let after_s = beam as f64 * f64::from(scan.time_increment_s);
        let share = if motion_s > 0.0 {
            after_s / motion_s
        } else {
            0.0
        };
        let base_then = Isometry2::new(motion.translation.vector * share, turn_rad * share);
        let angle_rad =
            f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad);
        let direction = Vector2::new(libm::cos(angle_rad), libm::sin(angle_rad));
        let point = ScanPoint {
            position: Point2::from(direction * range),
            view: UnitVector2::new_unchecked(direction),
        }
        .in_frame(&(base_then * base_from_sensor));
        let is_apart = |last: &ScanPoint| {
            (last.position - point.position).norm_squared() >= limits.spacing_m * limits.spacing_m
        };
        if points.last().is_none_or(is_apart) {
            points.push(point);
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    const LIMITS: PointLimits = PointLimits {
        min_range_m: 0.1,
        max_range_m: 30.0,
        spacing_m: 0.05,
    };

    #[test]
    fn each_beam_is_placed_at_its_own_time() {
        let scan = Scan {
            angle_min_rad: 0.0,
            angle_increment_rad: FRAC_PI_2 as f32,
            time_increment_s: 0.1,
            range_min_m: 0.0,
            range_max_m: 10.0,
            ranges_m: vec![2.0, 2.0, 10.0, f32::NAN, 0.05],
        };
        // A turn of 90° to the left and 1 m ahead, in 0.2 s.
        let motion = Isometry2::new(Vector2::new(1.0, 0.0), FRAC_PI_2);
        let mount = Isometry2::new(Vector2::new(0.5, 0.0), 0.0);
        let points = scan_points(&scan, &mount, (&motion, 0.2), &LIMITS);
        assert_eq!(points.len(), 2, "{points:?}");
        assert!((points[0].position - Point2::new(2.5, 0.0)).norm() < 1e-6);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let expected = Point2::new(0.5 + (0.5 - 2.0) * half, (0.5 + 2.0) * half);
        assert!(
            (points[1].position - expected).norm() < 1e-6,
            "{}",
            points[1].position
        );
    }
}
