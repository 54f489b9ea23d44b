//! What the console sends and requests.

use std::time::Duration;

use measurement::time::Monotonic;
use protocol::keys::{self, RobotId, Topic};
use protocol::message::View;
use protocol::wire::{self, Header};
use serde::Serialize;

use super::ConsoleModel;
use super::incoming::{OpenSessions, Outgoing, RequestId};
use super::map_sync::MapQuery;

const VIEW_PERIOD: Duration = Duration::from_millis(500);
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
        if self.is_info_wanted(now) {
            let request = self.number();
            self.robot.info_query.ask(request, now);
            outgoing.push(Outgoing::Get {
                request,
                key: Topic::Info.key(&robot),
                payload: Vec::new(),
                is_bulk: false,
            });
        }
        if self
            .view
            .last_sent
            .is_none_or(|at| now.since(at) >= VIEW_PERIOD)
        {
            self.view.last_sent = Some(now);
            let payload = self.message(&self.view());
            outgoing.extend(payload.map(|payload| Outgoing::Put {
                key: keys::view_of(&robot, &self.session_name()),
                payload,
            }));
        }
        if self.connection.is_ping_due(now) {
            let request = self.number();
            self.connection.on_ping(request, now);
            outgoing.push(Outgoing::Get {
                request,
                key: Topic::Ping.key(&robot),
                payload: Vec::new(),
                is_bulk: false,
            });
        }
        outgoing
    }

    fn bulk_queries(&mut self, now: Monotonic) -> Vec<Outgoing> {
        let mut outgoing = Vec::new();
        let queries = self.map.queries(now, || next(&mut self.requests));
        for (request, query) in queries {
            outgoing.extend(match query {
                MapQuery::Digests(layer, body) => {
                    self.bulk_query(Topic::Digests(layer), request, &body)
                }
                MapQuery::Tiles(layer, body) => {
                    self.bulk_query(Topic::Tiles(layer), request, &body)
                }
            });
        }
        // Before the first map head the run that they belong to is unknown.
        if self.map.boot().is_some() {
            let shores = self
                .has_shores()
                .then(|| self.shores.query(now, || next(&mut self.requests)))
                .flatten();
            outgoing.extend(
                shores.and_then(|(request, body)| self.bulk_query(Topic::Shores, request, &body)),
            );
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

    fn is_info_wanted(&self, now: Monotonic) -> bool {
        let is_lacking = self.robot.info.is_none() || self.map.lacks_info() || self.is_info_old();
        is_lacking && self.robot.info_query.is_due_after(INFO_PERIOD, now)
    }

    fn is_info_old(&self) -> bool {
        let known = self.info().map(|info| info.revision);
        let newest = self.status().map(|(status, _)| status.info_revision);
        known
            .zip(newest)
            .is_some_and(|(known, newest)| known < newest)
    }

    fn view(&self) -> View {
        let wanted_layers = self.wanted_layers();
        let layers = wanted_layers
            .iter()
            .map(|layer| 1u32 << *layer as u32)
            .sum();
        let store = self.map.store();
        let revision = store
            .grids()
            .map(|grid| store.head_revision(grid.layer))
            .max();
        View {
            rectangle_m: self.view.rectangle_m,
            layers,
            revision: revision.unwrap_or(0),
            is_synchronized: self.matches_last_head()
                && !self.view.is_unfinished
                && !self.voxels.is_wanted()
                && !self.trajectory.is_wanted(),
            wants_scan: self.scans.is_wanted(),
        }
    }

    fn session_name(&self) -> RobotId {
        RobotId::from_bytes(self.settings.session.0)
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

    fn number(&mut self) -> RequestId {
        next(&mut self.requests)
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
