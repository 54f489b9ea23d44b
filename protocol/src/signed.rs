//! Signed commands from an operator to a robot (`SPEC.md`, section 12). Without the operator's key
//! none can be made, changed, or moved to another robot, key, operator, run or time.
//!
//! A signed message is an envelope of fixed width ([`ENVELOPE_BYTES`]) and a body. Robot, operator
//! and topic are signed but not sent: the key expression contains them. [`Envelope::parse`] reads
//! without verification, for all checks that are cheaper than a signature; [`Envelope::open`]
//! verifies.
//!
//! Operators' keys are PKCS#8 and SPKI in PEM (RFC 8410), as `openssl` reads and writes them.

use std::fmt;

use ed25519_dalek::pkcs8::spki::der::pem::LineEnding;
use ed25519_dalek::pkcs8::{
    DecodePrivateKey, DecodePublicKey, EncodePrivateKey, EncodePublicKey, KeypairBytes,
};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use serde::Serialize;
use serde::de::DeserializeOwned;
use zeroize::Zeroizing;

use crate::keys::{OperatorId, OperatorTopic, RobotId, operator_key};
use crate::message::{AgeToken, Drive, EStop, LeaseRequest, Refusal, Reset, Setting};
use crate::tile::BootId;
use crate::wire;
use crate::wire::{PROTOCOL, WireError};

/// Bytes before the body of a signed message.
pub const ENVELOPE_BYTES: usize = 2 + 16 + 4 * 8 + SIGNATURE_BYTES;

/// Limit of a signed message.
pub const MAX_SIGNED_BYTES: usize = 256;

/// Body of a signed message; each has one key per operator.
pub trait Command: Serialize + DeserializeOwned {
    /// Topic of its key, the only place where its signature is valid.
    const TOPIC: OperatorTopic;
}

impl Command for Drive {
    const TOPIC: OperatorTopic = OperatorTopic::Drive;
}

impl Command for EStop {
    const TOPIC: OperatorTopic = OperatorTopic::EStop;
}

impl Command for Reset {
    const TOPIC: OperatorTopic = OperatorTopic::Reset;
}

impl Command for LeaseRequest {
    const TOPIC: OperatorTopic = OperatorTopic::Lease;
}

impl Command for Setting {
    const TOPIC: OperatorTopic = OperatorTopic::Set;
}

/// Receiver and sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Route<'a> {
    /// Vehicle that the command is for.
    pub robot: &'a RobotId,
    /// Operator who signs.
    pub operator: &'a OperatorId,
}

/// Time of a command in the robot's terms, independent of other clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandHeader {
    /// Run of the robot's program that issued the token.
    pub boot: BootId,
    /// Newest token that the console had when it read its keys.
    pub token: AgeToken,
    /// Newest lease grant that the console knows of, 0 before the first.
    pub epoch: u64,
    /// Increases with every message that the console signs.
    pub seq: u64,
}

/// A received signed message. Nothing in it is authentic before [`Envelope::open`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Envelope<'a> {
    header: CommandHeader,
    signature: [u8; SIGNATURE_BYTES],
    body: &'a [u8],
}

/// Reason why a message is rejected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignedError {
    /// Longer than any signed message.
    #[error("{0} bytes are longer than any signed message, {MAX_SIGNED_BYTES} bytes")]
    TooLong(usize),
    /// Not readable.
    #[error(transparent)]
    Unreadable(#[from] WireError),
    /// Not signed with that key, or for another robot, operator, topic or time.
    #[error("its signature is wrong")]
    Signature,
}

impl From<SignedError> for Refusal {
    fn from(error: SignedError) -> Self {
        match error {
            SignedError::TooLong(_) | SignedError::Unreadable(_) => Self::Malformed,
            SignedError::Signature => Self::Signature,
        }
    }
}

/// Signs a command for [`operator_key`] of its route and topic.
pub fn sign<T: Command>(
    key: &SecretKey,
    route: Route<'_>,
    header: &CommandHeader,
    command: &T,
) -> Result<Vec<u8>, SignedError> {
    let body = postcard::to_stdvec(command).map_err(|_unserialisable| WireError::Malformed)?;
    let signature = key.sign(&signature_input(T::TOPIC, route, header, &body));
    let mut bytes = Vec::with_capacity(ENVELOPE_BYTES + body.len());
    bytes.extend(PROTOCOL.to_le_bytes());
    bytes.extend(header.boot.0);
    bytes.extend(header.token.n.to_le_bytes());
    bytes.extend(header.token.nonce.to_le_bytes());
    bytes.extend(header.epoch.to_le_bytes());
    bytes.extend(header.seq.to_le_bytes());
    bytes.extend(signature);
    bytes.extend(body);
    if bytes.len() > MAX_SIGNED_BYTES {
        Err(SignedError::TooLong(bytes.len()))
    } else {
        Ok(bytes)
    }
}

impl<'a> Envelope<'a> {
    /// Parses the envelope; cheap for any input.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, SignedError> {
        if bytes.len() > MAX_SIGNED_BYTES {
            return Err(SignedError::TooLong(bytes.len()));
        }
        let rest = wire::check_protocol_version(bytes)?;
        let (boot, rest) = chunk(rest)?;
        let (n, rest) = chunk(rest)?;
        let (nonce, rest) = chunk(rest)?;
        let (epoch, rest) = chunk(rest)?;
        let (seq, rest) = chunk(rest)?;
        let (signature, body) = chunk(rest)?;
        Ok(Self {
            header: CommandHeader {
                boot: BootId(boot),
                token: AgeToken {
                    n: u64::from_le_bytes(n),
                    nonce: u64::from_le_bytes(nonce),
                },
                epoch: u64::from_le_bytes(epoch),
                seq: u64::from_le_bytes(seq),
            },
            signature,
            body,
        })
    }

    /// Claimed time.
    pub const fn unverified_header(&self) -> CommandHeader {
        self.header
    }

    /// Claimed command; only for refusing it cheaply.
    pub fn unverified_command<T: Command>(&self) -> Result<T, SignedError> {
        Ok(wire::decode_body(self.body)?)
    }

    /// Verifies the signature of `key` for `route` and returns the command.
    /// [`Envelope::unverified_header`] is then authentic too.
    pub fn open<T: Command>(&self, route: Route<'_>, key: &PublicKey) -> Result<T, SignedError> {
        let input = signature_input(T::TOPIC, route, &self.header, self.body);
        if key.verify(&input, &self.signature) {
            self.unverified_command()
        } else {
            Err(SignedError::Signature)
        }
    }
}

