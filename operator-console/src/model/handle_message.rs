//! Handling of messages from the link. An invalid message is rejected and counted: none causes a panic or unbounded memory.

use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{
    Digests, Event, Info, LayerHead, MAX_SENSORS, MapHead, Pong, Pose, Scan, SensorInfo,
    ShoresReply, Status, TileBand, TilesReply, TrajectoryPart, VoxelsReply,
};
use protocol::tile::TileKey;
use protocol::wire::{self, Header, WireError};
use serde::de::DeserializeOwned;

use super::trajectory_sync::{GAP, TrailSync};
use super::visible_change::status_changed;
use super::{
    ConsoleModel, Incoming, MAX_EVENTS, RejectReason, RequestId, RetryTimer, StopBeforeEStop,
    Stream,
};

impl ConsoleModel {
    pub fn apply(&mut self, incoming: Incoming, now: Monotonic) {
        match incoming {
            Incoming::Sample { key, payload } => self.take(&key, &payload, None, now),
            Incoming::Reply {
                request,
                key,
                payload,
            } => self.take(&key, &payload, Some(request), now),
            Incoming::Ended { request } => {
                self.shores.query.ended(request, now);
                self.voxels.ended(request, now);
                self.trajectory.query.ended(request, now);
                self.trail.query.ended(request, now);
                self.map.ended(request, now);
            }
            Incoming::Lost { overrun, oversized } => {
                self.reject_counts.add(RejectReason::Overrun, overrun);
                self.reject_counts.add(RejectReason::Oversized, oversized);
            }
            Incoming::Presence(is_present) => {
                self.connection.is_present = Some(is_present);
                self.changes += 1;
            }
        }
    }

    fn take(&mut self, key: &str, payload: &[u8], request: Option<RequestId>, now: Monotonic) {
        self.connection.add_bytes(payload.len(), now);
        if let Err(why) = self.try_take(key, payload, request, now) {
            tracing::debug!(why = why.name(), "rejected a message");
            self.reject_counts.add(why, 1);
        }
    }

