//! A binary range coder, that of LZMA (Pavlov, LZMA specification 2015; after Martin 1979), with probabilities that learn faster at
//! first: a tile has few cells.

/// How probable it is that a bit is 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Probability {
    /// In parts of 2¹⁶.
    zero: u16,
    /// Bits seen, at most [`MEMORY`].
    seen: u8,
}

/// After so many bits the weight of a new one no longer falls.
const MEMORY: u8 = 30;
/// No bit is less probable than this, in parts of 2¹⁶.
const LEAST: u16 = 64;

impl Probability {
    pub(super) const EVEN: Self = Self {
        zero: 1 << 15,
        seen: 0,
    };

    fn learn(&mut self, bit: bool) {
        let rate = 131_072 / (2 * i32::from(self.seen) + 3);
        let goal = if bit { 0 } else { 65_535 };
        let zero = i32::from(self.zero);
        // It fits 32 bits: the first goal is at most 32,768 away, the second 54,613, and the rate falls.
        let zero = zero + (((goal - zero) * rate) >> 16);
        self.zero = zero.clamp(LEAST.into(), (65_535 - LEAST).into()) as u16;
        self.seen = MEMORY.min(self.seen + 1);
    }
}

/// Codes bits: an encoder writes the given ones, a decoder returns those that it reads, whatever it is given.
pub(super) trait BitCoder {
    fn bit(&mut self, probability: &mut Probability, bit: bool) -> bool;
}

/// Writes bits.
#[derive(Debug)]
pub(super) struct RangeEncoder {
    low: u64,
    range: u32,
    /// The byte that a carry may still change, and the number of bytes 255 after it.
    held: Option<(u8, usize)>,
    bytes: Vec<u8>,
}

impl RangeEncoder {
    pub(super) const fn new() -> Self {
        Self {
            low: 0,
            range: u32::MAX,
            held: None,
            bytes: Vec::new(),
        }
    }

    fn shift(&mut self) {
        let (carry, byte) = ((self.low >> 32) as u8, (self.low >> 24) as u8);
        self.low = (self.low << 8) & 0xffff_ffff;
        match &mut self.held {
            Some((_, full)) if carry == 0 && byte == 0xff => *full += 1,
            held => {
                if let Some((held, full)) = held.replace((byte, 0)) {
                    self.bytes.push(held.wrapping_add(carry));
                    let full = std::iter::repeat_n(0xff_u8.wrapping_add(carry), full);
                    self.bytes.extend(full);
                }
            }
        }
    }

    /// The bytes, without zeros at their end, which a decoder adds.
    pub(super) fn finish(mut self) -> Vec<u8> {
        // Of the numbers that mean the same the one with most zeros at its end.
        let end = self.low + u64::from(self.range);
        let rounded = [24, 16, 8].map(|bits| ((self.low >> bits) + 1) << bits);
        self.low = rounded
            .into_iter()
            .find(|low| *low < end)
            .unwrap_or(self.low);
        for _ in 0..5 {
            self.shift();
        }
        while self.bytes.last() == Some(&0) {
            self.bytes.pop();
        }
        self.bytes
    }
}

impl BitCoder for RangeEncoder {
    #[inline]
    fn bit(&mut self, probability: &mut Probability, bit: bool) -> bool {
        let bound = (self.range >> 16) * u32::from(probability.zero);
        if bit {
            self.low += u64::from(bound);
            self.range -= bound;
        } else {
            self.range = bound;
        }
        probability.learn(bit);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}

/// Reads bits of any bytes; zeros follow them.
#[derive(Debug)]
pub(super) struct RangeDecoder<'a> {
    code: u32,
    range: u32,
    bytes: &'a [u8],
}

impl<'a> RangeDecoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self {
            code: 0,
            range: u32::MAX,
            bytes,
        };
        for _ in 0..4 {
            decoder.shift();
        }
        decoder
    }

    fn shift(&mut self) {
        let (byte, rest) = self.bytes.split_first().unwrap_or((&0, &[]));
        self.bytes = rest;
        self.code = (self.code << 8) | u32::from(*byte);
    }

    /// Bytes that no bit needed.
    pub(super) const fn unread(&self) -> usize {
        self.bytes.len()
    }
}

impl BitCoder for RangeDecoder<'_> {
    #[inline]
    fn bit(&mut self, probability: &mut Probability, _: bool) -> bool {
        let bound = (self.range >> 16) * u32::from(probability.zero);
        let bit = self.code >= bound;
        if bit {
            self.code -= bound;
            self.range -= bound;
        } else {
            self.range = bound;
        }
        probability.learn(bit);
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.shift();
        }
        bit
    }
}
