//! What the records of a bag say: connections to streams, messages to measurements.

use std::collections::{HashMap, VecDeque};
use std::io::{self, Read, Seek};

use super::super::loss_log::LossLog;
use super::super::{Selection, StreamSummary};
use super::record::{Compression, RecordHeader, connection_type};
use super::record_source::{Found, Record, RecordSource};
use crate::ros::{self, DecodeError, Encoding, MessageType};
use measurement::drops::DropReason;
use measurement::time::RobotTime;
use measurement::{Measurement, Stream, StreamId};

/// Connections and streams that a bag may have; large robots have some hundreds.
const MAX_CONNECTIONS: usize = 10_000;

/// What was read of a bag so far.
#[derive(Debug)]
pub(super) struct Contents {
    selection: Selection,
    pub(super) streams: Vec<StreamSummary>,
    /// Beside each stream: whether a message of it that says nothing was noted.
    loss_reported: Vec<bool>,
    connections: HashMap<u32, Connection>,
    newest_header_stamp: Option<RobotTime>,
    /// Measurements of the last message.
    pub(super) ready: VecDeque<Measurement>,
    pub(super) losses: LossLog,
    data: Vec<u8>,
}

/// Who publishes what where.
#[derive(Clone, Copy, Debug)]
struct Connection {
    stream: StreamId,
    /// `None` where messages are only counted.
    decoded_as: Option<MessageType>,
    is_static_tf: bool,
}

/// What one record was.
#[derive(Debug)]
pub(super) enum WalkStep {
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
    pub(super) fn new(selection: Selection) -> Self {
        Self {
            selection,
            streams: Vec::new(),
            loss_reported: Vec::new(),
            connections: HashMap::new(),
            newest_header_stamp: None,
            ready: VecDeque::new(),
            losses: LossLog::default(),
            data: Vec::new(),
        }
    }

    /// Takes in the next record of `source`; `place` says in words where its byte `at` is.
    pub(super) fn walk<R: Read + Seek>(
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
            RecordHeader::Bag { .. }
            | RecordHeader::Index { .. }
            | RecordHeader::ChunkInfo { .. } => {
                source.skip(record.data_bytes)?;
            }
        }
        Ok(WalkStep::Continue)
    }

    /// Takes in the connections that follow each other in `source`, as they do at the end of a bag: it lists
    /// them all there. What is wrong with them will be met, and counted, when reading gets there.
    pub(super) fn take_connections<R: Read + Seek>(
        &mut self,
        source: &mut RecordSource<R>,
    ) -> io::Result<()> {
        while let Found::Record(record) = source.next()? {
            let is_connection = matches!(record.header, RecordHeader::Connection { .. });
            if !is_connection || self.take_connection(source, &record)?.is_err() {
                break;
            }
        }
        Ok(())
    }

    pub(super) fn count_loss(&mut self, reason: DropReason, note: impl FnOnce() -> String) {
        self.losses.add(reason, note);
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
        let Some(stream) = self.stream(topic, type_name, kind.is_some()) else {
            return Ok(Err("a topic beyond the number any bag has"));
        };
        let connection = Connection {
            stream,
            decoded_as: kind.filter(|_| self.selection.contains(topic)),
            is_static_tf: topic.rsplit('/').next() == Some("tf_static"),
        };
        self.connections.insert(*conn, connection);
        Ok(Ok(()))
    }

    /// The stream of a topic and type: several publishers share one.
    fn stream(&mut self, topic: &str, type_name: String, understood: bool) -> Option<StreamId> {
        let known = |summary: &StreamSummary| {
            summary.stream.name == topic && summary.stream.type_name == type_name
        };
        let index = self
            .streams
            .iter()
            .position(known)
            .unwrap_or(self.streams.len());
        if index >= MAX_CONNECTIONS {
            return None;
        }
        if index == self.streams.len() {
            self.loss_reported.push(false);
            let name = topic.to_owned();
            self.streams.push(StreamSummary {
                stream: Stream { name, type_name },
                understood,
                messages: 0,
                first: None,
                last: None,
            });
        }
        Some(StreamId(index as u16))
    }

    fn take_message<R: Read + Seek>(
        &mut self,
        source: &mut RecordSource<R>,
        record: &Record,
        conn: u32,
        time: RobotTime,
        place: impl Fn(u64) -> String,
    ) -> io::Result<()> {
        let Some(&connection) = self.connections.get(&conn) else {
            self.count_loss(DropReason::Damaged, || {
                format!(
                    "{}: a message of connection {conn}, which is not described",
                    place(record.at)
                )
            });
            return source.skip(record.data_bytes);
        };
        let summary = &mut self.streams[usize::from(connection.stream.0)];
        summary.messages += 1;
        summary.first.get_or_insert(time);
        summary.last = Some(time);
        let Some(kind) = connection.decoded_as else {
            return source.skip(record.data_bytes);
        };
        if !source.read_data(record, &mut self.data)? {
            self.count_loss(DropReason::Damaged, || {
                format!("{}: a message of more than 256 MiB", place(record.at))
            });
            return Ok(());
        }
        let decoded = ros::decode(kind, Encoding::Ros1, connection.is_static_tf, &self.data)
            .unwrap_or_else(|error| vec![Err(error)]);
        for part in decoded {
            match part {
                Ok(ros::Decoded { stamp, frame, data }) => {
                    self.newest_header_stamp = self.newest_header_stamp.max(stamp);
                    self.ready.push_back(Measurement {
                        stamp: stamp.or(self.newest_header_stamp).unwrap_or(time),
                        stream: connection.stream,
                        frame,
                        data,
                    });
                }
                Err(error) => {
                    self.count_lost_message(connection.stream, error, || place(record.at));
                }
            }
        }
        Ok(())
    }

    /// Counts a message that says nothing; the first of its stream in words.
    fn count_lost_message(
        &mut self,
        stream: StreamId,
        error: DecodeError,
        place: impl Fn() -> String,
    ) {
        self.losses.count(error.reason());
        let index = usize::from(stream.0);
        if !std::mem::replace(&mut self.loss_reported[index], true) {
            let name = &self.streams[index].stream.name;
            self.losses.note(|| {
                format!(
                    "{}: a message of {name}: {error} (later ones only counted)",
                    place()
                )
            });
        }
    }
}
