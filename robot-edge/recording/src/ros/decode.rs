//! Bytes → measurements.

use super::cursor::Cursor;
use super::point_cloud;
use super::{DecodeError, Decoded, Encoding, MessageType};
use measurement::pose::{self, Pose};
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{FrameId, GeodeticFix, ImuSample, MeasurementData, Twist};

/// What a message says: each measurement in it, or why that one says nothing.
///
/// `is_static` is whether the message came on `/tf_static`.
///
/// # Errors
/// Where nothing of the message can be read.
pub fn decode(
    kind: MessageType,
    encoding: Encoding,
    is_static: bool,
    message: &[u8],
) -> Result<Vec<Result<Decoded, DecodeError>>, DecodeError> {
    let mut fields = Cursor::new(message, encoding)?;
    if kind == MessageType::TfMessage {
        // Header, two names and seven numbers: no transform is shorter than 76 bytes.
        let transforms = fields.length(76)?;
        return (0..transforms)
            .map(|_| transform(&mut fields, is_static))
            .collect();
    }
    one(kind, &mut fields).map(|decoded| vec![decoded])
}

/// A message of one measurement. The outer error is of the layout, the inner of the content.
fn one(
    kind: MessageType,
    fields: &mut Cursor<'_>,
) -> Result<Result<Decoded, DecodeError>, DecodeError> {
    if kind == MessageType::Twist {
        let data = MeasurementData::Twist(twist(fields)?);
        return Ok(Ok(Decoded {
            stamp: None,
            frame: "".into(),
            data,
        }));
    }
    let (stamp, frame) = header(fields)?;
    let data = match kind {
        MessageType::LaserScan => Ok(laser_scan(fields, false)?),
        MessageType::MultiEchoLaserScan => Ok(laser_scan(fields, true)?),
        MessageType::PointCloud2 => point_cloud::decode(fields)?.map(MeasurementData::PointCloud),
        MessageType::Imu => Ok(MeasurementData::Imu(imu(fields)?)),
        MessageType::JointState => Ok(MeasurementData::Joints(joints(fields)?)),
        MessageType::NavSatFix => Ok(MeasurementData::Fix(fix(fields)?)),
        MessageType::Odometry => {
            let child = frame_id(fields.string()?);
            odometry(child, pose(fields)?)
        }
        // The message does not say whose pose it is: the vehicle's.
        MessageType::PoseStamped | MessageType::PoseWithCovarianceStamped => {
            odometry("base_link".into(), pose(fields)?)
        }
        MessageType::TwistStamped | MessageType::Twist => {
            Ok(MeasurementData::Twist(twist(fields)?))
        }
        // Several measurements: see `decode`.
        MessageType::TfMessage => Err(DecodeError::TooShort),
    };
    Ok(data.map(|data| Decoded { stamp, frame, data }))
}

fn header(fields: &mut Cursor<'_>) -> Result<(Option<RobotTime>, FrameId), DecodeError> {
    // ROS 1 counts messages in the header and its seconds are unsigned.
    let secs = match fields.encoding() {
        Encoding::Ros1 => {
            fields.u32()?;
            i64::from(fields.u32()?)
        }
        Encoding::Cdr => i64::from(fields.i32()?),
    };
    let nanos = i64::from(fields.u32()?);
    let stamp = RobotTime::from_nanos(secs * 1_000_000_000 + nanos);
    let stamp = (stamp != RobotTime::from_nanos(0)).then_some(stamp);
    Ok((stamp, frame_id(fields.string()?)))
}

/// ROS 1 frames may begin with a slash that tf2 takes off.
fn frame_id(name: &str) -> FrameId {
    name.strip_prefix('/').unwrap_or(name).into()
}

