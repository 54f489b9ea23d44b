//! A raster as Cloud-Optimised `GeoTIFF` (OGC 21-026): a layer's values in its sample type, placed in `odom` metres.
//!
//! Row 0 is the greatest y. Coordinates are metres in `odom`. With a datum `odom` is described as a
//! projection of WGS 84: Transverse Mercator about the datum, which differs from the tangent plane by
//! 8 mm at 10 km (docs/maps.md). UTM would turn the raster by the convergence of meridians, and resample it.
//! Without, the coordinate system is user-defined and local.
//!
//! The directories stand first, so that a reader on the web finds a tile after one request. Each overview has half the
//! resolution of the one before; a pixel is the deciding code of its cells ([`LayerId::deciding`]). The `tiff` crate
//! writes a directory behind its data, so this file writes the format (TIFF 6.0) itself. Memory beside the raster is one tile.

use std::fs::File;
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::ExportError;
use crate::export::write_atomically;
use crate::layer::{LayerId, UNKNOWN};
use crate::message::Datum;
use crate::mosaic::Raster;

/// Rows and columns of a tile.
const TILE_PIXELS: usize = 256;

/// Mean radius of the Earth.
const EARTH_M: f64 = 6_371_000.0;

/// Tags of TIFF 6.0, of `GeoTIFF`, and of GDAL.
mod tag {
    pub(super) const NEW_SUBFILE_TYPE: u16 = 254;
    pub(super) const IMAGE_WIDTH: u16 = 256;
    pub(super) const IMAGE_LENGTH: u16 = 257;
    pub(super) const BITS_PER_SAMPLE: u16 = 258;
    pub(super) const COMPRESSION: u16 = 259;
    pub(super) const PHOTOMETRIC_INTERPRETATION: u16 = 262;
    pub(super) const SAMPLES_PER_PIXEL: u16 = 277;
    pub(super) const TILE_WIDTH: u16 = 322;
    pub(super) const TILE_LENGTH: u16 = 323;
    pub(super) const TILE_OFFSETS: u16 = 324;
    pub(super) const TILE_BYTE_COUNTS: u16 = 325;
    pub(super) const SAMPLE_FORMAT: u16 = 339;
    pub(super) const MODEL_PIXEL_SCALE: u16 = 33550;
    pub(super) const MODEL_TIEPOINT: u16 = 33922;
    pub(super) const GEO_KEY_DIRECTORY: u16 = 34735;
    pub(super) const GEO_DOUBLE_PARAMS: u16 = 34736;
    pub(super) const GEO_ASCII_PARAMS: u16 = 34737;
    /// Item names and units as XML.
    pub(super) const GDAL_METADATA: u16 = 42112;
    pub(super) const GDAL_NODATA: u16 = 42113;
}

/// Writes `raster` as a `GeoTIFF` with the layer's values. `datum` is where on Earth `odom` is.
pub fn write_geotiff(
    path: &Path,
    raster: &Raster,
    datum: Option<Datum>,
) -> Result<(), ExportError> {
    write_atomically(path, |writer| Ok(encode(writer, raster, datum)?))
}

fn encode(writer: &mut BufWriter<File>, raster: &Raster, datum: Option<Datum>) -> io::Result<()> {
    let mut levels = levels_of(raster);
    // Their size is known, the places of the tiles are not.
    let mut at = write_directories(writer, raster, datum, &levels)?;
    // A reader expects the smallest overview first.
    for level in levels.iter_mut().rev() {
        for index in 0..level.tiles.len() {
            let mut bytes = deflate_tile(raster, level, index)?;
            level.tiles[index] = [at, place(bytes.len())?];
            if bytes.len() % 2 == 1 {
                bytes.push(0);
            }
            writer.write_all(&bytes)?;
            at = place(at as usize + bytes.len())?;
        }
    }
    writer.seek(SeekFrom::Start(0))?;
    write_directories(writer, raster, datum, &levels)?;
    Ok(())
}

/// The image, or an overview of it.
struct Level {
    /// Cells along the edge of a pixel.
    step: usize,
    /// Pixels.
    width: usize,
    height: usize,
    /// Offset in the file and number of bytes of each tile, row by row.
    tiles: Vec<[u32; 2]>,
}

impl Level {
    const fn tile_columns(&self) -> usize {
        self.width.div_ceil(TILE_PIXELS)
    }
}

/// The image, then overviews until one is a single tile.
fn levels_of(raster: &Raster) -> Vec<Level> {
    let mut levels = Vec::new();
    let mut step = 1;
    loop {
        let [width, height] = [raster.width(), raster.height()].map(|cells| cells.div_ceil(step));
        let [columns, rows] = [width, height].map(|pixels| pixels.div_ceil(TILE_PIXELS));
        let tiles = vec![[0; 2]; columns * rows];
        let is_last = tiles.len() == 1;
        levels.push(Level {
            step,
            width,
            height,
            tiles,
        });
        if is_last {
            return levels;
        }
        step *= 2;
    }
}

