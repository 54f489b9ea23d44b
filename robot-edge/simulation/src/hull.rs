//! A hull: how a boat lies on the water.

use nalgebra::{Point2, Vector2};

use crate::chassis::Posture;
use crate::path::PlanarPose;
use crate::waves::Waves;

/// A hull about `base_link`, which lies amidships at the waterline of the boat at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hull {
    /// From the stern to the bow, metres.
    pub length_m: f64,
    /// From starboard to port, metres; of a catamaran over both hulls.
    pub width_m: f64,
}

impl Hull {
    /// How the boat lies at `at`, on waves about `water_level_m`.
    ///
    /// It follows the surface under its bow, stern and sides: it heaves with their mean, and pitches and rolls
    /// with the slopes between them, so that waves shorter than the hull hardly move it. It has no inertia of
    /// its own, hence no resonance; and it is neither set nor slowed by waves.
    pub fn afloat(
        &self,
        at: PlanarPose,
        waves: &Waves,
        water_level_m: f64,
        time_s: f64,
    ) -> Posture {
        let ahead = Vector2::new(libm::cos(at.yaw_rad), libm::sin(at.yaw_rad));
        let to_bow_m = ahead * (0.5 * self.length_m);
        let to_port_m = Vector2::new(-ahead.y, ahead.x) * (0.5 * self.width_m);
        let [bow_m, stern_m, port_m, starboard_m] = [to_bow_m, -to_bow_m, to_port_m, -to_port_m]
            .map(|to_m| waves.height_m(Point2::from(at.position_m.coords + to_m), time_s));
        Posture {
            z_m: water_level_m + 0.25 * (bow_m + stern_m + port_m + starboard_m),
            pitch_rad: libm::atan2(stern_m - bow_m, self.length_m),
            roll_rad: libm::atan2(port_m - starboard_m, self.width_m),
        }
    }
}

#[cfg(test)]
mod tests;
