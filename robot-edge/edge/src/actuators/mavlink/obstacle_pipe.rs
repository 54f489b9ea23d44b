//! Distances of obstacles from the edge to the motor guard, which owns the link with the autopilot: the autopilot's own avoidance takes them
//! (`OBSTACLE_DISTANCE`).
//!
//! They go through a pipe of their own, in records of a fixed length, so that nothing of them lies before a velocity. Neither end waits:
//! where the pipe is full a record is lost, and the guard sends none that is old. The edge keeps both ends; each guard inherits the read
//! end.

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::Duration;

use measurement::time::Monotonic;
use rustix::fs::OFlags;
use teleop::collision_monitor::{ObstaclesAround, SECTORS_AROUND};

use crate::actuators::forward_pipe;

/// In the guard's environment: the number of the inherited read end.
pub const VARIABLE: &str = "FORESHORE_OBSTACLE_PIPE";

/// Between two records.
const PERIOD: Duration = Duration::from_millis(200);

/// So long what a sweep has shown holds, and a record: a laser that a servo tilts looks elsewhere next.
const MAX_AGE: Duration = Duration::from_secs(1);

/// Greatest distance that is sent, centimetres; an obstacle farther away is none.
pub const MAX_CM: u16 = 5000;

/// No obstacle up to the greatest distance, and not known, as `OBSTACLE_DISTANCE` has them.
const NONE_CM: u16 = MAX_CM + 1;
const UNKNOWN_CM: u16 = u16::MAX;

/// Time of the newest sweep (nanoseconds of `CLOCK_BOOTTIME`), and the distances, all little endian.
const RECORD_BYTES: usize = 8 + 2 * SECTORS_AROUND;

/// Centimetres, clockwise; the middle of the first sector is ahead.
pub type Distances = [u16; SECTORS_AROUND];

/// The edge's end.
#[derive(Debug)]
pub struct ObstacleSender {
    write_end: Arc<OwnedFd>,
    /// The nearest of the last [`MAX_AGE`], and when it was seen.
    sectors: [(f32, Monotonic); SECTORS_AROUND],
    sent: Option<Monotonic>,
}

impl ObstacleSender {
    pub fn new(write_end: Arc<OwnedFd>) -> Self {
        Self {
            write_end,
            sectors: [(f32::NAN, Monotonic::default()); SECTORS_AROUND],
            sent: None,
        }
    }

    /// What a sweep has shown that arrived at `now`.
    pub fn update(&mut self, around: &ObstaclesAround, now: Monotonic) {
        for ((kept_m, seen), nearest_m) in self.sectors.iter_mut().zip(around.nearest_m) {
            let is_old = now.since(*seen) > MAX_AGE;
            if is_old {
                *kept_m = f32::NAN;
            }
            // The least of both; of a number and none the number.
            if nearest_m <= *kept_m || kept_m.is_nan() && !nearest_m.is_nan() {
                (*kept_m, *seen) = (nearest_m, now);
            }
        }
        if self.sent.is_some_and(|sent| now.since(sent) < PERIOD) {
            return;
        }
        self.sent = Some(now);
        let mut record = Vec::with_capacity(RECORD_BYTES);
        record.extend(now.nanos().to_le_bytes());
        for (nearest_m, _) in self.sectors {
            record.extend(centimetres(nearest_m).to_le_bytes());
        }
        // So few bytes are written whole or not at all (pipe(7)).
        let _lost_where_full = rustix::io::write(&self.write_end, &record);
    }
}

fn centimetres(metres: f32) -> u16 {
    if metres.is_nan() {
        return UNKNOWN_CM;
    }
    let centimetres = (100.0 * metres).round();
    if centimetres > f32::from(MAX_CM) {
        NONE_CM
    } else {
        // Nearer than the least distance it would count as not measured.
        (centimetres as u16).max(1)
    }
}

/// The guard's end.
#[derive(Debug)]
pub struct ObstacleReceiver(OwnedFd);

