//! Writes connections to the audit log.

use zenoh::sample::SampleKind;
use zenoh::session::Link;
use zenoh::{Session, Wait};

use crate::LinkError;
use crate::audit::{Audit, LinkEvent};
use crate::endpoints::Channel;

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
