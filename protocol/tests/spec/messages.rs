//! Messages: the bytes of every example, of signed ones also the signed bytes; no message and no field may be missing.

use std::collections::BTreeSet;
use std::fmt::Debug;
use std::path::Path;

use ed25519_dalek::pkcs8::DecodePublicKey;
use ed25519_dalek::{Signature, VerifyingKey};
use protocol::keys::{OperatorId, RobotId, operator_key};
use protocol::message::{
    AgeToken, Answer, Changes, Digests, DigestsRequest, Drive, EStop, Event, Info, LeaseRequest,
    Localization, MapHead, Plan, Pong, Pose, Reset, Scan, Setting, ShoresReply, ShoresRequest,
    Status, TilesReply, TilesRequest, TrajectoryPart, TrajectoryRequest, View, VoxelsReply,
    VoxelsRequest,
};
use protocol::signed::{
    Command, CommandHeader, ENVELOPE_BYTES, Envelope, PublicKey, Route, SecretKey, sign,
};
use protocol::tile::BootId;
use protocol::wire::{Header, WireError, decode, encode};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{SPEC, blocks_of, hex, json, table};

/// Checks the example of a name with its type.
type Check = fn(&str);

const EXAMPLES: [(&str, Check); 46] = [
    ("Info", check::<Info>),
    ("Pong", check::<Pong>),
    ("Pose", check::<Pose>),
    ("Status", check::<Status>),
    ("Status.driven", check::<Status>),
    ("Localization", check::<Localization>),
    ("Plan", check::<Plan>),
    ("Event", check::<Event>),
    ("MapHead", check::<MapHead>),
    ("View", check::<View>),
    ("Changes", check::<Changes>),
    ("DigestsRequest", check::<DigestsRequest>),
    ("Digests", check::<Digests>),
    ("TilesRequest.NewerThan", check::<TilesRequest>),
    ("TilesRequest.ByKey", check::<TilesRequest>),
    ("TilesReply", check::<TilesReply>),
    ("ShoresRequest", check::<ShoresRequest>),
    ("ShoresReply", check::<ShoresReply>),
    ("ShoresReply.nothing", check::<ShoresReply>),
    ("VoxelsRequest", check::<VoxelsRequest>),
    ("VoxelsReply.None", check::<VoxelsReply>),
    ("VoxelsReply.Preparing", check::<VoxelsReply>),
    ("VoxelsReply.Gone", check::<VoxelsReply>),
    ("VoxelsReply.Part", check::<VoxelsReply>),
    ("TrajectoryRequest", check::<TrajectoryRequest>),
    ("TrajectoryPart", check::<TrajectoryPart>),
    ("Scan", check::<Scan>),
    ("Drive", check_signed::<Drive>),
    ("Drive.goal", check_signed::<Drive>),
    ("EStop", check_signed::<EStop>),
    ("Reset", check_signed::<Reset>),
    ("LeaseRequest.Request", check_signed::<LeaseRequest>),
    ("LeaseRequest.Release", check_signed::<LeaseRequest>),
    ("LeaseRequest.HandOver", check_signed::<LeaseRequest>),
    ("LeaseRequest.Refuse", check_signed::<LeaseRequest>),
    ("LeaseRequest.TakeOver", check_signed::<LeaseRequest>),
    ("Setting.BudgetKbps", check_signed::<Setting>),
    ("Setting.CollisionMonitor", check_signed::<Setting>),
    ("Setting.Recording", check_signed::<Setting>),
    ("Setting.SaveMap", check_signed::<Setting>),
    ("Setting.Locate", check_signed::<Setting>),
    ("Answer.Done", check::<Answer>),
    ("Answer.Granted", check::<Answer>),
    ("Answer.Waiting", check::<Answer>),
    ("Answer.EStopped", check::<Answer>),
    ("Answer.Refused", check::<Answer>),
];

/// Parts of messages.
const PARTS: [&str; 50] = [
    "LayerInfo",
    "SensorInfo",
    "SensorKind",
    "SensorMount",
    "FieldOfView",
    "SensorStatus",
    "SensorFault",
    "DeviceStatus",
    "DeviceState",
    "DeviceClock",
    "RecordingStatus",
    "RecordingState",
    "PoseConfidence",
    "Severity",
    "DropCount",
    "LayerHead",
    "TileSummary",
    "ChangedTile",
    "TileBand",
    "Shores",
    "Datum",
    "ShoreCluster",
    "ShoreClass",
    "DockingSite",
    "DockingChoice",
    "MapPose",
    "VoxelFile",
    "VoxelsPart",
    "AgeToken",
    "TeleopStatus",
    "TeleopState",
    "StopReason",
    "LeaseEnd",
    "FaultReason",
    "MotorHold",
    "GoalStatus",
    "GoalEnd",
    "LeaseStatus",
    "Arming",
    "Velocity",
    "Clamp",
    "CollisionMonitorState",
    "SpeedLimits",
    "EStopStatus",
    "CommandCounters",
    "RefusedCount",
    "Settings",
    "Barrier",
    "BarrierKind",
    "Refusal",
];

