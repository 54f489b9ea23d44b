//! What an operator tells a robot, signed: nobody on the way can make one, change one, or move one to another robot,
//! key, operator, run or moment.
//!
//! A signed message is an envelope of fixed width ([`ENVELOPE_BYTES`]) and a body. Robot, operator and key are signed
//! but not sent: the key that a message arrives with tells them. Everything that is cheaper to judge than a signature
//! is judged first: [`Envelope::parse`] reads without believing, [`Envelope::open`] believes. `SPEC.md`, section 12.

mod key_pair;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::keys::{OperatorId, OperatorTopic, RobotId, operator_key};
use crate::message::{AgeToken, Drive, EStop, LeaseRequest, Refusal, Reset, Setting};
use crate::tile::BootId;
use crate::wire::{self, PROTOCOL, WireError};

pub use key_pair::{InvalidKey, PublicKey, SIGNATURE_BYTES, SecretKey};

/// What precedes the body of every signed message.
pub const ENVELOPE_BYTES: usize = 2 + 16 + 4 * 8 + SIGNATURE_BYTES;

/// Largest signed message.
pub const MAX_SIGNED_BYTES: usize = 256;

/// The body of a signed message, which has one key for each operator.
pub trait Command: Serialize + DeserializeOwned {
    /// Where it goes, and the only place where its signature is good.
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

/// From whom to whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Route<'a> {
    /// Who is to do it.
    pub robot: &'a RobotId,
    /// Who wants it.
    pub operator: &'a OperatorId,
}

/// When: in the robot's terms, not in those of any clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandHeader {
    /// The run of the robot's program that issued the token.
    pub boot: BootId,
    /// The newest token that the console had when it read its keys.
    pub token: AgeToken,
    /// The grant of the lease that it relies on: the newest that the console knows of, 0 before the first.
    pub epoch: u64,
    /// Grows with every message that the console signs.
    pub seq: u64,
}

/// A signed message as it arrived. Nothing in it is to be believed before [`Envelope::open`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Envelope<'a> {
    header: CommandHeader,
    signature: [u8; SIGNATURE_BYTES],
    body: &'a [u8],
}

/// Why bytes are no message of who is said to have signed it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignedError {
    /// Longer than any signed message.
    #[error("{0} bytes are longer than any signed message, {MAX_SIGNED_BYTES} bytes")]
    TooLong(usize),
    /// Not to be read.
    #[error(transparent)]
    Unreadable(#[from] WireError),
    /// Not signed with that key, or not for that robot, operator, kind of command and moment.
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

/// The bytes of a signed message, for [`operator_key`] of its route and topic and for nowhere else.
///
/// # Errors
/// Where the command is longer than a signed message may be.
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
    /// What `bytes` claim. Costs nothing worth mentioning, whatever they are.
    ///
    /// # Errors
    /// Where they are too long, of another protocol version, or shorter than an envelope.
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

    /// When it claims to be from.
    pub const fn unverified_header(&self) -> CommandHeader {
        self.header
    }

    /// What it claims to want: good for refusing it cheaply, and for nothing else.
    ///
    /// # Errors
    /// Where the body is not such a command.
    pub fn unverified_command<T: Command>(&self) -> Result<T, SignedError> {
        Ok(wire::decode_body(self.body)?)
    }

    /// What the holder of `key` wants of `route.robot`. Then [`Envelope::unverified_header`] is theirs too.
    ///
    /// # Errors
    /// Where it was not signed by them, for this route and this kind of command, as it is; and where it was, but is
    /// no such command.
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

/// What is signed: each part behind its length, so that different parts never make the same bytes.
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

#[cfg(test)]
mod tests;