/// Continuous layers are 32-bit floats, NaN for unknown; classes are bytes, 0 for unknown.
fn is_float(layer: LayerId) -> bool {
    layer.classes().is_empty()
}

/// `SampleFormat`: 1 unsigned, 2 signed, 3 IEEE 754.
fn sample_format(layer: LayerId) -> u16 {
    if is_float(layer) {
        3
    } else if layer.classes().iter().any(|class| class.value < 0) {
        2
    } else {
        1
    }
}

/// A tile, row 0 the greatest y, as one zlib stream. What is beyond the raster is unknown.
fn deflate_tile(raster: &Raster, level: &Level, index: usize) -> io::Result<Vec<u8>> {
    let layer = raster.layer();
    let quantisation = layer.quantisation();
    let (tile_row, tile_column) = (index / level.tile_columns(), index % level.tile_columns());
    let first_row = tile_row * TILE_PIXELS;
    let first_column = tile_column * TILE_PIXELS;
    let columns = first_column..(first_column + TILE_PIXELS).min(level.width);
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let mut codes = Vec::with_capacity(TILE_PIXELS);
    let mut bytes = Vec::new();
    for row in first_row..first_row + TILE_PIXELS {
        codes.clear();
        if row < level.height {
            raster.read_deciding(level.step, row, columns.clone(), &mut codes);
        }
        codes.resize(TILE_PIXELS, UNKNOWN);
        bytes.clear();
        for &code in &codes {
            let value = quantisation.decode(code);
            if is_float(layer) {
                bytes.extend(value.unwrap_or(f32::NAN).to_le_bytes());
            } else {
                bytes.extend((value.unwrap_or(0.0) as i8).to_le_bytes());
            }
        }
        encoder.write_all(&bytes)?;
    }
    encoder.finish()
}

/// A field of a directory, its values in the byte order of the file.
struct Field {
    tag: u16,
    /// Field type (TIFF 6.0, section 2).
    kind: u16,
    count: usize,
    bytes: Vec<u8>,
}

impl Field {
    fn ascii(tag: u16, text: &str) -> Self {
        let bytes = [text.as_bytes(), &[0]].concat();
        Self {
            tag,
            kind: 2,
            count: bytes.len(),
            bytes,
        }
    }

    fn shorts(tag: u16, values: &[u16]) -> Self {
        Self {
            tag,
            kind: 3,
            count: values.len(),
            bytes: values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
        }
    }

    fn longs(tag: u16, values: impl IntoIterator<Item = u32>) -> Self {
        let bytes: Vec<u8> = values.into_iter().flat_map(u32::to_le_bytes).collect();
        Self {
            tag,
            kind: 4,
            count: bytes.len() / 4,
            bytes,
        }
    }

    fn doubles(tag: u16, values: &[f64]) -> Self {
        Self {
            tag,
            kind: 12,
            count: values.len(),
            bytes: values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
        }
    }
}

/// A place in the file.
fn place(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_too_large| {
        io::Error::new(
            io::ErrorKind::FileTooLarge,
            "a TIFF holds at most 4 GiB: map a smaller area or use larger cells",
        )
    })
}

/// Writes the header and a directory for each level, from the start of the file; returns where they end.
fn write_directories(
    writer: &mut impl Write,
    raster: &Raster,
    datum: Option<Datum>,
    levels: &[Level],
) -> io::Result<u32> {
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    for (index, level) in levels.iter().enumerate() {
        let fields = fields_of(raster, datum, level)?;
        // The values stand behind the directory: the number of its fields, the fields, and where the next one is.
        let mut values = Vec::new();
        let values_at = file.len() + 2 + 12 * fields.len() + 4;
        file.extend((fields.len() as u16).to_le_bytes());
        for field in fields {
            file.extend(field.tag.to_le_bytes());
            file.extend(field.kind.to_le_bytes());
            file.extend(place(field.count)?.to_le_bytes());
            let mut bytes = field.bytes;
            if bytes.len() <= 4 {
                bytes.resize(4, 0);
                file.extend(bytes);
            } else {
                file.extend(place(values_at + values.len())?.to_le_bytes());
                bytes.resize(bytes.len().next_multiple_of(2), 0);
                values.extend(bytes);
            }
        }
        let is_last = index + 1 == levels.len();
        let next = if is_last { 0 } else { values_at + values.len() };
        file.extend(place(next)?.to_le_bytes());
        file.extend(values);
    }
    writer.write_all(&file)?;
    place(file.len())
}

