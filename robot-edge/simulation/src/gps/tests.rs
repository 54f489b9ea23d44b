use nalgebra::Vector2;
use proptest::prelude::*;

use super::*;

/// In the Earth's frame, by the definition of geodetic coordinates.
fn earth(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Vector3<f64> {
    let [sin_latitude, cos_latitude] = sin_cos(latitude_deg.to_radians());
    let [sin_longitude, cos_longitude] = sin_cos(longitude_deg.to_radians());
    let eccentricity2 = 0.006_694_379_990_141_316;
    let normal_m = 6_378_137.0 / libm::sqrt(1.0 - eccentricity2 * sin_latitude * sin_latitude);
    Vector3::new(
        (normal_m + altitude_m) * cos_latitude * cos_longitude,
        (normal_m + altitude_m) * cos_latitude * sin_longitude,
        (normal_m * (1.0 - eccentricity2) + altitude_m) * sin_latitude,
    )
}

#[test]
fn known_points_of_the_earth() {
    let check = |in_earth_m: [f64; 3], expected: [f64; 3]| {
        let found = earth_to_geodetic(in_earth_m.into());
        for (found, (expected, within)) in found.iter().zip(expected.iter().zip([1e-9, 1e-9, 1e-4]))
        {
            assert!((found - expected).abs() < within, "{found} {expected}");
        }
    };
    check([6_378_137.0, 0.0, 0.0], [0.0, 0.0, 0.0]);
    check([0.0, 6_378_237.0, 0.0], [0.0, 90.0, 100.0]);
    check([0.0, 0.0, 6_356_752.314_245], [90.0, 0.0, 0.0]);
    check([0.0, 0.0, -6_356_742.314_245], [-90.0, 0.0, -10.0]);
}

#[test]
fn a_degree_of_the_equator_and_of_the_meridian_have_their_lengths() {
    let datum = Datum {
        latitude_deg: 0.0,
        longitude_deg: 0.0,
        altitude_m: 0.0,
    };
    // 111,319.49 m and 110,574.28 m a degree at the equator; a metre is too little for its curvature.
    let [latitude_deg, longitude_deg, altitude_m] = datum.geodetic(Point3::new(1.0, 1.0, 0.0));
    assert!((longitude_deg * 111_319.490_8 - 1.0).abs() < 1e-6);
    assert!(
        (latitude_deg * 110_574.275_8 - 1.0).abs() < 1e-5,
        "{latitude_deg}"
    );
    assert!(altitude_m.abs() < 1e-6);
    // The tangent plane leaves the sea: a kilometre out by 7.8 cm.
    let [.., altitude_m] = Datum::LAKE.geodetic(Point3::new(1000.0, 0.0, 0.0));
    assert!((altitude_m - 53.0783).abs() < 2e-4, "{altitude_m}");
}

proptest! {
    #[test]
    fn a_fix_back_in_the_plane_is_the_point(
        latitude_deg in -90.0..90.0_f64,
        longitude_deg in -180.0..180.0_f64,
        x in -20e3..20e3_f64, y in -20e3..20e3_f64, z in -100.0..3000.0_f64,
    ) {
        let datum = Datum { latitude_deg, longitude_deg, altitude_m: 50.0 };
        let [fix_latitude_deg, fix_longitude_deg, fix_altitude_m] = datum.geodetic(Point3::new(x, y, z));
        let from_datum_m = earth(fix_latitude_deg, fix_longitude_deg, fix_altitude_m)
            - earth(latitude_deg, longitude_deg, 50.0);
        // Distances and heights first, which no choice of axes can hide.
        prop_assert!((from_datum_m.norm() - Vector3::new(x, y, z).norm()).abs() < 1e-6);
        let [sin, cos] = sin_cos(longitude_deg.to_radians());
        let outward_m = from_datum_m.xy().dot(&Vector2::new(cos, sin));
        let east_m = from_datum_m.xy().dot(&Vector2::new(-sin, cos));
        let [sin, cos] = sin_cos(latitude_deg.to_radians());
        let north_m = from_datum_m.z * cos - outward_m * sin;
        let up_m = from_datum_m.z * sin + outward_m * cos;
        let error_m = (Vector3::new(east_m, north_m, up_m) - Vector3::new(x, y, z)).norm();
        prop_assert!(error_m < 1e-6, "{error_m}");
    }
}
