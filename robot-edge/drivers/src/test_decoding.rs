//! Decoding in tests: in one read, in any reads, with damage, and by a second decoder.

use std::fmt::Debug;
use std::path::Path;
use std::process::Command;

use proptest::prelude::*;

use crate::read_buffer::CAPACITY;
use crate::skip::skip;
use crate::{Decoder, Dropped};

/// Messages of the longest reads.
pub(crate) fn decode<D: Decoder>(decoder: D, bytes: &[u8]) -> (Vec<D::Message>, Dropped) {
    decode_in(decoder, bytes, &[CAPACITY])
}

/// Messages of reads with these lengths in turn.
pub(crate) fn decode_in<D: Decoder>(
    mut decoder: D,
    bytes: &[u8],
    lengths: &[usize],
) -> (Vec<D::Message>, Dropped) {
    let mut messages = Vec::new();
    let mut rest = bytes;
    for length in lengths.iter().cycle() {
        let (read, after) = rest.split_at((*length).min(rest.len()));
        decoder.push(read);
        messages.extend(std::iter::from_fn(|| decoder.next_message()));
        rest = after;
        if rest.is_empty() {
            break;
        }
    }
    (messages, decoder.dropped().clone())
}

/// The only message, of bytes of which nothing is dropped.
#[track_caller]
pub(crate) fn decode_one<D: Decoder<Message: Debug>>(decoder: D, bytes: &[u8]) -> D::Message {
    let (mut messages, dropped) = decode(decoder, bytes);
    assert_eq!(dropped, Dropped::default());
    assert_eq!(messages.len(), 1, "{messages:?}");
    messages.remove(0)
}

/// Lengths of reads.
pub(crate) fn read_lengths() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(prop_oneof![1..20_usize, 1..500_usize], 1..10)
}

/// What happens to bytes on a bad line.
#[derive(Clone, Debug)]
pub(crate) struct Damage {
    flips: Vec<(prop::sample::Index, u8)>,
    cut: (prop::sample::Index, usize),
    noise: Vec<u8>,
    lengths: Vec<usize>,
}

/// Damage with noise of any bytes and of `marks`, those that mean something in the protocol.
pub(crate) fn damage(marks: &'static [u8]) -> impl Strategy<Value = Damage> {
    let byte = prop_oneof![prop::sample::select(marks), any::<u8>()];
    let flips = prop::collection::vec(any::<(prop::sample::Index, u8)>(), 0..8);
    let cut = (
        any::<prop::sample::Index>(),
        prop_oneof![Just(0), 0..40_usize],
    );
    let noise = prop::collection::vec(byte, 0..100);
    let parts = (flips, cut, noise, read_lengths());
    parts.prop_map(|(flips, cut, noise, lengths)| Damage {
        flips,
        cut,
        noise,
        lengths,
    })
}

impl Damage {
    /// Messages of damaged bytes, which are the same in all reads.
    #[track_caller]
    pub(crate) fn decode<D: Decoder<Message: Debug>>(
        &self,
        new: impl Fn() -> D,
        mut bytes: Vec<u8>,
    ) -> Vec<D::Message> {
        let (at, length) = self.cut;
        let at = at.index(bytes.len() + 1);
        bytes.splice(at..bytes.len().min(at + length), self.noise.clone());
        for (at, mask) in &self.flips {
            if !bytes.is_empty() {
                *at.get_mut(&mut bytes) ^= mask;
            }
        }
        let whole = decode(new(), &bytes);
        let in_parts = decode_in(new(), &bytes, &self.lengths);
        assert_eq!(whole.1, in_parts.1);
        // Debug text: NaN is not equal to itself.
        assert_eq!(format!("{whole:?}"), format!("{in_parts:?}"));
        whole.0
    }
}

/// Bytes of hexadecimal digits, whatever is between them.
pub(crate) fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(u8::is_ascii_hexdigit).collect();
    let pair = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap();
    digits.chunks(2).map(pair).collect()
}

/// What a second decoder, `tests/python/SCRIPT`, prints of a capture; `None`, with a notice, without
/// Python.
pub(crate) fn second_decoder(script: &str, capture: &Path) -> Option<String> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/python");
    let command = Command::new("python3")
        .arg(folder.join(script))
        .arg(capture)
        .output();
    let Ok(output) = command else {
        skip("there is no python3", "package python3");
        return None;
    };
    assert!(output.status.success(), "{output:?}");
    Some(String::from_utf8(output.stdout).unwrap())
}
