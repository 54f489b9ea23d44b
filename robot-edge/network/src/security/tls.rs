//! The settings that make a link mutual TLS, each for both kinds of session.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use protocol::keys::RobotId;
use serde_json::{Map, Value, json};

use super::access::{router_access, vehicle_access};
use crate::credentials::{Credentials, Identity, OperatorList};
use crate::endpoints::{DEFAULT_PORT, listeners_of_router};

/// Sessions that a vehicle holds at once: as many as operators that it distinguishes.
const MAX_SESSIONS: usize = 64;
/// A link that another end began and has not set up in this time is given up, ms: strangers must not hold many.
const SETUP_MS: u64 = 4000;

/// Settings of Zenoh: key and value.
pub(crate) type SettingsOfTls = Vec<(&'static str, Value)>;

/// What both sides and routers share. Each has other settings for certificates and keys.
fn shared_settings() -> SettingsOfTls {
    vec![
        // Nothing else carries a common name.
        ("transport/link/protocols", json!(["quic", "tls"])),
        ("transport/link/tls/enable_mtls", json!(true)),
        // Without it, whatever any public authority has ever signed would pass for a vehicle.
        ("transport/link/tls/verify_name_on_connect", json!(true)),
        ("transport/link/tls/close_link_on_expiration", json!(true)),
        ("transport/unicast/max_sessions", json!(MAX_SESSIONS)),
        ("transport/unicast/accept_timeout", json!(SETUP_MS)),
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

/// The configuration of a router: `zenohd -c` needs nothing else.
#[derive(Clone, Debug)]
pub struct RouterConfig {
    pub ca_pem: String,
    pub certificate_pem: String,
    pub key_pem: String,
    /// The vehicles it serves, each with its list.
    pub vehicles: Vec<(RobotId, OperatorList)>,
}

impl RouterConfig {
    /// The text of the file. It holds the router's key, so that it depends on no other file and no folder.
    pub fn to_json5(&self) -> String {
        let base64 = |pem: &str| json!(STANDARD.encode(pem));
        let (certificate, key) = (base64(&self.certificate_pem), base64(&self.key_pem));
        let mut settings = shared_settings();
        settings.extend([
            ("mode", json!("router")),
            // Control and bulk of each vehicle, and of as many consoles as the vehicle would accept without a router.
            (
                "transport/unicast/max_sessions",
                json!(2 * (1 + MAX_SESSIONS) * self.vehicles.len()),
            ),
            (
                "listen/endpoints",
                json!(listeners_of_router("[::]", DEFAULT_PORT)),
            ),
            ("listen/exit_on_failure", json!(true)),
            ("scouting/multicast/enabled", json!(false)),
            ("scouting/gossip/enabled", json!(false)),
            (
                "transport/link/tls/root_ca_certificate_base64",
                base64(&self.ca_pem),
            ),
            (
                "transport/link/tls/listen_certificate_base64",
                certificate.clone(),
            ),
            ("transport/link/tls/listen_private_key_base64", key.clone()),
            ("transport/link/tls/connect_certificate_base64", certificate),
            ("transport/link/tls/connect_private_key_base64", key),
            ("transport/link/tx/lease", json!(4000)),
            ("transport/link/rx/max_message_size", json!(4 << 20)),
            ("transport/shared_memory/enabled", json!(false)),
            ("adminspace/enabled", json!(false)),
            ("access_control", router_access(&self.vehicles)),
        ]);
        let mut root = Value::Object(Map::new());
        for (key, value) in settings {
            let mut place = &mut root;
            for part in key.split('/') {
                place = &mut place[part];
            }
            *place = value;
        }
        format!(
            "// Made by `robot-edge keys`, which writes it anew when a vehicle or a person is added. It holds the router's key.\n\
             {root:#}\n"
        )
    }
}
