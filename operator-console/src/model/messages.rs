//! Messages between link and model, as bytes, why the model rejects one, and what the model sends and requests.

use std::collections::BTreeMap;
use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::{self, RobotId, Topic};
use protocol::message::{DigestsRequest, TilesRequest, View};
use protocol::wire::{self, Header};
use serde::Serialize;

use super::ConsoleModel;
use super::layer_sync::Query;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RequestId(pub u64);

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    Sample {
        key: String,
        payload: Vec<u8>,
    },
    /// One of any number of replies to a request.
    Reply {
        request: RequestId,
        key: String,
        payload: Vec<u8>,
    },
    /// No more replies will come: the last one arrived or the request timed out.
    Ended {
        request: RequestId,
    },
    Lost {
        /// Because the console was too slow.
        overrun: u64,
        /// Because they exceeded the size limit.
        oversized: u64,
    },
    /// Whether the robot's presence token is there. For display only.
    Presence(bool),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OpenSessions {
    /// Small, urgent messages.
    pub control: bool,
    /// Maps.
    pub bulk: bool,
}

impl OpenSessions {
    pub const BOTH: Self = Self {
        control: true,
        bulk: true,
    };
    pub const NONE: Self = Self {
        control: false,
        bulk: false,
    };
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outgoing {
    Get {
        request: RequestId,
        key: String,
        payload: Vec<u8>,
        is_bulk: bool,
    },
    /// Sends a message over the control session.
    Put { key: String, payload: Vec<u8> },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RejectReason {
    /// Its key is not of this protocol, or of another robot.
    Key,
    Malformed,
    /// Another version of the protocol: one of the two programs must be updated.
    OtherProtocol,
    Oversized,
    Overrun,
    BeforeJoin,
    /// From a run of the robot that is over or not yet announced.
    OtherBoot,
    OldEpoch,
    OldRevision,
    BadTile,
    /// Differences to a revision that is not here: the tile is requested.
    NoBase,
    UnknownLayer,
}

impl RejectReason {
    pub const fn name(self) -> &'static str {
        match self {
            Self::Key => "foreign key",
            Self::Malformed => "malformed",
            Self::OtherProtocol => "other protocol version: update the older program",
            Self::Oversized => "oversized",
            Self::Overrun => "console too slow",
            Self::BeforeJoin => "before joining",
            Self::OtherBoot => "other boot",
            Self::OldEpoch => "erased layer",
            Self::OldRevision => "known already",
            Self::BadTile => "damaged tile",
            Self::NoBase => "differences to a tile that was missed",
            Self::UnknownLayer => "unknown layer",
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RejectCounts(BTreeMap<RejectReason, u64>);

impl RejectCounts {
    pub fn add(&mut self, why: RejectReason, count: u64) {
        if count > 0 {
            *self.0.entry(why).or_default() += count;
        }
    }

    pub fn count(&self, why: RejectReason) -> u64 {
        self.0.get(&why).copied().unwrap_or(0)
    }

    pub fn iter(&self) -> impl Iterator<Item = (RejectReason, u64)> {
        self.0.iter().map(|(why, count)| (*why, *count))
    }
}

const VIEW_PERIOD: Duration = Duration::from_millis(500);
/// Limits of the distance from the vehicle, along each axis, within which a console that joins requests all tiles first, metres.
const NEAR_M: [f64; 2] = [20.0, 64.0];
const INFO_PERIOD: Duration = Duration::from_millis(500);

impl ConsoleModel {
    /// What to send and to request now over the open sessions. Also samples the link quality.
    pub fn outgoing(&mut self, sessions: OpenSessions, now: Monotonic) -> Vec<Outgoing> {
        self.connection.expire_pings(now);
        let round_trip = self.connection.round_trip();
        let missing = self.poses_missing(now);
        let kbps = self.connection.kbps(now);
        self.quality.sample(round_trip, missing, kbps, now);
        let mut outgoing = Vec::new();
        if sessions.control {
            outgoing.extend(self.control_outgoing(now));
        }
        if sessions.bulk {
            outgoing.extend(self.bulk_queries(now));
        }
        outgoing
    }

    fn control_outgoing(&mut self, now: Monotonic) -> Vec<Outgoing> {
        let mut outgoing = Vec::new();
        let robot = self.settings.robot.clone();
        let get = |request, topic: Topic| Outgoing::Get {
            request,
            key: topic.key(&robot),
            payload: Vec::new(),
            is_bulk: false,
        };
        if self.is_info_wanted() {
            let number = || next(&mut self.requests);
            let request = self.robot.info_query.request(INFO_PERIOD, now, number);
            outgoing.extend(request.map(|request| get(request, Topic::Info)));
        }
        let view_age = self.view.last_sent.map(|at| now.since(at));
        if view_age.is_none_or(|age| age >= VIEW_PERIOD) {
            self.view.last_sent = Some(now);
            let payload = self.message(&self.view());
            let session = RobotId::from_bytes(self.settings.session.0);
            outgoing.extend(payload.map(|payload| Outgoing::Put {
                key: keys::view_of(&robot, &session),
                payload,
            }));
        }
        if self.connection.is_ping_due(now) {
            let request = next(&mut self.requests);
            self.connection.on_ping(request, now);
            outgoing.push(get(request, Topic::Ping));
        }
        outgoing
    }

    fn bulk_queries(&mut self, now: Monotonic) -> Vec<Outgoing> {
        let mut outgoing = Vec::new();
        let near_m = self.near_m();
        let queries = self.map.queries(near_m, now, || next(&mut self.requests));
        for (request, layer, query) in queries {
            outgoing.extend(match query {
                Query::Digests { newer_than } => {
                    let body = DigestsRequest { newer_than };
                    self.bulk_query(Topic::Digests(layer), request, &body)
                }
                Query::Tiles(tiles) => {
                    let body = TilesRequest::ByKey(tiles);
                    self.bulk_query(Topic::Tiles(layer), request, &body)
                }
                Query::Overviews(places) => {
                    let body = TilesRequest::ByKey(places);
                    self.bulk_query(Topic::Overviews(layer), request, &body)
                }
            });
        }
        // Before the first map head the run that they belong to is unknown. The trail is as long as many tiles.
        if self.map.boot().is_some() && !self.map.is_joining(near_m) {
            if self.has_shores()
                && let Some((request, body)) = self.shores.query(now, || next(&mut self.requests))
            {
                outgoing.extend(self.bulk_query(Topic::Shores, request, &body));
            }
            while let Some((request, body)) = self.voxels.query(now, || next(&mut self.requests)) {
                outgoing.extend(self.bulk_query(Topic::Voxels, request, &body));
            }
            let whole = self.trajectory.query(now, || next(&mut self.requests));
            let trail = self.trail.query(now, || next(&mut self.requests));
            for (request, body) in [whole, trail].into_iter().flatten() {
                outgoing.extend(self.bulk_query(Topic::Trajectory, request, &body));
            }
        }
        outgoing
    }

    /// An area of the size of the view around the vehicle, where a window that joins will look.
    fn near_m(&self) -> Option<[f64; 4]> {
        let (pose, _) = self.vehicle.pose()?;
        let [low_x, low_y, high_x, high_y] = self.view.rectangle_m.map(f64::from);
        let [x, y, _] = pose.position_m;
        let [width, height] = [high_x - low_x, high_y - low_y].map(|side_m| {
            let [least, most] = NEAR_M;
            (0.5 * side_m).clamp(least, most)
        });
        Some([x - width, y - height, x + width, y + height])
    }

    fn is_info_wanted(&self) -> bool {
        let newest = self.status().map_or(0, |(status, _)| status.info_revision);
        let is_current = self.info().is_some_and(|info| info.revision >= newest);
        !is_current || self.map.lacks_info()
    }

    fn view(&self) -> View {
        // Before the first map head nobody knows to which run a tile belongs.
        let boot = self.map.boot();
        let wanted_layers = boot.into_iter().flat_map(|_| self.wanted_layers());
        let store = self.map.store();
        let revisions = store.grids().map(|grid| store.head_revision(grid.layer));
        let revision = revisions.max();
        View {
            rectangle_m: self.view.rectangle_m,
            layers: wanted_layers.map(|layer| 1u32 << layer as u32).sum(),
            revision: revision.unwrap_or(0),
            is_synchronized: self.matches_last_head()
                && !self.view.is_unfinished
                && !self.voxels.is_wanted()
                && !self.trajectory.is_wanted(),
            wants_scan: self.scans.is_wanted,
        }
    }

    fn bulk_query<T: Serialize>(
        &mut self,
        topic: Topic,
        request: RequestId,
        body: &T,
    ) -> Option<Outgoing> {
        Some(Outgoing::Get {
            request,
            key: topic.key(&self.settings.robot),
            payload: self.message(body)?,
            is_bulk: true,
        })
    }

    fn message<T: Serialize>(&mut self, body: &T) -> Option<Vec<u8>> {
        self.seq += 1;
        let header = Header {
            boot: self.settings.session,
            seq: self.seq,
            robot_time_ns: 0,
        };
        let bytes = wire::encode(&header, body);
        bytes
            .inspect_err(|why| tracing::error!(%why, "cannot encode a message"))
            .ok()
    }
}

const fn next(requests: &mut u64) -> RequestId {
    *requests += 1;
    RequestId(*requests)
}
