//! Salvages a cut-off or damaged MCAP file: all that can be read goes into a new, whole one.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};

use mcap::WriteOptions;

use super::framing::{McapRecords, Piece, malformed};
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
    let read_error = RecordingError::io(damaged);
    let write_error = |source| RecoverError::Write {
        path: saved.to_owned(),
        source,
    };
    let mut records = McapRecords::open(damaged)?;
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
    while let Some(piece) = records.next().map_err(read_error)? {
        match piece {
            Piece::Record {
                opcode: op::FOOTER, ..
            } => break,
            Piece::Record {
                opcode,
                offset,
                body,
                ..
            } => match copy.take(opcode, body) {
                Ok(()) => {}
                Err(CopyError::Malformed) => losses.add(DropReason::Damaged, || malformed(offset)),
                Err(CopyError::Write(source)) => return Err(write_error(source)),
            },
            Piece::Loss { reason, note } => losses.add(reason, || note),
        }
    }
    copy.writer.finish().map_err(write_error)?;
    let written = copy.writer.into_inner().into_inner();
    let file = written.map_err(|err| write_error(err.into_error().into()))?;
    file.sync_data().map_err(|err| write_error(err.into()))?;
    Ok(RecoverReport {
        messages: copy.messages,
        losses: losses.counts().clone(),
        notes: losses.notes().to_vec(),
    })
}

struct Copy {
    writer: mcap::Writer<BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
}

/// Why a record is not copied.
enum CopyError {
    /// It is malformed, or has lost its channel.
    Malformed,
    Write(mcap::McapError),
}

impl From<Malformed> for CopyError {
    fn from(Malformed: Malformed) -> Self {
        Self::Malformed
    }
}

impl From<mcap::McapError> for CopyError {
    fn from(error: mcap::McapError) -> Self {
        Self::Write(error)
    }
}

impl Copy {
    /// Writes one record.
    fn take(&mut self, opcode: u8, body: &[u8]) -> Result<(), CopyError> {
        match opcode {
            op::SCHEMA => {
                let (schema, definition) = record::schema(body)?;
                let id = self
                    .writer
                    .add_schema(&schema.name, &schema.encoding, definition)?;
                self.schemas.insert(schema.id, id);
            }
            op::CHANNEL => {
                let channel = record::channel(body)?;
                // Schema 0 means none; a channel whose schema is lost gets none.
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let id = self.writer.add_channel(
                    schema,
                    &channel.topic,
                    &channel.message_encoding,
                    &channel.metadata,
                )?;
                self.channels.insert(channel.id, id);
            }
            op::MESSAGE => {
                let (mut header, data) = record::message(body)?;
                header.channel_id = *self.channels.get(&header.channel_id).ok_or(Malformed)?;
                self.messages += 1;
                self.writer.write_to_known_channel(&header, data)?;
            }
            op::METADATA => self.writer.write_metadata(&record::metadata(body)?)?,
            _ => {}
        }
        Ok(())
    }
}
