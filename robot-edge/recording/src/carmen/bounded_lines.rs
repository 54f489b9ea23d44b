//! Lines of a file that may hold anything, in bounded memory.

use std::io::{self, BufRead, Read};

/// A scan of 10,000 beams with remissions is about 150 kB of text.
pub(super) const MAX_LINE_BYTES: usize = 1 << 20;

/// What [`BoundedLines::next_line`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineEnd {
    /// A whole line.
    Newline,
    /// The file ends without a newline: the line may be cut.
    EndOfFile,
    /// Longer than [`MAX_LINE_BYTES`]; what follows up to the newline was skipped.
    TooLong,
}

/// Reads lines into one buffer.
#[derive(Debug)]
pub(super) struct BoundedLines<R> {
    reader: R,
    line: Vec<u8>,
    line_number: u64,
    bytes_read: u64,
}

impl<R: BufRead> BoundedLines<R> {
    pub(super) const fn new(reader: R) -> Self {
        Self {
            reader,
            line: Vec::new(),
            line_number: 0,
            bytes_read: 0,
        }
    }

    /// Moves to the next line; `None` at the end of the file.
    pub(super) fn next_line(&mut self) -> io::Result<Option<LineEnd>> {
        self.line.clear();
        let read = (&mut self.reader)
            .take(MAX_LINE_BYTES as u64 + 1)
            .read_until(b'\n', &mut self.line)?;
        if read == 0 {
            return Ok(None);
        }
        self.line_number += 1;
        self.bytes_read += read as u64;
        if self.line.last() == Some(&b'\n') {
            return Ok(Some(LineEnd::Newline));
        }
        if read <= MAX_LINE_BYTES {
            return Ok(Some(LineEnd::EndOfFile));
        }
        self.bytes_read += self.reader.skip_until(b'\n')? as u64;
        Ok(Some(LineEnd::TooLong))
    }

    /// The line last moved to.
    pub(super) fn line(&self) -> &[u8] {
        &self.line
    }

    /// Its number, from 1.
    pub(super) const fn line_number(&self) -> u64 {
        self.line_number
    }

    /// Bytes read so far.
    pub(super) const fn bytes_read(&self) -> u64 {
        self.bytes_read
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_skipped_and_the_next_is_whole() {
        let mut text = b"one\n".to_vec();
        text.extend(vec![b'x'; MAX_LINE_BYTES + 5]);
        text.extend(b"\nthree\nfour");
        let mut lines = BoundedLines::new(&text[..]);
        assert_eq!(lines.next_line().unwrap(), Some(LineEnd::Newline));
        assert_eq!(lines.line(), b"one\n");
        assert_eq!(lines.next_line().unwrap(), Some(LineEnd::TooLong));
        assert!(lines.line().len() <= MAX_LINE_BYTES + 1);
        assert_eq!(lines.next_line().unwrap(), Some(LineEnd::Newline));
        assert_eq!((lines.line(), lines.line_number()), (&b"three\n"[..], 3));
        assert_eq!(lines.next_line().unwrap(), Some(LineEnd::EndOfFile));
        assert_eq!(lines.next_line().unwrap(), None);
        assert_eq!(lines.bytes_read(), text.len() as u64);
    }
}
