//! Result of asking at an address: robots, or the cause of a failure.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use network::LinkError;
use network::credentials::Identity;
use protocol::keys::RobotId;
use zenoh::{Session, Wait as _};

/// A name that is not resolved within this time counts as unknown.
const LOOKUP_TIMEOUT: Duration = Duration::from_secs(2);
const PROBE_TIMEOUT: Duration = Duration::from_millis(700);

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AddressState {
    #[default]
    Asking,
    Found,
    /// Zenoh answers and reports no robot.
    NoRobot,
    /// A robot answers, as its certificate says, but its access control hides it from this console.
    AccessDenied {
        robot: RobotId,
        /// Whether by QUIC, as at its control port; otherwise the port may be that for tiles.
        by_quic: bool,
    },
    UnknownName,
    /// The computer answers, but nothing listens at the port.
    Refused,
    Silent,
    /// Something answers with another protocol, or with or without keys unlike this console.
    WrongProtocol,
    Problem(String),
}

impl AddressState {
    /// Diagnoses a failure at `address`. May resolve its name and try its port: takes seconds at most.
    pub(super) fn of(why: &LinkError, address: &str) -> Self {
        match why {
            LinkError::Open { .. } => place(address).map_or(Self::Silent, probe_port),
            _ => Self::Problem(why.to_string()),
        }
    }

    /// Diagnoses a session without a robot. A vehicle hides itself from operators who were not on its list when it
    /// started, but its certificate identifies it.
    pub(super) fn of_no_robot(session: &Session) -> Self {
        let mut links = session.info().links().wait();
        links.next().map_or(Self::NoRobot, |link| {
            Self::of_silent(link.auth_identifier(), link.dst().protocol().as_str())
        })
    }

    /// The same by the common name of the peer's certificate.
    fn of_silent(common_name: Option<&str>, protocol: &str) -> Self {
        match common_name.and_then(|name| name.parse().ok()) {
            Some(Identity::Vehicle(robot)) => Self::AccessDenied {
                robot,
                by_quic: protocol == "quic",
            },
            _ => Self::NoRobot,
        }
    }

    /// The robot that answers there but denies access.
    pub const fn access_denied(&self) -> Option<&RobotId> {
        match self {
            Self::AccessDenied {
                robot,
                by_quic: true,
            } => Some(robot),
            _ => None,
        }
    }

    /// Why no robot is reached at `address`, in one line.
    pub fn complaint(&self, address: &str) -> Option<String> {
        match self {
            Self::Asking | Self::Found | Self::NoRobot => None,
            Self::AccessDenied { robot, by_quic } => {
                let tiles = if *by_quic {
                    ""
                } else {
                    "; or this is its port for tiles"
                };
                Some(format!(
                    "{robot} answers at {address} but denies access: you are not on its list of operators; \
                     access is granted within two seconds of being added{tiles}"
                ))
            }
            Self::UnknownName => Some(format!("the name in {address} is not known")),
            Self::Refused | Self::Silent => Some(format!("no answer at {address}; trying again")),
            Self::WrongProtocol => Some(format!(
                "what listens at {address} does not answer as a robot: keys on one side only, or of another fleet?"
            )),
            Self::Problem(why) => Some(why.clone()),
        }
    }
}

pub fn place(address: &str) -> Option<(&str, u16)> {
    let address = address.split(['?', '#']).next()?;
    let (_protocol, place) = address.split_once('/')?;
    let (host, port) = place.rsplit_once(':')?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    Some((host, port.parse().ok()?))
}

/// Tries the port by TCP, which every robot has open: with keys it offers TLS beside QUIC.
fn probe_port((host, port): (&str, u16)) -> AddressState {
    let Some(found) = look_up(host, port) else {
        return AddressState::UnknownName;
    };
    match TcpStream::connect_timeout(&found, PROBE_TIMEOUT) {
        Ok(_closed_at_once) => AddressState::WrongProtocol,
        Err(why) if why.kind() == ErrorKind::ConnectionRefused => AddressState::Refused,
        Err(_) => AddressState::Silent,
    }
}

