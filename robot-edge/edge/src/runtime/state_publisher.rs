//! Sends poses, scans, sensor health and status to consoles and the collision monitor, independently of mapping.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use drivers::status::{DeviceStatus, DeviceStatuses};
use protocol::message::{
    self, DeviceClock, DeviceState, DropCount, Info, LayerInfo, Localization, MAX_DEVICES,
    RecordingStatus, SensorFault, Status,
};

use super::map_correction::placed;
use super::mapping_stage::{MapStats, SharedMapFromOdom};
use super::maps::Maps;
use super::network::RobotDescription;
use super::source::DataClock;
use crate::config::Config;
use crate::driving::velocity_estimator::VelocityEstimator;
use crate::driving::{MapRequest, MonitorSensorInput, SharedDriveState};
use crate::events::event;
use crate::publishing::keel_depth::KeelDepth;
use crate::publishing::scan_downsampling::downsample_scan;
use crate::sensor_monitor::{FaultChange, SensorMonitor};
use crate::server::publish_state::PublishState;
use localization::OnJump;
use localization::registration::RegistrationCounts;
use localization::scan_localization::ScanLocalizationReport;
use localization::scan_matching::slam::{ClosureCounts, Confidence};
use mapping::registered_scan::{RegisteredScan, ScanKind, SensorId};
use measurement::Measurement;
use measurement::drops::DropCounts;
use measurement::pose::Pose;
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use nalgebra::Point2;
use network::clock;

/// The network output of the localization stage. It never waits for a map.
pub(super) struct StatePublisher {
    pub(super) publish_state: Arc<PublishState>,
    pub(super) drive_state: Option<Arc<SharedDriveState>>,
    pub(super) monitor_input: Option<MonitorSensorInput>,
    /// A jump that resets the maps also resets the ground plane of the collision monitor.
    pub(super) on_jump: OnJump,
    /// Consoles show poses and scans in the map.
    pub(super) map_from_odom: SharedMapFromOdom,
    pub(super) velocity_estimator: VelocityEstimator,
    pub(super) goes_sideways: bool,
    pub(super) sensors: SensorMonitor,
    /// Devices that are read without a middleware.
    pub(super) devices: Option<DeviceStatuses>,
    /// Of a boat.
    pub(super) keel_depth: Option<KeelDepth>,
    /// Start of the program in a live run; otherwise sensors are monitored by the time of the data.
    pub(super) since: Option<Monotonic>,
    pub(super) published_sensors: Option<u32>,
    pub(super) last_pose_stamp: Option<RobotTime>,
    /// Bumpers that touch something.
    pub(super) pressed: BTreeSet<SensorId>,
}

