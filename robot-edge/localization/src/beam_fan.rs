//! Directions of a scan's beams, computed once for scans of one shape.

use measurement::scan::Scan;

/// Cosine and sine of every beam's angle, kept for the next scan of the same shape.
#[derive(Clone, Debug, Default)]
pub struct BeamFan {
    angle_min_rad: f32,
    angle_increment_rad: f32,
    directions: Vec<(f64, f64)>,
}

impl BeamFan {
    /// `(cos, sin)` of each beam's angle in the sensor's plane.
    pub fn directions(&mut self, scan: &Scan) -> &[(f64, f64)] {
        let same_shape = self.angle_min_rad.to_bits() == scan.angle_min_rad.to_bits()
            && self.angle_increment_rad.to_bits() == scan.angle_increment_rad.to_bits();
        if !same_shape {
            self.angle_min_rad = scan.angle_min_rad;
            self.angle_increment_rad = scan.angle_increment_rad;
            self.directions.clear();
        }
        for beam in self.directions.len()..scan.ranges_m.len() {
            let angle_rad =
                f64::from(scan.angle_min_rad) + beam as f64 * f64::from(scan.angle_increment_rad);
            self.directions
                .push((libm::cos(angle_rad), libm::sin(angle_rad)));
        }
        &self.directions[..scan.ranges_m.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_follow_the_shape_of_each_scan() {
        let scan = |angle_min_rad, beams| Scan {
            angle_min_rad,
            angle_increment_rad: 0.5,
            ranges_m: vec![1.0; beams],
            ..Scan::default()
        };
        let mut fan = BeamFan::default();
        assert_eq!(
            fan.directions(&scan(0.0, 2)),
            [(1.0, 0.0), (libm::cos(0.5), libm::sin(0.5))]
        );
        assert_eq!(
            fan.directions(&scan(0.0, 3))[2],
            (libm::cos(1.0), libm::sin(1.0))
        );
        assert_eq!(
            fan.directions(&scan(-1.0, 1)),
            [(libm::cos(-1.0), libm::sin(-1.0))]
        );
    }
}
