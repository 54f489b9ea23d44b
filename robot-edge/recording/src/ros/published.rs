//! ROS 2 messages of maps and poses that are published: CDR behind its encapsulation header.
//!
//! Field orders are those of the definitions in `nav_msgs`, `map_msgs`, `grid_map_msgs`, `octomap_msgs`, `tf2_msgs` and
//! `geometry_msgs` (Jazzy).

use measurement::Twist;
use measurement::pose::{Pose, planar};
use measurement::time::RobotTime;

use super::encode::CdrWriter;

/// A `geometry_msgs/Twist`, which has no stamp.
pub fn twist(twist: &Twist) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.twist(twist);
    out.bytes
}

/// A `geometry_msgs/TwistStamped`; `frame`: that of the vehicle.
pub fn twist_stamped(stamp: RobotTime, frame: &str, twist: &Twist) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    out.twist(twist);
    out.bytes
}

/// A `tf2_msgs/TFMessage` of transforms at one time: parent, child, and the pose of the child in the parent.
pub fn transforms(stamp: RobotTime, transforms: &[(&str, &str, Pose)]) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.length(transforms.len());
    for (parent, child, parent_from_child) in transforms {
        out.header(stamp, parent);
        out.string(child);
        out.pose(parent_from_child);
    }
    out.bytes
}

/// A `nav_msgs/Odometry` with covariances of zero, which are not known; `twist` is in the frame of the child.
pub fn odometry(
    stamp: RobotTime,
    (parent, child, parent_from_child): (&str, &str, &Pose),
    twist: &Twist,
) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, parent);
    out.string(child);
    out.pose(parent_from_child);
    out.f64s(&[0.0; 36]);
    out.twist(twist);
    out.f64s(&[0.0; 36]);
    out.bytes
}

/// A pose of a path: stamp, position in metres, and quaternion x, y, z, w.
pub type PathPose = (RobotTime, [f64; 3], [f64; 4]);

/// Bytes of a pose in a `nav_msgs/Path`, at most, apart from the name of the frame.
pub const PATH_POSE_BYTES: usize = 80;

/// A `geometry_msgs/PoseStamped`.
pub fn pose_stamped(stamp: RobotTime, frame: &str, pose: &Pose) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    out.pose(pose);
    out.bytes
}

/// A `nav_msgs/Path`.
pub fn path(
    stamp: RobotTime,
    frame: &str,
    poses: impl ExactSizeIterator<Item = PathPose>,
) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    out.length(poses.len());
    for (stamp, position_m, quaternion_xyzw) in poses {
        out.header(stamp, frame);
        out.f64s(&position_m);
        out.f64s(&quaternion_xyzw);
    }
    out.bytes
}

/// A `nav_msgs/OccupancyGrid`: `cells` in rows of `width` from the least y, each from the least x; −1 unknown, 0 free … 100
/// occupied. `origin_m`: the corner of the first cell, metres.
pub fn occupancy_grid(
    stamp: RobotTime,
    frame: &str,
    (cell_m, origin_m): (f64, [f64; 2]),
    [width, height]: [u32; 2],
    cells: &[i8],
) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    // When the map was loaded.
    out.stamp(stamp);
    out.f32s(&[cell_m as f32]);
    out.u32(width);
    out.u32(height);
    out.pose(&planar(origin_m[0], origin_m[1], 0.0));
    out.i8s(cells);
    out.bytes
}

/// A `map_msgs/OccupancyGridUpdate`: `cells` as in [`occupancy_grid`], of a rectangle whose first cell is the one at column and
/// row `first` of that grid.
pub fn occupancy_grid_update(
    stamp: RobotTime,
    frame: &str,
    first: [i32; 2],
    [width, height]: [u32; 2],
    cells: &[i8],
) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    for index in first {
        out.number(index.to_le_bytes());
    }
    out.u32(width);
    out.u32(height);
    out.i8s(cells);
    out.bytes
}

/// A `grid_map_msgs/GridMap` of one layer. `values`: from the greatest x and y, first along x, `rows` of them for each of
/// `columns`; unknown is not a number. `centre_m`: the middle of the map, metres.
pub fn grid_map(
    stamp: RobotTime,
    frame: &str,
    (cell_m, centre_m): (f64, [f64; 2]),
    layer: &str,
    [rows, columns]: [u32; 2],
    values: &[f32],
) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    out.f64s(&[
        cell_m,
        f64::from(rows) * cell_m,
        f64::from(columns) * cell_m,
    ]);
    out.pose(&planar(centre_m[0], centre_m[1], 0.0));
    // Layers, and those without which a cell is unknown.
    for _ in 0..2 {
        out.length(1);
        out.string(layer);
    }
    out.length(1);
    out.length(2);
    for (label, size, stride) in [
        ("column_index", columns, columns.saturating_mul(rows)),
        ("row_index", rows, rows),
    ] {
        out.string(label);
        out.u32(size);
        out.u32(stride);
    }
    out.u32(0); // offset of the data
    out.length(values.len());
    out.f32s(values);
    // Where the first row and column are in the buffer.
    out.number(0_u16.to_le_bytes());
    out.number(0_u16.to_le_bytes());
    out.bytes
}

/// An `octomap_msgs/Octomap` of occupied and free voxels; `tree`: the nodes of a `.bt` file, without its header.
pub fn octomap(stamp: RobotTime, frame: &str, cell_m: f64, tree: &[u8]) -> Vec<u8> {
    let mut out = CdrWriter::new();
    out.header(stamp, frame);
    out.number([1]); // binary
    out.string("OcTree");
    out.f64s(&[cell_m]);
    out.length(tree.len());
    out.bytes.extend(tree);
    out.bytes
}
