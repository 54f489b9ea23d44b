//! Map layers: meaning, unit, wire code, colours and legend.
//!
//! On the wire, in the [tile store](crate::tile_store) and in every export a cell is one `u16`
//! *code*. Code 0 is unknown in every layer; [`Quantisation`] maps the rest to values. A new layer
//! is a new [`LayerId`] variant; the compiler then lists the matches to extend.

mod palette;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::layer::palette::{Rgb, okabe_ito, round_step};
pub use palette::{Palette, Pattern, Scheme};

/// A map layer. Closed and append-only: the position of a variant is its number on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LayerId {
    /// Probability that a cell is occupied, from a horizontal laser.
    Occupancy,
    /// Mean height above the ground plane.
    Elevation,
    /// Free or obstacle, from the elevation map.
    Obstacle,
    /// Slope cost: 0 flat or clear … 1 lethal.
    Cost,
    /// Traversable vegetation or rigid obstacle.
    Rigidity,
    /// Class of the shore, and docking sites.
    Shore,
    /// `IntraScan`: 0 thin … 1 wide.
    Intra,
    /// `InterScan`: 0 still … 1 changing.
    Inter,
    /// Least depth of the water.
    Depth,
}

/// One class of a class layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Class {
    /// Name in legends and summaries.
    pub name: &'static str,
    /// Value in exported rasters; its code is its index in [`LayerId::classes`] plus one.
    pub value: i8,
    color: Rgb,
    pattern: Pattern,
}

/// Without patterns: obstacles are as thin as walls.
const OBSTACLE: [Class; 2] = [
    class("free", -1, okabe_ito::BLUE, Pattern::Plain),
    class("obstacle", 1, okabe_ito::VERMILLION, Pattern::Plain),
];
const RIGIDITY: [Class; 2] = [
    class("traversable", 1, okabe_ito::BLUISH_GREEN, Pattern::Dots),
    class("rigid", 2, okabe_ito::VERMILLION, Pattern::Lattice),
];
const SHORE: [Class; 4] = [
    class("sparse", 1, okabe_ito::DARK_YELLOW, Pattern::Dots),
    class("dense", 2, okabe_ito::BLUISH_GREEN, Pattern::Hatching),
    class("solid", 3, okabe_ito::BLUE, Pattern::Lattice),
    class(
        "docking site",
        4,
        okabe_ito::REDDISH_PURPLE,
        Pattern::Chevrons,
    ),
];

const fn class(name: &'static str, value: i8, color: Rgb, pattern: Pattern) -> Class {
    Class {
        name,
        value,
        color,
        pattern,
    }
}

impl LayerId {
    /// Every layer, in wire order.
    pub const ALL: [Self; 9] = [
        Self::Occupancy,
        Self::Elevation,
        Self::Obstacle,
        Self::Cost,
        Self::Rigidity,
        Self::Shore,
        Self::Intra,
        Self::Inter,
        Self::Depth,
    ];

