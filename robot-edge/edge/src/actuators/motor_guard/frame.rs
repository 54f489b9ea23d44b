//! Frames between teleop loop and motor guard, through the guard's standard input and output.
//!
//! Frames have a fixed length in each direction, so that no length field can be corrupted. All numbers are little
//! endian; `crc` is CRC-32 (IEEE 802.3) of everything before it.
//!
//! | command, 44 bytes | | report, 92 bytes | |
//! | --- | --- | --- | --- |
//! | 0 | `F5 4D`, version 1, kind 1 | 0 | `F5 4D`, version 1, kind 2 |
//! | 4 | sequence number, u64 | 4 | sequence number of the newest velocity that was taken, u64 |
//! | 12 | decided at, u64 ns of `CLOCK_BOOTTIME` | 12 | reported at, u64 ns of `CLOCK_BOOTTIME` |
//! | 20 | linear, f64 m/s | 20 | applied: linear, angular, 2 × f64 |
//! | 28 | angular, f64 rad/s | 36 | measured: linear, angular, 2 × f64 |
//! | 36 | how often a mode was requested, u32 | 52 | battery, f64 V |
//! | 40 | crc | 60 | which of the three are known: bits 0 to 2 |
//! | | | 61 | readiness, fault, detail of the fault, controller's flags, its watchdog: 5 × u8 |
//! | | | 66 | the detail's second and third byte |
//! | | | 68 | lapses, stale, garbage, reconnects, lost bytes of encoders: 5 × u32 |
//! | | | 88 | crc |

use crate::actuators::report::{
    ControllerFault, ControllerFlags, ControllerWatchdog, Counters, Hold, Readiness, Report,
};
use measurement::time::Monotonic;
use teleop::Velocity;

const MAGIC: [u8; 3] = [0xF5, b'M', 1];
const CRC_BYTES: usize = 4;

pub const COMMAND_BYTES: usize = 44;

pub const REPORT_BYTES: usize = 92;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorCommand {
    /// Grows with each frame.
    pub sequence: u64,
    /// When the edge's loop decided on it: the guard's clock is the same.
    pub decided_at: Monotonic,
    pub velocity: Velocity,
    /// How often it was requested that the motors' controller goes to the mode in which it obeys.
    pub mode_requests: u32,
}

pub(super) trait Frame<const N: usize>: Sized {
    const KIND: u8;
    fn write(&self, body: &mut Writer<'_>);
    /// Absent where a value means nothing.
    fn read(body: &mut Reader<'_>) -> Option<Self>;

    fn encode(&self) -> [u8; N] {
        let mut bytes = [0; N];
        let (content, crc) = bytes.split_at_mut(N - CRC_BYTES);
        let mut body = Writer(content);
        body.put(&MAGIC);
        body.put(&[Self::KIND]);
        self.write(&mut body);
        crc.copy_from_slice(&crc32fast::hash(content).to_le_bytes());
        bytes
    }

    fn decode(bytes: &[u8; N]) -> Option<Self> {
        let (content, crc) = bytes.split_at(N - CRC_BYTES);
        if crc != crc32fast::hash(content).to_le_bytes() || !begins_well::<N, Self>(content) {
            return None;
        }
        let body = content.get(MAGIC.len() + 1..)?;
        Self::read(&mut Reader(body))
    }
}

fn begins_well<const N: usize, F: Frame<N>>(bytes: &[u8]) -> bool {
    let start = MAGIC.iter().chain([&F::KIND]);
    bytes.iter().zip(start).all(|(byte, wanted)| byte == wanted)
}

impl Frame<COMMAND_BYTES> for MotorCommand {
    const KIND: u8 = 1;

    fn write(&self, body: &mut Writer<'_>) {
        body.put(&self.sequence.to_le_bytes());
        body.put_moment(self.decided_at);
        body.put_velocity(self.velocity);
        body.put(&self.mode_requests.to_le_bytes());
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        Some(Self {
            sequence: u64::from_le_bytes(body.take()?),
            decided_at: body.take_moment()?,
            velocity: body.take_velocity()?,
            mode_requests: u32::from_le_bytes(body.take()?),
        })
    }
}

/// Finds frames in a stream of bytes, whatever lies between them.
#[derive(Clone, Debug)]
pub(super) struct Decoder<const N: usize> {
    bytes: [u8; N],
    length: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Found<F> {
    Frame(F),
    /// A byte that belongs to no frame.
    Garbage,
}

impl<const N: usize> Decoder<N> {
    pub(super) const fn new() -> Self {
        Self {
            bytes: [0; N],
            length: 0,
        }
    }

    pub(super) fn push<F: Frame<N>>(&mut self, bytes: &[u8], mut found: impl FnMut(Found<F>)) {
        for &byte in bytes {
            if let Some(slot) = self.bytes.get_mut(self.length) {
                *slot = byte;
                self.length += 1;
            }
            self.settle(&mut found);
        }
    }

    /// Until what is held could be the beginning of a frame.
    fn settle<F: Frame<N>>(&mut self, found: &mut impl FnMut(Found<F>)) {
        while self.length > 0 {
            let held = self.bytes.get(..self.length).unwrap_or_default();
            if begins_well::<N, F>(held) {
                if self.length < N {
                    return;
                }
                if let Some(frame) = F::decode(&self.bytes) {
                    self.length = 0;
                    found(Found::Frame(frame));
                    return;
                }
            }
            self.bytes.copy_within(1..self.length, 0);
            self.length -= 1;
            found(Found::Garbage);
        }
    }
}

/// Puts values one after another; what does not fit is left out, which a test of each frame's length excludes.
pub(super) struct Writer<'a>(&'a mut [u8]);

impl Writer<'_> {
    pub(super) fn put(&mut self, bytes: &[u8]) {
        if let Some((slot, rest)) = std::mem::take(&mut self.0).split_at_mut_checked(bytes.len()) {
            slot.copy_from_slice(bytes);
            self.0 = rest;
        }
    }

    pub(super) fn put_moment(&mut self, moment: Monotonic) {
        self.put(&nanos(moment).to_le_bytes());
    }

    pub(super) fn put_velocity(&mut self, velocity: Velocity) {
        self.put(&velocity.linear_mps.to_le_bytes());
        self.put(&velocity.angular_radps.to_le_bytes());
    }

    #[cfg(test)]
    fn is_full(&self) -> bool {
        self.0.is_empty()
    }
}

pub(super) struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    pub(super) fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (value, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*value)
    }

    pub(super) fn take_moment(&mut self) -> Option<Monotonic> {
        Some(Monotonic::from_nanos(u64::from_le_bytes(self.take()?)))
    }

    pub(super) fn take_velocity(&mut self) -> Option<Velocity> {
        Some(Velocity::new(self.take_f64()?, self.take_f64()?))
    }

    pub(super) fn take_f64(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.take()?))
    }
}

