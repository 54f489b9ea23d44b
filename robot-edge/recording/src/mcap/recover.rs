//! Salvages a cut-off or damaged MCAP file: all that can be read goes into a new, whole one.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::WriteOptions;
use mcap::records::MessageHeader;

use super::framing::{Frame, Framing, open_checked};
use super::record::{self, Malformed, op};
use crate::RecordingError;
use crate::messages::LossLog;
use measurement::drops::{DropCounts, DropReason};

/// Result of a recovery.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecoverReport {
    /// Messages in the new file.
    pub messages: u64,
    /// Losses, by reason.
    pub losses: DropCounts,
    /// The first few losses in words.
    pub notes: Vec<String>,
}

/// Why nothing was salvaged.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// The damaged file.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The new file.
    #[error("{path}: cannot write what was saved: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system or the format.
        source: mcap::McapError,
    },
}

/// Copies what can be read of `damaged` to `saved`, which must not exist yet. Messages are copied byte by
/// byte, whatever their types; `damaged` is not changed.
pub fn recover(damaged: &Path, saved: &Path) -> Result<RecoverReport, RecoverError> {
    let read_error = |source| RecordingError::Io {
        path: damaged.to_owned(),
        source,
    };
    let write_error = |source| RecoverError::Write {
        path: saved.to_owned(),
        source,
    };
    let mut framing = Framing::new(open_checked(damaged)?).map_err(read_error)?;
    let file = File::create_new(saved).map_err(|err| write_error(err.into()))?;
    let options = WriteOptions::new().profile("ros2").compression_threads(0);
    let writer = options.create(BufWriter::new(file)).map_err(write_error)?;
    let mut copy = Copy {
        writer,
        channels: BTreeMap::new(),
        schemas: BTreeMap::new(),
        messages: 0,
    };
    let mut losses = LossLog::default();
    let mut unpacked = Vec::new();

    while let Some(frame) = framing.next_frame().map_err(read_error)? {
        match frame {
            Frame::Record {
                opcode: op::FOOTER, ..
            } => break,
            Frame::Record {
                opcode: op::CHUNK,
                offset,
            } => {
                let records = record::Chunk::parse(framing.body())
                    .map_err(|Malformed| "its fields are damaged".to_owned())
                    .and_then(|chunk| {
                        record::unpack(&chunk, &mut unpacked).map_err(|err| err.to_string())
                    });
                if let Err(why) = records {
                    losses.add(DropReason::Damaged, || {
                        format!("byte {offset}: a chunk is lost: {why}")
                    });
                    continue;
                }
                for record in record::records(&unpacked) {
                    copy.take(record, offset, &mut losses)
                        .map_err(write_error)?;
                }
            }
            Frame::Record { opcode, offset } => {
                copy.take(Ok((opcode, framing.body())), offset, &mut losses)
                    .map_err(write_error)?;
            }
            Frame::Damaged { offset, bytes } => losses.add(DropReason::Damaged, || {
                format!("byte {offset}: {bytes} bytes are no records")
            }),
            Frame::CutOff { offset } => losses.add(DropReason::CutOff, || {
                format!("byte {offset}: the file ends in the middle of a record")
            }),
        }
    }
    copy.writer.finish().map_err(write_error)?;
    let file = copy
        .writer
        .into_inner()
        .into_inner()
        .map_err(|err| write_error(err.into_error().into()))?;
    file.sync_data().map_err(|err| write_error(err.into()))?;
    let (losses, notes) = (losses.counts().clone(), losses.notes().to_vec());
    Ok(RecoverReport {
        messages: copy.messages,
        losses,
        notes,
    })
}

struct Copy {
    writer: mcap::Writer<BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
}

impl Copy {
    /// Writes one record; one that is malformed or lost its channel is counted.
    fn take(
        &mut self,
        record: Result<(u8, &[u8]), Malformed>,
        offset: u64,
        losses: &mut LossLog,
    ) -> Result<(), mcap::McapError> {
        let written = match record {
            Ok((op::SCHEMA, body)) => {
                record::Schema::parse(body).map(|schema| self.schema(&schema))
            }
            Ok((op::CHANNEL, body)) => {
                record::Channel::parse(body).map(|channel| self.channel(&channel))
            }
            Ok((op::MESSAGE, body)) => record::Message::parse(body).and_then(|message| {
                let id = *self.channels.get(&message.channel_id).ok_or(Malformed)?;
                Ok(self.message(id, &message))
            }),
            Ok((op::METADATA, body)) => {
                record::Metadata::parse(body).map(|metadata| self.metadata(&metadata))
            }
            Ok(_) => Ok(Ok(())),
            Err(Malformed) => Err(Malformed),
        };
        written.unwrap_or_else(|Malformed| {
            losses.add(DropReason::Damaged, || super::malformed(offset));
            Ok(())
        })
    }

    fn schema(&mut self, schema: &record::Schema<'_>) -> Result<(), mcap::McapError> {
        let id = self
            .writer
            .add_schema(schema.name, schema.encoding, schema.definition)?;
        self.schemas.insert(schema.id, id);
        Ok(())
    }

    fn channel(&mut self, channel: &record::Channel<'_>) -> Result<(), mcap::McapError> {
        // Schema 0 means none; a channel whose schema is lost gets none.
        let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
        let metadata = owned(&channel.metadata);
        let id =
            self.writer
                .add_channel(schema, channel.topic, channel.message_encoding, &metadata)?;
        self.channels.insert(channel.id, id);
        Ok(())
    }

    fn message(
        &mut self,
        channel_id: u16,
        message: &record::Message<'_>,
    ) -> Result<(), mcap::McapError> {
        let header = MessageHeader {
            channel_id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        self.messages += 1;
        self.writer.write_to_known_channel(&header, message.data)
    }

    fn metadata(&mut self, metadata: &record::Metadata<'_>) -> Result<(), mcap::McapError> {
        self.writer.write_metadata(&mcap::records::Metadata {
            name: metadata.name.to_owned(),
            metadata: owned(&metadata.entries),
        })
    }
}

fn owned(entries: &BTreeMap<&str, &str>) -> BTreeMap<String, String> {
    entries
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).to_owned()))
        .collect()
}