fn laser_scan(fields: &mut Cursor<'_>, multi_echo: bool) -> Result<MeasurementData, DecodeError> {
    let angle_min_rad = fields.f32()?;
    let _angle_max = fields.f32()?;
    let angle_increment_rad = fields.f32()?;
    let time_increment_s = fields.f32()?;
    let _scan_time = fields.f32()?;
    let scan = Scan {
        angle_min_rad,
        angle_increment_rad,
        time_increment_s,
        range_min_m: fields.f32()?,
        range_max_m: fields.f32()?,
        ranges_m: if multi_echo {
            first_echoes(fields)?
        } else {
            fields.f32_sequence()?
        },
    };
    Ok(MeasurementData::Scan {
        scan,
        own_pose: None,
    })
}

fn first_echoes(fields: &mut Cursor<'_>) -> Result<Vec<f32>, DecodeError> {
    let beams = fields.length(4)?;
    (0..beams)
        .map(|_| {
            let echoes = fields.f32_sequence()?;
            // No echo is no return, which REP 117 writes as +∞.
            Ok(echoes.first().copied().unwrap_or(f32::INFINITY))
        })
        .collect()
}

fn transform(
    fields: &mut Cursor<'_>,
    is_static: bool,
) -> Result<Result<Decoded, DecodeError>, DecodeError> {
    let (stamp, frame) = header(fields)?;
    let child = frame_id(fields.string()?);
    let data = pose(fields)?.map(|parent_from_child| MeasurementData::Transform {
        child,
        parent_from_child,
        is_static,
    });
    Ok(data.map(|data| Decoded { stamp, frame, data }))
}

/// Position and orientation, or translation and rotation.
fn pose(fields: &mut Cursor<'_>) -> Result<Result<Pose, DecodeError>, DecodeError> {
    let (translation_m, quaternion_xyzw) = (fields.f64s()?, fields.f64s()?);
    Ok(pose::from_parts(translation_m, quaternion_xyzw).ok_or(DecodeError::BadPose))
}

fn odometry(
    child: FrameId,
    pose: Result<Pose, DecodeError>,
) -> Result<MeasurementData, DecodeError> {
    let child = if child.is_empty() {
        "base_link".into()
    } else {
        child
    };
    pose.map(|odom_from_base| MeasurementData::Odometry {
        child,
        odom_from_base,
    })
}

fn imu(fields: &mut Cursor<'_>) -> Result<ImuSample, DecodeError> {
    let orientation_xyzw = fields.f64s()?;
    let [first_covariance, ..] = fields.f64s::<9>()?;
    let angular_velocity_radps = fields.f64s()?;
    fields.f64s::<9>()?;
    Ok(ImuSample {
        // sensor_msgs/Imu: −1 in the first element says that there is no orientation.
        orientation_xyzw: (first_covariance.to_bits() != (-1.0f64).to_bits())
            .then_some(orientation_xyzw),
        angular_velocity_radps,
        linear_acceleration_mps2: fields.f64s()?,
    })
}

fn joints(fields: &mut Cursor<'_>) -> Result<Vec<(String, f64)>, DecodeError> {
    let names = fields.length(4)?;
    let names: Vec<_> = (0..names)
        .map(|_| fields.string())
        .collect::<Result<_, _>>()?;
    let positions = fields.length(8)?;
    let positions: Vec<_> = (0..positions)
        .map(|_| fields.f64())
        .collect::<Result<_, _>>()?;
    Ok(names
        .into_iter()
        .map(str::to_owned)
        .zip(positions)
        .collect())
}

fn fix(fields: &mut Cursor<'_>) -> Result<GeodeticFix, DecodeError> {
    let status = fields.i8()?;
    let _service = fields.u16()?;
    let [latitude_deg, longitude_deg, altitude_m] = fields.f64s()?;
    Ok(GeodeticFix {
        latitude_deg,
        longitude_deg,
        altitude_m,
        status,
    })
}

fn twist(fields: &mut Cursor<'_>) -> Result<Twist, DecodeError> {
    Ok(Twist {
        linear_mps: fields.f64s()?,
        angular_radps: fields.f64s()?,
    })
}
