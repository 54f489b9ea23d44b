//! How each sensor is doing: rate, age, losses, faults. Pure: measurements and times in, statuses and changes out.
//!
//! Times are durations on one line that the caller chooses and keeps to: since a live vehicle's program began, or of
//! the data's own time where it is replayed or simulated, so that a replay tells the same at every speed.

mod descriptors;
mod geometry;
mod health;

use std::time::Duration;

use protocol::message::{MAX_SENSORS, SensorFault, SensorInfo, SensorKind, SensorStatus};

pub use descriptors::{MeasurementSelector, SensorDescriptor, descriptors};

use geometry::DetectedGeometry;
use health::SensorHealth;

use localization::registration::{RegistrationCounts, SensorCounts};
use mapping::registered_scan::{RegisteredScan, SensorId};
use measurement::Measurement;
use measurement::drops::DropReason;

/// Between two looks at the sensors.
const CHECK_PERIOD: Duration = Duration::from_millis(250);
/// A fault that is gone for so long is over: one that comes and goes is told of once.
const CLEAR_AFTER: Duration = Duration::from_secs(2);

/// Watches the sensors of one vehicle.
#[derive(Clone, Debug)]
pub struct SensorMonitor {
    sensors: Vec<MonitoredSensor>,
    /// What was found out of them.
    revision: u32,
    last_check: Option<Duration>,
}

#[derive(Clone, Debug)]
struct MonitoredSensor {
    info: SensorInfo,
    own: MeasurementSelector,
    range_sensor: Option<SensorId>,
    health: SensorHealth,
    geometry: DetectedGeometry,
    dropped: u64,
    /// The fault that people were told of, and when it was last there.
    reported: Option<(SensorFault, Duration)>,
}

/// A fault that began or is over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultChange {
    /// It began.
    Raised {
        /// Name of the sensor.
        sensor: String,
        /// What.
        fault: SensorFault,
        /// What, in a sentence.
        message: String,
    },
    /// The sensor is well again.
    Cleared {
        /// Name of the sensor.
        sensor: String,
        /// That, in a sentence.
        message: String,
    },
}

impl SensorMonitor {
    /// Watches these, of which the first [`MAX_SENSORS`] count.
    pub fn new(sensors: Vec<SensorDescriptor>) -> Self {
        let monitored = |descriptors: SensorDescriptor| MonitoredSensor {
            health: SensorHealth::new(descriptors.info.rate_hz),
            geometry: descriptors.geometry,
            range_sensor: descriptors.range_sensor,
            own: descriptors.own,
            info: descriptors.info,
            dropped: 0,
            reported: None,
        };
        Self {
            sensors: sensors
                .into_iter()
                .take(MAX_SENSORS)
                .map(monitored)
                .collect(),
            revision: 0,
            last_check: None,
        }
    }

    /// Something was measured, and could be known since `at`.
    pub fn take(&mut self, measurement: &Measurement, at: Duration) {
        for sensor in &mut self.sensors {
            if let Some(is_valid) = sensor.own.classify(measurement) {
                sensor.health.take(measurement.stamp, is_valid, at);
                if sensor.geometry.measured(measurement, &mut sensor.info) {
                    self.revision += 1;
                }
            }
        }
    }

    /// The beams of a scan were placed; by them the sensor's window `is_blocked` or is not.
    pub fn on_registered_scan(&mut self, scan: &RegisteredScan, is_blocked: bool) {
        for sensor in &mut self.sensors {
            if sensor.range_sensor != Some(scan.sensor) {
                continue;
            }
            sensor.health.set_blocked(is_blocked);
            if sensor.geometry.on_registered_scan(scan, &mut sensor.info) {
                self.revision += 1;
            }
        }
    }

    /// The stamps begin anew, and that is as it should be: a recording is replayed again.
    pub fn on_replay_restart(&mut self) {
        for sensor in &mut self.sensors {
            sensor.health.reset_stamp();
        }
    }

    /// The data is wound: time stands at `to`, before or behind what it was. What was told of is not told to be over.
    pub fn seek(&mut self, to: Duration) {
        self.last_check = None;
        for sensor in &mut self.sensors {
            sensor.health.seek(to);
            sensor.reported = None;
        }
    }

    /// Whether it is time to [`check`](Self::check).
    pub fn is_check_due(&self, now: Duration) -> bool {
        self.last_check
            .is_none_or(|last_check| now.saturating_sub(last_check) >= CHECK_PERIOD)
    }

    /// What began or is over since the last look.
    pub fn check(&mut self, now: Duration) -> Vec<FaultChange> {
        self.last_check = Some(now);
        self.sensors
            .iter_mut()
            .filter_map(|sensor| sensor.check(now))
            .collect()
    }