/// Of the clock that edge and guard share.
pub(super) fn nanos(moment: Monotonic) -> u64 {
    let since_start = moment.since(Monotonic::from_nanos(0));
    u64::try_from(since_start.as_nanos()).unwrap_or(u64::MAX)
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorReport {
    /// The newest velocity that was taken; 0 before the first.
    pub sequence: u64,
    pub report: Report,
    pub fault: Option<ControllerFault>,
}

impl Frame<REPORT_BYTES> for MotorReport {
    const KIND: u8 = 2;

    fn write(&self, body: &mut Writer<'_>) {
        let report = &self.report;
        body.put(&self.sequence.to_le_bytes());
        body.put_moment(report.at);
        body.put_velocity(report.applied.unwrap_or_default());
        body.put_velocity(report.measured.unwrap_or_default());
        body.put(&report.battery_v.unwrap_or_default().to_le_bytes());
        let known = u8::from(report.applied.is_some())
            | u8::from(report.measured.is_some()) << 1
            | u8::from(report.battery_v.is_some()) << 2;
        let (fault, detail) = fault_code(self.fault);
        // No process has a number of more than 22 bits.
        let [low, middle, high, _] = detail.to_le_bytes();
        body.put(&[
            known,
            readiness_code(report.readiness),
            fault,
            low,
            report.controller.0,
            watchdog_code(report.watchdog),
            middle,
            high,
        ]);
        let Counters {
            dropouts,
            stale,
            garbage,
            reconnects,
            lost_bytes,
        } = report.counters;
        for counter in [dropouts, stale, garbage, reconnects, lost_bytes] {
            body.put(&counter.to_le_bytes());
        }
    }

    fn read(body: &mut Reader<'_>) -> Option<Self> {
        let sequence = u64::from_le_bytes(body.take()?);
        let at = body.take_moment()?;
        let applied = body.take_velocity()?;
        let measured = body.take_velocity()?;
        let battery_v = body.take_f64()?;
        let [known, readiness, fault, low, flags, watchdog, middle, high] = body.take()?;
        let detail = u32::from_le_bytes([low, middle, high, 0]);
        let mut counter = || body.take().map(u32::from_le_bytes);
        let counters = Counters {
            dropouts: counter()?,
            stale: counter()?,
            garbage: counter()?,
            reconnects: counter()?,
            lost_bytes: counter()?,
        };
        let velocity = |bit: u8, velocity: Velocity| {
            (known & bit != 0 && velocity.is_finite()).then_some(velocity)
        };
        Some(Self {
            sequence,
            report: Report {
                readiness: readiness_of(readiness)?,
                applied: velocity(1, applied),
                measured: velocity(2, measured),
                battery_v: (known & 4 != 0 && battery_v.is_finite()).then_some(battery_v),
                controller: ControllerFlags(flags),
                watchdog: watchdog_of(watchdog)?,
                counters,
                at,
            },
            fault: fault_of(fault, detail)?,
        })
    }
}

const fn readiness_code(readiness: Readiness) -> u8 {
    match readiness {
        Readiness::Starting => 0,
        Readiness::Active => 1,
        Readiness::Holding(Hold::Start) => 2,
        Readiness::Holding(Hold::Silence) => 3,
        Readiness::Holding(Hold::Garbage) => 4,
        Readiness::Holding(Hold::Controller) => 5,
    }
}

const fn readiness_of(code: u8) -> Option<Readiness> {
    Some(match code {
        0 => Readiness::Starting,
        1 => Readiness::Active,
        2 => Readiness::Holding(Hold::Start),
        3 => Readiness::Holding(Hold::Silence),
        4 => Readiness::Holding(Hold::Garbage),
        5 => Readiness::Holding(Hold::Controller),
        _ => return None,
    })
}

const fn watchdog_code(watchdog: ControllerWatchdog) -> u8 {
    match watchdog {
        ControllerWatchdog::Unknown => 0,
        ControllerWatchdog::Proven => 1,
        ControllerWatchdog::Absent => 2,
    }
}

const fn watchdog_of(code: u8) -> Option<ControllerWatchdog> {
    Some(match code {
        0 => ControllerWatchdog::Unknown,
        1 => ControllerWatchdog::Proven,
        2 => ControllerWatchdog::Absent,
        _ => return None,
    })
}

const fn fault_code(fault: Option<ControllerFault>) -> (u8, u32) {
    match fault {
        None => (0, 0),
        Some(ControllerFault::Port(errno)) => (1, errno as u32),
        Some(ControllerFault::Silent) => (2, 0),
        Some(ControllerFault::GarbledLine) => (3, 0),
        Some(ControllerFault::Refusing) => (4, 0),
        Some(ControllerFault::Unreadable) => (5, 0),
        Some(ControllerFault::MotorMode(mode)) => (6, mode as u32),
        Some(ControllerFault::NoWatchdog(mode)) => (7, mode as u32),
        Some(ControllerFault::Held(pid)) => (8, pid),
    }
}

/// The outer absence: no such code.
#[expect(
    clippy::option_option,
    reason = "no fault is not the same as no such code"
)]
const fn fault_of(code: u8, detail: u32) -> Option<Option<ControllerFault>> {
    let [low, ..] = detail.to_le_bytes();
    Some(match code {
        0 => None,
        1 => Some(ControllerFault::Port(low)),
        2 => Some(ControllerFault::Silent),
        3 => Some(ControllerFault::GarbledLine),
        4 => Some(ControllerFault::Refusing),
        5 => Some(ControllerFault::Unreadable),
        6 => Some(ControllerFault::MotorMode(low)),
        7 => Some(ControllerFault::NoWatchdog(low)),
        8 => Some(ControllerFault::Held(detail)),
        _ => return None,
    })
}

