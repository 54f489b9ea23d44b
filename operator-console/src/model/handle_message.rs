//! What becomes of each message.

use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{
    Digests, Event, Info, LayerHead, MapHead, Pong, Pose, Scan, ShoresReply, Status, TeleopStatus,
    TileBand, TilesReply, TrajectoryPart, VoxelsReply,
};
use protocol::wire::{self, Header, WireError};
use serde::de::DeserializeOwned;

use super::trail_sync::{GAP, TrailSync};
use super::validation::{is_info_valid, is_status_valid};
use super::visible_change::status_changed;
use super::{ConsoleModel, MAX_EVENTS, RejectReason, RequestId, StopBeforeEStop, Stream};

impl ConsoleModel {
    /// Takes a message that arrived with a key, pushed or in answer to a request.
    ///
    /// # Errors
    /// Why it was not taken.
    pub(super) fn take(
        &mut self,
        key: &str,
        payload: &[u8],
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let (robot, topic) = Topic::parse(key).ok_or(RejectReason::Key)?;
        if robot != self.settings.robot {
            return Err(RejectReason::Key);
        }
        match request {
            None => self.take_pushed(topic, payload, now)?,
            Some(request) => self.take_reply(topic, payload, request, now)?,
        }
        if is_by_control(topic) {
            self.connection.on_message(now);
        }
        Ok(())
    }

    pub(super) fn teleop(&self) -> Option<&TeleopStatus> {
        let (status, _) = self.status.as_ref()?;
        status.teleop.as_ref()
    }

    /// While an emergency stop is active nothing stops on the way: what is told now was before it.
    fn record_stop_before_estop(&mut self, status: &Status) {
        let teleop = status.teleop.as_ref();
        if let Some(teleop) = teleop.filter(|teleop| teleop.estop.is_some()) {
            let last_stop = teleop.last_stop;
            self.stop_before_estop = Some(StopBeforeEStop { last_stop });
        }
    }

    /// Whether it goes where it is told to, and stands where it is told to.
    fn update_motion(&mut self, status: &Status, now: Monotonic) {
        let pose = self.vehicle.pose().map(|(pose, _)| pose);
        let info = self.info.as_ref().map(|(info, _)| info);
        self.motion.update(status, pose.as_ref(), info, now);
    }

    fn take_pushed(
        &mut self,
        topic: Topic,
        payload: &[u8],
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        match topic {
            Topic::Pose => self.take_pose(payload, now)?,
            Topic::Status => {
                let (header, status): (_, Status) = decode(payload)?;
                self.of_this_boot(header)?;
                if !is_status_valid(&status) {
                    return Err(RejectReason::Malformed);
                }
                self.quality.on_message(Stream::Status, now);
                let teleop = status.teleop.as_ref();
                let is_held = teleop.is_some_and(|teleop| teleop.lease.holder.is_some());
                self.quality.rate(is_held, now);
                if status.has_ended {
                    if self.ended_seq.is_none() {
                        self.ended_seq = Some(header.seq);
                        self.shores.hurry();
                    }
                } else {
                    self.ended_seq = None;
                }
                self.record_stop_before_estop(&status);
                let before = self.status.as_ref();
                let is_changed = before.is_none_or(|(before, _)| status_changed(before, &status));
                self.changes += u64::from(is_changed);
                self.map.update_clock(header, now);
                self.update_motion(&status, now);
                self.monitor_history.update(status.teleop.as_ref(), now);
                self.status = Some((status, now));
                self.status_run = Some(header.boot);
            }
            Topic::Event => {
                let (_, event): (_, Event) = decode(payload)?;
                if event.kind == "estop" {
                    let last_stop = self.teleop().and_then(|teleop| teleop.last_stop);
                    self.stop_before_estop = Some(StopBeforeEStop { last_stop });
                }
                if self.events.len() >= MAX_EVENTS {
                    self.events.pop_front();
                }
                self.events.push_back((event, now));
                self.changes += 1;
            }
            Topic::MapHead => {
                let (header, head): (_, MapHead) = decode(payload)?;
                let seq = header.seq;
                let of_shores = |layer: &&LayerHead| layer.layer == LayerId::Shore;
                let epoch = head.layers.iter().find(of_shores).map(|head| head.epoch);
                if self.map.take_head(head, header.boot, now)? {
                    self.vehicle.forget();
                    self.shores.forget();
                    self.voxels.forget();
                    self.trajectory.forget();
                    self.trail = TrailSync::default();
                    self.scans.forget();
                    self.stop_before_estop = None;
                    self.monitor_history.forget();
                    self.ended_seq = None;
                    // Another run has not ended because the last one had.
                    self.status.take_if(|(status, _)| status.has_ended);
                    if self
                        .info
                        .as_ref()
                        .is_some_and(|(_, boot)| *boot != header.boot)
                    {
                        self.info = None;
                    }
                }
                if epoch.is_some_and(|epoch| self.shores.of_epoch(epoch)) {
                    self.changes += 1;
                }
                self.map.update_clock(header, now);
                self.restore_names();
                self.quality.on_message(Stream::MapHead, now);
                self.head_seq = seq;
            }
            Topic::Tile(tile) => {
                let (header, band): (_, TileBand) = decode(payload)?;
                self.map.take_band(tile, header, &band, None, now)?;
                self.quality.on_message(Stream::Tiles, now);
                self.sensor_updates += 1;
            }
            Topic::Shores => self.take_shores(payload, None, now)?,
            Topic::Scan => {
                let (header, scan): (_, Scan) = decode(payload)?;
                self.of_this_boot(header)?;
                // One that was on its way when nobody wanted any more would stay for ever.
                if self.wants_scan {
                    self.scans.take(scan, header.robot_time_ns, now)?;
                    self.sensor_updates += 1;
                }
            }
            Topic::Alive
            | Topic::View
            | Topic::Info
            | Topic::Ping
            | Topic::Tiles(_)
            | Topic::Digests(_)
            | Topic::Voxels
            | Topic::Trajectory
            | Topic::Operator(_) => return Err(RejectReason::Key),
        }
        Ok(())
    }

