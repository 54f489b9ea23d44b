//! MCAP files with ROS 2 messages in CDR (or ROS 1 messages, which MCAP can hold too).
//!
//! The `mcap` crate's readers trust the lengths in a file: three changed bytes can make them allocate
//! without limit, and a damaged chunk ends them. So the outer framing is walked here, within limits, and
//! goes on behind damage; writing is the crate's.

mod framing;
mod record;
pub mod recover;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use framing::{Frame, Framing, MAGIC, open_checked};
use measurement::drops::{DropCounts, DropReason};
use measurement::time::RobotTime;
use measurement::{Measurement, Stream, StreamId};
use record::{Malformed, op};

use super::{Position, RecordingError, RecordingReader, Selection, StreamSummary, ros};
use crate::messages::{MAX_STREAMS, Messages, Reading};
use crate::ros::{Encoding, MessageType};

/// Name of the metadata record that Foreshore writes, and the key in it that names the vehicle.
pub(super) const METADATA_NAME: &str = "foreshore";
pub(super) const VEHICLE_KEY: &str = "vehicle";

/// Reads an MCAP file from its beginning to its end, in bounded memory: one chunk at a time.
#[derive(Debug)]
pub struct McapReader {
    path: PathBuf,
    framing: Framing,
    selection: Selection,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Channel>,
    messages: Messages,
    vehicle: Option<String>,
    chunk: Vec<u8>,
    data_has_ended: bool,
    is_finished: bool,
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    stream: StreamId,
    /// How its messages are read; `None` if they are only counted.
    reading: Option<Reading>,
}

