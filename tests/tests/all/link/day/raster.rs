//! Exported maps, read as any other program would.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// An exported layer.
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
            panic!("{}: other pixels than are exported", path.display())
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
