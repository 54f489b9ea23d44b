//! Decodes ROS messages into measurements.

use measurement::pose::Pose;
use measurement::scan::Scan;
use measurement::time::RobotTime;
use measurement::{FrameId, GeodeticFix, ImuSample, MeasurementData, RangeReading, Twist, pose};

use super::point_cloud::point_cloud;
use super::{DecodeError, Decoded, Encoding, MessageType};

/// Decodes a message: each measurement in it, or why that one cannot be decoded.
///
/// `is_static` is whether the message came on `/tf_static`.
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
    let unstamped = match kind {
        MessageType::Twist => Some(MeasurementData::Twist(twist(fields)?)),
        MessageType::Bool => Some(MeasurementData::Bool(fields.u8()? != 0)),
        _ => None,
    };
    if let Some(data) = unstamped {
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
        MessageType::PointCloud2 => point_cloud(fields, stamp)?.map(MeasurementData::Cloud),
        MessageType::Imu => Ok(MeasurementData::Imu(imu(fields)?)),
        MessageType::JointState => Ok(MeasurementData::Joints(joints(fields)?)),
        MessageType::NavSatFix => Ok(MeasurementData::Fix(fix(fields)?)),
        MessageType::Odometry => {
            let child = frame_id(fields.string()?);
            odometry(child, pose(fields)?)
        }
        // The message has no child frame: it is the vehicle's pose.
        MessageType::PoseStamped | MessageType::PoseWithCovarianceStamped => {
            odometry("base_link".into(), pose(fields)?)
        }
        MessageType::TwistStamped => Ok(MeasurementData::Twist(twist(fields)?)),
        MessageType::Range => range(fields)?.map(MeasurementData::Range),
        // Without a stamp: see above. Several measurements: see `decode` and `velodyne_packets`.
        MessageType::Twist
        | MessageType::Bool
        | MessageType::TfMessage
        | MessageType::VelodyneScan => Err(DecodeError::TooShort),
    };
    Ok(data.map(|data| Decoded { stamp, frame, data }))
}

/// Packets with their times.
type Packets<'a> = Vec<(RobotTime, &'a [u8])>;

/// Frame of a `velodyne_msgs/VelodyneScan`, and its packets with the times of their arrival.
pub(crate) fn velodyne_packets(
    encoding: Encoding,
    message: &[u8],
) -> Result<(FrameId, Packets<'_>), DecodeError> {
    let mut fields = Cursor::new(message, encoding)?;
    let (_, frame) = header(&mut fields)?;
    let packets = fields.length(8 + lidar::velodyne::PACKET)?;
    let packets = (0..packets).map(|_| {
        let secs = match encoding {
            Encoding::Ros1 => i64::from(fields.u32()?),
            Encoding::Cdr => i64::from(fields.i32()?),
        };
        let nanos = i64::from(fields.u32()?);
        let stamp = RobotTime::from_nanos(secs * 1_000_000_000 + nanos);
        Ok((stamp, fields.take(lidar::velodyne::PACKET)?))
    });
    Ok((frame, packets.collect::<Result<_, DecodeError>>()?))
}

/// Frame and positions of a `nav_msgs/Path`, metres. The frames of its poses are not read: they are the path's.
pub fn decode_path(
    encoding: Encoding,
    message: &[u8],
) -> Result<(FrameId, Vec<[f64; 3]>), DecodeError> {
    let mut fields = Cursor::new(message, encoding)?;
    let (_, frame) = header(&mut fields)?;
    // Header and seven numbers.
    let poses = fields.length(68)?;
    let points_m = (0..poses).map(|_| {
        header(&mut fields)?;
        let position_m = fields.f64s()?;
        fields.f64s::<4>()?;
        Ok(position_m)
    });
    Ok((frame, points_m.collect::<Result<_, DecodeError>>()?))
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
        // sensor_msgs/Imu: −1 in the first element means that there is no orientation.
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
    let covariance_m2 = fields.f64s::<9>()?;
    let sigma_m = libm::sqrt(covariance_m2[0].max(covariance_m2[4]));
    let is_known = fields.u8()? != 0 && sigma_m > 0.0 && sigma_m.is_finite();
    Ok(GeodeticFix {
        latitude_deg,
        longitude_deg,
        altitude_m,
        status,
        sigma_m: is_known.then_some(sigma_m),
    })
}

fn twist(fields: &mut Cursor<'_>) -> Result<Twist, DecodeError> {
    Ok(Twist {
        linear_mps: fields.f64s()?,
        angular_radps: fields.f64s()?,
    })
}

