//! Reads the fields of a serialised message one after another, and never past its end.

use super::{DecodeError, Encoding};

/// A place in a message's bytes.
#[derive(Clone, Debug)]
pub(super) struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    encoding: Encoding,
    big_endian: bool,
}

macro_rules! number {
    ($name:ident, $type:ty) => {
        pub(super) fn $name(&mut self) -> Result<$type, DecodeError> {
            const SIZE: usize = size_of::<$type>();
            self.align(SIZE);
            let raw: [u8; SIZE] = *self
                .take(SIZE)?
                .first_chunk()
                .ok_or(DecodeError::TooShort)?;
            Ok(if self.big_endian {
                <$type>::from_be_bytes(raw)
            } else {
                <$type>::from_le_bytes(raw)
            })
        }
    };
}

impl<'a> Cursor<'a> {
    /// At the first field of `message`.
    pub(super) fn new(message: &'a [u8], encoding: Encoding) -> Result<Self, DecodeError> {
        let (bytes, big_endian) = match encoding {
            Encoding::Ros1 => (message, false),
            // OMG DDSI-RTPS 2.5, 10.2: {0, 0} is big-endian plain CDR, {0, 1} little-endian; then options.
            Encoding::Cdr => match message {
                [0, order @ (0 | 1), _, _, fields @ ..] => (fields, *order == 0),
                [a, b, ..] => return Err(DecodeError::Encapsulation([*a, *b])),
                _ => return Err(DecodeError::TooShort),
            },
        };
        Ok(Self {
            bytes,
            at: 0,
            encoding,
            big_endian,
        })
    }

    number!(u8, u8);
    number!(i8, i8);
    number!(u16, u16);
    number!(u32, u32);
    number!(i32, i32);
    number!(f32, f32);
    number!(f64, f64);

    pub(super) const fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// `N` numbers of 8 bytes.
    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], DecodeError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Length of a sequence whose elements take at least `element_bytes` each: one that lies must not
    /// ask for more memory than the message could fill.
    pub(super) fn length(&mut self, element_bytes: usize) -> Result<usize, DecodeError> {
        let length = self.u32()? as usize;
        let fits = length
            .checked_mul(element_bytes)
            .is_some_and(|bytes| bytes <= self.rest());
        if fits {
            Ok(length)
        } else {
            Err(DecodeError::TooShort)
        }
    }

    /// `float32[]`.
    pub(super) fn f32_sequence(&mut self) -> Result<Vec<f32>, DecodeError> {
        let length = self.length(4)?;
        if length > 0 {
            self.align(4);
        }
        let raw = self.take(4 * length)?.as_chunks::<4>().0;
        Ok(if self.big_endian {
            raw.iter().map(|bytes| f32::from_be_bytes(*bytes)).collect()
        } else {
            raw.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
        })
    }

    /// `uint8[]`.
    pub(super) fn byte_sequence(&mut self) -> Result<&'a [u8], DecodeError> {
        let length = self.length(1)?;
        self.take(length)
    }

    /// `string`; CDR ends it with a zero that its length counts.
    pub(super) fn string(&mut self) -> Result<&'a str, DecodeError> {
        let bytes = self.byte_sequence()?;
        let bytes = match self.encoding {
            Encoding::Cdr => bytes.strip_suffix(&[0]).unwrap_or(bytes),
            Encoding::Ros1 => bytes,
        };
        str::from_utf8(bytes).ok().ok_or(DecodeError::NotText)
    }

    /// CDR puts every number at a multiple of its size, counted from the first field.
    fn align(&mut self, size: usize) {
        if self.encoding == Encoding::Cdr {
            self.at = self.at.next_multiple_of(size);
        }
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], DecodeError> {
        let end = self.at.checked_add(length).ok_or(DecodeError::TooShort)?;
        let taken = self.bytes.get(self.at..end).ok_or(DecodeError::TooShort)?;
        self.at = end;
        Ok(taken)
    }

    const fn rest(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }
}
