//! Poses in the TUM format, for `evo` and other trajectory tools, and their path as `GeoJSON`.

use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::ExportError;
use super::geojson::{Feature, Geometry, Projection, write_features};
use crate::export::write_atomically;
use crate::message::Datum;

/// Steps of [`StampedPose::position`] per metre: 0.1 µm.
const PER_M: f64 = 1e7;
/// Steps of [`StampedPose::quaternion_xyzw`] per 1: 10⁻⁹.
const PER_ONE: f64 = 1e9;

/// Pose of the vehicle in `odom` at a sensor stamp, quantised as in files and messages, so that
/// console and vehicle write the same bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StampedPose {
    /// Nanoseconds since the epoch of the clock that stamped the data.
    pub stamp_ns: i64,
    /// Position of `base_link`: x, y, z, 0.1 µm.
    position: [i64; 3],
    /// Orientation of `base_link`: x, y, z, w, 10⁻⁹.
    quaternion_xyzw: [i64; 4],
}

impl StampedPose {
    /// `base_link` at `position_m` (metres in `odom`), rotated by a unit quaternion (x, y, z, w).
    pub fn new(stamp_ns: i64, position_m: [f64; 3], quaternion_xyzw: [f64; 4]) -> Self {
        // NaN becomes 0; too large values saturate.
        Self {
            stamp_ns,
            position: position_m.map(|m| (m * PER_M).round() as i64),
            quaternion_xyzw: quaternion_xyzw.map(|part| (part * PER_ONE).round() as i64),
        }
    }

    /// Position of `base_link`, metres in `odom`.
    pub fn position_m(&self) -> [f64; 3] {
        self.position.map(|steps| steps as f64 / PER_M)
    }

    /// Orientation of `base_link`: x, y, z, w.
    pub fn quaternion_xyzw(&self) -> [f64; 4] {
        self.quaternion_xyzw.map(|steps| steps as f64 / PER_ONE)
    }

    /// Heading of `base_link` in `odom`, counter-clockwise from x, radians.
    pub fn yaw_rad(&self) -> f64 {
        let [x, y, z, w] = self.quaternion_xyzw();
        libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    }

    /// Stamp, position and quaternion for messages.
    pub(crate) const fn to_row(self) -> [i64; 8] {
        let ([x, y, z], [qx, qy, qz, qw]) = (self.position, self.quaternion_xyzw);
        [self.stamp_ns, x, y, z, qx, qy, qz, qw]
    }

    pub(crate) const fn from_row([stamp_ns, x, y, z, qx, qy, qz, qw]: [i64; 8]) -> Self {
        Self {
            stamp_ns,
            position: [x, y, z],
            quaternion_xyzw: [qx, qy, qz, qw],
        }
    }
}

/// Writes one line per pose: `stamp_s tx ty tz qx qy qz qw`.
///
/// Stamps have nanoseconds, positions 0.1 µm, quaternions 10⁻⁹.
pub fn write_trajectory(
    path: &Path,
    poses: impl IntoIterator<Item = StampedPose>,
) -> Result<(), ExportError> {
    write_atomically(path, |writer| {
        for pose in poses {
            write_line(writer, pose)?;
        }
        Ok(())
    })
}

#[derive(Serialize)]
struct PathProperties {
    kind: &'static str,
    /// Seconds since the epoch of the clock that stamped the data.
    first_stamp_s: f64,
    last_stamp_s: f64,
}

/// Writes the path of the vehicle as one line to `trajectory.geojson` in `dir`; returns its path. A vehicle that has not
/// moved a millimetre is a point; no poses are an empty collection.
pub fn write_path(
    dir: &Path,
    poses: &[StampedPose],
    datum: Option<Datum>,
) -> Result<PathBuf, ExportError> {
    let projection = Projection::new(datum);
    let mut line: Vec<[f64; 2]> = poses
        .iter()
        .map(|pose| {
            let [x_m, y_m, _] = pose.position_m();
            projection.coordinates([x_m, y_m])
        })
        .collect();
    line.dedup();
    let geometry = match line[..] {
        [only] => Geometry::Point(only),
        _ => Geometry::LineString(line),
    };
    let feature = poses.first().zip(poses.last()).map(|(first, last)| {
        let [first_stamp_s, last_stamp_s] =
            [first, last].map(|pose| (pose.stamp_ns as f64 / 1e6).round() / 1e3);
        let properties = PathProperties {
            kind: "path",
            first_stamp_s,
            last_stamp_s,
        };
        Feature::new(geometry, properties)
    });
    let path = dir.join("trajectory.geojson");
    write_atomically(&path, |writer| {
        projection.begin(writer, "")?;
        write_features(writer, feature, &mut "\n")?;
        Ok(writer.write_all(b"\n]}\n")?)
    })?;
    Ok(path)
}

