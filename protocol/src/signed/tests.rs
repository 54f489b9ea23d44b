use proptest::prelude::*;

use super::*;
use crate::message::{DockingChoice, MapPose, ShoreClass};

/// The keys of RFC 8410, section 10, as `openssl` writes them too.
const SECRET_PEM: &str = "-----BEGIN PRIVATE KEY-----
MC4CAQAwBQYDK2VwBCIEINTuctv5E1hK1bbY8fdp+K06/nwoy/HU++CXqI9EdVhC
-----END PRIVATE KEY-----
";
const SECRET_PEM_VERSION_2: &str = "-----BEGIN PRIVATE KEY-----
MHICAQEwBQYDK2VwBCIEINTuctv5E1hK1bbY8fdp+K06/nwoy/HU++CXqI9EdVhC
oB8wHQYKKoZIhvcNAQkJFDEPDA1DdXJkbGUgQ2hhaXJzgSEAGb9ECWmEzf6FQbrB
Z9w7lshQhqowtrbLDFw4rXAxZuE=
-----END PRIVATE KEY-----
";
const PUBLIC_PEM: &str = "-----BEGIN PUBLIC KEY-----
MCowBQYDK2VwAyEAGb9ECWmEzf6FQbrBZ9w7lshQhqowtrbLDFw4rXAxZuE=
-----END PUBLIC KEY-----
";

/// Order of the group, little-endian: without a check it could be added to the second half of a
/// signature.
const GROUP_ORDER: [u8; 32] = [
    0xED, 0xD3, 0xF5, 0x5C, 0x1A, 0x63, 0x12, 0x58, 0xD6, 0x9C, 0xF7, 0xA2, 0xDE, 0xF9, 0xDE, 0x14,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x10,
];

fn secret() -> SecretKey {
    SecretKey::from_pem(SECRET_PEM).unwrap()
}

fn anna() -> OperatorId {
    "anna".parse().unwrap()
}

fn scout() -> RobotId {
    "scout-1".parse().unwrap()
}

const HEADER: CommandHeader = CommandHeader {
    boot: BootId([7; 16]),
    token: AgeToken { n: 300, nonce: 99 },
    epoch: 4,
    seq: 1000,
};

const DRIVE: Drive = Drive {
    linear_mps: 0.5,
    lateral_mps: 0.0,
    angular_radps: -0.25,
    estop: None,
    docking: None,
    goal: None,
};

fn drive_of_anna() -> Vec<u8> {
    let (robot, operator) = (&scout(), &anna());
    sign(&secret(), Route { robot, operator }, &HEADER, &DRIVE).unwrap()
}

fn open<T: Command>(
    bytes: &[u8],
    robot: &RobotId,
    operator: &OperatorId,
) -> Result<T, SignedError> {
    Envelope::parse(bytes)?.open(Route { robot, operator }, &secret().public())
}

#[test]
fn every_kind_of_command_fits_and_survives() {
    fn check<T: Command + PartialEq + std::fmt::Debug>(command: T) -> usize {
        let longest = "a".repeat(64);
        let (robot, operator) = (&longest.parse().unwrap(), &longest.parse().unwrap());
        let bytes = sign(&secret(), Route { robot, operator }, &HEADER, &command).unwrap();
        assert_eq!(open(&bytes, robot, operator), Ok(command));
        bytes.len() - ENVELOPE_BYTES
    }
    let press = u64::MAX;
    let estop = Some(EStop { press });
    let docking = Some(DockingChoice {
        site: u32::MAX,
        vegetation: ShoreClass::Dense,
    });
    let longest_drive = Drive {
        estop,
        docking,
        goal: Some(MapPose {
            x_mm: i32::MIN,
            y_mm: i32::MIN,
            yaw_mrad: i32::MIN,
        }),
        ..DRIVE
    };
    assert_eq!(check(longest_drive), 46);
    assert_eq!(check(EStop { press }), 10);
    assert_eq!(check(Reset { estop: 1 }), 1);
    assert_eq!(check(LeaseRequest::Request), 1);
    let longest: OperatorId = "a".repeat(64).parse().unwrap();
    assert_eq!(check(LeaseRequest::HandOver(longest)), 66);
    assert_eq!(check(Setting::BudgetKbps(u32::MAX)), 6);
}

