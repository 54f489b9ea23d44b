//! What `rmw_zenoh` attaches to every message: 33 bytes (`rmw_zenoh_cpp/src/detail/attachment_helpers.cpp`), which are
//! zenoh-ext's serialisation of an `i64`, an `i64` and 16 bytes behind their number.

use measurement::time::RobotTime;

/// Length of an attachment.
pub const ATTACHMENT_BYTES: usize = 33;

const GID_BYTES: u8 = 16;

/// An attachment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Number of the message; a publisher's first has 1.
    pub sequence: i64,
    /// When it was published, on the wall clock of its publisher.
    pub published: RobotTime,
    /// Which publisher.
    pub gid: [u8; 16],
}

impl Attachment {
    /// As bytes.
    pub fn encode(&self) -> [u8; ATTACHMENT_BYTES] {
        let mut bytes = [0; ATTACHMENT_BYTES];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.published.as_nanos().to_le_bytes());
        bytes[16] = GID_BYTES;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// From bytes; `None` where they are none: older forms are not read.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk()?;
        let (published_ns, rest) = rest.split_first_chunk()?;
        let (&[length], rest) = rest.split_first_chunk()?;
        let gid = rest.try_into().ok()?;
        (length == GID_BYTES).then(|| Self {
            sequence: i64::from_le_bytes(*sequence),
            published: RobotTime::from_nanos(i64::from_le_bytes(*published_ns)),
            gid,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_the_bytes_that_ros_reads() {
        let attachment = Attachment {
            sequence: 1,
            published: RobotTime::from_nanos(0x0102_0304),
            gid: std::array::from_fn(|index| index as u8),
        };
        let bytes = attachment.encode();
        let expected = [
            &[1, 0, 0, 0, 0, 0, 0, 0, 4, 3, 2, 1, 0, 0, 0, 0, 16][..],
            &attachment.gid,
        ]
        .concat();
        assert_eq!(bytes[..], expected);
        assert_eq!(Attachment::decode(&bytes), Some(attachment));
        for cut in 0..ATTACHMENT_BYTES {
            assert_eq!(Attachment::decode(&bytes[..cut]), None);
        }
        let mut other = bytes;
        other[16] = 15;
        assert_eq!(Attachment::decode(&other), None);
        assert_eq!(
            Attachment::decode(&[bytes.to_vec(), vec![0]].concat()),
            None
        );
    }
}