    fn take_pose(&mut self, payload: &[u8], now: Monotonic) -> Result<(), RejectReason> {
        let (header, pose): (_, Pose) = decode(payload)?;
        let numbers = pose
            .position_m
            .into_iter()
            .chain(pose.quaternion_xyzw.map(f64::from));
        if !numbers.into_iter().all(f64::is_finite) {
            return Err(RejectReason::Malformed);
        }
        self.of_this_boot(header)?;
        self.map.update_clock(header, now);
        self.quality.pose(now);
        let before = self.vehicle.pose();
        if before.is_none_or(|(_, at)| now.since(at) > GAP) {
            self.trail.gap();
        }
        self.connection.set_steady(self.quality.is_steady());
        self.changes += u64::from(self.vehicle.take(pose, header.robot_time_ns, now));
        Ok(())
    }

    fn take_reply(
        &mut self,
        topic: Topic,
        payload: &[u8],
        request: RequestId,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        match topic {
            Topic::Tiles(layer) => {
                let (header, reply): (_, TilesReply) = decode(payload)?;
                self.map.take_reply(layer, header, &reply, request, now)?;
                self.changes += 1;
            }
            Topic::Digests(layer) => {
                let (header, digests): (_, Digests) = decode(payload)?;
                self.map
                    .take_digests(layer, header.boot, &digests, request)?;
            }
            Topic::Info => {
                let (header, info): (_, Info) = decode(payload)?;
                if !is_info_valid(&info) {
                    return Err(RejectReason::Malformed);
                }
                self.map
                    .take_info(&info, header.boot)
                    .map_err(|_why| RejectReason::Malformed)?;
                self.info = Some((info, header.boot));
                self.info_request = None;
                self.changes += 1;
            }
            Topic::Ping => {
                let (_, Pong) = decode(payload)?;
                self.connection.on_pong(request, now);
            }
            Topic::Shores => self.take_shores(payload, Some(request), now)?,
            Topic::Voxels => {
                let (header, reply): (_, VoxelsReply) = decode(payload)?;
                self.of_this_boot(header)?;
                let stamp_ns = header.robot_time_ns;
                self.voxels.take(reply, stamp_ns, request, now)?;
                self.changes += 1;
            }
            Topic::Trajectory => {
                let (header, part): (_, TrajectoryPart) = decode(payload)?;
                self.of_this_boot(header)?;
                if let Some(known) = self.trail.take(&part, request, now) {
                    self.vehicle.fill_trail(&known);
                } else if !self.trajectory.take(&part, request, now)? {
                    return Err(RejectReason::OldRevision);
                }
                self.changes += 1;
            }
            Topic::Alive
            | Topic::View
            | Topic::Pose
            | Topic::Status
            | Topic::Event
            | Topic::MapHead
            | Topic::Tile(_)
            | Topic::Scan
            | Topic::Operator(_) => return Err(RejectReason::Key),
        }
        Ok(())
    }

    fn take_shores(
        &mut self,
        payload: &[u8],
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let (header, news): (_, ShoresReply) = decode(payload)?;
        self.of_this_boot(header)?;
        let is_changed = self.shores.take(news, header.seq, request, now)?;
        self.changes += u64::from(is_changed);
        Ok(())
    }

    /// What the last run of the robot still had to say is not this one's.
    fn of_this_boot(&self, header: Header) -> Result<(), RejectReason> {
        match self.map.boot() {
            Some(boot) if boot != header.boot => Err(RejectReason::OtherBoot),
            Some(_) | None => Ok(()),
        }
    }
}

/// Whether it comes by the control session, as the vehicle's state does and what it is told. Tiles may go on coming by theirs
/// while that one is lost: where one is QUIC and the other TLS, a network that swallows UDP cuts only the first.
const fn is_by_control(topic: Topic) -> bool {
    match topic {
        Topic::Info
        | Topic::Alive
        | Topic::Pose
        | Topic::Status
        | Topic::Event
        | Topic::MapHead
        | Topic::Ping
        | Topic::View
        | Topic::Operator(_) => true,
        Topic::Tile(_)
        | Topic::Tiles(_)
        | Topic::Digests(_)
        | Topic::Shores
        | Topic::Voxels
        | Topic::Trajectory
        | Topic::Scan => false,
    }
}

fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<(Header, T), RejectReason> {
    wire::decode(payload).map_err(|why| match why {
        WireError::TooLong(_) => RejectReason::Oversized,
        WireError::OtherProtocol { .. } => RejectReason::OtherProtocol,
        WireError::Malformed => RejectReason::Malformed,
    })
}
