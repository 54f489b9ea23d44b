//! Map export: `GeoTIFF`, PNG with legend, PGM and YAML (`map_server` of ROS and Nav2, trinary
//! mode), TUM trajectory, `GeoJSON`.
//!
//! Every file is written under a temporary name and renamed when it is complete. A failed export
//! leaves the previous file unchanged.

mod contours;
mod date;
mod geojson;
mod geotiff;
mod picture;
mod poses;
mod shores;
mod trajectory;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::layer::{LayerId, Palette};
use crate::mosaic::{MAX_RASTER_CELLS, MosaicError, Raster};
use crate::tile_store::TileStore;
pub use contours::write_contours;
pub use date::{span_label, utc_label};
pub use geotiff::write_geotiff;
pub use picture::{Caption, Footprint, Label, length_label, round_length_m, write_picture};
pub use poses::Poses;
pub use shores::{shore_labels, write_shores};
pub use trajectory::{StampedPose, write_covariances, write_path, write_trajectory};

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

/// Writes `<layer>.tif` and `<layer>.png` to `dir`; for occupancy and obstacles also `<layer>.pgm` and
/// `occupancy.yaml`; for elevation and obstacle also `<layer>.document.png` in the colours of
/// \[LOD\]; for depth also `depth.geojson`, its contours. The labels of the caption are drawn on the
/// shores only. Returns the paths.
pub fn export_raster(
    dir: &Path,
    raster: &Raster,
    caption: &Caption<'_>,
) -> Result<Vec<PathBuf>, ExportError> {
    let layer = raster.layer();
    let caption = &Caption {
        labels: if layer == LayerId::Shore {
            caption.labels
        } else {
            &[]
        },
        ..*caption
    };
    let mut files = vec![
        dir.join(format!("{layer}.tif")),
        dir.join(format!("{layer}.png")),
    ];
    write_geotiff(&files[0], raster, caption.datum)?;
    write_picture(&files[1], raster, &palette_for(raster), caption)?;
    if let Some(palette) = layer.document_palette() {
        let path = dir.join(format!("{layer}.document.png"));
        write_picture(&path, raster, &palette, caption)?;
        files.push(path);
    }
    if layer == LayerId::Depth {
        files.push(write_contours(dir, raster, caption.datum)?);
    }
    if matches!(layer, LayerId::Occupancy | LayerId::Obstacle) {
        files.extend(write_map_server(dir, layer.name(), raster)?);
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

/// Writes a raster of probabilities or of obstacles as `<name>.pgm` and `<name>.yaml` to `dir`; returns their paths.
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
            // Classes of the obstacle map are -1, free, and 1: they fit the thresholds of a probability.
            let value = raster.layer().quantisation().decode(code);
            value.map_or(Trinary::Undecided, Trinary::of).grey()
        }));
        writer.write_all(&pixels)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs::{self, File};

    use serde_json::json;
    use tiff::decoder::{Decoder, DecodingResult};
    use tiff::tags::Tag;

    use super::*;
    use crate::tile::{BootId, TileCells, TileKey};
    use crate::tile_store::LayerGrid;

    fn store_of(
        layer: LayerId,
        cell_m: f64,
        width: i64,
        height: i64,
        code: impl Fn(i64, i64) -> u16,
    ) -> TileStore {
        let mut store = TileStore::new(BootId([3; 16]), 500);
        store.set_grid(LayerGrid { layer, cell_m }).unwrap();
        fill(&mut store, layer, width, height, code);
        store
    }

    /// Publishes the codes of a rectangle whose lowest cell is (−20, −10).
    fn fill(
        store: &mut TileStore,
        layer: LayerId,
        width: i64,
        height: i64,
        code: impl Fn(i64, i64) -> u16,
    ) {
        for ty in -1..=(height - 10) / 64 {
            for tx in -1..=(width - 20) / 64 {
                let cells = TileCells::from_fn(|x, y| {
                    let index = |i: usize| i64::try_from(i).unwrap();
                    let (x, y) = (64 * tx + index(x) + 20, 64 * ty + index(y) + 10);
                    let inside = (0..width).contains(&x) && (0..height).contains(&y);
                    if inside { code(x, y) } else { 0 }
                });
                let key = TileKey {
                    layer,
                    tx: tx as i32,
                    ty: ty as i32,
                };
                assert!(store.publish(key, cells).is_ok());
            }
        }
    }

    pub(super) fn raster_of(
        layer: LayerId,
        cell_m: f64,
        width: i64,
        height: i64,
        code: impl Fn(i64, i64) -> u16,
    ) -> Raster {
        let store = store_of(layer, cell_m, width, height, code);
        Raster::of_layer(&store, layer, MAX_RASTER_CELLS)
            .unwrap()
            .unwrap()
    }

    fn read_tiff(path: &Path) -> (DecodingResult, (u32, u32), Vec<f64>, Vec<f64>, String) {
        let mut decoder = Decoder::new(File::open(path).unwrap()).unwrap();
        let dimensions = decoder.dimensions().unwrap();
        let scale = decoder.get_tag_f64_vec(Tag::ModelPixelScaleTag).unwrap();
        let tie = decoder.get_tag_f64_vec(Tag::ModelTiepointTag).unwrap();
        let no_data = decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap();
        (
            decoder.read_image().unwrap(),
            dimensions,
            scale,
            tie,
            no_data,
        )
    }

    #[test]
    fn geotiff_reads_back_with_corners_values_and_unknown() {
        let raster = raster_of(LayerId::Elevation, 0.25, 300, 401, |x, y| match (x, y) {
            (0, 0) => 32768 + 200,
            (299, 400) => 32768 - 3,
            (5, 400) => 32768,
            _ => 0,
        });
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("elevation.tif");
        write_geotiff(&path, &raster, None).unwrap();
        let (image, dimensions, scale, tie, no_data) = read_tiff(&path);
        assert_eq!(dimensions, (300, 401));
        assert_eq!(scale, [0.25, 0.25, 0.0]);
        assert_eq!(tie, [0.0, 0.0, 0.0, -5.0, (401.0 - 10.0) * 0.25, 0.0]);
        assert_eq!(no_data, "nan");
        let DecodingResult::F32(values) = image else {
            panic!("not f32");
        };
        assert_eq!(
            values[5].to_bits(),
            0.0_f32.to_bits(),
            "row 0 is the greatest y"
        );
        assert_eq!(values[299].to_bits(), (-0.015_f32).to_bits());
        assert_eq!(values[400 * 300].to_bits(), 1.0_f32.to_bits());
        assert_eq!(
            values.iter().filter(|value| value.is_nan()).count(),
            300 * 401 - 3
        );
    }

    #[test]
    fn geotiff_with_a_datum_is_on_earth() {
        let raster = raster_of(LayerId::Depth, 0.3, 30, 20, |_, _| 200);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("depth.tif");
        let keys_of = |datum| {
            write_geotiff(&path, &raster, datum).unwrap();
            let (_, _, scale, tie, _) = read_tiff(&path);
            // Coordinates stay metres in `odom`.
            assert_eq!(scale, [0.3, 0.3, 0.0]);
            assert_eq!(tie[3..5], [-20.0 * 0.3, 10.0 * 0.3]);
            let mut decoder = Decoder::new(File::open(&path).unwrap()).unwrap();
            let keys = decoder.get_tag_u16_vec(Tag::GeoKeyDirectoryTag).unwrap();
            let keys: Vec<[u16; 4]> = keys.as_chunks::<4>().0.to_vec();
            assert_eq!(keys[0], [1, 1, 0, keys.len() as u16 - 1]);
            assert!(keys[1..].is_sorted_by_key(|key| key[0]));
            let doubles = decoder.get_tag_f64_vec(Tag::GeoDoubleParamsTag);
            (keys, doubles.unwrap_or_default())
        };
        let has = |keys: &[[u16; 4]], key, value| keys.contains(&[key, 0, 1, value]);
        let (keys, doubles) = keys_of(None);
        assert!(has(&keys, 1024, 32767) && doubles.is_empty(), "{keys:?}");
        let (keys, doubles) = keys_of(Some(crate::message::Datum {
            latitude_deg: 38.5,
            longitude_deg: -9.1,
            altitude_m: 637.1,
        }));
        // Projected, WGS 84, Transverse Mercator about the datum.
        for (key, value) in [
            (1024, 1),
            (2048, 4326),
            (3072, 32767),
            (3075, 1),
            (3076, 9001),
        ] {
            assert!(has(&keys, key, value), "{key} {keys:?}");
        }
        let value = |key| {
            let [_, tag, count, at] = keys.iter().find(|found| found[0] == key).unwrap();
            assert_eq!((*tag, *count), (Tag::GeoDoubleParamsTag.to_u16(), 1));
            doubles[usize::from(*at)]
        };
        let values = [3080, 3081, 3082, 3083, 3092].map(value);
        let expected = [-9.1, 38.5, 0.0, 0.0, 1.0001_f64];
        assert_eq!(values.map(f64::to_bits), expected.map(f64::to_bits));
    }

    /// 600 × 400 cells of one value with a bay of unknown ones, and one cell more dangerous than all.
    #[test]
    fn gdal_finds_cloud_optimised_tiffs_with_our_values() {
        let dir = tempfile::tempdir().unwrap();
        let datum = crate::message::Datum {
            latitude_deg: 38.5,
            longitude_deg: -9.1,
            altitude_m: 0.0,
        };
        // Of the common cells and of the dangerous one.
        let codes_of = |layer: LayerId| match layer {
            LayerId::Obstacle | LayerId::Rigidity | LayerId::Shore => [1, 2],
            _ if layer.least_decides() => [200, 100],
            _ => [100, 200],
        };
        for layer in LayerId::ALL {
            let [common, dangerous] = codes_of(layer);
            let raster = raster_of(layer, 0.25, 600, 400, |x, y| match (x, y) {
                (123, 321) => dangerous,
                (400..500, 5..) => 0,
                _ => common,
            });
            write_geotiff(
                &dir.path().join(format!("{layer}.tif")),
                &raster,
                Some(datum),
            )
            .unwrap();
            let unknown = if layer.classes().is_empty() {
                f32::NAN
            } else {
                0.0
            };
            let (mut codes, mut values) = (Vec::new(), Vec::new());
            for y in (0..raster.height()).rev() {
                raster.read_row(y, &mut codes);
                let row = codes.iter().map(|&code| layer.quantisation().decode(code));
                values.extend(row.flat_map(|value| value.unwrap_or(unknown).to_le_bytes()));
            }
            fs::write(dir.path().join(format!("{layer}.f32")), values).unwrap();
        }
        let Some(report) = crate::gdal::gis_report(dir.path()) else {
            return;
        };
        for layer in LayerId::ALL {
            let found = &report["rasters"][format!("{layer}.tif")];
            assert_eq!(found["problems"], json!([]), "{layer}");
            assert_eq!(found["size"], json!([600, 400]));
            assert_eq!(found["block"], json!([256, 256]));
            assert_eq!(found["overviews"], json!([[300, 200], [150, 100]]));
            assert_eq!(
                (&found["cells"], &found["other_cells"]),
                (&json!(240_000), &json!(0))
            );
            let transform = json!([-5.0, 0.25, 0.0, 97.5, 0.0, -0.25]);
            assert_eq!(found["transform"], transform);
            assert_eq!(found["method"], "Transverse_Mercator");
            let mut values = codes_of(layer).map(|code| layer.quantisation().decode(code).unwrap());
            values.sort_by(f32::total_cmp);
            // The dangerous cell is on each overview.
            assert_eq!(
                found["extremes"],
                json!([values, values, values]),
                "{layer}"
            );
        }
    }

    #[test]
    fn each_layer_has_its_sample_type() {
        let dir = tempfile::tempdir().unwrap();
        for layer in LayerId::ALL {
            let max = 1 + u16::from(layer == LayerId::Shore) * 2;
            let corner_only = |x: i64, y: i64| if (x, y) == (1, 1) { 0 } else { max };
            let path = dir.path().join(format!("{layer}.tif"));
            write_geotiff(&path, &raster_of(layer, 0.1, 2, 2, corner_only), None).unwrap();
            let (image, .., no_data) = read_tiff(&path);
            match (layer, image) {
                (
                    LayerId::Occupancy
                    | LayerId::Elevation
                    | LayerId::Cost
                    | LayerId::Intra
                    | LayerId::Inter
                    | LayerId::Depth,
                    DecodingResult::F32(values),
                ) => {
                    let expected = layer.quantisation().decode(max).unwrap();
                    assert_eq!(values[0].to_bits(), expected.to_bits());
                    assert!(values[1].is_nan());
                    assert_eq!(no_data, "nan");
                }
                (LayerId::Obstacle, DecodingResult::I8(values)) => {
                    assert_eq!((values, no_data.as_str()), (vec![-1, 0, -1, -1], "0"));
                }
                (LayerId::Rigidity | LayerId::Shore, DecodingResult::U8(values)) => {
                    let value = max as u8;
                    assert_eq!(
                        (values, no_data.as_str()),
                        (vec![value, 0, value, value], "0")
                    );
                }
                _ => panic!("{layer} has another sample type"),
            }
        }
    }

    #[test]
    fn map_server_files_are_trinary_and_upright() {
        let quantisation = LayerId::Occupancy.quantisation();
        let probabilities = [[0.65, 0.648, 0.98], [0.196, 0.2, f32::NAN]];
        let raster = raster_of(LayerId::Occupancy, 0.05, 3, 2, |x, y| {
            quantisation.encode(probabilities[1 - y as usize][x as usize])
        });
        let dir = tempfile::tempdir().unwrap();
        let [pgm, yaml] = write_map_server(dir.path(), "occupancy", &raster).unwrap();
        assert_eq!(
            fs::read(pgm).unwrap(),
            [b"P5\n3 2\n255\n".as_slice(), &[205, 205, 0, 254, 205, 205]].concat(),
            "0.65 is stored as 0.648, the nearest step"
        );
        assert_eq!(
            fs::read_to_string(yaml).unwrap(),
            "image: occupancy.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.0, -0.5, 0.0]\n\
     negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
        );
        let quantisation = LayerId::Obstacle.quantisation();
        let raster = raster_of(LayerId::Obstacle, 0.05, 3, 1, |x, _| {
            quantisation.encode([-1.0, f32::NAN, 1.0][x as usize])
        });
        let [pgm, _] = write_map_server(dir.path(), "obstacle", &raster).unwrap();
        assert_eq!(
            fs::read(pgm).unwrap(),
            [b"P5\n3 1\n255\n".as_slice(), &[254, 205, 0]].concat()
        );
    }

    #[test]
    fn every_known_layer_gets_its_files() {
        let mut store = store_of(LayerId::Occupancy, 0.1, 40, 30, |x, _| 1 + x as u16);
        for layer in [LayerId::Elevation, LayerId::Shore, LayerId::Depth] {
            store.set_grid(LayerGrid { layer, cell_m: 0.2 }).unwrap();
        }
        fill(&mut store, LayerId::Shore, 10, 10, |x, _| 1 + x as u16 % 4);
        fill(&mut store, LayerId::Depth, 10, 10, |x, _| {
            150 + 10 * x as u16
        });
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("made").join("for it");
        let exported = export_all(
            &target,
            &store,
            &Caption {
                title: "a test",
                ..Caption::default()
            },
        )
        .unwrap();
        assert_eq!(exported.empty, [LayerId::Elevation]);
        let mut names: Vec<String> = fs::read_dir(&target)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(
            names,
            [
                "depth.geojson",
                "depth.png",
                "depth.tif",
                "occupancy.pgm",
                "occupancy.png",
                "occupancy.tif",
                "occupancy.yaml",
                "shore.png",
                "shore.tif"
            ]
        );
        assert_eq!(exported.files.len(), 9);
        let png = png::Decoder::new(std::io::BufReader::new(
            File::open(target.join("shore.png")).unwrap(),
        ));
        assert!(png.read_info().unwrap().info().width > 400);
    }

    #[test]
    fn an_error_names_the_path_and_the_other_layers_are_written() {
        let mut store = store_of(LayerId::Occupancy, 0.1, 4, 4, |_, _| 6);
        let layer = LayerId::Obstacle;
        store.set_grid(LayerGrid { layer, cell_m: 0.1 }).unwrap();
        fill(&mut store, layer, 4, 4, |_, _| 1);
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("occupancy.tif")).unwrap();
        let error = export_all(dir.path(), &store, &Caption::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("occupancy.tif"), "{error}");
        assert!(dir.path().join("obstacle.png").exists());
        let leftovers = fs::read_dir(dir.path())
            .unwrap()
            .filter(|entry| entry.as_ref().unwrap().path().extension() == Some("part".as_ref()))
            .count();
        assert_eq!(leftovers, 0);
    }

    /// Cells on a side: a square kilometre at 0.1 m.
    const LARGE_SIDE: i64 = 10_000;
    /// The picture of 3334 × 3334 pixels takes 33 MB, and as much while it is filtered. A copied raster
    /// would take 200 MB.
    const MAX_EXTRA_KB: u64 = 150_000;

    /// A line of this process's status, KB; `None` if the system has none.
    fn status_kb(name: &str) -> Option<u64> {
        let text = fs::read_to_string("/proc/self/status").ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim_matches(|sign: char| !sign.is_ascii_digit())
            .parse()
            .ok()
    }

    #[test]
    #[ignore = "ten seconds and 300 MB; its figure of memory holds where it runs alone"]
    fn a_map_of_10_000_by_10_000_cells_is_exported_in_little_memory() {
        let layer = LayerId::Occupancy;
        let code = |x: i64, y: i64| 1 + ((x / 7 + y / 3) % 250) as u16;
        let store = store_of(layer, 0.1, LARGE_SIDE, LARGE_SIDE, code);
        assert_eq!(store.cells_known(layer), 100_000_000);
        // Resets the peak.
        drop(fs::write("/proc/self/clear_refs", "5"));
        let held_kb = status_kb("VmRSS:");
        let dir = tempfile::tempdir().unwrap();
        let exported = export_all(dir.path(), &store, &Caption::default()).unwrap();
        assert_eq!(exported.files.len(), 4);
        if let (Some(held_kb), Some(peak_kb)) = (held_kb, status_kb("VmHWM:")) {
            let extra_kb = peak_kb.saturating_sub(held_kb);
            println!("{held_kb} KB held, {extra_kb} KB more for the export");
            assert!(extra_kb < MAX_EXTRA_KB, "{extra_kb}");
        }
        for file in &exported.files {
            println!(
                "{}: {} bytes",
                file.display(),
                fs::metadata(file).unwrap().len()
            );
        }

        let file = File::open(dir.path().join("occupancy.tif")).unwrap();
        let mut decoder = Decoder::new(file).unwrap();
        assert_eq!(decoder.dimensions().unwrap(), (10_000, 10_000));
        let decode = |x, y| layer.quantisation().decode(code(x, y)).unwrap().to_bits();
        let DecodingResult::F32(first) = decoder.read_chunk(0).unwrap() else {
            panic!("not f32");
        };
        assert_eq!(first[0].to_bits(), decode(0, LARGE_SIDE - 1));
        assert_eq!(first[255].to_bits(), decode(255, LARGE_SIDE - 1));
        let pgm = fs::metadata(dir.path().join("occupancy.pgm")).unwrap();
        assert_eq!(
            pgm.len(),
            100_000_000 + "P5\n10000 10000\n255\n".len() as u64
        );
    }

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