    /// Name in file names, keys, summaries and configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Occupancy => "occupancy",
            Self::Elevation => "elevation",
            Self::Obstacle => "obstacle",
            Self::Cost => "cost",
            Self::Rigidity => "rigidity",
            Self::Shore => "shore",
            Self::Intra => "intra",
            Self::Inter => "inter",
            Self::Depth => "depth",
        }
    }

    /// Short meaning of a value, for legends.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Occupancy => "probability of being occupied",
            Self::Elevation => "height above ground plane",
            Self::Obstacle => "obstacle",
            Self::Cost => "slope cost: 0 flat or clear, 1 lethal",
            Self::Rigidity => "rigidity",
            Self::Shore => "shore",
            Self::Intra => "IntraScan: 0 thin, 1 wide",
            Self::Inter => "InterScan: 0 still, 1 changing",
            Self::Depth => "depth of the water",
        }
    }

    /// Unit of a value; `None` for a pure number or a class.
    pub const fn unit(self) -> Option<&'static str> {
        match self {
            Self::Elevation | Self::Depth => Some("m"),
            Self::Occupancy
            | Self::Obstacle
            | Self::Cost
            | Self::Rigidity
            | Self::Shore
            | Self::Intra
            | Self::Inter => None,
        }
    }

    /// Conversion between values and codes.
    pub const fn quantisation(self) -> Quantisation {
        match self {
            Self::Occupancy | Self::Cost | Self::Intra | Self::Inter => Quantisation::UNIT_INTERVAL,
            Self::Elevation => Quantisation::HEIGHT,
            Self::Depth => Quantisation::DEPTH,
            Self::Obstacle => Quantisation::Classes(&OBSTACLE),
            Self::Rigidity => Quantisation::Classes(&RIGIDITY),
            Self::Shore => Quantisation::Classes(&SHORE),
        }
    }

    /// Whether low values are the dangerous ones.
    pub(crate) const fn least_decides(self) -> bool {
        matches!(self, Self::Inter | Self::Depth)
    }

    /// Of two cells the code that stands for both, where cells are drawn as one: that of the more
    /// dangerous value, so that a wall stays visible. Any known code wins over [`UNKNOWN`].
    pub fn deciding(self, a: u16, b: u16) -> u16 {
        if self.least_decides() {
            // Unknown is the greatest.
            a.wrapping_sub(1).min(b.wrapping_sub(1)).wrapping_add(1)
        } else {
            a.max(b)
        }
    }

    /// Classes in code order, code 1 first; empty for a continuous layer.
    pub const fn classes(self) -> &'static [Class] {
        match self.quantisation() {
            Quantisation::Linear { .. } => &[],
            Quantisation::Classes(classes) => classes,
        }
    }
}

impl fmt::Display for LayerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// An unknown layer name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown layer {0:?}: layers are occupancy, elevation, obstacle, cost, rigidity, shore, intra, inter and depth"
)]
pub struct UnknownLayer(pub String);

impl FromStr for LayerId {
    type Err = UnknownLayer;

    fn from_str(name: &str) -> Result<Self, UnknownLayer> {
        Self::ALL
            .into_iter()
            .find(|layer| layer.name() == name)
            .ok_or_else(|| UnknownLayer(name.to_owned()))
    }
}

/// Legend of a [`Palette`].
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// Quantity with its unit.
    pub title: String,
    /// The continuous part, if any.
    pub ramp: Option<Ramp>,
    /// Colours with a meaning of their own, including classes and "unknown".
    pub swatches: Vec<Swatch>,
}

/// A colour scale from `low` to `high`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    /// Value at the low end.
    pub low: f32,
    /// Value at the high end.
    pub high: f32,
    /// Labelled values, ascending, including both ends.
    pub ticks: Vec<Tick>,
    palette: Palette,
}

/// A labelled value of a [`Ramp`].
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// In the layer's unit.
    pub value: f32,
    /// Printed number.
    pub label: String,
}

/// A colour, its pattern and its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swatch {
    /// sRGB with straight alpha.
    pub color: [u8; 4],
    /// Distinguishes it without its colour.
    pub pattern: Pattern,
    /// Colour of the pattern.
    pub mark: [u8; 4],
    /// Printed name.
    pub label: String,
}

impl Swatch {
    /// Without a pattern.
    pub const fn plain(color: [u8; 4], label: String) -> Self {
        Self {
            color,
            pattern: Pattern::Plain,
            mark: color,
            label,
        }
    }

    /// Colour of a pixel: `x` to the right, `y` down.
    pub const fn color_at(&self, x: usize, y: usize) -> [u8; 4] {
        if self.pattern.is_mark(x, y) {
            self.mark
        } else {
            self.color
        }
    }
}

