//! MCAP files with ROS 2 messages in CDR (or ROS 1 messages, which MCAP can hold too).
//!
//! The `mcap` crate's readers trust the lengths in a file: three changed bytes can make them allocate
//! without limit, and a damaged chunk ends them. So the outer framing is walked here, within limits, and
//! goes on behind damage; writing is the crate's.

mod framing;
mod record;
pub mod recover;

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use framing::{MAGIC, McapRecords, Piece, malformed};
use mcap::records::Channel;
use measurement::Stream;
use measurement::drops::DropReason;
use measurement::time::RobotTime;
use record::{Malformed, op};

use super::{Position, RecordingError, Selection, ros};
use crate::messages::{MAX_STREAMS, MessageRecording, Messages, Reading, SelectedStream};
use crate::ros::{Encoding, MessageType};

/// Name of the metadata record that Foreshore writes, and the key in it that names the vehicle.
pub(super) const METADATA_NAME: &str = "foreshore";
pub(super) const VEHICLE_KEY: &str = "vehicle";

/// Reads an MCAP file from its beginning to its end, in bounded memory: one chunk at a time.
#[derive(Debug)]
pub struct McapReader {
    path: PathBuf,
    records: McapRecords,
    contents: Contents,
}

/// Schemas, channels and messages so far.
#[derive(Debug, Default)]
struct Contents {
    selection: Selection,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, SelectedStream>,
    messages: Messages,
    vehicle: Option<String>,
    data_has_ended: bool,
}

impl McapReader {
    /// Opens the file at `path`.
    pub fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let mut records = McapRecords::open(path)?;
        let summary = read_summary(&mut records).map_err(RecordingError::io(path))?;
        let mut contents = Contents {
            selection,
            ..Contents::default()
        };
        for (opcode, body) in record::any_records(&summary) {
            if matches!(opcode, op::SCHEMA | op::CHANNEL) {
                // A malformed definition is read again in the data section.
                contents.take_record(opcode, body).unwrap_or_default();
            }
        }
        Ok(Self {
            path: path.to_owned(),
            records,
            contents,
        })
    }

    /// Reads on by one record or what is lost in its place; `false` at the end.
    fn read_record(&mut self) -> io::Result<bool> {
        let contents = &mut self.contents;
        match self.records.next()? {
            Some(Piece::Record {
                opcode: op::FOOTER, ..
            }) => {
                if !self.records.ends_with_magic()? {
                    contents.count_lost_end();
                }
                return Ok(false);
            }
            Some(Piece::Record {
                opcode: op::DATA_END,
                body,
                ..
            }) => {
                let expected = record::data_section_crc(body).unwrap_or(0);
                contents.check_data_section(expected, self.records.data_crc());
            }
            Some(Piece::Record {
                opcode,
                offset,
                is_in_chunk,
                body,
            }) => {
                let is_data = matches!(opcode, op::CHUNK | op::MESSAGE) && !is_in_chunk;
                if is_data && contents.data_has_ended {
                    contents.count_damage(|| {
                        format!("byte {offset}: there is data behind the end of the data")
                    });
                }
                if let Err(Malformed) = contents.take_record(opcode, body) {
                    contents.count_damage(|| malformed(offset));
                }
            }
            Some(Piece::Loss { reason, note }) => {
                contents.messages.losses_mut().add(reason, || note);
                return Ok(reason != DropReason::CutOff);
            }
            None => {
                contents.count_lost_end();
                return Ok(false);
            }
        }
        Ok(true)
    }
}

