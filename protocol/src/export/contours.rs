//! Depth contours as `GeoJSON`.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::geojson::{Feature, Geometry, Projection, write_features};
use super::{ExportError, write_atomically};
use crate::contours::contours;
use crate::message::Datum;
use crate::mosaic::Raster;

#[derive(Serialize)]
struct ContourProperties {
    kind: &'static str,
    /// Below the water level, metres.
    depth_m: f32,
}

/// Writes the lines of equal depth through `raster` to `depth.geojson` in `dir`; returns its path.
///
/// The deeper water is on the left of a line. Equal rasters give equal bytes.
pub fn write_contours(
    dir: &Path,
    raster: &Raster,
    datum: Option<Datum>,
) -> Result<PathBuf, ExportError> {
    let projection = Projection::new(datum);
    let features = contours(raster).into_iter().map(|contour| {
        let points = contour.points.iter();
        let line = points.map(|cells| projection.coordinates(cells.map(|n| n * raster.cell_m())));
        let properties = ContourProperties {
            kind: "depth contour",
            depth_m: contour.depth_m,
        };
        Feature::new(Geometry::LineString(line.collect()), properties)
    });
    let path = dir.join("depth.geojson");
    write_atomically(&path, |writer| {
        projection.begin(writer, "\"depths\":\"metres below the water level\",\n")?;
        write_features(writer, features, &mut "\n")?;
        Ok(writer.write_all(b"\n]}\n")?)
    })?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::super::tests::raster_of;
    use super::*;
    use crate::layer::LayerId;

    fn collection(datum: Option<Datum>) -> Value {
        // Deeper towards y, from cell (−20, −10).
        let raster = raster_of(LayerId::Depth, 0.5, 40, 40, |_, y| 1 + 176 + 10 * y as u16);
        let dir = tempfile::tempdir().unwrap();
        let path = write_contours(dir.path(), &raster, datum).unwrap();
        assert!(path.ends_with("depth.geojson"));
        serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
    }

    #[test]
    fn contours_are_lines_with_their_depth() {
        let read = collection(None);
        let features = read["features"].as_array().unwrap();
        let depths: Vec<_> = features
            .iter()
            .map(|feature| feature["properties"]["depth_m"].as_f64().unwrap())
            .collect();
        assert_eq!(depths, [2.0, 3.0, 4.0, 5.0]);
        let three = &features[1];
        assert_eq!(three["geometry"]["type"], "LineString");
        assert_eq!(three["properties"]["kind"], "depth contour");
        let line = three["geometry"]["coordinates"].as_array().unwrap();
        // 1.76 m + 0.1 m a cell of 0.5 m reaches 3 m at 12.4 cells: 6.45 m from the lowest edge.
        assert_eq!(line.len(), 40);
        // Eastwards, with the deeper water on the left.
        assert_eq!(line[0], json!([-9.75, 1.45]));
        assert_eq!(line[39], json!([9.75, 1.45]));
        let reference = read["coordinate_reference"].as_str().unwrap();
        assert!(reference.starts_with("NOT WGS-84"), "{reference}");
    }

    #[test]
    fn with_a_fix_they_are_on_earth() {
        let read = collection(Some(Datum {
            latitude_deg: 38.5,
            longitude_deg: -9.1,
            altitude_m: 0.0,
        }));
        let place = &read["features"][1]["geometry"]["coordinates"][39];
        // A second is 24.2313 m of longitude and 30.8350 m of latitude.
        let expected = [
            -9.1 + 9.75 / 24.2313 / 3600.0,
            38.5 + 1.45 / 30.8350 / 3600.0,
        ];
        for (axis, expected) in expected.into_iter().enumerate() {
            let error_deg = place[axis].as_f64().unwrap() - expected;
            assert!(error_deg.abs() < 1e-8, "{place}");
        }
    }
}
