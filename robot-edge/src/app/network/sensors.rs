//! What came from the sensors is watched, and consoles hear what is wrong with them.

use super::herald::Herald;
use crate::clock::Monotonic;
use crate::measurement::Measurement;
use crate::robot_time::RobotDuration;
use crate::sensor_watch::Change;
use protocol::message::SensorFault;
use std::time::Duration;

impl Herald {
    /// Something was measured, which could be known since `came`; `elapsed` of the data's time has passed with it.
    pub(in crate::app) fn came(
        &mut self,
        measurement: &Measurement,
        came: Monotonic,
        elapsed: RobotDuration,
    ) {
        if let Some(lookout) = &mut self.lookout {
            lookout.came(measurement.stamp, came);
        }
        let at = self.watched_at(came, elapsed);
        self.sensors.take(measurement, at);
        self.look_at_sensors(at);
    }

    /// Tells consoles what began and ended with the sensors.
    pub(super) fn look_at_sensors(&mut self, now: Duration) {
        if !self.sensors.is_look_due(now) {
            return;
        }
        for change in self.sensors.look(now) {
            let (kind, message) = match change {
                Change::Began { fault, message, .. } => (fault_kind(fault), message),
                Change::Over { message, .. } => ("sensor_back", message),
            };
            tracing::warn!(kind, message);
            self.tell(kind, &message);
        }
        self.tell_sensors();
    }

    /// Tells consoles what was found out of the sensors.
    pub(super) fn tell_sensors(&mut self) {
        let (revision, infos) = self.sensors.infos();
        if self.told_sensors != Some(revision) {
            self.told_sensors = Some(revision);
            self.shared.set_sensors(revision, infos);
        }
    }
}

/// Time of the data since the first.
pub(super) fn of_data(elapsed: RobotDuration) -> Duration {
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
