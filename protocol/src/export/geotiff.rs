//! A raster as `GeoTIFF` (OGC 19-008r4): a layer's values in its sample type, placed in `odom` metres.
//!
//! Row 0 is the greatest y. Coordinates are metres in `odom`. With a datum `odom` is described as a
//! projection of WGS 84: Transverse Mercator about the datum, which differs from the tangent plane by
//! 2 cm at 10 km. UTM would turn the raster by the convergence of meridians, and resample it.
//! Without, the coordinate system is user-defined and local. Values are deflated strip by strip, so
//! memory beside the raster stays at one strip.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use tiff::TiffResult;
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKindStandard};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, SampleFormat, Tag};

use super::ExportError;
use crate::export::write_atomically;
use crate::layer::LayerId;
use crate::message::Datum;
use crate::mosaic::Raster;

type Directory<'a> = DirectoryEncoder<'a, &'a mut BufWriter<File>, TiffKindStandard>;

/// Approximate size of a strip before compression.
const STRIP_BYTES: usize = 256 * 1024;
/// GDAL's tag for item names and units as XML.
const GDAL_METADATA: Tag = Tag::Unknown(42112);

/// Mean radius of the Earth.
const EARTH_M: f64 = 6_371_000.0;

/// Writes `raster` as a `GeoTIFF` with the layer's values. `datum` is where on Earth `odom` is.
pub fn write_geotiff(
    path: &Path,
    raster: &Raster,
    datum: Option<Datum>,
) -> Result<(), ExportError> {
    write_atomically(path, |writer| Ok(encode(writer, raster, datum)?))
}

fn encode(writer: &mut BufWriter<File>, raster: &Raster, datum: Option<Datum>) -> TiffResult<()> {
    let sample_bytes = if is_float(raster.layer()) { 4 } else { 1 };
    let row_bytes = raster.width() * sample_bytes;
    let rows_per_strip = (STRIP_BYTES / row_bytes).clamp(1, raster.height());
    let mut tiff = TiffEncoder::new(writer)?;
    let mut directory = tiff.image_directory()?;

    let mut offsets = Vec::new();
    let mut byte_counts = Vec::new();
    for first_row in (0..raster.height()).step_by(rows_per_strip) {
        let end_row = (first_row + rows_per_strip).min(raster.height());
        let mut strip = deflate_rows(raster, first_row..end_row)?;
        byte_counts.push(u32::try_from(strip.len())?);
        // The next item must start at an even offset.
        if strip.len() % 2 == 1 {
            strip.push(0);
        }
        offsets.push(u32::try_from(directory.write_data(strip.as_slice())?)?);
    }

    directory.write_tag(Tag::ImageWidth, u32::try_from(raster.width())?)?;
    directory.write_tag(Tag::ImageLength, u32::try_from(raster.height())?)?;
    directory.write_tag(Tag::BitsPerSample, 8 * sample_bytes as u16)?;
    directory.write_tag(Tag::SampleFormat, sample_format(raster.layer()).to_u16())?;
    directory.write_tag(Tag::SamplesPerPixel, 1_u16)?;
    directory.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16())?;
    directory.write_tag(
        Tag::PhotometricInterpretation,
        PhotometricInterpretation::BlackIsZero.to_u16(),
    )?;
    directory.write_tag(Tag::RowsPerStrip, u32::try_from(rows_per_strip)?)?;
    directory.write_tag(Tag::StripOffsets, offsets.as_slice())?;
    directory.write_tag(Tag::StripByteCounts, byte_counts.as_slice())?;
    write_position(&mut directory, raster, datum)?;
    write_meaning(&mut directory, raster.layer())?;
    directory.finish()
}

/// Continuous layers are 32-bit floats, NaN for unknown; classes are bytes, 0 for unknown.
fn is_float(layer: LayerId) -> bool {
    layer.classes().is_empty()
}

fn sample_format(layer: LayerId) -> SampleFormat {
    if is_float(layer) {
        SampleFormat::IEEEFP
    } else if layer.classes().iter().any(|class| class.value < 0) {
        SampleFormat::Int
    } else {
        SampleFormat::Uint
    }
}

/// Rows of the file, 0 the greatest y, as one zlib stream of samples in this machine's byte order,
/// which the `tiff` crate writes.
fn deflate_rows(raster: &Raster, file_rows: std::ops::Range<usize>) -> io::Result<Vec<u8>> {
    let quantisation = raster.layer().quantisation();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    let mut codes = Vec::with_capacity(raster.width());
    let mut bytes = Vec::new();
    for file_row in file_rows {
        raster.read_row(raster.height() - 1 - file_row, &mut codes);
        bytes.clear();
        for &code in &codes {
            let value = quantisation.decode(code);
            if is_float(raster.layer()) {
                bytes.extend(value.unwrap_or(f32::NAN).to_ne_bytes());
            } else {
                bytes.extend((value.unwrap_or(0.0) as i8).to_ne_bytes());
            }
        }
        encoder.write_all(&bytes)?;
    }
    encoder.finish()
}

fn write_position(
    directory: &mut Directory<'_>,
    raster: &Raster,
    datum: Option<Datum>,
) -> TiffResult<()> {
    let ([x_min_m, _], [_, y_max_m]) = raster.corners_m();
    let cell_m = raster.cell_m();
    let citation = "odom|";
    // Each key: id, location of its value (0 here, else a tag), count, value or place in the tag.
    let here = |id: u16, value: u16| [id, 0, 1, value];
    let double = |id: u16, place: u16| [id, Tag::GeoDoubleParamsTag.to_u16(), 1, place];
    let mut keys = vec![
        here(1024, if datum.is_some() { 1 } else { 32767 }), // GTModelType: projected or user-defined
        here(1025, 1),                                       // GTRasterType: a pixel is an area
        [
            1026,
            Tag::GeoAsciiParamsTag.to_u16(),
            citation.len() as u16,
            0,
        ], // GTCitation
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
    directory.write_tag(Tag::ModelPixelScaleTag, [cell_m, cell_m, 0.0])?;
    directory.write_tag(
        Tag::ModelTiepointTag,
        [0.0, 0.0, 0.0, x_min_m, y_max_m, 0.0],
    )?;
    directory.write_tag(Tag::GeoKeyDirectoryTag, keys.as_flattened())?;
    if let Some(datum) = datum {
        // Metres at the datum's altitude are shorter on the ellipsoid.
        let scale = 1.0 + datum.altitude_m / EARTH_M;
        let origin = [datum.longitude_deg, datum.latitude_deg];
        let doubles = [origin[0], origin[1], 0.0, 0.0, scale];
        directory.write_tag(Tag::GeoDoubleParamsTag, doubles.as_slice())?;
    }
    directory.write_tag(Tag::GeoAsciiParamsTag, citation)
}

fn write_meaning(directory: &mut Directory<'_>, layer: LayerId) -> TiffResult<()> {
    let no_data = if is_float(layer) { "nan" } else { "0" };
    directory.write_tag(Tag::GdalNodata, no_data)?;

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
    let mut xml = format!(
        "<GDALMetadata><Item name=\"DESCRIPTION\" sample=\"0\" role=\"description\">{meaning}</Item>\
         {unit}</GDALMetadata>"
    );
    // An even length with its terminator, so that the next item starts at an even offset.
    if xml.len() % 2 == 0 {
        xml.push('\n');
    }
    directory.write_tag(GDAL_METADATA, xml.as_str())
}
