//! Log-odds in one byte (docs/methods.md, section 3).

use crate::octree::{OctreeConfig, RangeSensorModel};

/// Unknown voxel.
pub(super) const UNKNOWN: u8 = 0;
/// L = 0; greater values are occupied.
pub(super) const EVEN: u8 = 128;
/// Number of scales to try.
const CANDIDATES: u32 = 512;
/// Steps of a byte on either side of [`EVEN`].
const MAX_STEPS: f64 = 127.0;

/// Scale of log-odds as steps of a byte around [`EVEN`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LogOddsTable {
    per_unit: f64,
    pub(super) values: Values,
}

/// Range of values of voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Values {
    pub(super) least: u8,
    pub(super) greatest: u8,
}

/// Change by one scan of one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Update {
    /// Added on a hit.
    pub(super) hit: u8,
    /// Subtracted on a miss.
    pub(super) miss: u8,
}

impl LogOddsTable {
    /// As fine as a byte allows, with the sensors' log-odds as near to whole steps as possible:
    /// 1/30 to 1/50 for the sensors of \[HYB\].
    pub(super) fn new(config: &OctreeConfig, sensors: &[RangeSensorModel]) -> Self {
        let (least, greatest) = (log_odds(config.p_min), log_odds(config.p_max));
        let finest = MAX_STEPS / greatest.max(-least);
        let rounding = |per_unit: f64| -> f64 {
            let changes = sensors.iter().flat_map(|model| [model.p_hit, model.p_miss]);
            changes
                .map(|p| {
                    let steps = log_odds(p).abs() * per_unit;
                    let error = (libm::round(steps).max(1.0) - steps) / steps;
                    error * error
                })
                .sum()
        };
        let candidates =
            (0..CANDIDATES).map(|n| finest * (1.0 - 0.5 * f64::from(n) / f64::from(CANDIDATES)));
        let per_unit = candidates
            .min_by(|a, b| rounding(*a).total_cmp(&rounding(*b)))
            .unwrap_or(finest);
        let byte = |log_odds: f64| (f64::from(EVEN) + libm::round(log_odds * per_unit)) as u8;
        Self {
            per_unit,
            values: Values {
                least: byte(least).min(EVEN - 1),
                greatest: byte(greatest).max(EVEN + 1),
            },
        }
    }

    /// At least one step.
    pub(super) fn update(&self, sensor: &RangeSensorModel) -> Update {
        let steps = |p: f64| libm::round(log_odds(p).abs() * self.per_unit).clamp(1.0, 254.0) as u8;
        Update {
            hit: steps(sensor.p_hit),
            miss: steps(sensor.p_miss),
        }
    }

    pub(super) fn log_odds(&self, value: u8) -> f64 {
        (f64::from(value) - f64::from(EVEN)) / self.per_unit
    }
}

impl Values {
    /// L ← clamp(L + l) for a miss.
    #[inline]
    pub(super) fn freed(self, value: u8, update: Update) -> u8 {
        let known = if value == UNKNOWN { EVEN } else { value };
        known.saturating_sub(update.miss).max(self.least)
    }

    /// L ← clamp(L + l) for a hit.
    #[inline]
    pub(super) fn hit(self, value: u8, update: Update) -> u8 {
        let known = if value == UNKNOWN { EVEN } else { value };
        known.saturating_add(update.hit).min(self.greatest)
    }
}

/// L = ln(p / (1 − p)).
fn log_odds(p: f64) -> f64 {
    libm::log(p / (1.0 - p))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_presets_fit_a_byte_within_a_percent() {
        let model = |p_hit, p_miss| RangeSensorModel {
            p_hit,
            p_miss,
            ..RangeSensorModel::default()
        };
        let hybrid = OctreeConfig::default();
        let octomap = OctreeConfig {
            p_min: 0.1192,
            p_max: 0.971,
            ..hybrid.clone()
        };
        for (config, sensors) in [
            (&hybrid, vec![model(0.95, 0.49)]),
            (&hybrid, vec![model(0.55, 0.49), model(0.7, 0.45)]),
            (&octomap, vec![model(0.7, 0.4)]),
        ] {
            let steps = LogOddsTable::new(config, &sensors);
            for sensor in &sensors {
                let update = steps.update(sensor);
                for (p, found) in [(sensor.p_hit, update.hit), (sensor.p_miss, update.miss)] {
                    let wanted = log_odds(p).abs();
                    let error = f64::from(found) / steps.per_unit / wanted - 1.0;
                    assert!(error.abs() < 0.02, "{p}: {found} steps are off by {error}");
                }
            }
            for (p, found) in [
                (config.p_min, steps.values.least),
                (config.p_max, steps.values.greatest),
            ] {
                assert!((steps.log_odds(found) - log_odds(p)).abs() < 0.02, "{p}");
            }
        }
    }
}
