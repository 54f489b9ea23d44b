//! A file for the network: one zstd frame, with length and digest of the unpacked file.

use std::io::{self, Read as _, Write};

/// The level of tiles: higher levels are hardly smaller.
const LEVEL: i32 = 1;
const PIECE_BYTES: usize = 64 * 1024;

/// A packed file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PackedFile {
    /// Length of the unpacked file.
    pub bytes: u64,
    /// BLAKE3 of the unpacked file.
    pub digest: [u8; 32],
    /// The zstd frame.
    pub packed: Vec<u8>,
}

/// Reason why unpacking failed.
#[derive(Debug, thiserror::Error)]
pub enum UnpackError {
    /// Wrong length or digest.
    #[error("it is damaged: {0} bytes were promised, others came")]
    Damaged(u64),
    /// No zstd frame, or a write error.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl PackedFile {
    /// Packs the output of `write`.
    pub fn pack<E: From<io::Error>>(
        write: impl FnOnce(&mut dyn Write) -> Result<(), E>,
    ) -> Result<Self, E> {
        let mut out = CountingWriter {
            inner: zstd::Encoder::new(Vec::new(), LEVEL)?,
            bytes: 0,
            hasher: blake3::Hasher::new(),
        };
        write(&mut out)?;
        Ok(Self {
            bytes: out.bytes,
            digest: *out.hasher.finalize().as_bytes(),
            packed: out.inner.finish()?,
        })
    }

    /// Unpacks to `out`, never more than the declared length.
    pub fn unpack(&self, out: &mut impl Write) -> Result<(), UnpackError> {
        let mut frame = zstd::Decoder::new(&*self.packed)?.take(self.bytes.saturating_add(1));
        let mut hasher = blake3::Hasher::new();
        let mut piece = vec![0; PIECE_BYTES];
        let mut written = 0;
        loop {
            let length = frame.read(&mut piece)?;
            if length == 0 {
                break;
            }
            written += length as u64;
            if written > self.bytes {
                return Err(UnpackError::Damaged(self.bytes));
            }
            hasher.update(&piece[..length]);
            out.write_all(&piece[..length])?;
        }
        if written != self.bytes || *hasher.finalize().as_bytes() != self.digest {
            return Err(UnpackError::Damaged(self.bytes));
        }
        Ok(())
    }
}

/// Counts and hashes the bytes written through it.
struct CountingWriter<W> {
    inner: W,
    bytes: u64,
    hasher: blake3::Hasher,
}

impl<W: Write> Write for CountingWriter<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(bytes)?;
        self.hasher.update(&bytes[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn packed(bytes: &[u8]) -> PackedFile {
        PackedFile::pack(|out| out.write_all(bytes)).unwrap()
    }

    fn unpacked(file: &PackedFile) -> Result<Vec<u8>, UnpackError> {
        let mut out = Vec::new();
        file.unpack(&mut out).map(|()| out)
    }

    #[test]
    fn wrong_length_or_digest_is_an_error() {
        let good = packed(&vec![7; 300_000]);
        assert!(good.packed.len() < 1_000);
        let short = PackedFile {
            bytes: 299_999,
            ..good.clone()
        };
        let long = PackedFile {
            bytes: 300_001,
            ..good.clone()
        };
        let other = PackedFile {
            digest: [0; 32],
            ..good.clone()
        };
        for wrong in [short, long, other] {
            let promised = wrong.bytes;
            let error = unpacked(&wrong).unwrap_err();
            assert!(
                matches!(error, UnpackError::Damaged(bytes) if bytes == promised),
                "{error}"
            );
        }
        let cut = PackedFile {
            packed: good.packed[..good.packed.len() - 1].to_vec(),
            ..good
        };
        assert!(unpacked(&cut).is_err());
    }

    #[test]
    fn a_frame_that_never_ends_is_not_written_for_ever() {
        let huge = packed(&vec![0; 50_000_000]);
        let lie = PackedFile { bytes: 10, ..huge };
        let mut out = Vec::new();
        assert!(lie.unpack(&mut out).is_err());
        assert!(out.len() <= 10);
    }

    proptest! {
        #[test]
        fn files_survive(bytes: Vec<u8>) {
            let file = packed(&bytes);
            prop_assert_eq!(file.bytes, bytes.len() as u64);
            prop_assert_eq!(unpacked(&file).unwrap(), bytes);
        }

        #[test]
        fn bytes_that_are_no_frame_are_refused(bytes: Vec<u8>, at in 0_usize..100, flip in 1_u8..) {
            let mut file = packed(&bytes);
            let at = at % file.packed.len();
            file.packed[at] ^= flip;
            // Some bits of a frame have no effect.
            if let Ok(out) = unpacked(&file) {
                prop_assert_eq!(out, bytes);
            }
        }
    }
}
