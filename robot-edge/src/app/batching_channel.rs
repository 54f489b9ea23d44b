//! Steps on their way from who places to who maps.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::anyhow;

use super::mapping_input::MappingInput;
use crate::clock;
use localization::registration::RegistrationOutput;
use measurement::time::Monotonic;

/// Parcels that wait for mapping where all is mapped, however late: who places waits for room. Memory is bounded by …
const QUEUE_CAPACITY: usize = 64;
/// The same where what has waited for `MAX_QUEUE_DELAY` (2 s) is left out: more than come in that time, even at 400 scans a second,
/// so that who places finds room.
const LIVE_QUEUE_CAPACITY: usize = 1024;
/// … the beams in a parcel, and one scan more.
const MAX_BATCH_BEAMS: usize = 4096;
/// Without a scan, mapping tells what it knows this often.
const TICK_INTERVAL: Duration = Duration::from_millis(100);

/// Packs steps: a channel's locks cost more than a step does.
pub(super) struct BatchingSender {
    sender: SyncSender<Vec<MappingInput>>,
    inputs: Vec<MappingInput>,
    beams: usize,
    last_tick: Monotonic,
}

/// A way for parcels of steps, and its other end; whether that leaves out what comes too late.
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
    /// Adds a step, and sends what there is once it can be told or is large.
    ///
    /// # Errors
    /// Where nobody maps any more.
    pub(super) fn add(&mut self, input: MappingInput) -> anyhow::Result<()> {
        let is_due = match &input {
            MappingInput::Registered {
                placed: RegistrationOutput::Scan(scan),
                ..
            } => {
                self.beams += scan.beams.len();
                self.beams >= MAX_BATCH_BEAMS
            }
            MappingInput::Registered {
                placed: RegistrationOutput::Jump(_),
                ..
            }
            | MappingInput::ClockReset => false,
            // Poses come often, and change no map.
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

    /// Sends the rest: no step follows, be it that placing has failed in the middle of a batch.
    ///
    /// # Errors
    /// Where nobody maps any more.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        if self.inputs.is_empty() {
            return Ok(());
        }
        self.send()
    }

    fn send(&mut self) -> anyhow::Result<()> {
        self.beams = 0;
        self.sender
            .send(std::mem::take(&mut self.inputs))
            .map_err(|_closed| anyhow!("mapping has ended"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::mapping_stage::MAX_QUEUE_DELAY;
    use super::*;
    use localization::pose_jump::PoseJump;
    use mapping::registered_scan::{BeamOutcome, RegisteredBeam, RegisteredScan, SensorId};
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
            placed: RegistrationOutput::Scan(RegisteredScan {
                stamp: RobotTime::from_nanos(0),
                sensor: SensorId(0),
                beam_step_rad: 0.01,
                own_body_hits: 0,
                odom_from_base: planar(0.0, 0.0, 0.0),
                beams: vec![beam; beams],
            }),
            measured_at: Monotonic::default(),
            since: Monotonic::default(),
        }
    }

    const TICK: MappingInput = MappingInput::Tick {
        input_delay: None,
        datum: None,
    };

    #[test]
    fn a_parcel_goes_when_it_can_be_told_or_is_large() {
        let (mut sender, receiver) = batching_channel(false);
        sender.last_tick = clock::now() + Duration::from_hours(1);
        // Poses alone are no reason to wake who maps.
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
            placed: RegistrationOutput::Jump(jump),
            measured_at: Monotonic::default(),
            since: Monotonic::default(),
        };
        sender.add(jump).unwrap();
        sender.add(MappingInput::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        sender.add(TICK).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 3);
        // Now and then what there is is told without a scan.
        sender.last_tick = Monotonic::default();
        sender.add(TICK).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 1);
        drop(receiver);
        sender.add(scan(1)).unwrap();
        assert!(sender.add(TICK).is_err(), "nobody maps any more");
    }

    #[test]
    fn the_rest_is_sent_at_the_end() {
        let (mut rest, receiver) = batching_channel(false);
        rest.add(scan(1)).unwrap();
        rest.add(MappingInput::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        rest.finish().unwrap();
        let parcels_left: Vec<_> = receiver.iter().collect();
        assert_eq!((parcels_left.len(), parcels_left[0].len()), (1, 2));
        let (none, receiver) = batching_channel(false);
        none.finish().unwrap();
        assert_eq!(receiver.iter().count(), 0, "nothing is no parcel");
    }

    /// Who tells the guard does not wait for mapping before mapping leaves something out.
    #[test]
    fn there_is_room_for_what_comes_until_it_is_too_late() {
        let in_time = usize::try_from(MAX_QUEUE_DELAY.as_secs()).unwrap() * 400;
        let (live, _receiver) = batching_channel(true);
        let sent = (0..in_time).filter(|_| live.sender.try_send(Vec::new()).is_ok());
        assert_eq!(sent.count(), in_time);
    }
}
