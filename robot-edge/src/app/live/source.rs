//! The source: messages in, measurements out, nearly in the order of their stamps.

use std::collections::{BTreeMap, VecDeque};
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use super::gathered::Gathered;
use super::lateness::Lateness;
use crate::app::mapping_side::LONGEST_LAG;
use crate::app::source::{Item, Lost, Source};
use crate::clock::Monotonic;
use crate::drops::DropReason;
use crate::link::ros2::{Heard, Inbox, RosLink};
use crate::measurement::{Measurement, MeasurementData, Stream};
use crate::recording::messages::{Messages, Reading};
use crate::recording::stamp_order::{Ordered, StampOrder};
use crate::recording::survey::Survey;
use crate::recording::{Position, RecordingError, Selection};
use crate::robot_time::{RobotDuration, RobotTime};
use crate::ros::{Encoding, MessageType};

/// A measurement waits so long for older ones. Longer would put right more, and let the vehicle see later; what comes
/// later than that is mapped all the same.
const HOLD: RobotDuration = RobotDuration::from_millis(50);
const HOLD_AT_MOST: Duration = Duration::from_millis(50);

/// Longest wait for a message, so that an interrupt is heard.
const NAP: Duration = Duration::from_millis(20);

/// Measurements that are kept while the sensors are looked for, and bytes of their ranges.
const MAX_GATHERED: usize = 50_000;
const MAX_GATHERED_BYTES: usize = 64 << 20;

/// Stamps whose arrival is remembered.
const MAX_ARRIVALS: usize = 50_000;

/// What is made of what comes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::app) struct Wanted {
    /// Names of the streams that are mapped.
    pub(in crate::app) mapped: Vec<String>,
    /// Whether the others are recorded.
    pub(in crate::app) others: bool,
}

/// The sensors of a ROS 2 system.
pub(in crate::app) struct Live {
    link: RosLink,
    inbox: Inbox,
    messages: Messages,
    wanted: Wanted,
    selection: Selection,
    order: StampOrder,
    lateness: Lateness,
    /// When what waits for its turn came, by its stamp.
    arrivals: BTreeMap<RobotTime, Monotonic>,
    gathered: VecDeque<Measurement>,
    gathered_bytes: usize,
    /// Of what was gathered, when it came.
    came: VecDeque<Monotonic>,
    not_gathered: u64,
    /// Scans that mapping was too slow for.
    skipped: u64,
    /// Items have gone out since it last said that there are no more at present.
    is_busy: bool,
}

impl Live {
    pub(super) fn new(link: RosLink, inbox: Inbox) -> Self {
        Self {
            link,
            inbox,
            messages: Messages::default(),
            wanted: Wanted {
                mapped: Vec::new(),
                others: true,
            },
            selection: Selection::All,
            order: StampOrder::live(HOLD),
            lateness: Lateness::default(),
            arrivals: BTreeMap::new(),
            gathered: VecDeque::new(),
            gathered_bytes: 0,
            came: VecDeque::new(),
            not_gathered: 0,
            skipped: 0,
            is_busy: false,
        }
    }

    /// From now on, what comes is made this of. What was gathered goes first.
    pub(in crate::app) fn begin(&mut self, wanted: Wanted) {
        self.selection = if wanted.others {
            Selection::All
        } else {
            Selection::Named(wanted.mapped.clone())
        };
        self.wanted = wanted;
    }

    /// Gathers what comes within `wait`; whether anything did.
    pub(super) fn gather(&mut self, wait: Duration) -> bool {
        let until = Monotonic::now() + wait;
        let mut has_come = false;
        loop {
            self.subscribe();
            let rest = until.since(Monotonic::now());
            let Ok(heard) = self.inbox.take(rest.min(NAP)) else {
                if rest.is_zero() {
                    return has_come;
                }
                continue;
            };
            let came = heard.came;
            self.read(&heard);
            while let Some(measurement) = self.messages.pop() {
                has_come = true;
                self.keep(measurement, came);
            }
        }
    }

    /// What has been gathered so far. Errors name it by `place`.
    pub(super) fn survey(&self, place: &str) -> Result<Survey, RecordingError> {
        let gathered = Gathered {
            measurements: self.gathered.iter(),
            streams: self.messages.streams(),
            losses: self.messages.loss_counts(),
            loss_notes: self.messages.losses().notes(),
        };
        gathered.survey(place)
    }

    /// The connection that it listens to.
    pub(in crate::app) const fn link(&self) -> &RosLink {
        &self.link
    }

    /// Whether static transforms have come.
    pub(super) fn has_static_transforms(&self) -> bool {
        self.gathered.iter().any(Measurement::is_timeless)
    }

    fn keep(&mut self, measurement: Measurement, came: Monotonic) {
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
        if self.gathered.len() >= MAX_GATHERED || self.gathered_bytes + bytes > MAX_GATHERED_BYTES {
            self.not_gathered += 1;
            return;
        }
        self.gathered_bytes += bytes;
        self.gathered.push_back(measurement);
        self.came.push_back(came);
    }

    /// Topics that somebody has begun to publish are listened to.
    fn subscribe(&self) {
        if let Err(error) = self.link.subscribe_to_announced() {
            tracing::warn!(%error, "a topic is not listened to");
        }
    }

