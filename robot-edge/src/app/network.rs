//! A run on the network: opens the link and feeds it with what mapping knows.

use std::io::{self, Write};
use std::sync::Arc;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{Event, Info, LayerInfo, Pose, Reason, Shores, Status};
use protocol::tile::BootId;

use super::data_clock::DataClock;
use crate::cli::NetworkOptions;
use crate::clock::{self, Monotonic};
use crate::config::Config;
use crate::drops::DropCounts;
use crate::exit::UsageError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::endpoints::{DEFAULT_CONTROL, bulk_endpoint, is_loopback};
use crate::link::sessions::Endpoints;
use crate::link::shared::Shared;
use crate::link::{LinkError, zenoh_config_file};
use crate::mapping::posed_scan::PosedScan;
use crate::pipeline::Pipeline;
use crate::robot_time::RobotTime;

/// Consoles that lag when the data has ended are waited for this long.
const FAREWELL: Duration = Duration::from_secs(10);
/// Time for the status that says so to arrive.
const LAST_WORDS: Duration = Duration::from_millis(1200);

/// How a run is on the network.
#[derive(Clone, Debug)]
pub(super) struct NetworkPlan {
    robot: RobotId,
    endpoints: Endpoints,
    /// Whether an endpoint was named: then mapping without it is not what was asked for.
    is_asked_for: bool,
    stay: bool,
}

impl NetworkPlan {
    /// What the command line and the configuration say; `None` for no network.
    ///
    /// # Errors
    /// Where an endpoint is none, or open to others without being said to be.
    pub(super) fn new(
        options: &NetworkOptions,
        robot: Option<&RobotId>,
        config: &Config,
    ) -> Result<Option<Self>, UsageError> {
        if options.no_network {
            return Ok(None);
        }
        let named = |flags: &[String], setting: &Option<String>| {
            if flags.is_empty() {
                setting.iter().cloned().collect()
            } else {
                flags.to_vec()
            }
        };
        let mut listen: Vec<String> = named(&options.listen, &config.link.listen);
        let connect: Vec<String> = named(&options.connect, &config.link.connect);
        for endpoint in listen.iter().chain(&connect) {
            bulk_endpoint(endpoint).map_err(|err| UsageError(err.to_string()))?;
        }
        if let Some(open) = listen.iter().find(|endpoint| !is_loopback(endpoint))
            && !options.insecure
        {
            return Err(UsageError(format!(
                "--listen {open}: whoever reaches this address could watch the robot, unencrypted. If that is \
                 meant, say --insecure; else listen on 127.0.0.1 and reach it through a tunnel"
            )));
        }
        let is_asked_for = !(listen.is_empty() && connect.is_empty());
        if !is_asked_for {
            listen.push(DEFAULT_CONTROL.to_owned());
        }
        Ok(Some(Self {
            robot: match robot {
                Some(robot) => robot.clone(),
                None => name_of(&config.vehicle.name),
            },
            endpoints: Endpoints {
                listen,
                connect,
                zenoh_config: zenoh_config_file(options.zenoh_config.clone()),
            },
            is_asked_for,
            stay: options.stay,
        }))
    }

    /// Whether the map is served on when the data has ended.
    pub(super) const fn stays(&self) -> bool {
        self.stay
    }
}

/// A vehicle's name as a robot's: every sign that a key cannot have becomes `_`.
fn name_of(vehicle: &str) -> RobotId {
    let plain = |sign: char| {
        if sign.is_ascii_alphanumeric() || sign == '-' {
            sign
        } else {
            '_'
        }
    };
    let name: String = vehicle.chars().map(plain).take(64).collect();
    name.parse().unwrap_or_else(|_empty| RobotId::default())
}

/// A run's link, and what is told over it.
pub(super) struct Network {
    link: EdgeLink,
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
        quiet: bool,
    ) -> anyhow::Result<Option<Self>> {
        let store = pipeline.publisher().shared_store();
        let shared = Arc::new(Shared::default());
        let settings = EdgeSettings {
            robot: plan.robot.clone(),
            boot,
            endpoints: plan.endpoints.clone(),
            budget_kbps: config.streaming.budget_kbps,
            info: info(config, source, pipeline),
        };
        match EdgeLink::open(settings, store, shared) {
            Ok(link) => {
                let network = Self {
                    link,
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

    /// Tells consoles where the vehicle is.
    pub(super) fn moved(&self, scan: &PosedScan) {
        let q = scan.odom_from_base.rotation.quaternion();
        self.link.shared().set_pose(
            scan.stamp,
            Pose {
                position_m: scan.odom_from_base.translation.vector.into(),
                quaternion_xyzw: [q.i, q.j, q.k, q.w].map(|part| part as f32),
                speed_mps: 0.0,
                turn_rate_radps: 0.0,
            },
        );
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
