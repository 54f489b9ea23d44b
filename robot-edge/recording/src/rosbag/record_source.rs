//! Records one after the other, out of a file or a chunk that may be damaged anywhere.

use std::io::{self, Read, Seek, SeekFrom};

use super::record::{MAX_HEADER_BYTES, RecordHeader, find_header};

/// Bytes looked through at a time for the next header behind damage.
const SEARCH_BYTES: usize = 64 << 10;

/// Longest record data that is kept in memory.
pub(super) const MAX_DATA_BYTES: u64 = 256 << 20;

/// What [`RecordSource::next`] found.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// A record; its data is next, to be read, skipped or walked into.
    Record(Record),
    /// Nothing that can be read, at byte `at`; the next call goes on with the next record that makes sense.
    Damage { at: u64, what: &'static str },
    /// The end comes in the middle of the record at byte `at`.
    CutOff { at: u64 },
    /// The end.
    End,
}

/// Where a record is and what its header says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Record {
    /// Byte at which the record begins.
    pub(super) at: u64,
    pub(super) header: RecordHeader,
    pub(super) data_bytes: u64,
}

/// Walks over records.
///
/// Chunks without compression need no care: their records follow their header.
///
/// A record whose length is damaged leads astray, so where what follows makes no sense, the search for the
/// next header starts inside the record before it.
#[derive(Debug)]
pub(super) struct RecordSource<R> {
    reader: R,
    at: u64,
    end: u64,
    /// The end according to what was read so far.
    expected_end: u64,
    /// Where the record last returned begins.
    last: u64,
    /// Whether chunks are compressed, once one was seen: a recorder packs all alike.
    is_compressed: Option<bool>,
    /// Bytes that may still be read a second time: without this limit a file made for it could cost time
    /// that grows with the square of its length.
    rereads_left: u64,
}

impl RecordSource<io::Cursor<Vec<u8>>> {
    /// Walks over the records that were in a chunk.
    pub(super) fn in_memory(records: Vec<u8>) -> io::Result<Self> {
        let end = records.len() as u64;
        let mut source = Self::new(io::Cursor::new(records), 0, end)?;
        source.is_compressed = Some(false);
        Ok(source)
    }
}

impl<R: Read + Seek> RecordSource<R> {
    /// Walks over the records in `reader` from byte `at` to byte `end`, its length.
    pub(super) fn new(mut reader: R, at: u64, end: u64) -> io::Result<Self> {
        reader.seek(SeekFrom::Start(at))?;
        Ok(Self {
            reader,
            at,
            end,
            expected_end: end,
            last: at,
            is_compressed: None,
            rereads_left: end.saturating_mul(2).saturating_add(16 << 20),
        })
    }

    /// Where the next byte will come from.
    pub(super) fn at(&self) -> u64 {
        self.at.min(self.end)
    }

    /// Whether the data of the record last returned does not end before the end.
    pub(super) const fn reaches_beyond_end(&self, record: &Record) -> bool {
        self.at.saturating_add(record.data_bytes) > self.end
    }

    /// Takes note that there should be data up to byte `end`.
    pub(super) fn extend_expected_end(&mut self, end: u64) {
        self.expected_end = self.expected_end.max(end);
    }

    /// The next record.
    pub(super) fn next(&mut self) -> io::Result<Found> {
        let at = self.at;
        if at > self.end {
            return self.recover(TRUNCATED_RECORD);
        }
        if at == self.end {
            let cut = self.expected_end > self.end;
            self.expected_end = self.end;
            return Ok(if cut {
                Found::CutOff { at }
            } else {
                Found::End
            });
        }
        match self.read_header()? {
            Ok(record) => {
                self.last = at;
                Ok(Found::Record(record))
            }
            Err(what) => {
                self.at = at;
                self.recover(what)
            }
        }
    }

    /// Reads the data of the record last returned into `data`, which is emptied first; `false` where it
    /// is longer than [`MAX_DATA_BYTES`] and was skipped.
    pub(super) fn read_data(&mut self, record: &Record, data: &mut Vec<u8>) -> io::Result<bool> {
        data.clear();
        if record.data_bytes > MAX_DATA_BYTES {
            self.skip(record.data_bytes)?;
            return Ok(false);
        }
        let read = (&mut self.reader)
            .take(record.data_bytes)
            .read_to_end(data)?;
        self.at += read as u64;
        Ok(true)
    }

