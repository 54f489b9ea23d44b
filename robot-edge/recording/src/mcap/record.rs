//! The records of an MCAP file that carry data (MCAP specification, "Records"): bytes to meaning.
//!
//! Every length is checked against the bytes that are there before anything is allocated; the crate's
//! `parse_record` reserves up to 4 GiB on the claim of one string.

use std::collections::BTreeMap;
use std::io::Read;

use mcap::records::{Channel, ChunkHeader, MessageHeader, Metadata, SchemaHeader};

pub(super) use mcap::records::op;

/// Opcodes from here on are private to the writer.
pub(super) const PRIVATE_OPCODES: u8 = 0x80;

/// Fewest bytes that a record of this opcode has; `None` for opcodes that the specification leaves free.
pub(super) const fn least_length(opcode: u8) -> Option<u64> {
    Some(match opcode {
        op::DATA_END => 4,
        op::MESSAGE_INDEX => 6,
        op::HEADER | op::METADATA => 8,
        op::SCHEMA => 14,
        op::CHANNEL => 16,
        op::SUMMARY_OFFSET => 17,
        op::FOOTER | op::METADATA_INDEX => 20,
        op::MESSAGE => 22,
        op::CHUNK | op::ATTACHMENT => 40,
        op::STATISTICS => 46,
        op::ATTACHMENT_INDEX => 48,
        op::CHUNK_INDEX => 64,
        PRIVATE_OPCODES.. => 0,
        0 | 0x10..PRIVATE_OPCODES => return None,
    })
}

/// The bytes of a record do not hold its fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Malformed;

/// A schema and its definition.
pub(super) fn schema(body: &[u8]) -> Result<(SchemaHeader, &[u8]), Malformed> {
    let mut fields = Fields(body);
    let header = SchemaHeader {
        id: fields.u16()?,
        name: fields.string()?,
        encoding: fields.string()?,
    };
    let length = fields.u32()? as usize;
    Ok((header, fields.take(length)?))
}

pub(super) fn channel(body: &[u8]) -> Result<Channel, Malformed> {
    let mut fields = Fields(body);
    Ok(Channel {
        id: fields.u16()?,
        schema_id: fields.u16()?,
        topic: fields.string()?,
        message_encoding: fields.string()?,
        metadata: fields.map()?,
    })
}

pub(super) fn metadata(body: &[u8]) -> Result<Metadata, Malformed> {
    let mut fields = Fields(body);
    Ok(Metadata {
        name: fields.string()?,
        metadata: fields.map()?,
    })
}

/// A message and its data.
pub(super) fn message(body: &[u8]) -> Result<(MessageHeader, &[u8]), Malformed> {
    let mut fields = Fields(body);
    let header = MessageHeader {
        channel_id: fields.u16()?,
        sequence: fields.u32()?,
        log_time: fields.u64()?,
        publish_time: fields.u64()?,
    };
    Ok((header, fields.0))
}

/// A chunk and its compressed records.
pub(super) fn chunk(body: &[u8]) -> Result<(ChunkHeader, &[u8]), Malformed> {
    let mut fields = Fields(body);
    let header = ChunkHeader {
        message_start_time: fields.u64()?,
        message_end_time: fields.u64()?,
        uncompressed_size: fields.u64()?,
        uncompressed_crc: fields.u32()?,
        compression: fields.string()?,
        compressed_size: fields.u64()?,
    };
    let length = usize::try_from(header.compressed_size).ok();
    let records = fields.take(length.ok_or(Malformed)?)?;
    Ok((header, records))
}

/// The first field of `Statistics`: messages in the file.
pub(super) fn message_count(body: &[u8]) -> Result<u64, Malformed> {
    Fields(body).u64()
}

