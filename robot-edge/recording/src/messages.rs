//! Decodes messages of a file or a network into measurements and counts losses.

use std::collections::{BTreeMap, VecDeque};

use lidar::{LidarDecoder, Revolution, Sensor};
use measurement::drops::{DropCounts, DropReason};
use measurement::time::RobotTime;
use measurement::{FrameId, Measurement, MeasurementData, Stream, StreamId};

use super::{Position, RecordingError, RecordingReader, Selection, StreamSummary, ros};
use crate::ros::{DecodeError, Encoding, MessageType};

/// Limit on streams, so that damaged or hostile files cannot exhaust memory.
pub const MAX_STREAMS: usize = 4096;

/// How the messages of a stream are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Type of the message.
    pub kind: MessageType,
    /// Encoding of the bytes.
    pub encoding: Encoding,
    /// Whether its transforms hold for all time.
    pub is_static: bool,
}

/// A stream of a file and how its messages are read; `None` if they are only counted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SelectedStream {
    pub(crate) stream: StreamId,
    pub(crate) reading: Option<Reading>,
}

/// A recording of messages.
pub(crate) trait MessageRecording: Send {
    /// What was read so far.
    fn messages(&self) -> &Messages;

    /// For taking measurements.
    fn messages_mut(&mut self) -> &mut Messages;

    /// Reads the next record; `false` at the end.
    fn step(&mut self) -> Result<bool, RecordingError>;

    /// Progress of reading.
    fn position(&self) -> Position;

    /// The vehicle that the recording's metadata names.
    fn vehicle(&self) -> Option<&str> {
        None
    }
}

impl<R: MessageRecording> RecordingReader for R {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        loop {
            let messages = self.messages_mut();
            let next = messages.pop();
            if next.is_some() || messages.is_finished {
                return Ok(next);
            }
            if !self.step()? {
                self.messages_mut().finish();
            }
        }
    }

    fn streams(&self) -> &[StreamSummary] {
        self.messages().streams()
    }

    fn losses(&self) -> &DropCounts {
        self.messages().loss_counts()
    }

    fn loss_notes(&self) -> &[String] {
        self.messages().losses().notes()
    }

    fn position(&self) -> Position {
        MessageRecording::position(self)
    }

    fn vehicle(&self) -> Option<&str> {
        MessageRecording::vehicle(self)
    }
}

/// Reads the messages of several streams and counts what cannot be read.
#[derive(Debug, Default)]
pub struct Messages {
    streams: Vec<StreamSummary>,
    losses: LossLog,
    newest_stamp: Option<RobotTime>,
    /// Of the streams of packets.
    lidars: BTreeMap<StreamId, LidarStream>,
    ready: VecDeque<Measurement>,
    is_finished: bool,
}

impl Messages {
    /// The number of a stream, which is a new one if its name or type is new; `None` if there are too many.
    pub fn stream(&mut self, stream: &Stream, is_understood: bool) -> Option<StreamId> {
        let known = self
            .streams
            .iter()
            .position(|summary| summary.stream == *stream);
        let index = known.unwrap_or(self.streams.len());
        let id = u16::try_from(index)
            .ok()
            .filter(|_| index < MAX_STREAMS)
            .map(StreamId)?;
        if known.is_none() {
            self.streams.push(StreamSummary {
                stream: stream.clone(),
                understood: is_understood,
                messages: 0,
                first: None,
                last: None,
            });
        }
        Some(id)
    }

    /// [`Messages::stream`], whose messages are read as `reading` says if `selection` contains it.
    pub(crate) fn select(
        &mut self,
        stream: &Stream,
        reading: Option<Reading>,
        selection: &Selection,
    ) -> Option<SelectedStream> {
        Some(SelectedStream {
            stream: self.stream(stream, reading.is_some())?,
            reading: reading.filter(|_| selection.contains(&stream.name)),
        })
    }

    /// Takes a message that was logged at `log_time`, if it is known; without `reading` it is only counted.
    pub fn take(
        &mut self,
        stream: StreamId,
        reading: Option<Reading>,
        log_time: Option<RobotTime>,
        message: &[u8],
    ) {
        let Some(summary) = self.streams.get_mut(usize::from(stream.0)) else {
            return;
        };
        summary.messages += 1;
        summary.first = summary.first.or(log_time);
        summary.last = log_time.or(summary.last);
        let Some(Reading {
            kind,
            encoding,
            is_static,
        }) = reading
        else {
            return;
        };
        if kind == MessageType::VelodyneScan {
            return self.take_velodyne_scan(stream, encoding, message);
        }
        match ros::decode(kind, encoding, is_static, message) {
            Ok(parts) => {
                for part in parts {
                    match part {
                        Ok(decoded) => self.take_decoded(stream, log_time, decoded),
                        Err(err) => self.count_lost_message(stream, err),
                    }
                }
            }
            Err(err) => self.count_lost_message(stream, err),
        }
    }

    fn take_velodyne_scan(&mut self, stream: StreamId, encoding: Encoding, message: &[u8]) {
        let packets = ros::velodyne_packets(encoding, message);
        let (frame, packets) = match packets {
            Ok(packets) => packets,
            Err(err) => return self.count_lost_message(stream, err),
        };
        self.add_lidar(stream, frame, || Sensor::Velodyne(Box::default()));
        for (stamp, packet) in packets {
            self.take_packet(stream, stamp, packet);
        }
    }

