//! A run on the network: opens the link and feeds it with what mapping knows.

mod sensors;
mod shutdown;
mod state_publisher;

pub(super) use state_publisher::StatePublisher;

use std::io::{self, Write};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::Shores;
use protocol::tile::BootId;

use super::driving::DrivePlan;
use super::network_plan::NetworkPlan;
use super::operator_access;
use super::status_message::build_info;
use super::thread_priority::lower_thread_priority;
use crate::audit::AuditLog;
use crate::clock;
use crate::config::Config;
use crate::driving::operators::PendingOperatorList;
use crate::driving::velocity_estimator::VelocityEstimator;
use crate::driving::{Driving, MonitorMapInput, OperatorListWatcher, Operators};
use crate::events::event;
use crate::export::voxels::{PublishedClasses, pack_voxels};
use crate::link::LinkError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::publish_state::PublishState;
use crate::link::sessions::Endpoints;
use crate::pipeline::{Maps, PausedSnapshot};
use crate::sensor_monitor::{SensorMonitor, descriptors};
use crate::streaming::trajectory::SharedTrajectory;
use localization::registration::RegistrationSettings;
use mapping::Mapper;
use mapping::octree::Octree;
use mapping::registered_scan::RegisteredScan;
use measurement::time::Monotonic;
use measurement::time::{RobotDuration, RobotTime};
use recording::new_file::NewFile;

/// Consoles that lag when the data has ended are waited for this long.
const CONSOLE_SYNC_TIMEOUT: Duration = Duration::from_secs(10);
/// Time for the status that says so to arrive.
const FINAL_STATUS_DELAY: Duration = Duration::from_millis(1200);

/// Speeds are measured over this: encoders of wheels are fine.
const SPEED_WINDOW_LAND: RobotDuration = RobotDuration::from_nanos(100_000_000);
/// Fixes scatter by centimetres.
const SPEED_WINDOW_WATER: RobotDuration = RobotDuration::from_nanos(500_000_000);

/// What a network tells of.
pub(super) struct RobotDescription<'a> {
    /// What is replayed or simulated; empty on a real vehicle.
    pub(super) source: &'a str,
    /// Measurements come when they come; else by the time of the data.
    pub(super) is_live: bool,
    /// How its sensors are placed.
    pub(super) localization: &'a RegistrationSettings,
    /// Operators may record.
    pub(super) can_record: bool,
}

/// A run's link, and what is told over it.
pub(super) struct Network {
    // Ends before the link: what is driven is told zero first.
    driving: Option<Driving>,
    _operator_list_watcher: Option<OperatorListWatcher>,
    robot: RobotId,
    monitor_input: Option<MonitorMapInput>,
    pub(super) link: EdgeLink,
    // Last: it writes down how the others end.
    _audit_log: Option<AuditLog>,
    keep_serving: bool,
}

