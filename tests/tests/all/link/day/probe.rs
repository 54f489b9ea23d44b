//! Map values that the probe's card shows, and those of exported maps.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use protocol::layer::{LayerId, Quantisation};

use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

use crate::link::controls::Control;

/// The value that the card shows of one layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    pub(super) layer: LayerId,
    pub(super) value: String,
}

/// The position that the card shows: x and y in `odom`, metres.
pub(super) fn position_m(all: &[Control]) -> Option<[f64; 2]> {
    all.iter().find_map(|control| position(&control.words))
}

/// The values that the card shows.
pub(super) fn readings(all: &[Control]) -> Vec<Reading> {
    let Some(card) = all
        .iter()
        .find(|control| position(&control.words).is_some())
    else {
        return Vec::new();
    };
    let [left, _, _, below] = card.edges;
    let is_of_card = |control: &&Control| {
        control.role == "Label" && control.edges[0] == left && control.edges[1] >= below
    };
    let named = all.iter().filter(is_of_card).filter_map(|name| {
        let layer = LayerId::ALL
            .into_iter()
            .find(|layer| operator_console::panels::layers::layer_name(*layer) == name.words)?;
        let in_line = all.iter().filter(|control| {
            control.role == "Label"
                && control.edges[0] >= name.edges[2]
                && (control.edges[1] - name.edges[1]).abs() <= 3
        });
        let value = in_line.min_by_key(|control| control.edges[0])?;
        Some(Reading {
            layer,
            value: value.words.clone(),
        })
    });
    named.collect()
}

impl Reading {
    /// Whether an exported value is the value shown, to its last digit. Unknown is NaN, or class 0.
    pub(super) fn agrees_with(&self, exported: f32) -> bool {
        if self.value == "unknown" {
            let is_class = !self.layer.classes().is_empty();
            return exported.is_nan() || (is_class && exported.to_bits() == 0);
        }
        match self.layer.quantisation() {
            Quantisation::Classes(classes) => classes.iter().any(|class| {
                class.name == self.value && f32::from(class.value).to_bits() == exported.to_bits()
            }),
            Quantisation::Linear { .. } => {
                let words = self.value.split(' ').next().unwrap_or_default();
                let decimals = words.split_once('.').map_or(0, |(_, after)| after.len());
                let half = 0.5 * 0.1_f64.powi(i32::try_from(decimals).unwrap());
                let shown = number(words).unwrap();
                (shown - f64::from(exported)).abs() <= half * 1.001
            }
        }
    }
}

/// `x 1.20 m  y −3.40 m`
fn position(words: &str) -> Option<[f64; 2]> {
    let mut words = words.split_whitespace();
    words.next().filter(|name| *name == "x")?;
    let x = number(words.next()?)?;
    let y = number(words.nth(2)?)?;
    Some([x, y])
}

fn number(words: &str) -> Option<f64> {
    words.replace('−', "-").parse().ok()
}

/// An exported layer of any type of pixel.
pub(super) struct Raster {
    width: usize,
    height: usize,
    /// Side of a cell, metres.
    cell_m: f64,
    /// The upper left corner, metres in `odom`.
    corner_m: [f64; 2],
    values: Vec<f32>,
}

impl Raster {
    pub(super) fn read(path: &Path) -> Self {
        let file = BufReader::new(File::open(path).unwrap());
        let mut decoder = Decoder::new(file).unwrap();
        let (width, height) = decoder.dimensions().unwrap();
        let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap();
        let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        let image = decoder.read_image().unwrap();
        let values = if let DecodingResult::F32(values) = image {
            values
        } else if let DecodingResult::I8(values) = image {
            values.into_iter().map(f32::from).collect()
        } else if let DecodingResult::U8(values) = image {
            values.into_iter().map(f32::from).collect()
        } else {
            panic!("{}: unexpected pixel type", path.display())
        };
        Self {
            width: width as usize,
            height: height as usize,
            cell_m: scale[0],
            corner_m: [tie[3], tie[4]],
            values,
        }
    }

    /// The value at a point, metres in `odom`; NaN outside.
    pub(super) fn at(&self, [x_m, y_m]: [f64; 2]) -> f32 {
        let column = ((x_m - self.corner_m[0]) / self.cell_m).floor();
        let row = ((self.corner_m[1] - y_m) / self.cell_m).floor();
        let is_within =
            (0.0..self.width as f64).contains(&column) && (0.0..self.height as f64).contains(&row);
        if is_within {
            self.values[row as usize * self.width + column as usize]
        } else {
            f32::NAN
        }
    }
}
