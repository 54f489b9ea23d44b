//! Reads exported maps back with other people's code and compares them.

use std::fs::{self, File};
use std::path::Path;

use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;

/// Probabilities of being occupied, row 0 the greatest y; NaN where unknown.
pub(crate) struct OccupancyTiff {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) cell_m: f64,
    /// Column and row of the upper left corner, in cells from the origin of `odom`.
    pub(crate) corner: [i64; 2],
    pub(crate) values: Vec<f32>,
}

impl OccupancyTiff {
    pub(crate) fn read(folder: &Path) -> Self {
        let mut tiff = Decoder::new(File::open(folder.join("occupancy.tif")).unwrap()).unwrap();
        let (width, height) = tiff.dimensions().unwrap();
        let scale = tiff.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap();
        let tie = tiff.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        let cell_m = scale[0];
        assert_eq!(scale, [cell_m, cell_m, 0.0]);
        assert_eq!((&tie[..3], tie[5]), (&[0.0; 3][..], 0.0));
        let DecodingResult::F32(values) = tiff.read_image().unwrap() else {
            panic!("samples are not f32");
        };
        let whole = |metres: f64| {
            let cells = metres / cell_m;
            assert!(
                (cells - cells.round()).abs() < 1e-6,
                "{metres} m is no edge between cells"
            );
            cells.round() as i64
        };
        Self {
            width: width as usize,
            height: height as usize,
            cell_m,
            corner: [whole(tie[3]), whole(tie[4])],
            values,
        }
    }

    /// The probability in the cell `x` columns east and `y` rows north of `odom`'s origin.
    fn at(&self, x: i64, y: i64) -> Option<f32> {
        let column = usize::try_from(x - self.corner[0])
            .ok()
            .filter(|&c| c < self.width)?;
        let row = usize::try_from(self.corner[1] - 1 - y)
            .ok()
            .filter(|&r| r < self.height)?;
        Some(self.values[row * self.width + column]).filter(|p| !p.is_nan())
    }

    fn known(&self) -> impl Iterator<Item = [i64; 2]> {
        let cells = self.values.iter().enumerate().filter(|(_, p)| !p.is_nan());
        cells.map(|(index, _)| {
            let (row, column) = (index / self.width, index % self.width);
            [
                self.corner[0] + column.cast_signed() as i64,
                self.corner[1] - 1 - row.cast_signed() as i64,
            ]
        })
    }

    /// Compares all cells that either map knows.
    pub(crate) fn compare(&self, other: &Self) -> Comparison {
        assert_eq!(self.cell_m.to_bits(), other.cell_m.to_bits());
        let mut comparison = Comparison::default();
        for [x, y] in self.known() {
            comparison.add(self.at(x, y), other.at(x, y));
        }
        for [x, y] in other.known().filter(|&[x, y]| self.at(x, y).is_none()) {
            comparison.add(None, other.at(x, y));
        }
        comparison
    }
}

/// What two maps make of the cells that either knows.
#[derive(Debug, Default)]
pub(crate) struct Comparison {
    /// Known to either.
    pub(crate) cells: u64,
    /// Of the same class, and at most 0.05 apart.
    pub(crate) agree: u64,
    /// Known to one alone.
    pub(crate) one_sided: u64,
    /// Known to both, of the same class, and farther apart.
    pub(crate) far: u64,
    /// Known to both, of different classes.
    pub(crate) other_class: u64,
    /// Exactly the same.
    pub(crate) equal: u64,
}

impl Comparison {
    fn add(&mut self, one: Option<f32>, two: Option<f32>) {
        self.cells += 1;
        match (one, two) {
            (Some(one), Some(two)) if grey(one) != grey(two) => self.other_class += 1,
            (Some(one), Some(two)) if (one - two).abs() > 0.05 => self.far += 1,
            (Some(one), Some(two)) => {
                self.agree += 1;
                self.equal += u64::from(one.to_bits() == two.to_bits());
            }
            _ => self.one_sided += 1,
        }
    }

    /// The share of cells that agree.
    pub(crate) fn share(&self) -> f64 {
        self.agree as f64 / self.cells as f64
    }
}

/// The grey of a probability in a PGM for Nav2's `map_server`, by that tool's own rule.
pub(crate) fn grey(probability: f32) -> u8 {
    if probability >= 0.65 {
        0
    } else if probability <= 0.196 {
        254
    } else {
        205
    }
}

/// Width, height and pixels of a binary PGM.
pub(crate) fn read_pgm(path: &Path) -> (usize, usize, Vec<u8>) {
    let bytes = fs::read(path).unwrap();
    let mut lines = bytes.splitn(4, |&byte| byte == b'\n');
    let mut line = || lines.next().unwrap();
    assert_eq!(line(), b"P5");
    let size = String::from_utf8(line().to_vec()).unwrap();
    let (width, height) = size.split_once(' ').unwrap();
    assert_eq!(line(), b"255");
    (
        width.parse().unwrap(),
        height.parse().unwrap(),
        line().to_vec(),
    )
}
