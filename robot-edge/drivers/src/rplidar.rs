//! Slamtec RPLIDAR laser scanners (A, S and C series) on a serial line.
//!
//! Source: `sdk/include/sl_lidar_cmd.h` at 2f10ad5, `sdk/src/sl_crc.cpp` at 2f10ad5 and
//! `sdk/src/dataunpacker/unpacker/handler_capsules.cpp` at 1597018 of `Slamtec/rplidar_ros`, the
//! vendor's own decoder ("SDK" below); behaviour of a real A1M8:
//! `docs/rplidar-a1m8-findings.md` of cpane/heron at 7f678e2. A reply is a descriptor and data;
//! replies to scan requests go on until [`request::STOP`].
//!
//! Angles count clockwise as seen from above; 0 is the front of the housing, the sensor's x axis.

use std::cell::Cell;
use std::collections::VecDeque;
use std::f64::consts::TAU;

use measurement::scan::Scan;

use crate::read_buffer::{Front, ReadBuffer, before_mark};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::Rplidar;

/// Requests without arguments.
pub mod request {
    /// Ends scanning. No reply.
    pub const STOP: &[u8] = &[0xA5, 0x25];
    /// Restarts the device. It replies with a text, which is dropped as garbage.
    pub const RESET: &[u8] = &[0xA5, 0x40];
    /// Starts sending single nodes.
    pub const SCAN: &[u8] = &[0xA5, 0x20];
    /// Asks for [`super::Message::Info`].
    pub const INFO: &[u8] = &[0xA5, 0x50];
    /// Asks for [`super::Message::Health`].
    pub const HEALTH: &[u8] = &[0xA5, 0x52];
    /// Asks for [`super::Message::SampleDuration`].
    pub const SAMPLE_DURATION: &[u8] = &[0xA5, 0x59];
}

/// Starts sending capsules in a mode that the device lists. The descriptor says which kind comes.
pub fn start_express_scan(mode: u8) -> Vec<u8> {
    with_payload(0x82, &[mode, 0, 0, 0, 0])
}

/// Duty cycle of the motor, 0 to 1023, 660 by default (A2, A3 with their adapter). No reply.
pub fn set_motor_pwm(duty: u16) -> Vec<u8> {
    with_payload(0xF0, &duty.to_le_bytes())
}

/// Speed of the motor in turns per minute (S series). No reply.
pub fn set_motor_speed(turns_per_min: u16) -> Vec<u8> {
    with_payload(0xA8, &turns_per_min.to_le_bytes())
}

/// What can be asked about scan modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigKey {
    /// Number of modes; the mode of the request has no meaning.
    ModeCount = 0x70,
    /// Time of a sample.
    SampleDuration = 0x71,
    /// Greatest distance.
    RangeMax = 0x74,
    /// Type of the data.
    AnswerType = 0x75,
    /// The mode to prefer; the mode of the request has no meaning.
    TypicalMode = 0x7C,
    /// Name of the mode.
    Name = 0x7F,
}

/// Asks for [`Message::Config`].
pub fn request_config(key: ConfigKey, mode: u16) -> Vec<u8> {
    let key = (key as u32).to_le_bytes();
    with_payload(0x84, &[&key[..], &mode.to_le_bytes()].concat())
}

fn with_payload(command: u8, payload: &[u8]) -> Vec<u8> {
    let mut bytes = [&[0xA5, command, payload.len() as u8], payload].concat();
    bytes.push(xor_of(&bytes));
    bytes
}

fn xor_of(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |xor, byte| xor ^ byte)
}

/// What a device sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Message {
    /// Which device it is.
    Info {
        /// Model; its high four bits are the series.
        model: u8,
        /// Version of the firmware: major, minor.
        firmware: [u8; 2],
        /// Version of the hardware.
        hardware: u8,
        /// Serial number.
        serial: [u8; 16],
    },
    /// Its state.
    Health {
        /// 0: good; 1: warning; 2: error, the device does not scan until a reset.
        status: u8,
        /// The error.
        error_code: u16,
    },
    /// Time of a sample, seconds.
    SampleDuration {
        /// After [`request::SCAN`].
        scan_s: f64,
        /// After [`start_express_scan`] of mode 0 or 1.
        express_s: f64,
    },
    /// A property of a scan mode.
    Config(Config),
    /// A scan begins.
    ScanBegins,
    /// One turn.
    Sweep(Sweep),
}

