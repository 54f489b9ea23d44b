//! The network of the vehicle: opens the sessions, and reopens them when the operator list changes.
//!
//! Zenoh fixes its access control when a session opens, and cannot close a single link (1.10: `update_config` of its
//! tables is private and never called). Therefore a change of the list reopens both sessions. The layers above and the
//! drive loop continue.

use std::collections::BTreeSet;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::message::Info;
use protocol::tile::BootId;
use protocol::tile_store::TileStore;

use super::open_sessions::{OpenSessions, Outgoing};
use super::publish_state::PublishState;
use crate::driving::operators::PendingOperatorList;
use crate::driving::{Inbox, SharedDriveState};
use crate::events::event;
use crate::lock;
use crate::publishing::announced_map::AnnouncedMap;
use network::LinkError;
use network::audit::Audit;
use network::certificate_probe::certificate_problem_at;
use network::clock;
use network::credentials::OperatorList;
use network::sessions::Endpoints;

const LIST_CHECK_PERIOD: Duration = Duration::from_millis(100);
/// A router that has not answered by then is reported, once; the attempts go on.
const ROUTER_CHECK_DELAY: Duration = Duration::from_secs(3);
const CLOSE_TIMEOUT: Duration = Duration::from_millis(300);
/// Interval of attempts to reopen the sessions: the system may not have freed their ports yet. After
/// [`COMPLAINT_DELAY`], ten times as long.
const RETRY_PERIOD: Duration = Duration::from_millis(50);
/// Failing attempts are reported after this time.
const COMPLAINT_DELAY: Duration = Duration::from_secs(1);
const REPEAT_INTERVAL: Duration = Duration::from_secs(10);

#[derive(Clone, Debug)]
pub struct EdgeSettings {
    pub robot: RobotId,
    pub boot: BootId,
    pub endpoints: Endpoints,
    pub newer_operators: PendingOperatorList,
    /// Budget of the tiles, kilobits (10³ bits) per second.
    pub budget_kbps: u32,
    pub info: Info,
    /// The drive loop, if the vehicle can be driven.
    pub driving: Option<(Inbox, Arc<SharedDriveState>)>,
}

/// The part that survives a reopening.
pub(super) struct LinkServer {
    pub(super) settings: EdgeSettings,
    pub(super) announced_map: Arc<Mutex<AnnouncedMap>>,
    pub(super) publish_state: Arc<PublishState>,
    pub(super) out: Outgoing,
}

/// Dropping it closes the network.
pub struct EdgeLink {
    publish_state: Arc<PublishState>,
    announced_map: Arc<Mutex<AnnouncedMap>>,
    thread: Option<JoinHandle<()>>,
}

impl EdgeLink {
    /// Opens both sessions and starts to serve `store` and `publish_state`.
    pub fn open(
        settings: EdgeSettings,
        store: Arc<Mutex<TileStore>>,
        publish_state: Arc<PublishState>,
    ) -> Result<Self, LinkError> {
        let announced_map = Arc::new(Mutex::new(AnnouncedMap::new(store)));
        let server = LinkServer {
            out: Outgoing::new(settings.boot),
            settings,
            announced_map: Arc::clone(&announced_map),
            publish_state: Arc::clone(&publish_state),
        };
        let sessions = OpenSessions::open(&server)?;
        let thread = thread::Builder::new()
            .name("link".to_owned())
            .spawn(move || server.serve(sessions))
            .map_err(LinkError::Thread)?;
        Ok(Self {
            publish_state,
            announced_map,
            thread: Some(thread),
        })
    }

    pub const fn publish_state(&self) -> &Arc<PublishState> {
        &self.publish_state
    }

    /// Announces that the data has ended, with all of the map; returns its newest revision.
    pub fn end(&self) -> u64 {
        let mut announced_map = lock(&self.announced_map);
        let changed = self.publish_state.take_changed_tiles();
        let announced = announced_map.announce_all(changed);
        self.publish_state.tiles_announced(announced, 0);
        self.publish_state.end();
        let store = announced_map.announced();
        let store = lock(&store);
        let revisions = store.grids().map(|grid| store.head_revision(grid.layer));
        revisions.max().unwrap_or(0)
    }
}

impl Drop for EdgeLink {
    fn drop(&mut self) {
        self.publish_state.close();
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("the thread of the link failed");
        }
    }
}