impl Contents {
    fn count_damage(&mut self, note: impl FnOnce() -> String) {
        self.messages.losses_mut().add(DropReason::Damaged, note);
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

    fn take_record(&mut self, opcode: u8, body: &[u8]) -> Result<(), Malformed> {
        match opcode {
            op::SCHEMA => {
                let (schema, _) = record::schema(body)?;
                if self.schemas.len() < MAX_STREAMS {
                    self.schemas.insert(schema.id, schema.name);
                }
            }
            op::CHANNEL => return self.take_channel(record::channel(body)?),
            op::MESSAGE => {
                let (header, data) = record::message(body)?;
                let channel = self.channels.get(&header.channel_id).ok_or(Malformed)?;
                let log_time = i64::try_from(header.log_time).unwrap_or(i64::MAX);
                let log_time = Some(RobotTime::from_nanos(log_time));
                self.messages
                    .take(channel.stream, channel.reading, log_time, data);
            }
            op::METADATA => {
                let mut metadata = record::metadata(body)?;
                if metadata.name == METADATA_NAME {
                    self.vehicle = metadata.metadata.remove(VEHICLE_KEY);
                }
            }
            op::STATISTICS => self.check_statistics(body),
            _ => {}
        }
        Ok(())
    }

    fn take_channel(&mut self, channel: Channel) -> Result<(), Malformed> {
        if self.channels.contains_key(&channel.id) || self.channels.len() >= MAX_STREAMS {
            return Ok(());
        }
        let schema = self.schemas.get(&channel.schema_id);
        let type_name = schema.map_or("", String::as_str);
        let encoding = match channel.message_encoding.as_str() {
            "cdr" => Some(Encoding::Cdr),
            "ros1" => Some(Encoding::Ros1),
            _ => None,
        };
        let kind = MessageType::from_type_name(type_name);
        let reading = kind.zip(encoding).map(|(kind, encoding)| Reading {
            kind,
            encoding,
            is_static: channel.topic.ends_with("tf_static"),
        });
        let stream = Stream {
            name: channel.topic,
            type_name: ros::ros1_type_name(type_name),
        };
        // Merged files and restarted drivers have several channels of one topic.
        let selected = self.messages.select(&stream, reading, &self.selection);
        self.channels.insert(channel.id, selected.ok_or(Malformed)?);
        Ok(())
    }

    /// At the end of the data: was something changed that nothing else showed?
    fn check_data_section(&mut self, expected: u32, found: Option<u32>) {
        self.data_has_ended = true;
        let is_changed = expected != 0 && found.is_some_and(|found| found != expected);
        if is_changed && self.messages.loss_counts().total() == 0 {
            self.count_damage(|| {
                "the checksum of the data section does not fit: something outside of its chunks was changed"
                    .to_owned()
            });
        }
    }

    /// The writer's own count shows what was lost without a trace.
    fn check_statistics(&mut self, body: &[u8]) {
        let streams = self.messages.streams().iter();
        let read: u64 = streams.map(|summary| summary.messages).sum();
        if let Ok(written) = record::message_count(body)
            && read < written
            && self.messages.loss_counts().total() == 0
        {
            self.count_damage(|| {
                format!("{read} messages were read of the {written} that were written")
            });
        }
    }
}

impl MessageRecording for McapReader {
    fn messages(&self) -> &Messages {
        &self.contents.messages
    }

    fn messages_mut(&mut self) -> &mut Messages {
        &mut self.contents.messages
    }

    fn step(&mut self) -> Result<bool, RecordingError> {
        self.read_record().map_err(RecordingError::io(&self.path))
    }

    fn position(&self) -> Position {
        let (bytes_read, bytes_total) = self.records.position();
        Position {
            bytes_read,
            bytes_total,
        }
    }

    fn vehicle(&self) -> Option<&str> {
        self.contents.vehicle.as_deref()
    }
}

/// Larger summaries are not read: they hold indexes of files of hundreds of gigabytes.
const MAX_SUMMARY_BYTES: u64 = 16 << 20;

/// Opcode, length and body of the footer, and the end mark.
const END_BYTES: u64 = 9 + 20 + MAGIC.len() as u64;

/// The summary section; empty where the file has none, or not a whole one.
fn read_summary(records: &mut McapRecords) -> io::Result<Vec<u8>> {
    let (_, length) = records.position();
    let Some(footer_at) = length.checked_sub(END_BYTES) else {
        return Ok(Vec::new());
    };
    let mut end = [0; END_BYTES as usize];
    records.read_at(footer_at, &mut end)?;
    let [opcode, footer @ ..] = end;
    let start = footer
        .get(8..16)
        .and_then(<[u8]>::first_chunk)
        .map_or(0, |raw| u64::from_le_bytes(*raw));
    let is_whole = opcode == op::FOOTER && end.ends_with(&MAGIC);
    if !is_whole || start == 0 || start > footer_at || footer_at - start > MAX_SUMMARY_BYTES {
        return Ok(Vec::new());
    }
    let mut summary = vec![0; (footer_at - start) as usize];
    records.read_at(start, &mut summary)?;
    Ok(summary)
}

#[cfg(test)]
mod tests;