/// A property of a scan mode: see [`ConfigKey`].
#[derive(Clone, Debug, PartialEq)]
pub enum Config {
    /// Number of modes.
    ModeCount(u16),
    /// Time of a sample, seconds.
    SampleDurationS(f64),
    /// Greatest distance, metres.
    RangeMaxM(f64),
    /// Type of the data, as in the descriptor.
    AnswerType(u8),
    /// The mode to prefer.
    TypicalMode(u16),
    /// Name of the mode.
    Name(String),
}

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Angle in 1/64°, clockwise, below 360°.
    pub angle_q6: u16,
    /// Distance in 1/4 mm; 0 without a measurement.
    pub distance_q2: u32,
}

/// The samples of one turn in the order of time. About one of eight has a smaller angle than the
/// one before: the device corrects angles by distance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sweep {
    /// Its samples.
    pub nodes: Vec<Node>,
}

impl Sweep {
    /// The sweep in SI units, in the sensor's frame, in the order of time: angles decrease. There
    /// are as many beams as samples, each with the nearest of its samples: NaN for none or an
    /// invalid one, infinite beyond `range_max_m`. `None` if an argument is impossible.
    pub fn to_scan(
        &self,
        sample_duration_s: f64,
        range_min_m: f32,
        range_max_m: f32,
    ) -> Option<Scan> {
        let count = self.nodes.len();
        let start_q6 = self.nodes.first()?.angle_q6;
        let is_possible = (0.0..0.01).contains(&sample_duration_s)
            && (0.0..range_max_m).contains(&range_min_m)
            && range_max_m.is_finite();
        if !is_possible {
            return None;
        }
        let mut ranges_m = vec![f32::NAN; count];
        for (at, node) in self.nodes.iter().enumerate() {
            let from_start_q6 = (node.angle_q6 + TURN_Q6 - start_q6) % TURN_Q6;
            let turn = usize::from(TURN_Q6);
            let beam = (usize::from(from_start_q6) * count + turn / 2) / turn % count;
            let range_m = (f64::from(node.distance_q2) / 4000.0) as f32;
            // A sample behind the first one, or one before the last one's end, is of another turn.
            if beam.abs_diff(at) > count / 2 || range_m < range_min_m || range_m == 0.0 {
                continue;
            }
            let range_m = if range_m < range_max_m {
                range_m
            } else {
                f32::INFINITY
            };
            ranges_m[beam] = ranges_m[beam].min(range_m);
        }
        let start = f64::from(start_q6) / f64::from(TURN_Q6);
        let start = if start > 0.5 { start - 1.0 } else { start };
        Some(Scan {
            angle_min_rad: (-start * TAU) as f32,
            angle_increment_rad: (-TAU / count as f64) as f32,
            time_increment_s: sample_duration_s as f32,
            range_min_m,
            range_max_m,
            ranges_m,
        })
    }
}

const TURN_Q6: u16 = 360 << 6;
const MARK: &[u8] = &[0xA5, 0x5A];
const DESCRIPTOR: usize = 7;
/// The most samples of a turn: 32 000 a second at 4 turns a second.
const MAX_NODES: usize = 8192;
/// Two or three check bits are all that marks a node: so many in a row begin after an error.
const NODES_TO_ALIGN: usize = 10;
/// Capsules are nearer to each other: 32 samples at 4000 a second and 15 turns a second are 43°.
const MAX_STEP_Q6: u16 = 90 << 6;

/// What a descriptor announces.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Answer {
    Info,
    Health,
    SampleDuration,
    /// With this length.
    Config(usize),
    Node,
    Express,
    Ultra,
    Dense,
    HighQuality,
}

impl Answer {
    const ALL: [Self; 8] = [
        Self::Info,
        Self::Health,
        Self::SampleDuration,
        Self::Node,
        Self::Express,
        Self::Ultra,
        Self::Dense,
        Self::HighQuality,
    ];

