//! Record headers of ROS bags, version 2.0: bytes to meaning.
//!
//! A record is a header length, a header, a data length and data; a header is a row of `name=value` fields,
//! each behind its length; all numbers are little endian
//! (<http://wiki.ros.org/Bags/Format/2.0>).

use measurement::time::RobotTime;

/// Longest header that is read: real ones hold a topic name at most.
pub(super) const MAX_HEADER_BYTES: usize = 4096;

/// How far before its operation code [`find_header`] looks for a header's start: a topic's name may come first.
const MAX_BYTES_BEFORE_OP: usize = 512;

/// What the header of a record says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum RecordHeader {
    /// The first record.
    Bag {
        /// Where the connections and chunk infos are; 0 in a bag that was never closed.
        index_pos: u64,
    },
    /// Messages and connections, perhaps compressed.
    Chunk {
        compression: Compression,
        /// Bytes once decompressed.
        size: u32,
    },
    /// Topic and type behind a number.
    Connection { conn: u32, topic: String },
    /// One message.
    Message { conn: u32, time: RobotTime },
    /// Where the messages of one connection are in the chunk before.
    Index { count: u32 },
    /// Times and counts of one chunk.
    ChunkInfo { count: u32 },
}

/// How a chunk is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Bzip2,
    Lz4,
}

impl RecordHeader {
    /// Reads a header, without the length before it. The error says what is wrong.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, &'static str> {
        let fields = Fields::parse(bytes)?;
        let [op] = fields.number("op", "no operation code")?;
        match op {
            0x02 => Ok(Self::Message {
                conn: fields.conn()?,
                time: fields.time("time")?,
            }),
            0x03 => Ok(Self::Bag {
                index_pos: u64::from_le_bytes(fields.number("index_pos", "no index position")?),
            }),
            0x04 => {
                fields.conn()?;
                Ok(Self::Index {
                    count: fields.count()?,
                })
            }
            0x05 => {
                let size = u32::from_le_bytes(fields.number("size", "no chunk size")?);
                let compression = match fields.get("compression") {
                    Some(b"none") => Compression::None,
                    Some(b"bz2") => Compression::Bzip2,
                    Some(b"lz4") => Compression::Lz4,
                    _ => return Err("a compression other than none, bz2 and lz4"),
                };
                Ok(Self::Chunk { compression, size })
            }
            0x06 => Ok(Self::ChunkInfo {
                count: fields.count()?,
            }),
            0x07 => Ok(Self::Connection {
                conn: fields.conn()?,
                topic: text(fields.get("topic").ok_or("no topic")?)?,
            }),
            _ => Err("an unknown operation code"),
        }
    }

    /// Whether this is a chunk whose records cannot be read where they are.
    pub(super) const fn is_packed_chunk(&self) -> bool {
        matches!(
            self,
            Self::Chunk {
                compression: Compression::Bzip2 | Compression::Lz4,
                ..
            }
        )
    }

    /// Bytes of data that such a record has, where the header tells.
    pub(super) fn expected_data_bytes(&self) -> Option<u64> {
        match self {
            Self::Index { count } => Some(u64::from(*count) * 12),
            Self::ChunkInfo { count } => Some(u64::from(*count) * 8),
            Self::Bag { .. }
            | Self::Chunk { .. }
            | Self::Connection { .. }
            | Self::Message { .. } => None,
        }
    }
}

/// Type of the messages behind a connection, from the connection record's data; empty where it names none.
pub(super) fn connection_type(data: &[u8]) -> Result<String, &'static str> {
    Fields::parse(data)?
        .get("type")
        .map_or(Ok(String::new()), text)
}

/// Finds the first thing in `bytes` that reads like a whole record header, its length included, and that
/// `accept` accepts: for finding one's feet again behind damage.
pub(super) fn find_header(
    bytes: &[u8],
    accept: impl Fn(&RecordHeader) -> bool,
) -> Option<(usize, RecordHeader)> {
    const OP: &[u8] = b"\x04\x00\x00\x00op=";
    let mut from = 0;
    while let Some(found) = bytes[from..]
        .windows(OP.len())
        .position(|window| window == OP)
    {
        let op = from + found;
        let earliest = op.saturating_sub(MAX_BYTES_BEFORE_OP);
        // The operation code may stand anywhere in its header.
        let header = (earliest..=op.saturating_sub(4)).rev().find_map(|start| {
            let (header, end) = header_at(bytes, start)?;
            (end > op && accept(&header)).then_some((start, header))
        });
        if header.is_some() {
            return header;
        }
        from = op + OP.len();
    }
    None
}

/// The header whose length stands at `start`, and where it ends.
fn header_at(bytes: &[u8], start: usize) -> Option<(RecordHeader, usize)> {
    let (length, rest) = bytes.get(start..)?.split_first_chunk()?;
    let length = u32::from_le_bytes(*length) as usize;
    if length > MAX_HEADER_BYTES {
        return None;
    }
    let header = RecordHeader::parse(rest.get(..length)?).ok()?;
    Some((header, start + 4 + length))
}

/// The fields of a header, in place.
struct Fields<'a>(Vec<(&'a [u8], &'a [u8])>);

impl<'a> Fields<'a> {
    fn parse(mut bytes: &'a [u8]) -> Result<Self, &'static str> {
        let mut fields = Vec::with_capacity(8);
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_first_chunk().ok_or("a field without length")?;
            let (field, rest) = rest
                .split_at_checked(u32::from_le_bytes(*length) as usize)
                .ok_or("a field longer than its header")?;
            let equals = field
                .iter()
                .position(|&byte| byte == b'=')
                .ok_or("a field without =")?;
            fields.push((&field[..equals], &field[equals + 1..]));
            bytes = rest;
        }
        Ok(Self(fields))
    }

    fn get(&self, name: &str) -> Option<&'a [u8]> {
        self.0
            .iter()
            .find(|(field, _)| *field == name.as_bytes())
            .map(|(_, value)| *value)
    }

    fn number<const N: usize>(
        &self,
        name: &str,
        missing: &'static str,
    ) -> Result<[u8; N], &'static str> {
        self.get(name)
            .and_then(|value| value.try_into().ok())
            .ok_or(missing)
    }

    fn conn(&self) -> Result<u32, &'static str> {
        self.number("conn", "no connection number")
            .map(u32::from_le_bytes)
    }

    fn count(&self) -> Result<u32, &'static str> {
        self.number("count", "no count").map(u32::from_le_bytes)
    }

    fn time(&self, name: &str) -> Result<RobotTime, &'static str> {
        // Two u32: seconds, then nanoseconds.
        let both = u64::from_le_bytes(self.number(name, "no time")?);
        let [secs, nanos] = [both as u32, (both >> 32) as u32].map(i64::from);
        Ok(RobotTime::from_nanos(secs * 1_000_000_000 + nanos))
    }
}

fn text(bytes: &[u8]) -> Result<String, &'static str> {
    str::from_utf8(bytes)
        .map(str::to_owned)
        .ok()
        .ok_or("a name that is not text")
}