#[test]
fn examples_are_what_is_encoded_and_decoded() {
    for (name, check) in EXAMPLES {
        check(name);
    }
}

fn check<T: Serialize + DeserializeOwned + PartialEq + Debug>(name: &str) {
    let stated = json(name);
    let golden = hex(name);
    let stated_header = &stated["header"];
    let header = Header {
        boot: BootId(serde_json::from_value(stated_header["boot"].clone()).unwrap()),
        seq: stated_header["seq"].as_u64().unwrap(),
        robot_time_ns: stated_header["robot_time_ns"].as_i64().unwrap(),
    };
    let body: T = body(name, &stated);

    assert_eq!(
        encode(&header, &body).as_deref(),
        Ok(&*golden),
        "{name} encodes to other bytes"
    );
    assert_eq!(decode::<T>(&golden), Ok((header, body)), "{name}");
    let longer = [&golden[..], &[0]].concat();
    let cut = (0..golden.len()).map(|length| &golden[..length]);
    for malformed in cut.chain([&longer[..]]) {
        assert_eq!(
            decode::<T>(malformed),
            Err(WireError::Malformed),
            "{name} is exactly its bytes"
        );
    }
}

/// The body of an example.
pub(crate) fn body<T: Serialize + DeserializeOwned>(name: &str, stated: &Value) -> T {
    // Through text: a `Value` would keep `f32`s as `f64`s, with other digits.
    let body: T = serde_json::from_str(&stated["body"].to_string()).unwrap();
    let reported: Value = serde_json::from_str(&serde_json::to_string(&body).unwrap()).unwrap();
    assert_eq!(
        reported, stated["body"],
        "{name} does not state every field"
    );
    body
}

#[test]
fn every_message_and_variant_has_an_example() {
    let documented: BTreeSet<&str> = blocks_of("json").into_iter().collect();
    let checked: BTreeSet<&str> = EXAMPLES.iter().map(|(name, _)| *name).collect();
    let unchecked: Vec<_> = documented.difference(&checked).collect();
    assert!(
        unchecked.is_empty(),
        "examples that no test knows: {unchecked:?}"
    );

    for declared in declarations() {
        let Declaration {
            name,
            is_enum,
            members,
        } = &declared;
        if PARTS.contains(&name.as_str()) {
            continue;
        }
        if *is_enum {
            for variant in members {
                let example = format!("{name}.{variant}");
                assert!(checked.contains(&*example), "{example} has no example");
            }
        } else {
            assert!(checked.contains(&**name), "{name} has no example");
        }
    }
}

#[test]
fn every_field_and_variant_is_documented_in_order() {
    for Declaration {
        name,
        is_enum,
        members,
    } in declarations()
    {
        let level = if PARTS.contains(&&*name) {
            "####"
        } else {
            "###"
        };
        let rows = table(&format!("{level} `{name}`"));
        let column = usize::from(is_enum);
        let documented: Vec<&str> = rows
            .iter()
            .map(|row| row[column].trim_matches('`'))
            .collect();
        assert_eq!(documented, members, "the table of {name}");
        if is_enum {
            for (number, row) in rows.iter().enumerate() {
                assert_eq!(row[0], number.to_string(), "{name}: {row:?}");
            }
        }
    }
}

/// A public type out of `src/message/`.
struct Declaration {
    name: String,
    is_enum: bool,
    /// Fields or variants.
    members: Vec<String>,
}

/// Every public type, read from the sources: a new one must be documented.
fn declarations() -> Vec<Declaration> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/message");
    let mut declarations: Vec<Declaration> = Vec::new();
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    for file in files {
        let mut is_inside = false;
        for line in std::fs::read_to_string(file).unwrap().lines() {
            let is_enum = line.starts_with("pub enum ");
            if let Some(rest) = line
                .strip_prefix("pub struct ")
                .or_else(|| line.strip_prefix("pub enum "))
            {
                declarations.push(Declaration {
                    name: identifier(rest),
                    is_enum,
                    members: Vec::new(),
                });
                is_inside = true;
            } else if line.starts_with('}') {
                is_inside = false;
            } else if let Some(member) = line.strip_prefix("    ")
                && let Some(declaration) = declarations.last_mut().filter(|_| is_inside)
            {
                if let Some(field) = member.strip_prefix("pub ") {
                    declaration.members.push(identifier(field));
                } else if declaration.is_enum && member.starts_with(char::is_uppercase) {
                    declaration.members.push(identifier(member));
                }
            }
        }
    }
    assert!(declarations.len() > 12, "found only {}", declarations.len());
    declarations
}