fn chunk<const N: usize>(bytes: &[u8]) -> Result<([u8; N], &[u8]), WireError> {
    let (chunk, rest) = bytes.split_first_chunk().ok_or(WireError::Malformed)?;
    Ok((*chunk, rest))
}

/// Signed bytes: each part with its length before it, so that different parts never give the same
/// bytes.
fn signature_input(
    topic: OperatorTopic,
    route: Route<'_>,
    header: &CommandHeader,
    body: &[u8],
) -> Vec<u8> {
    let Route { robot, operator } = route;
    let domain = format!("foreshore signed message, protocol {PROTOCOL}");
    let key = operator_key(robot, operator, topic);
    let token = [
        header.token.n.to_le_bytes(),
        header.token.nonce.to_le_bytes(),
    ];
    let parts: [&[u8]; 9] = [
        domain.as_bytes(),
        robot.as_str().as_bytes(),
        &header.boot.0,
        key.as_bytes(),
        operator.as_str().as_bytes(),
        &header.epoch.to_le_bytes(),
        &header.seq.to_le_bytes(),
        token.as_flattened(),
        body,
    ];
    let mut input = Vec::with_capacity(parts.iter().map(|part| 4 + part.len()).sum());
    for part in parts {
        input.extend((part.len() as u32).to_le_bytes());
        input.extend(part);
    }
    input
}

/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = ed25519_dalek::SIGNATURE_LENGTH;

/// An operator's private key. Wiped from memory when dropped, and never printed.
#[derive(Clone)]
pub struct SecretKey(SigningKey);

/// An operator's public key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PublicKey(VerifyingKey);

/// Reason why a text is no key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum InvalidKey {
    /// No secret key, or of another type.
    #[error(
        "it is no secret Ed25519 key in PEM (`-----BEGIN PRIVATE KEY-----`): `openssl genpkey -algorithm ed25519` \
         makes one"
    )]
    Secret,
    /// No public key, or of another type.
    #[error(
        "it is no public Ed25519 key in PEM (`-----BEGIN PUBLIC KEY-----`): `openssl pkey -pubout` makes one of the \
         secret key"
    )]
    Public,
    /// A point of small order, for which anyone can sign.
    #[error("it is a weak public key, for which anybody could sign")]
    Weak,
    /// The key cannot be written.
    #[error("the key cannot be encoded")]
    Encoding,
}

impl SecretKey {
    /// Key of 32 random bytes, which must come from the system's random numbers.
    pub fn from_seed(seed: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(seed))
    }

    /// Key for links without access control. Anyone can derive it: its signatures prove nothing,
    /// but commands have one format.
    pub fn without_secret(operator: &OperatorId) -> Self {
        let seed = blake3::derive_key(
            "foreshore operator without keys",
            operator.as_str().as_bytes(),
        );
        Self::from_seed(&seed)
    }

    /// Reads PEM: PKCS#8, with or without the public key.
    pub fn from_pem(pem: &str) -> Result<Self, InvalidKey> {
        SigningKey::from_pkcs8_pem(pem)
            .map(Self)
            .map_err(|_why| InvalidKey::Secret)
    }

    /// Writes PEM, to be readable by its owner only.
    ///
    /// PKCS#8 version 1, without the public key: `openssl` does not read version 2.
    pub fn to_pem(&self) -> Result<Zeroizing<String>, InvalidKey> {
        let pair = KeypairBytes {
            secret_key: self.0.to_bytes(),
            public_key: None,
        };
        pair.to_pkcs8_pem(LineEnding::LF)
            .map_err(|_why| InvalidKey::Encoding)
    }

    /// Its public key.
    pub fn public(&self) -> PublicKey {
        PublicKey(self.0.verifying_key())
    }

    fn sign(&self, input: &[u8]) -> [u8; SIGNATURE_BYTES] {
        self.0.sign(input).to_bytes()
    }
}

impl fmt::Debug for SecretKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SecretKey").finish_non_exhaustive()
    }
}

impl PublicKey {
    /// Reads PEM.
    pub fn from_pem(pem: &str) -> Result<Self, InvalidKey> {
        let key = VerifyingKey::from_public_key_pem(pem).map_err(|_why| InvalidKey::Public)?;
        if key.is_weak() {
            Err(InvalidKey::Weak)
        } else {
            Ok(Self(key))
        }
    }

    /// Writes PEM.
    pub fn to_pem(&self) -> Result<String, InvalidKey> {
        self.0
            .to_public_key_pem(LineEnding::LF)
            .map_err(|_why| InvalidKey::Encoding)
    }

    /// Strict verification: a message has exactly one valid signature per key.
    fn verify(&self, input: &[u8], signature: &[u8; SIGNATURE_BYTES]) -> bool {
        let signature = Signature::from_bytes(signature);
        self.0.verify_strict(input, &signature).is_ok()
    }
}

#[cfg(test)]
mod tests;
