//! ROS 1 bags, version 2.0.
//!
//! Read from front to back as they were recorded, so a bag whose index is damaged or was never written is
//! as good as any.

mod record;

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use measurement::Stream;
use measurement::drops::DropReason;
use measurement::time::RobotTime;

use self::record::{
    Chunk, Compression, Found, Record, RecordHeader, RecordSource, connection_type, decompress,
};
use super::{Position, RecordingError, Selection};
use crate::messages::{MessageRecording, Messages, Reading, SelectedStream};
use crate::ros::{Encoding, MessageType};

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
    pub fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let io_error = RecordingError::io(path);
        let mut file = File::open(path).map_err(io_error)?;
        let bytes_total = file.metadata().map_err(io_error)?.len();
        let mut beginning = Vec::new();
        (&mut file)
            .take(FIRST_LINE_BYTES)
            .read_to_end(&mut beginning)
            .map_err(io_error)?;
        check_first_line(path, &beginning)?;

        let mut contents = Contents {
            selection,
            ..Contents::default()
        };
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
        // A chunk cut by the end of the file is counted when the end is reached.
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

impl MessageRecording for RosbagReader {
    fn messages(&self) -> &Messages {
        &self.contents.messages
    }

    fn messages_mut(&mut self) -> &mut Messages {
        &mut self.contents.messages
    }

    fn step(&mut self) -> Result<bool, RecordingError> {
        self.walk().map_err(RecordingError::io(&self.path))
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
            remedy: "Nothing was recorded, or it was not copied to its end: copy it again",
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

/// Connections and streams that a bag may have; large robots have some hundreds.
const MAX_CONNECTIONS: usize = 10_000;

/// Connections and messages of a bag.
#[derive(Debug, Default)]
struct Contents {
    selection: Selection,
    connections: HashMap<u32, SelectedStream>,
    messages: Messages,
    data: Vec<u8>,
}

/// Kind of one record.
#[derive(Debug)]
enum WalkStep {
    /// Dealt with.
    Continue,
    /// A compressed chunk, whose data is next.
    Chunk {
        record: Record,
        compression: Compression,
        size: u32,
    },
    /// There are no more, and the one at byte `at` is not whole.
    CutOff { at: u64 },
    /// There are no more.
    End,
}

impl Contents {
    /// Reads the next record of `source`; `place` describes an offset.
    fn walk<R: Read + Seek>(
        &mut self,
        source: &mut RecordSource<R>,
        place: impl Fn(u64) -> String,
    ) -> io::Result<WalkStep> {
        let record = match source.next()? {
            Found::Record(record) => record,
            Found::Damage { at, what } => {
                self.count_loss(DropReason::Damaged, || format!("{}: {what}", place(at)));
                return Ok(WalkStep::Continue);
            }
            Found::CutOff { at } => return Ok(WalkStep::CutOff { at }),
            Found::End => return Ok(WalkStep::End),
        };
        match &record.header {
            // Its records follow as if it were not there.
            RecordHeader::Chunk {
                compression: Compression::None,
                ..
            } => {}
            &RecordHeader::Chunk { compression, size } => {
                return Ok(WalkStep::Chunk {
                    record,
                    compression,
                    size,
                });
            }
            RecordHeader::Connection { .. } => {
                if let Err(what) = self.take_connection(source, &record)? {
                    self.count_loss(DropReason::Damaged, || {
                        format!("{}: a connection with {what}", place(record.at))
                    });
                }
            }
            RecordHeader::Message { conn, time } => {
                self.take_message(source, &record, *conn, *time, place)?;
            }
            _ => source.skip(record.data_bytes)?,
        }
        Ok(WalkStep::Continue)
    }

    /// Takes in the connections that follow each other in `source`, as they do at the end of a bag: it lists
    /// them all there. What is wrong with them will be met, and counted, when reading gets there.
    fn take_connections<R: Read + Seek>(&mut self, source: &mut RecordSource<R>) -> io::Result<()> {
        while let Found::Record(record) = source.next()? {
            let is_connection = matches!(record.header, RecordHeader::Connection { .. });
            if !is_connection || self.take_connection(source, &record)?.is_err() {
                break;
            }
        }
        Ok(())
    }

    fn count_loss(&mut self, reason: DropReason, note: impl FnOnce() -> String) {
        self.messages.losses_mut().add(reason, note);
    }

    fn take_connection<R: Read + Seek>(
        &mut self,
        source: &mut RecordSource<R>,
        record: &Record,
    ) -> io::Result<Result<(), &'static str>> {
        let RecordHeader::Connection { conn, topic } = &record.header else {
            return Ok(Ok(()));
        };
        if !source.read_data(record, &mut self.data)? {
            return Ok(Err("a description of more than 256 MiB"));
        }
        let type_name = match connection_type(&self.data) {
            Ok(type_name) => type_name,
            Err(what) => return Ok(Err(what)),
        };
        if self.connections.len() >= MAX_CONNECTIONS && !self.connections.contains_key(conn) {
            return Ok(Err("a number beyond any a bag has"));
        }
        let kind = MessageType::from_type_name(&type_name);
        let reading = kind.map(|kind| Reading {
            kind,
            encoding: Encoding::Ros1,
            is_static: topic.rsplit('/').next() == Some("tf_static"),
        });
        let stream = Stream {
            name: topic.clone(),
            type_name,
        };
        // Several publishers of a topic share one stream.
        let selected = self.messages.select(&stream, reading, &self.selection);
        let Some(selected) = selected else {
            return Ok(Err("a topic beyond the number any bag has"));
        };
        self.connections.insert(*conn, selected);
        Ok(Ok(()))
    }

    fn take_message<R: Read + Seek>(
        &mut self,
        source: &mut RecordSource<R>,
        record: &Record,
        conn: u32,
        time: RobotTime,
        place: impl Fn(u64) -> String,
    ) -> io::Result<()> {
        let Some(&SelectedStream { stream, reading }) = self.connections.get(&conn) else {
            self.count_loss(DropReason::Damaged, || {
                format!(
                    "{}: a message of connection {conn}, which is not described",
                    place(record.at)
                )
            });
            return source.skip(record.data_bytes);
        };
        if reading.is_none() {
            self.messages.take(stream, None, Some(time), &[]);
            return source.skip(record.data_bytes);
        }
        if source.read_data(record, &mut self.data)? {
            self.messages.take(stream, reading, Some(time), &self.data);
        } else {
            self.messages.take(stream, None, Some(time), &[]);
            self.count_loss(DropReason::Damaged, || {
                format!("{}: a message of more than 256 MiB", place(record.at))
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
