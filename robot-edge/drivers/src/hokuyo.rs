//! Hokuyo laser scanners (URG, UBG, UHG, UTM, UST): SCIP 2.0 over USB, RS-232 or TCP port 10940.
//!
//! Source: Hokuyo, Communication Protocol Specification for SCIP2.0 Standard (C-42-03320B), called
//! "manual" below. Multi-echo data and the sums of text lines: `urg_library/current/src/urg_sensor.c`
//! of Hokuyo-aut/urg_node2 at 815a110. A reply is the request, a status, lines of data and an empty
//! line. Every line after the request ends with a sum of its bytes.
//!
//! Steps count counter-clockwise as seen from above; [`Parameters::front_step`] is the sensor's x
//! axis.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use measurement::scan::Scan;

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder};

mod session;

pub use session::Hokuyo;

/// Requests without arguments. The reply to each is a [`Message::Status`] if nothing else is said.
pub mod request {
    /// Leaves SCIP 1.1. Status `0E` (unknown command) from a sensor that has only SCIP 2.
    pub const SCIP2: &[u8] = b"SCIP2.0\n";
    /// Switches the laser on. Status `02`: it is on.
    pub const LASER_ON: &[u8] = b"BM\n";
    /// Ends measuring and switches the laser off.
    pub const LASER_OFF: &[u8] = b"QT\n";
    /// Settings and sensor time back to those after power-on.
    pub const RESET: &[u8] = b"RS\n";
    /// Enters the mode for [`TIME`]; no measuring meanwhile.
    pub const TIME_MODE_ON: &[u8] = b"TM0\n";
    /// Asks for the sensor's time, [`super::Message::Time`].
    pub const TIME: &[u8] = b"TM1\n";
    /// Leaves the mode for [`TIME`].
    pub const TIME_MODE_OFF: &[u8] = b"TM2\n";
    /// Asks for [`super::Message::Parameters`].
    pub const PARAMETERS: &[u8] = b"PP\n";
    /// Asks for vendor, product, firmware, protocol and serial number, [`super::Message::Version`].
    pub const VERSION: &[u8] = b"VV\n";
    /// Asks for the sensor's state, [`super::Message::State`].
    pub const STATE: &[u8] = b"II\n";
}

/// How distances are sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Two characters, up to 4095 mm: MS, GS.
    Short,
    /// Three characters: MD, GD.
    Long,
    /// Three characters for each of up to three echoes: ND, HD. The first is decoded.
    MultiEcho,
}

/// Asks for scans until [`request::LASER_OFF`]: one of `skipped_scans` + 1 (at most 9), the nearest
/// of every `cluster` steps (at most 99). First a [`Message::Status`] comes, then
/// [`Message::Distances`]. `None` if the sensor cannot be asked so.
pub fn request_scans(
    encoding: Encoding,
    steps: RangeInclusive<u16>,
    cluster: u8,
    skipped_scans: u8,
) -> Option<Vec<u8>> {
    let name = match encoding {
        Encoding::Short => "MS",
        Encoding::Long => "MD",
        Encoding::MultiEcho => "ND",
    };
    let request = request_steps(name, steps, cluster)?;
    (skipped_scans <= 9).then(|| format!("{request}{skipped_scans}00\n").into_bytes())
}

/// Asks for one scan; the laser must be on.
pub fn request_scan(
    encoding: Encoding,
    steps: RangeInclusive<u16>,
    cluster: u8,
) -> Option<Vec<u8>> {
    let name = match encoding {
        Encoding::Short => "GS",
        Encoding::Long => "GD",
        Encoding::MultiEcho => "HD",
    };
    request_steps(name, steps, cluster).map(|request| (request + "\n").into_bytes())
}

fn request_steps(name: &str, steps: RangeInclusive<u16>, cluster: u8) -> Option<String> {
    let (start, end) = steps.into_inner();
    let possible = start <= end && end < MAX_STEPS && cluster <= 99;
    possible.then(|| format!("{name}{start:04}{end:04}{cluster:02}"))
}

/// What a sensor sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// A reply without data.
    Status {
        /// Name of the request: `BM`, `MD`.
        request: &'static str,
        /// Its status.
        status: Status,
    },
    /// One scan.
    Distances(Distances),
    /// Limits and geometry.
    Parameters(Parameters),
    /// Lines of the reply, without sums: `PROD:UST-10LX`.
    Version(Vec<String>),
    /// Lines of the reply, without sums: `STAT:Sensor works well.`
    State(Vec<String>),
    /// The sensor's time in ms, 24 bits: see [`SensorTime`].
    Time(u32),
}

