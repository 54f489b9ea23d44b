//! Peers that may not connect.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use network::LinkError;
use network::clock;
use network::credentials::Credentials;
use network::endpoints::Channel;
use network::sessions::{self, Endpoints, Side};
use rcgen::{
    CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair,
    date_time_ymd,
};
use zenoh::{Config, Wait as _};

use super::{person, vehicle};
use crate::fleet::{Fleet, quic, text};
use crate::processes::{free_port, wait_until};

const DAY: i64 = 86_400;

/// Whether a stranger's own program can connect with these files.
fn try_to_connect(endpoint: &str, authority: &Path, own: Option<&Path>) -> bool {
    let mut config = Config::default();
    let mut set = |key: &str, value: serde_json::Value| {
        config.insert_json5(key, &value.to_string()).unwrap();
    };
    set("mode", "client".into());
    set("connect/endpoints", vec![endpoint].into());
    set("connect/timeout_ms", 1500.into());
    set("scouting/multicast/enabled", false.into());
    set(
        "transport/link/tls/root_ca_certificate",
        authority.to_str().into(),
    );
    if let Some(own) = own {
        set("transport/link/tls/enable_mtls", true.into());
        for (key, file) in [
            ("connect_certificate", "link.pem"),
            ("connect_private_key", "link.key.pem"),
        ] {
            let path = own.join(file);
            set(&format!("transport/link/tls/{key}"), path.to_str().into());
        }
    }
    let Ok(session) = zenoh::open(config).wait() else {
        return false;
    };
    // In TLS 1.3 a client learns of its refusal after the handshake.
    let is_connected = session.info().peers_zid().wait().count() > 0;
    session.close().wait().unwrap();
    is_connected
}

/// A person's folder with a certificate of the fleet's authority, valid from and until some seconds from
/// now.
fn certificate(fleet: &Fleet, name: &str, [from_s, until_s]: [i64; 2]) -> PathBuf {
    let authority = fleet.root().join("authority");
    let key = KeyPair::from_pem(&text(authority.join("ca.key.pem"))).unwrap();
    let issuer = Issuer::from_ca_cert_pem(&text(authority.join("ca.pem")), key).unwrap();
    let mut params = CertificateParams::default();
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, name);
    params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ClientAuth];
    let at = |seconds: i64| {
        let now = clock::seconds_since_1970();
        date_time_ymd(1970, 1, 1) + Duration::from_secs(now.checked_add_signed(seconds).unwrap())
    };
    (params.not_before, params.not_after) = (at(from_s), at(until_s));
    let own = KeyPair::generate().unwrap();
    let folder = fleet.scratch(&format!("{name}{from_s}{until_s}"));
    fs::create_dir(&folder).unwrap();
    fs::write(
        folder.join("link.pem"),
        params.signed_by(&own, &issuer).unwrap().pem(),
    )
    .unwrap();
    fs::write(folder.join("link.key.pem"), own.serialize_pem()).unwrap();
    folder
}

#[test]
fn only_valid_certificates_of_the_fleet_connect() {
    let (fleet, others, port) = (Fleet::new(), Fleet::new(), free_port());
    let vehicle = vehicle(&fleet, &[quic(port)], &[]);
    let ca = fleet.vehicle().join("ca.pem");
    let expired = certificate(&fleet, "operator:anna", [-2 * DAY, -DAY]);
    let early = certificate(&fleet, "operator:anna", [DAY, 2 * DAY]);
    let current = certificate(&fleet, "operator:anna", [-DAY, DAY]);
    let (anna, other_anna) = (fleet.person("anna"), others.person("anna"));
    for protocol in ["quic", "tls"] {
        let to = |what: &str| format!("{protocol}/127.0.0.1:{port}{what}");
        let datagrams = if protocol == "quic" {
            "?mixed_rel=1"
        } else {
            ""
        };
        let endpoint = to(datagrams);
        for (who, own, gets_in) in [
            ("anna", Some(&anna), true),
            ("a certificate made here", Some(&current), true),
            ("nobody", None, false),
            ("another fleet's", Some(&other_anna), false),
            ("expired", Some(&expired), false),
            ("not yet good", Some(&early), false),
        ] {
            let is_in = try_to_connect(&endpoint, &ca, own.map(PathBuf::as_path));
            assert_eq!(is_in, gets_in, "{who} by {protocol}");
        }
        // A client refuses a vehicle of another fleet.
        let other_ca = other_anna.join("ca.pem");
        assert!(!try_to_connect(&endpoint, &other_ca, Some(&anna)));
    }
    let plain = format!("tcp/127.0.0.1:{port}");
    assert!(!try_to_connect(&plain, &ca, Some(&anna)));
    person(&fleet, "anna", port).close().wait().unwrap();
    vehicle.close().wait().unwrap();
}

