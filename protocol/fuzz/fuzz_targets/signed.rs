//! Signed messages: any bytes are refused, or contain claims that survive signing; without the key
//! none is verified.
#![no_main]

use std::cell::LazyCell;

use libfuzzer_sys::fuzz_target;
use protocol::keys::{OperatorId, RobotId};
use protocol::message::{Drive, EStop, LeaseRequest, Reset, Setting};
use protocol::signed::{Command, Envelope, Route, SecretKey, SignedError, sign};

struct Parties {
    robot: RobotId,
    operator: OperatorId,
    key: SecretKey,
}

thread_local! {
    static PARTIES: LazyCell<Parties> = LazyCell::new(|| Parties {
        robot: "scout-1".parse().unwrap(),
        operator: "anna".parse().unwrap(),
        key: SecretKey::from_seed(&[7; 32]),
    });
}

fn check<T: Command>(envelope: &Envelope<'_>, length: usize, parties: &Parties) {
    let Ok(command) = envelope.unverified_command::<T>() else {
        return;
    };
    let Parties { robot, operator, key } = parties;
    let route = Route { robot, operator };
    let opened = envelope.open::<T>(route, &key.public());
    assert!(matches!(opened, Err(SignedError::Signature)));
    let once = sign(key, route, &envelope.unverified_header(), &command).unwrap();
    assert!(once.len() <= length);
    let signed = Envelope::parse(&once).unwrap();
    assert_eq!(signed.unverified_header(), envelope.unverified_header());
    let command = signed.open::<T>(route, &key.public()).unwrap();
    assert_eq!(sign(key, route, &signed.unverified_header(), &command).unwrap(), once);
}

fuzz_target!(|bytes: &[u8]| {
    let Ok(envelope) = Envelope::parse(bytes) else {
        return;
    };
    PARTIES.with(|parties| {
        check::<Drive>(&envelope, bytes.len(), parties);
        check::<EStop>(&envelope, bytes.len(), parties);
        check::<Reset>(&envelope, bytes.len(), parties);
        check::<LeaseRequest>(&envelope, bytes.len(), parties);
        check::<Setting>(&envelope, bytes.len(), parties);
    });
});
