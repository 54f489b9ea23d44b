//! What came from the sensors is watched, and consoles hear what is wrong with them.

use super::state_publisher::StatePublisher;
use crate::sensor_monitor::FaultChange;
use measurement::Measurement;
use measurement::time::Monotonic;
use measurement::time::RobotDuration;
use protocol::message::SensorFault;
use std::time::Duration;

impl StatePublisher {
    /// Something was measured, which could be known since `received_at`; `elapsed` of the data's time has passed with it.
    pub(in crate::app) fn on_measurement(
        &mut self,
        measurement: &Measurement,
        received_at: Monotonic,
        elapsed: RobotDuration,
    ) {
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.record_received(measurement.stamp, received_at);
        }
        let at = self.monitor_time(received_at, elapsed);
        self.sensors.take(measurement, at);
        self.check_sensors(at);
    }

    /// Tells consoles what began and ended with the sensors.
    pub(super) fn check_sensors(&mut self, now: Duration) {
        if !self.sensors.is_check_due(now) {
            return;
        }
        for change in self.sensors.check(now) {
            let (kind, message) = match change {
                FaultChange::Raised { fault, message, .. } => (fault_kind(fault), message),
                FaultChange::Cleared { message, .. } => ("sensor_recovered", message),
            };
            tracing::warn!(kind, message);
            self.publish_event(kind, &message);
        }
        self.publish_sensors();
    }

    /// Tells consoles what was found out of the sensors.
    pub(super) fn publish_sensors(&mut self) {
        let (revision, infos) = self.sensors.infos();
        if self.published_sensors != Some(revision) {
            self.published_sensors = Some(revision);
            self.publish_state.set_sensors(revision, infos);
        }
    }
}

/// Time of the data since the first.
pub(super) fn since_data_start(elapsed: RobotDuration) -> Duration {
    Duration::from_nanos(u64::try_from(elapsed.as_nanos()).unwrap_or_default())
}

const fn fault_kind(fault: SensorFault) -> &'static str {
    match fault {
        SensorFault::Silent => "sensor_silent",
        SensorFault::Clock => "sensor_clock",
        SensorFault::AllInvalid => "sensor_invalid",
        SensorFault::Slow => "sensor_slow",
        SensorFault::Blocked => "sensor_blocked",
    }
}
