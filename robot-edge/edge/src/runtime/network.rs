//! The network of a run: opens it and passes the state of the maps on.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use drivers::status::DeviceStatuses;
use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::Shores;
use protocol::tile::{BootId, TileKey};

use super::driving::DrivePlan;
use super::mapping_stage::SharedMapFromOdom;
use super::maps::{Maps, PausedSnapshot};
use super::network_plan::{self, NetworkPlan};
use super::state_publisher::{StatePublisher, build_info};
use crate::config::Config;
use crate::driving::operators::PendingOperatorList;
use crate::driving::velocity_estimator::VelocityEstimator;
use crate::driving::{Driving, MonitorMapInput, OperatorListWatcher, Operators};
use crate::events::event;
use crate::export::voxels::{PublishedClasses, pack_voxels_for_link};
use crate::publishing::keel_depth::KeelDepth;
use crate::publishing::trajectory::SharedTrajectory;
use crate::sensor_monitor::{SensorMonitor, descriptors};
use crate::server::edge::{EdgeLink, EdgeSettings};
use crate::server::publish_state::PublishState;
use crate::thread_priority::lower_thread_priority;
use localization::registration::RegistrationSettings;
use mapping::Mapper;
use mapping::octree::Octree;
use mapping::registered_scan::RegisteredScan;
use measurement::pose::Pose;
use measurement::time::{Monotonic, RobotDuration, RobotTime};
use network::LinkError;
use network::audit::AuditLog;
use network::clock;
use network::program_code::load_program;
use network::sessions::Endpoints;
use recording::new_file::NewFile;

/// Maximum wait for consoles at the end of the data.
const CONSOLE_SYNC_TIMEOUT: Duration = Duration::from_secs(10);
/// Longest download of the octree's files, at the whole budget.
const MAX_DOWNLOAD: Duration = Duration::from_mins(2);
/// Time for the final status to arrive.
const FINAL_STATUS_DELAY: Duration = Duration::from_millis(1200);

/// Window of speed measurements on land: wheel encoders are precise.
const SPEED_WINDOW_LAND: RobotDuration = RobotDuration::from_nanos(100_000_000);
/// On water: positions scatter by centimetres.
const SPEED_WINDOW_WATER: RobotDuration = RobotDuration::from_nanos(500_000_000);

pub(super) const fn velocity_estimator(config: &Config) -> VelocityEstimator {
    VelocityEstimator::new(if config.teleop.is_boat {
        SPEED_WINDOW_WATER
    } else {
        SPEED_WINDOW_LAND
    })
}

pub(super) struct RobotDescription<'a> {
    /// Recording or world; empty on a real vehicle.
    pub(super) source: &'a str,
    /// Live measurements; otherwise the time of the data applies.
    pub(super) is_live: bool,
    pub(super) localization: &'a RegistrationSettings,
    pub(super) can_record: bool,
    pub(super) devices: Option<&'a DeviceStatuses>,
}

pub(super) struct Network {
    // Dropped before the link: the motors stop first.
    driving: Option<Driving>,
    _operator_list_watcher: Option<OperatorListWatcher>,
    robot: RobotId,
    monitor_input: Option<MonitorMapInput>,
    pub(super) link: EdgeLink,
    // Dropped last: it records the end of the others.
    _audit_log: Option<AuditLog>,
    keep_serving: bool,
    budget_kbps: u32,
}