/// The fields of a directory in the order of their tags, as the format requires.
fn fields_of(raster: &Raster, datum: Option<Datum>, level: &Level) -> io::Result<Vec<Field>> {
    let layer = raster.layer();
    let is_overview = level.step > 1;
    let bits = if is_float(layer) { 32 } else { 8 };
    let [width, height] = [level.width, level.height].map(place);
    let mut fields = vec![
        Field::longs(tag::NEW_SUBFILE_TYPE, [u32::from(is_overview)]),
        Field::longs(tag::IMAGE_WIDTH, [width?]),
        Field::longs(tag::IMAGE_LENGTH, [height?]),
        Field::shorts(tag::BITS_PER_SAMPLE, &[bits]),
        Field::shorts(tag::COMPRESSION, &[8]), // Deflate
        Field::shorts(tag::PHOTOMETRIC_INTERPRETATION, &[1]), // black is zero
        Field::shorts(tag::SAMPLES_PER_PIXEL, &[1]),
        Field::shorts(tag::TILE_WIDTH, &[TILE_PIXELS as u16]),
        Field::shorts(tag::TILE_LENGTH, &[TILE_PIXELS as u16]),
        Field::longs(tag::TILE_OFFSETS, level.tiles.iter().map(|tile| tile[0])),
        Field::longs(
            tag::TILE_BYTE_COUNTS,
            level.tiles.iter().map(|tile| tile[1]),
        ),
        Field::shorts(tag::SAMPLE_FORMAT, &[sample_format(layer)]),
    ];
    if !is_overview {
        fields.extend(position(raster, datum));
        fields.push(Field::ascii(tag::GDAL_METADATA, &meaning(layer)));
    }
    let no_data = if is_float(layer) { "nan" } else { "0" };
    fields.push(Field::ascii(tag::GDAL_NODATA, no_data));
    Ok(fields)
}

fn position(raster: &Raster, datum: Option<Datum>) -> Vec<Field> {
    let ([x_min_m, _], [_, y_max_m]) = raster.corners_m();
    let cell_m = raster.cell_m();
    let citation = "odom|";
    // Each key: id, location of its value (0 here, else a tag), count, value or place in the tag.
    let here = |id: u16, value: u16| [id, 0, 1, value];
    let double = |id: u16, place: u16| [id, tag::GEO_DOUBLE_PARAMS, 1, place];
    let mut keys = vec![
        here(1024, if datum.is_some() { 1 } else { 32767 }), // GTModelType: projected or user-defined
        here(1025, 1),                                       // GTRasterType: a pixel is an area
        [1026, tag::GEO_ASCII_PARAMS, citation.len() as u16, 0], // GTCitation
    ];
    if datum.is_some() {
        keys.extend([
            here(2048, 4326),  // GeodeticCRS: WGS 84
            here(2054, 9102),  // GeogAngularUnits: degree
            here(3072, 32767), // ProjectedCRS: user-defined
            here(3074, 32767), // Projection: user-defined
            here(3075, 1),     // ProjMethod: Transverse Mercator
        ]);
    }
    keys.push(here(3076, 9001)); // ProjLinearUnits: metre
    if datum.is_some() {
        keys.extend([
            double(3080, 0), // ProjNatOriginLong
            double(3081, 1), // ProjNatOriginLat
            double(3082, 2), // ProjFalseEasting
            double(3083, 3), // ProjFalseNorthing
            double(3092, 4), // ProjScaleAtNatOrigin
        ]);
    }
    // Header: version 1.1.0 and the number of keys.
    keys.insert(0, [1, 1, 0, keys.len() as u16]);
    let mut fields = vec![
        Field::doubles(tag::MODEL_PIXEL_SCALE, &[cell_m, cell_m, 0.0]),
        Field::doubles(tag::MODEL_TIEPOINT, &[0.0, 0.0, 0.0, x_min_m, y_max_m, 0.0]),
        Field::shorts(tag::GEO_KEY_DIRECTORY, keys.as_flattened()),
    ];
    if let Some(datum) = datum {
        // Metres at the datum's altitude are shorter on the ellipsoid.
        let scale = 1.0 + datum.altitude_m / EARTH_M;
        let doubles = [datum.longitude_deg, datum.latitude_deg, 0.0, 0.0, scale];
        fields.push(Field::doubles(tag::GEO_DOUBLE_PARAMS, &doubles));
    }
    fields.push(Field::ascii(tag::GEO_ASCII_PARAMS, citation));
    fields
}

/// Description and unit as GDAL's XML.
fn meaning(layer: LayerId) -> String {
    let classes: Vec<String> = layer
        .classes()
        .iter()
        .map(|class| format!("{} {}", class.value, class.name))
        .collect();
    let meaning = if classes.is_empty() {
        layer.meaning().to_owned()
    } else {
        format!("{}: {}", layer.meaning(), classes.join(", "))
    };
    let unit = layer.unit().map_or_else(String::new, |unit| {
        format!("<Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">{unit}</Item>")
    });
    format!(
        "<GDALMetadata><Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">{meaning}</Item>\
         {unit}</GDALMetadata>"
    )
}