impl StatePublisher {
    /// The clock of the data was reset; `is_repeated`: the same data follows again.
    pub(super) fn reset_clock(&mut self, is_repeated: bool) {
        self.last_pose_stamp = None;
        self.clear_keel_depth();
        if is_repeated {
            self.sensors.on_replay_restart();
        }
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.reset_clock();
        }
    }

    /// The replay went to another time, `elapsed` after the first data.
    pub(super) fn seek(&mut self, elapsed: RobotDuration) {
        self.reset_clock(false);
        self.sensors.seek(since_data_start(elapsed));
    }

    /// Publishes a pose, unless a newer one was published.
    pub(super) fn publish_pose(&mut self, (stamp, pose): (RobotTime, Pose)) {
        if self.last_pose_stamp.is_some_and(|last| stamp <= last) {
            return;
        }
        self.last_pose_stamp = Some(stamp);
        let measured = self.velocity_estimator.update(stamp, &pose);
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.update_odometry(stamp, &pose, measured, clock::now());
        }
        let pose = self.map_from_odom.get() * pose;
        let q = pose.rotation.quaternion();
        self.publish_state.set_pose(
            stamp,
            message::Pose {
                position_m: pose.translation.vector.into(),
                quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|part| part as f32),
                speed_mps: measured.linear_mps as f32,
                // Else it is noise or leeway.
                lateral_mps: if self.goes_sideways {
                    measured.lateral_mps as f32
                } else {
                    0.0
                },
                turn_rate_radps: measured.angular_radps as f32,
                token: None,
            },
        );
    }

    /// Handles a jump before the next scan. Returns the earliest time, because a jump has no time of measurement.
    pub(super) fn on_pose_jump(&mut self) -> Monotonic {
        self.clear_keel_depth();
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.on_pose_jump();
            if self.on_jump == OnJump::Reset {
                monitor_input.reset_ground();
            }
        }
        Monotonic::default()
    }

    fn clear_keel_depth(&mut self) {
        if let Some(keel_depth) = &mut self.keel_depth {
            keel_depth.clear();
        }
    }

    /// Publishes a scan. Returns its latest possible time of measurement, on the clock of this machine.
    pub(super) fn publish_scan(&mut self, scan: &RegisteredScan) -> Monotonic {
        // If scans carry their poses, there are no others.
        self.publish_pose((scan.stamp, scan.odom_from_base));
        let now = clock::now();
        let measured_at = match &mut self.monitor_input {
            Some(monitor_input) => monitor_input.add_scan(scan, now),
            None => now,
        };
        let is_blocked = |monitor_input: &MonitorSensorInput| monitor_input.is_blocked(scan.sensor);
        let is_blocked = self.monitor_input.as_ref().is_some_and(is_blocked);
        self.sensors.on_registered_scan(scan, is_blocked);
        self.report_contact(scan);
        if let Some(keel_depth) = &mut self.keel_depth
            && self.sensors.is_sonar(scan.sensor)
        {
            keel_depth.add_scan(scan);
        }
        if self.publish_state.wants_scan()
            && let Some(name) = self.sensors.name(scan.sensor)
            && let Some(shown) = downsample_scan(name, &placed(scan, &self.map_from_odom.get()))
        {
            self.publish_state.set_scan(scan.sensor, scan.stamp, shown);
        }
        measured_at
    }

    /// Publishes an event where a bumper is newly pressed or released.
    fn report_contact(&mut self, scan: &RegisteredScan) {
        if !matches!(scan.kind, ScanKind::Contact { .. }) {
            return;
        }
        let is_pressed = !scan.beams.is_empty();
        let was_pressed = self.pressed.contains(&scan.sensor);
        if is_pressed == was_pressed {
            return;
        }
        let change = if is_pressed {
            self.pressed.insert(scan.sensor);
            "contact"
        } else {
            self.pressed.remove(&scan.sensor);
            "released"
        };
        let name = self.sensors.name(scan.sensor).unwrap_or_default();
        let message = format!("{name}: {change}");
        tracing::warn!(kind = "contact", message);
        self.publish_event("contact", &message);
    }

    pub(super) fn publish_status(
        &mut self,
        counts: RegistrationCounts,
        maps: &MapStats,
        (clock, lost): (&DataClock, u64),
        recording: Option<RecordingStatus>,
    ) {
        let now = match self.since {
            Some(since) => clock::elapsed(since),
            None => since_data_start(clock.elapsed()),
        };
        self.check_sensors(now);
        self.sensors.count(&counts);
        self.publish_state.set_status(Status {
            sensors: self.sensors.statuses(now),
            devices: self.devices.as_ref().map_or_else(Vec::new, device_statuses),
            recording,
            depth_under_keel_m: self
                .keel_depth
                .as_ref()
                .and_then(KeelDepth::depth_m)
                .map(|depth_m| depth_m as f32),
            ..build_status(maps, counts, clock, lost)
        });
    }

    /// Publishes how well the scans determine the pose, once a scan was matched.
    pub(super) fn publish_localization(
        &self,
        report: &ScanLocalizationReport,
        closures: &[[Point2<f64>; 2]],
    ) {
        let Some((_, pose)) = &report.newest else {
            return;
        };
        // Of the vehicle's axes, turned to those of the map.
        let map_from_base = (pose.map_from_local * pose.local_from_base).rotation;
        let turn = map_from_base.to_rotation_matrix();
        let of_position = pose.covariance.fixed_view::<2, 2>(0, 0);
        let covariance = turn * of_position * turn.transpose();
        let ClosureCounts { added, removed } = report.closures;
        self.publish_state.set_localization(Localization {
            confidence: match pose.confidence {
                Confidence::Full => message::PoseConfidence::Determined,
                Confidence::UncertainAlong(_) => message::PoseConfidence::UncertainAlong,
                Confidence::OdometryOnly => message::PoseConfidence::OdometryOnly,
                Confidence::Lost => message::PoseConfidence::Lost,
            },
            is_searching: report.is_searching,
            covariance_m2: [(0, 0), (0, 1), (1, 1)].map(|at| covariance[at] as f32),
            heading_sigma_rad: pose.covariance[(2, 2)].sqrt() as f32,
            inliers: pose.inliers as f32,
            residual_m: pose.residual_m as f32,
            closures: [added, removed].map(|count| u32::try_from(count).unwrap_or(u32::MAX)),
            closures_m: Some(
                closures
                    .iter()
                    .map(|[a, b]| [a.x, a.y, b.x, b.y].map(|metres| metres as f32))
                    .collect(),
            ),
        });
    }

    /// Whether an operator requested to start or stop recording since the last call.
    pub(super) fn take_recording_request(&self) -> Option<bool> {
        self.drive_state.as_ref()?.take_recording_request()
    }

    /// What an operator wanted of the map since the last call.
    pub(super) fn take_map_request(&self) -> Option<MapRequest> {
        self.drive_state.as_ref()?.take_map_request()
    }

    pub(super) fn set_recording(&self, is_running: bool) {
        if let Some(drive_state) = &self.drive_state {
            drive_state.set_recording(is_running);
        }
    }

    pub(super) fn publish_event(&self, kind: &str, message: &str) {
        self.publish_state
            .publish_event(event(kind, message.to_owned()));
    }

    #[cfg(test)]
    pub(super) fn published_pose(&self) -> Option<RobotTime> {
        self.publish_state.pose().map(|(stamp, _)| stamp)
    }

    /// The time on the clock of the sensor monitor.
    pub(super) fn monitor_time(&self, received_at: Monotonic, elapsed: RobotDuration) -> Duration {
        match self.since {
            Some(since) => received_at.since(since),
            None => since_data_start(elapsed),
        }
    }
}

