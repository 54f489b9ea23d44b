//! Outer records of an MCAP file; finds the next record behind damage.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::RecordingError;
use crate::mcap::record::{least_length, op};

/// Longest record that is read whole; others are passed over (attachments may be as long as they like).
pub(super) const MAX_RECORD_BYTES: u64 = 64 << 20;

const RECORD_HEADER_BYTES: u64 = 9;

/// How many records must follow one another before bytes are believed to be records again.
const PLAUSIBLE_RUN: usize = 3;

/// The next piece of the file.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Frame {
    /// A record whose body is in [`Framing::body`].
    Record {
        /// What it is.
        opcode: u8,
        /// Where it starts.
        offset: u64,
    },
    /// Bytes that are no records were passed over, up to the next ones.
    Damaged {
        /// Where they start.
        offset: u64,
        /// How many.
        bytes: u64,
    },
    /// The file ends here, before its end mark.
    CutOff {
        /// Where the record starts that does not end.
        offset: u64,
    },
}

/// Walks over the records of a file.
#[derive(Debug)]
pub(super) struct Framing {
    file: BufReader<File>,
    at: u64,
    length: u64,
    body: Vec<u8>,
    crc: crc32fast::Hasher,
    /// Bytes were passed over unread, so the checksum means nothing.
    crc_is_broken: bool,
}

impl Framing {
    /// Behind the first magic of `file`, which the caller has checked.
    pub(super) fn new(file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        let mut file = BufReader::with_capacity(1 << 16, file);
        file.seek(SeekFrom::Start(MAGIC.len() as u64))?;
        let mut crc = crc32fast::Hasher::new();
        crc.update(&MAGIC);
        Ok(Self {
            file,
            at: MAGIC.len() as u64,
            length,
            body: Vec::new(),
            crc,
            crc_is_broken: false,
        })
    }

    pub(super) fn body(&self) -> &[u8] {
        &self.body
    }

    /// The buffer of the last record's body, for taking it out and putting it back.
    pub(super) const fn body_mut(&mut self) -> &mut Vec<u8> {
        &mut self.body
    }

    /// Bytes passed so far, and in all.
    pub(super) const fn position(&self) -> (u64, u64) {
        (self.at, self.length)
    }

    /// CRC-32 of all bytes before the last record; `None` where some were passed over.
    pub(super) fn crc_before_last_record(&self) -> Option<u32> {
        (!self.crc_is_broken).then(|| self.crc.clone().finalize())
    }

    /// Whether the file ends as a finished one does.
    pub(super) fn ends_with_magic(&mut self) -> io::Result<bool> {
        let mut end = [0; MAGIC.len()];
        self.file.seek(SeekFrom::Start(
            self.length.saturating_sub(end.len() as u64),
        ))?;
        self.file.read_exact(&mut end)?;
        Ok(end == MAGIC)
    }

    /// The next record that is read, or what is in its place; `None` at the end of the file.
    pub(super) fn next_frame(&mut self) -> io::Result<Option<Frame>> {
        loop {
            let offset = self.at;
            if offset >= self.length {
                return Ok(None);
            }
            let Some(head) = self.header_at(offset)? else {
                return self.lost(offset).map(Some);
            };
            let end = offset + RECORD_HEADER_BYTES + head.length;
            if head.opcode != op::DATA_END {
                self.crc.update(&head.bytes);
            }
            if head.length > MAX_RECORD_BYTES || !is_read(head.opcode) {
                self.skip_damage(head.length)?;
                self.at = end;
                continue;
            }
            self.body.resize(head.length as usize, 0);
            self.file.read_exact(&mut self.body)?;
            if head.opcode != op::DATA_END {
                self.crc.update(&self.body);
            }
            self.at = end;
            return Ok(Some(Frame::Record {
                opcode: head.opcode,
                offset,
            }));
        }
    }

    /// Opcode and length at `offset`, and the file right behind them; `None` where no record can be.
    fn header_at(&mut self, offset: u64) -> io::Result<Option<RecordHeader>> {
        let rest = self.length.saturating_sub(offset);
        if rest < RECORD_HEADER_BYTES {
            return Ok(None);
        }
        let ahead = i64::try_from(offset).unwrap_or(i64::MAX)
            - i64::try_from(self.file.stream_position()?).unwrap_or(0);
        self.file.seek_relative(ahead)?;
        let mut bytes = [0; RECORD_HEADER_BYTES as usize];
        self.file.read_exact(&mut bytes)?;
        let [opcode, length @ ..] = bytes;
        let length = u64::from_le_bytes(length);
        let fits = length <= rest - RECORD_HEADER_BYTES
            && least_length(opcode).is_some_and(|least| length >= least);
        Ok(fits.then_some(RecordHeader {
            opcode,
            length,
            bytes,
        }))
    }

