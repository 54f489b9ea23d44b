//! What a range says: hit, miss or nothing (`algorithms.md` §0).

use mapping::registered_scan::BeamOutcome;

/// The limits by which a range is judged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeLimits {
    /// Smallest range that is a measurement, metres.
    pub range_min_m: f32,
    /// Ranges at or above this are misses, metres.
    pub range_max_m: f32,
    /// What a range below `range_min_m` means, 0 included.
    pub zero_range: ZeroRange,
}

/// What a range below the sensor's smallest one means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ZeroRange {
    /// Nothing: dirt on the window, a fault, an object too near.
    #[default]
    Invalid,
    /// No return, for sensors that say it so.
    Miss,
}

impl RangeLimits {
    /// Judges one range, in this order: not-a-number, −∞ or negative is invalid (`None`); +∞ or
    /// ≥ `range_max_m` is a miss; < `range_min_m` is what `zero_range` says; the rest are hits.
    pub fn classify(&self, range_m: f32) -> Option<BeamOutcome> {
        if range_m.is_nan() || range_m < 0.0 {
            None
        } else if range_m >= self.range_max_m {
            Some(BeamOutcome::Miss)
        } else if range_m < self.range_min_m {
            match self.zero_range {
                ZeroRange::Invalid => None,
                ZeroRange::Miss => Some(BeamOutcome::Miss),
            }
        } else {
            Some(BeamOutcome::Hit)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_judged_in_order() {
        let rule = RangeLimits {
            range_min_m: 0.1,
            range_max_m: 20.0,
            zero_range: ZeroRange::Invalid,
        };
        for (range, expected) in [
            (f32::NAN, None),
            (f32::NEG_INFINITY, None),
            (-0.5, None),
            (f32::INFINITY, Some(BeamOutcome::Miss)),
            (20.0, Some(BeamOutcome::Miss)),
            (81.91, Some(BeamOutcome::Miss)),
            (0.0, None),
            (0.099, None),
            (0.1, Some(BeamOutcome::Hit)),
            (19.999, Some(BeamOutcome::Hit)),
        ] {
            assert_eq!(rule.classify(range), expected, "{range}");
        }
        let trusting = RangeLimits {
            zero_range: ZeroRange::Miss,
            ..rule
        };
        assert_eq!(trusting.classify(0.0), Some(BeamOutcome::Miss));
        assert_eq!(trusting.classify(-0.5), None);
    }
}
