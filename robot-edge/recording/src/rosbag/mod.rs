//! ROS 1 bags, version 2.0.
//!
//! Read from front to back as they were recorded, so a bag whose index is damaged or was never written is
//! as good as any.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use self::chunk::{Chunk, decompress};
use self::contents::{Contents, WalkStep};
use self::record::{Compression, RecordHeader};
use self::record_source::{Found, Record, RecordSource};
use super::{Position, RecordingError, RecordingReader, Selection, StreamSummary};
use measurement::Measurement;
use measurement::drops::{DropCounts, DropReason};

mod chunk;
mod contents;
mod record;
mod record_source;

/// The first line of a bag.
const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

/// Bytes that hold the first line of a bag of any version.
const FIRST_LINE_BYTES: u64 = 64;

/// Reads the messages of a bag that this program understands.
///
/// A measurement's stamp is its message's header stamp; where that is missing or zero, the newest header
/// stamp met so far; before any, the time at which the message was recorded. Transforms of topics called
/// `tf_static` hold for all time.
#[derive(Debug)]
pub struct RosbagReader {
    path: PathBuf,
    records: RecordSource<BufReader<File>>,
    /// The compressed chunk whose records are next.
    chunk: Option<Chunk>,
    contents: Contents,
    position: Position,
}

impl RosbagReader {
    /// Opens the bag at `path`.
    ///
    /// # Errors
    /// Where the file cannot be opened, is no bag, or is one of another version.
    pub fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let io_error = |source| io_error(path, source);
        let mut file = File::open(path).map_err(io_error)?;
        let bytes_total = file.metadata().map_err(io_error)?.len();
        let mut beginning = Vec::new();
        (&mut file)
            .take(FIRST_LINE_BYTES)
            .read_to_end(&mut beginning)
            .map_err(io_error)?;
        check_first_line(path, &beginning)?;

        let mut contents = Contents::new(selection);
        let at = MAGIC.len() as u64;
        let mut index_pos = 0;
        let mut first =
            RecordSource::new(BufReader::new(&file), at, bytes_total).map_err(io_error)?;
        if let Found::Record(Record {
            header: RecordHeader::Bag { index_pos: pos },
            ..
        }) = first.next().map_err(io_error)?
        {
            index_pos = pos;
        }
        if (at..bytes_total).contains(&index_pos) {
            RecordSource::new(BufReader::new(&file), index_pos, bytes_total)
                .and_then(|mut index| contents.take_connections(&mut index))
                .map_err(io_error)?;
        }
        let reader = BufReader::with_capacity(1 << 16, file);
        let mut records = RecordSource::new(reader, at, bytes_total).map_err(io_error)?;
        records.extend_expected_end(index_pos);
        Ok(Self {
            path: path.to_owned(),
            records,
            chunk: None,
            contents,
            position: Position {
                bytes_read: 0,
                bytes_total,
            },
        })
    }

    /// Takes in the next record; `false` at the end.
    fn walk(&mut self) -> io::Result<bool> {
        if let Some(chunk) = &mut self.chunk {
            let chunk_at = chunk.at;
            let place = |at| format!("byte {chunk_at}, byte {at} of the chunk there");
            match self.contents.walk(&mut chunk.records, place)? {
                WalkStep::Continue => {}
                WalkStep::End => self.chunk = None,
                WalkStep::CutOff { .. } if chunk.is_cut => {}
                WalkStep::CutOff { at } => self.contents.count_loss(DropReason::Damaged, || {
                    format!("{}: the chunk ends inside a record", place(at))
                }),
                WalkStep::Chunk { record, .. } => {
                    self.contents.count_loss(DropReason::Damaged, || {
                        format!("{}: a chunk inside a chunk", place(record.at))
                    });
                    chunk.records.skip(record.data_bytes)?;
                }
            }
            return Ok(true);
        }
        let walked = self
            .contents
            .walk(&mut self.records, |at| format!("byte {at}"))?;
        self.position.bytes_read = self.position.bytes_read.max(self.records.at());
        match walked {
            WalkStep::Continue => {}
            WalkStep::End => return Ok(false),
            WalkStep::CutOff { at } => self.contents.count_loss(DropReason::CutOff, || {
                format!("byte {at}: the recording ends inside what it began")
            }),
            WalkStep::Chunk {
                record,
                compression,
                size,
            } => self.enter(&record, compression, size)?,
        }
        Ok(true)
    }

    /// Makes the records of a compressed chunk the next.
    fn enter(&mut self, record: &Record, compression: Compression, size: u32) -> io::Result<()> {
        let is_cut = self.records.reaches_beyond_end(record);
        let (records, wrong) = self
            .records
            .with_data(record, |data| decompress(compression, size, is_cut, data))?;
        // What the end of the file cuts off is counted there.
        if let Some(what) = wrong.filter(|_| !is_cut) {
            self.contents.count_loss(DropReason::Damaged, || {
                format!("byte {}: {what}", record.at)
            });
        }
        self.chunk = Some(Chunk {
            at: record.at,
            is_cut,
            records: RecordSource::in_memory(records)?,
        });
        Ok(())
    }
}

impl RecordingReader for RosbagReader {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        loop {
            if let Some(measurement) = self.contents.ready.pop_front() {
                return Ok(Some(measurement));
            }
            if !self.walk().map_err(|source| io_error(&self.path, source))? {
                return Ok(None);
            }
        }
    }

    fn streams(&self) -> &[StreamSummary] {
        &self.contents.streams
    }

    fn losses(&self) -> &DropCounts {
        self.contents.losses.counts()
    }

    fn loss_notes(&self) -> &[String] {
        self.contents.losses.notes()
    }

    fn position(&self) -> Position {
        self.position
    }
}

fn check_first_line(path: &Path, beginning: &[u8]) -> Result<(), RecordingError> {
    if beginning.starts_with(MAGIC) {
        return Ok(());
    }
    if MAGIC.starts_with(beginning) {
        return Err(RecordingError::Damaged {
            path: path.to_owned(),
            offset: beginning.len() as u64,
            what: "the file ends in its first line".to_owned(),
            remedy: "Nothing was recorded, or it was not copied to its end: copy it anew",
        });
    }
    let text = String::from_utf8_lossy(beginning);
    let first_line = text.lines().next().unwrap_or("");
    if let Some((_, version)) = first_line.split_once(" V").filter(|_| is_rosbag(beginning)) {
        return Err(RecordingError::UnsupportedVersion {
            path: path.to_owned(),
            format: "ROS bag",
            version: version.to_owned(),
            remedy: "bags have been written in version 2.0 since ROS C Turtle (2010); on a machine with \
                     ROS 1, `rosbag fix OLD.bag NEW.bag` converts it",
        });
    }
    Err(RecordingError::UnknownFormat {
        path: path.to_owned(),
        begins_with: format!("{first_line:?}"),
    })
}

/// Whether a file that begins so is a bag, of whatever version.
pub(super) fn is_rosbag(beginning: &[u8]) -> bool {
    beginning.starts_with(b"#ROSBAG") || beginning.starts_with(b"#ROSRECORD")
}

fn io_error(path: &Path, source: io::Error) -> RecordingError {
    RecordingError::Io {
        path: path.to_owned(),
        source,
    }
}

#[cfg(test)]
mod bag_bytes;
#[cfg(test)]
mod tests;