impl LinkServer {
    /// In a thread of its own: looking up a name and trying TLS take seconds.
    fn report_missing_router(&self) {
        let publish_state = Arc::clone(&self.publish_state);
        let Endpoints {
            connect,
            credentials,
            audit,
            ..
        } = self.settings.endpoints.clone();
        thread::spawn(move || {
            let wrong = connect.iter().find_map(|endpoint| {
                let why = certificate_problem_at(endpoint, credentials.as_ref()?)?;
                Some(format!("{endpoint}: {why}"))
            });
            let reason =
                wrong.unwrap_or_else(|| format!("nobody answers at {} yet", connect.join(", ")));
            let message =
                format!("{reason}: until a router does, no console reaches this robot there");
            tracing::warn!("{message}");
            publish_event(audit.as_ref(), &publish_state, "router_missing", message);
        });
    }

    /// Keeps the sessions open, with the access control of the newest list.
    fn serve(mut self, sessions: OpenSessions) {
        let mut sessions = Some(sessions);
        let mut router_check_due = (!self.settings.endpoints.connect.is_empty())
            .then(|| clock::now() + ROUTER_CHECK_DELAY);
        while clock::sleep_until(clock::now() + LIST_CHECK_PERIOD, || {
            self.publish_state.is_closing()
        }) {
            if router_check_due
                .take_if(|due| clock::now() >= *due)
                .is_some()
                && let Some(sessions) = &sessions
                && !sessions.is_router_connected()
            {
                self.report_missing_router();
            }
            let Some(newer) = self.settings.newer_operators.take() else {
                continue;
            };
            let endpoints = &mut self.settings.endpoints;
            let is_same = identities(&newer) == identities(&endpoints.operators);
            endpoints.operators = newer;
            // Without own listeners, a router enforces access by its own rules.
            if is_same || endpoints.listen.is_empty() {
                continue;
            }
            let began = clock::now();
            let message =
                "all links are closed, and opened anew for those on the newer list of operators";
            self.publish_event("access", message.to_owned());
            // The old sessions end first: old and new rules never apply at the same time.
            if let Some(before) = sessions.take() {
                end(before);
            }
            sessions = self.reopen();
            if sessions.is_some() {
                let took_ms = clock::elapsed(began).as_millis();
                let message =
                    format!("links are open by the newer list of operators, after {took_ms} ms");
                self.publish_event("access", message);
            }
        }
    }

    /// Retries until the sessions are open; `None` if the network closes.
    fn reopen(&self) -> Option<OpenSessions> {
        let began = clock::now();
        let mut warning_due = began + COMPLAINT_DELAY;
        while !self.publish_state.is_closing() {
            match OpenSessions::open(self) {
                Ok(sessions) => return Some(sessions),
                Err(why) => {
                    let now = clock::now();
                    if now >= warning_due {
                        warning_due = now + REPEAT_INTERVAL;
                        tracing::error!(%why, "the links cannot be opened anew");
                        self.publish_event(
                            "access_failed",
                            format!("the links cannot be opened anew, which is tried again: {why}"),
                        );
                    }
                }
            }
            let pause = if clock::elapsed(began) < COMPLAINT_DELAY {
                RETRY_PERIOD
            } else {
                10 * RETRY_PERIOD
            };
            clock::sleep_until(clock::now() + pause, || self.publish_state.is_closing());
        }
        None
    }

    fn publish_event(&self, kind: &'static str, message: String) {
        let audit = self.settings.endpoints.audit.as_ref();
        publish_event(audit, &self.publish_state, kind, message);
    }
}

fn publish_event(
    audit: Option<&Audit>,
    publish_state: &PublishState,
    kind: &'static str,
    message: String,
) {
    if let Some(audit) = audit {
        audit.write(kind, message.clone());
    }
    publish_state.publish_event(event(kind, message));
}

/// Closes sessions, with a limit for peers that do not receive. Listeners close first and free their ports.
fn end(sessions: OpenSessions) {
    let (ended, has_ended) = sync_channel(1);
    thread::spawn(move || {
        drop(sessions);
        // The receiver may have timed out.
        let _is_waited_for = ended.send(());
    });
    let _has_ended = has_ended.recv_timeout(CLOSE_TIMEOUT);
}

/// The certificate names in the access control.
fn identities(people: &OperatorList) -> BTreeSet<String> {
    let people = people.people().iter();
    people.map(|listed| listed.identity().to_string()).collect()
}