impl Legend {
    fn of(palette: &Palette) -> Self {
        let layer = palette.layer();
        let title = match layer.unit() {
            Some(unit) => format!("{} ({unit})", layer.meaning()),
            None => layer.meaning().to_owned(),
        };
        let ramp = layer.classes().is_empty().then(|| Ramp::of(palette));
        let ground = if let Some(ground_m) = palette.scheme().ground_m() {
            let swatch = |value: f32, label: String| {
                let [red, green, blue] = palette.ramp_color(value);
                Swatch::plain([red, green, blue, 255], label)
            };
            vec![
                swatch(0.0, format!("ground, ± {ground_m}")),
                swatch(-1.0, format!("below −{ground_m}")),
            ]
        } else {
            Vec::new()
        };
        let classes = layer.classes().iter().zip(1..).map(|(class, code)| Swatch {
            color: palette.color(code),
            pattern: palette.pattern(code),
            mark: palette.mark_color(code),
            label: class.name.to_owned(),
        });
        let unknown = Swatch::plain(palette.unknown_color(), "unknown".to_owned());
        Self {
            title,
            ramp,
            swatches: ground.into_iter().chain(classes).chain([unknown]).collect(),
        }
    }
}

impl Ramp {
    /// Colour of `value`.
    pub fn color(&self, value: f32) -> [u8; 4] {
        let [red, green, blue] = self.palette.ramp_color(value);
        [red, green, blue, 255]
    }

    fn of(palette: &Palette) -> Self {
        let (low, high) = palette.range();
        let end_step = round_step(high - low);
        let decimals = if end_step < 0.1 {
            2
        } else {
            usize::from(end_step < 1.0)
        };
        let step = 2.0 * end_step;
        // A bounded quantity ends with its range; heights may exceed the scale.
        let (at_least, at_most) = match palette.scheme() {
            Scheme::Cividis => ("≥ ", "≤ "),
            Scheme::Deep => ("≥ ", ""),
            scheme if scheme.ground_m().is_some() => ("≥ ", ""),
            _ => ("", ""),
        };
        let tick = |value: f32, prefix: &str| Tick {
            value,
            label: format!("{prefix}{}", number(value, decimals)),
        };
        let first = (low / step).floor() as i32 + 1;
        let inner = (first..)
            .map(|i| i as f32 * step)
            .skip_while(|value| value - low < 0.4 * step)
            .take_while(|value| high - value > 0.4 * step)
            .map(|value| tick(value, ""));
        let mut bottom = tick(low, at_most);
        if palette.scheme().ground_m().is_some() {
            bottom.label = number(low, 2);
        }
        let ticks = [bottom]
            .into_iter()
            .chain(inner)
            .chain([tick(high, at_least)])
            .collect();
        Self {
            low,
            high,
            ticks,
            palette: *palette,
        }
    }
}

/// A number with a typographic minus sign, and no sign at zero.
fn number(value: f32, decimals: usize) -> String {
    let digits = format!("{:.decimals$}", value.abs());
    let zero = digits.bytes().all(|byte| matches!(byte, b'0' | b'.'));
    if value < 0.0 && !zero {
        format!("−{digits}")
    } else {
        digits
    }
}

/// Code of an unknown cell, in every layer.
pub const UNKNOWN: u16 = 0;

