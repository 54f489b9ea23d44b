//! Occupancy as `map_server` of ROS and Nav2 reads it: PGM and YAML in trinary mode.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::ExportError;
use super::atomic_file::write_atomically;
use crate::mosaic::Raster;

/// At least this probability is occupied; `map_saver`'s default.
const OCCUPIED_MIN: f32 = 0.65;
/// At most this probability is free; `map_saver`'s default, just below what grey 205 reads back as.
const FREE_MAX: f32 = 0.196;

/// What `map_server` makes of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trinary {
    /// Probability at least 0.65.
    Occupied,
    /// Probability at most 0.196.
    Free,
    /// In between.
    Undecided,
}

impl Trinary {
    /// From a probability of being occupied.
    pub fn of(probability: f32) -> Self {
        if probability >= OCCUPIED_MIN {
            Self::Occupied
        } else if probability <= FREE_MAX {
            Self::Free
        } else {
            Self::Undecided
        }
    }

    /// Its name in counts.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Occupied => "occupied",
            Self::Free => "free",
            Self::Undecided => "undecided",
        }
    }

    /// Its grey in the PGM, which unknown cells share with undecided ones.
    const fn grey(self) -> u8 {
        match self {
            Self::Occupied => 0,
            Self::Free => 254,
            Self::Undecided => 205,
        }
    }
}

/// Writes `<name>.pgm` and `<name>.yaml` to `dir` and returns their paths.
///
/// Row 0 is the greatest y; `origin` is the lower left corner of the lower left cell.
pub fn write_map_server(
    dir: &Path,
    name: &str,
    raster: &Raster,
) -> Result<[PathBuf; 2], ExportError> {
    let pgm = dir.join(format!("{name}.pgm"));
    let yaml = dir.join(format!("{name}.yaml"));
    let io_error = |path: &Path| {
        let path = path.to_owned();
        move |source| ExportError::Io { path, source }
    };
    write_atomically(&pgm, |writer| {
        write_pgm(writer, raster).map_err(io_error(&pgm))
    })?;
    let ([x_m, y_m], _) = raster.corners_m();
    write_atomically(&yaml, |writer| {
        write!(
            writer,
            "image: {name}.pgm\n\
             mode: trinary\n\
             resolution: {:?}\n\
             origin: [{x_m:?}, {y_m:?}, 0.0]\n\
             negate: 0\n\
             occupied_thresh: {OCCUPIED_MIN}\n\
             free_thresh: {FREE_MAX}\n",
            raster.cell_m(),
        )
        .map_err(io_error(&yaml))
    })?;
    Ok([pgm, yaml])
}

fn write_pgm(writer: &mut impl Write, raster: &Raster) -> std::io::Result<()> {
    write!(writer, "P5\n{} {}\n255\n", raster.width(), raster.height())?;
    let mut codes = Vec::with_capacity(raster.width());
    let mut pixels = Vec::with_capacity(raster.width());
    for y in (0..raster.height()).rev() {
        raster.read_row(y, &mut codes);
        pixels.clear();
        pixels.extend(codes.iter().map(|&code| {
            let probability = raster.layer().quantisation().decode(code);
            probability.map_or(Trinary::Undecided, Trinary::of).grey()
        }));
        writer.write_all(&pixels)?;
    }
    Ok(())
}
