//! Errors of a trajectory by relations between its poses.
//!
//! R. Kümmerle, B. Steder, C. Dornhege, M. Ruhnke, G. Grisetti, C. Stachniss, A. Kleiner, "On Measuring the Accuracy of
//! SLAM Algorithms", Autonomous Robots 2009, section 3; W. Burgard et al., "A Comparison of SLAM Algorithms Based on a
//! Graph of Relations", IROS 2009.

use measurement::time::RobotTime;
use nalgebra::{Isometry2, Vector2};

/// The true difference of two poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Relation {
    /// Stamps of the two poses.
    pub stamps: [RobotTime; 2],
    /// The second pose in the frame of the first.
    pub first_from_second: Isometry2<f64>,
    /// What stands behind the pose in the line.
    pub remarks: Vec<String>,
}

impl Relation {
    /// Reads a line of a `.relations` file: two stamps in seconds, x, y, z, roll, pitch, yaw; in metres and radians.
    /// `None` if it is a comment, empty or damaged.
    pub fn parse(line: &str) -> Option<Self> {
        if line.trim_start().starts_with('#') {
            return None;
        }
        let mut fields = line.split_ascii_whitespace();
        let mut number = || fields.next()?.parse::<f64>().ok().filter(|n| n.is_finite());
        let stamps = [number()?, number()?];
        let [x, y, _z, _roll, _pitch, yaw] = [
            number()?,
            number()?,
            number()?,
            number()?,
            number()?,
            number()?,
        ];
        Some(Self {
            stamps: [
                RobotTime::from_secs_f64(stamps[0])?,
                RobotTime::from_secs_f64(stamps[1])?,
            ],
            first_from_second: Isometry2::new(Vector2::new(x, y), yaw),
            remarks: fields.map(str::to_owned).collect(),
        })
    }

    /// The error of two poses: metres and radians (equations 3 and 4 of Kümmerle et al.).
    pub fn error(&self, first: &Isometry2<f64>, second: &Isometry2<f64>) -> (f64, f64) {
        let error = self.first_from_second.inv_mul(&first.inv_mul(second));
        (
            error.translation.vector.norm(),
            error.rotation.angle().abs(),
        )
    }
}

/// Mean, and standard deviation of the sample.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Spread {
    /// Number of values.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub deviation: f64,
}

impl Spread {
    /// Of these values; zero where there are none.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len();
        let mean = values.iter().sum::<f64>() / count.max(1) as f64;
        let squares: f64 = values
            .iter()
            .map(|value| (value - mean) * (value - mean))
            .sum();
        let deviation = libm::sqrt(squares / count.saturating_sub(1).max(1) as f64);
        Self {
            count,
            mean,
            deviation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_read_and_errors_measured() {
        let line = "90.239599 90.719599 0.422330 -0.000750 0.0 0.0 0.0 0.017260 7 9 c";
        let relation = Relation::parse(line).unwrap();
        assert_eq!(relation.stamps[1].as_nanos(), 90_719_599_000);
        assert_eq!(relation.remarks, ["7", "9", "c"]);
        let first = Isometry2::new(Vector2::new(3.0, 4.0), 2.0);
        let off = Isometry2::new(Vector2::new(0.03, -0.04), -0.01);
        let (m, rad) = relation.error(&first, &(first * relation.first_from_second * off));
        assert!(
            (m - 0.05).abs() < 1e-12 && (rad - 0.01).abs() < 1e-12,
            "{m} {rad}"
        );
        for damaged in [
            "",
            "# 1 2 0 0 0 0 0 0",
            "1 2 0 0 0 0 0",
            "1 2 0 x 0 0 0 0",
            "1 2 0 inf 0 0 0 0",
        ] {
            assert_eq!(Relation::parse(damaged), None, "{damaged}");
        }
    }

    #[test]
    fn the_deviation_is_that_of_the_sample() {
        let spread = Spread::of(&[1.0, 2.0, 3.0, 6.0]);
        assert!((spread.mean - 3.0).abs() < 1e-12);
        assert!((spread.deviation - libm::sqrt(14.0 / 3.0)).abs() < 1e-12);
        assert_eq!(Spread::of(&[]), Spread::default());
    }
}
