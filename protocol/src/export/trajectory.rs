//! Poses in the TUM format, as `evo` and other trajectory tools read it.

use std::io::Write;
use std::path::Path;

use super::ExportError;
use super::whole_file::write_whole;

/// A pose of the vehicle in `odom` at a sensor stamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Nanoseconds since the epoch of the clock that stamped the data.
    pub stamp_ns: i64,
    /// Position of `base_link`, metres.
    pub position_m: [f64; 3],
    /// Orientation of `base_link`: x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
}

/// Writes one line a pose: `stamp_s tx ty tz qx qy qz qw`.
///
/// Stamps are printed to the nanosecond, positions to 0.1 µm, quaternions to 10⁻⁹.
pub fn write_trajectory(
    path: &Path,
    poses: impl IntoIterator<Item = StampedPose>,
) -> Result<(), ExportError> {
    write_whole(path, |writer| {
        let mut lines = poses.into_iter();
        lines
            .try_for_each(|pose| write_line(writer, &pose))
            .map_err(|source| ExportError::Io {
                path: path.to_owned(),
                source,
            })
    })
}

fn write_line(writer: &mut impl Write, pose: &StampedPose) -> std::io::Result<()> {
    let sign = if pose.stamp_ns < 0 { "-" } else { "" };
    let nanos = pose.stamp_ns.unsigned_abs();
    let (whole_s, rest_ns) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    let [x, y, z] = pose.position_m;
    let [qx, qy, qz, qw] = pose.quaternion_xyzw;
    writeln!(
        writer,
        "{sign}{whole_s}.{rest_ns:09} {x:.7} {y:.7} {z:.7} {qx:.9} {qy:.9} {qz:.9} {qw:.9}"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_keep_their_nanoseconds() {
        let pose = |stamp_ns| StampedPose {
            stamp_ns,
            position_m: [1.5, -2.0, 0.25],
            quaternion_xyzw: [0.0, 0.0, -0.6, 0.8],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("trajectory.tum");
        write_trajectory(&path, [1_700_000_000_000_000_001, -5].map(pose)).unwrap();
        assert_eq!(
            std::fs::read_to_string(path).unwrap(),
            "1700000000.000000001 1.5000000 -2.0000000 0.2500000 0.000000000 0.000000000 -0.600000000 0.800000000\n\
             -0.000000005 1.5000000 -2.0000000 0.2500000 0.000000000 0.000000000 -0.600000000 0.800000000\n"
        );
    }
}
