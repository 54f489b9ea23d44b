//! Settings of a vehicle that an autopilot drives.

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use crate::config::{ConfigIssue, Problem};
use drivers::Address;
use drivers::config::{LinkKeys, SERIAL, TCP, UDP, UDP_LISTEN};

/// Of a serial port, as `ArduPilot` sets its USB port, and the least: 20 velocities of 65 bytes a second take 13 kbit/s. Unsent
/// bytes are discarded after 50 ms, in which 179 bytes of distances of obstacles must have left, too: with them the former is the least.
const BAUD: u32 = 115_200;
const LEAST_BAUD: u32 = 38_400;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MavlinkConfig {
    /// Address and port to connect to.
    pub tcp: Option<String>,
    /// Address and port to send datagrams to.
    pub udp: Option<String>,
    /// Own address and port that the autopilot sends datagrams to.
    pub udp_listen: Option<String>,
    /// Serial port; better a name that stays: `/dev/serial/by-id/…`.
    pub serial: Option<String>,
    pub baud: Option<u32>,
    /// Number of the autopilot's system (`SYSID_THISMAV`); frames of others are ignored.
    pub system: u32,
    /// Number of this computer's system: as a companion computer, that of the autopilot.
    pub own_system: u32,
    /// `MAV_COMP_ID_ONBOARD_COMPUTER` is 191.
    pub own_component: u32,
    /// Whether mode GUIDED is requested, once, when an operator takes the lease.
    pub request_guided: bool,
    /// Whether distances of obstacles are sent to it, for its own avoidance.
    pub obstacle_distance: bool,
}

impl Default for MavlinkConfig {
    fn default() -> Self {
        Self {
            tcp: None,
            udp: None,
            udp_listen: None,
            serial: None,
            baud: None,
            system: 1,
            own_system: 1,
            own_component: 191,
            request_guided: false,
            obstacle_distance: false,
        }
    }
}

impl MavlinkConfig {
    /// Everything that is wrong with the values; keys are relative to this table.
    pub fn check(&self) -> Vec<ConfigIssue> {
        let issue = |key: &str, value: String, why, allowed: String| ConfigIssue {
            origin: None,
            key: key.to_owned(),
            problem: Problem::NotAllowed {
                value,
                why,
                allowed,
            },
        };
        let numbers = [
            ("system", self.system),
            ("own_system", self.own_system),
            ("own_component", self.own_component),
        ];
        let numbers = numbers.into_iter().filter_map(|(key, number)| {
            let why = "MAVLink numbers systems and components";
            let is_number = (1..=255).contains(&number);
            (!is_number).then(|| issue(key, number.to_string(), why, "1 to 255".to_owned()))
        });
        let mut issues: Vec<_> = numbers.collect();
        if (self.own_system, self.own_component) == (self.system, 1) {
            let why = "the autopilot itself is component 1 of its system";
            let allowed = "191, or another number".to_owned();
            issues.push(issue("own_component", "1".to_owned(), why, allowed));
        }
        let (least_baud, why) = if self.obstacle_distance {
            (BAUD, "distances of obstacles would wait in the port")
        } else {
            (LEAST_BAUD, "velocities would wait in the port")
        };
        if let Some(baud) = self.baud.filter(|baud| *baud < least_baud) {
            let allowed = format!("{least_baud} or more");
            issues.push(issue("baud", baud.to_string(), why, allowed));
        }
        if let Err((key, allowed)) = self.address() {
            let values = [&self.tcp, &self.udp, &self.udp_listen, &self.serial];
            let values = values
                .into_iter()
                .flatten()
                .map(|value| format!("\"{value}\""));
            let value = values.collect::<Vec<_>>().join(", ");
            issues.push(issue(key, value, "it says where the autopilot is", allowed));
        }
        issues
    }

    /// Where the autopilot is. Fails with a key and what is allowed.
    pub fn address(&self) -> Result<Address, (&'static str, String)> {
        let keys = LinkKeys {
            given: [&self.tcp, &self.udp, &self.udp_listen, &self.serial],
            baud: self.baud,
        };
        let address = keys.address(TCP | UDP | UDP_LISTEN | SERIAL, BAUD)?;
        if let Address::Tcp(peer) | Address::Udp(peer) = &address
            && peer.parse::<SocketAddr>().is_err()
        {
            let key = if self.tcp.is_some() { "tcp" } else { "udp" };
            let text =
                "address and port, as 192.168.0.2:5760 is: the motor guard looks up no names";
            return Err((key, text.to_owned()));
        }
        Ok(address)
    }

    /// Own system and component, and the autopilot's system.
    pub fn numbers(&self) -> ([u8; 2], u8) {
        let byte = |number: u32| u8::try_from(number).unwrap_or(u8::MAX);
        (
            [byte(self.own_system), byte(self.own_component)],
            byte(self.system),
        )
    }
}
