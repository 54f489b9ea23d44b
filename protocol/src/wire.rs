//! Messages as bytes: a header and a body in postcard, within limits. `SPEC.md` tells of every byte.
//!
//! `protocol` comes first, as a fixed two bytes, so that every version of this program can tell that another
//! one speaks. Enums are append-only; a body that grows does so in a new protocol version.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::tile::BootId;

/// The version that is spoken here. Others are refused, with a message that says so.
pub const PROTOCOL: u16 = 3;

/// Largest message of all; tiles come in bands that stay below it.
pub const MAX_MESSAGE_BYTES: usize = 64 * 1024;

/// What precedes every body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// The run of the program that sent it.
    pub boot: BootId,
    /// Counts the messages of the sender over all its keys, so that one key sees gaps.
    pub seq: u64,
    /// Stamp of the data it tells of, nanoseconds on the robot's sensor clock; 0 where it tells of none.
    pub robot_time_ns: i64,
}

/// Why bytes are no message.
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
        /// Which.
        theirs: u16,
    },
    /// Not the message it should be.
    #[error("it is not the message its key promises")]
    Malformed,
}

/// The bytes of a message.
///
/// # Errors
/// Where the body is longer than a message may be.
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

/// The message in `bytes`, which must hold nothing else.
///
/// # Errors
/// Where they are no such message of this protocol version.
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

/// What follows the protocol version, if it is the one spoken here.
pub(crate) fn check_protocol_version(bytes: &[u8]) -> Result<&[u8], WireError> {
    let (theirs, rest) = bytes.split_first_chunk().ok_or(WireError::Malformed)?;
    let theirs = u16::from_le_bytes(*theirs);
    if theirs == PROTOCOL {
        Ok(rest)
    } else {
        Err(WireError::OtherProtocol { theirs })
    }
}

/// The body in `bytes`, which must hold nothing else.
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
    fn a_message_is_its_header_and_its_body_and_nothing_else() {
        let bytes = encode(&HEADER, &(5u8, 300u16)).unwrap();
        let mut expected = vec![3, 0];
        expected.extend([7; 16]);
        expected.extend([2, 1, 0, 0, 0, 0, 0, 0]);
        expected.extend([0xFE, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF]);
        expected.extend([5, 0xAC, 0x02]);
        assert_eq!(bytes, expected);
        assert_eq!(decode::<(u8, u16)>(&bytes), Ok((HEADER, (5, 300))));
        assert_eq!(
            decode::<u8>(&bytes),
            Err(WireError::Malformed),
            "bytes are left"
        );
        for length in 0..bytes.len() {
            assert!(
                decode::<(u8, u16)>(&bytes[..length]).is_err(),
                "cut at {length}"
            );
        }
    }

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

    /// A sequence that claims 2⁶³ elements must not be allocated.
    #[test]
    fn a_length_that_lies_is_malformed() {
        let mut bytes = encode(&HEADER, &()).unwrap();
        bytes.extend([0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F]);
        assert_eq!(decode::<Vec<u8>>(&bytes), Err(WireError::Malformed));
        assert_eq!(decode::<Vec<[u64; 4]>>(&bytes), Err(WireError::Malformed));
        assert_eq!(decode::<String>(&bytes), Err(WireError::Malformed));
    }
}
