//! How each sensor is doing: rate, age, losses, faults. Pure: measurements and times in, statuses and changes out.
//!
//! Times are durations on one line that the caller chooses and keeps to: since a live vehicle's program began, or of
//! the data's own time where it is replayed or simulated, so that a replay tells the same at every speed.

mod health;
mod listed;
mod sight;

use std::time::Duration;

use protocol::message::{MAX_SENSORS, SensorFault, SensorInfo, SensorKind, SensorStatus};

pub use listed::{Listed, Own, listed};

use health::Health;
use sight::Sight;

use crate::drops::DropReason;
use crate::localization::placer::{PlacerCounts, SensorCounts};
use crate::mapping::posed_scan::{PosedScan, SensorId};
use crate::measurement::Measurement;

/// Between two looks at the sensors.
const LOOK_PERIOD: Duration = Duration::from_millis(250);
/// A fault that is gone for so long is over: one that comes and goes is told of once.
const OVER_AFTER: Duration = Duration::from_secs(2);

/// Watches the sensors of one vehicle.
#[derive(Clone, Debug)]
pub struct SensorWatch {
    sensors: Vec<Watched>,
    /// What was found out of them.
    revision: u32,
    looked: Option<Duration>,
}

#[derive(Clone, Debug)]
struct Watched {
    info: SensorInfo,
    own: Own,
    range_sensor: Option<SensorId>,
    health: Health,
    sight: Sight,
    dropped: u64,
    /// The fault that people were told of, and when it was last there.
    told: Option<(SensorFault, Duration)>,
}

/// A fault that began or is over.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// It began.
    Began {
        /// Name of the sensor.
        sensor: String,
        /// What.
        fault: SensorFault,
        /// What, in a sentence.
        message: String,
    },
    /// The sensor is well again.
    Over {
        /// Name of the sensor.
        sensor: String,
        /// That, in a sentence.
        message: String,
    },
}

impl SensorWatch {
    /// Watches these, of which the first [`MAX_SENSORS`] count.
    pub fn new(sensors: Vec<Listed>) -> Self {
        let watched = |listed: Listed| Watched {
            health: Health::new(listed.info.rate_hz),
            sight: listed.sight,
            range_sensor: listed.range_sensor,
            own: listed.own,
            info: listed.info,
            dropped: 0,
            told: None,
        };
        Self {
            sensors: sensors.into_iter().take(MAX_SENSORS).map(watched).collect(),
            revision: 0,
            looked: None,
        }
    }

    /// Something was measured, and could be known since `at`.
    pub fn take(&mut self, measurement: &Measurement, at: Duration) {
        for sensor in &mut self.sensors {
            if let Some(is_valid) = sensor.own.judge(measurement) {
                sensor.health.take(measurement.stamp, is_valid, at);
                if sensor.sight.measured(measurement, &mut sensor.info) {
                    self.revision += 1;
                }
            }
        }
    }

    /// The beams of a scan were placed; by them the sensor's window `is_blocked` or is not.
    pub fn placed(&mut self, scan: &PosedScan, is_blocked: bool) {
        for sensor in &mut self.sensors {
            if sensor.range_sensor != Some(scan.sensor) {
                continue;
            }
            sensor.health.set_blocked(is_blocked);
            if sensor.sight.placed(scan, &mut sensor.info) {
                self.revision += 1;
            }
        }
    }

    /// The stamps begin anew, and that is as it should be: a recording is replayed again.
    pub fn begin_again(&mut self) {
        for sensor in &mut self.sensors {
            sensor.health.forget_stamp();
        }
    }

    /// The data is wound: time stands at `to`, before or behind what it was. What was told of is not told to be over.
    pub fn wind(&mut self, to: Duration) {
        self.looked = None;
        for sensor in &mut self.sensors {
            sensor.health.wind(to);
            sensor.told = None;
        }
    }

    /// Whether it is time to [`look`](Self::look).
    pub fn is_look_due(&self, now: Duration) -> bool {
        self.looked
            .is_none_or(|looked| now.saturating_sub(looked) >= LOOK_PERIOD)
    }

    /// What began or is over since the last look.
    pub fn look(&mut self, now: Duration) -> Vec<Change> {
        self.looked = Some(now);
        self.sensors
            .iter_mut()
            .filter_map(|sensor| sensor.look(now))
            .collect()
    }

    /// Takes over what the placer has left out.
    pub fn count(&mut self, counts: &PlacerCounts) {
        let poses = |reasons: &[DropReason]| -> u64 {
            let reasons = reasons.iter();
            reasons
                .map(|reason| counts.dropped_poses.get(*reason))
                .sum()
        };
        for sensor in &mut self.sensors {
            sensor.dropped = match &sensor.own {
                Own::Scans { .. } => {
                    let own = |of: &&SensorCounts| Some(of.sensor) == sensor.range_sensor;
                    let own = counts.sensors.iter().find(own);
                    own.map_or(0, |own| own.dropped_scans.total())
                }
                Own::Wheels { .. } => poses(&[DropReason::WheelJump]),
                Own::Fixes(_) => {
                    poses(&[DropReason::NoFix, DropReason::BadFix, DropReason::FixLeap])
                }
                Own::Attitudes(_) | Own::Odometry | Own::Transforms { .. } => {
                    poses(&[DropReason::BadPose])
                }
                Own::Tilt { .. } => 0,
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
        let status = |sensor: &Watched| SensorStatus {
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

impl Watched {
    fn look(&mut self, now: Duration) -> Option<Change> {
        let sensor = self.info.name.clone();
        match (self.health.fault(now), self.told) {
            // What is only less bad is not told anew: a sensor that stutters would never be quiet.
            (Some(fault), Some((told, _))) if fault >= told => {
                self.told = Some((told, now));
                None
            }
            (Some(fault), _) => {
                self.told = Some((fault, now));
                let message = format!("{sensor}: {}", self.words(fault, now));
                Some(Change::Began {
                    sensor,
                    fault,
                    message,
                })
            }
            (None, Some((_, seen))) if now.saturating_sub(seen) >= OVER_AFTER => {
                self.told = None;
                let message = format!("{sensor}: back");
                Some(Change::Over { sensor, message })
            }
            (None, _) => None,
        }
    }

    fn words(&self, fault: SensorFault, now: Duration) -> String {
        match fault {
            SensorFault::Silent => match self.health.age(now) {
                Some(age) => format!("silent for {:.1} s", age.as_secs_f64()),
                None => "nothing has come from it".to_owned(),
            },
            SensorFault::Clock => "its stamps leapt".to_owned(),
            SensorFault::AllInvalid => match self.own {
                Own::Fixes(_) => "no fix".to_owned(),
                // Over a bank or a shoal it is the water that is at fault, not the sonar.
                Own::Scans { .. } if self.info.kind == SensorKind::Sonar => {
                    "nothing valid: covered, broken, or nearer to the bottom than it measures"
                        .to_owned()
                }
                Own::Scans { .. }
                | Own::Wheels { .. }
                | Own::Attitudes(_)
                | Own::Odometry
                | Own::Transforms { .. }
                | Own::Tilt { .. } => "measures nothing: covered or broken".to_owned(),
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