    /// Passes over `bytes` of data.
    pub(super) fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.at += bytes;
        // A relative seek keeps what is buffered.
        let bytes = i64::try_from(bytes).unwrap_or(i64::MAX);
        self.reader.seek_relative(bytes)
    }

    /// Hands the data of the record last returned, a compressed chunk, to `read`, and passes over it.
    pub(super) fn with_data<T>(
        &mut self,
        record: &Record,
        read: impl FnOnce(&mut dyn Read) -> T,
    ) -> io::Result<T> {
        let result = read(&mut (&mut self.reader).take(record.data_bytes));
        self.at += record.data_bytes;
        self.reader.seek(SeekFrom::Start(self.at))?;
        Ok(result)
    }

    /// A header and the length of the data behind it, or what is wrong with them.
    fn read_header(&mut self) -> io::Result<Result<Record, &'static str>> {
        let at = self.at;
        let Some(header_bytes) = self.read_u32()? else {
            return Ok(Err(TRUNCATED_RECORD));
        };
        if header_bytes as usize > MAX_HEADER_BYTES {
            return Ok(Err("a record header of a senseless length"));
        }
        if u64::from(header_bytes) > self.end - self.at {
            return Ok(Err(TRUNCATED_RECORD));
        }
        let mut buffer = [0; MAX_HEADER_BYTES];
        let header = &mut buffer[..header_bytes as usize];
        self.reader.read_exact(header)?;
        self.at += u64::from(header_bytes);
        let header = match RecordHeader::parse(header) {
            Ok(header) => header,
            Err(what) => return Ok(Err(what)),
        };
        let Some(data_bytes) = self.read_u32()? else {
            return Ok(Err(TRUNCATED_RECORD));
        };
        let record = Record {
            at,
            header,
            data_bytes: u64::from(data_bytes),
        };
        if record
            .header
            .expected_data_bytes()
            .is_some_and(|expected| expected != record.data_bytes)
        {
            return Ok(Err(
                "an index whose length contradicts its number of entries",
            ));
        }
        if matches!(record.header, RecordHeader::Chunk { .. }) {
            self.is_compressed = Some(record.header.is_packed_chunk());
            // What of it is there is worth reading.
            self.extend_expected_end(self.at + record.data_bytes);
        } else if record.data_bytes > self.end - self.at {
            return Ok(Err(TRUNCATED_RECORD));
        }
        Ok(Ok(record))
    }

    fn read_u32(&mut self) -> io::Result<Option<u32>> {
        if self.end - self.at < 4 {
            return Ok(None);
        }
        let mut bytes = [0; 4];
        self.reader.read_exact(&mut bytes)?;
        self.at += 4;
        Ok(Some(u32::from_le_bytes(bytes)))
    }

    /// Goes from damage to the next header, or to the end.
    fn recover(&mut self, what: &'static str) -> io::Result<Found> {
        let at = self.at();
        let mut from = at + 1;
        if self.last < at && at - self.last <= self.rereads_left {
            self.rereads_left -= at - self.last;
            from = self.last + 1;
        }
        // Compressed data holds pieces of records in clear: behind damage in a packed bag only the next
        // chunk is a place to go on from.
        let is_compressed = match self.is_compressed {
            Some(is_compressed) => is_compressed,
            None => self
                .search(from, is_chunk)?
                .is_some_and(|(_, chunk)| chunk.is_packed_chunk()),
        };
        let accept = if is_compressed { is_chunk } else { is_no_bag };
        let found = match self.search(from, accept)? {
            // The header that was just judged; one before it would have been found first.
            Some((same, _)) if same == at => self.search(at + 1, accept)?,
            found => found,
        };
        let found = found.map(|(at, _)| at);
        self.at = found.unwrap_or(self.end);
        self.last = self.at;
        self.reader.seek(SeekFrom::Start(self.at))?;
        if found.is_none() && what == TRUNCATED_RECORD {
            self.expected_end = self.end;
            return Ok(Found::CutOff { at });
        }
        Ok(Found::Damage { at, what })
    }

    /// The first header at or behind `from` that `accept` accepts, and where it begins.
    fn search(
        &mut self,
        from: u64,
        accept: fn(&RecordHeader) -> bool,
    ) -> io::Result<Option<(u64, RecordHeader)>> {
        let mut window = Vec::with_capacity(SEARCH_BYTES + 2 * MAX_HEADER_BYTES);
        let mut window_at = from;
        self.reader.seek(SeekFrom::Start(from))?;
        loop {
            let read = (&mut self.reader)
                .take(SEARCH_BYTES as u64)
                .read_to_end(&mut window)?;
            if let Some((found, header)) = find_header(&window, accept) {
                return Ok(Some((window_at + found as u64, header)));
            }
            if read == 0 {
                return Ok(None);
            }
            // A header may begin in this window and end in the next.
            let passed = window.len().saturating_sub(MAX_HEADER_BYTES + 4);
            window.drain(..passed);
            window_at += passed as u64;
        }
    }
}

