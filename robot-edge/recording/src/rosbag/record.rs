//! Records of a ROS bag: headers, chunks, and walking over damage.

use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};

use measurement::time::RobotTime;

/// Bytes looked through at a time for the next header behind damage.
const SEARCH_BYTES: usize = 64 << 10;

/// Longest record data that is kept in memory.
pub(super) const MAX_DATA_BYTES: u64 = 256 << 20;

/// Result of [`RecordSource::next`].
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

/// Place and header of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Record {
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
    /// Offset of the record last returned.
    last: u64,
    /// Whether chunks are compressed; a recorder compresses all or none. `None` before the first chunk.
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

    /// Offset of the next byte.
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
        if let RecordHeader::Index { data_bytes } = record.header
            && data_bytes != record.data_bytes
        {
            return Ok(Err(
                "an index whose length contradicts its number of entries",
            ));
        }
        if matches!(record.header, RecordHeader::Chunk { .. }) {
            self.is_compressed = Some(record.header.is_packed_chunk());
            // The part that exists is read.
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

/// Longest header that is read: real ones hold a topic name at most.
pub(super) const MAX_HEADER_BYTES: usize = 4096;

/// How far before its operation code [`find_header`] looks for a header's start: a topic's name may come first.
const MAX_BYTES_BEFORE_OP: usize = 512;

/// Header of a record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum RecordHeader {
    /// The first record.
    Bag {
        /// Offset of the connections and chunk infos; 0 in a bag that was never closed.
        index_pos: u64,
    },
    /// Messages and connections, perhaps compressed.
    Chunk {
        compression: Compression,
        /// Bytes once decompressed.
        size: u32,
    },
    /// Topic and type behind a number.
    Connection { conn: u32, topic: String },
    /// One message.
    Message { conn: u32, time: RobotTime },
    /// Offsets of messages in the previous chunk, or times and counts of a chunk: not needed.
    Index { data_bytes: u64 },
}

/// How a chunk is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compression {
    None,
    Bzip2,
    Lz4,
}

impl RecordHeader {
    /// Reads a header, without the length before it.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, &'static str> {
        let fields = Fields::parse(bytes)?;
        let [op] = fields.number("op", "no operation code")?;
        match op {
            0x02 => Ok(Self::Message {
                conn: fields.conn()?,
                time: fields.time("time")?,
            }),
            0x03 => Ok(Self::Bag {
                index_pos: u64::from_le_bytes(fields.number("index_pos", "no index position")?),
            }),
            0x04 => {
                fields.conn()?;
                Ok(Self::Index {
                    data_bytes: fields.count()? * 12,
                })
            }
            0x05 => {
                let size = u32::from_le_bytes(fields.number("size", "no chunk size")?);
                let compression = match fields.get("compression") {
                    Some(b"none") => Compression::None,
                    Some(b"bz2") => Compression::Bzip2,
                    Some(b"lz4") => Compression::Lz4,
                    _ => return Err("a compression other than none, bz2 and lz4"),
                };
                Ok(Self::Chunk { compression, size })
            }
            0x06 => Ok(Self::Index {
                data_bytes: fields.count()? * 8,
            }),
            0x07 => Ok(Self::Connection {
                conn: fields.conn()?,
                topic: text(fields.get("topic").ok_or("no topic")?)?,
            }),
            _ => Err("an unknown operation code"),
        }
    }

    /// Whether this is a chunk whose records cannot be read where they are.
    pub(super) const fn is_packed_chunk(&self) -> bool {
        matches!(
            self,
            Self::Chunk {
                compression: Compression::Bzip2 | Compression::Lz4,
                ..
            }
        )
    }
}

/// Type of the messages behind a connection, from the connection record's data; empty where it names none.
pub(super) fn connection_type(data: &[u8]) -> Result<String, &'static str> {
    Fields::parse(data)?
        .get("type")
        .map_or(Ok(String::new()), text)
}

