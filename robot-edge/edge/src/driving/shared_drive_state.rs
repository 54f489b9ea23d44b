//! The state that the loop publishes to the rest of the program: newest token, status, events.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, TryLockError};

use protocol::keys::OperatorId as OperatorName;
use protocol::message::{MapPose, MotorHold, Plan, TeleopStatus};

use super::status_message::{self, MonitorDetail};
use crate::actuators::Fault;
use crate::driving::planner::PlannerExchange;
use crate::driving::thread::LoopFailure;
use crate::lock;
use teleop::collision_monitor::UnavailableReason;
use teleop::{AgeToken, ArbiterEvent, OperatorId, TeleopReport};

/// Greatest number of waiting events; the oldest is dropped.
const MAX_EVENTS: usize = 256;

/// An event for operators and the audit log.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum DriveEvent {
    Arbiter(ArbiterEvent),
    /// The collision monitor gave no limits, and the vehicle stops.
    MonitorUnavailable {
        unavailable_reason: Option<UnavailableReason>,
    },
    Motors(Fault),
    /// An autopilot obeys no velocity from now on, or obeys again.
    MotorsHeld(Option<MotorHold>),
    /// What an autopilot says.
    Autopilot(String),
    LoopFailed(LoopFailure),
    Recording {
        is_on: bool,
        by: OperatorId,
    },
    MonitorSwitched {
        is_on: bool,
        by: OperatorId,
    },
    MonitorReenabled(MonitorReenabled),
}

/// What switches the collision monitor on again: it was off for one driver and one drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum MonitorReenabled {
    Granted(OperatorId),
    EStopped,
    /// A reset of an emergency stop or of a fault.
    Reset,
}

/// The latest values. The loop never waits to write: if a reader holds a part, the loop writes it in the next round, 20
/// ms later.
#[derive(Debug, Default)]
pub struct SharedDriveState {
    token: Mutex<Option<AgeToken>>,
    /// With the details of the collision monitor.
    report: Mutex<Option<(TeleopReport, MonitorDetail)>>,
    drive_events: Mutex<VecDeque<DriveEvent>>,
    names: Mutex<Vec<OperatorName>>,
    runtime_settings: Mutex<status_message::RuntimeSettings>,
    recording_request: Mutex<Option<bool>>,
    map_request: Mutex<Option<MapRequest>>,
    is_recording: AtomicBool,
    is_closing: AtomicBool,
    planner: Option<PlannerExchange>,
}

/// What an operator wants of the map of matched scans.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MapRequest {
    /// Save it under this name.
    Save(String),
    /// Search for the vehicle near this pose.
    Locate(MapPose),
}

impl SharedDriveState {
    pub(super) fn new(planner: Option<PlannerExchange>) -> Self {
        Self {
            planner,
            ..Self::default()
        }
    }

    /// The newest token, for the next pose.
    pub fn token(&self) -> Option<AgeToken> {
        *lock(&self.token)
    }

    /// Whether an operator holds the lease or gets it next: tokens are then published in every round.
    pub fn is_held(&self) -> bool {
        let report = *lock(&self.report);
        report
            .is_some_and(|(report, _)| report.lease.holder.is_some() || report.lease.next.is_some())
    }

    /// The status of driving; `None` before the loop's first round.
    pub fn status(&self) -> Option<TeleopStatus> {
        let (report, detail) = (*lock(&self.report))?;
        let mut runtime_settings = *lock(&self.runtime_settings);
        runtime_settings.recording = self.is_recording.load(Ordering::Relaxed);
        let report = (&report, detail);
        let mut status = status_message::status(report, &lock(&self.names), runtime_settings);
        status.goal.has_planner = self
            .planner
            .as_ref()
            .is_some_and(PlannerExchange::is_present);
        Some(status)
    }

    /// The events since the last call: kind and message.
    pub fn take_events(&self) -> Vec<(&'static str, String)> {
        let drive_events: Vec<_> = lock(&self.drive_events).drain(..).collect();
        let names = lock(&self.names);
        let drive_events = drive_events.iter();
        drive_events
            .map(|drive_event| status_message::event_text(drive_event, &names))
            .collect()
    }

    /// The path of the planner; `None` where there is none.
    pub fn plan(&self) -> Option<Plan> {
        self.planner.as_ref().map(PlannerExchange::plan)
    }

    pub fn budget_kbps(&self) -> u32 {
        lock(&self.runtime_settings).budget_kbps
    }

    pub fn take_recording_request(&self) -> Option<bool> {
        lock(&self.recording_request).take()
    }

    /// What an operator wants of the map of matched scans.
    pub fn take_map_request(&self) -> Option<MapRequest> {
        lock(&self.map_request).take()
    }

    pub fn set_recording(&self, is_running: bool) {
        self.is_recording.store(is_running, Ordering::Relaxed);
    }

    /// Returns whether the request was stored; not while a reader holds the lock.
    pub(super) fn request_recording(&self, is_on: bool) -> bool {
        write(&self.recording_request, |request| *request = Some(is_on))
    }

    /// Returns whether the request was stored; not while a reader holds the lock.
    pub(super) fn request_map(&self, wanted: MapRequest) -> bool {
        write(&self.map_request, |request| *request = Some(wanted))
    }

    pub(super) fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }

    pub(super) fn publish_token(&self, token: AgeToken) {
        write(&self.token, |shown| *shown = Some(token));
    }

    pub(super) fn publish_report(&self, report: &TeleopReport, detail: MonitorDetail) {
        write(&self.report, |shown| *shown = Some((*report, detail)));
    }

    pub(super) fn publish_settings(&self, runtime_settings: status_message::RuntimeSettings) {
        write(&self.runtime_settings, |shown| *shown = runtime_settings);
    }

    /// Publishes events; they stay in `waiting` while a reader holds the lock.
    pub(super) fn publish_events(&self, waiting: &mut VecDeque<DriveEvent>) {
        write(&self.drive_events, |published| {
            published.extend(waiting.drain(..));
            while published.len() > MAX_EVENTS {
                published.pop_front();
            }
        });
        // Without a reader the queue must not grow.
        while waiting.len() > MAX_EVENTS {
            waiting.pop_front();
        }
    }

    pub(super) fn publish_names<'a>(&self, names: impl Iterator<Item = &'a OperatorName>) {
        write(&self.names, |shown| {
            shown.clear();
            shown.extend(names.cloned());
        });
    }
}

/// Returns whether it was written; not while a reader holds the lock.
fn write<T>(part: &Mutex<T>, change: impl FnOnce(&mut T)) -> bool {
    match part.try_lock() {
        Ok(mut shown) => change(&mut shown),
        Err(TryLockError::Poisoned(poisoned)) => change(&mut poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => return false,
    }
    true
}