#[test]
fn a_command_is_good_for_one_robot_one_operator_and_one_key() {
    let bytes = drive_of_anna();
    let (berta, other) = ("berta".parse().unwrap(), "scout-2".parse().unwrap());
    let refused = Err(SignedError::Signature);
    assert_eq!(open::<Drive>(&bytes, &other, &anna()), refused);
    assert_eq!(open::<Drive>(&bytes, &scout(), &berta), refused);
    assert_eq!(
        open::<Reset>(&bytes, &scout(), &anna()),
        Err(SignedError::Signature)
    );
    let key = SecretKey::from_seed(&[1; 32]).public();
    let (robot, operator) = (&scout(), &anna());
    let envelope = Envelope::parse(&bytes).unwrap();
    assert_eq!(
        envelope.open::<Drive>(Route { robot, operator }, &key),
        refused
    );
    assert_eq!(
        Refusal::from(SignedError::Signature),
        Refusal::Signature,
        "it is refused as such"
    );
}

/// `estop` and `reset` of one number have the same body: only the signed topic distinguishes them.
#[test]
fn a_command_with_the_same_body_is_not_good_for_another_key() {
    let (robot, operator) = (&scout(), &anna());
    let route = Route { robot, operator };
    let bytes = sign(&secret(), route, &HEADER, &EStop { press: 3 }).unwrap();
    let envelope = Envelope::parse(&bytes).unwrap();
    assert_eq!(envelope.unverified_command(), Ok(Reset { estop: 3 }));
    let opened = envelope.open::<Reset>(route, &secret().public());
    assert_eq!(opened, Err(SignedError::Signature));
}

#[test]
fn each_part_of_the_stamp_is_signed() {
    let bytes = drive_of_anna();
    for (part, range) in [
        ("boot", 2..18),
        ("n", 18..26),
        ("nonce", 26..34),
        ("epoch", 34..42),
        ("seq", 42..50),
    ] {
        let mut moved = bytes.clone();
        moved[range.start] ^= 1;
        let envelope = Envelope::parse(&moved).unwrap();
        assert_ne!(envelope.unverified_header(), HEADER, "{part}");
        let opened = open::<Drive>(&moved, &scout(), &anna());
        assert_eq!(opened, Err(SignedError::Signature), "{part}");
    }
}

#[test]
fn a_signature_has_no_second_form() {
    let mut bytes = drive_of_anna();
    let mut carry = 0;
    for (byte, order) in bytes[82..ENVELOPE_BYTES].iter_mut().zip(GROUP_ORDER) {
        let sum = u16::from(*byte) + u16::from(order) + carry;
        (*byte, carry) = (sum as u8, sum >> 8);
    }
    assert_eq!(carry, 0);
    let opened = open::<Drive>(&bytes, &scout(), &anna());
    assert_eq!(opened, Err(SignedError::Signature));
}

#[test]
fn other_versions_giants_and_pieces_are_not_read() {
    let bytes = drive_of_anna();
    let mut newer = bytes.clone();
    newer[0] += 1;
    let theirs = PROTOCOL + 1;
    let refused = SignedError::from(WireError::OtherProtocol { theirs });
    assert_eq!(Envelope::parse(&newer), Err(refused.clone()));
    assert!(refused.to_string().contains("update the older"));
    let giant = [&bytes[..], &[0; MAX_SIGNED_BYTES]].concat();
    let length = giant.len();
    assert_eq!(Envelope::parse(&giant), Err(SignedError::TooLong(length)));
    for length in 0..ENVELOPE_BYTES {
        let refused = SignedError::from(WireError::Malformed);
        assert_eq!(Envelope::parse(&bytes[..length]), Err(refused), "{length}");
    }
}