#[cfg(test)]
pub(super) fn every_fault(detail: u32) -> impl Iterator<Item = Option<ControllerFault>> {
    (0..=u8::MAX).filter_map(move |code| fault_of(code, detail))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::actuators::motor_guard::frame::{MotorReport, every_fault};
    use crate::actuators::report::{ControllerWatchdog, Counters, Hold, Readiness, Report};

    fn motor_command(sequence: u64, linear_mps: f64) -> MotorCommand {
        MotorCommand {
            sequence,
            decided_at: Monotonic::from_nanos(123_456_789_012),
            velocity: Velocity {
                linear_mps,
                lateral_mps: 0.0,
                angular_radps: -0.25,
            },
            mode_requests: 3,
        }
    }

    fn find(bytes: &[u8]) -> (Vec<MotorCommand>, usize) {
        let (mut frames, mut garbage) = (Vec::new(), 0);
        Decoder::new().push(bytes, |found| match found {
            Found::Frame(frame) => frames.push(frame),
            Found::Garbage => garbage += 1,
        });
        (frames, garbage)
    }

    #[test]
    fn the_bytes_are_those_of_the_table() {
        let bytes = motor_command(0x0102, 1.5).encode();
        assert_eq!(&bytes[..12], [0xF5, 0x4D, 1, 1, 2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[12..20], 123_456_789_012_u64.to_le_bytes());
        assert_eq!(bytes[20..28], 1.5_f64.to_le_bytes());
        assert_eq!(bytes[28..36], (-0.25_f64).to_le_bytes());
        assert_eq!(bytes[36..40], [3, 0, 0, 0]);
        assert_eq!(bytes[40..], crc32fast::hash(&bytes[..40]).to_le_bytes());
    }

    #[test]
    fn frames_fill_their_length() {
        fn fills<const N: usize, F: Frame<N>>(frame: &F) {
            let mut room = vec![0; N - CRC_BYTES - MAGIC.len() - 1];
            let mut body = Writer(&mut room);
            frame.write(&mut body);
            assert!(body.is_full());
        }
        fills(&motor_command(1, 0.0));
        fills(&motor_report(Readiness::Starting, None));
    }

    fn motor_report(
        readiness: Readiness,
        fault: Option<crate::actuators::report::ControllerFault>,
    ) -> MotorReport {
        MotorReport {
            sequence: 77,
            report: Report {
                readiness,
                measured: Some(motor_command(0, 0.5).velocity),
                battery_v: Some(24.5),
                watchdog: ControllerWatchdog::Proven,
                counters: Counters {
                    dropouts: 1,
                    stale: 2,
                    garbage: 3,
                    reconnects: u32::MAX,
                    lost_bytes: 4,
                },
                ..Report::unknown(Monotonic::from_nanos(99))
            },
            fault,
        }
    }

    #[test]
    fn frames_are_decoded_as_encoded() {
        let holds = [Hold::Start, Hold::Silence, Hold::Garbage, Hold::Controller];
        let readiness = holds
            .map(Readiness::Holding)
            .into_iter()
            .chain([Readiness::Starting, Readiness::Active]);
        for readiness in readiness {
            for fault in every_fault(0x3F_12C5) {
                let motor_report = motor_report(readiness, fault);
                assert_eq!(
                    MotorReport::decode(&motor_report.encode()),
                    Some(motor_report)
                );
            }
        }
        assert_eq!(every_fault(0).count(), 9);
    }

    #[test]
    fn a_code_that_means_nothing_is_no_frame() {
        for at in [61, 62, 65] {
            let mut bytes = motor_report(Readiness::Starting, None).encode();
            bytes[at] = 200;
            let crc = crc32fast::hash(&bytes[..88]).to_le_bytes();
            bytes[88..].copy_from_slice(&crc);
            assert_eq!(MotorReport::decode(&bytes), None, "{at}");
        }
    }

    #[test]
    fn a_frame_that_was_cut_off_does_not_take_the_next_one_with_it() {
        let whole = motor_command(2, 0.0).encode();
        for cut in 1..COMMAND_BYTES {
            let bytes = [&motor_command(1, 0.0).encode()[..cut], &whole].concat();
            assert_eq!(find(&bytes), (vec![motor_command(2, 0.0)], cut));
        }
    }

    proptest! {
        #[test]
        fn frames_are_found_between_any_garbage(
            garbage in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..120), 4),
            split in 1..100usize,
        ) {
            let frames: Vec<MotorCommand> = (1..=3).map(|n| motor_command(n, n as f64)).collect();
            let mut stream = garbage[0].clone();
            for (frame, after) in frames.iter().zip(&garbage[1..]) {
                stream.extend(frame.encode());
                stream.extend(after);
            }
            // Garbage could begin like a frame: the rest of one settles it.
            stream.extend([0; COMMAND_BYTES]);
            let (mut found, mut decoder) = (Vec::new(), Decoder::<COMMAND_BYTES>::new());
            for part in stream.chunks(split) {
                decoder.push(part, |one: Found<MotorCommand>| if let Found::Frame(frame) = one { found.push(frame) });
            }
            prop_assert_eq!(found, frames);
        }

        #[test]
        fn no_flipped_bits_make_another_frame(flips in prop::collection::vec(0..COMMAND_BYTES * 8, 1..4)) {
            let good = motor_command(7, 1.0).encode();
            let mut bad = good;
            for &bit in &flips {
                bad[bit / 8] ^= 1 << (bit % 8);
            }
            prop_assert_eq!(MotorCommand::decode(&bad).is_some(), bad == good);
        }

        #[test]
        fn any_velocity_and_moment_survive(
            sequence in any::<u64>(), at in any::<u64>(), linear in any::<u64>(), angular in any::<u64>(),
        ) {
            let motor_command = MotorCommand {
                sequence,
                decided_at: Monotonic::from_nanos(at),
                velocity: Velocity {
                    linear_mps: f64::from_bits(linear),
                    lateral_mps: 0.0,
                    angular_radps: f64::from_bits(angular),
                },
                mode_requests: 0,
            };
            let bytes = motor_command.encode();
            let back = MotorCommand::decode(&bytes).unwrap();
            prop_assert_eq!(back.encode(), bytes, "bit by bit, also what is not a number");
        }
    }
}
