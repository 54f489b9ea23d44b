//! Checks that a console is connected to a vehicle or router.
//!
//! Zenoh also trusts public certificate authorities when it connects. No public authority signs the common name
//! `vehicle:NAME`, so that the name decides.

use std::thread;

use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

use crate::LinkError;
use crate::credentials::Identity;

/// Closes the session, now or later, if its peer is neither a vehicle nor a router. The session must be closed in the
/// end: the listener keeps a clone of it.
pub(crate) fn check_peers(session: &Session, endpoints: &str) -> Result<(), LinkError> {
    let stranger = session
        .info()
        .links()
        .wait()
        .find_map(|link| unexpected_peer_name(link.auth_identifier()));
    if let Some(name) = stranger {
        close(session);
        return Err(LinkError::UnexpectedPeer {
            endpoints: endpoints.to_owned(),
            name,
        });
    }
    let watched = session.clone();
    session
        .info()
        .link_events_listener()
        .callback(move |event| {
            if event.kind() != SampleKind::Put {
                return;
            }
            if let Some(name) = unexpected_peer_name(event.link().auth_identifier()) {
                tracing::error!(
                    name,
                    "somebody else answers now, who is no vehicle and no router: the link is closed"
                );
                let session = watched.clone();
                // Closing waits for callbacks, and this is one.
                thread::spawn(move || close(&session));
            }
        })
        .background()
        .wait()
        .map_err(|why| LinkError::Declare {
            what: "the watch over links".to_owned(),
            why,
        })
}

/// The name of a peer that may not serve a console.
fn unexpected_peer_name(common_name: Option<&str>) -> Option<String> {
    let name = common_name.unwrap_or("nobody");
    let serves = name
        .parse()
        .is_ok_and(|identity: Identity| identity.serves_consoles());
    (!serves).then(|| name.to_owned())
}

fn close(session: &Session) {
    if let Err(why) = session.close().wait() {
        tracing::debug!(%why, "a session did not close");
    }
}
