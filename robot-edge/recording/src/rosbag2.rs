//! Files of ROS 2 bags that are `SQLite` databases (`.db3`).
//!
//! Source: `rosbag2_storage_sqlite3`: a table `topics` (id, name, type, `serialization_format`) and a table `messages` (id,
//! `topic_id`, timestamp in nanoseconds, data), in the order of writing. With the compression mode `message` each message is a
//! Zstandard frame.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use measurement::Stream;
use measurement::drops::DropReason;
use measurement::time::RobotTime;
use rusqlite::{Connection, OpenFlags};

use super::{Position, RecordingError, Selection};
use crate::messages::{MessageRecording, Messages, Reading, SelectedStream};
use crate::ros::{Encoding, MessageType, ros1_type_name};

pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Messages that are read at once.
const PAGE: i64 = 64;
const ZSTD_MAGIC: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];
/// Greatest length of a message that is decompressed.
const MAX_MESSAGE_BYTES: usize = 256 << 20;

/// Reads the messages of a `.db3` that this program understands.
#[derive(Debug)]
pub(crate) struct Rosbag2Reader {
    file: Connection,
    topics: BTreeMap<i64, SelectedStream>,
    messages: Messages,
    page: VecDeque<Row>,
    last_id: i64,
    /// Greatest id.
    end_id: i64,
    bytes_total: u64,
}

#[derive(Debug)]
struct Row {
    topic: i64,
    time: RobotTime,
    data: Vec<u8>,
}

impl Rosbag2Reader {
    /// Opens the file at `path`, for reading only.
    pub(crate) fn open(path: &Path, selection: &Selection) -> Result<Self, RecordingError> {
        let bytes_total = std::fs::metadata(path)
            .map_err(RecordingError::io(path))?
            .len();
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let damaged = |error: rusqlite::Error| RecordingError::Damaged {
            path: PathBuf::from(path),
            offset: 0,
            what: format!("SQLite says: {error}"),
            remedy: "If it is still being recorded, wait for its end; else `sqlite3 FILE .recover` saves what can be read",
        };
        let file = Connection::open_with_flags(path, flags).map_err(damaged)?;
        // Without it, SQLite refuses a file that is cut. Nothing can be written.
        file.pragma_update(None, "writable_schema", "ON")
            .map_err(damaged)?;
        let mut messages = Messages::default();
        let topics = topics(&file, &mut messages, selection).map_err(damaged)?;
        let end_id = file.query_row("SELECT max(id) FROM messages", [], |row| row.get(0));
        // The end may be damaged; what is before it can be read.
        let end_id: Option<i64> = end_id.ok().flatten();
        Ok(Self {
            file,
            topics,
            messages,
            page: VecDeque::new(),
            last_id: i64::MIN,
            end_id: end_id.unwrap_or_default(),
            bytes_total,
        })
    }

    fn read_page(&mut self) -> rusqlite::Result<()> {
        let mut statement = self.file.prepare_cached(
            "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ?1 ORDER BY id LIMIT ?2",
        )?;
        let mut rows = statement.query((self.last_id, PAGE))?;
        while let Some(row) = rows.next()? {
            self.last_id = row.get(0)?;
            self.page.push_back(Row {
                topic: row.get(1)?,
                time: RobotTime::from_nanos(row.get(2)?),
                data: row.get(3)?,
            });
        }
        Ok(())
    }

    /// Takes the next message; `false` at the end.
    fn read_record(&mut self) -> bool {
        if self.page.is_empty()
            && let Err(error) = self.read_page()
        {
            let id = self.last_id;
            self.messages.losses_mut().add(DropReason::Damaged, || {
                format!("behind message {id}: SQLite says: {error}; the rest is not read")
            });
        }
        let Some(Row { topic, time, data }) = self.page.pop_front() else {
            return false;
        };
        let Some(&SelectedStream { stream, reading }) = self.topics.get(&topic) else {
            self.messages.losses_mut().add(DropReason::Damaged, || {
                format!("a message of topic {topic}, which is not described")
            });
            return true;
        };
        if data.starts_with(ZSTD_MAGIC) && reading.is_some() {
            match zstd::bulk::decompress(&data, MAX_MESSAGE_BYTES) {
                Ok(data) => self.messages.take(stream, reading, Some(time), &data),
                Err(error) => {
                    self.messages.take(stream, None, Some(time), &[]);
                    self.messages.losses_mut().add(DropReason::Damaged, || {
                        format!("a compressed message at {time}: {error}")
                    });
                }
            }
        } else {
            self.messages.take(stream, reading, Some(time), &data);
        }
        true
    }
}

fn topics(
    file: &Connection,
    messages: &mut Messages,
    selection: &Selection,
) -> rusqlite::Result<BTreeMap<i64, SelectedStream>> {
    let mut statement =
        file.prepare("SELECT id, name, type, serialization_format FROM topics ORDER BY id")?;
    let mut rows = statement.query([])?;
    let mut topics = BTreeMap::new();
    while let Some(row) = rows.next()? {
        let (id, name, type_name): (i64, String, String) = (row.get(0)?, row.get(1)?, row.get(2)?);
        let format: String = row.get(3)?;
        let kind = MessageType::from_type_name(&type_name).filter(|_| format == "cdr");
        let reading = kind.map(|kind| Reading {
            kind,
            encoding: Encoding::Cdr,
            is_static: name.ends_with("tf_static"),
        });
        let type_name = ros1_type_name(&type_name);
        let stream = Stream { name, type_name };
        if let Some(selected) = messages.select(&stream, reading, selection) {
            topics.insert(id, selected);
        }
    }
    Ok(topics)
}

impl MessageRecording for Rosbag2Reader {
    fn messages(&self) -> &Messages {
        &self.messages
    }

    fn messages_mut(&mut self) -> &mut Messages {
        &mut self.messages
    }

    fn step(&mut self) -> Result<bool, RecordingError> {
        Ok(self.read_record())
    }

    fn position(&self) -> Position {
        let share = if self.messages.is_finished() || self.end_id <= 0 {
            1.0
        } else {
            self.last_id.max(0) as f64 / self.end_id as f64
        };
        Position {
            bytes_read: (self.bytes_total as f64 * share) as u64,
            bytes_total: self.bytes_total,
        }
    }
}
