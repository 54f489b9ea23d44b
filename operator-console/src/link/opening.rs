//! How a session is opened, and opened again by another way.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use robot_edge::clock;
use robot_edge::link::LinkError;
use robot_edge::link::endpoints::{Channel, attempts};
use robot_edge::link::sessions::{self, Endpoints, RETRY_PERIOD, Side};
use zenoh::{Session, Wait as _};

use super::connect::{State, subscribe};
use super::lost_link::LostLink;
use super::transport::Transport;
use crate::locks::lock;

/// What lets TLS through lets QUIC through a moment later.
const COMING_BACK: Duration = Duration::from_millis(200);

/// Opens the session of `channel`, and again where its link is lost for good and it could go by another way.
pub(super) fn keep_open(state: &Arc<State>, channel: Channel, endpoints: &Endpoints) {
    let has_keys = endpoints.credentials.is_some();
    let has_other_way =
        attempts(channel, &endpoints.connect, has_keys).is_ok_and(|ways| ways.len() > 1);
    let mut is_first = true;
    while let Some(session) = open_with_retries(state, channel, endpoints, is_first) {
        is_first = false;
        if !has_other_way || !wait_until_lost(state, &session) {
            return;
        }
        tracing::info!("the link is lost; it is opened anew, by whatever way answers");
        let taken = lock(state.session(channel)).take();
        taken.into_iter().for_each(close_in_background);
    }
}

/// Waits until the session has lost its link for good; false where it is not wanted any more.
fn wait_until_lost(state: &State, session: &Session) -> bool {
    let mut lost = LostLink::default();
    while !state.is_closing() {
        let has_link = session.info().links().wait().next().is_some();
        if lost.update(has_link, clock::now()) {
            return true;
        }
        clock::sleep_until(clock::now() + RETRY_PERIOD, || state.is_closing());
    }
    false
}

/// Tries until the session is open; none where it is not wanted any more.
fn open_with_retries(
    state: &Arc<State>,
    channel: Channel,
    endpoints: &Endpoints,
    mut is_first: bool,
) -> Option<Session> {
    while !state.is_closing() {
        match open(channel, endpoints, is_first)
            .and_then(|session| subscribe(state, channel, session))
        {
            Ok(session) => {
                let mut slot = lock(state.session(channel));
                // It may have been closed meanwhile, and nobody would close this one.
                if state.is_closing() {
                    drop(slot);
                    close(&session);
                    return None;
                }
                *slot = Some(session.clone());
                drop(slot);
                state.set_problem(channel, None);
                return Some(session);
            }
            Err(why) => {
                tracing::debug!(%why, "not connected yet");
                state.set_problem(channel, Some(in_words(&why, channel, endpoints)));
            }
        }
        is_first = false;
        clock::sleep_until(clock::now() + RETRY_PERIOD, || state.is_closing());
    }
    None
}

/// Opens the session once. Where nobody answered before and it is TLS that does now, QUIC is asked once more: the robot, or
/// the network, may have come between its question and that of TLS, or be coming.
fn open(channel: Channel, endpoints: &Endpoints, is_first: bool) -> Result<Session, LinkError> {
    let session = sessions::open(Side::Console, channel, endpoints)?;
    let is_second_best = Transport::of(&session, &endpoints.connect) == Some(Transport::TlsInstead);
    if is_first || !is_second_best {
        return Ok(session);
    }
    thread::sleep(COMING_BACK);
    match sessions::open(Side::Console, channel, endpoints) {
        Ok(again) => {
            close_in_background(session);
            Ok(again)
        }
        Err(_lost_again) => Ok(session),
    }
}

/// Closing may wait for the network, and nobody waits for it.
fn close_in_background(session: Session) {
    thread::spawn(move || close(&session));
}

/// Closes a session, and may wait for the network.
pub(super) fn close(session: &Session) {
    if let Err(why) = session.close().wait() {
        tracing::debug!(%why, "a session did not close");
    }
}

fn in_words(why: &LinkError, channel: Channel, asked: &Endpoints) -> String {
    match (why, channel) {
        // One way of several is the last that failed: what was asked is all of them.
        (LinkError::Open { .. }, Channel::Control) => {
            format!("no answer at {}; trying again", asked.connect.join(", "))
        }
        (LinkError::Open { endpoints, .. }, Channel::Bulk) => {
            format!("no answer at {endpoints}, where maps come from; trying again")
        }
        (
            LinkError::Endpoint(_)
            | LinkError::Protocol { .. }
            | LinkError::Credentials(_)
            | LinkError::UnexpectedPeer { .. }
            | LinkError::Config { .. }
            | LinkError::Setting { .. }
            | LinkError::Declare { .. }
            | LinkError::NoRandomness(_)
            | LinkError::Thread(_)
            | LinkError::Encoder(_),
            Channel::Control | Channel::Bulk,
        ) => why.to_string(),
    }
}
