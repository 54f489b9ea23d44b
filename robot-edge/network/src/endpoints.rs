//! Where the two sessions of a robot are.

use super::LinkError;

/// The port of control, unless set otherwise; bulk is the next.
pub const DEFAULT_PORT: u16 = 7447;
/// Where control listens unless set otherwise: this machine only.
pub const DEFAULT_CONTROL: &str = "tcp/127.0.0.1:7447";
/// The same with keys.
pub const DEFAULT_SECURED_CONTROL: &str = "quic/127.0.0.1:7447";

/// Bulk's own buffer in the kernel: what is in it can be neither replaced nor overtaken.
const BULK_SEND_BUFFER: &str = "so_sndbuf=32768";
/// Beside it for TLS: a handshake that takes longer is given up, so that silent strangers do not gather.
const BULK_BY_TLS: &str = "so_sndbuf=32768;tls_handshake_timeout_ms=4000";
const CONTROL_BY_TLS: &str = "tls_handshake_timeout_ms=4000";
/// Of QUIC: what is sent best effort goes as datagrams, which are never sent again and wait for nothing that was lost.
const DATAGRAMS: &str = "mixed_rel=1";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Small messages; found by scouting.
    Control,
    /// Tiles; its address follows from control's, so it never scouts.
    Bulk,
}

/// An endpoint in its parts: `PROTOCOL/HOST:PORT?METADATA#CONFIG`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Endpoint<'a> {
    protocol: &'a str,
    host: &'a str,
    port: u16,
    metadata: &'a str,
    config: &'a str,
}

impl<'a> Endpoint<'a> {
    fn parse(text: &'a str) -> Result<Self, LinkError> {
        let refused = || LinkError::Endpoint(text.to_owned());
        let (rest, config) = text.split_once('#').unwrap_or((text, ""));
        let (address, metadata) = rest.split_once('?').unwrap_or((rest, ""));
        let (protocol, place) = address.split_once('/').ok_or_else(refused)?;
        let (host, port) = place.rsplit_once(':').ok_or_else(refused)?;
        let port = port.parse().ok().ok_or_else(refused)?;
        let is_bracketed = host.starts_with('[') && host.ends_with(']');
        let is_host = !host.is_empty()
            && !host.contains(|sign: char| sign == '/' || sign.is_whitespace())
            && (is_bracketed || !host.contains(':'));
        if !is_host || port == 0 || port == u16::MAX {
            return Err(refused());
        }
        Ok(Self {
            protocol,
            host,
            port,
            metadata,
            config,
        })
    }

    /// The endpoint of tiles that belongs to this one of control.
    fn bulk(&self) -> Self {
        Self {
            protocol: self.protocol,
            host: self.host,
            port: self.port + 1,
            metadata: self.metadata,
            config: self.config,
        }
    }

    /// The same place by TLS, over TCP.
    fn by_tls(&self) -> Self {
        Self {
            protocol: "tls",
            metadata: "",
            ..self.clone()
        }
    }

    fn with_metadata(self, metadata: &'a str) -> Self {
        if self.metadata.is_empty() {
            Self { metadata, ..self }
        } else {
            self
        }
    }

    fn with_config(self, config: &'a str) -> Self {
        if self.config.is_empty() {
            Self { config, ..self }
        } else {
            self
        }
    }

    fn text(&self) -> String {
        let Self {
            protocol,
            host,
            port,
            metadata,
            config,
        } = self;
        let part = |sign: &str, part: &str| {
            if part.is_empty() {
                String::new()
            } else {
                format!("{sign}{part}")
            }
        };
        format!(
            "{protocol}/{host}:{port}{}{}",
            part("?", metadata),
            part("#", config)
        )
    }
}

