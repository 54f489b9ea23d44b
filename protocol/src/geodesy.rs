//! WGS-84: places on Earth as metres east, north and up of a datum, and back (docs/methods.md, section 0).
//!
//! Geodetic to Earth-centred, Earth-fixed (ECEF) is the definition; back is the closed form of Vermeille (2002),
//! *Direct transformation from geocentric coordinates to geodetic coordinates*. East-north-up (ENU) is ECEF, moved
//! and turned to the tangent plane at the datum (REP-103).

/// Semi-major axis, metres (WGS-84, defining).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening (WGS-84, defining).
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity, squared.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A place on Earth by WGS-84; as [`Datum`](crate::message::Datum), the origin of `odom`.
pub type GeodeticPoint = crate::message::Datum;

/// The tangent plane at a datum: x east, y north, z up, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalTangentPlane {
    datum: GeodeticPoint,
    datum_in_ecef: [f64; 3],
    /// Rows of the rotation matrix.
    enu_from_ecef: [[f64; 3]; 3],
}

impl LocalTangentPlane {
    /// With its origin at `datum`.
    pub fn new(datum: GeodeticPoint) -> Self {
        let (latitude_rad, longitude_rad) = (
            datum.latitude_deg.to_radians(),
            datum.longitude_deg.to_radians(),
        );
        let (sin_lat, cos_lat) = (libm::sin(latitude_rad), libm::cos(latitude_rad));
        let (sin_lon, cos_lon) = (libm::sin(longitude_rad), libm::cos(longitude_rad));
        Self {
            datum,
            datum_in_ecef: ecef_from_geodetic(&datum),
            enu_from_ecef: [
                [-sin_lon, cos_lon, 0.0],
                [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
            ],
        }
    }

    /// The place of the origin.
    pub const fn datum(&self) -> GeodeticPoint {
        self.datum
    }

    /// Metres east, north and up of the datum.
    pub fn enu_from_geodetic(&self, place: &GeodeticPoint) -> [f64; 3] {
        let ecef = ecef_from_geodetic(place);
        let from_datum: [f64; 3] =
            std::array::from_fn(|axis| ecef[axis] - self.datum_in_ecef[axis]);
        self.enu_from_ecef
            .map(|row| row[0] * from_datum[0] + row[1] * from_datum[1] + row[2] * from_datum[2])
    }

    /// The place that is so many metres east, north and up of the datum.
    pub fn geodetic_from_enu(&self, enu: [f64; 3]) -> GeodeticPoint {
        let [east, north, up] = self.enu_from_ecef;
        geodetic_from_ecef(std::array::from_fn(|axis| {
            let from_datum = east[axis] * enu[0] + north[axis] * enu[1] + up[axis] * enu[2];
            self.datum_in_ecef[axis] + from_datum
        }))
    }
}

/// Metres from Earth's centre: x towards 0° N 0° E, z towards the north pole.
fn ecef_from_geodetic(place: &GeodeticPoint) -> [f64; 3] {
    let (latitude_rad, longitude_rad) = (
        place.latitude_deg.to_radians(),
        place.longitude_deg.to_radians(),
    );
    let (sin_lat, cos_lat) = (libm::sin(latitude_rad), libm::cos(latitude_rad));
    // Length of the normal, from the ellipsoid to Earth's axis.
    let normal_m = SEMI_MAJOR_M / libm::sqrt(1.0 - E2 * sin_lat * sin_lat);
    let from_axis_m = (normal_m + place.altitude_m) * cos_lat;
    [
        from_axis_m * libm::cos(longitude_rad),
        from_axis_m * libm::sin(longitude_rad),
        (normal_m * (1.0 - E2) + place.altitude_m) * sin_lat,
    ]
}

/// Inverse of [`ecef_from_geodetic`], for places farther than 50 km from Earth's centre; longitude in (−180, 180].
///
/// The names are those of Vermeille (2002).
fn geodetic_from_ecef([x, y, z]: [f64; 3]) -> GeodeticPoint {
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
    let to_place_m = libm::hypot(d_m, z);
    GeodeticPoint {
        latitude_deg: (2.0 * libm::atan2(z, d_m + to_place_m)).to_degrees(),
        longitude_deg: libm::atan2(y, x).to_degrees(),
        altitude_m: (k + E2 - 1.0) / k * to_place_m,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> GeodeticPoint {
        GeodeticPoint {
            latitude_deg,
            longitude_deg,
            altitude_m,
        }
    }

    fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
        let squares: [f64; 3] = std::array::from_fn(|axis| (a[axis] - b[axis]).powi(2));
        libm::sqrt(squares.iter().sum())
    }

    #[test]
    fn axes_give_the_radii_of_the_ellipsoid() {
        let semi_minor_m = 6_356_752.314_245;
        for (place, expected) in [
            (point(0.0, 0.0, 0.0), [SEMI_MAJOR_M, 0.0, 0.0]),
            (point(0.0, 90.0, 100.0), [0.0, SEMI_MAJOR_M + 100.0, 0.0]),
            (point(90.0, 0.0, 0.0), [0.0, 0.0, semi_minor_m]),
            (point(-90.0, 0.0, -5.0), [0.0, 0.0, 5.0 - semi_minor_m]),
        ] {
            assert!(
                distance(ecef_from_geodetic(&place), expected) < 1e-6,
                "{place:?}"
            );
        }
    }

    #[test]
    fn a_hundred_metres_are_the_arcs_of_geodesy_tables() {
        // Lengths of a degree of latitude and of longitude, by the series
        // 111132.954 − 559.822 cos 2φ + 1.175 cos 4φ and 111412.84 cos φ − 93.5 cos 3φ + 0.118 cos 5φ
        // metres: good to a centimetre in a kilometre.
        for (latitude_deg, longitude_deg) in
            [(38.5, -9.1), (-33.0, 151.2), (0.0, 0.0), (68.0, 20.0)]
        {
            let datum = point(latitude_deg, longitude_deg, 0.0);
            let plane = LocalTangentPlane::new(datum);
            let phi = f64::to_radians(latitude_deg);
            let north_m =
                111_132.954 - 559.822 * libm::cos(2.0 * phi) + 1.175 * libm::cos(4.0 * phi);
            let east_m = 111_412.84 * libm::cos(phi) - 93.5 * libm::cos(3.0 * phi)
                + 0.118 * libm::cos(5.0 * phi);
            let east = plane.geodetic_from_enu([100.0, 0.0, 0.0]);
            let error_m = (east.longitude_deg - longitude_deg) * east_m - 100.0;
            assert!(error_m.abs() < 1e-3, "east at {latitude_deg}: {error_m}");
            assert!((east.latitude_deg - latitude_deg).abs() * north_m < 2e-3);
            let north = plane.geodetic_from_enu([0.0, 100.0, 0.0]);
            let error_m = (north.latitude_deg - latitude_deg) * north_m - 100.0;
            assert!(error_m.abs() < 1e-3, "north at {latitude_deg}: {error_m}");
            assert!((north.longitude_deg - longitude_deg).abs() * east_m < 1e-6);
        }
    }

    proptest! {
        #[test]
        fn conversions_are_inverses(
            latitude_deg in -90.0..=90.0f64, longitude_deg in -180.0..180.0f64,
            altitude_m in -11_000.0..100_000.0f64, enu in prop::array::uniform3(-20_000.0..20_000.0f64),
        ) {
            let datum = point(latitude_deg, longitude_deg, altitude_m);
            let ecef = ecef_from_geodetic(&datum);
            let back = ecef_from_geodetic(&geodetic_from_ecef(ecef));
            prop_assert!(distance(back, ecef) < 2e-8);
            let plane = LocalTangentPlane::new(datum);
            let back = plane.enu_from_geodetic(&plane.geodetic_from_enu(enu));
            prop_assert!(distance(back, enu) < 2e-8);
        }
    }
}