/// The two characters of a status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status(pub [u8; 2]);

impl Status {
    /// Whether the request was accepted, or what it asks for is already so.
    pub fn is_ok(self, request: &str) -> bool {
        self.0 == *b"00"
            || (self.0 == *b"02" && matches!(request, "BM" | "TM"))
            || (self.0 == *b"03" && request == "TM")
            || (self.0 == *b"0E" && request == "SCIP2.0")
    }

    /// Its meaning (manual, sections 8 and 9).
    pub fn meaning(self, request: &str) -> &'static str {
        let number = std::str::from_utf8(&self.0).map(str::parse::<u8>);
        match (&self.0, request, number) {
            (b"0A", ..) => "the sensor cannot reply",
            (b"0B", ..) => "the sensor has no room, or the request is being processed",
            (b"0C" | b"0F", ..) => "too few arguments",
            (b"0D" | b"0E", ..) => "unknown request, or not possible now",
            (b"0G" | b"0H", ..) => "invalid characters after the request",
            (b"0I", ..) => "the sensor waits for new firmware",
            (b"00", ..) => "accepted",
            (b"01", "BM", _) => "the laser is faulty",
            (b"02", "BM", _) => "the laser is on",
            (b"02" | b"03", "TM", _) => "the mode is already so",
            (b"04", "TM", _) => "not in the mode for the time",
            (.., Ok(Ok(1..=7))) => "invalid arguments",
            (.., Ok(Ok(10))) => "the laser is off",
            (.., Ok(Ok(21..=49))) => "measuring stopped: the sensor checks an error",
            (.., Ok(Ok(50..=97))) => "hardware fault",
            (.., Ok(Ok(98))) => "measuring resumes",
            _ => "unknown status",
        }
    }
}

/// One scan as it was sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Distances {
    /// First step.
    pub start_step: u16,
    /// Last step.
    pub end_step: u16,
    /// Steps that share one distance, at least 1.
    pub cluster: u16,
    /// Sensor time of step 0 in ms, 24 bits: see [`SensorTime`].
    pub step_0_time_ms: u32,
    /// How they were sent.
    pub encoding: Encoding,
    /// Distances in mm, and error codes below the sensor's smallest distance.
    pub distances_mm: Vec<u32>,
}

/// Limits and geometry of a sensor.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters {
    /// Model (MODL).
    pub model: String,
    /// Smallest distance (DMIN), mm.
    pub distance_min_mm: u32,
    /// Greatest distance (DMAX), mm.
    pub distance_max_mm: u32,
    /// Steps of a full turn (ARES).
    pub steps_per_turn: u16,
    /// First step that measures (AMIN).
    pub first_step: u16,
    /// Last step that measures (AMAX).
    pub last_step: u16,
    /// Step of the sensor's x axis (AFRT).
    pub front_step: u16,
    /// Motor speed (SCAN), turns per minute.
    pub turns_per_min: u16,
}

impl Parameters {
    /// Steps that measure.
    pub fn steps(&self) -> RangeInclusive<u16> {
        self.first_step..=self.last_step
    }

    fn seconds_per_step(&self) -> f64 {
        60.0 / (f64::from(self.turns_per_min) * f64::from(self.steps_per_turn))
    }

    /// The time from [`Distances::step_0_time_ms`] to the first beam of [`Self::to_scan`], seconds.
    pub fn first_beam_delay_s(&self, distances: &Distances) -> f64 {
        middle_of_first(distances) * self.seconds_per_step()
    }