#[test]
fn a_link_ends_when_its_certificate_does() {
    let (fleet, port) = (Fleet::new(), free_port());
    let vehicle = vehicle(&fleet, &[quic(port)], &[]);
    let folder = certificate(&fleet, "operator:anna", [-60, 4]);
    fs::copy(fleet.vehicle().join("ca.pem"), folder.join("ca.pem")).unwrap();
    fs::set_permissions(
        folder.join("link.key.pem"),
        std::os::unix::fs::PermissionsExt::from_mode(0o600),
    )
    .unwrap();
    let endpoints = Endpoints {
        connect: vec![quic(port)],
        credentials: Some(Credentials::open(&folder).unwrap()),
        ..Endpoints::default()
    };
    let session = sessions::open(Side::Console, Channel::Control, &endpoints).unwrap();
    let links = || vehicle.info().links().wait().count();
    assert!(links() > 0);
    wait_until("the link ends with its certificate", || links() == 0);
    session.close().wait().unwrap();
    vehicle.close().wait().unwrap();
}

#[test]
fn a_persons_certificate_cannot_act_as_a_vehicle() {
    let (fleet, port) = (Fleet::new(), free_port());
    // Sam listens with her own certificate.
    let impostor = Endpoints {
        listen: vec![quic(port)],
        credentials: Some(Credentials::open(&fleet.person("sam")).unwrap()),
        ..Endpoints::default()
    };
    let impostor = sessions::open(Side::Edge, Channel::Control, &impostor).unwrap();
    let endpoints = fleet.endpoints("anna", quic(port));
    let refused = sessions::open(Side::Console, Channel::Control, &endpoints).unwrap_err();
    assert!(matches!(refused, LinkError::Open { .. }), "{refused}");
    impostor.close().wait().unwrap();
}

#[test]
fn a_valid_certificate_without_a_vehicle_name_is_refused() {
    let (fleet, port) = (Fleet::new(), free_port());
    let authority = fleet.root().join("authority");
    let key = KeyPair::from_pem(&text(authority.join("ca.key.pem"))).unwrap();
    let issuer = Issuer::from_ca_cert_pem(&text(authority.join("ca.pem")), key).unwrap();
    // As signed by a public authority, which Zenoh trusts too.
    let params = CertificateParams::new(vec!["127.0.0.1".to_owned()]).unwrap();
    let own = KeyPair::generate().unwrap();
    let folder = fleet.scratch("public");
    fs::create_dir(&folder).unwrap();
    let certificate = params.signed_by(&own, &issuer).unwrap().pem();
    fs::write(folder.join("link.pem"), certificate).unwrap();
    fs::write(folder.join("link.key.pem"), own.serialize_pem()).unwrap();
    let mut config = Config::default();
    for (key, value) in [
        ("mode", serde_json::json!("peer")),
        (
            "listen/endpoints",
            serde_json::json!([format!("tls/127.0.0.1:{port}")]),
        ),
        ("scouting/multicast/enabled", serde_json::json!(false)),
        (
            "transport/link/tls/listen_certificate",
            serde_json::json!(folder.join("link.pem")),
        ),
        (
            "transport/link/tls/listen_private_key",
            serde_json::json!(folder.join("link.key.pem")),
        ),
    ] {
        config.insert_json5(key, &value.to_string()).unwrap();
    }
    let impostor = zenoh::open(config).wait().unwrap();
    let endpoints = fleet.endpoints("anna", format!("tls/127.0.0.1:{port}"));
    let refused = sessions::open(Side::Console, Channel::Control, &endpoints).unwrap_err();
    assert!(
        matches!(refused, LinkError::UnexpectedPeer { .. }),
        "{refused}"
    );
    impostor.close().wait().unwrap();
}
