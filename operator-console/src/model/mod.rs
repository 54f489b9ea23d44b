//! One robot as this console knows it: messages in, questions out, everything else to be read.
//!
//! The model owns no thread, socket or clock: whoever holds it feeds it what the link brings, asks it what to
//! send, and draws or exports what it holds. The present is always a parameter.

mod connection;
mod incoming;
mod layer_sync;
mod link_quality;
mod map_questions;
mod map_sync;
mod refusals;
mod sending;
mod shores_sync;
mod tile_intake;
mod vehicle;

use std::collections::{BTreeSet, VecDeque};
use std::io;
use std::time::Duration;

use protocol::keys::{RobotId, Topic};
use protocol::layer::LayerId;
use protocol::message::{
    Digests, Event, Info, MapHead, Pong, Pose, Shores, ShoresNews, Status, TileBand, TilesReply,
};
use protocol::tile::BootId;
use protocol::wire::{self, Header, WireError};
use robot_edge::clock::Monotonic;
use serde::de::DeserializeOwned;

pub use connection::{Connection, LinkState, SILENT_AFTER};
pub use incoming::{Incoming, Outgoing, RequestId};
pub use link_quality::{LinkQuality, LinkSample, Stream};
pub use map_sync::{LayerStep, MapSync};
pub use refusals::{Refusal, Refusals};
pub use vehicle::Vehicle;

use shores_sync::ShoresSync;

const MAX_EVENTS: usize = 200;
/// Heads come every second: without one for so long, nobody knows what the robot's map is now.
const HEAD_LIFETIME: Duration = Duration::from_millis(2500);

/// What a console is and wants.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelSettings {
    /// The robot.
    pub robot: RobotId,
    /// This run of the console: random.
    pub session: BootId,
    /// Most memory for tiles, megabytes (10⁶ bytes).
    pub store_mb: u32,
    /// The layers that are wanted.
    pub layers: BTreeSet<LayerId>,
}

/// One robot. See the [module](self).
pub struct ConsoleModel {
    settings: ModelSettings,
    map: MapSync,
    vehicle: Vehicle,
    shores: ShoresSync,
    connection: Connection,
    quality: LinkQuality,
    refusals: Refusals,
    info: Option<(Info, BootId)>,
    status: Option<(Status, Monotonic)>,
    /// The number of the message that first said that the robot's data has ended, and of the newest head.
    ended_seq: Option<u64>,
    head_seq: u64,
    events: VecDeque<(Event, Monotonic)>,
    rectangle_m: [f32; 4],
    asked_info: Option<(RequestId, Monotonic)>,
    told_view: Option<Monotonic>,
    requests: u64,
    seq: u64,
    /// Counts changes that somebody may want to draw.
    changes: u64,
}

impl ConsoleModel {
    /// A robot of which nothing is known.
    ///
    /// # Errors
    /// Where zstd cannot be set up.
    pub fn new(settings: ModelSettings) -> io::Result<Self> {
        let mut map = MapSync::new(settings.store_mb)?;
        map.set_wanted(settings.layers.clone(), [0.0; 2]);
        Ok(Self {
            settings,
            map,
            vehicle: Vehicle::default(),
            shores: ShoresSync::default(),
            connection: Connection::default(),
            quality: LinkQuality::default(),
            refusals: Refusals::default(),
            info: None,
            status: None,
            ended_seq: None,
            head_seq: 0,
            events: VecDeque::new(),
            rectangle_m: [0.0; 4],
            asked_info: None,
            told_view: None,
            requests: 0,
            seq: 0,
            changes: 0,
        })
    }

    /// Which robot.
    pub const fn robot(&self) -> &RobotId {
        &self.settings.robot
    }

    /// The map.
    pub const fn map(&self) -> &MapSync {
        &self.map
    }

    /// Whether the map equals what the robot announced, and that lately.
    pub fn is_in_step(&self, now: Monotonic) -> bool {
        let head_at = self.map.head_at();
        head_at.is_some_and(|at| now.since(at) <= HEAD_LIFETIME) && self.holds_what_was_announced()
    }

    /// Whether the map equals what the robot announced last, however long ago, and the shores are known, where there
    /// are any.
    pub fn holds_what_was_announced(&self) -> bool {
        let knows_shores = !self.has_shores() || self.shores.is_told(self.ended_seq);
        self.map.is_in_step() && knows_shores
    }