impl ObstacleReceiver {
    /// The one that the edge has passed on, if it has.
    pub fn inherited() -> Option<Self> {
        forward_pipe::inherited(VARIABLE, OFlags::RDONLY).map(Self)
    }

    /// The newest that came since the last call, unless it is old.
    pub fn take(&self, now: Monotonic) -> Option<Distances> {
        let mut buffer = [0; 8 * RECORD_BYTES];
        let mut newest = None;
        while let Ok(length @ 1..) = rustix::io::read(&self.0, &mut buffer) {
            // Reads of whole records return whole records.
            let records = buffer.get(..length)?.as_chunks::<RECORD_BYTES>().0;
            newest = records.last().copied().or(newest);
        }
        let (stamp, distances) = newest.as_ref()?.split_first_chunk::<8>()?;
        let age = now.since(Monotonic::from_nanos(u64::from_le_bytes(*stamp)));
        if age > MAX_AGE {
            return None;
        }
        let mut taken = [UNKNOWN_CM; SECTORS_AROUND];
        for (taken, bytes) in taken.iter_mut().zip(distances.as_chunks::<2>().0) {
            *taken = u16::from_le_bytes(*bytes);
        }
        Some(taken)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuators::forward_pipe;

    fn at(ms: u64) -> Monotonic {
        Monotonic::from_nanos(ms * 1_000_000)
    }

    fn around(sectors: &[(usize, f32)]) -> ObstaclesAround {
        let mut around = ObstaclesAround::default();
        for (sector, nearest_m) in sectors {
            around.nearest_m[*sector] = *nearest_m;
        }
        around
    }

    #[test]
    fn the_nearest_of_a_second_arrives_and_what_is_old_does_not() {
        let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
        rustix::io::ioctl_fionbio(&read_end, true).unwrap();
        let receiver = ObstacleReceiver(read_end);
        let mut sender = ObstacleSender::new(Arc::new(write_end));
        let ahead = |receiver: &ObstacleReceiver, ms| {
            let taken = receiver.take(at(ms));
            taken.map(|distances| [distances[0], distances[1], distances[71]])
        };
        assert_eq!(ahead(&receiver, 5000), None);
        sender.update(&around(&[(0, 2.5), (1, f32::INFINITY)]), at(5000));
        assert_eq!(ahead(&receiver, 5010), Some([250, NONE_CM, UNKNOWN_CM]));
        assert_eq!(ahead(&receiver, 5010), None, "once");
        // The laser looks above it; a second sweep comes too early to be sent, and counts.
        sender.update(&around(&[(0, f32::INFINITY)]), at(5150));
        sender.update(&around(&[(1, 0.001), (71, 80.0)]), at(5200));
        assert_eq!(ahead(&receiver, 5200), Some([250, 1, NONE_CM]));
        // Not seen again for more than a second, and for more than a second nothing is sent.
        sender.update(&around(&[(0, f32::INFINITY)]), at(6250));
        assert_eq!(
            ahead(&receiver, 6250),
            Some([NONE_CM, UNKNOWN_CM, UNKNOWN_CM])
        );
        sender.update(&around(&[]), at(6500));
        assert_eq!(ahead(&receiver, 7501), None);
    }

    #[test]
    fn a_pipe_that_nobody_reads_makes_nobody_wait() {
        let (read_end, write_end) = forward_pipe::pipe(forward_pipe::LEAST_BYTES).unwrap();
        rustix::io::ioctl_fionbio(&read_end, true).unwrap();
        let mut sender = ObstacleSender::new(Arc::new(write_end));
        for round in 0..100 {
            sender.update(
                &around(&[(0, 40.0 - 0.1 * round as f32)]),
                at(5000 + 200 * round),
            );
        }
        // The pipe had room for 26.
        let distances = ObstacleReceiver(read_end).take(at(10_000)).unwrap();
        assert_eq!(distances[0], 3750);
    }
}