/// Writes one line per pose: its stamp, s, and `xx xy x_yaw yy y_yaw yaw_yaw` of the covariance of x, y (m) and yaw (rad) in the frame
/// of `base_link`. Rows: nanoseconds, and the six.
pub fn write_covariances(
    path: &Path,
    rows: impl IntoIterator<Item = (i64, [f64; 6])>,
) -> Result<(), ExportError> {
    write_atomically(path, |writer| {
        for (stamp_ns, parts) in rows {
            write_steps(writer, stamp_ns, 9)?;
            for part in parts {
                write!(writer, " {part:e}")?;
            }
            writeln!(writer)?;
        }
        Ok(())
    })
}

fn write_line(writer: &mut impl Write, pose: StampedPose) -> std::io::Result<()> {
    write_steps(writer, pose.stamp_ns, 9)?;
    for steps in pose.position {
        write!(writer, " ")?;
        write_steps(writer, steps, 7)?;
    }
    for steps in pose.quaternion_xyzw {
        write!(writer, " ")?;
        write_steps(writer, steps, 9)?;
    }
    writeln!(writer)
}

/// Writes a number in steps of 10^-`digits`.
fn write_steps(writer: &mut impl Write, steps: i64, digits: usize) -> std::io::Result<()> {
    let sign = if steps < 0 { "-" } else { "" };
    let one = 10u64.pow(digits as u32);
    let (whole, rest) = (steps.unsigned_abs() / one, steps.unsigned_abs() % one);
    write!(writer, "{sign}{whole}.{rest:0digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_keep_their_nanoseconds() {
        let pose = |stamp_ns| StampedPose::new(stamp_ns, [1.5, -2.0, 0.25], [0.0, 0.0, -0.6, 0.8]);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("trajectory.tum");
        write_trajectory(&path, [1_700_000_000_000_000_001, -5].map(pose)).unwrap();
        assert_eq!(
            std::fs::read_to_string(path).unwrap(),
            "1700000000.000000001 1.5000000 -2.0000000 0.2500000 0.000000000 0.000000000 -0.600000000 0.800000000\n\
             -0.000000005 1.5000000 -2.0000000 0.2500000 0.000000000 0.000000000 -0.600000000 0.800000000\n"
        );
    }

    #[test]
    fn path_is_one_line_without_standing() {
        let pose = |secs, x_m, y_m| {
            let stamp_ns = secs * 1_000_000_000_i64 + 250_000_000;
            StampedPose::new(stamp_ns, [x_m, y_m, 7.0], [0.0, 0.0, 0.0, 1.0])
        };
        let dir = tempfile::tempdir().unwrap();
        let feature = |poses: &[StampedPose], datum| -> serde_json::Value {
            let path = write_path(dir.path(), poses, datum).unwrap();
            assert!(path.ends_with("trajectory.geojson"));
            let json: serde_json::Value =
                serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
            assert_eq!(json.get("crs").is_some(), datum.is_none(), "{json}");
            json["features"][0].clone()
        };
        let poses = [
            pose(10, 0.0, 0.0),
            pose(11, 0.0001, 0.0),
            pose(12, 10.0, 20.0),
        ];
        let found = feature(&poses, None);
        let place = &found["geometry"];
        assert_eq!(place["type"], "LineString");
        let line = serde_json::json!([[0.0, 0.0], [10.0, 20.0]]);
        assert_eq!(place["coordinates"], line);
        let properties =
            serde_json::json!({"kind": "path", "first_stamp_s": 10.25, "last_stamp_s": 12.25});
        assert_eq!(found["properties"], properties);
        assert_eq!(feature(&poses[..2], None)["geometry"]["type"], "Point");
        assert!(feature(&[], None).is_null());
        let datum = Datum {
            latitude_deg: 38.5,
            longitude_deg: -9.1,
            altitude_m: 0.0,
        };
        let found = feature(&poses, Some(datum));
        let end = &found["geometry"]["coordinates"][1];
        // A second is 24.2313 m of longitude and 30.8350 m of latitude.
        let expected = [
            -9.1 + 10.0 / 24.2313 / 3600.0,
            38.5 + 20.0 / 30.8350 / 3600.0,
        ];
        for (axis, expected) in expected.into_iter().enumerate() {
            assert!(
                (end[axis].as_f64().unwrap() - expected).abs() < 1e-8,
                "{end}"
            );
        }
    }

    #[test]
    fn poses_are_quantised_equally_in_files_and_messages() {
        let pose = StampedPose::new(
            0,
            [1.234_567_89, -1e-9, f64::NAN],
            [1.0 / 3.0, 0.0, -0.5e-9, 2.0],
        );
        assert_eq!(
            pose.to_row(),
            [0, 12_345_679, 0, 0, 333_333_333, 0, -1, 2_000_000_000]
        );
        assert_eq!(StampedPose::from_row(pose.to_row()), pose);
        let far = StampedPose::new(0, [f64::INFINITY, f64::NEG_INFINITY, 1e300], [0.0; 4]);
        assert_eq!(far.to_row()[1..4], [i64::MAX, i64::MIN, i64::MAX]);
        let mut line = Vec::new();
        write_line(&mut line, far).unwrap();
        let line = String::from_utf8(line).unwrap();
        assert!(
            line.starts_with("0.000000000 922337203685.4775807 -922337203685.4775808 "),
            "{line}"
        );
    }
}
