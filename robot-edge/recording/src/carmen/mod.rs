//! CARMEN logs (`.log`, `.clf`): text, a message a line, in the order in which things happened.

mod line;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use measurement::drops::{DropCounts, DropReason};
use measurement::time::{RobotDuration, RobotTime};
use measurement::{FrameId, Measurement, Stream, StreamId};

use self::line::Layout;
use super::{Position, RecordingError, RecordingReader, Selection, StreamSummary};
use crate::messages::LossLog;

/// Message names a log may hold before more are taken for garbage; CARMEN itself knows about 20.
const MAX_STREAMS: usize = 64;

/// Reads the lasers and the odometry of a CARMEN log; a stream is a message name (`FLASER`).
///
/// - `FLASER` and `RLASER` lines name no angles: half a circle, see [`CarmenReader::with_laser_range_max_m`]
///   for their limit. The limit of `ROBOTLASER` and `RAWLASER` is their own, at most 80 m.
/// - A measurement's stamp is the line's first (`ipc`) stamp. Stamps that contradict the order of the lines
///   of their stream are repaired and counted in [`RecordingReader::stamp_repairs`].
/// - Lines of other messages are counted by name, damaged lines in [`RecordingReader::losses`].
#[derive(Debug)]
pub struct CarmenReader {
    path: PathBuf,
    lines: BoundedLines<BufReader<File>>,
    bytes_total: u64,
    selection: Selection,
    laser_range_max_m: f32,
    summaries: Vec<StreamSummary>,
    /// Beside each summary.
    streams: Vec<LogStream>,
    losses: LossLog,
    stamp_repairs: u64,
}

/// State of one message name.
#[derive(Debug)]
struct LogStream {
    /// `None` where its lines are only counted.
    layout: Option<Layout>,
    frame: FrameId,
    stamps: StampRepair,
    repair_reported: bool,
}

impl CarmenReader {
    /// Opens the log at `path`.
    pub fn open(path: &Path, selection: Selection) -> Result<Self, RecordingError> {
        let io_error = RecordingError::io(path);
        let file = File::open(path).map_err(io_error)?;
        let bytes_total = file.metadata().map_err(io_error)?.len();
        Ok(Self {
            path: path.to_owned(),
            lines: BoundedLines::new(BufReader::with_capacity(1 << 16, file)),
            bytes_total,
            selection,
            laser_range_max_m: line::DEFAULT_RANGE_MAX_M,
            summaries: Vec::new(),
            streams: Vec::new(),
            losses: LossLog::default(),
            stamp_repairs: 0,
        })
    }

    /// Makes `FLASER` and `RLASER` ranges at or above `range_max_m` misses, instead of those from 80 m:
    /// these lines do not say what their laser reports where it sees nothing, but
    /// `Survey` finds it.
    #[must_use]
    pub const fn with_laser_range_max_m(mut self, range_max_m: f32) -> Self {
        self.laser_range_max_m = range_max_m;
        self
    }

    /// The measurement of the current line, if any.
    fn read_line(&mut self, end: LineEnd) -> Option<Measurement> {
        let line_number = self.lines.line_number();
        if end == LineEnd::TooLong {
            self.losses.add(DropReason::Damaged, || {
                format!("line {line_number}: longer than {MAX_LINE_BYTES} bytes")
            });
            return None;
        }
        if end == LineEnd::EndOfFile {
            // CARMEN ends every line with a newline; all fields but the last may still be complete.
            self.losses.add(DropReason::CutOff, || {
                format!("line {line_number}: the recording ends inside this line")
            });
        }
        let text = self.lines.line().trim_ascii();
        if text.is_empty() || text.starts_with(b"#") {
            return None;
        }
        let Ok(text) = str::from_utf8(text) else {
            self.losses.add(DropReason::Damaged, || {
                format!("line {line_number}: not text")
            });
            return None;
        };
        let (name, fields) = text
            .split_once(|c: char| c.is_ascii_whitespace())
            .unwrap_or((text, ""));
        let Some(index) = stream_index(&mut self.summaries, &mut self.streams, name) else {
            self.losses.add(DropReason::Damaged, || {
                format!("line {line_number}: begins with no message name")
            });
            return None;
        };
        let (stream, summary) = (&mut self.streams[index], &mut self.summaries[index]);
        summary.messages += 1;
        let layout = stream.layout.filter(|_| self.selection.contains(name))?;
        match line::parse(layout, fields, self.laser_range_max_m) {
            Ok((raw_stamp, data)) => {
                let (stamp, repair) = stream.stamps.repair(raw_stamp);
                if repair != Repair::None {
                    self.stamp_repairs += 1;
                    if !std::mem::replace(&mut stream.repair_reported, true) {
                        let name = &summary.stream.name;
                        self.losses
                            .note(|| repair_note(line_number, name, raw_stamp, repair));
                    }
                }
                summary.first.get_or_insert(stamp);
                summary.last = Some(stamp);
                Some(Measurement {
                    stamp,
                    stream: StreamId(index as u16),
                    frame: stream.frame.clone(),
                    data,
                })
            }
            Err(error) => {
                // A line that is cut off was counted as such.
                if end == LineEnd::Newline {
                    let name = &summary.stream.name;
                    self.losses.add(error.reason(), || {
                        format!("line {line_number}: {name}: {error}")
                    });
                }
                None
            }
        }
    }
}

