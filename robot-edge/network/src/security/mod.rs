//! Who may do what on the link: mutual TLS, and access control by the common names of certificates.
//!
//! This keeps strangers out and everybody to their role. That a vehicle moves for its operators alone does not rest on
//! it: commands are signed ([`protocol::signed`]), and the vehicle's list of operators has the last word.

mod access;
mod links;
mod tls;

pub use links::audit_closed_links;
pub(super) use links::{audit_links, check_peers};
pub use tls::RouterConfig;
pub(super) use tls::{SettingsOfTls, console_settings, edge_settings};