    /// The scan in SI units, in the sensor's frame. NaN for an error code; infinite without an echo.
    /// `None` if the distances are not of a sensor with these parameters.
    pub fn to_scan(&self, distances: &Distances) -> Option<Scan> {
        if distances.start_step < self.first_step || distances.end_step > self.last_step {
            return None;
        }
        // Two characters cannot say more: a distance beyond is sent as the greatest number.
        let max_mm = match distances.encoding {
            Encoding::Short => self.distance_max_mm.min(4095),
            Encoding::Long | Encoding::MultiEcho => self.distance_max_mm,
        };
        // Manual, table 4: UTM sensors send 1 if there is no object in the range.
        let no_object_mm = self.model.starts_with("UTM").then_some(1);
        let range_m = |distance_mm: &u32| {
            if Some(*distance_mm) == no_object_mm || *distance_mm >= max_mm {
                f32::INFINITY
            } else if *distance_mm < self.distance_min_mm {
                f32::NAN
            } else {
                (f64::from(*distance_mm) / 1000.0) as f32
            }
        };
        let radians_per_step = TAU / f64::from(self.steps_per_turn);
        let cluster = f64::from(distances.cluster);
        let first = middle_of_first(distances) - f64::from(self.front_step);
        Some(Scan {
            angle_min_rad: (first * radians_per_step) as f32,
            angle_increment_rad: (cluster * radians_per_step) as f32,
            time_increment_s: (cluster * self.seconds_per_step()) as f32,
            range_min_m: (f64::from(self.distance_min_mm) / 1000.0) as f32,
            range_max_m: (f64::from(max_mm) / 1000.0) as f32,
            ranges_m: distances.distances_mm.iter().map(range_m).collect(),
        })
    }
}

/// The distance of a cluster is that of its nearest step, on average the one in the middle.
fn middle_of_first(distances: &Distances) -> f64 {
    f64::from(distances.start_step) + (f64::from(distances.cluster) - 1.0) / 2.0
}

/// Continues the sensor's time, which starts again after 2²⁴ ms (4.66 h).
#[derive(Clone, Copy, Debug, Default)]
pub struct SensorTime(Option<i64>);

impl SensorTime {
    /// Milliseconds since the sensor's zero before the first `time_ms`. A time that is up to 2.33 h
    /// behind the last one is that of an older message, or of a sensor that was reset.
    pub fn continued_ms(&mut self, time_ms: u32) -> i64 {
        let time_ms = i64::from(time_ms & 0xFF_FFFF);
        let last_ms = self.0.unwrap_or(time_ms);
        let half = 1 << 23;
        let step_ms = (time_ms - last_ms + half).rem_euclid(2 * half) - half;
        *self.0.insert(last_ms.saturating_add(step_ms))
    }
}

/// Most steps of a turn that are believed; the finest sensors have 2880.
const MAX_STEPS: u16 = 4096;
const MAX_ECHOES: usize = 3;
/// Characters of data in a line, without the sum.
const LINE: usize = 64;
const MAX_TEXT_LINE: usize = 160;
const MAX_TEXT_LINES: usize = 16;

/// Names of requests, and the number of digits that follow.
const ECHOES: [(&str, usize); 14] = [
    ("MD", 13),
    ("MS", 13),
    ("ND", 13),
    ("GD", 10),
    ("GS", 10),
    ("HD", 10),
    ("PP", 0),
    ("VV", 0),
    ("II", 0),
    ("BM", 0),
    ("QT", 0),
    ("RS", 0),
    ("TM", 1),
    ("SCIP2.0", 0),
];

/// What bytes are as the first line of a reply.
enum Echo<'a> {
    None,
    Begun,
    Complete(&'static str, &'a [u8]),
}

fn echo(bytes: &[u8]) -> Echo<'_> {
    for (name, digits) in ECHOES {
        let length = name.len() + digits;
        let fits = |(at, byte): (usize, &u8)| match name.as_bytes().get(at) {
            Some(expected) => byte == expected,
            None if at < length => byte.is_ascii_digit(),
            None => *byte == b'\n',
        };
        if bytes.iter().take(length + 1).enumerate().all(fits) {
            return match bytes.get(name.len()..length) {
                Some(digits) if bytes.len() > length => Echo::Complete(name, digits),
                _ => Echo::Begun,
            };
        }
    }
    Echo::None
}

/// Decodes replies.
pub type HokuyoDecoder = StreamDecoder<Message>;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        match echo(bytes) {
            Echo::Begun => Front::Incomplete,
            Echo::None => {
                let starts = |at: &usize| !matches!(echo(&bytes[*at..]), Echo::None);
                let next = (1..bytes.len()).find(starts).unwrap_or(bytes.len());
                Front::Skip(DropReason::Garbage, next)
            }
            Echo::Complete(name, digits) => {
                let mut lines = Lines {
                    bytes,
                    at: name.len() + digits.len() + 1,
                };
                match reply(name, digits, &mut lines) {
                    Ok(message) => Front::Message(message, lines.at),
                    Err(Stop::Incomplete) => Front::Incomplete,
                    Err(Stop::Drop(reason)) => Front::Skip(reason, 1),
                }
            }
        }
    }
}

