//! Where the two sessions of a robot are.

use super::LinkError;

/// Where control listens unless told otherwise: this machine only.
pub const DEFAULT_CONTROL: &str = "tcp/127.0.0.1:7447";

/// What kind of session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Small messages; found by scouting.
    Control,
    /// Tiles; its address follows from control's, so it never scouts.
    Bulk,
}

/// The endpoints of `channel` that belong to control endpoints: bulk is the same host, the next port.
///
/// # Errors
/// Where an endpoint names no port, or the last one.
pub fn on_channel(channel: Channel, controls: &[String]) -> Result<Vec<String>, LinkError> {
    let endpoint = |control: &String| {
        let bulk = bulk_endpoint(control)?;
        Ok(match channel {
            Channel::Control => control.clone(),
            Channel::Bulk => bulk,
        })
    };
    controls.iter().map(endpoint).collect()
}

/// The bulk endpoint that belongs to a control endpoint.
///
/// # Errors
/// Where the endpoint names no port, or the last one.
pub fn bulk_endpoint(control: &str) -> Result<String, LinkError> {
    let refused = || LinkError::Endpoint(control.to_owned());
    let (address, options) = match control.find(['#', '?']) {
        Some(at) => control.split_at(at),
        None => (control, ""),
    };
    let (host, port) = address.rsplit_once(':').ok_or_else(refused)?;
    let port: u16 = port.parse().ok().ok_or_else(refused)?;
    let next = port
        .checked_add(1)
        .filter(|_| port != 0 && host.contains('/'))
        .ok_or_else(refused)?;
    Ok(format!("{host}:{next}{options}"))
}

/// Whether only this machine can reach a listener at `endpoint`.
pub fn is_loopback(endpoint: &str) -> bool {
    let address = endpoint.split(['#', '?']).next().unwrap_or_default();
    let host = address
        .split_once('/')
        .and_then(|(_, rest)| rest.rsplit_once(':'));
    host.is_some_and(|(host, _)| {
        let host = host.trim_start_matches('[').trim_end_matches(']');
        host == "localhost"
            || host
                .parse::<std::net::IpAddr>()
                .is_ok_and(|ip| ip.is_loopback())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bulk_is_the_next_port() {
        for (control, bulk) in [
            ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448"),
            ("tcp/[::1]:9000", "tcp/[::1]:9001"),
            (
                "tcp/boat.example:1#iface=eth0",
                "tcp/boat.example:2#iface=eth0",
            ),
        ] {
            assert_eq!(bulk_endpoint(control).unwrap(), bulk);
            assert_eq!(
                on_channel(Channel::Bulk, &[control.to_owned()]).unwrap(),
                [bulk]
            );
            assert_eq!(
                on_channel(Channel::Control, &[control.to_owned()]).unwrap(),
                [control]
            );
        }
        for control in [
            "",
            "tcp/host",
            "host:7447",
            "tcp/host:65535",
            "tcp/host:0",
            "tcp/host:port",
        ] {
            let error = bulk_endpoint(control).unwrap_err().to_string();
            assert!(error.contains("PROTOCOL/HOST:PORT"), "{error}");
        }
    }

    #[test]
    fn loopback_is_this_machine() {
        for endpoint in [
            "tcp/127.0.0.1:1",
            "tcp/[::1]:1",
            "tcp/localhost:1#so_sndbuf=1",
        ] {
            assert!(is_loopback(endpoint), "{endpoint}");
        }
        for endpoint in [
            "tcp/0.0.0.0:1",
            "tcp/[::]:1",
            "tcp/192.168.1.2:1",
            "tcp/127.0.0.1.example:1",
            "",
        ] {
            assert!(!is_loopback(endpoint), "{endpoint}");
        }
    }
}
