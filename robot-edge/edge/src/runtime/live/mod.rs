//! The live source: ROS 2 messages in, measurements nearly in the order of their stamps out.

mod arrival_order;
mod delay_estimator;
pub(super) mod devices;
mod discovery;

use std::collections::VecDeque;
use std::path::Path;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use self::arrival_order::ArrivalOrder;
use crate::config::RangeSensor;
use crate::ros2::{Inbox, RosLink, RosMessage};
use crate::runtime::mapping_stage::MAX_QUEUE_DELAY;
use crate::runtime::source::{Source, SourceItem, SourceLosses};
use crate::survey::Survey;
use crate::survey::range_sensors::expected_stream;
use measurement::drops::{DropCounts, DropReason};
use measurement::time::Monotonic;
use measurement::{Measurement, Stream};
use network::clock;
use recording::messages::{Messages, Reading};
use recording::ros::{Encoding, MessageType};
use recording::{Format, Position, RecordingError, RecordingReader, Selection, StreamSummary};

pub(super) use discovery::{TopicDiscovery, find};

/// Messages of one moment come over different connections.
const REORDER_WAIT: Duration = Duration::from_millis(50);

/// Longest wait for a message, so that an interrupt takes effect.
const POLL_TIMEOUT: Duration = Duration::from_millis(20);

/// Limits of the measurements that are kept during discovery, and of their payload bytes.
const MAX_PROBE_MEASUREMENTS: usize = 50_000;
const MAX_PROBE_BYTES: usize = 64 << 20;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::runtime) struct StreamSelection {
    pub(in crate::runtime) mapped: Vec<String>,
    /// Whether unmapped streams are recorded.
    pub(in crate::runtime) others: bool,
}

pub(in crate::runtime) struct LiveSource {
    link: RosLink,
    inbox: Inbox,
    messages: Messages,
    stream_selection: StreamSelection,
    selection: Selection,
    order: ArrivalOrder,
    probe_buffer: VecDeque<Measurement>,
    probe_bytes: usize,
    /// Arrival times of `probe_buffer`.
    received_at: VecDeque<Monotonic>,
    probe_dropped: u64,
    /// Scans that were dropped because mapping was too slow.
    scans_skipped: u64,
    /// Items were returned since the last `Idle`.
    is_busy: bool,
}

impl LiveSource {
    pub(super) fn new(link: RosLink, inbox: Inbox) -> Self {
        Self {
            link,
            inbox,
            messages: Messages::default(),
            stream_selection: StreamSelection {
                mapped: Vec::new(),
                others: true,
            },
            selection: Selection::All,
            order: ArrivalOrder::new(REORDER_WAIT),
            probe_buffer: VecDeque::new(),
            probe_bytes: 0,
            received_at: VecDeque::new(),
            probe_dropped: 0,
            scans_skipped: 0,
            is_busy: false,
        }
    }

    /// Starts the run. Measurements of the discovery are returned first.
    pub(in crate::runtime) fn begin(&mut self, stream_selection: StreamSelection) {
        self.selection = if stream_selection.others {
            Selection::All
        } else {
            Selection::Named(stream_selection.mapped.clone())
        };
        self.stream_selection = stream_selection;
    }

    /// Collects measurements for `wait`. Returns whether there were any.
    pub(super) fn probe(&mut self, wait: Duration) -> bool {
        let until = clock::now() + wait;
        let mut has_data = false;
        loop {
            self.subscribe();
            let rest = until.since(clock::now());
            let Ok(message) = self.inbox.take(rest.min(POLL_TIMEOUT)) else {
                if rest.is_zero() {
                    return has_data;
                }
                continue;
            };
            let received_at = message.received_at;
            self.read(&message);
            while let Some(measurement) = self.messages.pop() {
                has_data = true;
                self.buffer_measurement(measurement, received_at);
            }
        }
    }

    /// A survey of the collected measurements; `place` names them in errors.
    pub(super) fn survey(&self, place: &str) -> Result<Survey, RecordingError> {
        let probe_buffer = ProbeBuffer {
            measurements: self.probe_buffer.iter(),
            streams: self.messages.streams(),
            losses: self.messages.loss_counts(),
            loss_notes: self.messages.losses().notes(),
        };
        probe_buffer.survey(place)
    }

