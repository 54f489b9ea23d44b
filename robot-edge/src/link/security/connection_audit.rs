//! Who connects to a vehicle, for the audit log.

use zenoh::sample::SampleKind;
use zenoh::session::Link;
use zenoh::{Session, Wait};

use crate::audit::{Audit, LinkEvent};
use crate::link::LinkError;
use crate::link::endpoints::Channel;

/// Writes down every link that is set up and every one that ends.
pub(in crate::link) fn audit_links(
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

/// Writes down that the links of a session end, which is about to be closed: it reports none of these ends itself.
pub(in crate::link) fn audit_closed_links(session: &Session, channel: Channel, audit: &Audit) {
    for link in session.info().links().wait() {
        audit_link(&link, channel, false, audit);
    }
}

fn audit_link(link: &Link, channel: Channel, is_up: bool, audit: &Audit) {
    // Of a connection that carries datagrams too, one line is enough.
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