impl StatePublisher {
    /// Processes a measurement that could have been received at `received_at` at the earliest, `elapsed` after the
    /// first data.
    pub(super) fn on_measurement(
        &mut self,
        measurement: &Measurement,
        received_at: Monotonic,
        elapsed: RobotDuration,
    ) {
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.record_received(measurement.stamp, received_at);
        }
        let at = self.monitor_time(received_at, elapsed);
        self.sensors.take(measurement, at);
        self.check_sensors(at);
    }

    pub(super) fn check_sensors(&mut self, now: Duration) {
        if !self.sensors.is_check_due(now) {
            return;
        }
        for change in self.sensors.check(now) {
            let (kind, message) = match change {
                FaultChange::Raised { fault, message, .. } => (fault_kind(fault), message),
                FaultChange::Cleared { message, .. } => ("sensor_recovered", message),
            };
            tracing::warn!(kind, message);
            self.publish_event(kind, &message);
        }
        self.publish_sensors();
    }

    /// Publishes the sensor descriptions if they changed.
    pub(super) fn publish_sensors(&mut self) {
        let (revision, infos) = self.sensors.infos();
        if self.published_sensors != Some(revision) {
            self.published_sensors = Some(revision);
            self.publish_state.set_sensors(revision, infos);
        }
    }
}

pub(super) fn since_data_start(elapsed: RobotDuration) -> Duration {
    Duration::from_nanos(u64::try_from(elapsed.as_nanos()).unwrap_or_default())
}

fn device_statuses(statuses: &DeviceStatuses) -> Vec<message::DeviceStatus> {
    let statuses = statuses.now().take(MAX_DEVICES);
    let status = |(name, status): (&str, DeviceStatus)| message::DeviceStatus {
        name: name.to_owned(),
        state: match status.state {
            drivers::status::State::Connecting => DeviceState::Connecting,
            drivers::status::State::Configuring => DeviceState::Configuring,
            drivers::status::State::Measuring => DeviceState::Measuring,
        },
        trouble: status
            .trouble
            .map_or_else(String::new, |trouble| trouble.to_string()),
        identity: status.identity.unwrap_or_default(),
        rate_hz: status.rate_hz as f32,
        age_ms: status
            .measured_at
            .map(|at| u32::try_from(clock::elapsed(at).as_millis()).unwrap_or(u32::MAX)),
        reconnects: u32::try_from(status.lost_connections).unwrap_or(u32::MAX),
        lost: status.losses.values().sum(),
        clock: status.clock.map(|clock| DeviceClock {
            offset_s: clock.offset_s,
            spread_s: clock.spread_s as f32,
            resets: u32::try_from(clock.resets).unwrap_or(u32::MAX),
        }),
    };
    statuses.map(status).collect()
}