/// A validly signed body that is no command.
#[test]
fn nonsense_that_was_signed_is_malformed() {
    let (robot, operator) = (&scout(), &anna());
    let route = Route { robot, operator };
    let bytes = sign(&secret(), route, &HEADER, &Nonsense(vec![0; 9])).unwrap();
    let opened = open::<Setting>(&bytes, robot, operator);
    assert_eq!(opened, Err(WireError::Malformed.into()));
    let too_long = sign(&secret(), route, &HEADER, &Nonsense(vec![0; 150]));
    assert_eq!(too_long, Err(SignedError::TooLong(ENVELOPE_BYTES + 152)));
}

#[derive(Serialize, serde::Deserialize)]
struct Nonsense(Vec<u8>);

impl Command for Nonsense {
    const TOPIC: OperatorTopic = OperatorTopic::Set;
}

#[test]
fn keys_are_files_of_openssl() {
    assert_eq!(*secret().to_pem().unwrap(), SECRET_PEM);
    assert_eq!(secret().public().to_pem().unwrap(), PUBLIC_PEM);
    let public = PublicKey::from_pem(PUBLIC_PEM).unwrap();
    assert_eq!(public, secret().public());
    let version_2 = SecretKey::from_pem(SECRET_PEM_VERSION_2).unwrap();
    assert_eq!(version_2.public(), public);
    assert!(!format!("{:?}", secret()).contains("d4ee"), "never printed");
}

#[test]
fn what_is_no_key_is_refused_by_reason() {
    let weak = "-----BEGIN PUBLIC KEY-----
MCowBQYDK2VwAyEAAQAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=
-----END PUBLIC KEY-----
";
    assert_eq!(PublicKey::from_pem(weak), Err(InvalidKey::Weak));
    for text in ["", "key", SECRET_PEM, &PUBLIC_PEM[..60]] {
        let refused = PublicKey::from_pem(text);
        assert_eq!(refused, Err(InvalidKey::Public), "{text:?}");
    }
    let mismatched = SECRET_PEM_VERSION_2.replace("ZuE=", "ZuA=");
    for text in ["", PUBLIC_PEM, &SECRET_PEM[..60], &mismatched] {
        let refused = SecretKey::from_pem(text).map(drop);
        assert_eq!(refused, Err(InvalidKey::Secret), "{text:?}");
    }
}

/// Offset of the signature.
const SIGNATURE: usize = ENVELOPE_BYTES - SIGNATURE_BYTES;

fn names() -> impl Strategy<Value = String> {
    "[a-z0-9_-]{1,12}"
}

fn headers() -> impl Strategy<Value = CommandHeader> {
    let few = || prop_oneof![0..3_u64, any::<u64>()];
    (any::<[u8; 16]>(), few(), few(), few(), few()).prop_map(|(boot, n, nonce, epoch, seq)| {
        CommandHeader {
            boot: BootId(boot),
            token: AgeToken { n, nonce },
            epoch,
            seq,
        }
    })
}

fn drives() -> impl Strategy<Value = Drive> {
    let speed = || any::<f32>().prop_filter("comparable", |speed| !speed.is_nan());
    let estop = prop::option::of(any::<u64>().prop_map(|press| EStop { press }));
    (speed(), speed(), estop).prop_map(|(linear_mps, angular_radps, estop)| Drive {
        linear_mps,
        lateral_mps: 0.0,
        angular_radps,
        estop,
        docking: None,
        goal: None,
    })
}