/// Why there is no message.
enum Stop {
    Incomplete,
    Drop(DropReason),
}

/// Lines of a reply.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Lines<'a> {
    /// The next line without its sum; `None` for the empty line at the end. The sum of a text leaves
    /// out the semicolon before it.
    fn next(&mut self, max_length: usize, is_text: bool) -> Result<Option<&'a [u8]>, Stop> {
        let rest = &self.bytes[self.at..];
        let longest = max_length.max(LINE) + 2;
        let within = &rest[..rest.len().min(longest)];
        let Some(length) = within.iter().position(|byte| *byte == b'\n') else {
            return Err(if within.len() < longest {
                Stop::Incomplete
            } else {
                Stop::Drop(DropReason::Length)
            });
        };
        self.at += length + 1;
        let Some((sum, mut content)) = rest[..length].split_last() else {
            return Ok(None);
        };
        let mut is_right = sum_of(content) == *sum;
        if is_text {
            content = content.strip_suffix(b";").unwrap_or(content);
            is_right |= sum_of(content) == *sum;
        }
        if is_right {
            let fits = content.len() <= max_length;
            return fits
                .then_some(Some(content))
                .ok_or(Stop::Drop(DropReason::Length));
        }
        let begins = |at: usize| matches!(echo(&rest[at..=length]), Echo::Complete(..));
        Err(Stop::Drop(if (0..length).any(begins) {
            DropReason::CutOff
        } else {
            DropReason::Checksum
        }))
    }

    /// The next line; an end is too early.
    fn expect(&mut self, max_length: usize) -> Result<&'a [u8], Stop> {
        self.next(max_length, false)?
            .ok_or(Stop::Drop(DropReason::Length))
    }

    /// The empty line at the end.
    fn end(&mut self) -> Result<(), Stop> {
        match self.next(LINE, false)? {
            None => Ok(()),
            Some(_) => Err(Stop::Drop(DropReason::Length)),
        }
    }

    fn texts(&mut self) -> Result<Vec<String>, Stop> {
        let mut texts = Vec::new();
        while let Some(line) = self.next(MAX_TEXT_LINE, true)? {
            if texts.len() == MAX_TEXT_LINES {
                return Err(Stop::Drop(DropReason::Length));
            }
            texts.push(String::from_utf8_lossy(line).into_owned());
        }
        Ok(texts)
    }
}

fn sum_of(content: &[u8]) -> u8 {
    let sum = content
        .iter()
        .fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
    (sum & 0x3F) + 0x30
}

fn reply(name: &'static str, digits: &[u8], lines: &mut Lines<'_>) -> Result<Message, Stop> {
    let rest = &lines.bytes[lines.at..];
    // A sensor in SCIP 1.1 replies without a sum.
    let scip1 = name == "SCIP2.0" && rest.starts_with(b"0\n");
    let status = if scip1 {
        lines.at += 2;
        *b"00"
    } else if name == "SCIP2.0" && rest == b"0" {
        return Err(Stop::Incomplete);
    } else {
        let status = lines.expect(2)?;
        <[u8; 2]>::try_from(status).map_err(|_shorter| Stop::Drop(DropReason::Length))?
    };
    if !status.iter().all(u8::is_ascii_alphanumeric) {
        return Err(Stop::Drop(DropReason::Field));
    }
    match lines.bytes.get(lines.at) {
        None => return Err(Stop::Incomplete),
        Some(b'\n') => {
            lines.at += 1;
            return Ok(Message::Status {
                request: name,
                status: Status(status),
            });
        }
        Some(_) => {}
    }
    match (name, &status) {
        ("PP", b"00") => parameters(&lines.texts()?)
            .map(Message::Parameters)
            .ok_or(Stop::Drop(DropReason::Field)),
        ("VV", b"00") => lines.texts().map(Message::Version),
        ("II", b"00") => lines.texts().map(Message::State),
        ("TM", b"00") => {
            let time_ms = number(lines.expect(4)?, 4)?;
            lines.end()?;
            Ok(Message::Time(time_ms))
        }
        ("MD" | "MS" | "ND", b"99") | ("GD" | "GS" | "HD", b"00") => {
            distances(name, digits, lines).map(Message::Distances)
        }
        _ => Err(Stop::Drop(DropReason::Field)),
    }
}

