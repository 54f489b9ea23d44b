//! ROBOTIS Dynamixel servos, protocols 1.0 and 2.0, on a half-duplex serial line.
//!
//! Source: ROBOTIS e-Manual, ROBOTIS-GIT/emanual: `docs/en/dxl/protocol1.md` at 097301c,
//! `protocol2.md` at 0117956, `ax/ax-12a.md` at 07fe860, `mx/mx-28.md` at 0117956,
//! `x/xh430-w210.md` at 00fc361. Angles grow counter-clockwise as seen on the horn; 0 is the middle of
//! the first turn.
//!
//! An adapter that returns what the host sends must have that switched off with protocol 1.0: there an
//! instruction looks like a status. With 2.0 it is recognised and dropped.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use crate::read_buffer::{Front, ReadBuffer, before_mark};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::Dynamixel;

/// The id that all servos obey and none replies to.
pub const BROADCAST: u8 = 0xFE;

const MARK_1: &[u8] = &[0xFF, 0xFF];
const MARK_2: &[u8] = &[0xFF, 0xFF, 0xFD, 0x00];
/// No byte sequence in the body of a 2.0 packet; a further `FD` behind it is put in.
const STUFFED: &[u8] = &[0xFF, 0xFF, 0xFD];
/// Bytes up to the length, which counts what follows.
const HEADER_1: usize = 4;
const HEADER_2: usize = 7;
/// Longest 2.0 packet that is awaited: the control tables end below address 1024.
const MAX_LENGTH_2: usize = 1100;

const PING: u8 = 0x01;
const READ: u8 = 0x02;
const WRITE: u8 = 0x03;
const STATUS: u8 = 0x55;
const SYNC_READ: u8 = 0x82;

/// Version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// 1.0: AX, DX, RX, EX, and MX as delivered.
    One,
    /// 2.0: X, P, PRO, and MX with firmware for it.
    Two,
}

/// A value in a servo's control table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Item {
    /// Its first byte.
    pub address: u16,
    /// Its bytes, low byte first.
    pub length: u16,
}

/// What a series of servos has in common.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// How it is spoken to.
    pub protocol: Protocol,
    /// Whether it holds and turns.
    pub torque_enable: Item,
    /// Greatest velocity on the way to an angle, in position mode.
    pub profile_velocity: Item,
    /// The angle to go to.
    pub goal_position: Item,
    /// The velocity to turn with in wheel or velocity mode, if it is one.
    pub goal_velocity: Option<Item>,
    /// The angle.
    pub present_position: Item,
    /// The velocity; not in wheel mode of an AX-12A, which has a fraction of its torque there.
    pub present_velocity: Item,
    /// Position at angle 0.
    pub middle: f64,
    /// Angle of one step, radians.
    pub step_rad: f64,
    /// Positions that can be commanded.
    pub goals: RangeInclusive<i32>,
    /// Positions that can be reported.
    pub positions: RangeInclusive<i32>,
    /// Velocity of one step, rad/s.
    pub velocity_step_radps: f64,
    /// Greatest velocity that can be commanded, steps.
    pub max_velocity: i32,
}

const fn item(address: u16, length: u16) -> Item {
    Item { address, length }
}

/// AX-12A: 300° in 1024 positions.
pub const AX_12A: Model = Model {
    protocol: Protocol::One,
    torque_enable: item(24, 1),
    profile_velocity: item(32, 2),
    goal_position: item(30, 2),
    goal_velocity: None,
    present_position: item(36, 2),
    present_velocity: item(38, 2),
    middle: 511.5,
    step_rad: 300.0 / 360.0 * TAU / 1023.0,
    goals: 0..=1023,
    positions: 0..=1023,
    velocity_step_radps: 0.111 * TAU / 60.0,
    max_velocity: 1023,
};

/// MX-28 with protocol 1.0, resolution divider 1, also in multi-turn mode.
pub const MX_28: Model = Model {
    protocol: Protocol::One,
    torque_enable: item(24, 1),
    profile_velocity: item(32, 2),
    goal_position: item(30, 2),
    goal_velocity: Some(item(32, 2)),
    present_position: item(36, 2),
    present_velocity: item(38, 2),
    middle: 2048.0,
    step_rad: TAU / 4096.0,
    goals: -28_672..=28_672,
    positions: -28_672..=28_672,
    velocity_step_radps: 0.114 * TAU / 60.0,
    max_velocity: 1023,
};