    /// From now on, packets of this stream are those of a lidar, unless they are already.
    pub(crate) fn add_lidar(
        &mut self,
        stream: StreamId,
        frame: FrameId,
        sensor: impl FnOnce() -> Sensor,
    ) {
        self.lidars.entry(stream).or_insert_with(|| LidarStream {
            decoder: LidarDecoder::new(sensor()),
            frame,
        });
    }

    /// Takes a packet of a lidar.
    pub(crate) fn take_packet(&mut self, stream: StreamId, stamp: RobotTime, packet: &[u8]) {
        let Some(lidar) = self.lidars.get_mut(&stream) else {
            return;
        };
        let before = lidar.decoder.counts().lost;
        let decoded = lidar.decoder.push(stamp, packet);
        let lost = lidar.decoder.counts().lost - before;
        match decoded {
            Ok(revolutions) => {
                let revolutions = revolutions.into_iter();
                self.ready
                    .extend(revolutions.map(|revolution| lidar.measurement(stream, revolution)));
            }
            Err(error) => self.count_loss(stream, DropReason::Undecodable, &error),
        }
        if lost > 0 {
            let why = format!("{lost} packets before it are missing");
            self.count_loss(stream, DropReason::Lost, &why);
            self.losses.count_many(DropReason::Lost, lost - 1);
        }
    }

    /// At the end of the data: what it left unfinished.
    pub(crate) fn finish(&mut self) {
        self.is_finished = true;
        for (stream, lidar) in &mut self.lidars {
            let rest = lidar.decoder.finish();
            self.ready
                .extend(rest.map(|revolution| lidar.measurement(*stream, revolution)));
        }
    }

    /// Whether the end of the data was reached.
    pub(crate) const fn is_finished(&self) -> bool {
        self.is_finished
    }

    /// The next measurement, in the order of the messages.
    pub fn pop(&mut self) -> Option<Measurement> {
        self.ready.pop_front()
    }

    /// The streams met so far; a [`StreamId`] is an index into them.
    pub fn streams(&self) -> &[StreamSummary] {
        &self.streams
    }

    /// Losses.
    pub const fn losses(&self) -> &LossLog {
        &self.losses
    }

    /// The same, to add to it.
    pub const fn losses_mut(&mut self) -> &mut LossLog {
        &mut self.losses
    }

    /// Losses, by reason.
    pub const fn loss_counts(&self) -> &DropCounts {
        self.losses.counts()
    }

    fn take_decoded(
        &mut self,
        stream: StreamId,
        log_time: Option<RobotTime>,
        decoded: ros::Decoded,
    ) {
        // A message without a stamp happened when its neighbours did, on *their* clock.
        let Some(stamp) = decoded.stamp.or(self.newest_stamp).or(log_time) else {
            return self.count_loss(
                stream,
                DropReason::BadStamp,
                &"it has no time: neither a stamp nor a log time",
            );
        };
        self.newest_stamp = self.newest_stamp.max(decoded.stamp);
        self.ready.push_back(Measurement {
            stamp,
            stream,
            frame: decoded.frame,
            data: decoded.data,
        });
    }

    fn count_lost_message(&mut self, stream: StreamId, err: DecodeError) {
        self.count_loss(stream, err.reason(), &err);
    }

    fn count_loss(&mut self, stream: StreamId, reason: DropReason, why: &dyn std::fmt::Display) {
        let Some(summary) = self.streams.get(usize::from(stream.0)) else {
            return;
        };
        self.losses.add(reason, || {
            format!(
                "{}: message {}: {why}",
                summary.stream.name, summary.messages
            )
        });
    }
}

/// A lidar whose packets are read.
#[derive(Debug)]
struct LidarStream {
    decoder: LidarDecoder,
    frame: FrameId,
}

impl LidarStream {
    fn measurement(&self, stream: StreamId, revolution: Revolution) -> Measurement {
        Measurement {
            stamp: revolution.stamp,
            stream,
            frame: FrameId::clone(&self.frame),
            data: MeasurementData::Cloud(revolution.cloud),
        }
    }
}

/// Losses that are described; later ones are only counted.
const NOTES_LIMIT: usize = 20;

/// Counts of losses and the first `NOTES_LIMIT` of them in words.
#[derive(Debug, Default)]
pub struct LossLog {
    counts: DropCounts,
    notes: Vec<String>,
}

impl LossLog {
    /// Counts one loss. `note` describes it and is called only for the first losses.
    pub fn add(&mut self, reason: DropReason, note: impl FnOnce() -> String) {
        self.count(reason);
        self.note(note);
    }

    /// Counts one loss without words.
    pub fn count(&mut self, reason: DropReason) {
        self.count_many(reason, 1);
    }

    /// Counts losses without words.
    pub fn count_many(&mut self, reason: DropReason, losses: u64) {
        self.counts.add_many(reason, losses);
    }

    /// Notes something that cost no data.
    pub fn note(&mut self, note: impl FnOnce() -> String) {
        if self.notes.len() < NOTES_LIMIT {
            self.notes.push(note());
        }
    }

    /// Losses by reason.
    pub const fn counts(&self) -> &DropCounts {
        &self.counts
    }

    /// Descriptions of the first losses.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }
}