/// A number of `length` characters of six bits each (manual, section 6).
fn number(characters: &[u8], length: usize) -> Result<u32, Stop> {
    if characters.len() != length {
        return Err(Stop::Drop(DropReason::Length));
    }
    let bits = |number: u32, character: &u8| match character {
        0x30..=0x6F => Ok(number << 6 | u32::from(character - 0x30)),
        _ => Err(Stop::Drop(DropReason::Field)),
    };
    characters.iter().try_fold(0, bits)
}

fn distances(name: &str, digits: &[u8], lines: &mut Lines<'_>) -> Result<Distances, Stop> {
    let argument = |range| {
        let digits: &[u8] = digits.get(range).unwrap_or_default();
        let digit = |number, digit: &u8| number * 10 + u16::from(digit - b'0');
        digits.iter().fold(0, digit)
    };
    let (start_step, end_step) = (argument(0..4), argument(4..8));
    let cluster = argument(8..10).max(1);
    if start_step > end_step || end_step >= MAX_STEPS {
        return Err(Stop::Drop(DropReason::Length));
    }
    let count = usize::from((end_step - start_step) / cluster) + 1;
    let encoding = match name {
        "MS" | "GS" => Encoding::Short,
        "ND" | "HD" => Encoding::MultiEcho,
        _ => Encoding::Long,
    };
    let (width, most) = match encoding {
        Encoding::Short => (2, 2 * count),
        Encoding::Long => (3, 3 * count),
        Encoding::MultiEcho => (3, (4 * MAX_ECHOES - 1) * count),
    };

    let step_0_time_ms = number(lines.expect(4)?, 4)?;
    let mut data = Vec::with_capacity(width * count);
    while let Some(line) = lines.next(LINE, false)? {
        data.extend_from_slice(line);
        if data.len() > most {
            return Err(Stop::Drop(DropReason::Length));
        }
    }
    let mut rest = data.as_slice();
    let mut next = || {
        let (characters, after) = rest
            .split_at_checked(width)
            .ok_or(Stop::Drop(DropReason::Length))?;
        rest = after;
        let first = number(characters, width)?;
        // Multi-echo: the next echoes of the same step.
        while let Some(after) = rest.strip_prefix(b"&") {
            let (characters, after) = after
                .split_at_checked(width)
                .ok_or(Stop::Drop(DropReason::Length))?;
            number(characters, width)?;
            rest = after;
        }
        Ok(first)
    };
    let distances_mm = (0..count)
        .map(|_step| next())
        .collect::<Result<Vec<_>, _>>()?;
    if !rest.is_empty() {
        return Err(Stop::Drop(DropReason::Length));
    }
    Ok(Distances {
        start_step,
        end_step,
        cluster,
        step_0_time_ms,
        encoding,
        distances_mm,
    })
}

/// `None` if a parameter is missing or impossible.
fn parameters(lines: &[String]) -> Option<Parameters> {
    let text = |key: &str| {
        let value = |line: &String| Some(line.strip_prefix(key)?.strip_prefix(':')?.to_string());
        lines.iter().find_map(value)
    };
    let number = |key: &str| text(key)?.trim().parse::<u32>().ok();
    let step = |key: &str| u16::try_from(number(key)?).ok();
    let parameters = Parameters {
        model: text("MODL")?,
        distance_min_mm: number("DMIN")?,
        distance_max_mm: number("DMAX")?,
        steps_per_turn: step("ARES")?,
        first_step: step("AMIN")?,
        last_step: step("AMAX")?,
        front_step: step("AFRT")?,
        turns_per_min: step("SCAN")?,
    };
    let possible = parameters.distance_min_mm < parameters.distance_max_mm
        && parameters.distance_max_mm < 1 << 18
        && parameters.steps_per_turn <= MAX_STEPS
        && parameters.first_step < parameters.last_step
        && parameters.last_step - parameters.first_step < parameters.steps_per_turn
        && parameters.last_step < MAX_STEPS
        && parameters.steps().contains(&parameters.front_step)
        && (60..=60_000).contains(&parameters.turns_per_min);
    possible.then_some(parameters)
}

#[cfg(test)]
mod tests;
