//! Steps on their way from who places to who maps.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

use anyhow::anyhow;

use super::step::Step;
use crate::clock::Monotonic;
use crate::localization::placer::Placed;

/// Parcels that wait for mapping where all is mapped, however late: who places waits for room. Memory is bounded by …
const WAITING: usize = 64;
/// The same where what has waited for `LONGEST_LAG` (2 s) is left out: more than come in that time, even at 400 scans a second,
/// so that who places finds room.
const WAITING_LIVE: usize = 1024;
/// … the beams in a parcel, and one scan more.
const PARCEL_BEAMS: usize = 4096;
/// Without a scan, mapping tells what it knows this often.
const TELL_APART: Duration = Duration::from_millis(100);

/// Packs steps: a channel's locks cost more than a step does.
pub(super) struct Parcels {
    sender: SyncSender<Vec<Step>>,
    steps: Vec<Step>,
    beams: usize,
    told: Monotonic,
}

/// A way for parcels of steps, and its other end; whether that leaves out what comes too late.
pub(super) fn parcels(is_live: bool) -> (Parcels, Receiver<Vec<Step>>) {
    let (sender, receiver) = sync_channel(if is_live { WAITING_LIVE } else { WAITING });
    let parcels = Parcels {
        sender,
        steps: Vec::new(),
        beams: 0,
        told: Monotonic::now(),
    };
    (parcels, receiver)
}

impl Parcels {
    /// Adds a step, and sends what there is once it can be told or is large.
    ///
    /// # Errors
    /// Where nobody maps any more.
    pub(super) fn add(&mut self, step: Step) -> anyhow::Result<()> {
        let is_due = match &step {
            Step::Placed {
                placed: Placed::Scan(scan),
                ..
            } => {
                self.beams += scan.beams.len();
                self.beams >= PARCEL_BEAMS
            }
            Step::Placed {
                placed: Placed::Jump(_),
                ..
            }
            | Step::ClockReset => false,
            // Poses come often, and change no map.
            Step::Told { .. } if self.steps.is_empty() && self.told.elapsed() < TELL_APART => {
                return Ok(());
            }
            Step::Told { .. } => {
                self.told = Monotonic::now();
                true
            }
        };
        self.steps.push(step);
        if is_due { self.send() } else { Ok(()) }
    }

    /// Sends the rest: no step follows, be it that placing has failed in the middle of a batch.
    ///
    /// # Errors
    /// Where nobody maps any more.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        if self.steps.is_empty() {
            return Ok(());
        }
        self.send()
    }

    fn send(&mut self) -> anyhow::Result<()> {
        self.beams = 0;
        self.sender
            .send(std::mem::take(&mut self.steps))
            .map_err(|_closed| anyhow!("mapping has ended"))
    }
}

#[cfg(test)]
mod tests {
    use super::super::mapping_side::LONGEST_LAG;
    use super::*;
    use crate::localization::pose_jump::PoseJump;
    use crate::mapping::posed_scan::{BeamOutcome, PosedBeam, PosedScan, SensorId};
    use crate::pose::planar;
    use crate::robot_time::RobotTime;
    use nalgebra::Point3;

    fn scan(beams: usize) -> Step {
        let beam = PosedBeam {
            origin_in_odom: Point3::origin(),
            end_in_odom: Point3::new(1.0, 0.0, 0.0),
            outcome: BeamOutcome::Hit,
            index: 0,
            range_m: 1.0,
        };
        Step::Placed {
            placed: Placed::Scan(PosedScan {
                stamp: RobotTime::from_nanos(0),
                sensor: SensorId(0),
                beam_step_rad: 0.01,
                own_body_hits: 0,
                odom_from_base: planar(0.0, 0.0, 0.0),
                beams: vec![beam; beams],
            }),
            taken: Monotonic::default(),
            since: Monotonic::default(),
        }
    }

    const TOLD: Step = Step::Told {
        lateness: None,
        datum: None,
    };

    #[test]
    fn a_parcel_goes_when_it_can_be_told_or_is_large() {
        let (mut parcels, receiver) = parcels(false);
        parcels.told = Monotonic::now() + Duration::from_hours(1);
        // Poses alone are no reason to wake who maps.
        parcels.add(TOLD).unwrap();
        parcels.add(scan(PARCEL_BEAMS - 1)).unwrap();
        assert!(receiver.try_recv().is_err());
        parcels.add(scan(1)).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 2);
        let jump = PoseJump {
            stamp: RobotTime::from_nanos(0),
            distance_m: 3.0,
        };
        let jump = Step::Placed {
            placed: Placed::Jump(jump),
            taken: Monotonic::default(),
            since: Monotonic::default(),
        };
        parcels.add(jump).unwrap();
        parcels.add(Step::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        parcels.add(TOLD).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 3);
        // Now and then what there is is told without a scan.
        parcels.told = Monotonic::default();
        parcels.add(TOLD).unwrap();
        assert_eq!(receiver.try_recv().unwrap().len(), 1);
        drop(receiver);
        parcels.add(scan(1)).unwrap();
        assert!(parcels.add(TOLD).is_err(), "nobody maps any more");
    }

    #[test]
    fn the_rest_is_sent_at_the_end() {
        let (mut rest, receiver) = parcels(false);
        rest.add(scan(1)).unwrap();
        rest.add(Step::ClockReset).unwrap();
        assert!(receiver.try_recv().is_err());
        rest.finish().unwrap();
        let parcels_left: Vec<_> = receiver.iter().collect();
        assert_eq!((parcels_left.len(), parcels_left[0].len()), (1, 2));
        let (none, receiver) = parcels(false);
        none.finish().unwrap();
        assert_eq!(receiver.iter().count(), 0, "nothing is no parcel");
    }

    /// Who tells the guard does not wait for mapping before mapping leaves something out.
    #[test]
    fn there_is_room_for_what_comes_until_it_is_too_late() {
        let in_time = usize::try_from(LONGEST_LAG.as_secs()).unwrap() * 400;
        let (live, _receiver) = parcels(true);
        let sent = (0..in_time).filter(|_| live.sender.try_send(Vec::new()).is_ok());
        assert_eq!(sent.count(), in_time);
    }
}