    /// Type, length, and whether data repeats.
    const fn layout(self) -> (u8, usize, bool) {
        match self {
            Self::Info => (0x04, 20, false),
            Self::Health => (0x06, 3, false),
            Self::SampleDuration => (0x15, 4, false),
            Self::Config(length) => (0x20, length, false),
            Self::Node => (0x81, 5, true),
            Self::Express => (0x82, 84, true),
            Self::HighQuality => (0x83, 781, true),
            Self::Ultra => (0x84, 132, true),
            Self::Dense => (0x85, 84, true),
        }
    }

    /// `Err` says why it is no descriptor. `bytes` begin with [`MARK`].
    fn of_descriptor(bytes: [u8; DESCRIPTOR]) -> Result<Self, DropReason> {
        let [_, _, length @ .., kind] = bytes;
        let length = u32::from_le_bytes(length);
        let repeats = length >> 30;
        let length = (length & 0x3FFF_FFFF) as usize;
        let answer = if kind == 0x20 {
            Some(Self::Config(length.clamp(5, 68)))
        } else {
            Self::ALL
                .into_iter()
                .find(|answer| answer.layout().0 == kind)
        };
        let answer = answer.ok_or(DropReason::UnknownKind)?;
        let announced = (kind, length, repeats == 1);
        (answer.layout() == announced && repeats <= 1)
            .then_some(answer)
            .ok_or(DropReason::Length)
    }
}

/// A piece of the stream.
enum Piece {
    Descriptor(Answer),
    Data(Answer, Vec<u8>),
}

/// Decodes replies.
#[derive(Debug, Default)]
pub struct RplidarDecoder {
    buffer: ReadBuffer,
    /// What the last descriptor announced.
    expected: Option<Answer>,
    /// Whether the next byte begins a node.
    is_aligned: Cell<bool>,
    /// The last capsule, whose angles need the next one.
    previous: Option<Vec<u8>>,
    /// Angle between the two capsules before.
    step_q6: Option<u16>,
    nodes: Vec<Node>,
    /// Whether the turn began at its beginning.
    is_whole: bool,
    /// Whether the turn is so far that its end can come.
    is_advanced: bool,
    messages: VecDeque<Message>,
}

impl Decoder for RplidarDecoder {
    type Message = Message;

    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_message(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.messages.pop_front() {
                return Some(message);
            }
            let (expected, is_aligned) = (self.expected, &self.is_aligned);
            let piece = self.buffer.next_message(|bytes| match expected {
                Some(answer) => front_of_data(bytes, answer, is_aligned),
                None => front_of_descriptor(bytes),
            })?;
            match piece {
                Piece::Descriptor(answer) => {
                    self.expected = Some(answer);
                    self.is_aligned.set(true);
                    self.previous = None;
                    self.step_q6 = None;
                    self.begin_sweep(false);
                    if answer.layout().2 {
                        self.messages.push_back(Message::ScanBegins);
                    }
                }
                Piece::Data(answer, data) => self.data(answer, &data),
            }
        }
    }

    fn dropped(&self) -> &Dropped {
        &self.buffer.dropped
    }
}

fn front_of_descriptor(bytes: &[u8]) -> Front<Piece> {
    let garbage = before_mark(bytes, MARK);
    match bytes.first_chunk() {
        _ if garbage > 0 => Front::Skip(DropReason::Garbage, garbage),
        None => Front::Incomplete,
        Some(descriptor) => match Answer::of_descriptor(*descriptor) {
            Ok(answer) => Front::Message(Piece::Descriptor(answer), DESCRIPTOR),
            Err(reason) => Front::Skip(reason, 1),
        },
    }
}

fn front_of_data(bytes: &[u8], answer: Answer, is_aligned: &Cell<bool>) -> Front<Piece> {
    let (_, length, repeats) = answer.layout();
    let needed = if answer == Answer::Node && !is_aligned.get() {
        NODES_TO_ALIGN * length
    } else {
        length
    };
    let data = |bytes: &[u8]| front_of_whole_data(bytes, answer, needed, is_aligned);
    // Another reply may begin in the data. That data looks like a whole descriptor is improbable. What is
    // wrong before it is skipped first, as if it had come alone.
    let mut at = 0;
    while at < bytes.len().min(needed) {
        at += before_mark(&bytes[at..], MARK);
        let rest = bytes.get(at..).unwrap_or_default();
        let begun = match rest.first_chunk() {
            _ if at >= needed => break,
            Some(descriptor) if Answer::of_descriptor(*descriptor).is_ok() => {
                if at == 0 {
                    return front_of_descriptor(bytes);
                }
                Front::Skip(DropReason::CutOff, at)
            }
            None if repeats && !rest.is_empty() => Front::Incomplete,
            _ => {
                at += 1;
                continue;
            }
        };
        return match bytes
            .get(..at)
            .filter(|before| !before.is_empty())
            .map(data)
        {
            Some(wrong @ Front::Skip(..)) => wrong,
            _ => begun,
        };
    }
    data(bytes)
}

