//! WGS-84: places on Earth as metres east, north and up of a datum, and back.
//!
//! Geodetic → Earth-centred, Earth-fixed (ECEF) is the definition; back is the closed form of Vermeille (2002),
//! *Direct transformation from geocentric coordinates to geodetic coordinates*, which is exact everywhere
//! but near Earth's centre. East–north–up (ENU) is ECEF, moved and turned to the tangent plane at the datum
//! (REP-103: x east, y north, z up).

use nalgebra::{Matrix3, Point3, Vector3};

/// Semi-major axis, metres (WGS-84, defining).
const SEMI_MAJOR_M: f64 = 6_378_137.0;
/// Flattening (WGS-84, defining).
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// First eccentricity, squared.
const E2: f64 = FLATTENING * (2.0 - FLATTENING);

/// A place by WGS-84.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeodeticPoint {
    /// Degrees, north positive.
    pub latitude_deg: f64,
    /// Degrees, east positive.
    pub longitude_deg: f64,
    /// Metres above the ellipsoid.
    pub altitude_m: f64,
}

/// The plane that touches the ellipsoid's normal at a datum: x east, y north, z up, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalTangentPlane {
    datum: GeodeticPoint,
    datum_in_ecef: Point3<f64>,
    enu_from_ecef: Matrix3<f64>,
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
        let enu_from_ecef = Matrix3::new(
            -sin_lon,
            cos_lon,
            0.0,
            -sin_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lat,
            cos_lat * cos_lon,
            cos_lat * sin_lon,
            sin_lat,
        );
        Self {
            datum,
            datum_in_ecef: ecef_from_geodetic(&datum),
            enu_from_ecef,
        }
    }

    /// Where the origin is.
    pub const fn datum(&self) -> GeodeticPoint {
        self.datum
    }

    /// A place as metres east, north and up of the datum.
    pub fn enu_from_geodetic(&self, place: &GeodeticPoint) -> Point3<f64> {
        let from_datum: Vector3<f64> = ecef_from_geodetic(place) - self.datum_in_ecef;
        Point3::from(self.enu_from_ecef * from_datum)
    }

    /// The place that lies so many metres east, north and up of the datum.
    pub fn geodetic_from_enu(&self, place_in_enu: &Point3<f64>) -> GeodeticPoint {
        let from_datum = self.enu_from_ecef.transpose() * place_in_enu.coords;
        geodetic_from_ecef(&(self.datum_in_ecef + from_datum))
    }
}

/// Metres from Earth's centre: x towards 0° N 0° E, z towards the north pole.
pub fn ecef_from_geodetic(place: &GeodeticPoint) -> Point3<f64> {
    let (latitude_rad, longitude_rad) = (
        place.latitude_deg.to_radians(),
        place.longitude_deg.to_radians(),
    );
    let (sin_lat, cos_lat) = (libm::sin(latitude_rad), libm::cos(latitude_rad));
    // Of the normal, from the ellipsoid down to the axis.
    let normal_m = SEMI_MAJOR_M / libm::sqrt(1.0 - E2 * sin_lat * sin_lat);
    let from_axis_m = (normal_m + place.altitude_m) * cos_lat;
    Point3::new(
        from_axis_m * libm::cos(longitude_rad),
        from_axis_m * libm::sin(longitude_rad),
        (normal_m * (1.0 - E2) + place.altitude_m) * sin_lat,
    )
}

/// The other way; longitude in (−180, 180]. For places farther than 50 km from Earth's centre.
pub fn geodetic_from_ecef(place_in_ecef: &Point3<f64>) -> GeodeticPoint {
    let (x, y, z) = (place_in_ecef.x, place_in_ecef.y, place_in_ecef.z);
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

    #[test]
    fn places_on_the_axes_are_the_ellipsoids_own_radii() {
        let semi_minor_m = 6_356_752.314_245;
        for (place, expected) in [
            (point(0.0, 0.0, 0.0), Point3::new(SEMI_MAJOR_M, 0.0, 0.0)),
            (
                point(0.0, 90.0, 100.0),
                Point3::new(0.0, SEMI_MAJOR_M + 100.0, 0.0),
            ),
            (point(90.0, 0.0, 0.0), Point3::new(0.0, 0.0, semi_minor_m)),
            (
                point(-90.0, 0.0, -5.0),
                Point3::new(0.0, 0.0, 5.0 - semi_minor_m),
            ),
        ] {
            let ecef = ecef_from_geodetic(&place);
            assert!((ecef - expected).norm() < 1e-6, "{place:?}: {ecef}");
        }
    }

    #[test]
    fn one_metre_east_and_north_are_the_arcs_that_geodesy_tables_give() {
        // At 38.5° N: a second of latitude is 30.8350 m, one of longitude 24.2313 m (the usual
        // series of the arcs in cosines of the latitude).
        let plane = LocalTangentPlane::new(point(38.5, -9.1, 50.0));
        let arc_s = 1.0 / 3600.0;
        let high_up = 1.0 + 50.0 / 6.37e6;
        let north = plane.enu_from_geodetic(&point(38.5 + arc_s, -9.1, 50.0));
        let east = plane.enu_from_geodetic(&point(38.5, -9.1 + arc_s, 50.0));
        assert!((north.y / high_up - 30.8350).abs() < 2e-3, "{north}");
        assert!((east.x / high_up - 24.2313).abs() < 2e-3, "{east}");
        assert!(
            north.x.abs() < 1e-6 && east.y.abs() < 1e-3,
            "{north} {east}"
        );
        let up = plane.enu_from_geodetic(&point(38.5, -9.1, 51.0));
        assert!((up - Point3::new(0.0, 0.0, 1.0)).norm() < 1e-8, "{up}");
        // A metre back is the arc's share of a degree.
        let metre = plane.geodetic_from_enu(&Point3::new(1.0, 1.0, 0.0));
        let seconds = |deg: f64| deg * 3600.0;
        let north_s = seconds(metre.latitude_deg - 38.5) * 30.8350 * high_up;
        let east_s = seconds(metre.longitude_deg + 9.1) * 24.2313 * high_up;
        assert!((north_s - 1.0).abs() < 1e-4 && (east_s - 1.0).abs() < 1e-4);
    }

    proptest! {
        #[test]
        fn there_and_back_is_the_same_place(
            latitude_deg in -90.0..=90.0f64, longitude_deg in -180.0..180.0f64,
            altitude_m in -11_000.0..100_000.0f64, enu in prop::array::uniform3(-20_000.0..20_000.0f64),
        ) {
            let datum = point(latitude_deg, longitude_deg, altitude_m);
            let ecef = ecef_from_geodetic(&datum);
            let back = ecef_from_geodetic(&geodetic_from_ecef(&ecef));
            prop_assert!((back - ecef).norm() < 2e-8, "{}", (back - ecef).norm());
            let plane = LocalTangentPlane::new(datum);
            let place = Point3::from(enu);
            let back = plane.enu_from_geodetic(&plane.geodetic_from_enu(&place));
            prop_assert!((back - place).norm() < 2e-8, "{}", (back - place).norm());
        }
    }
}
