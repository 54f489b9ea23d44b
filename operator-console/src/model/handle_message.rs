//! Handling of messages from the link. An invalid message is rejected and counted: none causes a panic or unbounded memory.

use measurement::time::Monotonic;
use protocol::keys::Topic;
use protocol::layer::LayerId;
use protocol::message::{
    ChangedTile, Changes, CollisionMonitorState, CommandCounters, DeviceStatus, Digests, Event,
    Info, LayerHead, Localization, MAX_DEVICES, MAX_PLAN_POINTS, MAX_SENSORS, MapHead, Plan, Pong,
    Pose, RecordingStatus, Scan, SensorInfo, SensorStatus, ShoresReply, SpeedLimits, Status,
    TeleopStatus, TilesReply, TrajectoryPart, VoxelsReply,
};
use protocol::tile::TileKey;
use protocol::wire::{self, Header, WireError};
use serde::de::DeserializeOwned;

use super::trajectory_sync::{GAP, TrailSync};
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
            Topic::Localization => {
                let (header, localization): (_, Localization) = decode(payload)?;
                self.of_this_boot(header)?;
                if !super::localization::is_valid(&localization) {
                    return Err(RejectReason::Malformed);
                }
                self.robot.localization.take(localization, header.boot, now);
                self.sensor_updates += 1;
            }
            Topic::Plan => {
                let (header, plan): (_, Plan) = decode(payload)?;
                self.of_this_boot(header)?;
                if plan.points_mm.len() > MAX_PLAN_POINTS {
                    return Err(RejectReason::Malformed);
                }
                self.robot.plan = plan;
                self.changes += 1;
            }
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
                    // Layers are wanted from now on.
                    self.view.last_sent = None;
                }
                if epoch.is_some_and(|epoch| self.shores.of_epoch(epoch)) {
                    self.changes += 1;
                }
                self.map.update_clock(header, now);
                self.quality.on_message(Stream::MapHead, now);
                self.robot.head_seq = seq;
            }
            Topic::Changes(layer) => {
                let (header, changes): (_, Changes) = decode(payload)?;
                for tile in changes.tiles {
                    let ChangedTile { tx, ty, band, .. } = tile;
                    let key = TileKey { layer, tx, ty };
                    let newest_ns = header.robot_time_ns;
                    let header = Header {
                        robot_time_ns: newest_ns.saturating_sub_unsigned(tile.older_ns),
                        ..header
                    };
                    if let Err(reason) = self.map.take_band(key, header, &band, None, now) {
                        self.reject_counts.add(reason, 1);
                    }
                }
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
        self.connection.steady_limit = self.quality.steady_limit();
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
        self.connection.steady_limit = self.quality.steady_limit();
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
            Topic::Overviews(layer) => {
                let (header, TilesReply { tx, ty, band, .. }) = decode(payload)?;
                let key = TileKey { layer, tx, ty };
                self.map.take_overview(key, header, &band, now)?;
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
        Topic::Changes(_)
            | Topic::Tiles(_)
            | Topic::Overviews(_)
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
    let clocks = || {
        status
            .devices
            .iter()
            .filter_map(|device| device.clock.as_ref())
    };
    status.sensors.len() <= MAX_SENSORS
        && status.devices.len() <= MAX_DEVICES
        && all_finite(status.sensors.iter().map(|sensor| &sensor.rate_hz))
        && all_finite(status.devices.iter().map(|device| &device.rate_hz))
        && all_finite(clocks().map(|clock| &clock.spread_s))
        && clocks().all(|clock| clock.offset_s.is_finite())
}

fn all_finite<'a>(numbers: impl IntoIterator<Item = &'a f32>) -> bool {
    numbers.into_iter().all(|number| number.is_finite())
}

/// Less than a pixel at the greatest zoom, metres, and at the end of a vehicle of 3 m, as a quaternion component: half of the angle,
/// radians.
const STEP: (f64, f32) = (2e-3, 1e-3);
/// Resolution of displayed speeds, m/s or rad/s.
const SPEED: f32 = 0.01;

fn differ(a: f32, b: f32, step: f32) -> bool {
    (a - b).abs() >= step
}

/// By a step in metres, or in a component of the quaternion.
pub(super) fn has_moved(before: &Pose, now: &Pose, (step_m, turn): (f64, f32)) -> bool {
    let mut positions = before.position_m.into_iter().zip(now.position_m);
    let mut turns = before.quaternion_xyzw.into_iter().zip(now.quaternion_xyzw);
    positions.any(|(a, b)| (a - b).abs() >= step_m) || turns.any(|(a, b)| differ(a, b, turn))
}

pub(super) fn pose_changed(before: &Pose, now: &Pose) -> bool {
    has_moved(before, now, STEP)
        || differ(before.speed_mps, now.speed_mps, SPEED)
        || differ(before.lateral_mps, now.lateral_mps, SPEED)
        || differ(before.turn_rate_radps, now.turn_rate_radps, SPEED)
}

/// Whether a status changes in more than counters, rates and ages.
pub(super) fn status_changed(before: &Status, now: &Status) -> bool {
    without_counters(before) != without_counters(now)
}

