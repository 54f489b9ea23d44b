//! Whether an autopilot obeys velocities, from its heartbeats.

use std::time::Duration;

use drivers::mavlink::{AutopilotState, AutopilotStatus, GUIDED};
use measurement::time::Monotonic;
use protocol::message::MotorHold;

/// Heartbeats come once a second. Without any it is not known whether it obeys; `ArduPilot` stops after 3 s without
/// velocities.
const SILENCE: Duration = Duration::from_millis(2500);

/// Of the texts that become events.
const TEXT_PERIOD: Duration = Duration::from_secs(1);

/// An autopilot as the drive loop sees it.
#[derive(Debug)]
pub struct AutopilotMonitor {
    status: AutopilotStatus,
    /// Whether mode GUIDED is requested when an operator takes the lease.
    pub requests_guided: bool,
    state: AutopilotState,
    heartbeat_at: Option<Monotonic>,
    texts_at: Option<Monotonic>,
}

impl AutopilotMonitor {
    pub fn new(status: AutopilotStatus, requests_guided: bool) -> Self {
        Self {
            status,
            requests_guided,
            state: AutopilotState::default(),
            heartbeat_at: None,
            texts_at: None,
        }
    }

    /// Why it obeys no velocity now. It never waits.
    pub(super) fn hold(&mut self, now: Monotonic) -> Option<MotorHold> {
        if let Some(state) = self.status.try_state() {
            if state.heartbeats > self.state.heartbeats {
                self.heartbeat_at = Some(now);
            }
            self.state = state;
        }
        let is_silent = self.heartbeat_at.is_none_or(|at| now.since(at) > SILENCE);
        if is_silent {
            Some(MotorHold::NoHeartbeat)
        } else if !self.state.is_rover {
            Some(MotorHold::NotARover)
        } else if self.state.has_failsafe {
            Some(MotorHold::Failsafe)
        } else if self.state.mode != GUIDED {
            Some(MotorHold::Mode(self.state.mode))
        } else if !self.state.is_armed {
            Some(MotorHold::Disarmed)
        } else {
            None
        }
    }

    /// What it has said since the last call; once a second at most, and the first few of a flood.
    pub(super) fn take_texts(&mut self, now: Monotonic) -> Vec<String> {
        let is_early = (self.texts_at).is_some_and(|at| now.since(at) < TEXT_PERIOD);
        if is_early {
            return Vec::new();
        }
        self.texts_at = Some(now);
        self.status.try_take_texts()
    }

    pub(super) const fn battery_v(&self) -> Option<f64> {
        self.state.battery_v
    }
}

#[cfg(test)]
mod tests {
    use drivers::Decoder as _;
    use drivers::device::Device as _;
    use drivers::mavlink::Autopilot;

    use super::*;

    /// Heartbeats that pymavlink packs: a rover, armed or not, in mode GUIDED, MANUAL or HOLD with a failsafe; a copter.
    const GUIDED_ARMED: &str = "fd0900000001010000000f0000000b03810403306e";
    const COPTER: &str = "fd0900000201010000000400000002038104033242";
    const CRITICAL: &str = "fd090000010101000000040000000a03010503f98e";

    fn receive(autopilot: &mut Autopilot, frame: &str) {
        let bytes = frame.as_bytes().chunks(2);
        let bytes =
            bytes.map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap());
        let mut decoder = autopilot.connect();
        decoder.push(&bytes.collect::<Vec<_>>());
        let message = decoder.next_message().unwrap();
        autopilot.take(message, None, &mut Vec::new());
    }

    #[test]
    fn heartbeats_say_why_it_does_not_obey_and_silence_does() {
        let at = |ms: u64| Monotonic::from_nanos(ms * 1_000_000);
        let status = AutopilotStatus::default();
        let mut autopilot = Autopilot::new(1, status.clone());
        let mut monitor = AutopilotMonitor::new(status, false);
        assert_eq!(monitor.hold(at(0)), Some(MotorHold::NoHeartbeat));
        for (frame, hold) in [
            (GUIDED_ARMED, None),
            (COPTER, Some(MotorHold::NotARover)),
            (CRITICAL, Some(MotorHold::Failsafe)),
            (GUIDED_ARMED, None),
        ] {
            receive(&mut autopilot, frame);
            assert_eq!(monitor.hold(at(1000)), hold, "{frame}");
        }
        assert_eq!(monitor.hold(at(3500)), None);
        assert_eq!(monitor.hold(at(3501)), Some(MotorHold::NoHeartbeat));
        receive(&mut autopilot, GUIDED_ARMED);
        assert_eq!(monitor.hold(at(9000)), None);
    }
}
