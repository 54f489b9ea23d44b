//! What came from the sensors is watched, and consoles hear what is wrong with them.

use super::super::background::give_way;
use super::super::data_clock::DataClock;
use super::super::driving::DrivePlan;
use super::super::network_plan::NetworkPlan;
use super::super::people;
use super::super::told::{info, status};
use super::Network;
use crate::audit::AuditLog;
use crate::clock::{self, Monotonic};
use crate::config::Config;
use crate::driving::speedometer::Speedometer;
use crate::driving::{Driving, ListWatch, Lookout, Operators};
use crate::events::event;
use crate::export::voxels::{PublishedClasses, pack_voxels};
use crate::link::LinkError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::sessions::Endpoints;
use crate::link::shared::Shared;
use crate::localization::placer::PlacerSettings;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::measurement::Measurement;
use crate::pipeline::Pipeline;
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::sensor_watch::{Change, SensorWatch, listed};
use crate::streaming::last_scan::last_scan;
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{self, RecordingStatus, SensorFault, Shores, Status};
use protocol::tile::BootId;
use std::io::{self, Write};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

impl Network {
    /// Something was measured, which could be known since `came`; `elapsed` of the data's time has passed with it.
    pub(super) fn came(
        &mut self,
        measurement: &Measurement,
        came: Monotonic,
        elapsed: RobotDuration,
    ) {
        if let Some(lookout) = &mut self.lookout {
            lookout.came(measurement.stamp, came);
        }
        let at = match self.since {
            Some(since) => came.since(since),
            None => of_data(elapsed),
        };
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
            self.link.shared().set_sensors(revision, infos);
        }
    }
}

/// Time of the data since the first.
fn of_data(elapsed: RobotDuration) -> Duration {
    Duration::from_nanos(u64::try_from(elapsed.as_nanos()).unwrap_or_default())
}

const fn fault_kind(fault: SensorFault) -> &'static str {
    match fault {
        SensorFault::Silent => "sensor_silent",
        SensorFault::Clock => "sensor_clock",
        SensorFault::AllInvalid => "sensor_invalid",
        SensorFault::Slow => "sensor_slow",
    }
}