/// Conversion between a layer's values and `u16` codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quantisation {
    /// `code = zero_code + round(value · steps_per_unit)`, saturating at `1` and `max_code`.
    Linear {
        /// Steps per unit, an integer so that both directions are exact.
        steps_per_unit: u16,
        /// Code of value 0.
        zero_code: u16,
        /// Greatest code of the layer.
        max_code: u16,
    },
    /// Code `i + 1` is class `i`; any other value is unknown.
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

    /// Metres in steps of 1 cm: 0 … 655.34 m, saturating beyond.
    pub const DEPTH: Self = Self::Linear {
        steps_per_unit: 100,
        zero_code: 1,
        max_code: u16::MAX,
    };

    /// Code of `value`; NaN is [`UNKNOWN`].
    ///
    /// A continuous value outside the layer's range (infinities included) saturates: a wall of any
    /// height remains a wall. A class layer takes the class's exported value.
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

    /// Value of `code`, rounded once to the nearest `f32`; `None` for [`UNKNOWN`] and for an unused
    /// code.
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

    /// Whether the layer uses `code`, including [`UNKNOWN`].
    pub fn is_code(&self, code: u16) -> bool {
        match *self {
            Self::Linear { max_code, .. } => code <= max_code,
            Self::Classes(classes) => usize::from(code) <= classes.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde::de::IntoDeserializer;
    use serde::de::value::StrDeserializer;

    use super::*;

    #[test]
    fn names_parse_back_and_an_unknown_one_lists_them_all() {
        for layer in LayerId::ALL {
            assert_eq!(layer.name().parse(), Ok(layer));
            assert_eq!(layer.to_string(), layer.name());
            let name: StrDeserializer<'_, serde::de::value::Error> =
                layer.name().into_deserializer();
            assert_eq!(LayerId::deserialize(name), Ok(layer));
        }
        let message = "ocupancy".parse::<LayerId>().unwrap_err().to_string();
        for layer in LayerId::ALL {
            assert!(message.contains(layer.name()), "{message}");
        }
    }

    #[test]
    fn the_more_dangerous_of_two_cells_decides() {
        for (a, b, greatest, least) in [(1, 251, 251, 1), (0, 7, 7, 7), (0, 0, 0, 0), (4, 3, 4, 3)]
        {
            for (a, b) in [(a, b), (b, a)] {
                assert_eq!(LayerId::Intra.deciding(a, b), greatest);
                assert_eq!(LayerId::Inter.deciding(a, b), least);
                assert_eq!(LayerId::Depth.deciding(a, b), least);
            }
        }
    }

    fn labels(ramp: &Ramp) -> Vec<&str> {
        ramp.ticks.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn every_legend_has_numbers_or_class_names() {
        for layer in LayerId::ALL {
            for palette in layer.palettes() {
                let legend = palette.legend();
                match layer.quantisation() {
                    Quantisation::Linear { .. } => {
                        let ramp = legend.ramp.unwrap();
                        assert!(ramp.ticks.len() >= 3, "{palette:?}");
                        assert!(
                            ramp.ticks.is_sorted_by(|a, b| a.value < b.value),
                            "{palette:?}"
                        );
                        assert_eq!(ramp.ticks[0].value.to_bits(), ramp.low.to_bits());
                    }
                    Quantisation::Classes(_) => {
                        assert_eq!(legend.swatches.len(), layer.classes().len() + 1);
                        assert_eq!(legend.swatches[0].label, layer.classes()[0].name);
                    }
                }
                assert_eq!(legend.swatches.last().unwrap().label, "unknown");
            }
        }
    }

    #[test]
    fn labels_are_round_and_signed_properly() {
        let occupancy = LayerId::Occupancy.default_palette().legend();
        assert_eq!(occupancy.title, "probability of being occupied");
        let ramp = occupancy.ramp.unwrap();
        assert_eq!(labels(&ramp), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);

        let elevation = LayerId::Elevation.default_palette().fitted(-0.43, 2.71);
        let legend = elevation.legend();
        assert_eq!(legend.title, "height above ground plane (m)");
        assert_eq!(
            labels(&legend.ramp.unwrap()),
            ["≤ −0.5", "0.0", "1.0", "2.0", "≥ 3.0"]
        );
    }

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
                let Quantisation::Linear { steps_per_unit, max_code, .. } = quantisation else {
                    continue;
                };
                let [low, high] = [1, max_code].map(|code| quantisation.decode(code).unwrap());
                let value = (f64::from(low) + part * f64::from(high - low)) as f32;
                let half_step = 0.5 / f64::from(steps_per_unit);
                let decoded = quantisation.decode(quantisation.encode(value)).unwrap();
                let rounding = f64::from(f32::EPSILON) * f64::from(value.abs());
                prop_assert!(
                    (f64::from(decoded) - f64::from(value)).abs() <= half_step + rounding,
                    "{layer}: {value} became {decoded}"
                );
            }
        }
    }
}
