//! `sensor_msgs/PointCloud2`: only clouds that keep their sensor's order.

use super::DecodeError;
use super::cursor::Cursor;
use measurement::PointCloud;

/// `sensor_msgs/PointField` datatypes that are read.
const UINT8: u8 = 2;
const UINT16: u8 = 4;
const FLOAT32: u8 = 7;

struct Field {
    offset: usize,
    datatype: u8,
}

/// Reads a cloud behind its header. The outer error is of the layout, the inner of the content.
pub(super) fn decode(
    fields: &mut Cursor<'_>,
) -> Result<Result<PointCloud, DecodeError>, DecodeError> {
    let height = fields.u32()?;
    let width = fields.u32()?;
    let [mut x, mut y, mut z, mut ring] = [const { None }; 4];
    // A name, an offset, a type and a count: at least 13 bytes.
    for _ in 0..fields.length(13)? {
        let name = fields.string()?;
        let field = Field {
            offset: fields.u32()? as usize,
            datatype: fields.u8()?,
        };
        fields.u32()?;
        match name {
            "x" => x = Some(field),
            "y" => y = Some(field),
            "z" => z = Some(field),
            "ring" => ring = Some(field),
            _ => {}
        }
    }
    let big_endian = fields.u8()? != 0;
    let point_step = fields.u32()? as usize;
    let row_step = fields.u32()? as usize;
    let data = fields.byte_sequence()?;
    if height <= 1 && ring.is_none() {
        return Ok(Err(DecodeError::NotOrganised));
    }
    let (Some(x), Some(y), Some(z)) = (x, y, z) else {
        return Ok(Err(DecodeError::BadCloud));
    };
    let layout = Layout {
        height,
        width,
        point_step,
        row_step,
        big_endian,
    };
    Ok(layout
        .read(data, &[x, y, z], ring.as_ref())
        .ok_or(DecodeError::BadCloud))
}

struct Layout {
    height: u32,
    width: u32,
    point_step: usize,
    row_step: usize,
    big_endian: bool,
}

impl Layout {
    fn read(&self, data: &[u8], xyz: &[Field; 3], ring: Option<&Field>) -> Option<PointCloud> {
        let points = (self.height as usize).checked_mul(self.width as usize)?;
        // No more points than there are bytes for, whatever the sizes claim.
        if self.point_step == 0 || points > data.len() / self.point_step {
            return None;
        }
        let mut cloud = PointCloud {
            points_m: Vec::with_capacity(points),
            width: self.width,
            rings: ring.map(|_| Vec::with_capacity(points)),
        };
        for row in 0..self.height as usize {
            for column in 0..self.width as usize {
                let start = row
                    .checked_mul(self.row_step)?
                    .checked_add(column * self.point_step)?;
                let point = data.get(start..)?.get(..self.point_step)?;
                let [x, y, z] = xyz;
                cloud.points_m.push([
                    self.float(point, x)?,
                    self.float(point, y)?,
                    self.float(point, z)?,
                ]);
                if let (Some(rings), Some(field)) = (&mut cloud.rings, ring) {
                    rings.push(self.ring(point, field)?);
                }
            }
        }
        Some(cloud)
    }

    fn float(&self, point: &[u8], field: &Field) -> Option<f32> {
        let raw = *point.get(field.offset..)?.first_chunk()?;
        let value = if self.big_endian {
            f32::from_be_bytes(raw)
        } else {
            f32::from_le_bytes(raw)
        };
        (field.datatype == FLOAT32).then_some(value)
    }

    fn ring(&self, point: &[u8], field: &Field) -> Option<u16> {
        let raw = point.get(field.offset..)?;
        match field.datatype {
            UINT8 => raw.first().map(|ring| u16::from(*ring)),
            UINT16 if self.big_endian => raw.first_chunk().map(|raw| u16::from_be_bytes(*raw)),
            UINT16 => raw.first_chunk().map(|raw| u16::from_le_bytes(*raw)),
            _ => None,
        }
    }
}
