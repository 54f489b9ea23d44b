//! Clouds of three-dimensional lidars.

use crate::time::{RobotDuration, RobotTime};

/// Points of a three-dimensional lidar.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// Points with a return, in the order of the source.
    pub points: Vec<CloudPoint>,
    /// Beams without a return: their points are not finite, or at the sensor itself.
    pub without_return: u32,
}

/// One return.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// In the frame of the measurement, metres.
    pub position_m: [f32; 3],
    /// From the measurement's stamp, seconds.
    pub after_s: f32,
    /// Reflectivity as the sensor gives it.
    pub intensity: f32,
    /// The laser that measured it, or the row of an organised cloud; `None` if the source does not say.
    pub ring: Option<u16>,
}

/// A longer revolution is damaged data.
const MAX_REVOLUTION_S: f32 = 30.0;

impl Cloud {
    /// Times of the first and of the last point of a cloud with this stamp; `None` without points, or if a time is not finite or
    /// farther from the stamp than half a minute.
    pub fn span(&self, stamp: RobotTime) -> Option<(RobotTime, RobotTime)> {
        let mut span_s: Option<(f32, f32)> = None;
        for point in &self.points {
            if point.after_s.is_nan() || point.after_s.abs() > MAX_REVOLUTION_S {
                return None;
            }
            let (first_s, last_s) = span_s.unwrap_or((point.after_s, point.after_s));
            span_s = Some((first_s.min(point.after_s), last_s.max(point.after_s)));
        }
        let (first_s, last_s) = span_s?;
        let at = |after_s: f32| stamp + RobotDuration::from_secs_f64(after_s.into());
        Some((at(first_s), at(last_s)))
    }
}
