//! A run on the network: opens the link and feeds it with what mapping knows.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{self, Event, Info, LayerInfo, Reason, Shores, Status};
use protocol::tile::BootId;

use super::data_clock::DataClock;
use super::driving::DrivePlan;
use super::network_plan::NetworkPlan;
use super::people;
use crate::audit::AuditLog;
use crate::clock::{self, Monotonic};
use crate::config::Config;
use crate::driving::speedometer::Speedometer;
use crate::driving::{Driving, ListWatch, Lookout, Operators};
use crate::drops::DropCounts;
use crate::link::LinkError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::sessions::Endpoints;
use crate::link::shared::Shared;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::pipeline::Pipeline;
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};

/// Consoles that lag when the data has ended are waited for this long.
const FAREWELL: Duration = Duration::from_secs(10);
/// Time for the status that says so to arrive.
const LAST_WORDS: Duration = Duration::from_millis(1200);

/// Speeds are measured over this: encoders of wheels are fine.
const SPEED_ON_LAND: RobotDuration = RobotDuration::from_nanos(100_000_000);
/// Fixes scatter by centimetres.
const SPEED_ON_WATER: RobotDuration = RobotDuration::from_nanos(500_000_000);

/// A run's link, and what is told over it.
pub(super) struct Network {
    // Ends before the link: what is driven is told zero first.
    driving: Option<Driving>,
    _list_watch: Option<ListWatch>,
    robot: RobotId,
    lookout: Option<Lookout>,
    speedometer: Speedometer,
    /// Stamp of the newest pose that was told.
    moved: Option<RobotTime>,
    link: EdgeLink,
    // Last: it writes down how the others end.
    _audit_log: Option<AuditLog>,
    stay: bool,
}

impl Network {
    /// Opens the link. `None` where nobody asked for one and it cannot be opened: mapping goes on without.
    ///
    /// # Errors
    /// Where the link was asked for and cannot be opened.
    pub(super) fn open(
        plan: &NetworkPlan,
        config: &Config,
        source: &str,
        boot: BootId,
        pipeline: &Pipeline,
        drive: &DrivePlan,
        quiet: bool,
    ) -> anyhow::Result<Option<Self>> {
        let store = pipeline.publisher().shared_store();
        let shared = Arc::new(Shared::default());
        let audit_log = plan
            .audit
            .as_deref()
            .map(|path| people::open_audit_log(path, &plan.robot, config, boot))
            .transpose()?;
        let audit = audit_log.as_ref().map(AuditLog::audit);
        let operators = plan
            .people
            .as_ref()
            .map_or_else(Operators::open, Operators::listed);
        let list_watch = plan
            .endpoints
            .credentials
            .as_ref()
            .zip(plan.people.clone())
            .map(|(credentials, list)| {
                people::watch_list(credentials, list, operators.newer(), &shared, audit.clone())
            })
            .transpose()?;
        let who = (&plan.robot, boot);
        let (driving, lookout) = drive
            .start(who, (operators, audit.clone()), config)?
            .unzip();
        let settings = EdgeSettings {
            robot: plan.robot.clone(),
            boot,
            endpoints: Endpoints {
                audit,
                ..plan.endpoints.clone()
            },
            budget_kbps: config.streaming.budget_kbps,
            info: info(config, source, pipeline),
            driving: driving.as_ref().map(Driving::handles),
        };
        match EdgeLink::open(settings, store, shared) {
            Ok(link) => {
                let network = Self {
                    driving,
                    _list_watch: list_watch,
                    robot: plan.robot.clone(),
                    lookout: lookout.flatten(),
                    speedometer: Speedometer::new(if config.teleop.is_boat {
                        SPEED_ON_WATER
                    } else {
                        SPEED_ON_LAND
                    }),
                    moved: None,
                    link,
                    _audit_log: audit_log,
                    stay: plan.stay,
                };
                if let Some(cell_m) = pipeline.publisher().store().cell_m(LayerId::Shore) {
                    let none_yet = Shores::gather(cell_m, None, Vec::new(), Vec::new());
                    network.shores(RobotTime::from_nanos(0), Arc::new(none_yet));
                }
                if !quiet {
                    let Endpoints {
                        listen, connect, ..
                    } = &plan.endpoints;
                    let places = [&listen[..], &connect[..]].concat().join(", ");
                    writeln!(io::stderr(), "network: robot {} at {places}", plan.robot)?;
                    people::say_how_open(&plan.endpoints, &mut io::stderr())?;
                }
                Ok(Some(network))
            }
            Err(err @ LinkError::Open { .. }) if !plan.is_asked_for => {
                if !quiet {
                    writeln!(
                        io::stderr(),
                        "network: none, nobody can watch: {err}. --listen names another endpoint, --no-network \
                         does without"
                    )?;
                }
                Ok(None)
            }
            Err(err) => Err(err.into()),
        }
    }

    /// Something stamped `stamp` came.
    pub(super) fn came(&mut self, stamp: RobotTime, came: Monotonic) {
        if let Some(lookout) = &mut self.lookout {
            lookout.came(stamp, came);
        }
    }

