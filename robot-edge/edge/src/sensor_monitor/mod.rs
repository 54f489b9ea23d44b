//! Rate, age, losses and faults of each sensor. Pure.
//!
//! The caller chooses one time base: time since the start of a live program, or time of the data in a replay or
//! simulation, so that a replay gives the same result at every speed.

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

const CHECK_PERIOD: Duration = Duration::from_millis(250);
/// A fault is cleared after this time without it, so that an intermittent one is reported once.
const CLEAR_AFTER: Duration = Duration::from_secs(2);

#[derive(Clone, Debug)]
pub struct SensorMonitor {
    sensors: Vec<MonitoredSensor>,
    /// Revision of the sensor descriptions.
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
    /// The reported fault, and when it was last present.
    reported: Option<(SensorFault, Duration)>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaultChange {
    Raised {
        sensor: String,
        fault: SensorFault,
        message: String,
    },
    Cleared {
        sensor: String,
        message: String,
    },
}

impl SensorMonitor {
    /// Monitors the first [`MAX_SENSORS`] of these.
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

    /// Processes a measurement that could have been received at `at` at the earliest.
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

    /// Processes a registered scan; `is_blocked` is the result of the blockage detection.
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

    /// The stamps restart because a recording is repeated; this is no fault.
    pub fn on_replay_restart(&mut self) {
        for sensor in &mut self.sensors {
            sensor.health.reset_stamp();
        }
    }

    /// The replay is at `to`, earlier or later than before. Reported faults are not reported as cleared.
    pub fn seek(&mut self, to: Duration) {
        self.last_check = None;
        for sensor in &mut self.sensors {
            sensor.health.seek(to);
            sensor.reported = None;
        }
    }

    pub fn is_check_due(&self, now: Duration) -> bool {
        self.last_check
            .is_none_or(|last_check| now.saturating_sub(last_check) >= CHECK_PERIOD)
    }

    /// The changes since the last check.
    pub fn check(&mut self, now: Duration) -> Vec<FaultChange> {
        self.last_check = Some(now);
        self.sensors
            .iter_mut()
            .filter_map(|sensor| sensor.check(now))
            .collect()
    }

    pub fn count(&mut self, counts: &RegistrationCounts) {
        let poses = |reasons: &[DropReason]| -> u64 {
            let reasons = reasons.iter();
            reasons
                .map(|reason| counts.dropped_poses.get(*reason))
                .sum()
        };
        for sensor in &mut self.sensors {
            sensor.dropped = match &sensor.own {
                MeasurementSelector::Scans { .. }
                | MeasurementSelector::Ranges(_)
                | MeasurementSelector::Clouds(_)
                | MeasurementSelector::Contacts(_) => {
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

    pub fn infos(&self) -> (u32, Vec<SensorInfo>) {
        let infos = self.sensors.iter().map(|sensor| sensor.info.clone());
        (self.revision, infos.collect())
    }

    pub fn name(&self, id: SensorId) -> Option<&str> {
        let mut sensors = self.sensors.iter();
        let found = sensors.find(|sensor| sensor.range_sensor == Some(id))?;
        Some(&found.info.name)
    }

    pub fn is_sonar(&self, id: SensorId) -> bool {
        self.sensors
            .iter()
            .any(|sensor| sensor.range_sensor == Some(id) && sensor.info.kind == SensorKind::Sonar)
    }

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
            fault: sensor.fault(now),
        };
        self.sensors.iter().map(status).collect()
    }
}

impl MonitoredSensor {
    /// A bumper without a rate sends only when its state changes.
    fn fault(&self, now: Duration) -> Option<SensorFault> {
        let is_on_change =
            matches!(self.own, MeasurementSelector::Contacts(_)) && self.info.rate_hz.is_none();
        self.health.fault(now).filter(|_| !is_on_change)
    }

    fn check(&mut self, now: Duration) -> Option<FaultChange> {
        let sensor = self.info.name.clone();
        match (self.fault(now), self.reported) {
            // A less severe fault is not reported again: an intermittent sensor would report all the time.
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
                // Over a bank or a shoal the water causes it, not the sonar.
                MeasurementSelector::Scans { .. } if self.info.kind == SensorKind::Sonar => {
                    "nothing valid: covered, broken, or nearer to the bottom than it measures"
                        .to_owned()
                }
                MeasurementSelector::Scans { .. }
                | MeasurementSelector::Ranges(_)
                | MeasurementSelector::Clouds(_)
                | MeasurementSelector::Contacts(_)
                | MeasurementSelector::Wheels { .. }
                | MeasurementSelector::Attitudes(_)
                | MeasurementSelector::Odometry
                | MeasurementSelector::Transforms { .. }
                | MeasurementSelector::Tilt { .. } => {
                    "measures nothing: covered or broken".to_owned()
                }
            },
            SensorFault::Blocked => {
                "its window seems to be blocked: no return where there was one".to_owned()
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