    fn read(&mut self, heard: &Heard) {
        let kind = MessageType::from_type_name(&heard.stream.type_name);
        let Some(stream) = self.messages.stream(&heard.stream, kind.is_some()) else {
            return self.messages.losses_mut().add(DropReason::Undecodable, || {
                format!("{}: there are too many topics", heard.stream.name)
            });
        };
        let reading = kind
            .filter(|_| self.selection.contains(&heard.stream.name))
            .map(|kind| Reading {
                kind,
                encoding: Encoding::Cdr,
                is_static: heard.stream.name.ends_with("tf_static"),
            });
        self.messages
            .take(stream, reading, heard.published, &heard.message);
    }

    /// Where mapping cannot keep up, it maps less and not later: scans are left out, poses never. Here those that nobody took
    /// in time; where placing goes ahead, mapping leaves out the others.
    fn is_too_late(heard: &Heard) -> bool {
        let is_scan = matches!(
            MessageType::from_type_name(&heard.stream.type_name),
            Some(MessageType::LaserScan | MessageType::MultiEchoLaserScan)
        );
        is_scan && heard.came.elapsed() > LONGEST_LAG
    }

    /// What becomes of a measurement at once; nothing where it has to wait for its turn.
    fn sort(&mut self, measurement: Measurement, came: Monotonic) -> Option<Item> {
        if !self.is_mapped(&measurement) {
            return self.wanted.others.then_some(Item::Aside(measurement));
        }
        if measurement.is_timeless() {
            return Some(Item::AtOnce(measurement));
        }
        self.arrivals
            .entry(measurement.stamp)
            .and_modify(|known| *known = came.min(*known))
            .or_insert(came);
        if self.arrivals.len() > MAX_ARRIVALS {
            // Stamps far ahead stay longest, and are the least likely to be true.
            self.arrivals.pop_last();
        }
        self.order.push(measurement);
        None
    }

    /// What found no room, or waited too long for it.
    fn overflown(&self) -> u64 {
        self.inbox.overflown() + self.not_gathered + self.skipped
    }

    fn is_mapped(&self, measurement: &Measurement) -> bool {
        let streams = self.messages.streams();
        let stream = streams.get(usize::from(measurement.stream.0));
        stream.is_some_and(|summary| self.wanted.mapped.contains(&summary.stream.name))
    }

    /// What waits for its turn and may not wait longer goes on.
    fn release(&mut self, now: Monotonic) {
        while let Some(first) = self.order.first_waiting()
            && self
                .arrivals
                .get(&first)
                .is_none_or(|&came| now.since(came) >= HOLD_AT_MOST)
        {
            self.order.release_until(first);
        }
    }

    fn next_in_turn(&mut self) -> Option<Item> {
        let ordered = self.order.pop()?;
        let taken = match &ordered {
            Ordered::Measurement(measurement) => {
                let stamp = &measurement.stamp;
                let came = self.arrivals.get(stamp).copied();
                while self
                    .arrivals
                    .first_key_value()
                    .is_some_and(|(first, _)| first < stamp)
                {
                    self.arrivals.pop_first();
                }
                // Only now is its stamp believed. Of what nobody knows when it came, nobody should think that it is young.
                came.map_or(Monotonic::from_nanos(0), |came| {
                    self.lateness.taken(measurement.stream, *stamp, came)
                })
            }
            Ordered::ClockReset { .. } => {
                self.lateness.reset_clock();
                Monotonic::now()
            }
        };
        Some(Item::Came { ordered, taken })
    }

    /// The next item that is there already.
    fn next_at_hand(&mut self) -> Option<Item> {
        loop {
            if let Some(item) = self.next_in_turn() {
                return Some(item);
            }
            let (measurement, came) = self.gathered.pop_front().zip(self.came.pop_front())?;
            if let Some(item) = self.sort(measurement, came) {
                return Some(item);
            }
        }
    }
}

impl Source for Live {
    fn next(&mut self) -> Result<Option<Item>, RecordingError> {
        loop {
            if let Some(item) = self.next_at_hand() {
                self.is_busy = true;
                return Ok(Some(item));
            }
            let wait = if self.is_busy { Duration::ZERO } else { NAP };
            match self.inbox.take(wait) {
                Ok(heard) if Self::is_too_late(&heard) => self.skipped += 1,
                Ok(heard) => {
                    let came = heard.came;
                    self.read(&heard);
                    while let Some(measurement) = self.messages.pop() {
                        self.gathered.push_back(measurement);
                        self.came.push_back(came);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    self.subscribe();
                    self.release(Monotonic::now());
                    if let Some(item) = self.next_in_turn() {
                        self.is_busy = true;
                        return Ok(Some(item));
                    }
                    self.is_busy = false;
                    return Ok(Some(Item::Pause));
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
        self.messages.loss_counts().total() + self.order.drops().total() + self.overflown()
    }

    fn lost(&self) -> Lost {
        let mut lost = Lost {
            counts: self.messages.loss_counts().clone(),
            late_scans: self.order.late_scans(),
            notes: self.messages.losses().notes().to_vec(),
            ..Lost::default()
        };
        lost.counts.merge(self.order.drops());
        lost.counts
            .add_many(DropReason::QueueFull, self.overflown());
        lost
    }
}