/// X series (XL430, XM430, XH430, XM540 and others), also in extended position mode.
pub const X_SERIES: Model = Model {
    protocol: Protocol::Two,
    torque_enable: item(64, 1),
    profile_velocity: item(112, 4),
    goal_position: item(116, 4),
    goal_velocity: Some(item(104, 4)),
    present_position: item(132, 4),
    present_velocity: item(128, 4),
    middle: 2048.0,
    step_rad: TAU / 4096.0,
    goals: -1_048_575..=1_048_575,
    positions: i32::MIN..=i32::MAX,
    velocity_step_radps: 0.229 * TAU / 60.0,
    max_velocity: 1023,
};

impl Model {
    /// Asks for a [`Status`] for [`Self::position_rad`].
    pub fn read_position(&self, id: u8) -> Option<Vec<u8>> {
        self.protocol.read(id, self.present_position)
    }

    /// Asks for a [`Status`] for [`Self::velocity_radps`].
    pub fn read_velocity(&self, id: u8) -> Option<Vec<u8>> {
        self.protocol.read(id, self.present_velocity)
    }

    /// Asks each of these servos for a [`Status`] for [`Self::position_rad`]; protocol 2.0 alone.
    pub fn sync_read_positions(&self, ids: &[u8]) -> Option<Vec<u8>> {
        self.protocol.sync_read(ids, self.present_position)
    }

    /// Goes to an angle in position mode. `None` if the servo cannot be asked so.
    pub fn write_goal_position(&self, id: u8, angle_rad: f64) -> Option<Vec<u8>> {
        let steps = whole(angle_rad / self.step_rad + self.middle)?;
        let is_possible = self.goals.contains(&steps);
        let write = || self.protocol.write(id, self.goal_position, steps);
        is_possible.then(write).flatten()
    }

    /// Holds and turns.
    pub fn write_torque_enable(&self, id: u8) -> Option<Vec<u8>> {
        self.protocol.write(id, self.torque_enable, 1)
    }

    /// Goes to angles with at most this velocity, in position mode. `None` if the servo cannot be asked so.
    pub fn write_profile_velocity(&self, id: u8, velocity_radps: f64) -> Option<Vec<u8>> {
        // 0 is no limit.
        let steps = whole(velocity_radps / self.velocity_step_radps)?.max(1);
        let is_possible = steps <= self.max_velocity;
        let write = || self.protocol.write(id, self.profile_velocity, steps);
        is_possible.then(write).flatten()
    }

    /// Turns with a velocity in wheel or velocity mode. `None` if the servo cannot be asked so.
    ///
    /// In the other modes of an MX this limits the speed of going to an angle, and 0 is no limit.
    pub fn write_goal_velocity(&self, id: u8, velocity_radps: f64) -> Option<Vec<u8>> {
        let steps = whole(velocity_radps / self.velocity_step_radps)?;
        let is_possible = steps.abs() <= self.max_velocity;
        let value = match self.protocol {
            Protocol::One if steps < 0 => 1024 - steps,
            _ => steps,
        };
        let write = || self.protocol.write(id, self.goal_velocity?, value);
        is_possible.then(write).flatten()
    }

    /// Angle in a reply to [`Self::read_position`], radians; `None` in another one.
    pub fn position_rad(&self, status: &Status) -> Option<f64> {
        let position = value(&status.parameters, self.present_position)?;
        let is_possible = self.positions.contains(&position);
        is_possible.then(|| (f64::from(position) - self.middle) * self.step_rad)
    }

    /// Velocity in a reply to [`Self::read_velocity`], rad/s; `None` in another one.
    pub fn velocity_radps(&self, status: &Status) -> Option<f64> {
        let value = value(&status.parameters, self.present_velocity)?;
        let steps = match (self.protocol, value) {
            (Protocol::Two, _) | (Protocol::One, 0..=1023) => value,
            (Protocol::One, 1024..=2047) => 1024 - value,
            (Protocol::One, _) => return None,
        };
        Some(f64::from(steps) * self.velocity_step_radps)
    }
}

