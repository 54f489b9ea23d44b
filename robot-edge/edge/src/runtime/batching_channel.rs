//! The bounded channel from the localization stage to the mapping stage. It carries batches.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::anyhow;

use super::source::SourceItem;
use super::source_reader::Batch;
use localization::registration::RegistrationOutput;
use localization::scan_localization::SavedMap;
use measurement::time::Monotonic;
use network::clock;
use protocol::geodesy::GeodeticPoint;

/// Input of the mapping stage, in the order of the data.
#[derive(Debug)]
pub(super) enum MappingInput {
    /// The clock of the data was reset; scans with stamps of the old clock may follow.
    ClockReset,
    Registered {
        output: RegistrationOutput,
        /// Latest possible time of measurement of a scan.
        measured_at: Monotonic,
        queued_at: Monotonic,
    },
    /// Save the map of the scans so far.
    SaveMap { name: String, map: Box<SavedMap> },
    /// Publish the state up to here.
    Tick {
        input_delay: Option<InputDelay>,
        datum: Option<GeodeticPoint>,
    },
}

#[derive(Clone, Copy, Debug)]
pub(super) struct InputDelay {
    /// The delay at `received_at`.
    lag: Duration,
    received_at: Monotonic,
}

impl InputDelay {
    /// The delay of a batch; `None` if the source has no deadlines.
    pub(super) fn of(batch: &Batch) -> Option<Self> {
        let live = batch.items.iter().find_map(|item| match item {
            // 0 means that the time of arrival is unknown.
            SourceItem::Live { measured_at, .. } => (*measured_at > Monotonic::default())
                .then_some(Self {
                    lag: Duration::ZERO,
                    received_at: *measured_at,
                }),
            SourceItem::Timed(_)
            | SourceItem::Immediate(_)
            | SourceItem::Unmapped(_)
            | SourceItem::Idle => None,
        });
        live.or_else(|| {
            Some(Self {
                lag: batch.lag?,
                received_at: batch.received_at,
            })
        })
    }

    pub(super) fn at(self, now: Monotonic) -> Duration {
        self.lag + now.since(self.received_at)
    }
}

/// Batches in the channel if every scan is mapped: the localization stage waits for room. Memory is bounded by this and
/// [`MAX_BATCH_BEAMS`].
const QUEUE_CAPACITY: usize = 64;
/// Batches in the channel if scans older than `MAX_QUEUE_DELAY` (2 s) are dropped: more than arrive in that time at 400 scans
/// per second, so that the localization stage never waits.
const LIVE_QUEUE_CAPACITY: usize = 1024;
/// A batch is sent when it has this many beams.
const MAX_BATCH_BEAMS: usize = 4096;
/// Interval of ticks without a scan.
const TICK_INTERVAL: Duration = Duration::from_millis(100);

/// Sends inputs in batches: locking the channel for each input costs more than the input.
pub(super) struct BatchingSender {
    sender: SyncSender<Vec<MappingInput>>,
    inputs: Vec<MappingInput>,
    beams: usize,
    last_tick: Monotonic,
}

/// Creates the channel. `is_live`: late scans are dropped.
pub(super) fn batching_channel(is_live: bool) -> (BatchingSender, Receiver<Vec<MappingInput>>) {
    let (sender, receiver) = sync_channel(if is_live {
        LIVE_QUEUE_CAPACITY
    } else {
        QUEUE_CAPACITY
    });
    let sender = BatchingSender {
        sender,
        inputs: Vec::new(),
        beams: 0,
        last_tick: clock::now(),
    };
    (sender, receiver)
}

impl BatchingSender {
    /// Adds an input, and sends the batch at a tick or when it is full. Fails if the mapping stage has ended.
    pub(super) fn add(&mut self, input: MappingInput) -> anyhow::Result<()> {
        let is_due = match &input {
            MappingInput::Registered {
                output: RegistrationOutput::Scan(scan),
                ..
            } => {
                self.beams += scan.beams.len();
                self.beams >= MAX_BATCH_BEAMS
            }
            MappingInput::Registered {
                output:
                    RegistrationOutput::Jump(_)
                    | RegistrationOutput::Corrected(_)
                    | RegistrationOutput::Confidence(_),
                ..
            }
            | MappingInput::ClockReset => false,
            MappingInput::SaveMap { .. } => true,
            // Poses are frequent and change no map.
            MappingInput::Tick { .. }
                if self.inputs.is_empty() && clock::elapsed(self.last_tick) < TICK_INTERVAL =>
            {
                return Ok(());
            }
            MappingInput::Tick { .. } => {
                self.last_tick = clock::now();
                true
            }
        };
        self.inputs.push(input);
        if is_due { self.send() } else { Ok(()) }
    }

