//! Walks over the records of an MCAP file and of its chunks; finds the next record behind damage.

use std::fs::File;
use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use crate::RecordingError;
use crate::mcap::record::{self, Malformed, PRIVATE_OPCODES, least_length, op};
use measurement::drops::DropReason;

/// Longest record that is read whole; others are passed over (attachments may be as long as they like).
const MAX_RECORD_BYTES: u64 = 64 << 20;

const RECORD_HEADER_BYTES: u64 = 9;

/// How many records must follow one another before bytes are believed to be records again.
const PLAUSIBLE_RUN: usize = 3;

/// `\x89MCAP0\r\n`, at both ends of a file.
pub(super) const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// The next piece of a file.
#[derive(Debug)]
pub(super) enum Piece<'a> {
    /// A record of the file (a chunk before the records in it) or of a chunk.
    Record {
        opcode: u8,
        /// Start of the record, or of its chunk.
        offset: u64,
        is_in_chunk: bool,
        body: &'a [u8],
    },
    /// Something cannot be read. A cut ends the file.
    Loss { reason: DropReason, note: String },
}

/// Walks over all records of a file: those in chunks follow their chunk.
#[derive(Debug)]
pub(super) struct McapRecords {
    file: Framing<BufReader<File>>,
    chunk: Framing<Cursor<Vec<u8>>>,
    chunk_offset: u64,
    /// Why the chunk that was returned last cannot be entered.
    lost_chunk: Option<String>,
}

impl McapRecords {
    /// Opens a file and checks its first bytes.
    pub(super) fn open(path: &Path) -> Result<Self, RecordingError> {
        let io_error = RecordingError::io(path);
        let mut file = File::open(path).map_err(io_error)?;
        let mut magic = Vec::new();
        file.by_ref()
            .take(MAGIC.len() as u64)
            .read_to_end(&mut magic)
            .map_err(io_error)?;
        if magic != MAGIC {
            return Err(not_this_format(path, &magic));
        }
        let length = file.metadata().map_err(io_error)?.len();
        let file = BufReader::with_capacity(1 << 16, file);
        let mut file = Framing::new(file, MAGIC.len() as u64, length);
        let mut crc = crc32fast::Hasher::new();
        crc.update(&MAGIC);
        file.crc = Some(crc);
        let mut chunk = Framing::new(Cursor::default(), 0, 0);
        chunk.is_chunk = true;
        Ok(Self {
            file,
            chunk,
            chunk_offset: 0,
            lost_chunk: None,
        })
    }

    /// The next record, or what is lost in its place; `None` at the end of the file.
    pub(super) fn next(&mut self) -> io::Result<Option<Piece<'_>>> {
        if let Some(note) = self.lost_chunk.take() {
            return Ok(Some(Piece::damaged(note)));
        }
        let offset = self.chunk_offset;
        match self.chunk.next_frame()? {
            None => {}
            Some(Frame::Record { opcode, .. }) => {
                let body = &self.chunk.body;
                return Ok(Some(Piece::Record {
                    opcode,
                    offset,
                    is_in_chunk: true,
                    body,
                }));
            }
            Some(Frame::Damaged { .. } | Frame::CutOff { .. }) => {
                return Ok(Some(Piece::damaged(malformed(offset))));
            }
        }
        let Some(frame) = self.file.next_frame()? else {
            return Ok(None);
        };
        Ok(Some(match frame {
            Frame::Record { opcode, offset } => {
                let body = &self.file.body;
                if opcode == op::CHUNK {
                    self.chunk_offset = offset;
                    self.lost_chunk = self.chunk.enter(body, offset).err();
                }
                Piece::Record {
                    opcode,
                    offset,
                    is_in_chunk: false,
                    body,
                }
            }
            Frame::Damaged { offset, bytes } => Piece::damaged(format!(
                "byte {offset}: {bytes} bytes are no records; reading went on behind them"
            )),
            Frame::CutOff { offset } => Piece::Loss {
                reason: DropReason::CutOff,
                note: format!("byte {offset}: the file ends in the middle of a record"),
            },
        }))
    }

    /// Bytes passed so far, and in all.
    pub(super) const fn position(&self) -> (u64, u64) {
        (self.file.at, self.file.length)
    }

    /// CRC-32 of all bytes before the end of the data; `None` if some were not read.
    pub(super) fn data_crc(&self) -> Option<u32> {
        let crc = self.file.crc.clone();
        crc.map(crc32fast::Hasher::finalize)
    }

    /// Whether the file ends as a finished one does.
    pub(super) fn ends_with_magic(&mut self) -> io::Result<bool> {
        let mut end = [0; MAGIC.len()];
        self.read_at(self.file.length.saturating_sub(end.len() as u64), &mut end)?;
        Ok(end == MAGIC)
    }

    /// Fills `bytes` from `offset` on; the walk goes on where it was.
    pub(super) fn read_at(&mut self, offset: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.file.bytes.seek(SeekFrom::Start(offset))?;
        self.file.bytes.read_exact(bytes)
    }
}

