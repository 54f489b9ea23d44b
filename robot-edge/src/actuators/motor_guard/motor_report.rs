//! What the guard tells, and its bytes.

use super::frame::{Frame, REPORT_BYTES, Reader, Writer};
use crate::actuators::report::{
    ControllerFault, ControllerFlags, ControllerWatchdog, Counters, Hold, Readiness, Report,
};
use teleop::Velocity;

/// What is known of the motors, or why they cannot be driven.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorReport {
    /// The newest velocity that was taken; 0 before the first.
    pub sequence: u64,
    /// Everything else.
    pub report: Report,
    /// Why the motors cannot be driven, if so.
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
        } = report.counters;
        for counter in [dropouts, stale, garbage, reconnects] {
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