/// Finds the first thing in `bytes` that reads like a whole record header, its length included, and that
/// `accept` accepts: for finding one's feet again behind damage.
pub(super) fn find_header(
    bytes: &[u8],
    accept: impl Fn(&RecordHeader) -> bool,
) -> Option<(usize, RecordHeader)> {
    const OP: &[u8] = b"\x04\x00\x00\x00op=";
    let mut from = 0;
    while let Some(found) = bytes[from..]
        .windows(OP.len())
        .position(|window| window == OP)
    {
        let op = from + found;
        let earliest = op.saturating_sub(MAX_BYTES_BEFORE_OP);
        // The operation code can be anywhere in its header.
        let header = (earliest..=op.saturating_sub(4)).rev().find_map(|start| {
            let (header, end) = header_at(bytes, start)?;
            (end > op && accept(&header)).then_some((start, header))
        });
        if header.is_some() {
            return header;
        }
        from = op + OP.len();
    }
    None
}

/// The header whose length is at `start`, and its end.
fn header_at(bytes: &[u8], start: usize) -> Option<(RecordHeader, usize)> {
    let (length, rest) = bytes.get(start..)?.split_first_chunk()?;
    let length = u32::from_le_bytes(*length) as usize;
    if length > MAX_HEADER_BYTES {
        return None;
    }
    let header = RecordHeader::parse(rest.get(..length)?).ok()?;
    Some((header, start + 4 + length))
}

/// The fields of a header, in place.
struct Fields<'a>(Vec<(&'a [u8], &'a [u8])>);

impl<'a> Fields<'a> {
    fn parse(mut bytes: &'a [u8]) -> Result<Self, &'static str> {
        let mut fields = Vec::with_capacity(8);
        while !bytes.is_empty() {
            let (length, rest) = bytes.split_first_chunk().ok_or("a field without length")?;
            let (field, rest) = rest
                .split_at_checked(u32::from_le_bytes(*length) as usize)
                .ok_or("a field longer than its header")?;
            let equals = field
                .iter()
                .position(|&byte| byte == b'=')
                .ok_or("a field without =")?;
            fields.push((&field[..equals], &field[equals + 1..]));
            bytes = rest;
        }
        Ok(Self(fields))
    }

    fn get(&self, name: &str) -> Option<&'a [u8]> {
        self.0
            .iter()
            .find(|(field, _)| *field == name.as_bytes())
            .map(|(_, value)| *value)
    }

    fn number<const N: usize>(
        &self,
        name: &str,
        missing: &'static str,
    ) -> Result<[u8; N], &'static str> {
        self.get(name)
            .and_then(|value| value.try_into().ok())
            .ok_or(missing)
    }

    fn conn(&self) -> Result<u32, &'static str> {
        self.number("conn", "no connection number")
            .map(u32::from_le_bytes)
    }

    fn count(&self) -> Result<u64, &'static str> {
        let count = self.number("count", "no count")?;
        Ok(u64::from(u32::from_le_bytes(count)))
    }

    fn time(&self, name: &str) -> Result<RobotTime, &'static str> {
        // Two u32: seconds, then nanoseconds.
        let both = u64::from_le_bytes(self.number(name, "no time")?);
        let [secs, nanos] = [both as u32, (both >> 32) as u32].map(i64::from);
        Ok(RobotTime::from_nanos(secs * 1_000_000_000 + nanos))
    }
}

fn text(bytes: &[u8]) -> Result<String, &'static str> {
    str::from_utf8(bytes)
        .map(str::to_owned)
        .ok()
        .ok_or("a name that is not text")
}

/// The records in a chunk that was compressed.
#[derive(Debug)]
pub(super) struct Chunk {
    /// Byte of the file at which it begins.
    pub(super) at: u64,
    pub(super) is_cut: bool,
    pub(super) records: RecordSource<Cursor<Vec<u8>>>,
}

