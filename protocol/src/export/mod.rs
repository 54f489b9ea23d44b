//! Maps as files that other tools open: `GeoTIFF`, PNG with legend, PGM + YAML, TUM, `GeoJSON`.
//!
//! Every file is written under a temporary name and renamed when it is complete, so a reader never sees
//! half of one and an export that fails leaves the previous file as it was.

mod atomic_file;
mod geotiff;
mod map_server;
mod picture;
mod shores;
mod trajectory;

use std::io;
use std::path::{Path, PathBuf};

use crate::layer::{LayerId, Palette};
use crate::mosaic::{MAX_RASTER_CELLS, MosaicError, Raster};
use crate::tile_store::TileStore;

pub use geotiff::write_geotiff;
pub use map_server::{Trinary, write_map_server};
pub use picture::{Caption, Label, length_label, round_length_m, write_picture};
pub use shores::write_shores;
pub use trajectory::{StampedPose, write_trajectory};

/// Why an export failed.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The file system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The `GeoTIFF` could not be encoded.
    #[error("{}: {source}", path.display())]
    Tiff {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: tiff::TiffError,
    },
    /// The PNG could not be encoded.
    #[error("{}: {source}", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: png::EncodingError,
    },
    /// The layer makes no raster.
    #[error("{}: {source}", path.display())]
    Mosaic {
        /// The directory exported to.
        path: PathBuf,
        /// What is wrong.
        source: MosaicError,
    },
}

/// What an export wrote.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// The files, in the order of writing.
    pub files: Vec<PathBuf>,
    /// Layers of which nothing is known: they have no files.
    pub empty: Vec<LayerId>,
}

/// Writes every layer of `store` to `dir`, which is made where it is missing. See [`export_layer`].
///
/// A layer that fails does not keep the others from being written; the first error is returned at the end.
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

/// Writes what [`export_raster`] writes of one layer of `store` to `dir`, which is made where it is missing, and returns the
/// paths: none where nothing of the layer is known.
pub fn export_layer(
    dir: &Path,
    store: &TileStore,
    layer: LayerId,
    caption: &Caption<'_>,
) -> Result<Vec<PathBuf>, ExportError> {
    std::fs::create_dir_all(dir).map_err(|source| ExportError::Io {
        path: dir.to_owned(),
        source,
    })?;
    let raster =
        Raster::of_layer(store, layer, MAX_RASTER_CELLS).map_err(|source| ExportError::Mosaic {
            path: dir.to_owned(),
            source,
        })?;
    raster.map_or(Ok(Vec::new()), |raster| {
        export_raster(dir, &raster, caption)
    })
}

/// Writes `<layer>.tif` and `<layer>.png`, for occupancy also `occupancy.pgm` and `occupancy.yaml`, for
/// elevation and obstacle the picture in the colours of \[LOD\] as `<layer>.document.png`, to `dir`, and returns their
/// paths.
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

/// The layer's default palette, where possible fitted to all but the lowest and the highest 1 % of cells.
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

#[cfg(test)]
mod tests;
