//! Checks whom a session is connected to, and audits its links.
//!
//! Zenoh also trusts public certificate authorities when it connects. No public authority signs the common name
//! `vehicle:NAME`, so that the name decides.

use std::thread;

use zenoh::sample::SampleKind;
use zenoh::session::Link;
use zenoh::{Session, Wait};

use crate::LinkError;
use crate::audit::{Audit, LinkEvent};
use crate::credentials::Identity;
use crate::endpoints::Channel;

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

/// Writes connections to the audit log.
pub(crate) fn audit_links(
    session: &Session,
    channel: Channel,
    audit: Audit,
) -> Result<(), LinkError> {
    session
        .info()
        .link_events_listener()
        .callback(move |event| {
            let is_up = event.kind() == SampleKind::Put;
            audit_link(event.link(), channel, is_up, &audit);
        })
        .background()
        .wait()
        .map_err(|why| LinkError::Declare {
            what: "the watch over links".to_owned(),
            why,
        })
}

/// Audits the end of the links of a session before it is closed: Zenoh does not report it.
pub fn audit_closed_links(session: &Session, channel: Channel, audit: &Audit) {
    for link in session.info().links().wait() {
        audit_link(&link, channel, false, audit);
    }
}

fn audit_link(link: &Link, channel: Channel, is_up: bool, audit: &Audit) {
    // A QUIC connection also has a datagram link, which is not audited.
    if !link.is_streamed() {
        return;
    }
    let who = link
        .auth_identifier()
        .unwrap_or("somebody without a certificate");
    audit.write_link(LinkEvent {
        who: who.to_owned(),
        channel: match channel {
            Channel::Control => "control",
            Channel::Bulk => "tiles",
        },
        from: link.dst().to_string(),
        is_up,
    });
}
