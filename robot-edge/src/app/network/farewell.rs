//! The end of a run: consoles get what they lack before the link closes.

use super::super::background::give_way;
use super::super::data_clock::DataClock;
use super::super::driving::DrivePlan;
use super::super::network_plan::NetworkPlan;
use super::super::people;
use super::super::told::{info, status};
use super::{FAREWELL, LAST_WORDS, Network};
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
    /// The data has ended: waits until every console has all of it, or for good where that was asked for.
    pub(super) fn take_leave(
        &self,
        pipeline: &Pipeline,
        quiet: bool,
        is_interrupted: impl Fn() -> bool,
    ) {
        let revision = head_revision(pipeline);
        let shared = self.link.shared();
        let is_interrupted = || {
            self.serve_voxels(pipeline);
            is_interrupted()
        };
        shared.end();
        if self.stay {
            if !quiet {
                // Nothing is lost where standard error is closed.
                drop(writeln!(
                    io::stderr(),
                    "network: the data has ended, the map is served until Ctrl-C"
                ));
            }
            while clock::sleep_until(Monotonic::now() + Duration::from_secs(1), is_interrupted) {}
            return;
        }
        let ended = Monotonic::now();
        let is_over = || {
            let now = Monotonic::now();
            let nobody_looks = shared.views(now).is_empty();
            let everybody_knows =
                now.since(ended) >= LAST_WORDS && shared.everybody_has(revision, now);
            is_interrupted() || nobody_looks || everybody_knows
        };
        clock::sleep_until(ended + FAREWELL, is_over);
    }
}

/// The newest revision of any layer.
fn head_revision(pipeline: &Pipeline) -> u64 {
    let store = pipeline.publisher().store();
    LayerId::ALL
        .into_iter()
        .map(|layer| store.head_revision(layer))
        .max()
        .unwrap_or(0)
}
