//! WGS-84: where on Earth a point of `odom` is.
//!
//! East, north and up of the datum are turned into Earth-centred, Earth-fixed coordinates (ECEF), and those back
//! into latitude and longitude by the closed form of Vermeille (2002), *Direct transformation from geocentric
//! coordinates to geodetic coordinates*.

use crate::message::Datum;

/// Semi-major axis, metres (WGS-84, defining).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening (WGS-84, defining).
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity, squared.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// The plane that touches Earth at a datum: x east, y north, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TangentPlane {
    datum_in_ecef_m: [f64; 3],
    /// Sine and cosine of the datum's latitude and longitude.
    latitude: (f64, f64),
    longitude: (f64, f64),
}

impl TangentPlane {
    /// With its origin at `datum`.
    pub fn new(datum: &Datum) -> Self {
        let latitude = libm::sincos(datum.latitude_deg.to_radians());
        let longitude = libm::sincos(datum.longitude_deg.to_radians());
        // Along the normal, from the ellipsoid down to the axis.
        let normal_m = SEMI_MAJOR_M / libm::sqrt(1.0 - E2 * latitude.0 * latitude.0);
        let from_axis_m = (normal_m + datum.altitude_m) * latitude.1;
        Self {
            datum_in_ecef_m: [
                from_axis_m * longitude.1,
                from_axis_m * longitude.0,
                (normal_m * (1.0 - E2) + datum.altitude_m) * latitude.0,
            ],
            latitude,
            longitude,
        }
    }

    /// Latitude and longitude, degrees, of a point of the plane: metres east and north of the datum. Longitude
    /// is in (−180, 180].
    pub fn geodetic_deg(&self, [east_m, north_m]: [f64; 2]) -> [f64; 2] {
        let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (self.latitude, self.longitude);
        let [datum_x, datum_y, datum_z] = self.datum_in_ecef_m;
        geodetic_deg_from_ecef([
            datum_x - sin_lon * east_m - sin_lat * cos_lon * north_m,
            datum_y + cos_lon * east_m - sin_lat * sin_lon * north_m,
            datum_z + cos_lat * north_m,
        ])
    }
}

/// For places farther than 50 km from Earth's centre.
fn geodetic_deg_from_ecef([x, y, z]: [f64; 3]) -> [f64; 2] {
    let from_axis_m = libm::hypot(x, y);
    let p = from_axis_m * from_axis_m / (SEMI_MAJOR_M * SEMI_MAJOR_M);
    let q = (1.0 - E2) * z * z / (SEMI_MAJOR_M * SEMI_MAJOR_M);
    let r = (p + q - E2 * E2) / 6.0;
    let s = E2 * E2 * p * q / (4.0 * r * r * r);
    let t = libm::cbrt(1.0 + s + libm::sqrt(s * (2.0 + s)));
    let u = r * (1.0 + t + 1.0 / t);
    let v = libm::sqrt(u * u + E2 * E2 * q);
    let w = E2 * (u + v - q) / (2.0 * v);
    let k = libm::sqrt(u + v + w * w) - w;
    let d_m = k * from_axis_m / (k + E2);
    let latitude_rad = 2.0 * libm::atan2(z, d_m + libm::hypot(d_m, z));
    [latitude_rad.to_degrees(), libm::atan2(y, x).to_degrees()]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn datum(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Datum {
        Datum {
            latitude_deg,
            longitude_deg,
            altitude_m,
        }
    }

    fn seconds(deg: f64) -> f64 {
        deg * 3600.0
    }

    #[test]
    fn a_hundred_metres_are_the_arcs_that_geodesy_tables_give() {
        // Lengths of a second of latitude and of longitude on the ellipsoid, by the series
        // 111132.954 − 559.822 cos 2φ + 1.175 cos 4φ and 111412.84 cos φ − 93.5 cos 3φ + 0.118 cos 5φ
        // metres a degree: good to a centimetre in a kilometre.
        for (latitude_deg, longitude_deg) in
            [(38.5, -9.1), (-33.0, 151.2), (0.0, 0.0), (68.0, 20.0)]
        {
            let plane = TangentPlane::new(&datum(latitude_deg, longitude_deg, 0.0));
            let phi = f64::to_radians(latitude_deg);
            let north_m = (111_132.954 - 559.822 * libm::cos(2.0 * phi)
                + 1.175 * libm::cos(4.0 * phi))
                / 3600.0;
            let east_m = (111_412.84 * libm::cos(phi) - 93.5 * libm::cos(3.0 * phi)
                + 0.118 * libm::cos(5.0 * phi))
                / 3600.0;
            let [lat, lon] = plane.geodetic_deg([100.0, 0.0]);
            let error_m = seconds(lon - longitude_deg) * east_m - 100.0;
            assert!(error_m.abs() < 1e-3, "east at {latitude_deg}: {error_m}");
            assert!(seconds(lat - latitude_deg).abs() * north_m < 2e-3);
            let [lat, lon] = plane.geodetic_deg([0.0, 100.0]);
            let error_m = seconds(lat - latitude_deg) * north_m - 100.0;
            assert!(error_m.abs() < 1e-3, "north at {latitude_deg}: {error_m}");
            assert!(seconds(lon - longitude_deg).abs() * east_m < 1e-6);
        }
    }

    proptest! {
        /// The other direction is the definition of WGS-84; a place and its point of the plane must agree to 1 mm.
        #[test]
        fn there_and_back_is_the_same_place(
            latitude_deg in -89.9..=89.9f64, longitude_deg in -180.0..180.0f64,
            altitude_m in -400.0..5_000.0f64, east_m in -2_000.0..2_000.0f64, north_m in -2_000.0..2_000.0f64,
        ) {
            let datum = datum(latitude_deg, longitude_deg, altitude_m);
            let plane = TangentPlane::new(&datum);
            let [lat, lon] = plane.geodetic_deg([east_m, north_m]);
            let at_origin = plane.geodetic_deg([0.0; 2]);
            prop_assert!((at_origin[0] - latitude_deg).abs() < 1e-9);
            // The plane leaves the ellipsoid: a point of it is so much higher than the datum.
            let above_m = (east_m * east_m + north_m * north_m) / (2.0 * 6.37e6);
            let there = TangentPlane::new(&Datum { latitude_deg: lat, longitude_deg: lon, altitude_m: altitude_m + above_m });
            let offset: [f64; 3] = std::array::from_fn(|i| there.datum_in_ecef_m[i] - plane.datum_in_ecef_m[i]);
            let ((sin_lat, cos_lat), (sin_lon, cos_lon)) = (plane.latitude, plane.longitude);
            let east = -sin_lon * offset[0] + cos_lon * offset[1];
            let north = -sin_lat * cos_lon * offset[0] - sin_lat * sin_lon * offset[1] + cos_lat * offset[2];
            prop_assert!((east - east_m).abs() < 1e-3 && (north - north_m).abs() < 1e-3, "{east} {north}");
        }
    }
}