impl Piece<'_> {
    fn damaged(note: String) -> Self {
        Self::Loss {
            reason: DropReason::Damaged,
            note,
        }
    }
}

/// Describes a record that is [`Malformed`].
pub(super) fn malformed(offset: u64) -> String {
    format!("byte {offset}: a record does not hold its fields")
}

#[derive(Debug)]
enum Frame {
    /// A record whose body is in [`Framing::body`].
    Record { opcode: u8, offset: u64 },
    /// Bytes that are no records were passed over, up to the next ones.
    Damaged { offset: u64, bytes: u64 },
    /// The record that starts here is not whole, and none follows.
    CutOff { offset: u64 },
}

/// Walks over the records of a file, or of one chunk.
#[derive(Debug)]
struct Framing<R> {
    bytes: R,
    at: u64,
    length: u64,
    /// In a chunk are schemas, channels and messages only (MCAP specification, "Chunk").
    is_chunk: bool,
    body: Vec<u8>,
    /// Of the bytes before [`op::DATA_END`]; `None` if it is not needed, or bytes were not read.
    crc: Option<crc32fast::Hasher>,
}

impl Framing<Cursor<Vec<u8>>> {
    /// Goes to the first record of a chunk with this body, or says why it is lost.
    fn enter(&mut self, body: &[u8], offset: u64) -> Result<(), String> {
        let (header, compressed) = record::chunk(body).map_err(|Malformed| {
            format!("byte {offset}: a chunk is lost: its fields are damaged")
        })?;
        (self.at, self.length) = (0, 0);
        record::unpack(&header, compressed, self.bytes.get_mut())
            .map_err(|error| format!("byte {offset}: a chunk is lost: {error}"))?;
        self.length = self.bytes.get_ref().len() as u64;
        Ok(())
    }
}

impl<R: Read + Seek> Framing<R> {
    const fn new(bytes: R, at: u64, length: u64) -> Self {
        Self {
            bytes,
            at,
            length,
            is_chunk: false,
            body: Vec::new(),
            crc: None,
        }
    }

    /// The next record that is read, or what is in its place; `None` at the end of the file.
    fn next_frame(&mut self) -> io::Result<Option<Frame>> {
        loop {
            let offset = self.at;
            if offset >= self.length {
                return Ok(None);
            }
            let Some(head) = self.header_at(offset)? else {
                return self.lost(offset).map(Some);
            };
            let end = offset + RECORD_HEADER_BYTES + head.length;
            let crc = self.crc.as_mut().filter(|_| head.opcode != op::DATA_END);
            if let Some(crc) = crc {
                crc.update(&head.bytes);
            }
            if !self.is_chunk && (head.length > MAX_RECORD_BYTES || !is_read(head.opcode)) {
                self.skip(head.length)?;
                self.at = end;
                continue;
            }
            self.body.resize(head.length as usize, 0);
            self.bytes.read_exact(&mut self.body)?;
            let crc = self.crc.as_mut().filter(|_| head.opcode != op::DATA_END);
            if let Some(crc) = crc {
                crc.update(&self.body);
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
            - i64::try_from(self.bytes.stream_position()?).unwrap_or(0);
        self.bytes.seek_relative(ahead)?;
        let mut bytes = [0; RECORD_HEADER_BYTES as usize];
        self.bytes.read_exact(&mut bytes)?;
        let [opcode, length @ ..] = bytes;
        let length = u64::from_le_bytes(length);
        let is_allowed = !self.is_chunk || matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        let fits = length <= rest - RECORD_HEADER_BYTES
            && least_length(opcode).is_some_and(|least| length >= least);
        Ok((fits && is_allowed).then_some(RecordHeader {
            opcode,
            length,
            bytes,
        }))
    }

    /// Passes over a record that is not needed; its bytes count for the checksum.
    fn skip(&mut self, length: u64) -> io::Result<()> {
        let mut left = length;
        let mut block = [0; 1 << 13];
        while left > 0 {
            let part = left.min(block.len() as u64) as usize;
            self.bytes.read_exact(&mut block[..part])?;
            if let Some(crc) = &mut self.crc {
                crc.update(&block[..part]);
            }
            left -= part as u64;
        }
        Ok(())
    }

    /// There is no record at `offset`: goes to where records begin again.
    fn lost(&mut self, offset: u64) -> io::Result<Frame> {
        self.crc = None;
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
            self.bytes.seek(SeekFrom::Start(block_start))?;
            let size = (self.length - block_start).min(block.len() as u64) as usize;
            self.bytes.read_exact(&mut block[..size])?;
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
            if head.opcode >= PRIVATE_OPCODES {
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