impl Network {
    /// Opens the network. `None` if it was not requested and cannot be opened: mapping goes on without it.
    pub(super) fn open(
        plan: &NetworkPlan,
        config: &Config,
        description: &RobotDescription<'_>,
        boot: BootId,
        maps: &Maps,
        (drive, log): (&DrivePlan, Option<NewFile>),
        quiet: bool,
    ) -> anyhow::Result<Option<(Self, StatePublisher)>> {
        load_program();
        let store = maps.publisher().shared_store();
        let publish_state = Arc::new(PublishState::default());
        let audit_log = plan
            .audit
            .as_deref()
            .map(|path| network_plan::open_audit_log(path, &plan.robot, config, boot))
            .transpose()?;
        let newer_operators = PendingOperatorList::default();
        let audit = audit_log.as_ref().map(AuditLog::audit);
        let operators = plan
            .operators
            .as_ref()
            .map_or_else(Operators::open, Operators::listed);
        let list_watch = plan
            .endpoints
            .credentials
            .as_ref()
            .zip(plan.operators.clone())
            .map(|(credentials, list)| {
                let newer = vec![operators.pending(), newer_operators.clone()];
                network_plan::watch_operator_list(
                    credentials,
                    list,
                    newer,
                    &publish_state,
                    audit.clone(),
                )
            })
            .transpose()?;
        let who = (&plan.robot, boot);
        let of_log = Arc::clone(&publish_state);
        let publish_event = move |kind, message| {
            of_log.publish_or_queue_event(event(kind, message), clock::now());
        };
        let (driving, monitor_inputs) = drive
            .start(
                who,
                (operators, audit.clone()),
                config,
                (log, publish_event),
            )?
            .unzip();
        let settings = EdgeSettings {
            robot: plan.robot.clone(),
            boot,
            endpoints: Endpoints {
                audit,
                ..plan.endpoints.clone()
            },
            newer_operators,
            budget_kbps: config.streaming.budget_kbps,
            info: build_info(config, description, maps),
            driving: driving.as_ref().map(Driving::handles),
        };
        match EdgeLink::open(settings, store, publish_state) {
            Ok(link) => {
                let drive_state = driving.as_ref().map(|driving| driving.handles().1);
                let (monitor_input, monitor_map_input) = monitor_inputs.flatten().unzip();
                let mut state_publisher = StatePublisher {
                    publish_state: Arc::clone(link.publish_state()),
                    drive_state,
                    monitor_input,
                    on_jump: config.localization.on_jump,
                    map_from_odom: SharedMapFromOdom::default(),
                    velocity_estimator: velocity_estimator(config),
                    goes_sideways: config.motors.modes.goes_sideways(),
                    keel_depth: config
                        .teleop
                        .is_boat
                        .then(|| KeelDepth::new(config.vehicle.clone())),
                    sensors: SensorMonitor::new(descriptors(config, description.localization)),
                    since: description.is_live.then(clock::now),
                    devices: description.devices.cloned(),
                    published_sensors: None,
                    last_pose_stamp: None,
                    pressed: BTreeSet::new(),
                };
                let network = Self {
                    driving,
                    _operator_list_watcher: list_watch,
                    robot: plan.robot.clone(),
                    monitor_input: monitor_map_input,
                    link,
                    _audit_log: audit_log,
                    keep_serving: plan.keep_serving,
                    budget_kbps: config.streaming.budget_kbps,
                };
                if maps.mapper().voxels().is_some() {
                    network.link.publish_state().enable_voxels();
                }
                state_publisher.publish_sensors();
                network.clear_shores(maps);
                if !quiet {
                    let Endpoints {
                        listen, connect, ..
                    } = &plan.endpoints;
                    let places = [&listen[..], &connect[..]].concat().join(", ");
                    writeln!(io::stderr(), "network: robot {} at {places}", plan.robot)?;
                    network_plan::print_security_notice(&plan.endpoints, &mut io::stderr())?;
                }
                Ok(Some((network, state_publisher)))
            }
            Err(err @ LinkError::Open { .. }) if !plan.is_requested => {
                if !quiet {
                    writeln!(
                        io::stderr(),
                        "warning: no network, so that nobody can watch: {err}. --no-network does without"
                    )?;
                }
                Ok(None)
            }
            Err(err) => Err(err.into()),
        }
    }

    pub(super) const fn is_driven(&self) -> bool {
        self.driving.is_some()
    }

    pub(super) fn end_driving(&mut self) {
        drop(self.driving.take());
    }

    /// Removes the shores when the replay goes to another time.
    pub(super) fn clear_shores(&self, maps: &Maps) {
        if let Some(cell_m) = maps.publisher().store().cell_m(LayerId::Shore) {
            let none_yet = Shores::gather(cell_m, None, Vec::new(), Vec::new());
            self.shores(RobotTime::from_nanos(0), Arc::new(none_yet));
        }
    }

