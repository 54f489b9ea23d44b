//! The vehicle's side of the link: it opens the sessions, and opens them anew where other people may connect.
//!
//! Zenoh's access control is fixed when a session opens, and it has no way to close a single link (1.10: `update_config` of
//! its tables is private, and nothing calls it). So whoever is taken off the list, or put on it, takes both sessions to be
//! opened anew; what is above them, and the loop that drives, goes on.

use std::collections::BTreeSet;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use protocol::keys::RobotId;
use protocol::message::Info;
use protocol::tile::BootId;
use protocol::tile_store::TileStore;

use super::LinkError;
use super::open_sessions::OpenSessions;
use super::outgoing::Outgoing;
use super::publish_state::PublishState;
use super::sessions::Endpoints;
use crate::clock;
use crate::credentials::OperatorList;
use crate::driving::operators::PendingOperatorList;
use crate::driving::{Inbox, SharedDriveState};
use crate::events::event;

/// Between two looks whether there is a newer list.
const LIST_CHECK_PERIOD: Duration = Duration::from_millis(100);
/// Sessions that are to end are waited for so long.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(300);
/// Between two attempts to open the sessions anew: the system may not have freed their ports yet. After [`COMPLAINT_DELAY`], ten
/// times as long.
const RETRY_PERIOD: Duration = Duration::from_millis(50);
/// Attempts that fail for so long are said to.
const COMPLAINT_DELAY: Duration = Duration::from_secs(1);
/// And then this often.
const REPEAT_INTERVAL: Duration = Duration::from_secs(10);

/// What a robot is called and how it is reached.
#[derive(Clone, Debug)]
pub struct EdgeSettings {
    /// Its name.
    pub robot: RobotId,
    /// This run.
    pub boot: BootId,
    /// Where, and by whom.
    pub endpoints: Endpoints,
    /// Where a newer list of those who may connect is left.
    pub newer_operators: PendingOperatorList,
    /// Tiles' share of the link, kilobits (10³ bits) per second.
    pub budget_kbps: u32,
    /// Who it is.
    pub info: Info,
    /// What drives it, if it can be driven.
    pub driving: Option<(Inbox, Arc<SharedDriveState>)>,
}

/// What is there as long as the link, whichever sessions it has.
pub(super) struct LinkServer {
    pub(super) settings: EdgeSettings,
    pub(super) store: Arc<Mutex<TileStore>>,
    pub(super) publish_state: Arc<PublishState>,
    pub(super) out: Outgoing,
}

/// An open link. Dropping it closes it.
pub struct EdgeLink {
    publish_state: Arc<PublishState>,
    thread: Option<JoinHandle<()>>,
}

impl EdgeLink {
    /// Opens both sessions and starts to serve `store` and `publish_state`.
    ///
    /// # Errors
    /// Where a session cannot be opened or Zenoh refuses a declaration.
    pub fn open(
        settings: EdgeSettings,
        store: Arc<Mutex<TileStore>>,
        publish_state: Arc<PublishState>,
    ) -> Result<Self, LinkError> {
        let server = LinkServer {
            out: Outgoing::new(settings.boot),
            settings,
            store,
            publish_state: Arc::clone(&publish_state),
        };
        let sessions = OpenSessions::open(&server)?;
        let thread = thread::Builder::new()
            .name("link".to_owned())
            .spawn(move || server.serve(sessions))
            .map_err(LinkError::Thread)?;
        Ok(Self {
            publish_state,
            thread: Some(thread),
        })
    }

    /// What mapping hands to the link.
    pub const fn publish_state(&self) -> &Arc<PublishState> {
        &self.publish_state
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
    /// Keeps sessions open until the link closes: those who may connect are always those of the newest list.
    fn serve(mut self, sessions: OpenSessions) {
        let mut sessions = Some(sessions);
        while clock::sleep_until(clock::now() + LIST_CHECK_PERIOD, || {
            self.publish_state.is_closing()
        }) {
            let Some(newer) = self.settings.newer_operators.take() else {
                continue;
            };
            let endpoints = &mut self.settings.endpoints;
            let is_same = identities(&newer) == identities(&endpoints.operators);
            endpoints.operators = newer;
            // Where nobody connects to the vehicle itself, a router decides who hears of it, by rules of its own.
            if is_same || endpoints.listen.is_empty() {
                continue;
            }
            let began = clock::now();
            let message =
                "all links are closed, and opened anew for those on the newer list of operators";
            self.publish_event("access", message.to_owned());
            // Those of before end first: at no moment there are listeners with both rules.
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

    /// Opens the sessions, however often it takes; `None` where the link closes meanwhile.
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
        if let Some(audit) = &self.settings.endpoints.audit {
            audit.write(kind, message.clone());
        }
        self.publish_state.publish_event(event(kind, message));
    }
}

/// Ends sessions, and does not wait long for somebody who takes nothing any more. Their listeners end first, and until they
/// have ended their ports are taken.
fn end(sessions: OpenSessions) {
    let (ended, has_ended) = sync_channel(1);
    thread::spawn(move || {
        drop(sessions);
        // Nobody waits for it any more where it took too long.
        let _is_waited_for = ended.send(());
    });
    let _has_ended = has_ended.recv_timeout(CLOSE_TIMEOUT);
}

/// Whose certificates the rules of access control name.
fn identities(people: &OperatorList) -> BTreeSet<String> {
    let people = people.people().iter();
    people.map(|listed| listed.identity().to_string()).collect()
}
