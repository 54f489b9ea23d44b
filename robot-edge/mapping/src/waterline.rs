//! How high the water stands, beneath which a laser sees nothing.

use nalgebra::Point3;

/// Share of a scan's height in the mean, which takes heaving out.
const WEIGHT: f64 = 0.02;

/// The water's height as a boat's base frame, which floats on it, tells.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Waterline {
    /// z of `odom`, metres.
    height_m: Option<f64>,
}

impl Waterline {
    /// Takes in where the base frame is, z of `odom`, metres.
    pub(super) fn observe(&mut self, base_m: f64) {
        let mean_m = self.height_m.unwrap_or(base_m);
        self.height_m = Some(mean_m + WEIGHT * (base_m - mean_m));
    }

    /// Where a beam without a return ends at the latest: light that goes into water does not come back, so it says
    /// nothing of what is beneath.
    pub(super) fn end_of_miss(self, origin: Point3<f64>, end: Point3<f64>) -> Point3<f64> {
        match self.height_m {
            Some(height_m) if end.z < height_m && height_m < origin.z => {
                let share = (origin.z - height_m) / (origin.z - end.z);
                origin + (end - origin) * share
            }
            Some(_) | None => end,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beams_without_a_return_end_at_the_water() {
        let mut waterline = Waterline::default();
        let (mast, far) = (Point3::new(0.0, 0.0, 2.0), Point3::new(40.0, 20.0, -6.0));
        assert_eq!(waterline.end_of_miss(mast, far), far);
        for base_m in [0.1, -0.1].repeat(300) {
            waterline.observe(base_m);
        }
        let end = waterline.end_of_miss(mast, far);
        assert!((end - Point3::new(10.0, 5.0, 0.0)).norm() < 0.05, "{end}");
        let sky = Point3::new(40.0, 0.0, 3.0);
        assert_eq!(waterline.end_of_miss(mast, sky), sky);
        let under = Point3::new(0.0, 0.0, -0.5);
        assert_eq!(waterline.end_of_miss(under, far), far);
    }
}
