//! Messages as bytes: a header and a body in postcard, with limits. `SPEC.md` defines every byte.
//!
//! The protocol version comes first, in two fixed bytes, so that every version recognises any
//! other. Enums are append-only; a body grows only in a new protocol version.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::tile::BootId;

/// Version of the protocol. Others are refused with a message that names them.
pub const PROTOCOL: u16 = 5;

/// Limit of a message; tiles are sent in bands below it.
pub const MAX_MESSAGE_BYTES: usize = 64 * 1024;

/// Bytes before every body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Run of the program that sent it.
    pub boot: BootId,
    /// Number of the sender's message over all keys, so one key has gaps.
    pub seq: u64,
    /// Stamp of its data, nanoseconds on the robot's sensor clock; 0 without.
    pub robot_time_ns: i64,
}

/// Reason why bytes are no message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// Longer than any message.
    #[error("{0} bytes are longer than any message, {MAX_MESSAGE_BYTES} bytes")]
    TooLong(usize),
    /// Another version of the protocol.
    #[error(
        "it speaks protocol {theirs}, this program speaks {PROTOCOL}: update the older of the two"
    )]
    OtherProtocol {
        /// Its version.
        theirs: u16,
    },
    /// Not the message it should be.
    #[error("it is not the message its key promises")]
    Malformed,
}

/// Encodes a message.
pub fn encode<T: Serialize>(header: &Header, body: &T) -> Result<Vec<u8>, WireError> {
    let mut bytes = PROTOCOL.to_le_bytes().to_vec();
    bytes.extend(header.boot.0);
    bytes.extend(header.seq.to_le_bytes());
    bytes.extend(header.robot_time_ns.to_le_bytes());
    let bytes = postcard::to_extend(body, bytes).map_err(|_unserialisable| WireError::Malformed)?;
    if bytes.len() > MAX_MESSAGE_BYTES {
        Err(WireError::TooLong(bytes.len()))
    } else {
        Ok(bytes)
    }
}

/// Decodes `bytes`, which must hold exactly one message.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<(Header, T), WireError> {
    if bytes.len() > MAX_MESSAGE_BYTES {
        return Err(WireError::TooLong(bytes.len()));
    }
    let rest = check_protocol_version(bytes)?;
    let (boot, rest) = rest.split_first_chunk().ok_or(WireError::Malformed)?;
    let (seq, rest) = rest.split_first_chunk().ok_or(WireError::Malformed)?;
    let (time, rest) = rest.split_first_chunk().ok_or(WireError::Malformed)?;
    let body = decode_body(rest)?;
    let header = Header {
        boot: BootId(*boot),
        seq: u64::from_le_bytes(*seq),
        robot_time_ns: i64::from_le_bytes(*time),
    };
    Ok((header, body))
}

/// The bytes after the protocol version, if it is ours.
pub(crate) fn check_protocol_version(bytes: &[u8]) -> Result<&[u8], WireError> {
    let (theirs, rest) = bytes.split_first_chunk().ok_or(WireError::Malformed)?;
    let theirs = u16::from_le_bytes(*theirs);
    if theirs == PROTOCOL {
        Ok(rest)
    } else {
        Err(WireError::OtherProtocol { theirs })
    }
}

/// Decodes a body that must fill `bytes`.
pub(crate) fn decode_body<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, WireError> {
    match postcard::take_from_bytes(bytes) {
        Ok((body, [])) => Ok(body),
        Ok(_) | Err(_) => Err(WireError::Malformed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: Header = Header {
        boot: BootId([7; 16]),
        seq: 258,
        robot_time_ns: -2,
    };

    #[test]
    fn other_versions_and_giants_are_refused() {
        let mut bytes = encode(&HEADER, &1u8).unwrap();
        bytes[..2].copy_from_slice(&7u16.to_le_bytes());
        let refused = decode::<u8>(&bytes).unwrap_err();
        assert_eq!(refused, WireError::OtherProtocol { theirs: 7 });
        assert!(refused.to_string().contains("update the older"));
        let giant = vec![0; MAX_MESSAGE_BYTES + 1];
        assert_eq!(
            decode::<u8>(&giant),
            Err(WireError::TooLong(MAX_MESSAGE_BYTES + 1))
        );
        assert!(matches!(
            encode(&HEADER, &giant),
            Err(WireError::TooLong(_))
        ));
    }

    /// A length prefix of 2⁶³ elements must not be allocated.
    #[test]
    fn wrong_length_prefix_is_malformed() {
        let mut bytes = encode(&HEADER, &()).unwrap();
        bytes.extend([0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F]);
        assert_eq!(decode::<Vec<u8>>(&bytes), Err(WireError::Malformed));
        assert_eq!(decode::<Vec<[u64; 4]>>(&bytes), Err(WireError::Malformed));
        assert_eq!(decode::<String>(&bytes), Err(WireError::Malformed));
    }
}
