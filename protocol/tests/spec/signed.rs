//! Signed messages: the bytes of every example, and the signed bytes.

use std::fmt::Debug;

use ed25519_dalek::{Signature, VerifyingKey, pkcs8::DecodePublicKey};
use protocol::keys::{OperatorId, RobotId, operator_key};
use protocol::message::{AgeToken, Drive};
use protocol::signed::{
    Command, CommandHeader, ENVELOPE_BYTES, Envelope, PublicKey, Route, SecretKey, sign,
};
use protocol::tile::BootId;
use serde_json::Value;

use super::document::{SPEC, hex, json, table};
use super::messages::body;

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
    let domain = "foreshore signed message, protocol 3";
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
