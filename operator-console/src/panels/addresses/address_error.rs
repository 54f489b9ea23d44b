//! What is wrong with an address that was typed, in a sentence or two: what, where, and what to type instead.

use std::net::Ipv6Addr;

use robot_edge::link::endpoints::DEFAULT_PORT;

/// A host where none was typed that could be one.
const SOME_HOST: &str = "192.168.1.20";
/// The last port is of no use: tiles come by the next one.
const LAST_PORT: u16 = u16::MAX - 1;

/// Names of protocols that robots are asked by.
const PROTOCOLS: [&str; 3] = ["tcp", "quic", "tls"];

/// What is wrong with `typed`, which is no address to ask at; `has_keys`: this console asks with keys.
pub(super) fn address_error(typed: &str, has_keys: bool) -> String {
    if typed.contains(char::is_whitespace) {
        return format!(
            "There is a space in it. Type host:port without one, for example {SOME_HOST}:{DEFAULT_PORT}."
        );
    }
    let whole = typed.trim_end_matches('/');
    let Some((protocol, place)) = whole.split_once('/') else {
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
        _ if is_port(place) => {
            format!("Between host and port stands a colon. Type {protocol}:{place}.")
        }
        _ => {
            let protocol = &whole[..whole.len() - host.len()];
            format!("No robot is asked by {protocol}. Type {right} alone.")
        }
    }
}

/// Of the host and the port, which may stand behind a protocol.
fn of_place(typed: &str, place: &str, has_keys: bool) -> String {
    let is_usual = |sign: char| sign.is_alphanumeric() || "-_.:[]%/".contains(sign);
    if let Some(sign) = place.chars().find(|sign| !is_usual(*sign)) {
        return format!(
            "A {sign} cannot be in an address. Type host:port, for example {SOME_HOST}:{DEFAULT_PORT}."
        );
    }
    let right = example(place.trim_end_matches('/'));
    if place.contains('/') {
        return format!("There is a / too many in it. Type host:port, for example {right}.");
    }
    let is_ipv6 = place.starts_with('[') || ipv6(place).is_some();
    if is_ipv6 && has_keys {
        return "A robot with keys is not asked at an IPv6 address. Type its name or its IPv4 address."
            .to_owned();
    }
    if ipv6(place).is_some() {
        return format!("An IPv6 address stands in brackets. Type {right}.");
    }
    let (host, port) = parts(place);
    if host.is_empty() {
        return format!("The host is missing. Type host:port, for example {right}.");
    }
    if host.contains(['[', ']']) && !is_in_brackets(host) {
        return format!(
            "Brackets stand around an IPv6 address, and a colon and the port behind them. Type for example [::1]:{DEFAULT_PORT}."
        );
    }
    if host.contains(':') && !host.starts_with('[') {
        return format!("There is a : too many in it. Type host:port, for example {right}.");
    }
    match port.map(str::parse) {
        None => {
            let typed = typed.trim_end_matches([':', '/']);
            format!(
                "The port is missing: for example {typed}:{DEFAULT_PORT}, which is usual for robots."
            )
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

fn is_port(text: &str) -> bool {
    text.parse()
        .is_ok_and(|port| (1..=LAST_PORT).contains(&port))
}

fn is_in_brackets(host: &str) -> bool {
    let inner = host
        .strip_prefix('[')
        .and_then(|host| host.strip_suffix(']'));
    inner.is_some_and(|inner| inner.parse::<Ipv6Addr>().is_ok())
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

/// An IPv6 address without brackets, and the port behind it where there is one.
fn ipv6(place: &str) -> Option<(&str, u16)> {
    let split = place.rsplit_once(':');
    let split = split.filter(|(host, port)| host.parse::<Ipv6Addr>().is_ok() && is_port(port));
    match split.and_then(|(host, port)| Some((host, port.parse().ok()?))) {
        Some(found) => Some(found),
        None => place
            .parse::<Ipv6Addr>()
            .is_ok()
            .then_some((place, DEFAULT_PORT)),
    }
}

/// The address that may have been meant.
fn example(place: &str) -> String {
    if let Some((host, port)) = ipv6(place) {
        return format!("[{host}]:{port}");
    }
    let (host, port) = parts(place);
    let port = port.and_then(|port| port.parse().ok());
    let port = port.filter(|port| (1..=LAST_PORT).contains(port));
    let port = port.unwrap_or(DEFAULT_PORT);
    let is_host = !host.is_empty() && !host.contains(['/', ':', '[', ']']);
    if is_host || is_in_brackets(host) {
        return format!("{host}:{port}");
    }
    // Colons too many, or one behind a protocol.
    let pieces = host.split(':').filter(|piece| !piece.is_empty());
    let pieces: Vec<_> = pieces.filter(|piece| !PROTOCOLS.contains(piece)).collect();
    match pieces[..] {
        [host, port] if is_port(port) && !host.contains(['/', '[', ']']) => {
            format!("{host}:{port}")
        }
        _ => format!("{SOME_HOST}:{port}"),
    }
}

#[cfg(test)]
mod tests {
    use robot_edge::link::endpoints::check_console;

    use super::*;

    #[test]
    fn what_is_to_be_typed_is_an_address_of_the_same_host() {
        for (typed, has_keys, right) in [
            ("boat::7447", false, "boat:7447"),
            ("tcp:192.168.1.21:7448", false, "192.168.1.21:7448"),
            ("boat/7448", false, "boat:7448"),
            ("boat:7448/", false, "boat:7448"),
            ("http://boat:80/", false, "boat:80"),
            ("tcp/boat:7448", true, "boat:7448"),
            ("quic/boat:7448/", false, "boat:7448"),
            ("fe80::1", false, "[fe80::1]:7447"),
            ("fe80::1:7450", false, "[fe80::1]:7450"),
            ("[::1]7447", false, "[::1]:7447"),
            ("[::1:7447", false, "[::1]:7447"),
            ("a:b:c:d", false, "192.168.1.20:7447"),
        ] {
            let says = address_error(typed, has_keys);
            let said = says.trim_end_matches('.').trim_end_matches(" alone");
            assert_eq!(said.rsplit(' ').next(), Some(right), "{says}");
            let protocol = if has_keys { "quic" } else { "tcp" };
            check_console(&format!("{protocol}/{right}"), has_keys).unwrap();
        }
        for typed in ["[::1]", "[::1]:9", "fe80::1", "fe80::1:9", "quic/[::1]:9"] {
            let says = address_error(typed, true);
            assert!(says.contains("not asked at an IPv6 address"), "{says}");
        }
    }

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
                "tcp/127.0.0.1;7447",
                false,
                "A ; cannot be in an address. Type host:port, for example 192.168.1.20:7447.",
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
            assert_eq!(address_error(typed, has_keys), says, "{typed}");
        }
    }
}