/// The first field of `DataEnd`: CRC-32 of all before it, 0 where it was not computed.
pub(super) fn data_section_crc(body: &[u8]) -> Result<u32, Malformed> {
    Fields(body).u32()
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

    fn map(&mut self) -> Result<BTreeMap<String, String>, Malformed> {
        let length = self.u32()? as usize;
        let mut entries = Fields(self.take(length)?);
        let mut map = BTreeMap::new();
        while !entries.0.is_empty() {
            map.insert(entries.string()?, entries.string()?);
        }
        Ok(map)
    }

    fn string(&mut self) -> Result<String, Malformed> {
        let length = self.u32()? as usize;
        let text = str::from_utf8(self.take(length)?);
        text.map(str::to_owned).ok().ok_or(Malformed)
    }
}

/// Largest chunk, uncompressed. Writers make 768 KiB to some MiB; a claim beyond this is damage.
const MAX_CHUNK_BYTES: usize = 128 << 20;

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

/// Puts the records of a chunk into `records`, whose former content is lost.
pub(super) fn unpack(
    header: &ChunkHeader,
    compressed: &[u8],
    records: &mut Vec<u8>,
) -> Result<(), ChunkError> {
    let expected = header.uncompressed_size;
    if expected > MAX_CHUNK_BYTES as u64 {
        return Err(ChunkError::TooLarge(expected));
    }
    records.clear();
    // One byte more than claimed, so that a claim too small is noticed; nothing is allocated on a claim.
    let limit = expected + 1;
    match header.compression.as_str() {
        // The size of uncompressed records is their length.
        "" => records.extend(compressed),
        "zstd" => {
            zstd::Decoder::new(compressed)?
                .take(limit)
                .read_to_end(records)?;
        }
        "lz4" => {
            lz4_flex::frame::FrameDecoder::new(compressed)
                .take(limit)
                .read_to_end(records)?;
        }
        other => {
            let shortened = other.chars().take(40).collect();
            return Err(ChunkError::UnknownCompression(shortened));
        }
    }
    let found = records.len();
    if !header.compression.is_empty() && found as u64 != expected {
        return Err(ChunkError::Length { found, expected });
    }
    let (found, expected) = (crc32fast::hash(records), header.uncompressed_crc);
    // 0 means that the writer did not compute it.
    if expected != 0 && found != expected {
        return Err(ChunkError::Checksum { found, expected });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpacked(
        compression: &str,
        uncompressed_size: u64,
        compressed: &[u8],
        records: &mut Vec<u8>,
    ) -> Result<(), ChunkError> {
        let header = ChunkHeader {
            message_start_time: 0,
            message_end_time: 0,
            uncompressed_size,
            uncompressed_crc: crc32fast::hash(b"hello hello hello"),
            compression: compression.to_owned(),
            compressed_size: compressed.len() as u64,
        };
        unpack(&header, compressed, records)
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
            unpacked(name, 17, bytes, &mut records).unwrap();
            assert_eq!(records, plain, "{name}");
            let short = unpacked(name, 16, bytes, &mut records);
            let is_refused = matches!(short, Err(ChunkError::Length { found: 17, .. }));
            assert_eq!(is_refused, !name.is_empty(), "{name}: {short:?}");
        }
        let flipped = unpacked("", 17, b"hello hallo hello", &mut records);
        assert!(matches!(flipped, Err(ChunkError::Checksum { .. })));
        assert!(matches!(
            unpacked("xz", 17, plain, &mut records),
            Err(ChunkError::UnknownCompression(_))
        ));
        assert!(matches!(
            unpacked("", 1 << 40, plain, &mut records),
            Err(ChunkError::TooLarge(_))
        ));
    }

    #[test]
    fn a_bomb_stops_at_what_the_chunk_claims() {
        let bomb = zstd::encode_all(&vec![0; 50 << 20][..], 1).unwrap();
        let mut records = Vec::new();
        assert!(unpacked("zstd", 1000, &bomb, &mut records).is_err());
        assert!(records.capacity() < 1 << 20, "{}", records.capacity());
    }
}