    fn try_take(
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
            self.connection.last_message = Some(now);
        }
        Ok(())
    }

    fn take_pushed(
        &mut self,
        topic: Topic,
        payload: &[u8],
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        match topic {
            Topic::Pose => self.take_pose(payload, now)?,
            Topic::Status => self.take_status(payload, now)?,
            Topic::Event => {
                let (_, event): (_, Event) = decode(payload)?;
                if event.kind == "estop" {
                    let teleop = self.robot.teleop();
                    let last_stop = teleop.and_then(|teleop| teleop.last_stop);
                    self.robot.stop_before_estop = Some(StopBeforeEStop { last_stop });
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
                    self.scans.by_sensor.clear();
                    self.robot.begin_run(header.boot);
                }
                if epoch.is_some_and(|epoch| self.shores.of_epoch(epoch)) {
                    self.changes += 1;
                }
                self.map.update_clock(header, now);
                self.shores.restore_names(self.map.boot());
                self.quality.on_message(Stream::MapHead, now);
                self.robot.head_seq = seq;
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
                // A late scan would stay on the map for ever.
                if self.scans.is_wanted {
                    self.scans.take(scan, header.robot_time_ns, now)?;
                    self.sensor_updates += 1;
                }
            }
            _ => return Err(RejectReason::Key),
        }
        Ok(())
    }

    fn take_status(&mut self, payload: &[u8], now: Monotonic) -> Result<(), RejectReason> {
        let (header, status): (_, Status) = decode(payload)?;
        self.of_this_boot(header)?;
        if !is_status_valid(&status) {
            return Err(RejectReason::Malformed);
        }
        let teleop = status.teleop.as_ref();
        self.quality.on_message(Stream::Status, now);
        let is_held = teleop.is_some_and(|teleop| teleop.lease.holder.is_some());
        self.quality.rate(is_held, now);
        self.map.update_clock(header, now);
        let robot = &mut self.robot;
        if !status.has_ended {
            robot.ended_seq = None;
        } else if robot.ended_seq.is_none() {
            robot.ended_seq = Some(header.seq);
            // Requests the shores as soon as possible.
            self.shores.query.backoff.not_before = Monotonic::default();
        }
        // During an emergency stop no other stop happens: the last one was before it.
        if let Some(teleop) = teleop.filter(|teleop| teleop.estop.is_some()) {
            let last_stop = teleop.last_stop;
            robot.stop_before_estop = Some(StopBeforeEStop { last_stop });
        }
        let before = robot.status.as_ref();
        let is_changed = before.is_none_or(|(before, _)| status_changed(before, &status));
        self.changes += u64::from(is_changed);
        let pose = self.vehicle.pose().map(|(pose, _)| pose);
        let info = robot.info.as_ref().map(|(info, _)| info);
        robot.motion.update(&status, pose.as_ref(), info, now);
        robot.monitor_history.update(teleop, now);
        robot.status = Some((status, now));
        robot.status_run = Some(header.boot);
        Ok(())
    }

    fn take_pose(&mut self, payload: &[u8], now: Monotonic) -> Result<(), RejectReason> {
        let (header, pose): (_, Pose) = decode(payload)?;
        let quaternion = pose.quaternion_xyzw.map(f64::from);
        let mut numbers = pose.position_m.into_iter().chain(quaternion);
        if !numbers.all(f64::is_finite) {
            return Err(RejectReason::Malformed);
        }
        self.of_this_boot(header)?;
        self.map.update_clock(header, now);
        self.quality.pose(now);
        let before = self.vehicle.pose();
        if before.is_none_or(|(_, at)| now.since(at) > GAP) {
            self.trail.gap();
        }
        self.connection.is_steady = self.quality.is_steady();
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
                let (header, TilesReply { tx, ty, band, .. }) = decode(payload)?;
                let key = TileKey { layer, tx, ty };
                self.map.take_band(key, header, &band, Some(request), now)?;
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
                self.robot.info = Some((info, header.boot));
                self.robot.info_query = RetryTimer::default();
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
            _ => return Err(RejectReason::Key),
        }
        Ok(())
    }

    fn take_shores(
        &mut self,
        payload: &[u8],
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), RejectReason> {
        let (header, reply): (_, ShoresReply) = decode(payload)?;
        self.of_this_boot(header)?;
        let is_changed = self.shores.take(reply, header.seq, request, now)?;
        self.changes += u64::from(is_changed);
        Ok(())
    }

    /// Rejects late messages of an earlier run of the robot.
    fn of_this_boot(&self, header: Header) -> Result<(), RejectReason> {
        match self.map.boot() {
            Some(boot) if boot != header.boot => Err(RejectReason::OtherBoot),
            _ => Ok(()),
        }
    }
}

/// Whether messages of this topic come by the control session. Tiles may still arrive while it is lost: if one session uses
/// QUIC and the other TLS, a network that drops UDP cuts only the first.
const fn is_by_control(topic: Topic) -> bool {
    !matches!(
        topic,
        Topic::Tile(_)
            | Topic::Tiles(_)
            | Topic::Digests(_)
            | Topic::Shores
            | Topic::Voxels
            | Topic::Trajectory
            | Topic::Scan
    )
}

fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<(Header, T), RejectReason> {
    wire::decode(payload).map_err(|why| match why {
        WireError::TooLong(_) => RejectReason::Oversized,
        WireError::OtherProtocol { .. } => RejectReason::OtherProtocol,
        WireError::Malformed => RejectReason::Malformed,
    })
}

pub(super) fn is_info_valid(info: &Info) -> bool {
    let numbers = info.footprint_m.iter().chain(&info.limits).chain([
        &info.stop_decel_mps2,
        &info.stop_decel_radps2,
        &info.footprint_offset_m,
    ]);
    info.sensors.len() <= MAX_SENSORS
        && all_finite(numbers)
        && info.sensors.iter().all(is_sensor_valid)
}

fn is_sensor_valid(sensor: &SensorInfo) -> bool {
    let mount = sensor.mount.iter();
    let place = mount.flat_map(|mount| mount.position_m.iter().chain([&mount.yaw_rad]));
    let view = sensor.view.iter();
    let view = view.flat_map(|view| view.angles_rad.iter().chain(&view.range_m));
    all_finite(place.chain(view).chain(&sensor.rate_hz))
}

pub(super) fn is_status_valid(status: &Status) -> bool {
    status.sensors.len() <= MAX_SENSORS
        && all_finite(status.sensors.iter().map(|sensor| &sensor.rate_hz))
}

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> bool {
    numbers.into_iter().all(|number| number.is_finite())
}