fn is_chunk(header: &RecordHeader) -> bool {
    matches!(header, RecordHeader::Chunk { .. })
}

fn is_no_bag(header: &RecordHeader) -> bool {
    !matches!(header, RecordHeader::Bag { .. })
}

const TRUNCATED_RECORD: &str = "a record that is longer than what is left";

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::super::bag_bytes::{chunk, connection, index, message};
    use super::*;

    /// Numbers of the messages found, `!` for damage, `/` for a cut.
    fn walk(bytes: &[u8]) -> String {
        let mut source = RecordSource::new(Cursor::new(bytes), 0, bytes.len() as u64).unwrap();
        let mut walked = String::new();
        let mut data = Vec::new();
        loop {
            match source.next().unwrap() {
                Found::End => return walked,
                Found::Damage { .. } => walked.push('!'),
                Found::CutOff { .. } => walked.push('/'),
                Found::Record(record) => match record.header {
                    RecordHeader::Message { conn, .. } => {
                        assert!(source.read_data(&record, &mut data).unwrap());
                        assert_eq!(data.len() as u64, record.data_bytes);
                        walked += &conn.to_string();
                    }
                    RecordHeader::Chunk { .. } => walked.push('c'),
                    RecordHeader::Connection { .. }
                    | RecordHeader::Bag { .. }
                    | RecordHeader::Index { .. }
                    | RecordHeader::ChunkInfo { .. } => source.skip(record.data_bytes).unwrap(),
                },
            }
        }
    }

    fn messages(numbers: std::ops::Range<u32>) -> Vec<u8> {
        numbers.flat_map(|n| message(n, n, &[7; 100])).collect()
    }

    #[test]
    fn chunks_without_compression_are_walked_into() {
        let bytes = [
            chunk("none", &messages(0..3)),
            index(0, 3),
            chunk("none", &messages(3..5)),
        ]
        .concat();
        assert_eq!(walk(&bytes), "c012c34");
    }

    #[test]
    fn a_wrong_length_costs_one_record() {
        let good = messages(0..6);
        let length_at = good.len() / 6 * 2 + message(0, 0, &[]).len() - 4;
        assert_eq!(&good[length_at..length_at + 5], [100, 0, 0, 0, 7]);
        for wrong in [0_u32, 99, 101, 180, 300, 100_000] {
            let mut bytes = good.clone();
            bytes[length_at..length_at + 4].copy_from_slice(&wrong.to_le_bytes());
            let walked = walk(&bytes);
            assert!(walked.contains('!'), "{wrong}: {walked}");
            assert!(walked.ends_with("345"), "{wrong}: {walked}");
            assert!(walked.starts_with("01"), "{wrong}: {walked}");
        }
    }

    #[test]
    fn garbage_between_records_is_passed() {
        let mut garbage = vec![0xa5; 200_000];
        garbage.extend(b"\x04\x00\x00\x00op=\x05");
        garbage.extend([0xa5; 3]);
        let bytes = [messages(0..2), garbage, messages(2..4)].concat();
        assert_eq!(walk(&bytes), "01!23");
    }

    #[test]
    fn an_end_inside_a_record_is_a_cut() {
        let bytes = messages(0..3);
        for cut in [1, 5, 30, 100] {
            assert_eq!(walk(&bytes[..bytes.len() - cut]), "01/", "{cut}");
        }
        assert_eq!(walk(&connection(1, "/scan", "x")[..30]), "/");
    }

    #[test]
    fn headers_that_promise_too_much_take_linear_time() {
        // Each header claims the whole rest; each lands on what is no record.
        let count = 20_000_u32;
        let mut bytes = Vec::new();
        for n in 0..count {
            let mut header = message(n, n, &[]);
            let promised = header.len() as u32 * (count - n) / 2;
            let length_at = header.len() - 4;
            header[length_at..].copy_from_slice(&promised.to_le_bytes());
            bytes.extend(header);
        }
        assert!(!walk(&bytes).is_empty());
    }
}