/// The nearest whole number, if there is one.
fn whole(number: f64) -> Option<i32> {
    let rounded = number.round();
    let is_whole = (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(&rounded);
    is_whole.then_some(rounded as i32)
}

/// A signed number of 2 or 4 bytes.
fn value(parameters: &[u8], item: Item) -> Option<i32> {
    match *parameters {
        [low, high] if item.length == 2 => Some(i16::from_le_bytes([low, high]).into()),
        [a, b, c, d] if item.length == 4 => Some(i32::from_le_bytes([a, b, c, d])),
        _ => None,
    }
}

impl Protocol {
    /// Asks a servo whether it is there; with 2.0, for its [`Status::identity`].
    pub fn ping(self, id: u8) -> Option<Vec<u8>> {
        let is_answered = id != BROADCAST || self == Self::Two;
        is_answered.then(|| self.packet(id, PING, &[])).flatten()
    }

    /// Asks a servo for a value.
    pub fn read(self, id: u8, item: Item) -> Option<Vec<u8>> {
        let is_answered = id != BROADCAST && item.length > 0;
        let read = || match self {
            Self::One => self.packet(id, READ, &[byte(item.address)?, byte(item.length)?]),
            Self::Two => self.packet(id, READ, &words(item)),
        };
        is_answered.then(read).flatten()
    }

    /// Sets a value of a servo, or of all with [`BROADCAST`].
    pub fn write(self, id: u8, item: Item, value: i32) -> Option<Vec<u8>> {
        let value = value.to_le_bytes();
        let value = value.get(..item.length.into())?;
        let address = item.address.to_le_bytes();
        let address = match self {
            Self::One => &[byte(item.address)?][..],
            Self::Two => &address,
        };
        self.packet(id, WRITE, &[address, value].concat())
    }

    /// Asks several servos for the same value; each replies. Protocol 2.0 alone.
    pub fn sync_read(self, ids: &[u8], item: Item) -> Option<Vec<u8>> {
        let is_new = |(at, id): (usize, &u8)| *id <= 252 && !ids[..at].contains(id);
        let is_possible = self == Self::Two
            && item.length > 0
            && !ids.is_empty()
            && ids.iter().enumerate().all(is_new);
        let parameters = [&words(item), ids].concat();
        let packet = || self.packet(BROADCAST, SYNC_READ, &parameters);
        is_possible.then(packet).flatten()
    }

    fn packet(self, id: u8, instruction: u8, parameters: &[u8]) -> Option<Vec<u8>> {
        let body = [&[instruction], parameters].concat();
        match self {
            Self::One => {
                let length = u8::try_from(body.len() + 1).ok()?;
                let mut bytes = [MARK_1, &[id, length], &body].concat();
                bytes.push(checksum(&bytes[2..]));
                (id <= BROADCAST).then_some(bytes)
            }
            Self::Two => {
                let body = stuff(&body);
                let length = u16::try_from(body.len() + 2).ok()?;
                let mut bytes = [MARK_2, &[id], &length.to_le_bytes(), &body].concat();
                bytes.extend(crc(&bytes).to_le_bytes());
                (id <= 252 || id == BROADCAST).then_some(bytes)
            }
        }
    }
}

fn byte(number: u16) -> Option<u8> {
    u8::try_from(number).ok()
}

fn words(item: Item) -> [u8; 4] {
    let ([a, b], [c, d]) = (item.address.to_le_bytes(), item.length.to_le_bytes());
    [a, b, c, d]
}

fn checksum(bytes: &[u8]) -> u8 {
    !bytes
        .iter()
        .fold(0, |sum: u8, byte| sum.wrapping_add(*byte))
}

/// CRC-16 with the polynomial 0x8005, highest bit first, from 0.
fn crc(bytes: &[u8]) -> u16 {
    let shift = |crc: u16| (crc << 1) ^ if crc & 0x8000 == 0 { 0 } else { 0x8005 };
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| shift(crc))
    })
}