/// Fails where an endpoint is none, or does not fit the protection of the link.
///
/// QUIC is never offered without mutual TLS: its listener sets up connections one after another (Zenoh #2719), and a
/// single client that is silent would keep all others out.
pub fn check(control: &str, has_keys: bool) -> Result<(), LinkError> {
    let endpoint = Endpoint::parse(control)?;
    let why = match (has_keys, endpoint.protocol) {
        (true, "quic" | "tls") | (false, "tcp") => return Ok(()),
        (true, _) => "with --keys it is quic/HOST:PORT, or tls/HOST:PORT where UDP is blocked",
        (false, "quic" | "tls") => "QUIC and TLS need --keys",
        (false, _) => "without --keys it is tcp/HOST:PORT",
    };
    Err(LinkError::Protocol {
        endpoint: control.to_owned(),
        why,
    })
}

/// Fails where a console could never connect to an endpoint.
pub fn check_console(control: &str, has_keys: bool) -> Result<(), LinkError> {
    attempts(Channel::Control, &[control.to_owned()], has_keys).map(drop)
}

/// Where a side listens for `channel`, given control endpoints: bulk is the same host, the next port.
///
/// Where control is QUIC, TLS is offered beside it at the same port of TCP, for networks that carry no UDP. Tiles go by
/// TLS: QUIC would share the console's one congestion window with commands, and has no buffer to keep small.
pub fn listeners(
    channel: Channel,
    controls: &[String],
    has_keys: bool,
) -> Result<Vec<String>, LinkError> {
    let mut all = Vec::new();
    for control in controls {
        check(control, has_keys)?;
        let endpoint = Endpoint::parse(control)?;
        match (channel, endpoint.protocol) {
            (Channel::Control, "quic") => {
                all.push(endpoint.clone().with_metadata(DATAGRAMS).text());
                all.push(endpoint.by_tls().with_config(CONTROL_BY_TLS).text());
            }
            (Channel::Control, "tls") => {
                all.push(endpoint.with_config(CONTROL_BY_TLS).text());
            }
            (Channel::Control, _) => all.push(control.clone()),
            (Channel::Bulk, "quic" | "tls") => {
                all.push(endpoint.bulk().by_tls().with_config(BULK_BY_TLS).text());
            }
            (Channel::Bulk, _) => all.push(endpoint.bulk().with_config(BULK_SEND_BUFFER).text()),
        }
    }
    Ok(all)
}

/// Where a side connects for `channel`, given control endpoints: what is tried first, and what where that fails.
pub fn attempts(
    channel: Channel,
    controls: &[String],
    has_keys: bool,
) -> Result<Vec<Vec<String>>, LinkError> {
    let (mut first, mut second) = (Vec::new(), Vec::new());
    for control in controls {
        check(control, has_keys)?;
        let endpoint = Endpoint::parse(control)?;
        if has_keys && endpoint.host.starts_with('[') {
            // It takes the brackets for a part of the name that the certificate must have.
            return Err(LinkError::Protocol {
                endpoint: control.clone(),
                why: "Zenoh cannot check a certificate against an IPv6 address: connect to a name, or to an IPv4 address",
            });
        }
        match (channel, endpoint.protocol) {
            (Channel::Control, "quic") => {
                first.push(endpoint.clone().with_metadata(DATAGRAMS).text());
                second.push(endpoint.by_tls().text());
            }
            (Channel::Control, _) => first.push(control.clone()),
            (Channel::Bulk, "quic") => first.push(endpoint.bulk().by_tls().text()),
            (Channel::Bulk, _) => first.push(endpoint.bulk().text()),
        }
    }
    let mut attempts = vec![first];
    if !second.is_empty() {
        attempts.push(second);
    }
    Ok(attempts)
}

/// Where one router listens for both sessions of everybody.
pub fn listeners_of_router(host: &str, port: u16) -> Vec<String> {
    let endpoint = Endpoint {
        protocol: "quic",
        host,
        port,
        metadata: DATAGRAMS,
        config: "",
    };
    vec![
        endpoint.text(),
        endpoint.by_tls().with_config(CONTROL_BY_TLS).text(),
        endpoint.bulk().by_tls().with_config(BULK_BY_TLS).text(),
    ]
}

pub fn bulk_endpoint(control: &str) -> Result<String, LinkError> {
    Ok(Endpoint::parse(control)?.bulk().text())
}

