//! Compressed chunks.

use std::io::{self, BufReader, Cursor, Read};

use super::record::Compression;
use super::record_source::{MAX_DATA_BYTES, RecordSource};

/// The records in a chunk that was compressed.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Byte of the file at which it begins.
    pub(super) at: u64,
    /// The file ends inside it.
    pub(super) is_cut: bool,
    pub(super) records: RecordSource<Cursor<Vec<u8>>>,
}

/// Decompresses as much of a chunk as can be trusted, and says what is wrong with the rest.
///
/// Both formats carry checksums. Where they contradict, nothing of the chunk is used. Of a chunk that the end
/// of the file cuts off (`is_cut`) all that comes before the cut is. `size` is what the chunk's header says
/// of the bytes in it.
pub(super) fn decompress(
    compression: Compression,
    size: u32,
    is_cut: bool,
    data: &mut dyn Read,
) -> (Vec<u8>, Option<&'static str>) {
    let mut records = Vec::new();
    let result = match compression {
        Compression::None => read_limited(data, &mut records),
        Compression::Bzip2 => read_limited(
            bzip2::bufread::BzDecoder::new(BufReader::new(data)),
            &mut records,
        ),
        // roslz4 writes standard frames: independent blocks, content checksum.
        Compression::Lz4 => read_limited(lz4_flex::frame::FrameDecoder::new(data), &mut records),
    };
    if records.len() as u64 > MAX_DATA_BYTES {
        records.truncate(MAX_DATA_BYTES as usize);
        return (records, Some("a chunk of more than 256 MiB"));
    }
    let ends_early = match &result {
        // An lz4 frame that ends between two blocks ends without an error.
        Ok(()) => records.len() < size as usize,
        Err(error) => error.kind() == io::ErrorKind::UnexpectedEof,
    };
    if ends_early && is_cut {
        (records, Some("a chunk that is cut off"))
    } else if ends_early || result.is_err() {
        (Vec::new(), Some("a chunk that cannot be decompressed"))
    } else {
        (records, None)
    }
}

fn read_limited(data: impl Read, records: &mut Vec<u8>) -> io::Result<()> {
    data.take(MAX_DATA_BYTES + 1)
        .read_to_end(records)
        .map(|_| ())
}

#[cfg(test)]
mod tests {
    use super::super::bag_bytes;
    use super::*;

    fn packed(name: &str, records: &[u8]) -> Vec<u8> {
        let record = bag_bytes::chunk(name, records);
        let header_bytes = 4 + u32::from_le_bytes(record[..4].try_into().unwrap()) as usize + 4;
        record[header_bytes..].to_vec()
    }

    /// Not repetitive, so that no codec makes it short.
    fn records(count: usize) -> Vec<u8> {
        let mut state = 1_u32;
        let next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 28) as u8
        };
        std::iter::repeat_with(next).take(count).collect()
    }

    #[test]
    fn chunks_come_out_as_they_went_in() {
        let records = records(3_000_000);
        for (name, compression) in [
            ("none", Compression::None),
            ("bz2", Compression::Bzip2),
            ("lz4", Compression::Lz4),
        ] {
            let (out, wrong) = decompress(
                compression,
                records.len() as u32,
                false,
                &mut &packed(name, &records)[..],
            );
            assert_eq!((out == records, wrong), (true, None), "{name}");
        }
    }

    #[test]
    fn damaged_chunks_yield_nothing_wrong() {
        let records = records(2_000_000);
        for (name, compression) in [("bz2", Compression::Bzip2), ("lz4", Compression::Lz4)] {
            let whole = packed(name, &records);
            let mut cut = whole.clone();
            cut.truncate(whole.len() * 3 / 4);
            let (out, wrong) = decompress(compression, records.len() as u32, true, &mut &cut[..]);
            assert_eq!(wrong, Some("a chunk that is cut off"), "{name}");
            assert!(!out.is_empty() && records.starts_with(&out), "{name}");

            for at in [5, whole.len() / 3, whole.len() / 2, whole.len() - 6] {
                let mut flipped = whole.clone();
                flipped[at] ^= 0x10;
                let (out, wrong) =
                    decompress(compression, records.len() as u32, false, &mut &flipped[..]);
                assert!(wrong.is_some(), "{name}, byte {at}");
                assert!(records.starts_with(&out), "{name}, byte {at}");
            }
        }
    }
}