    fn skip_damage(&mut self, length: u64) -> io::Result<()> {
        let mut left = length;
        let mut block = [0; 1 << 13];
        while left > 0 {
            let part = left.min(block.len() as u64) as usize;
            self.file.read_exact(&mut block[..part])?;
            self.crc.update(&block[..part]);
            left -= part as u64;
        }
        Ok(())
    }

    /// There is no record at `offset`: goes to where records begin again.
    fn lost(&mut self, offset: u64) -> io::Result<Frame> {
        self.crc_is_broken = true;
        let found = self.next_run_of_records(offset + 1)?;
        self.at = found.unwrap_or(self.length);
        Ok(match found {
            Some(found) => Frame::Damaged {
                offset,
                bytes: found - offset,
            },
            None => Frame::CutOff { offset },
        })
    }

    fn next_run_of_records(&mut self, from: u64) -> io::Result<Option<u64>> {
        let mut block = vec![0; 1 << 16];
        let mut block_start = from;
        while block_start < self.length {
            self.file.seek(SeekFrom::Start(block_start))?;
            let size = (self.length - block_start).min(block.len() as u64) as usize;
            self.file.read_exact(&mut block[..size])?;
            for at in 0..size {
                // A length is eight bytes little endian of which real ones fill at most five: a cheap sieve.
                let could_be = least_length(block[at]).is_some_and(|_| {
                    block[at + 1..size]
                        .get(5..8)
                        .is_none_or(|high| high == [0; 3])
                });
                let offset = block_start + at as u64;
                if could_be && self.is_run_of_records(offset)? {
                    return Ok(Some(offset));
                }
            }
            block_start += size as u64;
        }
        Ok(None)
    }

    fn is_run_of_records(&mut self, mut offset: u64) -> io::Result<bool> {
        for _ in 0..PLAUSIBLE_RUN {
            let Some(head) = self.header_at(offset)? else {
                return Ok(false);
            };
            // Real files hold no private records; damaged ones are full of bytes ≥ 0x80.
            if head.opcode >= op::PRIVATE {
                return Ok(false);
            }
            offset += RECORD_HEADER_BYTES + head.length;
            if head.opcode == op::FOOTER || offset == self.length {
                break;
            }
        }
        Ok(true)
    }
}

struct RecordHeader {
    opcode: u8,
    length: u64,
    bytes: [u8; RECORD_HEADER_BYTES as usize],
}

const fn is_read(opcode: u8) -> bool {
    matches!(
        opcode,
        op::SCHEMA
            | op::CHANNEL
            | op::MESSAGE
            | op::CHUNK
            | op::STATISTICS
            | op::METADATA
            | op::DATA_END
            | op::FOOTER
    )
}

/// `\x89MCAP0\r\n`, at both ends of a file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Opens a file and checks its first bytes.
pub(super) fn open_checked(path: &Path) -> Result<File, RecordingError> {
    let io_error = |source| RecordingError::Io {
        path: path.to_owned(),
        source,
    };
    let mut file = File::open(path).map_err(io_error)?;
    let mut magic = Vec::new();
    file.by_ref()
        .take(MAGIC.len() as u64)
        .read_to_end(&mut magic)
        .map_err(io_error)?;
    if magic == MAGIC {
        Ok(file)
    } else {
        Err(not_this_format(path, &magic))
    }
}

fn not_this_format(path: &Path, begins_with: &[u8]) -> RecordingError {
    let path = path.to_owned();
    match begins_with {
        [0x89, b'M', b'C', b'A', b'P', version, b'\r', b'\n'] => {
            RecordingError::UnsupportedVersion {
                path,
                format: "MCAP",
                version: char::from(*version).to_string(),
                remedy: "only version 0 exists at the time of writing: update this program",
            }
        }
        _ => RecordingError::UnknownFormat {
            path,
            begins_with: format!("{:?}", String::from_utf8_lossy(begins_with)),
        },
    }
}