    /// Gives the topics of ultrasonic sensors and bumpers their streams: these may send nothing for long.
    pub(super) fn expect_topics(&mut self, sensors: &[RangeSensor<'_>]) {
        for stream in sensors.iter().filter_map(expected_stream) {
            self.messages.stream(&stream, true);
        }
    }

    pub(in crate::runtime) const fn link(&self) -> &RosLink {
        &self.link
    }

    pub(super) fn has_static_transforms(&self) -> bool {
        self.probe_buffer
            .iter()
            .any(Measurement::is_static_transform)
    }

    fn buffer_measurement(&mut self, measurement: Measurement, received_at: Monotonic) {
        let bytes = measurement.data.payload_bytes();
        if self.probe_buffer.len() >= MAX_PROBE_MEASUREMENTS
            || self.probe_bytes + bytes > MAX_PROBE_BYTES
        {
            self.probe_dropped += 1;
            return;
        }
        self.probe_bytes += bytes;
        self.probe_buffer.push_back(measurement);
        self.received_at.push_back(received_at);
    }

    fn subscribe(&self) {
        if let Err(error) = self.link.subscribe_to_announced() {
            tracing::warn!(%error, "a topic is not listened to");
        }
    }

    fn read(&mut self, message: &RosMessage) {
        let kind = MessageType::from_type_name(&message.stream.type_name);
        let Some(stream) = self.messages.stream(&message.stream, kind.is_some()) else {
            return self.messages.losses_mut().add(DropReason::Undecodable, || {
                format!("{}: there are too many topics", message.stream.name)
            });
        };
        let reading = kind
            .filter(|_| self.selection.contains(&message.stream.name))
            .map(|kind| Reading {
                kind,
                encoding: Encoding::Cdr,
                is_static: message.stream.name.ends_with("tf_static"),
            });
        self.messages
            .take(stream, reading, message.published, &message.payload);
    }

    /// If mapping cannot keep up, scans are dropped, and poses never. This drops scans that were not read in time;
    /// the mapping stage drops those that waited in its channel.
    fn is_expired(message: &RosMessage) -> bool {
        let kind = MessageType::from_type_name(&message.stream.type_name);
        let is_scan = kind.is_some_and(|kind| {
            kind.is_cloud()
                || matches!(
                    kind,
                    MessageType::LaserScan | MessageType::MultiEchoLaserScan
                )
        });
        is_scan && clock::elapsed(message.received_at) > MAX_QUEUE_DELAY
    }

    /// Returns a measurement that does not wait to be ordered.
    fn classify(&mut self, measurement: Measurement, received_at: Monotonic) -> Option<SourceItem> {
        if !self.is_mapped(&measurement) {
            return self
                .stream_selection
                .others
                .then_some(SourceItem::Unmapped(measurement));
        }
        if measurement.is_static_transform() {
            return Some(SourceItem::Immediate(measurement));
        }
        self.order.push(measurement, received_at);
        None
    }

    /// Messages that found no room or waited too long.
    fn dropped(&self) -> u64 {
        self.inbox.dropped() + self.probe_dropped + self.scans_skipped
    }

    fn is_mapped(&self, measurement: &Measurement) -> bool {
        let streams = self.messages.streams();
        let stream = streams.get(usize::from(measurement.stream.0));
        stream.is_some_and(|summary| self.stream_selection.mapped.contains(&summary.stream.name))
    }

    fn next_available(&mut self) -> Option<SourceItem> {
        loop {
            if let Some(item) = self.order.next() {
                return Some(item);
            }
            let (measurement, received_at) = self
                .probe_buffer
                .pop_front()
                .zip(self.received_at.pop_front())?;
            if let Some(item) = self.classify(measurement, received_at) {
                return Some(item);
            }
        }
    }
}

impl Source for LiveSource {
    fn next(&mut self) -> Result<Option<SourceItem>, RecordingError> {
        loop {
            if let Some(item) = self.next_available() {
                self.is_busy = true;
                return Ok(Some(item));
            }
            let wait = if self.is_busy {
                Duration::ZERO
            } else {
                POLL_TIMEOUT
            };
            match self.inbox.take(wait) {
                Ok(message) if Self::is_expired(&message) => self.scans_skipped += 1,
                Ok(message) => {
                    let received_at = message.received_at;
                    self.read(&message);
                    while let Some(measurement) = self.messages.pop() {
                        self.probe_buffer.push_back(measurement);
                        self.received_at.push_back(received_at);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.subscribe();
                    self.order.release(clock::now());
                    if let Some(item) = self.order.next() {
                        self.is_busy = true;
                        return Ok(Some(item));
                    }
                    self.is_busy = false;
                    return Ok(Some(SourceItem::Idle));
                }
                Err(RecvTimeoutError::Disconnected) => return Ok(None),
            }
        }
    }

    fn streams_from(&self, from: usize) -> Vec<Stream> {
        let streams = self.messages.streams().iter().skip(from);
        streams.map(|summary| summary.stream.clone()).collect()
    }

    fn position(&self) -> Option<Position> {
        None
    }

    fn lost_total(&self) -> u64 {
        self.messages.loss_counts().total() + self.order.lost_total() + self.dropped()
    }

    fn lost(&self) -> SourceLosses {
        let mut lost = SourceLosses {
            counts: self.messages.loss_counts().clone(),
            notes: self.messages.losses().notes().to_vec(),
            ..SourceLosses::default()
        };
        self.order.add_losses(&mut lost);
        lost.counts.add_many(DropReason::QueueFull, self.dropped());
        lost
    }
}

pub(super) struct ProbeBuffer<'a> {
    pub(super) measurements: std::collections::vec_deque::Iter<'a, Measurement>,
    pub(super) streams: &'a [StreamSummary],
    pub(super) losses: &'a DropCounts,
    pub(super) loss_notes: &'a [String],
}

impl ProbeBuffer<'_> {
    pub(super) fn survey(mut self, place: &str) -> Result<Survey, RecordingError> {
        // They are ROS 2 messages in CDR, as in an MCAP file.
        Survey::of_reader(Path::new(place), Format::Mcap, &mut self)
    }
}

impl RecordingReader for ProbeBuffer<'_> {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        Ok(self.measurements.next().cloned())
    }

    fn streams(&self) -> &[StreamSummary] {
        self.streams
    }

    fn losses(&self) -> &DropCounts {
        self.losses
    }

    fn loss_notes(&self) -> &[String] {
        self.loss_notes
    }

    fn position(&self) -> Position {
        Position {
            bytes_read: 0,
            bytes_total: 0,
        }
    }
}
