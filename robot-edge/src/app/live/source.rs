//! The source: messages in, measurements out, nearly in the order of their stamps.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use super::delay_estimator::DelayEstimator;
use super::probe_buffer::ProbeBuffer;
use crate::app::mapping_stage::MAX_QUEUE_DELAY;
use crate::app::source::{Source, SourceItem, SourceLosses};
use crate::clock;
use crate::link::ros2::{Inbox, RosLink, RosMessage};
use crate::survey::Survey;
use measurement::drops::DropReason;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};
use measurement::{Measurement, MeasurementData, Stream};
use recording::messages::{Messages, Reading};
use recording::ros::{Encoding, MessageType};
use recording::time_sequencer::{Ordered, TimeSequencer};
use recording::{Position, RecordingError, Selection};

/// A measurement waits so long for older ones. Longer would put right more, and let the vehicle see later; what comes
/// later than that is mapped all the same.
const REORDER_WINDOW: RobotDuration = RobotDuration::from_millis(50);
const MAX_REORDER_WAIT: Duration = Duration::from_millis(50);

/// Longest wait for a message, so that an interrupt is heard.
const POLL_TIMEOUT: Duration = Duration::from_millis(20);

/// Measurements that are kept while the sensors are looked for, and bytes of their ranges.
const MAX_PROBE_MEASUREMENTS: usize = 50_000;
const MAX_PROBE_BYTES: usize = 64 << 20;

/// Stamps whose arrival is remembered.
const MAX_ARRIVAL_TIMES: usize = 50_000;

/// What is made of what comes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::app) struct StreamSelection {
    /// Names of the streams that are mapped.
    pub(in crate::app) mapped: Vec<String>,
    /// Whether the others are recorded.
    pub(in crate::app) others: bool,
}