/// Whether only this machine can reach a listener at `endpoint`.
pub fn is_loopback(endpoint: &str) -> bool {
    Endpoint::parse(endpoint).is_ok_and(|endpoint| {
        let host = endpoint.host.trim_start_matches('[').trim_end_matches(']');
        host == "localhost"
            || host
                .parse::<std::net::IpAddr>()
                .is_ok_and(|ip| ip.is_loopback())
    })
}

/// Host and port of an endpoint such as `quic/boat:7447`.
pub fn place(address: &str) -> Option<(&str, u16)> {
    let address = address.split(['?', '#']).next()?;
    let (_protocol, place) = address.split_once('/')?;
    let (host, port) = place.rsplit_once(':')?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    Some((host, port.parse().ok()?))
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
            let attempts = |channel| attempts(channel, &[control.to_owned()], false).unwrap();
            assert_eq!(attempts(Channel::Bulk), [[bulk]]);
            assert_eq!(attempts(Channel::Control), [[control]]);
        }
        for control in [
            "",
            "tcp/host",
            "host:7447",
            "tcp/host:65535",
            "tcp/host:0",
            "tcp/host:port",
            "tcp/:7447",
            "tcp/two words:7447",
            "tcp/fe80::1:7447",
            "http://host:80",
        ] {
            let error = bulk_endpoint(control).unwrap_err().to_string();
            assert!(error.contains("PROTOCOL/HOST:PORT"), "{error}");
        }
    }

    #[test]
    fn with_keys_control_is_datagrams_in_quic_and_tls_beside_it() {
        let of = |control: &str| {
            let controls = [control.to_owned()];
            let listen = |channel| listeners(channel, &controls, true).unwrap();
            let connect = |channel| attempts(channel, &controls, true).unwrap();
            (
                listen(Channel::Control),
                listen(Channel::Bulk),
                connect(Channel::Control),
                connect(Channel::Bulk),
            )
        };
        let (control, bulk, to_control, to_bulk) = of("quic/boat.example:7447#iface=eth0");
        let (quic, tls) = (
            "quic/boat.example:7447?mixed_rel=1#iface=eth0",
            "tls/boat.example:7447#iface=eth0",
        );
        assert_eq!(control, [quic, tls]);
        assert_eq!(to_control, [[quic], [tls]]);
        assert_eq!(bulk, ["tls/boat.example:7448#iface=eth0"]);
        assert_eq!(to_bulk, [["tls/boat.example:7448#iface=eth0"]]);
        let (control, bulk, to_control, _) = of("tls/0.0.0.0:7447");
        assert_eq!(control, ["tls/0.0.0.0:7447#tls_handshake_timeout_ms=4000"]);
        assert_eq!(to_control, [["tls/0.0.0.0:7447"]]);
        assert_eq!(
            bulk,
            ["tls/0.0.0.0:7448#so_sndbuf=32768;tls_handshake_timeout_ms=4000"]
        );
    }

    #[test]
    fn a_bracketed_address_is_listened_at_and_not_connected_to_with_keys() {
        let controls = ["quic/[::]:7447".to_owned()];
        assert!(listeners(Channel::Control, &controls, true).is_ok());
        let error = attempts(Channel::Control, &controls, true).unwrap_err();
        assert!(error.to_string().contains("IPv6"), "{error}");
        assert!(attempts(Channel::Control, &["tcp/[::1]:7447".to_owned()], false).is_ok());
    }

    #[test]
    fn keys_and_protocols_go_together() {
        for (endpoint, has_keys, says) in [
            ("quic/[::1]:7447", false, "need --keys"),
            ("tls/127.0.0.1:7447", false, "need --keys"),
            ("tcp/127.0.0.1:7447", true, "quic/HOST:PORT"),
            ("udp/127.0.0.1:7447", false, "tcp/HOST:PORT"),
            ("tcp/host", true, "PROTOCOL/HOST:PORT"),
        ] {
            let error = check(endpoint, has_keys).unwrap_err().to_string();
            assert!(error.contains(says), "{endpoint}: {error}");
        }
        assert!(check(DEFAULT_SECURED_CONTROL, true).is_ok());
        assert!(check(DEFAULT_CONTROL, false).is_ok());
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
