//! A file as it crosses the network: one zstd frame, and what it must be when it is unpacked.

use std::io::{self, Read as _, Write};

/// As tiles are packed: the fastest level is nearly as small as any.
const LEVEL: i32 = 1;
/// Unpacked in pieces of so many bytes.
const PIECE_BYTES: usize = 64 * 1024;

/// A file that is packed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PackedFile {
    /// Its length.
    pub bytes: u64,
    /// BLAKE3 of it.
    pub digest: [u8; 32],
    /// The zstd frame.
    pub packed: Vec<u8>,
}

/// Why a file is not what it should be.
#[derive(Debug, thiserror::Error)]
pub enum UnpackError {
    /// Its length or digest is another.
    #[error("it is damaged: {0} bytes were promised, others came")]
    Damaged(u64),
    /// It is no zstd frame, or it cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl PackedFile {
    /// Packs what `write` writes.
    ///
    /// # Errors
    /// Those of `write`, and of zstd.
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

    /// Unpacks it. Whatever the frame says, no more is written than was promised.
    ///
    /// # Errors
    /// Where it is not what was promised, or `out` cannot be written; some of it may have been written by then.
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

/// Measures what is written through it.
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
    fn what_is_not_what_was_promised_is_told() {
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
            // Some bits of a frame do not matter; whatever is written is what was packed.
            if let Ok(out) = unpacked(&file) {
                prop_assert_eq!(out, bytes);
            }
        }
    }
}
