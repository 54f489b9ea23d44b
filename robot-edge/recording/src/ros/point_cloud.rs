//! `sensor_msgs/PointCloud2` of any layout.
//!
//! Fields are found by their names. What drivers call ring and time, and in which unit: Velodyne `ring`, `time` (s, `float32`);
//! Ouster `ring`, `t` (ns, `uint32`); Hesai and Livox `ring` or `line`, `timestamp` (`float64`, absolute: s of Hesai, ns of Livox);
//! Livox `offset_time` (ns, `uint32`).

use measurement::cloud::{Cloud, CloudPoint};
use measurement::time::RobotTime;

use super::DecodeError;
use super::decode::Cursor;
use super::encode::CdrWriter;

/// Ring of a point of no known one.
const NO_RING: u16 = u16::MAX;

/// Least value of an absolute time in seconds, and in nanoseconds: 1973.
const ABSOLUTE_S: f64 = 1e8;
const ABSOLUTE_NS: f64 = 1e17;

#[derive(Clone, Copy)]
struct Field {
    offset: usize,
    datatype: u8,
}

const FLOAT32: u8 = 7;
const FLOAT64: u8 = 8;

impl Field {
    /// Bytes of one element; `None` for a datatype that does not exist.
    const fn bytes(self) -> Option<usize> {
        Some(match self.datatype {
            1 | 2 => 1,
            3 | 4 => 2,
            5..=FLOAT32 => 4,
            FLOAT64 => 8,
            _ => return None,
        })
    }

    /// Its value in a point that contains the field.
    fn value(self, point: &[u8], big_endian: bool) -> f64 {
        fn raw<const N: usize>(point: &[u8], offset: usize, big_endian: bool) -> [u8; N] {
            let mut raw = [0; N];
            if let Some(bytes) = point.get(offset..offset + N) {
                raw.copy_from_slice(bytes);
            }
            if big_endian {
                raw.reverse();
            }
            raw
        }
        let offset = self.offset;
        match self.datatype {
            1 => i8::from_le_bytes(raw(point, offset, big_endian)).into(),
            2 => u8::from_le_bytes(raw(point, offset, big_endian)).into(),
            3 => i16::from_le_bytes(raw(point, offset, big_endian)).into(),
            4 => u16::from_le_bytes(raw(point, offset, big_endian)).into(),
            5 => i32::from_le_bytes(raw(point, offset, big_endian)).into(),
            6 => u32::from_le_bytes(raw(point, offset, big_endian)).into(),
            FLOAT32 => f32::from_le_bytes(raw(point, offset, big_endian)).into(),
            _ => f64::from_le_bytes(raw(point, offset, big_endian)),
        }
    }

    /// Time of a point after the stamp, seconds.
    fn after_s(self, value: f64, stamp: RobotTime) -> f64 {
        match self.datatype {
            FLOAT64 if value >= ABSOLUTE_NS => (value - stamp.as_nanos() as f64) * 1e-9,
            FLOAT64 if value >= ABSOLUTE_S => value - stamp.as_secs_f64(),
            FLOAT32 | FLOAT64 => value,
            _ => value * 1e-9,
        }
    }
}

/// The fields that are used.
#[derive(Default)]
struct Fields {
    position: [Option<Field>; 3],
    intensity: Option<Field>,
    ring: Option<Field>,
    time: Option<Field>,
}

impl Fields {
    fn add(&mut self, name: &str, field: Field) {
        let place = match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "intensity" => &mut self.intensity,
            "ring" | "channel" | "line" => &mut self.ring,
            "t" | "time" | "timestamp" | "timeStamp" | "offset_time" | "time_offset" => {
                &mut self.time
            }
            _ => return,
        };
        place.get_or_insert(field);
    }

    /// Whether all lie in a point, and none in another.
    fn check(&self, point_step: usize) -> Result<(), DecodeError> {
        let fields = self.position.iter().flatten();
        let fields = fields.chain(&self.intensity).chain(&self.ring);
        let mut places = Vec::new();
        for field in fields.chain(&self.time) {
            let bytes = field
                .bytes()
                .ok_or(DecodeError::BadCloud("a field has an unknown datatype"))?;
            let end = field.offset.saturating_add(bytes);
            if end > point_step {
                return Err(DecodeError::BadCloud("a field ends beyond its point_step"));
            }
            places.push((field.offset, end));
        }
        places.sort_unstable();
        let overlap = places.windows(2).any(|pair| pair[0].1 > pair[1].0);
        if overlap {
            return Err(DecodeError::BadCloud("its fields overlap"));
        }
        Ok(())
    }
}

