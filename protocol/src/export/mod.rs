//! Map export: `GeoTIFF`, PNG with legend, PGM and YAML (`map_server` of ROS and Nav2, trinary
//! mode), TUM trajectory, `GeoJSON`.
//!
//! Every file is written under a temporary name and renamed when it is complete. A failed export
//! leaves the previous file unchanged.

mod geotiff;
mod picture;
mod shores;
mod trajectory;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::layer::{LayerId, Palette};
use crate::mosaic::{MAX_RASTER_CELLS, MosaicError, Raster};
use crate::tile_store::TileStore;
pub use geotiff::write_geotiff;
pub use picture::{Caption, Label, length_label, round_length_m, write_picture};
pub use shores::write_shores;
pub use trajectory::{StampedPose, write_trajectory};

/// A failed export.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct ExportError {
    /// File or directory.
    pub path: PathBuf,
    /// Reason.
    pub source: ExportFault,
}

/// Reason of a failed export.
#[derive(Debug, thiserror::Error)]
pub enum ExportFault {
    /// File system error.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The `GeoTIFF` could not be encoded.
    #[error("{0}")]
    Tiff(#[from] tiff::TiffError),
    /// The PNG could not be encoded.
    #[error("{0}")]
    Png(#[source] png::EncodingError),
    /// The layer gives no raster.
    #[error("{0}")]
    Mosaic(#[from] MosaicError),
}

impl From<png::EncodingError> for ExportFault {
    /// The error of the crate has no `source`, by which a full disk is recognized.
    fn from(error: png::EncodingError) -> Self {
        match error {
            png::EncodingError::IoError(error) => Self::Io(error),
            error => Self::Png(error),
        }
    }
}

impl ExportError {
    /// Adds `path` to a reason.
    pub fn at<E: Into<ExportFault>>(path: &Path) -> impl FnOnce(E) -> Self {
        move |fault| Self {
            path: path.to_owned(),
            source: fault.into(),
        }
    }
}

/// Result of an export.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// Files in the order of writing.
    pub files: Vec<PathBuf>,
    /// Layers without known cells, which have no files.
    pub empty: Vec<LayerId>,
}

/// Writes every layer of `store` to `dir`, which is created if necessary. See [`export_layer`].
///
/// An error in one layer does not stop the others; the first error is returned at the end.
pub fn export_all(
    dir: &Path,
    store: &TileStore,
    caption: &Caption<'_>,
) -> Result<Exported, ExportError> {
    let mut exported = Exported::default();
    let mut first_error = None;
    for grid in store.grids() {
        match export_layer(dir, store, grid.layer, caption) {
            Ok(files) if files.is_empty() => exported.empty.push(grid.layer),
            Ok(files) => exported.files.extend(files),
            Err(error) => {
                first_error.get_or_insert(error);
            }
        }
    }
    first_error.map_or(Ok(exported), Err)
}

/// Writes one layer of `store` by [`export_raster`] to `dir`, which is created if necessary;
/// returns the paths, none for an unknown layer.
pub fn export_layer(
    dir: &Path,
    store: &TileStore,
    layer: LayerId,
    caption: &Caption<'_>,
) -> Result<Vec<PathBuf>, ExportError> {
    fs::create_dir_all(dir).map_err(ExportError::at(dir))?;
    let raster = Raster::of_layer(store, layer, MAX_RASTER_CELLS);
    match raster.map_err(ExportError::at(dir))? {
        Some(raster) => export_raster(dir, &raster, caption),
        None => Ok(Vec::new()),
    }
}

/// Writes `<layer>.tif` and `<layer>.png` to `dir`; for occupancy also `occupancy.pgm` and
/// `occupancy.yaml`; for elevation and obstacle also `<layer>.document.png` in the colours of
/// \[LOD\]. Returns the paths.
pub fn export_raster(
    dir: &Path,
    raster: &Raster,
    caption: &Caption<'_>,
) -> Result<Vec<PathBuf>, ExportError> {
    let layer = raster.layer();
    let mut files = vec![
        dir.join(format!("{layer}.tif")),
        dir.join(format!("{layer}.png")),
    ];
    write_geotiff(&files[0], raster)?;
    write_picture(&files[1], raster, &palette_for(raster), caption)?;
    if let Some(palette) = layer.document_palette() {
        let path = dir.join(format!("{layer}.document.png"));
        write_picture(&path, raster, &palette, caption)?;
        files.push(path);
    }
    if layer == LayerId::Occupancy {
        files.extend(write_map_server(dir, "occupancy", raster)?);
    }
    Ok(files)
}

/// Default palette of the layer, fitted (if possible) to all but the lowest and highest 1 % of
/// cells.
pub fn palette_for(raster: &Raster) -> Palette {
    let palette = raster.layer().default_palette();
    let mut counts = vec![0_u64; usize::from(u16::MAX) + 1];
    for code in raster.known_codes() {
        counts[usize::from(code)] += 1;
    }
    let known: u64 = counts.iter().sum();
    let value_of_rank = |rank: u64| {
        let mut seen = 0;
        let code = counts.iter().position(|&count| {
            seen += count;
            seen > rank
        });
        let quantisation = raster.layer().quantisation();
        code.and_then(|code| quantisation.decode(code as u16))
    };
    match (
        value_of_rank(known / 100),
        value_of_rank(known - 1 - known / 100),
    ) {
        (Some(low), Some(high)) => palette.fitted(low, high),
        (None, _) | (_, None) => palette,
    }
}

/// Writes `path` through a temporary file beside it, which is always removed.
fn write_atomically(
    path: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), ExportFault>,
) -> Result<(), ExportError> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.part", std::process::id()));
    let part = path.with_file_name(name);
    let written = write_part(path, &part, content);
    if written.is_err() {
        // Report the first error; there may be no temporary file.
        drop(fs::remove_file(&part));
    }
    written.map_err(ExportError::at(path))
}