/// No other reply begins in the data.
fn front_of_whole_data(
    bytes: &[u8],
    answer: Answer,
    needed: usize,
    is_aligned: &Cell<bool>,
) -> Front<Piece> {
    let length = answer.layout().1;
    let is_sync = match answer {
        Answer::Express | Answer::Ultra | Answer::Dense => {
            bytes[0] >> 4 == 0xA && bytes.get(1).is_none_or(|byte| byte >> 4 == 0x5)
        }
        Answer::HighQuality => bytes[0] == 0xA5,
        _ => true,
    };
    if !is_sync {
        return Front::Skip(DropReason::Garbage, 1);
    }
    if answer == Answer::Node {
        let available = &bytes[..bytes.len().min(needed)];
        if !available
            .chunks_exact(length)
            .all(|bytes| node(bytes).is_some())
        {
            let reason = if is_aligned.replace(false) {
                DropReason::Field
            } else {
                DropReason::Garbage
            };
            return Front::Skip(reason, 1);
        }
    }
    if bytes.len() < needed {
        return Front::Incomplete;
    }
    let data = &bytes[..length];
    if !sum_is_right(answer, data) {
        return Front::Skip(DropReason::Checksum, 1);
    }
    is_aligned.set(true);
    Front::Message(Piece::Data(answer, data.to_vec()), length)
}

fn sum_is_right(answer: Answer, data: &[u8]) -> bool {
    match answer {
        Answer::Express | Answer::Ultra | Answer::Dense => {
            (data[0] & 0xF) | (data[1] << 4) == xor_of(&data[2..])
        }
        Answer::HighQuality => {
            let (content, sum) = data.split_at(data.len() - 4);
            crc_of(content).to_le_bytes() == sum
        }
        _ => true,
    }
}

/// CRC-32 as in zip, over a whole number of four bytes (`sl_crc.cpp`).
fn crc_of(content: &[u8]) -> u32 {
    let padding = 4 - content.len() % 4;
    let padded = content.iter().chain(std::iter::repeat_n(&0, padding));
    !padded.fold(u32::MAX, |crc, byte| {
        let shift = |crc: u32, _bit| (crc >> 1) ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 };
        (0..8).fold(crc ^ u32::from(*byte), shift)
    })
}

/// Reads a little-endian number of up to four bytes.
fn number(bytes: &[u8]) -> u32 {
    let add = |number: u32, byte: &u8| number << 8 | u32::from(*byte);
    bytes.iter().rev().fold(0, add)
}

/// `None` if a check bit or the angle is wrong.
fn node(bytes: &[u8]) -> Option<Node> {
    let start = bytes[0] & 1;
    let angle_q6 = (number(&bytes[1..3]) >> 1) as u16;
    let is_valid = start != bytes[0] >> 1 & 1 && bytes[1] & 1 == 1 && angle_q6 < TURN_Q6;
    is_valid.then(|| Node {
        angle_q6,
        distance_q2: number(&bytes[3..5]),
    })
}

/// Fails for a wrong length or an unknown key.
fn config(data: &[u8]) -> Result<Config, DropReason> {
    let (key, value) = data.split_at(4);
    let fixed = |length| {
        (value.len() == length)
            .then(|| number(value))
            .ok_or(DropReason::Length)
    };
    let q8 = |length| Ok(f64::from(fixed(length)?) / 256.0);
    Ok(match number(key) {
        0x70 => Config::ModeCount(fixed(2)? as u16),
        0x71 => Config::SampleDurationS(q8(4)? / 1e6),
        0x74 => Config::RangeMaxM(q8(4)?),
        0x75 => Config::AnswerType(fixed(1)? as u8),
        0x7C => Config::TypicalMode(fixed(2)? as u16),
        0x7F => {
            let name = value.split(|byte| *byte == 0).next().unwrap_or_default();
            Config::Name(String::from_utf8_lossy(name).into_owned())
        }
        _ => return Err(DropReason::UnknownKind),
    })
}