    /// Whether the robot tells of shores.
    pub fn has_shores(&self) -> bool {
        self.info().is_some_and(|info| {
            info.layers
                .iter()
                .any(|layer| layer.layer == LayerId::Shore)
        })
    }

    /// Shores and docking sites, where the robot has told of them.
    pub const fn shores(&self) -> Option<&Shores> {
        self.shores.shores()
    }

    /// The tiles that changed since the last call.
    pub fn take_changed_tiles(&mut self) -> BTreeSet<protocol::tile::TileKey> {
        self.map.take_changed()
    }

    /// Where it is.
    pub const fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// How the link does.
    pub const fn connection(&self) -> &Connection {
        &self.connection
    }

    /// How well it carries each stream.
    pub const fn link_quality(&self) -> &LinkQuality {
        &self.quality
    }

    /// What was not taken.
    pub const fn refusals(&self) -> &Refusals {
        &self.refusals
    }

    /// Who the robot is, once it has said so.
    pub fn info(&self) -> Option<&Info> {
        self.info.as_ref().map(|(info, _)| info)
    }

    /// How the robot is doing, and when it said so.
    pub const fn status(&self) -> Option<&(Status, Monotonic)> {
        self.status.as_ref()
    }

    /// What happened, oldest first, and when it was heard.
    pub const fn events(&self) -> &VecDeque<(Event, Monotonic)> {
        &self.events
    }

    /// Whether the robot's data has ended and its last announcement is known, so that nothing new will come.
    pub fn has_ended(&self) -> bool {
        self.ended_seq.is_some_and(|ended| self.head_seq > ended)
    }

    /// Rises with every change that can be seen: who draws need not draw again while it stands still.
    pub const fn changes(&self) -> u64 {
        self.changes
    }

