//! By what way messages come.

use zenoh::{Session, Wait as _};

/// The way of the control session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// QUIC: secured, and what is lost holds up nothing.
    Quic,
    /// TLS, as it was asked for.
    Tls,
    /// TLS, where QUIC was asked for and did not answer.
    TlsInstead,
    /// TCP, open to whoever reaches it.
    Tcp,
    /// Another, from a Zenoh configuration.
    Other,
}

impl Transport {
    /// The way of the first link that `session` has, where `asked` are the endpoints it was to connect to; none while it
    /// has no link.
    pub(super) fn of(session: &Session, asked: &[String]) -> Option<Self> {
        let link = session.info().links().wait().next()?;
        let locator = link.dst().to_string();
        Some(Self::of_locator(&locator, asked))
    }

    fn of_locator(locator: &str, asked: &[String]) -> Self {
        let (protocol, _) = locator.split_once('/').unwrap_or_default();
        match protocol {
            "quic" => Self::Quic,
            "tls" if asked.iter().any(|endpoint| endpoint.starts_with("quic/")) => Self::TlsInstead,
            "tls" => Self::Tls,
            "tcp" => Self::Tcp,
            _ => Self::Other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_way_that_was_not_asked_for_is_told() {
        let quic = ["quic/boat:7447".to_owned()];
        let tls = ["tls/boat:7447".to_owned()];
        let of = |locator: &str, asked: &[String]| Transport::of_locator(locator, asked);
        assert_eq!(of("quic/10.0.0.5:7447", &quic), Transport::Quic);
        assert_eq!(of("tls/10.0.0.5:7447", &quic), Transport::TlsInstead);
        assert_eq!(of("tls/10.0.0.5:7447", &tls), Transport::Tls);
        assert_eq!(of("tcp/10.0.0.5:7447", &[]), Transport::Tcp);
        assert_eq!(of("unixsock-stream/a", &[]), Transport::Other);
    }
}
