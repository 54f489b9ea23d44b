//! Why there is no link.

use std::path::PathBuf;

use super::endpoints::Channel;
use crate::credentials::CredentialsError;

#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    #[error(
        "endpoint {0:?} is not `PROTOCOL/HOST:PORT` with a port from 1 to 65534, for example tcp/192.168.1.20:7447, or quic/192.168.1.20:7447 with --keys"
    )]
    Endpoint(String),
    #[error("endpoint {endpoint:?}: {why}")]
    Protocol { endpoint: String, why: &'static str },
    #[error(transparent)]
    Credentials(#[from] CredentialsError),
    #[error(
        "whoever answers at {endpoints} shows the certificate of {name}, not of a vehicle or router of this fleet"
    )]
    UnexpectedPeer { endpoints: String, name: String },
    #[error("{path}: not a Zenoh configuration: {why}", path = path.display(), why = without_source_places(why))]
    Config { path: PathBuf, why: zenoh::Error },
    #[error("{}", not_opened(*channel, endpoints, why))]
    Open {
        channel: Channel,
        endpoints: String,
        why: zenoh::Error,
    },
    #[error("Zenoh does not take the setting {key}: {why}", why = without_source_places(why))]
    Setting {
        key: &'static str,
        why: zenoh::Error,
    },
    #[error("Zenoh refused {what}: {why}", why = without_source_places(why))]
    Declare { what: String, why: zenoh::Error },
    #[error("the operating system gives no random numbers: {0}")]
    NoRandomness(getrandom::Error),
    #[error("no thread can be had for the link: {0}")]
    Thread(std::io::Error),
}

/// The error without the places in the library's source (`at /…/orchestrator.rs:388.`), which help no user.
pub fn without_source_places(why: &zenoh::Error) -> String {
    let why = why.to_string();
    let mut words: Vec<&str> = Vec::new();
    for word in why.split(' ') {
        let is_place = word.contains(".rs:") && words.last() == Some(&"at");
        if is_place {
            words.pop();
        } else {
            words.push(word);
        }
    }
    words.join(" ").trim_end_matches('.').to_owned()
}

/// What the system says of a port that somebody else has.
const ADDRESS_IN_USE: &str = "Address already in use";

fn not_opened(channel: Channel, endpoints: &str, why: &zenoh::Error) -> String {
    let why = without_source_places(why);
    if why.contains(ADDRESS_IN_USE) {
        // What is set for Zenoh behind an address is nobody's concern.
        let places: Vec<_> = endpoints
            .split(", ")
            .filter_map(|endpoint| endpoint.split(['?', '#']).next())
            .collect();
        let port = match channel {
            Channel::Control => "the port",
            Channel::Bulk => "the port for tiles, which is the one after that for control,",
        };
        return format!(
            "another program has {port} already: {}. End that one, or choose another port with --listen",
            places.join(", ")
        );
    }
    format!(
        "the {channel:?} session cannot be opened ({endpoints}): {why}. --listen names another endpoint"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_error_names_a_place_in_the_source_of_a_library() {
        for (why, plain) in [
            (
                "Unable to connect to any of [tcp/h:1]. Timeout! at /root/.cargo/registry/src/zenoh-1.10.2/src/o.rs:388.",
                "Unable to connect to any of [tcp/h:1]. Timeout!",
            ),
            (
                "no at a.rs:1. - Caused by yes at /b/c.rs:22.",
                "no - Caused by yes",
            ),
            ("looked at rs: nothing", "looked at rs: nothing"),
        ] {
            assert_eq!(without_source_places(&why.into()), plain);
            let error = LinkError::Declare {
                what: "a".to_owned(),
                why: why.into(),
            };
            assert_eq!(error.to_string(), format!("Zenoh refused a: {plain}"));
        }
    }

    #[test]
    fn a_port_that_is_taken_is_said_to_be_and_what_to_do() {
        let error_text = |channel, why: &str| {
            let error = LinkError::Open {
                channel,
                endpoints: "quic/127.0.0.1:7447?mixed_rel=1, tls/127.0.0.1:7447#so_sndbuf=1"
                    .to_owned(),
                why: why.into(),
            };
            error.to_string()
        };
        let message = |why| error_text(Channel::Control, why);
        let of_tiles = error_text(Channel::Bulk, "Address already in use (os error 98)");
        assert!(of_tiles.contains("for tiles, which is the one after that for control, already"));
        assert_eq!(
            message(
                "Can not create a new listener: Address already in use (os error 98) at a.rs:418."
            ),
            "another program has the port already: quic/127.0.0.1:7447, tls/127.0.0.1:7447. End that one, or choose \
             another port with --listen"
        );
        assert!(message("no such host").ends_with(
            "mixed_rel=1, tls/127.0.0.1:7447#so_sndbuf=1): no such host. --listen names another endpoint"
        ));
    }
}