proptest! {
    #[test]
    fn signed_commands_open(
        robot in names(), operator in names(), header in headers(), drive in drives(), seed: [u8; 32],
    ) {
        let (robot, operator) = (&robot.parse().unwrap(), &operator.parse().unwrap());
        let route = Route { robot, operator };
        let key = SecretKey::from_seed(&seed);
        let bytes = sign(&key, route, &header, &drive).unwrap();
        let envelope = Envelope::parse(&bytes).unwrap();
        prop_assert_eq!(envelope.unverified_header(), header);
        prop_assert_eq!(envelope.open(route, &key.public()), Ok(drive));
    }

    /// Any change of one or more bits, also in the signature.
    #[test]
    fn no_byte_can_be_changed(drive in drives(), at: prop::sample::Index, change in 1..=255_u8) {
        let (robot, operator) = (&scout(), &anna());
        let mut bytes = sign(&secret(), Route { robot, operator }, &HEADER, &drive).unwrap();
        let at = at.index(bytes.len());
        bytes[at] ^= change;
        let refused = open::<Drive>(&bytes, robot, operator).unwrap_err();
        match refused {
            SignedError::Unreadable(WireError::OtherProtocol { .. }) => prop_assert!(at < 2),
            SignedError::Signature => prop_assert!(at >= 2),
            SignedError::Unreadable(_) | SignedError::TooLong(_) => prop_assert!(false, "{refused}"),
        }
    }

    #[test]
    fn nothing_can_be_cut_off_or_added(drive in drives(), cut in 1..9_usize, more in prop::collection::vec(any::<u8>(), 1..9)) {
        let (robot, operator) = (&scout(), &anna());
        let bytes = sign(&secret(), Route { robot, operator }, &HEADER, &drive).unwrap();
        let longer = [&bytes[..], &more].concat();
        for wrong in [&bytes[..bytes.len() - cut], &longer] {
            prop_assert_eq!(open::<Drive>(wrong, robot, operator), Err(SignedError::Signature));
        }
    }

    /// Envelope and body of two messages cannot be combined.
    #[test]
    fn nothing_can_be_put_together_from_two(first in headers(), second in headers(), a in drives(), b in drives()) {
        prop_assume!(first != second && a != b);
        let (robot, operator) = (&scout(), &anna());
        let route = Route { robot, operator };
        let first = sign(&secret(), route, &first, &a).unwrap();
        let second = sign(&secret(), route, &second, &b).unwrap();
        for mixed in [
            [&first[..SIGNATURE], &second[SIGNATURE..]].concat(),
            [&first[..ENVELOPE_BYTES], &second[ENVELOPE_BYTES..]].concat(),
            [&first[..SIGNATURE], &second[SIGNATURE..ENVELOPE_BYTES], &first[ENVELOPE_BYTES..]].concat(),
        ] {
            prop_assert_eq!(open::<Drive>(&mixed, robot, operator), Err(SignedError::Signature));
        }
    }

    /// Also if one part ends as the next begins: the lengths are signed.
    #[test]
    fn each_part_alone_changes_what_is_signed(
        names in prop::array::uniform4(names()), headers in [headers(), headers()],
        bodies in prop::array::uniform2(prop::collection::vec(any::<u8>(), 0..4)),
        topics in prop::array::uniform2(prop::sample::select(&OperatorTopic::ALL)),
        which in 0..9_usize,
    ) {
        let pick = |part: usize| usize::from(part == which);
        let [header, other] = &headers;
        let changed = CommandHeader {
            boot: if which == 0 { other.boot } else { header.boot },
            token: AgeToken {
                n: if which == 1 { other.token.n } else { header.token.n },
                nonce: if which == 2 { other.token.nonce } else { header.token.nonce },
            },
            epoch: if which == 3 { other.epoch } else { header.epoch },
            seq: if which == 4 { other.seq } else { header.seq },
        };
        let input = |robot: &str, operator: &str, topic, header: &CommandHeader, body: &[u8]| {
            let (robot, operator) = (&robot.parse().unwrap(), &operator.parse().unwrap());
            signature_input(topic, Route { robot, operator }, header, body)
        };
        let (robot, operator) = (&names[pick(5)], &names[2 + pick(6)]);
        let (topic, body) = (topics[pick(7)], &bodies[pick(8)]);
        let is_same = *header == changed && *robot == names[0] && *operator == names[2]
            && topic == topics[0] && *body == bodies[0];
        let before = input(&names[0], &names[2], topics[0], header, &bodies[0]);
        prop_assert_eq!(input(robot, operator, topic, &changed, body) == before, is_same);
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let bytes = [&PROTOCOL.to_le_bytes()[..], &bytes].concat();
        if let Ok(envelope) = Envelope::parse(&bytes) {
            drop(envelope.unverified_command::<Drive>());
            drop(envelope.unverified_command::<LeaseRequest>());
            drop(envelope.unverified_command::<Setting>());
            prop_assert_eq!(open::<Drive>(&bytes, &scout(), &anna()), Err(SignedError::Signature));
        }
    }
}