fn write_part(
    path: &Path,
    part: &Path,
    content: impl FnOnce(&mut BufWriter<File>) -> Result<(), ExportFault>,
) -> Result<(), ExportFault> {
    let mut writer = BufWriter::new(File::create(part)?);
    content(&mut writer)?;
    writer.flush()?;
    writer.get_ref().sync_all()?;
    Ok(fs::rename(part, path)?)
}

/// Least probability of occupied cells, the default of `map_saver`.
const OCCUPIED_MIN: f32 = 0.65;
/// Greatest probability of free cells, the default of `map_saver`, just below the value of grey
/// 205.
const FREE_MAX: f32 = 0.196;

/// State of a cell for `map_server`.
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
    /// State for a probability.
    pub fn of(probability: f32) -> Self {
        if probability >= OCCUPIED_MIN {
            Self::Occupied
        } else if probability <= FREE_MAX {
            Self::Free
        } else {
            Self::Undecided
        }
    }

    /// Name in counts.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Occupied => "occupied",
            Self::Free => "free",
            Self::Undecided => "undecided",
        }
    }

    /// Grey in the PGM; undecided cells are as unknown ones.
    const fn grey(self) -> u8 {
        match self {
            Self::Occupied => 0,
            Self::Free => 254,
            Self::Undecided => 205,
        }
    }
}

/// Writes `<name>.pgm` and `<name>.yaml` to `dir`; returns their paths.
///
/// Row 0 is the greatest y; `origin` is the lower left corner of the lower left cell.
pub fn write_map_server(
    dir: &Path,
    name: &str,
    raster: &Raster,
) -> Result<[PathBuf; 2], ExportError> {
    let pgm = dir.join(format!("{name}.pgm"));
    let yaml = dir.join(format!("{name}.yaml"));
    write_atomically(&pgm, |writer| Ok(write_pgm(writer, raster)?))?;
    let ([x_m, y_m], _) = raster.corners_m();
    write_atomically(&yaml, |writer| {
        Ok(write!(
            writer,
            "image: {name}.pgm\n\
             mode: trinary\n\
             resolution: {:?}\n\
             origin: [{x_m:?}, {y_m:?}, 0.0]\n\
             negate: 0\n\
             occupied_thresh: {OCCUPIED_MIN}\n\
             free_thresh: {FREE_MAX}\n",
            raster.cell_m(),
        )?)
    })?;
    Ok([pgm, yaml])
}

fn write_pgm(writer: &mut impl Write, raster: &Raster) -> io::Result<()> {
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

#[cfg(test)]
mod tests;

#[cfg(test)]
mod atomic_file_tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_previous_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("map.pgm");
        fs::write(&path, "before").unwrap();
        let failed = write_atomically(&path, |writer| {
            writer.write_all(b"half").unwrap();
            Err(io::Error::other("disk full").into())
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"before");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_error_names_the_file_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("missing").join("map.pgm");
        let error = write_atomically(&path, |_| Ok(())).unwrap_err().to_string();
        assert!(error.starts_with(path.to_str().unwrap()), "{error}");
    }
}