fn identifier(text: &str) -> String {
    text.chars()
        .take_while(|&character| character.is_alphanumeric() || character == '_')
        .collect()
}

/// The key of the examples: the text between its begin and end lines.
fn pem(kind: &str) -> &'static str {
    let begin = SPEC.find(&format!("-----BEGIN {kind} KEY-----")).unwrap();
    let end = format!("-----END {kind} KEY-----\n");
    let length = SPEC[begin..].find(&end).unwrap() + end.len();
    &SPEC[begin..begin + length]
}

fn secret() -> SecretKey {
    SecretKey::from_pem(pem("PRIVATE")).unwrap()
}

fn stamp(stated: &Value) -> CommandHeader {
    let stated = &stated["stamp"];
    CommandHeader {
        boot: BootId(serde_json::from_value(stated["boot"].clone()).unwrap()),
        token: AgeToken {
            n: stated["n"].as_u64().unwrap(),
            nonce: u64::from_le_bytes(serde_json::from_value(stated["nonce"].clone()).unwrap()),
        },
        epoch: stated["epoch"].as_u64().unwrap(),
        seq: stated["seq"].as_u64().unwrap(),
    }
}

fn names(stated: &Value) -> (RobotId, OperatorId) {
    let name = |who: &str| stated[who].as_str().unwrap();
    (
        name("robot").parse().unwrap(),
        name("operator").parse().unwrap(),
    )
}

pub(crate) fn check_signed<T: Command + PartialEq + Debug>(name: &str) {
    let stated = json(name);
    let golden = hex(name);
    let command: T = body(name, &stated);
    let (robot, operator) = &names(&stated);
    let route = Route { robot, operator };
    let stamp = stamp(&stated);
    assert_eq!(
        sign(&secret(), route, &stamp, &command).as_deref(),
        Ok(&*golden),
        "{name} is signed as other bytes"
    );
    let envelope = Envelope::parse(&golden).unwrap();
    assert_eq!(envelope.unverified_header(), stamp, "{name}");
    let opened = envelope.open::<T>(route, &PublicKey::from_pem(pem("PUBLIC")).unwrap());
    assert_eq!(opened, Ok(command), "{name}");
}

/// Independent of the signing code: from the specification and the Ed25519 library only.
#[test]
fn signature_covers_the_specified_bytes() {
    let message = hex("Drive");
    let stated = json("Drive");
    let (robot, operator) = names(&stated);
    let topic = Drive::TOPIC;
    let key = operator_key(&robot, &operator, topic);
    let domain = "foreshore signed message, protocol 5";
    let parts: [&[u8]; 9] = [
        domain.as_bytes(),
        robot.as_str().as_bytes(),
        &message[2..18],
        key.as_bytes(),
        operator.as_str().as_bytes(),
        &message[34..42],
        &message[42..50],
        &message[18..34],
        &message[ENVELOPE_BYTES..],
    ];
    let rows = table("## 12. Signed messages");
    let stated_sizes = rows[rows.len() - parts.len()..].iter().map(|row| row[1]);
    let mut input = Vec::new();
    for (part, size) in parts.iter().zip(stated_sizes) {
        assert!(size.is_empty() || size == part.len().to_string());
        input.extend((part.len() as u32).to_le_bytes());
        input.extend(*part);
    }
    assert!(SPEC.contains(&format!("`{domain}`, in ASCII")));
    assert_eq!(hex("signed bytes"), input);

    let signature = hex("signature");
    assert_eq!(message[50..ENVELOPE_BYTES], signature);
    let key = VerifyingKey::from_public_key_pem(pem("PUBLIC")).unwrap();
    let signature = Signature::from_slice(&signature).unwrap();
    assert!(key.verify_strict(&input, &signature).is_ok());
}

#[test]
fn the_keys_of_the_examples_belong_together_and_are_written_so() {
    assert_eq!(*secret().to_pem().unwrap(), pem("PRIVATE"));
    assert_eq!(secret().public().to_pem().unwrap(), pem("PUBLIC"));
}