/// The sensors of a ROS 2 system.
pub(in crate::app) struct LiveSource {
    link: RosLink,
    inbox: Inbox,
    messages: Messages,
    stream_selection: StreamSelection,
    selection: Selection,
    order: TimeSequencer,
    delay_estimator: DelayEstimator,
    /// When what waits for its turn came, by its stamp.
    arrival_times: BTreeMap<RobotTime, Monotonic>,
    probe_buffer: VecDeque<Measurement>,
    probe_bytes: usize,
    /// Of what was gathered, when it came.
    received_at: VecDeque<Monotonic>,
    probe_dropped: u64,
    /// Scans that mapping was too slow for.
    scans_skipped: u64,
    /// Items have gone out since it last said that there are no more at present.
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
            order: TimeSequencer::live(REORDER_WINDOW),
            delay_estimator: DelayEstimator::default(),
            arrival_times: BTreeMap::new(),
            probe_buffer: VecDeque::new(),
            probe_bytes: 0,
            received_at: VecDeque::new(),
            probe_dropped: 0,
            scans_skipped: 0,
            is_busy: false,
        }
    }

    /// From now on, what comes is made this of. What was gathered goes first.
    pub(in crate::app) fn begin(&mut self, stream_selection: StreamSelection) {
        self.selection = if stream_selection.others {
            Selection::All
        } else {
            Selection::Named(stream_selection.mapped.clone())
        };
        self.stream_selection = stream_selection;
    }

    /// Gathers what comes within `wait`; whether anything did.
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

    /// What has been gathered so far. Errors name it by `place`.
    pub(super) fn survey(&self, place: &str) -> Result<Survey, RecordingError> {
        let probe_buffer = ProbeBuffer {
            measurements: self.probe_buffer.iter(),
            streams: self.messages.streams(),
            losses: self.messages.loss_counts(),
            loss_notes: self.messages.losses().notes(),
        };
        probe_buffer.survey(place)
    }

    /// The connection that it listens to.
    pub(in crate::app) const fn link(&self) -> &RosLink {
        &self.link
    }

    /// Whether static transforms have come.
    pub(super) fn has_static_transforms(&self) -> bool {
        self.probe_buffer
            .iter()
            .any(Measurement::is_static_transform)
    }

    fn buffer_measurement(&mut self, measurement: Measurement, received_at: Monotonic) {
        let bytes = match &measurement.data {
            MeasurementData::Scan { scan, .. } => scan.ranges_m.len() * size_of::<f32>(),
            MeasurementData::Transform { .. }
            | MeasurementData::Odometry { .. }
            | MeasurementData::Imu(_)
            | MeasurementData::Joints(_)
            | MeasurementData::Fix(_)
            | MeasurementData::Twist(_)
            | MeasurementData::PointCloud(_) => 0,
        };
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

    /// Topics that somebody has begun to publish are listened to.
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

    /// Where mapping cannot keep up, it maps less and not later: scans are left out, poses never. Here those that nobody took
    /// in time; where placing goes ahead, mapping leaves out the others.
    fn is_expired(message: &RosMessage) -> bool {
        let is_scan = matches!(
            MessageType::from_type_name(&message.stream.type_name),
            Some(MessageType::LaserScan | MessageType::MultiEchoLaserScan)
        );
        is_scan && clock::elapsed(message.received_at) > MAX_QUEUE_DELAY
    }

    /// What becomes of a measurement at once; nothing where it has to wait for its turn.
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
        self.arrival_times
            .entry(measurement.stamp)
            .and_modify(|known| *known = received_at.min(*known))
            .or_insert(received_at);
        if self.arrival_times.len() > MAX_ARRIVAL_TIMES {
            // Stamps far ahead stay longest, and are the least likely to be true.
            self.arrival_times.pop_last();
        }
        self.order.push(measurement);
        None
    }

    /// What found no room, or waited too long for it.
    fn dropped(&self) -> u64 {
        self.inbox.dropped() + self.probe_dropped + self.scans_skipped
    }

    fn is_mapped(&self, measurement: &Measurement) -> bool {
        let streams = self.messages.streams();
        let stream = streams.get(usize::from(measurement.stream.0));
        stream.is_some_and(|summary| self.stream_selection.mapped.contains(&summary.stream.name))
    }

    /// What waits for its turn and may not wait longer goes on.
    fn release(&mut self, now: Monotonic) {
        while let Some(first) = self.order.oldest_buffered_stamp()
            && self
                .arrival_times
                .get(&first)
                .is_none_or(|&received_at| now.since(received_at) >= MAX_REORDER_WAIT)
        {
            self.order.release_until(first);
        }
    }

    fn next_ordered(&mut self) -> Option<SourceItem> {
        let ordered = self.order.pop()?;
        let measured_at = match &ordered {
            Ordered::Measurement(measurement) => {
                let stamp = &measurement.stamp;
                let received_at = self.arrival_times.get(stamp).copied();
                while self
                    .arrival_times
                    .first_key_value()
                    .is_some_and(|(first, _)| first < stamp)
                {
                    self.arrival_times.pop_first();
                }
                // Only now is its stamp believed. Of what nobody knows when it came, nobody should think that it is young.
                received_at.map_or(Monotonic::from_nanos(0), |received_at| {
                    self.delay_estimator
                        .measured_at(measurement.stream, *stamp, received_at)
                })
            }
            Ordered::ClockReset { .. } => {
                self.delay_estimator.reset_clock();
                clock::now()
            }
        };
        Some(SourceItem::Live {
            ordered,
            measured_at,
        })
    }

    /// The next item that is there already.
    fn next_available(&mut self) -> Option<SourceItem> {
        loop {
            if let Some(item) = self.next_ordered() {
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
                    self.release(clock::now());
                    if let Some(item) = self.next_ordered() {
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
        self.messages.loss_counts().total() + self.order.drops().total() + self.dropped()
    }

    fn lost(&self) -> SourceLosses {
        let mut lost = SourceLosses {
            counts: self.messages.loss_counts().clone(),
            late_scans: self.order.late_scans(),
            notes: self.messages.losses().notes().to_vec(),
            ..SourceLosses::default()
        };
        lost.counts.merge(self.order.drops());
        lost.counts.add_many(DropReason::QueueFull, self.dropped());
        lost
    }
}