    /// What is on the screen: lowest and greatest x and y in `odom`, metres, and the layers that are wanted.
    pub fn look_at(&mut self, rectangle_m: [f32; 4], layers: BTreeSet<LayerId>) {
        if rectangle_m.iter().all(|edge| edge.is_finite()) {
            let [low_x, low_y, high_x, high_y] = rectangle_m.map(f64::from);
            self.rectangle_m = rectangle_m;
            self.map.set_wanted(
                layers.clone(),
                [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)],
            );
            self.settings.layers = layers;
        }
    }

    /// Takes what the link brought. Whatever it is, nothing panics and nothing grows without limit.
    pub fn apply(&mut self, incoming: Incoming, now: Monotonic) {
        let taken = match incoming {
            Incoming::Sample { key, payload } => {
                self.connection.arrived(payload.len(), now);
                self.take(&key, &payload, None, now)
            }
            Incoming::Reply {
                request,
                key,
                payload,
            } => {
                self.connection.arrived(payload.len(), now);
                self.take(&key, &payload, Some(request), now)
            }
            Incoming::Ended { request } => {
                if !self.shores.ended(request, now) {
                    self.map.ended(request, now);
                }
                Ok(())
            }
            Incoming::Lost { overrun, oversized } => {
                self.refusals.add_many(Refusal::Overrun, overrun);
                self.refusals.add_many(Refusal::Oversized, oversized);
                Ok(())
            }
            Incoming::Presence(is_present) => {
                self.connection.set_present(is_present);
                self.changes += 1;
                Ok(())
            }
        };
        match taken {
            Ok(()) => {}
            Err(why) => {
                tracing::debug!(why = why.name(), "a message was not taken");
                self.refusals.add(why);
            }
        }
    }

    fn take(
        &mut self,
        key: &str,
        payload: &[u8],
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), Refusal> {
        let (robot, topic) = Topic::parse(key).ok_or(Refusal::Key)?;
        if robot != self.settings.robot {
            return Err(Refusal::Key);
        }
        match request {
            None => self.take_pushed(topic, payload, now)?,
            Some(request) => self.take_reply(topic, payload, request, now)?,
        }
        self.connection.heard(now);
        Ok(())
    }

    fn take_pushed(&mut self, topic: Topic, payload: &[u8], now: Monotonic) -> Result<(), Refusal> {
        match topic {
            Topic::Pose => {
                let (header, pose): (_, Pose) = decode(payload)?;
                let numbers = pose
                    .position_m
                    .into_iter()
                    .chain(pose.quaternion_xyzw.map(f64::from));
                if !numbers.into_iter().all(f64::is_finite) {
                    return Err(Refusal::Malformed);
                }
                self.of_this_boot(header)?;
                self.quality.pose(now);
                self.changes += u64::from(self.vehicle.take(pose, header.robot_time_ns, now));
            }
            Topic::Status => {
                let (header, status): (_, Status) = decode(payload)?;
                self.of_this_boot(header)?;
                self.quality.heard(Stream::Status, now);
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
                self.changes += u64::from(
                    self.status
                        .as_ref()
                        .is_none_or(|(before, _)| *before != status),
                );
                self.status = Some((status, now));
            }
            Topic::Event => {
                let (_, event) = decode(payload)?;
                if self.events.len() >= MAX_EVENTS {
                    self.events.pop_front();
                }
                self.events.push_back((event, now));
                self.changes += 1;
            }
            Topic::MapHead => {
                let (header, head): (_, MapHead) = decode(payload)?;
                let seq = header.seq;
                if self.map.take_head(head, header.boot, now)? {
                    self.vehicle.forget();
                    self.shores.forget();
                    self.ended_seq = None;
                    if self
                        .info
                        .as_ref()
                        .is_some_and(|(_, boot)| *boot != header.boot)
                    {
                        self.info = None;
                    }
                }
                self.quality.heard(Stream::MapHead, now);
                self.head_seq = seq;
            }
            Topic::Tile(tile) => {
                let (header, band): (_, TileBand) = decode(payload)?;
                self.map.take_band(tile, header.boot, &band, None, now)?;
                self.quality.heard(Stream::Tiles, now);
                self.changes += 1;
            }
            Topic::Shores => self.take_shores(payload, None, now)?,
            Topic::Alive
            | Topic::View
            | Topic::Info
            | Topic::Ping
            | Topic::Tiles(_)
            | Topic::Digests(_)
            | Topic::Operator(_) => return Err(Refusal::Key),
        }
        Ok(())
    }

    fn take_reply(
        &mut self,
        topic: Topic,
        payload: &[u8],
        request: RequestId,
        now: Monotonic,
    ) -> Result<(), Refusal> {
        match topic {
            Topic::Tiles(layer) => {
                let (header, reply): (_, TilesReply) = decode(payload)?;
                self.map
                    .take_reply(layer, header.boot, &reply, request, now)?;
                self.changes += 1;
            }
            Topic::Digests(layer) => {
                let (header, digests): (_, Digests) = decode(payload)?;
                self.map
                    .take_digests(layer, header.boot, &digests, request)?;
            }
            Topic::Info => {
                let (header, info): (_, Info) = decode(payload)?;
                self.map
                    .take_info(&info, header.boot)
                    .map_err(|_why| Refusal::Malformed)?;
                self.info = Some((info, header.boot));
                self.asked_info = None;
                self.changes += 1;
            }
            Topic::Ping => {
                let (_, Pong) = decode(payload)?;
                self.connection.ponged(request, now);
            }
            Topic::Shores => self.take_shores(payload, Some(request), now)?,
            Topic::Alive
            | Topic::View
            | Topic::Pose
            | Topic::Status
            | Topic::Event
            | Topic::MapHead
            | Topic::Tile(_)
            | Topic::Operator(_) => return Err(Refusal::Key),
        }
        Ok(())
    }

    fn take_shores(
        &mut self,
        payload: &[u8],
        request: Option<RequestId>,
        now: Monotonic,
    ) -> Result<(), Refusal> {
        let (header, news): (_, ShoresNews) = decode(payload)?;
        self.of_this_boot(header)?;
        let is_news = self.shores.take(news, header.seq, request, now)?;
        self.changes += u64::from(is_news);
        Ok(())
    }

    /// What the last run of the robot still had to say is not this one's.
    fn of_this_boot(&self, header: Header) -> Result<(), Refusal> {
        match self.map.boot() {
            Some(boot) if boot != header.boot => Err(Refusal::OtherBoot),
            Some(_) | None => Ok(()),
        }
    }
}

fn decode<T: DeserializeOwned>(payload: &[u8]) -> Result<(Header, T), Refusal> {
    wire::decode(payload).map_err(|why| match why {
        WireError::TooLong(_) => Refusal::Oversized,
        WireError::OtherProtocol { .. } => Refusal::OtherProtocol,
        WireError::Malformed => Refusal::Malformed,
    })
}