/// Reads a cloud behind its header with this stamp. The outer error is of the layout, the inner of the content.
pub(super) fn point_cloud(
    fields: &mut Cursor<'_>,
    stamp: Option<RobotTime>,
) -> Result<Result<Cloud, DecodeError>, DecodeError> {
    let height = fields.u32()? as usize;
    let width = fields.u32()? as usize;
    let mut used = Fields::default();
    // A name, an offset, a type and a count: at least 13 bytes.
    for _ in 0..fields.length(13)? {
        let name = fields.string()?;
        let field = Field {
            offset: fields.u32()? as usize,
            datatype: fields.u8()?,
        };
        fields.u32()?;
        used.add(name, field);
    }
    let big_endian = fields.u8()? != 0;
    let point_step = fields.u32()? as usize;
    let row_step = fields.u32()? as usize;
    let data = fields.byte_sequence()?;
    let _is_dense = fields.u8()?;
    Ok(points(
        &used,
        (data, big_endian),
        [height, width, row_step, point_step],
        stamp.unwrap_or_default(),
    ))
}

fn points(
    used: &Fields,
    (data, big_endian): (&[u8], bool),
    [height, width, row_step, point_step]: [usize; 4],
    stamp: RobotTime,
) -> Result<Cloud, DecodeError> {
    let [Some(x), Some(y), Some(z)] = used.position else {
        return Err(DecodeError::BadCloud("it has no fields x, y and z"));
    };
    used.check(point_step)?;
    let row_bytes = width.checked_mul(point_step);
    let fits = row_bytes.is_some_and(|row_bytes| {
        row_bytes <= row_step
            && (height.saturating_sub(1).checked_mul(row_step))
                .and_then(|before| before.checked_add(row_bytes))
                .is_some_and(|bytes| bytes <= data.len())
    });
    if height > 0 && width > 0 && !fits {
        return Err(DecodeError::BadCloud(
            "its data is shorter than its height, width, row_step and point_step say",
        ));
    }
    let mut cloud = Cloud::default();
    let points = if fits { height * width } else { 0 };
    cloud.points.reserve_exact(points);
    for at in 0..points {
        let (row, column) = (at / width, at % width);
        let point = &data[row * row_step + column * point_step..][..point_step];
        let position_m = [x, y, z].map(|axis| axis.value(point, big_endian) as f32);
        let squares = position_m.map(|metres| metres * metres);
        let square = squares.iter().sum::<f32>();
        if !square.is_finite() || square <= 0.0 {
            cloud.without_return += 1;
            continue;
        }
        let value = |field: Field| field.value(point, big_endian);
        let ring = match used.ring {
            Some(ring) => Some(value(ring) as u16).filter(|ring| *ring != NO_RING),
            None => (height > 1).then_some(row as u16),
        };
        let time = used.time.map(|time| time.after_s(value(time), stamp));
        cloud.points.push(CloudPoint {
            position_m,
            after_s: time.unwrap_or_default() as f32,
            intensity: used.intensity.map_or(0.0, |field| value(field) as f32),
            ring,
        });
    }
    Ok(cloud)
}

/// Names, offsets and datatypes of the fields of a cloud that is written.
const WRITTEN: [(&str, u32, u8); 6] = [
    ("x", 0, FLOAT32),
    ("y", 4, FLOAT32),
    ("z", 8, FLOAT32),
    ("intensity", 12, FLOAT32),
    ("ring", 16, 4),
    ("time", 18, FLOAT32),
];
const WRITTEN_STEP: usize = 22;

/// Writes a cloud behind its header, with the fields of Velodyne's driver. Beams without a return are points that are not numbers.
pub(super) fn write(cloud: &Cloud, out: &mut CdrWriter) {
    let points = cloud.points.len() + cloud.without_return as usize;
    out.u32(1);
    out.length(points);
    out.length(WRITTEN.len());
    for (name, offset, datatype) in WRITTEN {
        out.string(name);
        out.u32(offset);
        out.number([datatype]);
        out.u32(1);
    }
    out.number([0]);
    out.length(WRITTEN_STEP);
    out.length(WRITTEN_STEP * points);
    let mut data = Vec::with_capacity(WRITTEN_STEP * points);
    for point in &cloud.points {
        let [x, y, z] = point.position_m;
        data.extend(
            [x, y, z, point.intensity]
                .map(f32::to_le_bytes)
                .as_flattened(),
        );
        data.extend(point.ring.unwrap_or(NO_RING).to_le_bytes());
        data.extend(point.after_s.to_le_bytes());
    }
    for _ in 0..cloud.without_return {
        data.extend([f32::NAN.to_le_bytes(); 3].as_flattened());
        data.extend([0; WRITTEN_STEP - 12]);
    }
    out.length(data.len());
    out.bytes.extend(data);
    // Whether it has no points that are not finite.
    out.number([u8::from(cloud.without_return == 0)]);
}