const fn fault_kind(fault: SensorFault) -> &'static str {
    match fault {
        SensorFault::Silent => "sensor_silent",
        SensorFault::Clock => "sensor_clock",
        SensorFault::AllInvalid => "sensor_invalid",
        SensorFault::Slow => "sensor_slow",
        SensorFault::Blocked => "sensor_blocked",
    }
}

pub(super) fn build_info(config: &Config, description: &RobotDescription<'_>, maps: &Maps) -> Info {
    let vehicle = &config.vehicle;
    let teleop = &config.teleop;
    Info {
        vehicle: vehicle.name.clone(),
        source: description.source.to_owned(),
        footprint_m: [vehicle.length_m, vehicle.width_m].map(|metres| metres as f32),
        limits: [
            vehicle.max_speed_mps,
            if config.motors.modes.goes_sideways() {
                vehicle.max_speed_mps
            } else {
                0.0
            },
            vehicle.max_turn_rate_radps,
        ]
        .map(|limit| limit as f32),
        layers: maps
            .publisher()
            .store()
            .grids()
            .map(|grid| LayerInfo {
                layer: grid.layer,
                cell_m: grid.cell_m,
            })
            .collect(),
        revision: 0,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        is_boat: teleop.is_boat,
        stop_decel_mps2: teleop.stop_decel_mps2 as f32,
        stop_decel_radps2: teleop.stop_decel_radps2 as f32,
        max_command_age_ms: teleop.max_command_age_ms,
        can_record: description.can_record,
        // The network adds the sensors.
        sensors: Vec::new(),
        footprint_offset_m: vehicle.footprint_offset_m as f32,
    }
}

