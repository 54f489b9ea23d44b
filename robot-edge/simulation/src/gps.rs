//! A satellite receiver: positions on the WGS-84 ellipsoid.

use nalgebra::{Point3, Vector3};

use crate::motion::Motion;
use crate::noise::NoiseStream;
use measurement::GeodeticFix;
use measurement::pose::Pose;

/// A receiver with corrections of its carrier phase (RTK).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpsReceiver {
    pub rate_hz: f64,
    /// Antenna, metres in the base frame.
    pub antenna_m: Point3<f64>,
    /// Standard deviation to the east and to the north, each, unless the world overrides it, metres.
    pub noise_m: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct FixNoise {
    east: NoiseStream,
    north: NoiseStream,
    up: NoiseStream,
}

/// How much worse heights are than horizontal positions: satellites are above only.
const VERTICAL_NOISE: f64 = 2.0;

/// `NavSatStatus::STATUS_GBAS_FIX`: with corrections from the ground.
const STATUS_GBAS_FIX: i8 = 2;

impl FixNoise {
    pub(crate) fn new(seed: u64, sensor: &str) -> Self {
        let stream = |axis: &str| NoiseStream::new(seed, &format!("{sensor}/{axis}"));
        Self {
            east: stream("east"),
            north: stream("north"),
            up: stream("up"),
        }
    }
}

impl GpsReceiver {
    /// Its antenna's place; it has no attitude of its own.
    pub(crate) fn base_from_antenna(&self) -> Pose {
        Pose::translation(self.antenna_m.x, self.antenna_m.y, self.antenna_m.z)
    }

    /// Where it takes its antenna to be at `time_s`, in a world whose frame stands at `datum`. `noise_m` is
    /// horizontal; twice as much is vertical.
    pub(crate) fn fix(
        &self,
        datum: &Datum,
        motion: &Motion,
        time_s: f64,
        noise_m: f64,
        noise: &mut FixNoise,
    ) -> GeodeticFix {
        let error_m = Vector3::new(
            noise.east.normal(),
            noise.north.normal(),
            VERTICAL_NOISE * noise.up.normal(),
        ) * noise_m;
        let antenna_m = motion.world_from_base(time_s) * self.antenna_m;
        let [latitude_deg, longitude_deg, altitude_m] = datum.geodetic(antenna_m + error_m);
        GeodeticFix {
            latitude_deg,
            longitude_deg,
            altitude_m,
            status: STATUS_GBAS_FIX,
            sigma_m: Some(noise_m).filter(|noise_m| *noise_m > 0.0),
        }
    }
}

/// Where on the Earth the world's frame stands: its origin is here, x is east, y is north, z is up off the
/// ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Datum {
    pub(crate) latitude_deg: f64,
    pub(crate) longitude_deg: f64,
    /// Metres above the ellipsoid.
    pub(crate) altitude_m: f64,
}

impl Datum {
    /// Lagoa de Albufeira near Sesimbra, where the boat of the document may have been tested ("a lake near
    /// Sesimbra" \[HYB\] fig. 8.2). Rounded; the surface of the sea lies some 53 m above the ellipsoid there.
    pub(crate) const LAKE: Self = Self {
        latitude_deg: 38.51,
        longitude_deg: -9.17,
        altitude_m: 53.0,
    };

    /// Latitude and longitude in degrees and height in metres of a point in the local tangent plane, metres.
    pub(crate) fn geodetic(&self, in_world_m: Point3<f64>) -> [f64; 3] {
        let [sin_latitude, cos_latitude] = sin_cos(self.latitude_deg.to_radians());
        let [sin_longitude, cos_longitude] = sin_cos(self.longitude_deg.to_radians());
        let east = Vector3::new(-sin_longitude, cos_longitude, 0.0);
        let north = Vector3::new(
            -sin_latitude * cos_longitude,
            -sin_latitude * sin_longitude,
            cos_latitude,
        );
        let up = Vector3::new(
            cos_latitude * cos_longitude,
            cos_latitude * sin_longitude,
            sin_latitude,
        );
        // Along the vertical the ellipsoid's normal reaches the Earth's axis after this much.
        let normal_m = SEMI_MAJOR_M / libm::sqrt(1.0 - ECCENTRICITY2 * sin_latitude * sin_latitude);
        let origin_m = up * (normal_m + self.altitude_m)
            - Vector3::z() * (ECCENTRICITY2 * normal_m * sin_latitude);
        earth_to_geodetic(origin_m + east * in_world_m.x + north * in_world_m.y + up * in_world_m.z)
    }
}

/// WGS-84: equatorial radius and flattening.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const FLATTENING: f64 = 1.0 / 298.257_223_563;
const ECCENTRICITY2: f64 = FLATTENING * (2.0 - FLATTENING);

/// Steps of Bowring's formula; near the Earth's surface the first is already good to a micrometre.
const BOWRING_STEPS: usize = 3;

/// Degrees, degrees and metres of a point in the Earth's own frame [Bowring 1976, "Transformation from
/// spatial to geographical coordinates"].
fn earth_to_geodetic(in_earth_m: Vector3<f64>) -> [f64; 3] {
    let off_axis_m = libm::hypot(in_earth_m.x, in_earth_m.y);
    let semi_minor_m = SEMI_MAJOR_M * (1.0 - FLATTENING);
    let second_eccentricity2 = ECCENTRICITY2 / (1.0 - ECCENTRICITY2);
    let mut parametric_rad = libm::atan2(in_earth_m.z * SEMI_MAJOR_M, off_axis_m * semi_minor_m);
    let mut latitude_rad = 0.0;
    for _ in 0..BOWRING_STEPS {
        let [sin, cos] = sin_cos(parametric_rad);
        latitude_rad = libm::atan2(
            in_earth_m.z + second_eccentricity2 * semi_minor_m * sin * sin * sin,
            off_axis_m - ECCENTRICITY2 * SEMI_MAJOR_M * cos * cos * cos,
        );
        let [sin, cos] = sin_cos(latitude_rad);
        parametric_rad = libm::atan2((1.0 - FLATTENING) * sin, cos);
    }
    let [sin, cos] = sin_cos(latitude_rad);
    // Without a division that fails at a pole.
    let on_ellipsoid_m = SEMI_MAJOR_M * libm::sqrt(1.0 - ECCENTRICITY2 * sin * sin);
    let altitude_m = off_axis_m * cos + in_earth_m.z * sin - on_ellipsoid_m;
    let longitude_rad = libm::atan2(in_earth_m.y, in_earth_m.x);
    [
        latitude_rad.to_degrees(),
        longitude_rad.to_degrees(),
        altitude_m,
    ]
}

fn sin_cos(angle_rad: f64) -> [f64; 2] {
    [libm::sin(angle_rad), libm::cos(angle_rad)]
}

#[cfg(test)]
mod tests {
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
            for (found, (expected, within)) in
                found.iter().zip(expected.iter().zip([1e-9, 1e-9, 1e-4]))
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
    fn degrees_have_their_wgs84_lengths() {
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
}