fn without_counters(status: &Status) -> Status {
    let sensor = |sensor: &SensorStatus| SensorStatus {
        messages: 0,
        rate_hz: 0.0,
        age_ms: None,
        dropped: 0,
        ..sensor.clone()
    };
    let device = |device: &DeviceStatus| DeviceStatus {
        rate_hz: 0.0,
        age_ms: None,
        lost: 0,
        clock: None,
        ..device.clone()
    };
    let recording = status.recording.as_ref();
    Status {
        has_ended: status.has_ended,
        consoles: status.consoles,
        info_revision: status.info_revision,
        sensors: status.sensors.iter().map(sensor).collect(),
        devices: status.devices.iter().map(device).collect(),
        recording: recording.map(|recording| RecordingStatus {
            duration_s: 0,
            bytes: 0,
            free_bytes: None,
            lost: 0,
            ..recording.clone()
        }),
        teleop: status.teleop.as_ref().map(teleop),
        ..Status::default()
    }
}

fn teleop(teleop: &TeleopStatus) -> TeleopStatus {
    let no_limits = SpeedLimits {
        forward_mps: 0.0,
        reverse_mps: 0.0,
        left_mps: 0.0,
        right_mps: 0.0,
        left_radps: 0.0,
        right_radps: 0.0,
    };
    TeleopStatus {
        age_ms: None,
        peak_age_ms: None,
        speed_allowed_mps: 0.0,
        ground_age_ms: [None; 4],
        battery_v: None,
        docking: None,
        collision_monitor: match teleop.collision_monitor {
            CollisionMonitorState::On(_) => CollisionMonitorState::On(no_limits),
            CollisionMonitorState::UnknownSpace(_) => {
                CollisionMonitorState::UnknownSpace(no_limits)
            }
            other => other,
        },
        counters: CommandCounters {
            accepted: 0,
            ..teleop.counters.clone()
        },
        ..teleop.clone()
    }
}

#[cfg(test)]
mod tests {
    use protocol::message::{AgeToken, RecordingState, SensorFault, TeleopState};

    use super::*;
    use crate::test_support::{idle_teleop_status, pose_at_rest};

    fn pose() -> Pose {
        Pose {
            position_m: [1.0, 2.0, 0.0],
            token: Some(AgeToken { n: 1, nonce: 2 }),
            ..pose_at_rest()
        }
    }

    fn monitor(limit: f32) -> CollisionMonitorState {
        CollisionMonitorState::On(SpeedLimits {
            forward_mps: limit,
            reverse_mps: limit,
            left_mps: 0.0,
            right_mps: 0.0,
            left_radps: limit,
            right_radps: limit,
        })
    }

    fn status() -> Status {
        Status {
            sensors: vec![SensorStatus {
                name: "laser".to_owned(),
                messages: 10,
                rate_hz: 9.9,
                age_ms: Some(40),
                dropped: 0,
                fault: None,
            }],
            recording: Some(RecordingStatus {
                state: RecordingState::Recording,
                file: "a.mcap".to_owned(),
                files: 1,
                duration_s: 5,
                bytes: 1000,
                free_bytes: Some(9000),
                lost: 0,
            }),
            teleop: Some(TeleopStatus {
                age_ms: Some(30),
                peak_age_ms: Some(50),
                collision_monitor: monitor(1.0),
                ..idle_teleop_status()
            }),
            ..Status::default()
        }
    }

    fn changed(change: impl Fn(&mut Status)) -> bool {
        let mut now = status();
        change(&mut now);
        assert_ne!(now, status(), "nothing was changed");
        status_changed(&status(), &now)
    }

    #[test]
    fn standing_vehicle_needs_no_frames() {
        let seen = |change: fn(&mut Pose)| {
            let mut now = pose();
            change(&mut now);
            pose_changed(&pose(), &now)
        };
        assert!(!seen(|now| now.token = None));
        assert!(!seen(|now| now.position_m[1] += 0.001));
        assert!(!seen(|now| now.quaternion_xyzw[0] = 0.0009));
        assert!(seen(|now| now.position_m[1] += 0.003));
        assert!(seen(|now| now.position_m[0] -= 0.003));
        assert!(seen(|now| now.quaternion_xyzw[2] = -0.002));
        assert!(seen(|now| now.speed_mps = 0.02));
        assert!(seen(|now| now.turn_rate_radps = -0.02));
    }

    #[test]
    fn figures_that_only_count_on_are_no_news() {
        assert!(!changed(|now| now.data_time_ns = 1));
        assert!(!changed(|now| now.scans_mapped = 7));
        assert!(!changed(|now| now.tiles = [3, 9000]));
        assert!(!changed(|now| {
            now.sensors[0].age_ms = Some(60);
            now.sensors[0].messages += 1;
        }));
        assert!(!changed(|now| now.recording.as_mut().unwrap().bytes += 1));
        assert!(!changed(|now| {
            let teleop = now.teleop.as_mut().unwrap();
            teleop.age_ms = None;
            teleop.counters.accepted += 50;
            teleop.collision_monitor = monitor(0.5);
        }));
    }

    #[test]
    fn status_changes_need_a_frame() {
        fn teleop(now: &mut Status) -> &mut TeleopStatus {
            now.teleop.as_mut().unwrap()
        }
        let changes: [fn(&mut Status); 9] = [
            |now| now.has_ended = true,
            |now| now.info_revision = 2,
            |now| now.sensors[0].fault = Some(SensorFault::Silent),
            |now| now.recording.as_mut().unwrap().state = RecordingState::Failed,
            |now| now.recording = None,
            |now| teleop(now).state = TeleopState::EStop,
            |now| teleop(now).collision_monitor = CollisionMonitorState::Stale,
            |now| teleop(now).applied.linear_mps = 0.2,
            |now| teleop(now).counters.involuntary_stops = 1,
        ];
        for (at, change) in changes.into_iter().enumerate() {
            assert!(changed(change), "change {at}");
        }
    }
}