impl McapReader {
    /// Opens the file at `path`.
    pub fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let io_error = |source| RecordingError::Io {
            path: path.to_owned(),
            source,
        };
        let mut file = open_checked(path)?;
        let summary = read_summary(&mut file).map_err(io_error)?;
        let framing = Framing::new(file).map_err(io_error)?;
        let mut reader = Self {
            path: path.to_owned(),
            framing,
            selection,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            messages: Messages::default(),
            vehicle: None,
            chunk: Vec::new(),
            data_has_ended: false,
            is_finished: false,
        };
        for (opcode, body) in summary_definitions(&summary) {
            // A malformed definition is read again in the data section.
            reader.take_record(opcode, body).unwrap_or_default();
        }
        Ok(reader)
    }

    /// Reads on by one outer record; `false` at the end.
    fn step(&mut self) -> Result<bool, RecordingError> {
        let frame = self
            .framing
            .next_frame()
            .map_err(|source| self.io_error(source))?;
        match frame {
            Some(Frame::Record {
                opcode: op::FOOTER, ..
            }) => {
                let is_whole = self
                    .framing
                    .ends_with_magic()
                    .map_err(|source| self.io_error(source))?;
                if !is_whole {
                    self.count_lost_end();
                }
                return Ok(false);
            }
            Some(Frame::Record {
                opcode: op::DATA_END,
                ..
            }) => self.check_data_section(),
            Some(Frame::Record {
                opcode: op::STATISTICS,
                ..
            }) => self.check_statistics(),
            Some(Frame::Record { opcode, offset }) => {
                if self.data_has_ended && matches!(opcode, op::CHUNK | op::MESSAGE) {
                    self.messages.losses_mut().add(DropReason::Damaged, || {
                        format!("byte {offset}: there is data behind the end of the data")
                    });
                }
                if opcode == op::CHUNK {
                    self.take_chunk(offset);
                } else {
                    self.take_outer_record(opcode, offset);
                }
            }
            Some(Frame::Damaged { offset, bytes }) => {
                self.messages.losses_mut().add(DropReason::Damaged, || {
                    format!(
                        "byte {offset}: {bytes} bytes are no records; reading went on behind them"
                    )
                });
            }
            Some(Frame::CutOff { offset }) => {
                self.messages.losses_mut().add(DropReason::CutOff, || {
                    format!("byte {offset}: the file ends in the middle of a record")
                });
                return Ok(false);
            }
            None => {
                self.count_lost_end();
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn take_outer_record(&mut self, opcode: u8, offset: u64) {
        let body = std::mem::take(self.framing.body_mut());
        if self.take_record(opcode, &body).is_err() {
            self.messages
                .losses_mut()
                .add(DropReason::Damaged, || malformed(offset));
        }
        *self.framing.body_mut() = body;
    }

    fn count_lost_end(&mut self) {
        let data = if self.data_has_ended {
            "its data is complete"
        } else {
            "its recorder was stopped too early"
        };
        self.messages.losses_mut().add(DropReason::CutOff, || {
            format!("the file ends without its end mark: {data}")
        });
    }

    fn io_error(&self, source: std::io::Error) -> RecordingError {
        RecordingError::Io {
            path: self.path.clone(),
            source,
        }
    }

    fn take_chunk(&mut self, offset: u64) {
        let body = std::mem::take(self.framing.body_mut());
        let mut records = std::mem::take(&mut self.chunk);
        let unpacked = record::Chunk::parse(&body)
            .map_err(|Malformed| malformed(offset))
            .and_then(|chunk| {
                record::unpack(&chunk, &mut records)
                    .map_err(|err| format!("byte {offset}: a chunk is lost: {err}"))
            });
        match unpacked {
            Ok(()) => {
                for record in record::records(&records) {
                    let taken = record.and_then(|(opcode, body)| self.take_record(opcode, body));
                    if taken.is_err() {
                        self.messages
                            .losses_mut()
                            .add(DropReason::Damaged, || malformed(offset));
                    }
                }
            }
            Err(note) => self.messages.losses_mut().add(DropReason::Damaged, || note),
        }
        *self.framing.body_mut() = body;
        self.chunk = records;
    }

    fn take_record(&mut self, opcode: u8, body: &[u8]) -> Result<(), Malformed> {
        match opcode {
            op::SCHEMA => {
                let schema = record::Schema::parse(body)?;
                if self.schemas.len() < MAX_STREAMS {
                    self.schemas.insert(schema.id, schema.name.to_owned());
                }
                Ok(())
            }
            op::CHANNEL => self.take_channel(&record::Channel::parse(body)?),
            op::MESSAGE => self.take_message(&record::Message::parse(body)?),
            op::METADATA => {
                let metadata = record::Metadata::parse(body)?;
                if metadata.name == METADATA_NAME {
                    self.vehicle = metadata
                        .entries
                        .get(VEHICLE_KEY)
                        .map(|&name| name.to_owned());
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn take_channel(&mut self, channel: &record::Channel<'_>) -> Result<(), Malformed> {
        if self.channels.contains_key(&channel.id) || self.channels.len() >= MAX_STREAMS {
            return Ok(());
        }
        let type_name = self
            .schemas
            .get(&channel.schema_id)
            .map_or("", String::as_str);
        let encoding = match channel.message_encoding {
            "cdr" => Some(Encoding::Cdr),
            "ros1" => Some(Encoding::Ros1),
            _ => None,
        };
        let reading =
            MessageType::from_type_name(type_name)
                .zip(encoding)
                .map(|(kind, encoding)| Reading {
                    kind,
                    encoding,
                    is_static: channel.topic.ends_with("tf_static"),
                });
        let stream = Stream {
            name: channel.topic.to_owned(),
            type_name: ros::ros1_type_name(type_name),
        };
        // Merged files and restarted drivers have several channels of one topic.
        let id = self
            .messages
            .stream(&stream, reading.is_some())
            .ok_or(Malformed)?;
        let reading = reading.filter(|_| self.selection.contains(channel.topic));
        self.channels.insert(
            channel.id,
            Channel {
                stream: id,
                reading,
            },
        );
        Ok(())
    }

    fn take_message(&mut self, message: &record::Message<'_>) -> Result<(), Malformed> {
        let &Channel { stream, reading } =
            self.channels.get(&message.channel_id).ok_or(Malformed)?;
        let log_time = RobotTime::from_nanos(i64::try_from(message.log_time).unwrap_or(i64::MAX));
        self.messages
            .take(stream, reading, Some(log_time), message.data);
        Ok(())
    }

    /// At the end of the data: was something changed that nothing else showed?
    fn check_data_section(&mut self) {
        self.data_has_ended = true;
        let expected = record::data_section_crc(self.framing.body()).unwrap_or(0);
        if let Some(found) = self.framing.crc_before_last_record()
            && expected != 0
            && found != expected
            && self.messages.loss_counts().total() == 0
        {
            self.messages.losses_mut().add(DropReason::Damaged, || {
                "the checksum of the data section does not fit: something outside of its chunks was changed"
                    .to_owned()
            });
        }
    }

    /// The writer's own count shows what was lost without a trace.
    fn check_statistics(&mut self) {
        let read: u64 = self
            .messages
            .streams()
            .iter()
            .map(|summary| summary.messages)
            .sum();
        match record::message_count(self.framing.body()) {
            Ok(written) if read < written && self.messages.loss_counts().total() == 0 => {
                self.messages.losses_mut().add(DropReason::Damaged, || {
                    format!("{read} messages were read of the {written} that were written")
                });
            }
            Ok(_) | Err(Malformed) => {}
        }
    }
}

fn malformed(offset: u64) -> String {
    format!("byte {offset}: a record does not hold its fields")
}

impl RecordingReader for McapReader {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        loop {
            if let Some(measurement) = self.messages.pop() {
                return Ok(Some(measurement));
            }
            if self.is_finished {
                return Ok(None);
            }
            self.is_finished = !self.step()?;
        }
    }

    fn streams(&self) -> &[StreamSummary] {
        self.messages.streams()
    }

    fn losses(&self) -> &DropCounts {
        self.messages.loss_counts()
    }

    fn loss_notes(&self) -> &[String] {
        self.messages.losses().notes()
    }

    fn position(&self) -> Position {
        let (bytes_read, bytes_total) = self.framing.position();
        Position {
            bytes_read,
            bytes_total,
        }
    }

    fn vehicle(&self) -> Option<&str> {
        self.vehicle.as_deref()
    }
}

/// Larger summaries are not read: they hold indexes of files of hundreds of gigabytes.
const MAX_SUMMARY_BYTES: u64 = 16 << 20;

/// Opcode, length and body of the footer, and the end mark.
const END_BYTES: u64 = 9 + 20 + MAGIC.len() as u64;

/// The summary section of `file`; empty where it has none, or not a whole one.
fn read_summary(file: &mut File) -> io::Result<Vec<u8>> {
    let length = file.metadata()?.len();
    let Some(footer_at) = length.checked_sub(END_BYTES) else {
        return Ok(Vec::new());
    };
    file.seek(SeekFrom::Start(footer_at))?;
    let mut end = [0; END_BYTES as usize];
    file.read_exact(&mut end)?;
    let [opcode, footer @ ..] = end;
    let start = footer
        .get(8..16)
        .and_then(<[u8]>::first_chunk)
        .map_or(0, |raw| u64::from_le_bytes(*raw));
    let is_whole = opcode == op::FOOTER && end.ends_with(&MAGIC);
    if !is_whole || start == 0 || start > footer_at || footer_at - start > MAX_SUMMARY_BYTES {
        return Ok(Vec::new());
    }
    file.seek(SeekFrom::Start(start))?;
    let mut summary = vec![0; (footer_at - start) as usize];
    file.read_exact(&mut summary)?;
    Ok(summary)
}

/// The schemas and channels in a summary, opcode and body, in file order.
fn summary_definitions(summary: &[u8]) -> impl Iterator<Item = (u8, &[u8])> {
    record::any_records(summary).filter(|(opcode, _)| matches!(*opcode, op::SCHEMA | op::CHANNEL))
}

#[cfg(test)]
mod tests;
