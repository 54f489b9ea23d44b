//! What the `GeoJSON` files (RFC 7946) share: one feature per line.
//!
//! RFC 7946 allows WGS-84 coordinates only. Without a GNSS fix the coordinates are metres in
//! `odom`, which the foreign member `coordinate_reference` states, and for programs a local `crs` by
//! name (`GeoJSON` 2008, section 3.1), as in the `GeoTIFFs`: without it GDAL takes metres for degrees.

use std::io::{self, Write};

use serde::Serialize;

use crate::geodesy::LocalTangentPlane;
use crate::message::Datum;

const ON_EARTH: &str = r#""coordinate_reference":"WGS-84: longitude and latitude in degrees""#;
const IN_ODOM: &str = r#""crs":{"type":"name","properties":{"name":"LOCAL_CS[\"odom\",UNIT[\"metre\",1]]"}},
"coordinate_reference":"NOT WGS-84: x and y in metres in odom, because there was no satellite fix""#;

#[derive(Serialize)]
pub(super) struct Feature<P> {
    r#type: &'static str,
    geometry: Geometry,
    properties: P,
}

#[derive(Serialize)]
#[serde(tag = "type", content = "coordinates")]
pub(super) enum Geometry {
    Point([f64; 2]),
    LineString(Vec<[f64; 2]>),
    /// One outer ring, counter-clockwise and closed.
    Polygon([Vec<[f64; 2]>; 1]),
}

impl<P> Feature<P> {
    pub(super) fn new(geometry: Geometry, properties: P) -> Self {
        Self {
            r#type: "Feature",
            geometry,
            properties,
        }
    }
}

/// Converts points of `odom` to coordinates.
pub(super) struct Projection(Option<LocalTangentPlane>);

impl Projection {
    pub(super) fn new(datum: Option<Datum>) -> Self {
        Self(datum.map(LocalTangentPlane::new))
    }

    pub(super) fn is_on_earth(&self) -> bool {
        self.0.is_some()
    }

    /// Degrees to 10⁻⁸ (a millimetre); metres to a millimetre.
    pub(super) fn coordinates(&self, point_m: [f64; 2]) -> [f64; 2] {
        match &self.0 {
            Some(plane) => {
                let place = plane.geodetic_from_enu([point_m[0], point_m[1], 0.0]);
                [place.longitude_deg, place.latitude_deg].map(|deg| rounded(deg, 1e8))
            }
            None => point_m.map(|m| rounded(m, 1e3)),
        }
    }

    /// Begins a collection with its foreign `members`, each with a comma at its end.
    pub(super) fn begin(&self, writer: &mut impl Write, members: &str) -> io::Result<()> {
        let reference = if self.is_on_earth() {
            ON_EARTH
        } else {
            IN_ODOM
        };
        write!(
            writer,
            "{{\"type\":\"FeatureCollection\",\n\
             {reference},\n\
             {members}\"features\":["
        )
    }
}

/// Writes features behind a `separator`, which changes with the first one.
pub(super) fn write_features<P: Serialize>(
    writer: &mut impl Write,
    features: impl IntoIterator<Item = Feature<P>>,
    separator: &mut &str,
) -> io::Result<()> {
    for feature in features {
        write!(writer, "{separator}{}", serde_json::to_string(&feature)?)?;
        *separator = ",\n";
    }
    Ok(())
}

/// A number with so many steps per unit.
pub(super) fn rounded(number: f64, per_unit: f64) -> f64 {
    let rounded = (number * per_unit).round() / per_unit;
    // No minus sign at zero.
    rounded + 0.0
}