impl RecordingReader for CarmenReader {
    fn next_measurement(&mut self) -> Result<Option<Measurement>, RecordingError> {
        loop {
            let end = self.lines.next_line();
            let Some(end) = end.map_err(RecordingError::io(&self.path))? else {
                return Ok(None);
            };
            if let Some(measurement) = self.read_line(end) {
                return Ok(Some(measurement));
            }
        }
    }

    fn streams(&self) -> &[StreamSummary] {
        &self.summaries
    }

    fn losses(&self) -> &DropCounts {
        self.losses.counts()
    }

    fn loss_notes(&self) -> &[String] {
        self.losses.notes()
    }

    fn position(&self) -> Position {
        Position {
            bytes_read: self.lines.bytes_read(),
            bytes_total: self.bytes_total,
        }
    }

    fn stamp_repairs(&self) -> u64 {
        self.stamp_repairs
    }
}

/// Whether the first bytes of a file (some kilobytes) are those of a CARMEN log: among its first 100 lines
/// one is of a message this module reads or of a parameter, or the header comment of CARMEN's logger.
pub(super) fn is_carmen(beginning: &[u8]) -> bool {
    beginning
        .split(|&byte| byte == b'\n')
        .take(100)
        .any(|line| {
            let line = str::from_utf8(line.trim_ascii()).unwrap_or("");
            let name = line.split_ascii_whitespace().next().unwrap_or("");
            line::layout_of(name).is_some()
                || name == "PARAM"
                || line.starts_with("# message_name")
                || line.starts_with("# message formats defined")
        })
}

/// Index of the stream called `name`, new ones included; `None` where `name` is no message name, or one
/// too many.
fn stream_index(
    summaries: &mut Vec<StreamSummary>,
    streams: &mut Vec<LogStream>,
    name: &str,
) -> Option<usize> {
    if let Some(index) = summaries.iter().position(|known| known.stream.name == name) {
        return Some(index);
    }
    let layout = line::layout_of(name);
    if layout.is_none() && (summaries.len() >= MAX_STREAMS || !line::is_message_name(name)) {
        return None;
    }
    summaries.push(StreamSummary {
        stream: Stream {
            name: name.to_owned(),
            type_name: format!("carmen/{name}"),
        },
        understood: layout.is_some(),
        messages: 0,
        first: None,
        last: None,
    });
    streams.push(LogStream {
        layout: layout.map(|(layout, _)| layout),
        frame: layout.map_or("", |(_, frame)| frame).into(),
        stamps: StampRepair::default(),
        repair_reported: false,
    });
    Some(summaries.len() - 1)
}

fn repair_note(line_number: u64, name: &str, raw_stamp: RobotTime, repair: Repair) -> String {
    let what = match repair {
        Repair::Held(back) => format!("goes back by {} s and is held", back.as_secs_f64()),
        Repair::ClockChange | Repair::None => {
            format!("{raw_stamp} is of another clock; time goes on from the one before")
        }
    };
    format!("line {line_number}: the stamp of {name} {what} (later ones only counted)")
}

/// A scan of 10,000 beams with remissions is about 150 kB of text.
const MAX_LINE_BYTES: usize = 1 << 20;

/// Result of [`BoundedLines::next_line`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LineEnd {
    /// A whole line.
    Newline,
    /// The file ends without a newline: the line may be cut.
    EndOfFile,
    /// Longer than [`MAX_LINE_BYTES`]; what follows up to the newline was skipped.
    TooLong,
}

/// Reads lines into one buffer.
#[derive(Debug)]
struct BoundedLines<R> {
    reader: R,
    line: Vec<u8>,
    line_number: u64,
    bytes_read: u64,
}

impl<R: BufRead> BoundedLines<R> {
    const fn new(reader: R) -> Self {
        Self {
            reader,
            line: Vec::new(),
            line_number: 0,
            bytes_read: 0,
        }
    }

    /// Moves to the next line; `None` at the end of the file.
    fn next_line(&mut self) -> io::Result<Option<LineEnd>> {
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

    fn line(&self) -> &[u8] {
        &self.line
    }

    /// Its number, from 1.
    const fn line_number(&self) -> u64 {
        self.line_number
    }

    const fn bytes_read(&self) -> u64 {
        self.bytes_read
    }
}

/// A step longer than this, either way, is a change of clock: no log lasts 11 days.
const CLOCK_CHANGE: RobotDuration = RobotDuration::from_millis(1_000_000_000);

/// Repair of a stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Repair {
    /// Nothing.
    None,
    /// It went back by this much, and was held at the one before.
    Held(RobotDuration),
    /// It is of another clock, which is taken to go on where the old one stood.
    ClockChange,
}

/// The stamps of one stream so far.
#[derive(Clone, Copy, Debug, Default)]
struct StampRepair {
    last: Option<RobotTime>,
    clock_offset: RobotDuration,
}

impl StampRepair {
    /// The stamp to use for a line stamped `raw`: never before the one returned last.
    fn repair(&mut self, raw: RobotTime) -> (RobotTime, Repair) {
        let stamp = raw + self.clock_offset;
        let Some(last) = self.last else {
            self.last = Some(stamp);
            return (stamp, Repair::None);
        };
        let step = stamp.since(last);
        if step > CLOCK_CHANGE || last.since(stamp) > CLOCK_CHANGE {
            self.clock_offset = last.since(raw);
            return (last, Repair::ClockChange);
        }
        if step < RobotDuration::ZERO {
            return (last, Repair::Held(last.since(stamp)));
        }
        self.last = Some(stamp);
        (stamp, Repair::None)
    }
}

#[cfg(test)]
mod tests;