    /// Sends the rest. Fails if the mapping stage has ended.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        if self.inputs.is_empty() {
            return Ok(());
        }
        self.send()
    }

    /// A cloud takes the place of as many batches as its beams fill: empty ones before it.
    fn send(&mut self) -> anyhow::Result<()> {
        let places = std::mem::take(&mut self.beams) / MAX_BATCH_BEAMS;
        let empty = std::iter::repeat_with(Vec::new).take(places.saturating_sub(1));
        for batch in empty.chain([std::mem::take(&mut self.inputs)]) {
            self.sender
                .send(batch)
                .map_err(|_closed| anyhow!("mapping has ended"))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::mapping_stage::MAX_QUEUE_DELAY;
    use super::*;
    use localization::pose_buffer::PoseJump;
    use mapping::registered_scan::{
        BeamOutcome, RegisteredBeam, RegisteredScan, ScanKind, SensorId,
    };
    use measurement::pose::planar;
    use measurement::time::RobotTime;
    use nalgebra::Point3;

    fn scan(beams: usize) -> MappingInput {
        let beam = RegisteredBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(1.0, 0.0, 0.0),
            outcome: BeamOutcome::Hit,
            index: 0,
            range_m: 1.0,
        };
        MappingInput::Registered {
            output: RegistrationOutput::Scan(RegisteredScan {
                stamp: RobotTime::from_nanos(0),
                sensor: SensorId(0),
                beam_step_rad: 0.01,
                kind: ScanKind::Beams,
                own_body_hits: 0,
                odom_from_base: planar(0.0, 0.0, 0.0),
                beams: vec![beam; beams],
            }),
            measured_at: Monotonic::default(),
            queued_at: Monotonic::default(),
        }
    }

    const TICK: MappingInput = MappingInput::Tick {
        input_delay: None,
        datum: None,
    };

    #[test]
    fn a_batch_is_sent_at_a_tick_or_when_it_is_full() {
        let (mut sender, receiver) = batching_channel(false);
        sender.last_tick = clock::now() + Duration::from_hours(1);
        // A tick alone does not wake the mapping stage.
        sender.add(TICK).unwrap();
        sender.add(scan(MAX_BATCH_BEAMS - 1)).unwrap();
        assert!(receiver.try_recv().is_err());
        sender.add(scan(1)).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 2);
        let jump = PoseJump {
            stamp: RobotTime::from_nanos(0),
            distance_m: 3.0,
        };
        let jump = MappingInput::Registered {
            output: RegistrationOutput::Jump(jump),
            measured_at: Monotonic::default(),
            queued_at: Monotonic::default(),
        };
        sender.add(jump).unwrap();
        sender.add(MappingInput::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        sender.add(TICK).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 3);
        // After the interval, a tick is sent without a scan.
        sender.last_tick = Monotonic::default();
        sender.add(TICK).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 1);
        sender.add(scan(3 * MAX_BATCH_BEAMS)).unwrap();
        let batches: Vec<_> = receiver.try_iter().map(|batch| batch.len()).collect();
        assert_eq!(batches, [0, 0, 1], "memory is bounded with clouds, too");
        drop(receiver);
        sender.add(scan(1)).unwrap();
        assert!(sender.add(TICK).is_err(), "the mapping stage has ended");
    }

    #[test]
    fn the_rest_is_sent_at_the_end() {
        let (mut rest, receiver) = batching_channel(false);
        rest.add(scan(1)).unwrap();
        rest.add(MappingInput::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        rest.finish().unwrap();
        let batches: Vec<_> = receiver.iter().collect();
        assert_eq!((batches.len(), batches[0].len()), (1, 2));
        let (none, receiver) = batching_channel(false);
        none.finish().unwrap();
        assert_eq!(receiver.iter().count(), 0, "an empty batch is not sent");
    }

    /// The localization stage feeds the collision monitor: it must not wait for mapping.
    #[test]
    fn a_live_channel_has_room_until_scans_are_dropped() {
        let in_time = usize::try_from(MAX_QUEUE_DELAY.as_secs()).unwrap() * 400;
        let (live, _receiver) = batching_channel(true);
        let sent = (0..in_time).filter(|_| live.sender.try_send(Vec::new()).is_ok());
        assert_eq!(sent.count(), in_time);
    }
}
