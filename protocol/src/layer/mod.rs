//! The map layers: what a cell means, its unit, its code on the wire, its colours and its legend.
//!
//! On the wire, in the [tile store](crate::tile_store) and in every export a cell is one `u16` *code*.
//! Code 0 is unknown in every layer; [`Quantisation`] maps the rest to values. A new layer is a new
//! [`LayerId`] variant: the exhaustive matches below are the list of what it must answer.

mod legend;
mod palette;
mod palette_tables;
mod pattern;
mod quantisation;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

pub use legend::{Legend, Ramp, Swatch, Tick};
pub use palette::{Palette, Scheme};
pub use pattern::Pattern;
pub use quantisation::{Quantisation, UNKNOWN};

/// A map layer. Closed and append-only: the position of a variant is its number on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LayerId {
    /// Probability that a cell is occupied, from a horizontal laser.
    Occupancy,
    /// Mean height above the ground plane.
    Elevation,
    /// Free or obstacle, from the elevation.
    Obstacle,
    /// Slope cost: 0 flat or clear … 1 lethal.
    Cost,
    /// Whether a vehicle could push through what stands there.
    Rigidity,
    /// What kind of shore it is, and where one can dock.
    Shore,
}

/// Whether neighbouring codes are neighbouring values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerKind {
    /// Codes are equidistant steps of a physical quantity.
    Continuous,
    /// Codes name classes.
    Classes,
}

/// The type of a cell's value in an exported raster, and what stands for unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// 32-bit float, unknown is NaN.
    F32,
    /// Signed byte, unknown is 0.
    I8,
    /// Unsigned byte, unknown is 0.
    U8,
}

/// One class of a class layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Class {
    /// Name as legends and summaries print it.
    pub name: &'static str,
    /// Value in exported rasters; its code is its position in [`LayerId::classes`] plus one.
    pub value: i8,
}

const OBSTACLE: [Class; 2] = [class("free", -1), class("obstacle", 1)];
const RIGIDITY: [Class; 2] = [class("traversable", 1), class("rigid", 2)];
const SHORE: [Class; 4] = [
    class("sparse", 1),
    class("dense", 2),
    class("solid", 3),
    class("docking site", 4),
];

const fn class(name: &'static str, value: i8) -> Class {
    Class { name, value }
}

impl LayerId {
    /// Every layer, in wire order.
    pub const ALL: [Self; 6] = [
        Self::Occupancy,
        Self::Elevation,
        Self::Obstacle,
        Self::Cost,
        Self::Rigidity,
        Self::Shore,
    ];

    /// The name in file names, keys, summaries and configuration.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Occupancy => "occupancy",
            Self::Elevation => "elevation",
            Self::Obstacle => "obstacle",
            Self::Cost => "cost",
            Self::Rigidity => "rigidity",
            Self::Shore => "shore",
        }
    }

    /// What a cell's value says, in a few words that fit above a legend.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Occupancy => "probability of being occupied",
            Self::Elevation => "height above ground plane",
            Self::Obstacle => "obstacle",
            Self::Cost => "slope cost: 0 flat or clear, 1 lethal",
            Self::Rigidity => "rigidity",
            Self::Shore => "shore",
        }
    }

    /// The unit of a value; `None` where it is a pure number or a class.
    pub const fn unit(self) -> Option<&'static str> {
        match self {
            Self::Elevation => Some("m"),
            Self::Occupancy | Self::Obstacle | Self::Cost | Self::Rigidity | Self::Shore => None,
        }
    }

    /// Whether a cell holds a quantity or a class.
    pub const fn kind(self) -> LayerKind {
        match self.quantisation() {
            Quantisation::Linear { .. } => LayerKind::Continuous,
            Quantisation::Classes(_) => LayerKind::Classes,
        }
    }

    /// How values become codes and back.
    pub const fn quantisation(self) -> Quantisation {
        match self {
            Self::Occupancy | Self::Cost => Quantisation::UNIT_INTERVAL,
            Self::Elevation => Quantisation::HEIGHT,
            Self::Obstacle => Quantisation::Classes(&OBSTACLE),
            Self::Rigidity => Quantisation::Classes(&RIGIDITY),
            Self::Shore => Quantisation::Classes(&SHORE),
        }
    }

    /// The classes in code order, code 1 first; empty for a continuous layer.
    pub const fn classes(self) -> &'static [Class] {
        match self.quantisation() {
            Quantisation::Linear { .. } => &[],
            Quantisation::Classes(classes) => classes,
        }
    }

    /// The sample type of `<layer>.tif`.
    pub const fn sample_type(self) -> SampleType {
        match self {
            Self::Occupancy | Self::Elevation | Self::Cost => SampleType::F32,
            Self::Obstacle => SampleType::I8,
            Self::Rigidity | Self::Shore => SampleType::U8,
        }
    }
}

impl fmt::Display for LayerId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is no layer's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown layer {0:?}: layers are occupancy, elevation, obstacle, cost, rigidity and shore")]
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

#[cfg(test)]
mod tests {
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
    fn wire_numbers_never_move() {
        let numbers = LayerId::ALL.map(|layer| layer as u8);
        assert_eq!(numbers, [0, 1, 2, 3, 4, 5]);
        assert_eq!(LayerId::Shore.name(), "shore");
        assert_eq!(LayerId::Cost as u8, 3);
    }

    #[test]
    fn a_class_layer_exports_bytes_and_a_continuous_one_floats() {
        for layer in LayerId::ALL {
            let continuous = layer.kind() == LayerKind::Continuous;
            assert_eq!(
                continuous,
                layer.sample_type() == SampleType::F32,
                "{layer}"
            );
            assert_eq!(continuous, layer.classes().is_empty(), "{layer}");
        }
    }
}