fn stuff(body: &[u8]) -> Vec<u8> {
    let mut stuffed = Vec::with_capacity(body.len());
    for byte in body {
        stuffed.push(*byte);
        if stuffed.ends_with(STUFFED) {
            stuffed.push(0xFD);
        }
    }
    stuffed
}

fn unstuff(body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(body.len());
    let mut rest = body;
    while let [first, after @ ..] = rest {
        if let Some(after) = rest
            .strip_prefix(STUFFED)
            .and_then(|rest| rest.strip_prefix(&[0xFD]))
        {
            bytes.extend_from_slice(STUFFED);
            rest = after;
        } else {
            bytes.push(*first);
            rest = after;
        }
    }
    bytes
}

/// Reply of a servo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Status {
    /// Who replies.
    pub id: u8,
    /// What is wrong with the request or the servo. The parameters may be valid none the less.
    pub faults: Vec<Fault>,
    /// The value that was asked for.
    pub parameters: Vec<u8>,
}

/// What is wrong with a request or a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The supply voltage is out of range.
    InputVoltage,
    /// The goal is beyond the angle limits.
    AngleLimit,
    /// It is too hot.
    Overheating,
    /// A value is out of range.
    Range,
    /// The request came damaged.
    Checksum,
    /// The load is too great for the torque.
    Overload,
    /// The instruction is unknown, or an action without a registered write.
    Instruction,
    /// 2.0: the servo has a fault; its hardware error status tells which.
    Hardware,
    /// 2.0: the request failed.
    Result,
    /// 2.0: too few bytes for a value.
    DataLength,
    /// 2.0: a value is beyond its limit.
    DataLimit,
    /// 2.0: the value cannot be read, written, or not while the torque is on.
    Access,
    /// 2.0: a number without a meaning in the manual.
    Unknown(u8),
}

/// What kind of servo replies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Model number, 1030 for an XM430-W210.
    pub model: u16,
    /// Version of the firmware.
    pub firmware: u8,
}

impl Status {
    /// In a reply to a ping with 2.0; `None` in another one.
    pub fn identity(&self) -> Option<Identity> {
        match *self.parameters {
            [low, high, firmware] => Some(Identity {
                model: u16::from_le_bytes([low, high]),
                firmware,
            }),
            _ => None,
        }
    }
}

/// Decodes replies.
#[derive(Debug)]
pub struct DynamixelDecoder {
    protocol: Protocol,
    buffer: ReadBuffer,
}

impl DynamixelDecoder {
    /// For a line with this protocol.
    pub fn new(protocol: Protocol) -> Self {
        Self {
            protocol,
            buffer: ReadBuffer::default(),
        }
    }
}

impl Decoder for DynamixelDecoder {
    type Message = Status;

    fn push(&mut self, bytes: &[u8]) {
        self.buffer.push(bytes);
    }

    fn next_message(&mut self) -> Option<Status> {
        self.buffer.next_message(match self.protocol {
            Protocol::One => front_1,
            Protocol::Two => front_2,
        })
    }

    fn dropped(&self) -> &Dropped {
        &self.buffer.dropped
    }
}

fn front_1(bytes: &[u8]) -> Front<Status> {
    let garbage = before_mark(bytes, MARK_1);
    if garbage > 0 {
        return Front::Skip(DropReason::Garbage, garbage);
    }
    let Some(&[_, _, id, length]) = bytes.first_chunk::<HEADER_1>() else {
        return Front::Incomplete;
    };
    if id == 0xFF {
        return Front::Skip(DropReason::Garbage, 1);
    }
    if length < 2 {
        return Front::Skip(DropReason::Length, 1);
    }
    let total = HEADER_1 + usize::from(length);
    let received = &bytes[..bytes.len().min(total)];
    if let Some(at) = (1..received.len()).find(|at| body_1(&received[*at..]).is_some()) {
        return Front::Skip(DropReason::CutOff, at);
    }
    if received.len() < total {
        return Front::Incomplete;
    }
    match body_1(received) {
        None => Front::Skip(DropReason::Checksum, 1),
        // Only a host speaks to all.
        Some(_) if id == BROADCAST => Front::Skip(DropReason::UnknownKind, total),
        Some([error, parameters @ ..]) if error & 0x80 == 0 => {
            let status = Status {
                id,
                faults: faults_1(*error),
                parameters: parameters.to_vec(),
            };
            Front::Message(status, total)
        }
        Some(_) => Front::Skip(DropReason::Field, 1),
    }
}