pub(super) fn build_status(
    maps: &MapStats,
    registration: RegistrationCounts,
    clock: &DataClock,
    lost: u64,
) -> Status {
    let mut dropped: DropCounts = registration.dropped_scans;
    dropped.merge(&maps.dropped_scans);
    dropped.merge(&registration.dropped_poses);
    dropped.merge(&registration.dropped_beams);
    dropped.merge(&maps.dropped_beams);
    let reasons = dropped
        .iter()
        .map(|(reason, count)| (reason.to_string(), count));
    let lost = (lost > 0).then(|| ("lost_by_source".to_owned(), lost));
    Status {
        data_time_ns: clock.elapsed().as_nanos(),
        scans_in: registration.scans_in,
        scans_mapped: maps.scans_mapped,
        drops: reasons
            .chain(lost)
            .map(|(name, count)| DropCount { name, count })
            .collect(),
        ..Status::default()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use clap::Parser as _;
    use nalgebra::{Point3, Translation3};

    use super::*;
    use crate::cli::{Cli, Command};
    use crate::driving::monitor_input;
    use crate::runtime::replay::{create_run, survey_recording};
    use localization::pose_buffer::PoseJump;
    use localization::registration::RegistrationOutput;
    use mapping::ground_plane::GroundConfig;
    use mapping::ground_plane::{GroundPlane, GroundTracker};
    use mapping::obstacle::ObstacleConfig;
    use mapping::registered_scan::{BeamOutcome, RegisteredBeam, ScanKind, SensorId};
    use mapping::vehicle::VehicleConfig;
    use teleop::TeleopConfig;
    use teleop::collision_monitor::{CollisionMonitorConfig, CollisionMonitorRules};

    /// Of a vehicle whose heights are mapped; nobody listens.
    fn state_publisher(on_jump: OnJump) -> StatePublisher {
        let (teleop, vehicle) = (TeleopConfig::default(), VehicleConfig::default());
        let (guard, obstacle) = (CollisionMonitorConfig::default(), ObstacleConfig::default());
        let rules = CollisionMonitorRules::new(&guard, &teleop, &vehicle, &obstacle).unwrap();
        let ground = GroundTracker::new(&GroundConfig::default(), vehicle.wheelbase_m());
        let (monitor_input, _, _) = monitor_input(rules, 1, Some(ground));
        StatePublisher {
            publish_state: Arc::new(PublishState::default()),
            drive_state: None,
            monitor_input: Some(monitor_input),
            on_jump,
            map_from_odom: SharedMapFromOdom::default(),
            velocity_estimator: VelocityEstimator::new(RobotDuration::from_millis(100)),
            goes_sideways: false,
            sensors: SensorMonitor::new(Vec::new()),
            devices: None,
            keel_depth: None,
            since: None,
            published_sensors: None,
            last_pose_stamp: None,
            pressed: BTreeSet::new(),
        }
    }

    fn at_height(z_m: f64) -> Pose {
        Pose::from_parts(Translation3::new(0.0, 0.0, z_m), nalgebra::one())
    }

    fn scan(millis: i64, odom_from_base: Pose) -> RegistrationOutput {
        RegistrationOutput::Scan(RegisteredScan {
            stamp: RobotTime::from_nanos(1_000_000 * millis),
            sensor: SensorId(0),
            beam_step_rad: 0.01,
            kind: ScanKind::Beams,
            own_body_hits: 0,
            odom_from_base,
            beams: Vec::new(),
        })
    }

    #[test]
    fn contact_and_release_are_one_event_each() {
        let mut publisher = state_publisher(OnJump::Keep);
        let mut events = Vec::new();
        for (millis, is_pressed) in (0..)
            .step_by(50)
            .zip([false, true, true, true, false, false])
        {
            let RegistrationOutput::Scan(mut contact) = scan(millis, at_height(0.0)) else {
                unreachable!("it is one");
            };
            contact.kind = ScanKind::Contact { width_m: 0.5 };
            contact.beams.extend(is_pressed.then_some(RegisteredBeam {
                origin_in_odom: Point3::origin(),
                end_in_odom: Point3::origin(),
                outcome: BeamOutcome::Hit,
                index: 0,
                range_m: 0.0,
            }));
            publisher.publish_scan(&contact);
            let published = publisher.publish_state.take_events().into_iter();
            events.extend(published.map(|event| (millis, event.kind, event.message)));
        }
        let expected = |millis, change: &str| (millis, "contact".to_owned(), format!(": {change}"));
        assert_eq!(events, [expected(50, "contact"), expected(200, "released")]);
    }

    /// The collision monitor's ground plane restarts with the maps: otherwise a pose jump would look like a step in the floor.
    #[test]
    fn a_jump_that_erases_the_maps_resets_the_monitors_ground() {
        let rooms = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../recordings/rooms.mcap");
        let line = ["robot-edge", "replay", rooms.to_str().unwrap()];
        let line = line.into_iter().chain(["--no-network", "--quiet"]);
        let Command::Replay(command) = Cli::try_parse_from(line).unwrap().command else {
            unreachable!("it says so");
        };
        let (survey, config, plan) = survey_recording(&command).unwrap();
        let (run, _source) = create_run(&command, true, &survey, &config, plan).unwrap();
        for (on_jump, ground_z_m) in [(OnJump::Keep, 0.0), (OnJump::Reset, 3.0)] {
            let localization = &mut run.start().unwrap().localization;
            localization.state_publisher = Some(state_publisher(on_jump));
            let jump = RegistrationOutput::Jump(PoseJump {
                stamp: RobotTime::from_nanos(100_000_000),
                distance_m: 3.0,
            });
            let behind = scan(100, at_height(3.0));
            localization.registered = vec![scan(0, at_height(0.0)), jump, behind];
            localization.finish(&mut |_step| Ok(())).unwrap();
            let monitor_input = localization
                .state_publisher
                .as_ref()
                .and_then(|h| h.monitor_input.as_ref());
            let ground = GroundPlane::under(&at_height(ground_z_m));
            assert_eq!(
                monitor_input.unwrap().ground_plane(),
                Some(ground),
                "{on_jump:?}"
            );
        }
    }
}
