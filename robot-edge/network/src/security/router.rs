//! The configuration of a router: `zenohd -c` needs nothing else.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use protocol::keys::RobotId;
use serde_json::{Map, Value, json};

use super::access::router_access;
use super::tls::shared_settings;
use crate::credentials::OperatorList;
use crate::endpoints::{DEFAULT_PORT, listeners_of_router};

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
