//! The records of an MCAP file that carry data (MCAP specification, "Records"): bytes to meaning.
//!
//! Every length is checked against the bytes that are there before anything is allocated.

use std::collections::BTreeMap;
use std::io::Read;

pub(super) mod op {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const STATISTICS: u8 = 0x0B;
    pub(crate) const METADATA: u8 = 0x0C;
    pub(crate) const DATA_END: u8 = 0x0F;
    /// Opcodes from here on are private to the writer.
    pub(crate) const PRIVATE: u8 = 0x80;
}

/// Fewest bytes that a record of this opcode has; `None` for opcodes that the specification leaves free.
pub(super) const fn least_length(opcode: u8) -> Option<u64> {
    Some(match opcode {
        op::HEADER | op::METADATA => 8,
        op::FOOTER => 20,
        op::SCHEMA => 14,
        op::CHANNEL => 16,
        op::MESSAGE => 22,
        0x07 => 6,              // message index
        0x08 => 64,             // chunk index
        op::CHUNK | 0x09 => 40, // chunk, attachment
        0x0A => 48,             // attachment index
        0x0B => 46,             // statistics
        0x0D => 20,             // metadata index
        0x0E => 17,             // summary offset
        op::DATA_END => 4,
        op::PRIVATE.. => 0,
        0 | 0x10..op::PRIVATE => return None,
    })
}

/// The bytes of a record do not hold its fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Malformed;

/// `Schema`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Schema<'a> {
    pub(super) id: u16,
    pub(super) name: &'a str,
    pub(super) encoding: &'a str,
    pub(super) definition: &'a [u8],
}

/// `Channel`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel<'a> {
    pub(super) id: u16,
    pub(super) schema_id: u16,
    pub(super) topic: &'a str,
    pub(super) message_encoding: &'a str,
    pub(super) metadata: BTreeMap<&'a str, &'a str>,
}

/// `Metadata`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Metadata<'a> {
    pub(super) name: &'a str,
    pub(super) entries: BTreeMap<&'a str, &'a str>,
}

/// `Message`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message<'a> {
    pub(super) channel_id: u16,
    pub(super) sequence: u32,
    pub(super) log_time: u64,
    pub(super) publish_time: u64,
    pub(super) data: &'a [u8],
}

/// `Chunk`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Chunk<'a> {
    pub(super) uncompressed_size: u64,
    pub(super) uncompressed_crc: u32,
    pub(super) compression: &'a str,
    pub(super) records: &'a [u8],
}

impl<'a> Schema<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, Malformed> {
        let mut fields = Fields(body);
        Ok(Self {
            id: fields.u16()?,
            name: fields.string()?,
            encoding: fields.string()?,
            definition: {
                let length = fields.u32()? as usize;
                fields.take(length)?
            },
        })
    }
}

impl<'a> Channel<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, Malformed> {
        let mut fields = Fields(body);
        Ok(Self {
            id: fields.u16()?,
            schema_id: fields.u16()?,
            topic: fields.string()?,
            message_encoding: fields.string()?,
            metadata: fields.map()?,
        })
    }
}

impl<'a> Metadata<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, Malformed> {
        let mut fields = Fields(body);
        Ok(Self {
            name: fields.string()?,
            entries: fields.map()?,
        })
    }
}

impl<'a> Message<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, Malformed> {
        let mut fields = Fields(body);
        Ok(Self {
            channel_id: fields.u16()?,
            sequence: fields.u32()?,
            log_time: fields.u64()?,
            publish_time: fields.u64()?,
            data: fields.0,
        })
    }
}

impl<'a> Chunk<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, Malformed> {
        let mut fields = Fields(body);
        let (_start, _end) = (fields.u64()?, fields.u64()?);
        Ok(Self {
            uncompressed_size: fields.u64()?,
            uncompressed_crc: fields.u32()?,
            compression: fields.string()?,
            records: {
                let length = fields.u64()?;
                fields.take(usize::try_from(length).ok().ok_or(Malformed)?)?
            },
        })
    }
}

/// The first field of `Statistics`: messages in the file.
pub(super) fn message_count(body: &[u8]) -> Result<u64, Malformed> {
    Fields(body).u64()
}

/// The first field of `DataEnd`: CRC-32 of all before it, 0 where it was not computed.
pub(super) fn data_section_crc(body: &[u8]) -> Result<u32, Malformed> {
    Fields(body).u32()
}

/// The records in a chunk: opcode and body; an error for each stretch of bytes that is none of them.
pub(super) fn records(chunk: &[u8]) -> impl Iterator<Item = Result<(u8, &[u8]), Malformed>> {
    let mut fields = Fields(chunk);
    std::iter::from_fn(move || {
        if fields.0.is_empty() {
            return None;
        }
        let before = fields.0;
        let record = fields.record();
        if record.is_err() {
            let next = (1..before.len()).find(|&at| is_run_of_records(&before[at..]));
            fields.0 = next.map_or(&[], |at| &before[at..]);
        }
        Some(record)
    })
}

/// Records of every kind, up to the first that is malformed.
pub(super) fn any_records(bytes: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    let mut fields = Fields(bytes);
    std::iter::from_fn(move || {
        let opcode = fields.u8().ok()?;
        let length = usize::try_from(fields.u64().ok()?).ok()?;
        Some((opcode, fields.take(length).ok()?))
    })
}

/// Whether records begin here: several in a row, or up to the end of the chunk.
fn is_run_of_records(bytes: &[u8]) -> bool {
    const RUN: usize = 3;
    let mut fields = Fields(bytes);
    (0..RUN).all(|_| fields.0.is_empty() || fields.record().is_ok())
}

struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, length: usize) -> Result<&'a [u8], Malformed> {
        let (taken, rest) = self.0.split_at_checked(length).ok_or(Malformed)?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Malformed> {
        self.take(N)?.try_into().ok().ok_or(Malformed)
    }

    fn record(&mut self) -> Result<(u8, &'a [u8]), Malformed> {
        let opcode = self.u8()?;
        let length = self.u64()?;
        // Nothing else is in a chunk (MCAP specification, "Chunk").
        let is_allowed = matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        if !is_allowed || least_length(opcode).is_none_or(|least| length < least) {
            return Err(Malformed);
        }
        let length = usize::try_from(length).ok().ok_or(Malformed)?;
        Ok((opcode, self.take(length)?))
    }

    fn u8(&mut self) -> Result<u8, Malformed> {
        self.array().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Result<u16, Malformed> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, Malformed> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, Malformed> {
        self.array().map(u64::from_le_bytes)
    }

    fn map(&mut self) -> Result<BTreeMap<&'a str, &'a str>, Malformed> {
        let length = self.u32()? as usize;
        let mut entries = Fields(self.take(length)?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            map.insert(entries.string()?, entries.string()?);
        }
        Ok(map)
    }

    fn string(&mut self) -> Result<&'a str, Malformed> {
        let length = self.u32()? as usize;
        str::from_utf8(self.take(length)?).ok().ok_or(Malformed)
    }
}

/// Largest chunk, uncompressed. Writers make 768 KiB to some MiB; a claim beyond this is damage.
pub(super) const MAX_CHUNK_BYTES: usize = 128 << 20;

/// Why a chunk's records cannot be used.
#[derive(Debug, thiserror::Error)]
pub(super) enum ChunkError {
    #[error("it claims {0} bytes uncompressed, more than the {limit} that are read", limit = MAX_CHUNK_BYTES)]
    TooLarge(u64),
    #[error("its compression {0:?} is not known")]
    UnknownCompression(String),
    #[error("it does not decompress: {0}")]
    Decompression(#[from] std::io::Error),
    #[error("it is {found} bytes uncompressed instead of {expected}")]
    Length { found: usize, expected: u64 },
    #[error("its checksum is {found:08x} instead of {expected:08x}")]
    Checksum { found: u32, expected: u32 },
}

/// Puts the records of `chunk` into `records`, whose former content is lost.
pub(super) fn unpack(chunk: &Chunk<'_>, records: &mut Vec<u8>) -> Result<(), ChunkError> {
    if chunk.uncompressed_size > MAX_CHUNK_BYTES as u64 {
        return Err(ChunkError::TooLarge(chunk.uncompressed_size));
    }
    records.clear();
    // One byte more than claimed, so that a claim too small is noticed; nothing is allocated on a claim.
    let limit = chunk.uncompressed_size + 1;
    match chunk.compression {
        "" => {
            records.extend(chunk.records);
            records.len()
        }
        "zstd" => zstd::Decoder::new(chunk.records)?
            .take(limit)
            .read_to_end(records)?,
        "lz4" => lz4_flex::frame::FrameDecoder::new(chunk.records)
            .take(limit)
            .read_to_end(records)?,
        other => {
            return Err(ChunkError::UnknownCompression(
                other.chars().take(40).collect(),
            ));
        }
    };
    // The size of uncompressed records is their length.
    if !chunk.compression.is_empty() && records.len() as u64 != chunk.uncompressed_size {
        let (found, expected) = (records.len(), chunk.uncompressed_size);
        return Err(ChunkError::Length { found, expected });
    }
    let found = crc32fast::hash(records);
    // 0 means that the writer did not compute it.
    if chunk.uncompressed_crc != 0 && found != chunk.uncompressed_crc {
        return Err(ChunkError::Checksum {
            found,
            expected: chunk.uncompressed_crc,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunk<'a>(compression: &'a str, size: u64, records: &'a [u8]) -> Chunk<'a> {
        let uncompressed_crc = crc32fast::hash(b"hello hello hello");
        Chunk {
            uncompressed_size: size,
            uncompressed_crc,
            compression,
            records,
        }
    }

    #[test]
    fn every_compression_is_unpacked_and_checked() {
        let plain = b"hello hello hello";
        let zstd = zstd::encode_all(&plain[..], 1).unwrap();
        let mut lz4 = lz4_flex::frame::FrameEncoder::new(Vec::new());
        std::io::Write::write_all(&mut lz4, plain).unwrap();
        let lz4 = lz4.finish().unwrap();
        let mut records = b"old".to_vec();
        for (name, bytes) in [("", &plain[..]), ("zstd", &zstd), ("lz4", &lz4)] {
            unpack(&chunk(name, 17, bytes), &mut records).unwrap();
            assert_eq!(records, plain, "{name}");
            let short = unpack(&chunk(name, 16, bytes), &mut records);
            let is_refused = matches!(short, Err(ChunkError::Length { found: 17, .. }));
            assert_eq!(is_refused, !name.is_empty(), "{name}: {short:?}");
        }
        let flipped = unpack(&chunk("", 17, b"hello hallo hello"), &mut records);
        assert!(matches!(flipped, Err(ChunkError::Checksum { .. })));
        assert!(matches!(
            unpack(&chunk("xz", 17, plain), &mut records),
            Err(ChunkError::UnknownCompression(_))
        ));
        assert!(matches!(
            unpack(&chunk("", 1 << 40, plain), &mut records),
            Err(ChunkError::TooLarge(_))
        ));
    }

    #[test]
    fn a_bomb_stops_at_what_the_chunk_claims() {
        let bomb = zstd::encode_all(&vec![0; 50 << 20][..], 1).unwrap();
        let mut records = Vec::new();
        assert!(unpack(&chunk("zstd", 1000, &bomb), &mut records).is_err());
        assert!(records.capacity() < 1 << 20, "{}", records.capacity());
    }
}