/// Decompresses the valid part of a chunk and returns the fault of the rest.
///
/// Both formats carry checksums. If they do not match, the chunk is not used. Of a chunk that the end
/// of the file cuts off (`is_cut`) all that comes before the cut is. `size` is what the chunk's header says
/// of the bytes in it.
pub(super) fn decompress(
    compression: Compression,
    size: u32,
    is_cut: bool,
    data: &mut dyn Read,
) -> (Vec<u8>, Option<&'static str>) {
    let mut records = Vec::new();
    let result = match compression {
        Compression::None => read_limited(data, &mut records),
        Compression::Bzip2 => read_limited(
            bzip2::bufread::BzDecoder::new(BufReader::new(data)),
            &mut records,
        ),
        // roslz4 writes standard frames: independent blocks, content checksum.
        Compression::Lz4 => read_limited(lz4_flex::frame::FrameDecoder::new(data), &mut records),
    };
    if records.len() as u64 > MAX_DATA_BYTES {
        records.truncate(MAX_DATA_BYTES as usize);
        return (records, Some("a chunk of more than 256 MiB"));
    }
    let ends_early = match &result {
        // An lz4 frame that ends between two blocks ends without an error.
        Ok(()) => records.len() < size as usize,
        Err(error) => error.kind() == io::ErrorKind::UnexpectedEof,
    };
    if ends_early && is_cut {
        (records, Some("a chunk that is cut off"))
    } else if ends_early || result.is_err() {
        (Vec::new(), Some("a chunk that cannot be decompressed"))
    } else {
        (records, None)
    }
}

fn read_limited(data: impl Read, records: &mut Vec<u8>) -> io::Result<()> {
    data.take(MAX_DATA_BYTES + 1)
        .read_to_end(records)
        .map(|_| ())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::rosbag::tests::{chunk, connection, index, message};

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
                    _ => source.skip(record.data_bytes).unwrap(),
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

    fn packed(name: &str, records: &[u8]) -> Vec<u8> {
        let record = chunk(name, records);
        let header_bytes = 4 + u32::from_le_bytes(record[..4].try_into().unwrap()) as usize + 4;
        record[header_bytes..].to_vec()
    }

    /// Not repetitive, so that no codec makes it short.
    fn records(count: usize) -> Vec<u8> {
        let mut state = 1_u32;
        let next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 28) as u8
        };
        std::iter::repeat_with(next).take(count).collect()
    }

    #[test]
    fn chunks_come_out_as_they_went_in() {
        let records = records(3_000_000);
        for (name, compression) in [
            ("none", Compression::None),
            ("bz2", Compression::Bzip2),
            ("lz4", Compression::Lz4),
        ] {
            let (out, wrong) = decompress(
                compression,
                records.len() as u32,
                false,
                &mut &packed(name, &records)[..],
            );
            assert_eq!((out == records, wrong), (true, None), "{name}");
        }
    }

    #[test]
    fn damaged_chunks_yield_nothing_wrong() {
        let records = records(2_000_000);
        for (name, compression) in [("bz2", Compression::Bzip2), ("lz4", Compression::Lz4)] {
            let whole = packed(name, &records);
            let mut cut = whole.clone();
            cut.truncate(whole.len() * 3 / 4);
            let (out, wrong) = decompress(compression, records.len() as u32, true, &mut &cut[..]);
            assert_eq!(wrong, Some("a chunk that is cut off"), "{name}");
            assert!(!out.is_empty() && records.starts_with(&out), "{name}");

            for at in [5, whole.len() / 3, whole.len() / 2, whole.len() - 6] {
                let mut flipped = whole.clone();
                flipped[at] ^= 0x10;
                let (out, wrong) =
                    decompress(compression, records.len() as u32, false, &mut &flipped[..]);
                assert!(wrong.is_some(), "{name}, byte {at}");
                assert!(records.starts_with(&out), "{name}, byte {at}");
            }
        }
    }
}