fn look_up(host: &str, port: u16) -> Option<SocketAddr> {
    if let Ok(ip) = host.parse::<IpAddr>() {
        return Some(SocketAddr::new(ip, port));
    }
    let (sender, found): (SyncSender<Option<SocketAddr>>, _) = sync_channel(1);
    let name = host.to_owned();
    // The system's lookup cannot be interrupted.
    thread::spawn(move || {
        let found = (name.as_str(), port).to_socket_addrs();
        let first = found.ok().and_then(|mut all| all.next());
        if sender.send(first).is_err() {
            tracing::debug!(name, "the lookup finished too late");
        }
    });
    found.recv_timeout(LOOKUP_TIMEOUT).ok().flatten()
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use network::endpoints::Channel;

    use super::*;

    fn of(address: &str) -> AddressState {
        let why = LinkError::Open {
            channel: Channel::Control,
            endpoints: address.to_owned(),
            why: "no".into(),
        };
        AddressState::of(&why, address)
    }

    #[test]
    fn causes_of_failure_are_distinguished() {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let address = format!("tcp/{}", listener.local_addr().unwrap());
        assert_eq!(of(&address), AddressState::WrongProtocol);
        drop(listener);
        assert_eq!(of(&address), AddressState::Refused);
        // RFC 6761: this name never exists.
        let unknown = "tcp/nosuchhost.invalid:7447";
        assert_eq!(of(unknown), AddressState::UnknownName);
        let why = LinkError::UnexpectedPeer {
            endpoints: "quic/boat:7447".to_owned(),
            name: "eve".to_owned(),
        };
        let AddressState::Problem(words) = AddressState::of(&why, "quic/boat:7447") else {
            panic!("a stranger is a problem");
        };
        assert!(words.contains("certificate of eve"), "{words}");
    }

    #[test]
    fn silent_vehicle_differs_from_empty_router() {
        let access_denied = |by_quic| AddressState::AccessDenied {
            robot: "scout".parse().unwrap(),
            by_quic,
        };
        for (name, protocol, expected) in [
            (Some("vehicle:scout"), "quic", access_denied(true)),
            (Some("vehicle:scout"), "tls", access_denied(false)),
            (Some("router:"), "quic", AddressState::NoRobot),
            (None, "tcp", AddressState::NoRobot),
        ] {
            assert_eq!(AddressState::of_silent(name, protocol), expected);
        }
        let words = access_denied(true).complaint("quic/boat:7447").unwrap();
        assert_eq!(
            words,
            "scout answers at quic/boat:7447 but denies access: you are not on its list of operators; \
             access is granted within two seconds of being added"
        );
        let words = access_denied(false).complaint("quic/boat:7448").unwrap();
        assert!(
            words.ends_with("; or this is its port for tiles"),
            "{words}"
        );
    }

    #[test]
    fn an_endpoint_has_a_place() {
        for (address, expected) in [
            ("tcp/boat:7447", Some(("boat", 7447))),
            ("quic/10.0.0.5:9?mixed_rel=1#a=b", Some(("10.0.0.5", 9))),
            ("tcp/[::1]:7447", Some(("::1", 7447))),
            ("boat:7447", None),
            ("tcp/boat", None),
        ] {
            assert_eq!(place(address), expected, "{address}");
        }
    }

    #[test]
    fn complaints_cover_failures_only() {
        let complaint = |state: AddressState| state.complaint("tcp/boat:7447");
        for quiet in [
            AddressState::Asking,
            AddressState::Found,
            AddressState::NoRobot,
        ] {
            assert_eq!(complaint(quiet), None);
        }
        let nobody = Some("no answer at tcp/boat:7447; trying again".to_owned());
        assert_eq!(complaint(AddressState::Silent), nobody);
        assert_eq!(complaint(AddressState::Refused), nobody);
        let unknown = Some("the name in tcp/boat:7447 is not known".to_owned());
        assert_eq!(complaint(AddressState::UnknownName), unknown);
    }
}
