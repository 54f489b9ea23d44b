//! What the stages of the pipeline hand over to outputs beside the consoles' server: the ROS 2 system and Foxglove.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex};

use protocol::message::{Event, Shores};
use protocol::tile_store::TileStore;

use crate::lock;
use crate::publishing::trajectory::SharedTrajectory;
use mapping::octree::Octree;
use mapping::registered_scan::{RegisteredScan, SensorId};
use measurement::Twist;
use measurement::pose::Pose;
use measurement::time::RobotTime;

/// The vehicle at one time.
#[derive(Clone, Copy, Debug)]
pub struct VehicleState {
    pub stamp: RobotTime,
    pub odom_from_base: Pose,
    /// `None` while the vehicle is searched for in a saved map.
    pub map_from_odom: Option<Pose>,
    /// In the frame of the vehicle.
    pub twist: Twist,
}

/// The newest that the stages of the pipeline hand over. The locks are held only for a move or a copy.
#[derive(Clone, Debug, Default)]
pub struct OutputInputs {
    vehicle: Arc<Mutex<Option<VehicleState>>>,
    octree: Arc<Mutex<OctreeRequest>>,
    /// The first of each sensor since they were requested.
    scans: Arc<Mutex<Option<Scans>>>,
    shores: Arc<Mutex<Option<StampedShores>>>,
    /// The last ones that nobody took.
    events: Arc<Mutex<VecDeque<(RobotTime, Event)>>>,
    /// What consoles must know, each once.
    warnings: Arc<Mutex<Vec<String>>>,
}

type Scans = BTreeMap<SensorId, RegisteredScan>;
type StampedShores = (RobotTime, Arc<Shores>);

/// Events that wait; a newer one replaces the oldest.
const MAX_EVENTS: usize = 256;

#[derive(Debug, Default)]
enum OctreeRequest {
    #[default]
    None,
    Requested,
    Made(RobotTime, Box<Octree>),
}

impl OutputInputs {
    pub fn set_vehicle(&self, vehicle: VehicleState) {
        *lock(&self.vehicle) = Some(vehicle);
    }

    pub fn vehicle(&self) -> Option<VehicleState> {
        *lock(&self.vehicle)
    }

    /// Copies the scan, if it is requested.
    pub fn offer_scan(&self, scan: &RegisteredScan) {
        if let Some(scans) = &mut *lock(&self.scans) {
            scans.entry(scan.sensor).or_insert_with(|| scan.clone());
        }
    }

    /// The requested scans; `is_wanted` requests the next ones.
    pub fn take_scans(&self, is_wanted: bool) -> Scans {
        let next = is_wanted.then(Scans::new);
        std::mem::replace(&mut *lock(&self.scans), next).unwrap_or_default()
    }

    pub fn set_shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        *lock(&self.shores) = Some((stamp, shores));
    }

    pub fn shores(&self) -> Option<StampedShores> {
        lock(&self.shores).clone()
    }

    pub fn add_event(&self, stamp: RobotTime, event: Event) {
        let mut events = lock(&self.events);
        if events.len() >= MAX_EVENTS {
            events.pop_front();
        }
        events.push_back((stamp, event));
    }

    pub fn take_events(&self) -> VecDeque<(RobotTime, Event)> {
        std::mem::take(&mut *lock(&self.events))
    }

    /// Copies the octree, if it is requested.
    pub fn offer_octree(&self, stamp: RobotTime, octree: &Octree) {
        if matches!(*lock(&self.octree), OctreeRequest::Requested) {
            let mut copy = Box::new(octree.clone());
            copy.forget_disk();
            *lock(&self.octree) = OctreeRequest::Made(stamp, copy);
        }
    }

    /// Nobody takes it any more: its memory is freed.
    pub fn cancel_octree(&self) {
        *lock(&self.octree) = OctreeRequest::None;
    }

    /// Whether it is requested, or waits to be taken.
    #[cfg(test)]
    pub fn has_octree_request(&self) -> bool {
        !matches!(*lock(&self.octree), OctreeRequest::None)
    }

    pub fn add_warning(&self, message: String) {
        lock(&self.warnings).push(message);
    }

    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut *lock(&self.warnings))
    }

    /// The requested octree; the first call requests one.
    pub fn take_octree(&self) -> Option<(RobotTime, Box<Octree>)> {
        let mut request = lock(&self.octree);
        match std::mem::take(&mut *request) {
            OctreeRequest::Made(stamp, octree) => Some((stamp, octree)),
            OctreeRequest::None | OctreeRequest::Requested => {
                *request = OctreeRequest::Requested;
                None
            }
        }
    }
}

/// What is published of: shared with mapping.
pub struct OutputSources {
    pub inputs: OutputInputs,
    pub store: Arc<Mutex<TileStore>>,
    pub trajectory: SharedTrajectory,
}
