//! What to print beside a coloured map: numbers or class names, never colours alone.

use super::Pattern;
use super::palette::{GROUND_M, Palette, Scheme, round_step};

/// The legend of a [`Palette`].
#[derive(Clone, Debug, PartialEq)]
pub struct Legend {
    /// What is shown, with its unit.
    pub title: String,
    /// The continuous part, if any.
    pub ramp: Option<Ramp>,
    /// Colours with a meaning of their own, classes and "unknown" among them.
    pub swatches: Vec<Swatch>,
}

/// A colour scale from `low` to `high`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    /// The value at the low end.
    pub low: f32,
    /// The value at the high end.
    pub high: f32,
    /// Labelled values, from low to high, both ends among them.
    pub ticks: Vec<Tick>,
    palette: Palette,
}

/// A labelled value of a [`Ramp`].
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// The value, in the layer's unit.
    pub value: f32,
    /// The number as printed.
    pub label: String,
}

/// A colour, the marks on it, and its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swatch {
    /// sRGB with straight alpha.
    pub color: [u8; 4],
    /// What tells it apart without its colour.
    pub pattern: Pattern,
    /// The colour of the pattern's marks.
    pub mark: [u8; 4],
    /// Its meaning.
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

    /// The colour of a pixel: `x` counts to the right, `y` down.
    pub const fn color_at(&self, x: usize, y: usize) -> [u8; 4] {
        if self.pattern.is_mark(x, y) {
            self.mark
        } else {
            self.color
        }
    }
}

impl Legend {
    pub(super) fn of(palette: &Palette) -> Self {
        let layer = palette.layer();
        let title = match layer.unit() {
            Some(unit) => format!("{} ({unit})", layer.meaning()),
            None => layer.meaning().to_owned(),
        };
        let ramp = layer.classes().is_empty().then(|| Ramp::of(palette));
        let ground = if palette.scheme() == Scheme::GroundPlane {
            let swatch = |value: f32, label: String| {
                let [red, green, blue] = palette.ramp_color(value);
                Swatch::plain([red, green, blue, 255], label)
            };
            vec![
                swatch(0.0, format!("ground, ± {GROUND_M}")),
                swatch(-1.0, format!("below −{GROUND_M}")),
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
    /// The colour of `value`.
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
        // A bounded quantity ends where its range ends; a height goes on beyond both ends of the scale.
        let (at_least, at_most) = match palette.scheme() {
            Scheme::Cividis => ("≥ ", "≤ "),
            Scheme::GroundPlane => ("≥ ", ""),
            Scheme::Grey
            | Scheme::MapServer
            | Scheme::Magma
            | Scheme::OkabeIto
            | Scheme::GreenRed => ("", ""),
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
        let bottom = match palette.scheme() {
            Scheme::GroundPlane => Tick {
                value: low,
                label: number(low, 2),
            },
            Scheme::Cividis
            | Scheme::Grey
            | Scheme::MapServer
            | Scheme::Magma
            | Scheme::OkabeIto
            | Scheme::GreenRed => tick(low, at_most),
        };
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

/// A number with a true minus sign, and no sign at zero.
fn number(value: f32, decimals: usize) -> String {
    let digits = format!("{:.decimals$}", value.abs());
    let zero = digits.bytes().all(|byte| matches!(byte, b'0' | b'.'));
    if value < 0.0 && !zero {
        format!("−{digits}")
    } else {
        digits
    }
}

#[cfg(test)]
mod tests {
    use crate::layer::{LayerId, LayerKind};

    use super::*;

    fn labels(ramp: &Ramp) -> Vec<&str> {
        ramp.ticks.iter().map(|tick| tick.label.as_str()).collect()
    }

    #[test]
    fn every_legend_has_numbers_or_class_names() {
        for layer in LayerId::ALL {
            for palette in layer.palettes() {
                let legend = palette.legend();
                match layer.kind() {
                    LayerKind::Continuous => {
                        let ramp = legend.ramp.unwrap();
                        assert!(ramp.ticks.len() >= 3, "{palette:?}");
                        assert!(
                            ramp.ticks.is_sorted_by(|a, b| a.value < b.value),
                            "{palette:?}"
                        );
                        assert_eq!(ramp.ticks[0].value.to_bits(), ramp.low.to_bits());
                    }
                    LayerKind::Classes => {
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
}