/// ROS 2 since Jazzy ends it with a variance, which is not read.
fn range(fields: &mut Cursor<'_>) -> Result<Result<RangeReading, DecodeError>, DecodeError> {
    let reading = RangeReading {
        radiation_type: fields.u8()?,
        field_of_view_rad: fields.f32()?,
        range_min_m: fields.f32()?,
        range_max_m: fields.f32()?,
        range_m: fields.f32()?,
    };
    let is_cone = (0.0..=std::f32::consts::PI).contains(&reading.field_of_view_rad)
        && reading.range_min_m >= 0.0
        && reading.range_max_m > 0.0
        && reading.range_max_m >= reading.range_min_m;
    Ok(is_cone.then_some(reading).ok_or(DecodeError::BadCone))
}

/// A place in a message's bytes.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
    big_endian: bool,
}

macro_rules! number {
    ($name:ident, $type:ty) => {
        pub(super) fn $name(&mut self) -> Result<$type, DecodeError> {
            const SIZE: usize = size_of::<$type>();
            self.align(SIZE);
            let raw: [u8; SIZE] = *self
                .take(SIZE)?
                .first_chunk()
                .ok_or(DecodeError::TooShort)?;
            Ok(if self.big_endian {
                <$type>::from_be_bytes(raw)
            } else {
                <$type>::from_le_bytes(raw)
            })
        }
    };
}

impl<'a> Cursor<'a> {
    /// At the first field of `message`.
    fn new(message: &'a [u8], encoding: Encoding) -> Result<Self, DecodeError> {
        let (bytes, big_endian) = match encoding {
            Encoding::Ros1 => (message, false),
            // OMG DDSI-RTPS 2.5, 10.2: {0, 0} is big-endian plain CDR, {0, 1} little-endian; then options.
            Encoding::Cdr => match message {
                [0, order @ (0 | 1), _, _, fields @ ..] => (fields, *order == 0),
                [a, b, ..] => return Err(DecodeError::Encapsulation([*a, *b])),
                _ => return Err(DecodeError::TooShort),
            },
        };
        Ok(Self {
            bytes,
            at: 0,
            encoding,
            big_endian,
        })
    }

    number!(u8, u8);
    number!(i8, i8);
    number!(u16, u16);
    number!(u32, u32);
    number!(i32, i32);
    number!(f32, f32);
    number!(f64, f64);

    const fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// `N` numbers of 8 bytes.
    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], DecodeError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Length of a sequence whose elements take at least `element_bytes` each: one that lies must not
    /// ask for more memory than the message could fill.
    pub(super) fn length(&mut self, element_bytes: usize) -> Result<usize, DecodeError> {
        let length = self.u32()? as usize;
        let fits = length
            .checked_mul(element_bytes)
            .is_some_and(|bytes| bytes <= self.rest());
        if fits {
            Ok(length)
        } else {
            Err(DecodeError::TooShort)
        }
    }

    /// `float32[]`.
    fn f32_sequence(&mut self) -> Result<Vec<f32>, DecodeError> {
        let length = self.length(4)?;
        if length > 0 {
            self.align(4);
        }
        let raw = self.take(4 * length)?.as_chunks::<4>().0;
        Ok(if self.big_endian {
            raw.iter().map(|bytes| f32::from_be_bytes(*bytes)).collect()
        } else {
            raw.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
        })
    }

    /// `uint8[]`.
    pub(super) fn byte_sequence(&mut self) -> Result<&'a [u8], DecodeError> {
        let length = self.length(1)?;
        self.take(length)
    }

    /// `string`; CDR ends it with a zero that its length counts.
    pub(super) fn string(&mut self) -> Result<&'a str, DecodeError> {
        let bytes = self.byte_sequence()?;
        let bytes = match self.encoding {
            Encoding::Cdr => bytes.strip_suffix(&[0]).unwrap_or(bytes),
            Encoding::Ros1 => bytes,
        };
        str::from_utf8(bytes).ok().ok_or(DecodeError::NotText)
    }

    /// CDR puts every number at a multiple of its size, counted from the first field.
    fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(size);
        }
    }

    pub(super) fn take(&mut self, length: usize) -> Result<&'a [u8], DecodeError> {
        let end = self.at.checked_add(length).ok_or(DecodeError::TooShort)?;
        let taken = self.bytes.get(self.at..end).ok_or(DecodeError::TooShort)?;
        self.at = end;
        Ok(taken)
    }

    const fn rest(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }
}