    pub(super) fn trajectory(&self) -> SharedTrajectory {
        self.link.publish_state().trajectory().clone()
    }

    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// Gives the collision monitor the map with `scan`, which was measured at `measured_at` at the latest.
    pub(super) fn update_monitor(
        &mut self,
        scan: &RegisteredScan,
        map: (&Mapper, &Pose),
        measured_at: Monotonic,
    ) {
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.update_map(scan, map, measured_at);
        }
    }

    /// Publishes the shores and docking sites of the data up to `stamp`.
    pub(super) fn shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        self.link.publish_state().set_shores(stamp, shores);
    }

    /// Makes the requested octree files. `is_paused`: no newer data is expected.
    pub(super) fn serve_octree_files(&self, maps: &Maps, is_paused: bool) {
        let Some((voxels, stamp)) = maps.mapper().voxels().zip(maps.last_scan()) else {
            return;
        };
        if self
            .link
            .publish_state()
            .take_voxels_request(stamp, is_paused)
        {
            self.pack_voxels(maps, stamp, voxels.octree().clone());
        }
    }

    /// The same for a paused replay.
    pub(super) fn serve_paused_octree_files(&self, maps: &Maps, paused_snapshot: &PausedSnapshot) {
        let Some(stamp) = paused_snapshot
            .last_scan()
            .filter(|_| maps.mapper().voxels().is_some())
        else {
            return;
        };
        if self.link.publish_state().take_voxels_request(stamp, true)
            && let Some(octree) = maps.octree_of(paused_snapshot)
        {
            self.pack_voxels(maps, stamp, octree);
        }
    }

    /// Packs on a thread of low priority, so that mapping waits only for a copy of the octree: what the link carries in
    /// [`MAX_DOWNLOAD`].
    fn pack_voxels(&self, maps: &Maps, stamp: RobotTime, mut octree: Octree) {
        octree.forget_disk();
        let classes = PublishedClasses::of(&maps.publisher().store());
        let driving = self.driving.as_ref();
        let budget_kbps = driving.map_or(self.budget_kbps, |driving| {
            driving.handles().1.budget_kbps()
        });
        let limit_bytes = u64::from(budget_kbps) * 1000 / 8 * MAX_DOWNLOAD.as_secs();
        let octree = (octree, maps.mapper().vehicle_in_odom());
        let publish_state = self.link.publish_state();
        let of_thread = Arc::clone(publish_state);
        let begun = thread::Builder::new()
            .name("voxel-files".to_owned())
            .spawn(move || {
                lower_thread_priority();
                let made = pack_voxels_for_link(stamp, octree, &classes, limit_bytes)
                    .inspect_err(|why| tracing::warn!(%why, "the octree's files"));
                of_thread.put_voxels(made.ok(), clock::now());
            });
        if let Err(why) = begun {
            tracing::warn!(%why, "the octree's files");
            publish_state.put_voxels(None, clock::now());
        }
    }

    pub(super) fn publish_tiles(&self, changed: Vec<TileKey>) {
        self.link.publish_state().tiles_changed(changed);
    }

    /// Publishes an event to the connected consoles, or to the next one that connects.
    pub(super) fn publish_or_queue_event(&self, kind: &str, message: String) {
        let publish_state = self.link.publish_state();
        publish_state.publish_or_queue_event(event(kind, message), clock::now());
    }

    pub(super) fn publish_event(&self, kind: &str, message: &str) {
        self.link
            .publish_state()
            .publish_event(event(kind, message.to_owned()));
    }
}

impl Network {
    /// Waits at the end of the data until every console is synchronized, or forever with `--keep-serving`.
    pub(super) fn wait_for_consoles(
        &self,
        maps: &Maps,
        quiet: bool,
        is_interrupted: impl Fn() -> bool,
    ) {
        let publish_state = self.link.publish_state();
        let is_interrupted = || {
            self.serve_octree_files(maps, true);
            is_interrupted()
        };
        // Requested octree files contain all data when the end is published.
        self.serve_octree_files(maps, true);
        let revision = self.link.end();
        if self.keep_serving {
            if !quiet && !is_interrupted() {
                // A closed standard error is ignored.
                drop(writeln!(
                    io::stderr(),
                    "network: the data has ended, the map is served until Ctrl-C"
                ));
            }
            while clock::sleep_until(clock::now() + Duration::from_secs(1), is_interrupted) {}
            return;
        }
        let ended = clock::now();
        let is_over = || {
            let now = clock::now();
            let no_consoles = publish_state.views(now).is_empty();
            let all_informed = now.since(ended) >= FINAL_STATUS_DELAY
                && publish_state.all_consoles_have(revision, now);
            is_interrupted() || no_consoles || all_informed
        };
        clock::sleep_until(ended + CONSOLE_SYNC_TIMEOUT, is_over);
    }
}