/// Error and parameters of a packet with a right sum at the front.
fn body_1(bytes: &[u8]) -> Option<&[u8]> {
    let [_, _, id, length] = *bytes.first_chunk::<HEADER_1>()?;
    let (summed, sum) = bytes
        .get(..HEADER_1 + usize::from(length))?
        .split_at_checked(HEADER_1 + usize::from(length).checked_sub(1)?)?;
    let is_whole =
        bytes.starts_with(MARK_1) && id != 0xFF && length >= 2 && sum == [checksum(&summed[2..])];
    is_whole.then(|| &summed[HEADER_1..])
}

fn front_2(bytes: &[u8]) -> Front<Status> {
    let garbage = before_mark(bytes, MARK_2);
    if garbage > 0 {
        return Front::Skip(DropReason::Garbage, garbage);
    }
    let Some(&[_, _, _, _, id, low, high]) = bytes.first_chunk::<HEADER_2>() else {
        return Front::Incomplete;
    };
    if matches!(id, 0xFD | 0xFF) {
        return Front::Skip(DropReason::Field, 1);
    }
    let length = usize::from(u16::from_le_bytes([low, high]));
    if !(3..=MAX_LENGTH_2).contains(&length) {
        return Front::Skip(DropReason::Length, 1);
    }
    let total = HEADER_2 + length;
    let received = &bytes[..bytes.len().min(total)];
    // A mark in the body is the next packet, for one in the data would be stuffed.
    let body = &received[HEADER_2..received.len().min(total - 2)];
    if let Some(at) = body
        .windows(MARK_2.len())
        .position(|window| window == MARK_2)
    {
        return Front::Skip(DropReason::CutOff, HEADER_2 + at);
    }
    if received.len() < total {
        return Front::Incomplete;
    }
    let (checked, sum) = received.split_at(total - 2);
    if sum != crc(checked).to_le_bytes() {
        return Front::Skip(DropReason::Checksum, 1);
    }
    match &*unstuff(body) {
        [STATUS, ..] if id == BROADCAST => Front::Skip(DropReason::Field, 1),
        [STATUS, error, parameters @ ..] => {
            let status = Status {
                id,
                faults: faults_2(*error),
                parameters: parameters.to_vec(),
            };
            Front::Message(status, total)
        }
        [STATUS] => Front::Skip(DropReason::Length, 1),
        _ => Front::Skip(DropReason::UnknownKind, total),
    }
}

/// Bits 0 to 6.
fn faults_1(error: u8) -> Vec<Fault> {
    let faults = [
        Fault::InputVoltage,
        Fault::AngleLimit,
        Fault::Overheating,
        Fault::Range,
        Fault::Checksum,
        Fault::Overload,
        Fault::Instruction,
    ];
    let is_set = |(bit, fault): (usize, Fault)| (error >> bit & 1 != 0).then_some(fault);
    faults.into_iter().enumerate().filter_map(is_set).collect()
}

/// A number, and bit 7 for the servo itself.
fn faults_2(error: u8) -> Vec<Fault> {
    let of_request = match error & 0x7F {
        0 => None,
        1 => Some(Fault::Result),
        2 => Some(Fault::Instruction),
        3 => Some(Fault::Checksum),
        4 => Some(Fault::Range),
        5 => Some(Fault::DataLength),
        6 => Some(Fault::DataLimit),
        7 => Some(Fault::Access),
        other => Some(Fault::Unknown(other)),
    };
    let of_servo = (error & 0x80 != 0).then_some(Fault::Hardware);
    of_request.into_iter().chain(of_servo).collect()
}

#[cfg(test)]
mod tests;