impl RplidarDecoder {
    fn data(&mut self, answer: Answer, data: &[u8]) {
        let micros = |bytes: &[u8]| f64::from(number(bytes)) / 1e6;
        let message = match answer {
            Answer::Node => {
                let starts = data[0] & 1 == 1;
                if let Some(node) = node(data) {
                    self.add(node, starts);
                }
                return;
            }
            Answer::Express | Answer::Ultra | Answer::Dense => return self.capsule(answer, data),
            Answer::HighQuality => {
                for sample in data[9..777].chunks_exact(8) {
                    let node = Node {
                        angle_q6: (number(&sample[..2]) * 45 / 128) as u16,
                        distance_q2: number(&sample[2..6]),
                    };
                    self.add(node, sample[7] & 1 == 1);
                }
                return;
            }
            Answer::Info => {
                let mut serial = [0; 16];
                serial.copy_from_slice(&data[4..]);
                Ok(Message::Info {
                    model: data[0],
                    firmware: [data[2], data[1]],
                    hardware: data[3],
                    serial,
                })
            }
            Answer::Health if data[0] > 2 => Err(DropReason::Field),
            Answer::Health => Ok(Message::Health {
                status: data[0],
                error_code: number(&data[1..]) as u16,
            }),
            Answer::SampleDuration => Ok(Message::SampleDuration {
                scan_s: micros(&data[..2]),
                express_s: micros(&data[2..]),
            }),
            Answer::Config(_) => config(data).map(Message::Config),
        };
        self.expected = None;
        match message {
            Ok(message) => self.messages.push_back(message),
            Err(reason) => self.buffer.dropped.add(reason, 1),
        }
    }

    /// Adds a sample. A turn ends with the device's flag or behind the front, but not soon after
    /// its beginning: the flag is sent up to 9° before the front, and either may be lost.
    fn add(&mut self, node: Node, starts: bool) {
        let last_q6 = self.nodes.last().map_or(0, |last| last.angle_q6);
        let is_advanced = (TURN_Q6 / 4..TURN_Q6 / 12 * 11).contains(&node.angle_q6);
        let is_behind_front = node.angle_q6 < TURN_Q6 / 4 && last_q6 >= TURN_Q6 / 4 * 3;
        if self.is_advanced && !is_advanced && (starts || is_behind_front) {
            let nodes = self.begin_sweep(true);
            self.messages
                .extend(nodes.map(|nodes| Message::Sweep(Sweep { nodes })));
        }
        self.is_advanced |= is_advanced;
        if self.nodes.len() == MAX_NODES {
            self.buffer.dropped.add(DropReason::Length, 1);
            self.begin_sweep(false);
        }
        self.nodes.push(node);
    }

    /// Returns the samples of the turn that ends, if it is whole.
    fn begin_sweep(&mut self, is_whole: bool) -> Option<Vec<Node>> {
        let nodes = std::mem::take(&mut self.nodes);
        self.is_advanced = false;
        std::mem::replace(&mut self.is_whole, is_whole).then_some(nodes)
    }

    fn capsule(&mut self, answer: Answer, capsule: &[u8]) {
        let start = number(&capsule[2..4]) as u16;
        let start_q6 = start & 0x7FFF;
        if start_q6 >= TURN_Q6 {
            self.buffer.dropped.add(DropReason::Field, 1);
            self.previous = None;
            return;
        }
        // The first capsule after a start of the motor.
        if start >> 15 == 1 {
            self.previous = None;
            self.begin_sweep(false);
        }
        let Some(previous) = self.previous.replace(capsule.to_vec()) else {
            return;
        };
        let previous_q6 = number(&previous[2..4]) as u16 & 0x7FFF;
        let step_q6 = (start_q6 + TURN_Q6 - previous_q6) % TURN_Q6;
        // Steps are even: a greater one means that a capsule was lost.
        let usual_q6 = self.step_q6.replace(step_q6).unwrap_or(step_q6);
        if step_q6 > MAX_STEP_Q6 || 2 * u32::from(step_q6) > 3 * u32::from(usual_q6) + 2 {
            self.buffer.dropped.add(DropReason::CutOff, 1);
            return;
        }
        for node in nodes_of(answer, &previous, capsule, previous_q6, step_q6) {
            self.add(node, false);
        }
    }
}

