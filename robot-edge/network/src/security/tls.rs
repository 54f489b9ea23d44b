//! The settings that make a link mutual TLS, each for both kinds of session.

use std::path::Path;

use serde_json::{Value, json};

use super::access::vehicle_access;
use crate::credentials::{Credentials, Identity, OperatorList};

/// Sessions that a vehicle or a router holds at once: as many as operators that it distinguishes.
const MAX_SESSIONS: usize = 64;
/// A link that is not set up in this time is given up, ms: strangers must not hold many.
const SETUP_MS: u64 = 4000;

/// Settings of Zenoh: key and value.
pub(crate) type SettingsOfTls = Vec<(&'static str, Value)>;

/// What both sides and routers share. Each has other settings for certificates and keys.
pub(super) fn shared_settings() -> SettingsOfTls {
    vec![
        // Nothing else carries a common name.
        ("transport/link/protocols", json!(["quic", "tls"])),
        ("transport/link/tls/enable_mtls", json!(true)),
        // Without it, whatever any public authority has ever signed would pass for a vehicle.
        ("transport/link/tls/verify_name_on_connect", json!(true)),
        ("transport/link/tls/close_link_on_expiration", json!(true)),
        ("transport/unicast/max_sessions", json!(MAX_SESSIONS)),
        ("transport/unicast/accept_timeout", json!(SETUP_MS)),
        ("transport/unicast/open_timeout", json!(SETUP_MS)),
    ]
}

fn with_files(credentials: &Credentials) -> SettingsOfTls {
    let path = |path: &Path| json!(path.to_string_lossy());
    let (certificate, key) = (
        path(&credentials.link_certificate()),
        path(&credentials.link_key()),
    );
    let mut settings = shared_settings();
    settings.extend([
        (
            "transport/link/tls/root_ca_certificate",
            path(&credentials.ca_certificate()),
        ),
        ("transport/link/tls/listen_certificate", certificate.clone()),
        ("transport/link/tls/listen_private_key", key.clone()),
        ("transport/link/tls/connect_certificate", certificate),
        ("transport/link/tls/connect_private_key", key),
    ]);
    settings
}

/// Settings of a vehicle's sessions, to which `people` may connect.
pub(crate) fn edge_settings(credentials: &Credentials, people: &OperatorList) -> SettingsOfTls {
    let mut settings = with_files(credentials);
    if let Identity::Vehicle(robot) = credentials.identity() {
        settings.push(("access_control", vehicle_access(robot, people)));
    }
    settings
}

pub(crate) fn console_settings(credentials: &Credentials) -> SettingsOfTls {
    with_files(credentials)
}