    /// The clock of the data starts anew.
    pub(super) fn reset_clock(&mut self) {
        self.moved = None;
        if let Some(lookout) = &mut self.lookout {
            lookout.reset_clock();
        }
    }

    /// Tells consoles and the guard where the vehicle is, unless it is older than what they know.
    pub(super) fn moved(&mut self, (stamp, pose): (RobotTime, Pose)) {
        if self.moved.is_some_and(|last| stamp <= last) {
            return;
        }
        self.moved = Some(stamp);
        let measured = self.speedometer.see(stamp, &pose);
        if let Some(lookout) = &mut self.lookout {
            lookout.moved(stamp, &pose, measured, Monotonic::now());
        }
        let q = pose.rotation.quaternion();
        self.link.shared().set_pose(
            stamp,
            message::Pose {
                position_m: pose.translation.vector.into(),
                quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|part| part as f32),
                speed_mps: measured.linear_mps as f32,
                turn_rate_radps: measured.angular_radps as f32,
                token: None,
            },
        );
    }

    /// Tells the guard what a scan sees.
    pub(super) fn placed(&mut self, scan: &PosedScan, mapper: &Mapper) {
        // Where scans bring their poses, these are all there are.
        self.moved((scan.stamp, scan.odom_from_base));
        if let Some(lookout) = &mut self.lookout {
            lookout.see(scan, mapper, Monotonic::now());
        }
    }

    /// Whether an operator wants a recording to run, since the last call.
    pub(super) fn take_recording_wish(&self) -> Option<bool> {
        let (_, board) = self.driving.as_ref()?.handles();
        board.take_recording_wish()
    }

    /// Tells consoles whether a recording runs.
    pub(super) fn show_recording(&self, is_running: bool) {
        if let Some(driving) = &self.driving {
            driving.handles().1.show_recording(is_running);
        }
    }

    /// The robot's name on the network.
    pub(super) const fn robot(&self) -> &RobotId {
        &self.robot
    }

    /// A scan is in the map.
    pub(super) fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper) {
        if let Some(lookout) = &mut self.lookout {
            lookout.mapped(scan, mapper, Monotonic::now());
        }
    }

    /// Tells consoles of the shores and docking sites that the data up to `stamp` makes.
    pub(super) fn shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        self.link.shared().set_shores(stamp, shores);
    }

    /// Tells consoles what changed.
    pub(super) fn update(&self, pipeline: &mut Pipeline, clock: &DataClock, lost: u64) {
        let shared = self.link.shared();
        shared.tiles_changed(pipeline.take_changed_tiles());
        shared.set_status(status(pipeline, clock, lost));
    }

    /// Something happened that consoles should know.
    pub(super) fn tell(&self, kind: &str, message: &str) {
        self.link.shared().tell(Event {
            kind: kind.to_owned(),
            message: message.to_owned(),
        });
    }

    /// The data has ended: waits until every console has all of it, or for good where that was asked for.
    pub(super) fn take_leave(&self, revision: u64, quiet: bool, is_interrupted: impl Fn() -> bool) {
        let shared = self.link.shared();
        shared.end();
        if self.stay {
            if !quiet {
                // Nothing is lost where standard error is closed.
                drop(writeln!(
                    io::stderr(),
                    "network: the data has ended, the map is served until Ctrl-C"
                ));
            }
            while clock::sleep_until(Monotonic::now() + Duration::from_secs(1), &is_interrupted) {}
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

fn info(config: &Config, source: &str, pipeline: &Pipeline) -> Info {
    let vehicle = &config.vehicle;
    Info {
        vehicle: vehicle.name.clone(),
        source: source.to_owned(),
        footprint_m: [vehicle.length_m, vehicle.width_m].map(|metres| metres as f32),
        limits: [vehicle.max_speed_mps, vehicle.max_turn_rate_radps].map(|limit| limit as f32),
        layers: pipeline
            .publisher()
            .store()
            .grids()
            .map(|grid| LayerInfo {
                layer: grid.layer,
                cell_m: grid.cell_m,
            })
            .collect(),
    }
}

fn status(pipeline: &Pipeline, clock: &DataClock, lost: u64) -> Status {
    let placer = pipeline.placer().counts();
    let report = pipeline.report();
    let mut dropped: DropCounts = placer.dropped_scans;
    dropped.merge(&placer.dropped_poses);
    dropped.merge(&placer.dropped_beams);
    dropped.merge(&report.dropped_beams);
    let reasons = dropped
        .iter()
        .map(|(reason, count)| (reason.to_string(), count));
    let lost = (lost > 0).then(|| ("lost_by_source".to_owned(), lost));
    Status {
        data_time_ns: clock.elapsed().as_nanos(),
        scans_in: placer.scans_in,
        scans_mapped: report.scans_mapped,
        drops: reasons
            .chain(lost)
            .map(|(name, count)| Reason { name, count })
            .collect(),
        ..Status::default()
    }
}

/// The newest revision of any layer.
pub(super) fn head_revision(pipeline: &Pipeline) -> u64 {
    let store = pipeline.publisher().store();
    LayerId::ALL
        .into_iter()
        .map(|layer| store.head_revision(layer))
        .max()
        .unwrap_or(0)
}