impl Network {
    /// Opens the link. `None` where nobody asked for one and it cannot be opened: mapping goes on without.
    ///
    /// # Errors
    /// Where the link was asked for and cannot be opened.
    pub(super) fn open(
        plan: &NetworkPlan,
        config: &Config,
        description: &RobotDescription<'_>,
        boot: BootId,
        maps: &Maps,
        (drive, log): (&DrivePlan, Option<NewFile>),
        quiet: bool,
    ) -> anyhow::Result<Option<(Self, StatePublisher)>> {
        let store = maps.publisher().shared_store();
        let publish_state = Arc::new(PublishState::default());
        let audit_log = plan
            .audit
            .as_deref()
            .map(|path| operator_access::open_audit_log(path, &plan.robot, config, boot))
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
                operator_access::watch_operator_list(
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
                    velocity_estimator: VelocityEstimator::new(if config.teleop.is_boat {
                        SPEED_WINDOW_WATER
                    } else {
                        SPEED_WINDOW_LAND
                    }),
                    sensors: SensorMonitor::new(descriptors(config, description.localization)),
                    since: description.is_live.then(clock::now),
                    published_sensors: None,
                    last_pose_stamp: None,
                };
                let network = Self {
                    driving,
                    _operator_list_watcher: list_watch,
                    robot: plan.robot.clone(),
                    monitor_input: monitor_map_input,
                    link,
                    _audit_log: audit_log,
                    keep_serving: plan.keep_serving,
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
                    operator_access::print_security_notice(&plan.endpoints, &mut io::stderr())?;
                }
                Ok(Some((network, state_publisher)))
            }
            Err(err @ LinkError::Open { .. }) if !plan.is_requested => {
                if !quiet {
                    writeln!(
                        io::stderr(),
                        "network: none, nobody can watch: {err}. --no-network does without"
                    )?;
                }
                Ok(None)
            }
            Err(err) => Err(err.into()),
        }
    }

    /// Whether a loop drives.
    pub(super) const fn is_driven(&self) -> bool {
        self.driving.is_some()
    }

    /// What is driven is told zero, and nobody drives it any more.
    pub(super) fn end_driving(&mut self) {
        drop(self.driving.take());
    }

    /// The data is wound, and the maps with it: nothing is known of shores any more.
    pub(super) fn clear_shores(&self, maps: &Maps) {
        if let Some(cell_m) = maps.publisher().store().cell_m(LayerId::Shore) {
            let none_yet = Shores::gather(cell_m, None, Vec::new(), Vec::new());
            self.shores(RobotTime::from_nanos(0), Arc::new(none_yet));
        }
    }

    /// Where the vehicle was, as consoles are told.
    pub(super) fn trajectory(&self) -> SharedTrajectory {
        self.link.publish_state().trajectory().clone()
    }

    /// The robot's name on the network.
    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// A scan is in the map, which was measured at `measured_at`, at the latest.
    pub(super) fn mapped(
        &mut self,
        scan: &RegisteredScan,
        mapper: &Mapper,
        measured_at: Monotonic,
    ) {
        if let Some(monitor_input) = &mut self.monitor_input {
            monitor_input.update_map(scan, mapper, measured_at);
        }
    }

    /// Tells consoles of the shores and docking sites that the data up to `stamp` makes.
    pub(super) fn shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        self.link.publish_state().set_shores(stamp, shores);
    }

    /// Makes the octree's files where a console has asked for them. Nothing is mapped behind that for now where it `is_paused`.
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

    /// The same of maps that stand still.
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

    /// On a thread that gives way to all others: mapping waits only for a copy of the octree.
    fn pack_voxels(&self, maps: &Maps, stamp: RobotTime, octree: Octree) {
        let classes = PublishedClasses::of(&maps.publisher().store());
        let publish_state = self.link.publish_state();
        let of_thread = Arc::clone(publish_state);
        let begun = thread::Builder::new()
            .name("voxel-files".to_owned())
            .spawn(move || {
                lower_thread_priority();
                let made = pack_voxels(stamp, &octree, &classes)
                    .inspect_err(|why| tracing::warn!(%why, "the octree's files"));
                of_thread.put_voxels(made.ok(), clock::now());
            });
        if let Err(why) = begun {
            tracing::warn!(%why, "the octree's files");
            publish_state.put_voxels(None, clock::now());
        }
    }

    /// Tells consoles what changed.
    pub(super) fn publish_changes(&self, maps: &mut Maps) {
        let publish_state = self.link.publish_state();
        publish_state.tiles_changed(maps.take_changed_tiles());
        self.serve_octree_files(maps, false);
    }

    /// Something happened that the next console should know where none is there yet.
    pub(super) fn publish_or_queue_event(&self, kind: &str, message: String) {
        let publish_state = self.link.publish_state();
        publish_state.publish_or_queue_event(event(kind, message), clock::now());
    }

    /// Something happened that consoles should know.
    pub(super) fn publish_event(&self, kind: &str, message: &str) {
        self.link
            .publish_state()
            .publish_event(event(kind, message.to_owned()));
    }
}
