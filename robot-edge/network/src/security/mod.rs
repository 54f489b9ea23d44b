//! Who may do what on the link: mutual TLS, and access control by the common names of certificates.
//!
//! This keeps strangers out and everybody to their role. That a vehicle moves for its operators alone does not rest on
//! it: commands are signed ([`protocol::signed`]), and the vehicle's list of operators has the last word.

mod access;
mod connection_audit;
mod peer_check;
mod router;
mod tls;

pub use router::RouterConfig;

pub use connection_audit::audit_closed_links;
pub(super) use connection_audit::audit_links;
pub(super) use peer_check::check_peers;
pub(super) use tls::{SettingsOfTls, console_settings, edge_settings};
