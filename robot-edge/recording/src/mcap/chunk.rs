//! The records of a chunk, decompressed within a limit and checked.

use std::io::Read;

use super::record::Chunk;

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
    // Of plain records the size says nothing that their length does not.
    if !chunk.compression.is_empty() && records.len() as u64 != chunk.uncompressed_size {
        let (found, expected) = (records.len(), chunk.uncompressed_size);
        return Err(ChunkError::Length { found, expected });
    }
    let found = crc32fast::hash(records);
    // 0 says that the writer did not compute it.
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
