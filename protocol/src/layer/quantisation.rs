//! Values ⇄ cell codes, with their error bound.

use super::Class;

/// The code of a cell nothing is known about, in every layer.
pub const UNKNOWN: u16 = 0;

/// How a layer's values become `u16` codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantisation {
    /// `code = zero_code + round(value · steps_per_unit)`, saturating at `1` and `max_code`.
    Linear {
        /// Steps in one unit; the step is its reciprocal. Whole, so that both directions are exact.
        steps_per_unit: u16,
        /// The code of value 0.
        zero_code: u16,
        /// The largest code the layer uses.
        max_code: u16,
    },
    /// Code `i + 1` is class `i`; a value that is no class is unknown.
    Classes(&'static [Class]),
}

impl Quantisation {
    /// 0 … 1 in steps of 1/250: codes 1 … 251.
    pub const UNIT_INTERVAL: Self = Self::Linear {
        steps_per_unit: 250,
        zero_code: 1,
        max_code: 251,
    };

    /// Metres in steps of 5 mm around code 32768: −163.835 m … 163.835 m, saturating beyond.
    pub const HEIGHT: Self = Self::Linear {
        steps_per_unit: 200,
        zero_code: 32768,
        max_code: u16::MAX,
    };

    /// The code of `value`; NaN is [`UNKNOWN`].
    ///
    /// A continuous value outside the layer's range (infinities included) saturates at its ends: a wall
    /// too high to be told is still a wall. A class layer takes a class's exported value.
    pub fn encode(&self, value: f32) -> u16 {
        if value.is_nan() {
            return UNKNOWN;
        }
        match *self {
            Self::Linear {
                steps_per_unit,
                zero_code,
                max_code,
            } => {
                let steps = (f64::from(value) * f64::from(steps_per_unit)).round();
                (f64::from(zero_code) + steps).clamp(1.0, f64::from(max_code)) as u16
            }
            Self::Classes(classes) => classes
                .iter()
                .zip(1..)
                .find_map(|(class, code)| {
                    (f32::from(class.value).to_bits() == value.to_bits()).then_some(code)
                })
                .unwrap_or(UNKNOWN),
        }
    }

    /// The value of `code`, rounded once to the nearest `f32`; `None` for [`UNKNOWN`] and for a code that
    /// the layer does not use.
    pub fn decode(&self, code: u16) -> Option<f32> {
        if code == UNKNOWN || !self.is_code(code) {
            return None;
        }
        match *self {
            Self::Linear {
                steps_per_unit,
                zero_code,
                ..
            } => {
                let steps = i32::from(code) - i32::from(zero_code);
                Some((f64::from(steps) / f64::from(steps_per_unit)) as f32)
            }
            Self::Classes(classes) => classes
                .get(usize::from(code) - 1)
                .map(|class| f32::from(class.value)),
        }
    }

    /// Whether a cell of the layer may hold `code`; [`UNKNOWN`] it always may.
    pub fn is_code(&self, code: u16) -> bool {
        match *self {
            Self::Linear { max_code, .. } => code <= max_code,
            Self::Classes(classes) => usize::from(code) <= classes.len(),
        }
    }

    /// The distance of neighbouring values in the layer's unit; 0 where codes are exact.
    ///
    /// Within range `|decode(encode(v)) − v| ≤ step/2`, plus the rounding of the result to `f32`.
    pub fn step(&self) -> f64 {
        match *self {
            Self::Linear { steps_per_unit, .. } => 1.0 / f64::from(steps_per_unit),
            Self::Classes(_) => 0.0,
        }
    }

    /// The smallest and the largest value that do not saturate.
    pub fn range(&self) -> (f32, f32) {
        match *self {
            Self::Linear { max_code, .. } => (
                self.decode(1).unwrap_or(f32::NAN),
                self.decode(max_code).unwrap_or(f32::NAN),
            ),
            Self::Classes(classes) => classes
                .iter()
                .map(|class| f32::from(class.value))
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), value| {
                    (low.min(value), high.max(value))
                }),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::layer::{LayerId, LayerKind};

    #[test]
    fn codes_are_the_documented_ones() {
        let check = |layer: LayerId, value: f32, code: u16| {
            assert_eq!(layer.quantisation().encode(value), code, "{layer} {value}");
            assert_eq!(
                layer.quantisation().decode(code),
                Some(value),
                "{layer} {code}"
            );
        };
        check(LayerId::Occupancy, 0.0, 1);
        check(LayerId::Occupancy, 0.02, 6);
        check(LayerId::Occupancy, 0.98, 246);
        check(LayerId::Occupancy, 1.0, 251);
        check(LayerId::Cost, 0.5, 126);
        check(LayerId::Elevation, 0.0, 32768);
        check(LayerId::Elevation, -0.005, 32767);
        check(LayerId::Elevation, 1.0, 32968);
        check(LayerId::Elevation, -163.835, 1);
        check(LayerId::Elevation, 163.835, 65535);
        check(LayerId::Obstacle, -1.0, 1);
        check(LayerId::Obstacle, 1.0, 2);
        check(LayerId::Rigidity, 1.0, 1);
        check(LayerId::Rigidity, 2.0, 2);
        check(LayerId::Shore, 4.0, 4);
    }

    #[test]
    fn out_of_range_saturates_and_no_class_is_unknown() {
        let height = Quantisation::HEIGHT;
        assert_eq!(height.encode(1e9), 65535);
        assert_eq!(height.encode(f32::NEG_INFINITY), 1);
        assert_eq!(Quantisation::UNIT_INTERVAL.encode(-0.3), 1);
        assert_eq!(Quantisation::UNIT_INTERVAL.encode(1.7), 251);
        for layer in LayerId::ALL {
            assert_eq!(layer.quantisation().encode(f32::NAN), UNKNOWN, "{layer}");
            assert_eq!(layer.quantisation().decode(UNKNOWN), None, "{layer}");
        }
        assert_eq!(LayerId::Obstacle.quantisation().encode(0.0), UNKNOWN);
        assert_eq!(LayerId::Shore.quantisation().encode(2.5), UNKNOWN);
        assert_eq!(LayerId::Shore.quantisation().decode(5), None);
        assert_eq!(LayerId::Occupancy.quantisation().decode(252), None);
    }

    #[test]
    fn every_code_survives_its_value() {
        for layer in LayerId::ALL {
            let quantisation = layer.quantisation();
            for code in 1..=u16::MAX {
                if let Some(value) = quantisation.decode(code) {
                    assert_eq!(quantisation.encode(value), code, "{layer} {value}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn error_is_at_most_half_a_step(part in 0.0_f64..=1.0) {
            for layer in LayerId::ALL {
                let quantisation = layer.quantisation();
                if layer.kind() == LayerKind::Classes {
                    continue;
                }
                let (low, high) = quantisation.range();
                let value = (f64::from(low) + part * f64::from(high - low)) as f32;
                let decoded = quantisation.decode(quantisation.encode(value)).unwrap();
                let rounding = f64::from(f32::EPSILON) * f64::from(value.abs());
                prop_assert!(
                    (f64::from(decoded) - f64::from(value)).abs() <= quantisation.step() / 2.0 + rounding,
                    "{layer}: {value} became {decoded}"
                );
            }
        }
    }
}
