//! What is wrong with an address that was typed, in a sentence or two: what, where, and what to type instead.

use std::net::Ipv6Addr;

use robot_edge::link::endpoints::DEFAULT_PORT;

/// A host where none was typed that could be one.
const SOME_HOST: &str = "192.168.1.20";
/// The last port is of no use: tiles come by the next one.
const LAST_PORT: u16 = u16::MAX - 1;

/// What is wrong with `typed`, which is no address to ask at; `has_keys`: this console asks with keys.
pub(super) fn mistake(typed: &str, has_keys: bool) -> String {
    if typed.contains(char::is_whitespace) {
        return format!(
            "There is a space in it. Type host:port without one, for example {SOME_HOST}:{DEFAULT_PORT}."
        );
    }
    let Some((protocol, place)) = typed.split_once('/') else {
        return of_place(typed, typed, has_keys);
    };
    // As in web addresses.
    let host = place.trim_start_matches('/');
    let right = example(host);
    match (protocol, has_keys) {
        ("tcp", false) | ("quic" | "tls", true) => of_place(typed, place, has_keys),
        ("tcp", true) => format!(
            "TCP is for robots without keys, and this console was started with --keys. Type {right} alone."
        ),
        ("quic" | "tls", false) => format!(
            "{} needs keys, and this console was started without --keys. Type {right} alone.",
            protocol.to_uppercase()
        ),
        _ => {
            let protocol = &typed[..typed.len() - host.len()];
            format!("No robot is asked by {protocol}. Type {right} alone.")
        }
    }
}

/// Of the host and the port, which may stand behind a protocol.
fn of_place(typed: &str, place: &str, has_keys: bool) -> String {
    let right = example(place);
    if place.contains('/') {
        return format!("There is a / too many in it. Type host:port, for example {right}.");
    }
    let (host, port) = parts(place);
    if host.is_empty() {
        return format!("The host is missing. Type host:port, for example {right}.");
    }
    if host.contains(':') && !host.starts_with('[') {
        return format!("An IPv6 address stands in brackets. Type {right}.");
    }
    match port.map(str::parse) {
        None => {
            let typed = typed.trim_end_matches(':');
            format!(
                "The port is missing: for example {typed}:{DEFAULT_PORT}, which is usual for robots."
            )
        }
        Some(Ok(1..=LAST_PORT)) if has_keys && host.starts_with('[') => {
            "A robot with keys is not asked at an IPv6 address. Type its name or its IPv4 address."
                .to_owned()
        }
        Some(Ok(1..=LAST_PORT)) => {
            format!("This is no address. Type host:port, for example {right}.")
        }
        Some(Ok(_) | Err(_)) => {
            let port = port.unwrap_or_default();
            format!(
                "The port is \"{port}\", and must be a number from 1 to {LAST_PORT}. Type for example {right}."
            )
        }
    }
}

/// The host, and the port behind it where there is one. What has several colons is a host whole.
fn parts(place: &str) -> (&str, Option<&str>) {
    match place.rsplit_once(':') {
        Some((host, port)) if host.ends_with(']') || !host.contains(':') => {
            (host, Some(port).filter(|port| !port.is_empty()))
        }
        Some(_) | None => (place, None),
    }
}

/// The address that may have been meant.
fn example(place: &str) -> String {
    let (host, port) = parts(place);
    let is_host = !host.is_empty() && !host.contains('/');
    let port = port.and_then(|port| port.parse().ok());
    let port = port.filter(|port| (1..=LAST_PORT).contains(port));
    let port = port.unwrap_or(DEFAULT_PORT);
    if !is_host {
        return format!("{SOME_HOST}:{port}");
    }
    if !host.contains(':') || host.starts_with('[') {
        return format!("{host}:{port}");
    }
    // What stands behind the last colon is the port where the rest is an address without it.
    let split = host.rsplit_once(':');
    let split = split.filter(|(host, _)| host.parse::<Ipv6Addr>().is_ok());
    match split.and_then(|(host, port)| Some((host, port.parse::<u16>().ok()?))) {
        Some((host, port)) => format!("[{host}]:{port}"),
        None => format!("[{host}]:{DEFAULT_PORT}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistake_is_told_with_what_to_type() {
        for (typed, has_keys, says) in [
            (
                "my boat",
                false,
                "There is a space in it. Type host:port without one, for example 192.168.1.20:7447.",
            ),
            (
                "boat",
                false,
                "The port is missing: for example boat:7447, which is usual for robots.",
            ),
            (
                "boat:",
                false,
                "The port is missing: for example boat:7447, which is usual for robots.",
            ),
            (
                "tcp/boat",
                false,
                "The port is missing: for example tcp/boat:7447, which is usual for robots.",
            ),
            (
                "[::1]",
                false,
                "The port is missing: for example [::1]:7447, which is usual for robots.",
            ),
            (
                "boat:99999",
                false,
                "The port is \"99999\", and must be a number from 1 to 65534. Type for example boat:7447.",
            ),
            (
                "tcp/boat:0",
                false,
                "The port is \"0\", and must be a number from 1 to 65534. Type for example boat:7447.",
            ),
            (
                "boat:65535",
                false,
                "The port is \"65535\", and must be a number from 1 to 65534. Type for example boat:7447.",
            ),
            (
                "boat:port",
                false,
                "The port is \"port\", and must be a number from 1 to 65534. Type for example boat:7447.",
            ),
            (
                ":7447",
                false,
                "The host is missing. Type host:port, for example 192.168.1.20:7447.",
            ),
            (
                "fe80::1:7450",
                false,
                "An IPv6 address stands in brackets. Type [fe80::1]:7450.",
            ),
            (
                "fe80::1",
                false,
                "An IPv6 address stands in brackets. Type [fe80::1]:7447.",
            ),
            (
                "tcp/a/b:1",
                false,
                "There is a / too many in it. Type host:port, for example 192.168.1.20:1.",
            ),
            (
                "http://boat:80",
                false,
                "No robot is asked by http://. Type boat:80 alone.",
            ),
            (
                "udp/boat",
                false,
                "No robot is asked by udp/. Type boat:7447 alone.",
            ),
            (
                "quic/boat:9",
                false,
                "QUIC needs keys, and this console was started without --keys. Type boat:9 alone.",
            ),
            (
                "tcp/boat:9",
                true,
                "TCP is for robots without keys, and this console was started with --keys. Type boat:9 alone.",
            ),
            (
                "[::1]:9",
                true,
                "A robot with keys is not asked at an IPv6 address. Type its name or its IPv4 address.",
            ),
        ] {
            assert_eq!(mistake(typed, has_keys), says, "{typed}");
        }
    }
}
