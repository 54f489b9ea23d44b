//! A run on the network: opens the link and feeds it with what mapping knows.

mod farewell;
mod herald;
mod sensors;

pub(super) use herald::Herald;

use std::io::{self, Write};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::layer::LayerId;
use protocol::message::Shores;
use protocol::tile::BootId;

use super::background::give_way;
use super::driving::DrivePlan;
use super::network_plan::NetworkPlan;
use super::people;
use super::told::info;
use crate::audit::AuditLog;
use crate::clock::Monotonic;
use crate::config::Config;
use crate::driving::operators::NewerList;
use crate::driving::speedometer::Speedometer;
use crate::driving::{Driving, ListWatch, MapLookout, Operators};
use crate::events::event;
use crate::export::voxels::{PublishedClasses, pack_voxels};
use crate::link::LinkError;
use crate::link::edge::{EdgeLink, EdgeSettings};
use crate::link::sessions::Endpoints;
use crate::link::shared::Shared;
use crate::localization::placer::PlacerSettings;
use crate::mapping::Mapper;
use crate::mapping::octree::Octree;
use crate::mapping::posed_scan::PosedScan;
use crate::new_file::NewFile;
use crate::pipeline::{Maps, Standstill};
use crate::robot_time::{RobotDuration, RobotTime};
use crate::sensor_watch::{SensorWatch, listed};
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
    lookout: Option<MapLookout>,
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
        maps: &Maps,
        (drive, log): (&DrivePlan, Option<NewFile>),
        quiet: bool,
    ) -> anyhow::Result<Option<(Self, Herald)>> {
        let store = maps.publisher().shared_store();
        let shared = Arc::new(Shared::default());
        let audit_log = plan
            .audit
            .as_deref()
            .map(|path| people::open_audit_log(path, &plan.robot, config, boot))
            .transpose()?;
        let newer_people = NewerList::default();
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
                let newer = vec![operators.newer(), newer_people.clone()];
                people::watch_list(credentials, list, newer, &shared, audit.clone())
            })
            .transpose()?;
        let who = (&plan.robot, boot);
        let of_log = Arc::clone(&shared);
        let tell = move |kind, message| {
            of_log.tell_when_watched(event(kind, message), Monotonic::now());
        };
        let (driving, lookouts) = drive
            .start(who, (operators, audit.clone()), config, (log, tell))?
            .unzip();
        let settings = EdgeSettings {
            robot: plan.robot.clone(),
            boot,
            endpoints: Endpoints {
                audit,
                ..plan.endpoints.clone()
            },
            newer_people,
            budget_kbps: config.streaming.budget_kbps,
            info: info(config, subject, maps),
            driving: driving.as_ref().map(Driving::handles),
        };
        match EdgeLink::open(settings, store, shared) {
            Ok(link) => {
                let board = driving.as_ref().map(|driving| driving.handles().1);
                let (lookout, map_lookout) = lookouts.flatten().unzip();
                let mut herald = Herald {
                    shared: Arc::clone(link.shared()),
                    board,
                    lookout,
                    on_jump: config.localization.on_jump,
                    speedometer: Speedometer::new(if config.teleop.is_boat {
                        SPEED_ON_WATER
                    } else {
                        SPEED_ON_LAND
                    }),
                    sensors: SensorWatch::new(listed(config, subject.placing)),
                    since: subject.is_live.then(Monotonic::now),
                    told_sensors: None,
                    moved: None,
                };
                let network = Self {
                    driving,
                    _list_watch: list_watch,
                    robot: plan.robot.clone(),
                    lookout: map_lookout,
                    link,
                    _audit_log: audit_log,
                    stay: plan.stay,
                };
                if maps.mapper().voxels().is_some() {
                    network.link.shared().offer_voxels();
                }
                herald.tell_sensors();
                network.no_shores_yet(maps);
                if !quiet {
                    let Endpoints {
                        listen, connect, ..
                    } = &plan.endpoints;
                    let places = [&listen[..], &connect[..]].concat().join(", ");
                    writeln!(io::stderr(), "network: robot {} at {places}", plan.robot)?;
                    people::say_how_open(&plan.endpoints, &mut io::stderr())?;
                }
                Ok(Some((network, herald)))
            }
            Err(err @ LinkError::Open { .. }) if !plan.is_asked_for => {
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
    pub(super) fn no_shores_yet(&self, maps: &Maps) {
        if let Some(cell_m) = maps.publisher().store().cell_m(LayerId::Shore) {
            let none_yet = Shores::gather(cell_m, None, Vec::new(), Vec::new());
            self.shores(RobotTime::from_nanos(0), Arc::new(none_yet));
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

    /// A scan is in the map, which was measured at `taken`, at the latest.
    pub(super) fn mapped(&mut self, scan: &PosedScan, mapper: &Mapper, taken: Monotonic) {
        if let Some(lookout) = &mut self.lookout {
            lookout.mapped(scan, mapper, taken);
        }
    }

    /// Tells consoles of the shores and docking sites that the data up to `stamp` makes.
    pub(super) fn shores(&self, stamp: RobotTime, shores: Arc<Shores>) {
        self.link.shared().set_shores(stamp, shores);
    }

    /// Makes the octree's files where a console has asked for them. Nothing is mapped behind that for now where it `is_still`.
    pub(super) fn serve_voxels(&self, maps: &Maps, is_still: bool) {
        let Some((voxels, stamp)) = maps.mapper().voxels().zip(maps.last_scan()) else {
            return;
        };
        if self.link.shared().take_voxels_wish(stamp, is_still) {
            self.pack_voxels(maps, stamp, voxels.octree().clone());
        }
    }

    /// The same of maps that stand still.
    pub(super) fn serve_voxels_of(&self, maps: &Maps, standstill: &Standstill) {
        let Some(stamp) = standstill
            .last_scan()
            .filter(|_| maps.mapper().voxels().is_some())
        else {
            return;
        };
        if self.link.shared().take_voxels_wish(stamp, true)
            && let Some(octree) = maps.octree_of(standstill)
        {
            self.pack_voxels(maps, stamp, octree);
        }
    }

    /// On a thread that gives way to all others: mapping waits only for a copy of the octree.
    fn pack_voxels(&self, maps: &Maps, stamp: RobotTime, octree: Octree) {
        let classes = PublishedClasses::of(&maps.publisher().store());
        let shared = self.link.shared();
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
    pub(super) fn tell_changes(&self, maps: &mut Maps) {
        let shared = self.link.shared();
        shared.tiles_changed(maps.take_changed_tiles());
        self.serve_voxels(maps, false);
    }

    /// Something happened that the next console should know where none is there yet.
    pub(super) fn tell_when_watched(&self, kind: &str, message: String) {
        let shared = self.link.shared();
        shared.tell_when_watched(event(kind, message), Monotonic::now());
    }

    /// Something happened that consoles should know.
    pub(super) fn tell(&self, kind: &str, message: &str) {
        self.link.shared().tell(event(kind, message.to_owned()));
    }
}