/// Samples of the capsule `previous`, between whose angle and that of the next the sensor turned by
/// `step_q6`.
fn nodes_of(
    answer: Answer,
    previous: &[u8],
    next: &[u8],
    start_q6: u16,
    step_q6: u16,
) -> Vec<Node> {
    // Distance and correction of the angle (degrees, 16 bits after the point) of each sample.
    let samples: Vec<(u32, i32)> = match answer {
        Answer::Express => {
            let cabins = previous[4..].chunks_exact(5);
            let samples = cabins.flat_map(|cabin| {
                [(&cabin[..2], cabin[4] & 0xF), (&cabin[2..4], cabin[4] >> 4)].map(|(word, low)| {
                    let word = number(word);
                    let offset_q3 = (word & 3) << 4 | u32::from(low);
                    (word & 0xFFFC, (offset_q3 << 13).cast_signed())
                })
            });
            samples.collect()
        }
        Answer::Ultra => ultra_samples(previous, next),
        _ => {
            let distances_mm = previous[4..].chunks_exact(2).map(number);
            distances_mm
                .map(|distance_mm| (distance_mm << 2, 0))
                .collect()
        }
    };
    let step_q16 = ((u32::from(step_q6) << 10) / samples.len() as u32).cast_signed();
    let nodes = samples.into_iter().zip(0..);
    let nodes = nodes.map(|((distance_q2, offset_q16), at)| {
        let angle_q16 = (i32::from(start_q6) << 10) + at * step_q16 - offset_q16;
        Node {
            angle_q6: (angle_q16 >> 10).rem_euclid(i32::from(TURN_Q6)) as u16,
            distance_q2,
        }
    });
    nodes.collect()
}

/// Three samples of each word: a distance, and two differences, to this and to the next distance.
fn ultra_samples(previous: &[u8], next: &[u8]) -> Vec<(u32, i32)> {
    let words = previous[4..].chunks_exact(4).chain([&next[4..8]]);
    let words: Vec<u32> = words.map(number).collect();
    let samples = words.windows(2).flat_map(|pair| {
        let (distance, mut scale) = scaled(pair[0] & 0xFFF);
        let (next_distance, next_scale) = scaled(pair[1] & 0xFFF);
        let mut base = distance;
        if distance == 0 && next_distance != 0 {
            (base, scale) = (next_distance, next_scale);
        }
        let predicted = |difference: i32, base: u32, scale: u32| match difference {
            -512 | 511 => 0,
            _ => (base.cast_signed() + (difference << scale)).max(0) as u32,
        };
        let first = (pair[0] << 10).cast_signed() >> 22;
        let second = pair[0].cast_signed() >> 22;
        [
            distance,
            predicted(first, base, scale),
            predicted(second, next_distance, next_scale),
        ]
    });
    let samples = samples.map(|distance_mm| (distance_mm << 2, ultra_offset_q16(distance_mm << 2)));
    samples.collect()
}

/// A distance in mm of twelve bits that are coarser the further it is, and by how many bits.
fn scaled(bits: u32) -> (u32, u32) {
    // Least bits, least distance, scale.
    let ranges = [
        (3328, 1 << 14, 4),
        (1792, 1 << 12, 3),
        (1280, 1 << 11, 2),
        (512, 1 << 9, 1),
    ];
    let fits = ranges.into_iter().find(|(least, ..)| bits >= *least);
    let (least, distance_mm, scale) = fits.unwrap_or_default();
    (distance_mm + ((bits - least) << scale), scale)
}

/// Angle between the beam and the zero mark: the laser is beside the axis (SDK).
fn ultra_offset_q16(distance_q2: u32) -> i32 {
    let radians_q16 = |degrees: f64| (degrees.to_radians() * 65536.0) as i32;
    let offset_q16 = if distance_q2 >= 200 {
        let nearness = 98_361 / distance_q2.cast_signed();
        radians_q16(8.0) - (nearness << 6) - nearness.pow(3) / 98_304
    } else {
        radians_q16(7.5)
    };
    f64::from(offset_q16).to_degrees() as i32
}

#[cfg(test)]
mod tests;