    /// Takes over what the placer has left out.
    pub fn count(&mut self, counts: &RegistrationCounts) {
        let poses = |reasons: &[DropReason]| -> u64 {
            let reasons = reasons.iter();
            reasons
                .map(|reason| counts.dropped_poses.get(*reason))
                .sum()
        };
        for sensor in &mut self.sensors {
            sensor.dropped = match &sensor.own {
                MeasurementSelector::Scans { .. } => {
                    let own = |of: &&SensorCounts| Some(of.sensor) == sensor.range_sensor;
                    let own = counts.sensors.iter().find(own);
                    own.map_or(0, |own| own.dropped_scans.total())
                }
                MeasurementSelector::Wheels { .. } => poses(&[DropReason::WheelJump]),
                MeasurementSelector::Fixes(_) => poses(&[
                    DropReason::NoFix,
                    DropReason::BadFix,
                    DropReason::GnssOutlier,
                ]),
                MeasurementSelector::Attitudes(_)
                | MeasurementSelector::Odometry
                | MeasurementSelector::Transforms { .. } => poses(&[DropReason::BadPose]),
                MeasurementSelector::Tilt { .. } => 0,
            };
        }
    }

    /// What is known of the sensors, and how often something was found out.
    pub fn infos(&self) -> (u32, Vec<SensorInfo>) {
        let infos = self.sensors.iter().map(|sensor| sensor.info.clone());
        (self.revision, infos.collect())
    }

    /// The name of a range sensor.
    pub fn name(&self, id: SensorId) -> Option<&str> {
        let mut sensors = self.sensors.iter();
        let found = sensors.find(|sensor| sensor.range_sensor == Some(id))?;
        Some(&found.info.name)
    }

    /// How the sensors are doing.
    pub fn statuses(&self, now: Duration) -> Vec<SensorStatus> {
        let status = |sensor: &MonitoredSensor| SensorStatus {
            name: sensor.info.name.clone(),
            messages: sensor.health.messages(),
            rate_hz: sensor.health.rate_hz(now) as f32,
            age_ms: sensor
                .health
                .age(now)
                .map(|age| u32::try_from(age.as_millis()).unwrap_or(u32::MAX)),
            dropped: sensor.dropped,
            fault: sensor.health.fault(now),
        };
        self.sensors.iter().map(status).collect()
    }
}

impl MonitoredSensor {
    fn check(&mut self, now: Duration) -> Option<FaultChange> {
        let sensor = self.info.name.clone();
        match (self.health.fault(now), self.reported) {
            // What is only less bad is not told anew: a sensor that stutters would never be quiet.
            (Some(fault), Some((reported, _))) if fault >= reported => {
                self.reported = Some((reported, now));
                None
            }
            (Some(fault), _) => {
                self.reported = Some((fault, now));
                let message = format!("{sensor}: {}", self.fault_text(fault, now));
                Some(FaultChange::Raised {
                    sensor,
                    fault,
                    message,
                })
            }
            (None, Some((_, seen))) if now.saturating_sub(seen) >= CLEAR_AFTER => {
                self.reported = None;
                let message = format!("{sensor}: back");
                Some(FaultChange::Cleared { sensor, message })
            }
            (None, _) => None,
        }
    }

    fn fault_text(&self, fault: SensorFault, now: Duration) -> String {
        match fault {
            SensorFault::Silent => match self.health.age(now) {
                Some(age) => format!("silent for {:.1} s", age.as_secs_f64()),
                None => "nothing has come from it".to_owned(),
            },
            SensorFault::Clock => "its stamps jumped".to_owned(),
            SensorFault::AllInvalid => match self.own {
                MeasurementSelector::Fixes(_) => "no fix".to_owned(),
                // Over a bank or a shoal it is the water that is at fault, not the sonar.
                MeasurementSelector::Scans { .. } if self.info.kind == SensorKind::Sonar => {
                    "nothing valid: covered, broken, or nearer to the bottom than it measures"
                        .to_owned()
                }
                MeasurementSelector::Scans { .. }
                | MeasurementSelector::Wheels { .. }
                | MeasurementSelector::Attitudes(_)
                | MeasurementSelector::Odometry
                | MeasurementSelector::Transforms { .. }
                | MeasurementSelector::Tilt { .. } => {
                    "measures nothing: covered or broken".to_owned()
                }
            },
            SensorFault::Blocked => {
                "its window seems to be blocked: no echo where there was one".to_owned()
            }
            SensorFault::Slow => format!(
                "{:.1} instead of {:.1} messages a second",
                self.health.rate_hz(now),
                self.info.rate_hz.unwrap_or_default()
            ),
        }
    }
}

#[cfg(test)]
mod tests;
