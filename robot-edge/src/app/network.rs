//! A run on the network: opens the link and feeds it with what mapping knows.

mod farewell;
mod sensors;

use std::io::{self, Write};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::{self, RecordingStatus, Shores, Status};
use protocol::tile::BootId;

use super::background::give_way;
use super::data_clock::DataClock;
use super::driving::DrivePlan;
use super::network_plan::NetworkPlan;
use super::people;
use super::told::{info, status};
use crate::audit::AuditLog;
use crate::clock::Monotonic;
use crate::config::Config;
use crate::driving::speedometer::Speedometer;
use crate::driving::{Driving, ListWatch, Lookout, Operators};
use crate::events::event;
use crate::export::voxels::{PublishedClasses, pack_voxels};
use crate::link::LinkError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::sessions::Endpoints;
use crate::link::shared::Shared;
use crate::localization::placer::PlacerSettings;
use crate::mapping::Mapper;
use crate::mapping::posed_scan::PosedScan;
use crate::pipeline::Pipeline;
use crate::pose::Pose;
use crate::robot_time::{RobotDuration, RobotTime};
use crate::sensor_watch::{SensorWatch, listed};
use crate::streaming::last_scan::last_scan;
use crate::streaming::trajectory::SharedTrajectory;

/// Consoles that lag when the data has ended are waited for this long.
const FAREWELL: Duration = Duration::from_secs(10);
/// Time for the status that says so to arrive.
const LAST_WORDS: Duration = Duration::from_millis(1200);

/// Speeds are measured over this: encoders of wheels are fine.
const SPEED_ON_LAND: RobotDuration = RobotDuration::from_nanos(100_000_000);
/// Fixes scatter by centimetres.
const SPEED_ON_WATER: RobotDuration = RobotDuration::from_nanos(500_000_000);

/// What a network tells of.
pub(super) struct Subject<'a> {
    /// What is replayed or simulated; empty on a real vehicle.
    pub(super) source: &'a str,
    /// Measurements come when they come; else by the time of the data.
    pub(super) is_live: bool,
    /// How its sensors are placed.
    pub(super) placing: &'a PlacerSettings,
    /// Operators may record.
    pub(super) can_record: bool,
}

/// A run's link, and what is told over it.
pub(super) struct Network {
    // Ends before the link: what is driven is told zero first.
    driving: Option<Driving>,
    _list_watch: Option<ListWatch>,
    robot: RobotId,
    lookout: Option<Lookout>,
    speedometer: Speedometer,
    sensors: SensorWatch,
    /// What the sensors are watched by: since when the program lives, or nothing for the time of the data.
    since: Option<Monotonic>,
    told_sensors: Option<u32>,
    /// Stamp of the newest pose that was told.
    moved: Option<RobotTime>,
    pub(super) link: EdgeLink,
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
        subject: &Subject<'_>,
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
            info: info(config, subject, pipeline),
            driving: driving.as_ref().map(Driving::handles),
        };
        match EdgeLink::open(settings, store, shared) {
            Ok(link) => {
                let mut network = Self {
                    driving,
                    _list_watch: list_watch,
                    robot: plan.robot.clone(),
                    lookout: lookout.flatten(),
                    speedometer: Speedometer::new(if config.teleop.is_boat {
                        SPEED_ON_WATER
                    } else {
                        SPEED_ON_LAND
                    }),
                    sensors: SensorWatch::new(listed(config, subject.placing)),
                    since: subject.is_live.then(Monotonic::now),
                    told_sensors: None,
                    moved: None,
                    link,
                    _audit_log: audit_log,
                    stay: plan.stay,
                };
                if pipeline.mapper().voxels().is_some() {
                    network.link.shared().offer_voxels();
                }
                network.tell_sensors();
                network.no_shores_yet(pipeline);
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

    /// The clock of the data starts anew; `is_repeated` where the same data comes again.
    pub(super) fn reset_clock(&mut self, is_repeated: bool) {
        self.moved = None;
        if is_repeated {
            self.sensors.begin_again();
        }
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

    /// The data is wound, as the maps are: `elapsed` of its time has passed there.
    pub(super) fn wind(&mut self, pipeline: &Pipeline, elapsed: RobotDuration) {
        self.reset_clock(false);
        self.sensors.wind(sensors::of_data(elapsed));
        self.no_shores_yet(pipeline);
    }

    fn no_shores_yet(&self, pipeline: &Pipeline) {
        if let Some(cell_m) = pipeline.publisher().store().cell_m(LayerId::Shore) {
            let none_yet = Shores::gather(cell_m, None, Vec::new(), Vec::new());
            self.shores(RobotTime::from_nanos(0), Arc::new(none_yet));
        }
    }

    /// Tells the guard what a scan sees.
    pub(super) fn placed(&mut self, scan: &PosedScan, mapper: &Mapper) {
        // Where scans bring their poses, these are all there are.
        self.moved((scan.stamp, scan.odom_from_base));
        if let Some(lookout) = &mut self.lookout {
            lookout.see(scan, mapper, Monotonic::now());
        }
        self.sensors.placed(scan);
        let shared = self.link.shared();
        if shared.wants_scan()
            && let Some(name) = self.sensors.name(scan.sensor)
            && let Some(shown) = last_scan(name, scan)
        {
            shared.set_scan(scan.sensor, scan.stamp, shown);
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

    /// Where the vehicle was, as consoles are told.
    pub(super) fn trajectory(&self) -> SharedTrajectory {
        self.link.shared().trajectory().clone()
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

    /// Makes the octree's files where a console has asked for them, on a thread that gives way to all others: mapping waits
    /// only for a copy of the octree.
    /// Nothing is mapped behind that for now where it `is_still`.
    pub(super) fn serve_voxels(&self, pipeline: &Pipeline, is_still: bool) {
        let Some((voxels, stamp)) = pipeline.mapper().voxels().zip(pipeline.last_scan()) else {
            return;
        };
        let shared = self.link.shared();
        if !shared.take_voxels_wish(stamp, is_still) {
            return;
        }
        let octree = voxels.octree().clone();
        let classes = PublishedClasses::of(&pipeline.publisher().store());
        let of_thread = Arc::clone(shared);
        let begun = thread::Builder::new()
            .name("voxel-files".to_owned())
            .spawn(move || {
                give_way();
                let made = pack_voxels(stamp, &octree, &classes)
                    .inspect_err(|why| tracing::warn!(%why, "the octree's files"));
                of_thread.put_voxels(made.ok(), Monotonic::now());
            });
        if let Err(why) = begun {
            tracing::warn!(%why, "the octree's files");
            shared.put_voxels(None, Monotonic::now());
        }
    }

    /// Tells consoles what changed.
    pub(super) fn update(
        &mut self,
        pipeline: &mut Pipeline,
        clock: &DataClock,
        lost: u64,
        recording: Option<RecordingStatus>,
    ) {
        let now = match self.since {
            Some(since) => since.elapsed(),
            None => sensors::of_data(clock.elapsed()),
        };
        self.look_at_sensors(now);
        let counts = pipeline.placer().counts();
        self.sensors.count(&counts);
        let shared = self.link.shared();
        shared.tiles_changed(pipeline.take_changed_tiles());
        shared.set_status(Status {
            sensors: self.sensors.statuses(now),
            recording,
            ..status(pipeline, counts, clock, lost)
        });
        self.serve_voxels(pipeline, false);
    }

    /// Something happened that consoles should know.
    pub(super) fn tell(&self, kind: &str, message: &str) {
        self.link.shared().tell(event(kind, message.to_owned()));
    }
}
