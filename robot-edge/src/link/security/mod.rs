//! Who may do what on the link: mutual TLS, and access control by the common names of certificates.
//!
//! This keeps strangers out and everybody to their role. That a vehicle moves for its operators alone does not rest on
//! it: commands are signed ([`protocol::signed`]), and the vehicle's list of operators has the last word.

mod access;
mod connections;
mod router;
mod strangers;
mod tls;

pub use router::RouterConfig;

pub(super) use connections::{write_down_ends, write_down_links};
pub(super) use strangers::refuse_strangers;
pub(super) use tls::{SettingsOfTls, console_settings, edge_settings};
