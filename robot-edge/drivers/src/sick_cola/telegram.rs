//! Telegrams in both codings, byte for byte.

use super::{
    Channel, Coding, Details, DeviceState, DeviceTime, Encoder, Message, Position, ScanConfig,
    ScanData, ScanDataConfig, ScanStatus, Sector,
};
use crate::DropReason;
use crate::read_buffer::{Framed, Front, before_mark};

pub(super) const STX: u8 = 2;
pub(super) const ETX: u8 = 3;
/// An LMS5xx with five echoes and their strengths sends 23 kB.
pub(super) const MAX_PAYLOAD: usize = 32 * 1024;
const HEADER: usize = 8;
pub(super) const MAX_ENCODERS: usize = 4;
pub(super) const MAX_CHANNELS: usize = 12;
const MAX_TEXT: usize = 128;

impl Framed for Message {
    fn front(bytes: &[u8]) -> Front<Self> {
        match bytes {
            [] | [STX] => Front::Incomplete,
            [STX, STX, ..] => binary(bytes),
            [STX, b's', ..] => text(bytes),
            [_, rest @ ..] => Front::Skip(DropReason::Garbage, 1 + before_mark(rest, &[STX])),
        }
    }
}

fn binary(bytes: &[u8]) -> Front<Message> {
    if bytes.iter().take(4).any(|byte| *byte != STX) {
        return Front::Skip(DropReason::Garbage, 1);
    }
    let Some((header, rest)) = bytes.split_first_chunk::<HEADER>() else {
        return Front::Incomplete;
    };
    let length = header.iter().skip(4);
    let length = length.fold(0, |length, byte| length << 8 | usize::from(*byte));
    if length > MAX_PAYLOAD {
        return Front::Skip(DropReason::Length, 1);
    }
    if !begins_as_telegram(rest.get(..length).unwrap_or(rest)) {
        return Front::Skip(DropReason::Field, 1);
    }
    match (rest.get(..length), rest.get(length)) {
        (Some(payload), Some(sum)) if checksum(payload) == *sum => {
            decoded(Coding::B, payload, HEADER + length + 1)
        }
        (Some(_), Some(_)) => Front::Skip(DropReason::Checksum, 1),
        _ => Front::Incomplete,
    }
}

fn text(bytes: &[u8]) -> Front<Message> {
    let within = bytes.get(1..).unwrap_or_default();
    let is_control = |byte: &u8| *byte < b' ';
    let end = within.iter().position(is_control);
    let payload = within
        .get(..end.unwrap_or(within.len()))
        .unwrap_or_default();
    if payload.len() > MAX_PAYLOAD {
        return Front::Skip(DropReason::Length, 1);
    }
    if !begins_as_telegram(payload) {
        return Front::Skip(DropReason::Field, 1);
    }
    match end.and_then(|end| within.get(end)) {
        None => Front::Incomplete,
        Some(&ETX) => decoded(Coding::A, payload, payload.len() + 2),
        Some(&STX) => Front::Skip(DropReason::CutOff, payload.len() + 1),
        Some(_) => Front::Skip(DropReason::Field, 1),
    }
}

/// Whether a payload begins like `sRA`, as far as it was received.
fn begins_as_telegram(payload: &[u8]) -> bool {
    let fits = |(at, byte): (usize, &u8)| match at {
        0 => *byte == b's',
        _ => byte.is_ascii_uppercase(),
    };
    payload.iter().take(3).enumerate().all(fits)
}

pub(super) fn checksum(payload: &[u8]) -> u8 {
    payload.iter().fold(0, |sum, byte| sum ^ byte)
}

fn decoded(coding: Coding, payload: &[u8], length: usize) -> Front<Message> {
    match message(coding, payload) {
        Ok(message) => Front::Message(message, length),
        Err(DropReason::UnknownKind) => Front::Skip(DropReason::UnknownKind, length),
        Err(reason) => Front::Skip(reason, 1),
    }
}

fn message(coding: Coding, payload: &[u8]) -> Result<Message, DropReason> {
    let (kind, rest) = payload.split_at_checked(3).ok_or(DropReason::Length)?;
    let rest = rest.strip_prefix(b" ").unwrap_or(rest);
    let mut values = Values { coding, rest };
    if kind == b"sFA" {
        return whole(values.u16().map(Message::Error), &values);
    }
    let name = values.name();
    let values = &mut values;
    let accepted = |request| {
        Some(Message::Answer {
            request,
            result: Ok(()),
        })
    };
    let message = match (kind, name) {
        (b"sSN" | b"sRA", b"LMDscandata") => {
            let scan = scan_data(values).map(Box::new);
            return scan.map(Message::Scan).ok_or(DropReason::Field);
        }
        (b"sAN", b"SetAccessMode") => values.answer("SetAccessMode", 1),
        (b"sAN", b"Run") => values.answer("Run", 1),
        (b"sAN", b"mEEwriteall") => values.answer("mEEwriteall", 1),
        (b"sAN", b"LMCstartmeas") => values.answer("LMCstartmeas", 0),
        (b"sAN", b"LMCstopmeas") => values.answer("LMCstopmeas", 0),
        (b"sAN", b"mLMPsetscancfg") => {
            let answer = values.answer("mLMPsetscancfg", 0);
            // The settings that are in force now; LMPscancfg has them too.
            values.rest = &[];
            answer
        }
        (b"sWA", b"EIHstCola") => accepted("EIHstCola"),
        (b"sWA", b"LMPoutputRange") => accepted("LMPoutputRange"),
        (b"sWA", b"LMDscandatacfg") => accepted("LMDscandatacfg"),
        (b"sEA", b"LMDscandata") => values.bool().map(Message::Subscribed),
        (b"sRA", b"DeviceIdent") => values.identity(),
        (b"sRA", b"FirmwareVersion") => values.string(2).map(Message::FirmwareVersion),
        (b"sRA", b"LocationName") => values.string(2).map(Message::LocationName),
        (b"sRA", b"SCdevicestate") => values.device_state().map(Message::DeviceState),
        (b"sRA", b"STlms") => {
            let status = values.u16().map(Message::Status);
            // Temperature, time and lamps; the widths of CoLa B are not known.
            values.rest = &[];
            status
        }
        (b"sRA", b"LMPscancfg") => values.scan_config().map(Message::ScanConfig),
        (b"sRA", b"LMPoutputRange") => {
            let sectors = values.u16();
            let sector = sectors.and_then(|_| Sector::read(values));
            sector.map(Message::OutputRange)
        }
        (b"sRA", b"LMDscandatacfg") => ScanDataConfig::read(values).map(Message::ScanDataConfig),
        _ => return Err(DropReason::UnknownKind),
    };
    whole(message, values)
}

/// A message that leaves nothing over.
fn whole(message: Option<Message>, values: &Values<'_>) -> Result<Message, DropReason> {
    let nothing_left = values.rest.iter().all(|byte| *byte == b' ');
    message.filter(|_| nothing_left).ok_or(DropReason::Field)
}

/// Values that wait to be read.
#[derive(Clone, Copy)]
pub(super) struct Values<'a> {
    coding: Coding,
    rest: &'a [u8],
}

impl<'a> Values<'a> {
    fn take(&mut self, length: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(length)?;
        self.rest = rest;
        Some(taken)
    }

    /// Bytes up to the next space, which is taken too.
    fn name(&mut self) -> &'a [u8] {
        let is_space = |byte: &u8| *byte == b' ';
        let length = self.rest.iter().position(is_space);
        let (name, rest) = self.rest.split_at(length.unwrap_or(self.rest.len()));
        self.rest = rest.strip_prefix(b" ").unwrap_or(rest);
        name
    }

    /// A number of `width` bytes; negative ones as two's complement.
    fn number(&mut self, width: usize) -> Option<u32> {
        if self.coding == Coding::B {
            let bytes = self.take(width)?.iter();
            return Some(bytes.fold(0, |number, byte| number << 8 | u32::from(*byte)));
        }
        let token = std::str::from_utf8(self.name()).ok()?;
        let limit = 1_i64 << (8 * width);
        let number = if token.starts_with(['+', '-']) {
            let number = token.parse::<i64>().ok()?;
            let is_negative = (-limit / 2..0).contains(&number);
            if is_negative { number + limit } else { number }
        } else {
            i64::from_str_radix(token, 16).ok()?
        };
        let fits = (0..limit).contains(&number);
        fits.then_some(number as u32)
    }

    pub(super) fn u8(&mut self) -> Option<u8> {
        self.number(1)?.try_into().ok()
    }

    pub(super) fn u16(&mut self) -> Option<u16> {
        self.number(2)?.try_into().ok()
    }

    pub(super) fn u32(&mut self) -> Option<u32> {
        self.number(4)
    }

    pub(super) fn i32(&mut self) -> Option<i32> {
        self.number(4).map(u32::cast_signed)
    }

    fn finite(&mut self) -> Option<f32> {
        let number = f32::from_bits(self.u32()?);
        number.is_finite().then_some(number)
    }

    pub(super) fn bool(&mut self) -> Option<bool> {
        match self.u8()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    /// A number that is not above `limit`.
    fn count(&mut self, limit: usize) -> Option<usize> {
        let count = usize::from(self.u16()?);
        (count <= limit).then_some(count)
    }

    /// A text after its length, which has `width` bytes in CoLa B.
    fn string(&mut self, width: usize) -> Option<String> {
        let length = self.number(width)? as usize;
        let text = self.take((length <= MAX_TEXT).then_some(length)?)?;
        if self.coding == Coding::A && !self.rest.is_empty() {
            self.rest = self.rest.strip_prefix(b" ")?;
        }
        Some(String::from_utf8_lossy(text).into_owned())
    }

    fn answer(&mut self, request: &'static str, good: u8) -> Option<Message> {
        let code = self.u8()?;
        let result = if code == good { Ok(()) } else { Err(code) };
        Some(Message::Answer { request, result })
    }

    fn identity(&mut self) -> Option<Message> {
        let device = self.string(2)?;
        let firmware = self.string(2)?;
        Some(Message::Identity { device, firmware })
    }

    fn device_state(&mut self) -> Option<DeviceState> {
        match self.u8()? {
            0 => Some(DeviceState::Busy),
            1 => Some(DeviceState::Ready),
            2 => Some(DeviceState::Error),
            3 => Some(DeviceState::Standby),
            _ => None,
        }
    }

    /// Devices with several sectors send all of them; the first is read.
    fn scan_config(&mut self) -> Option<ScanConfig> {
        let frequency_centihertz = self.u32()?;
        self.u16()?;
        let sector = Sector::read(self)?;
        self.rest = &[];
        Some(ScanConfig {
            frequency_centihertz,
            sector,
        })
    }

    /// A channel whose values have `width` bytes in CoLa B.
    fn channel(&mut self, width: usize) -> Option<Channel> {
        let content = match self.coding {
            Coding::A => self.name(),
            Coding::B => self.take(5)?,
        };
        let is_content = content.len() == 5 && content.iter().all(u8::is_ascii_alphanumeric);
        let content = String::from_utf8_lossy(is_content.then_some(content)?).into_owned();
        let (scale, offset) = (self.finite()?, self.finite()?);
        let (start_deg_e4, step_deg_e4) = (self.i32()?, self.u16()?);
        let shortest = match self.coding {
            Coding::A => 2,
            Coding::B => width,
        };
        // The last token of CoLa A may lack its space.
        let count = self.count(self.rest.len().div_ceil(shortest))?;
        let value = |_| self.number(width)?.try_into().ok();
        Some(Channel {
            content,
            scale,
            offset,
            start_deg_e4,
            step_deg_e4,
            values: (0..count).map(value).collect::<Option<_>>()?,
        })
    }

    /// A number of two bytes that says whether a block follows.
    fn flag(&mut self) -> Option<bool> {
        Some(self.count(1)? == 1)
    }

    /// What follows the channels. In CoLa B, lengths of texts have `width` bytes: 1 in manuals, 2 in
    /// all other telegrams.
    fn details(mut self, width: usize) -> Option<Details> {
        let mut details = Details::default();
        if self.flag()? {
            details.position = Some(Position {
                translation: [self.finite()?, self.finite()?, self.finite()?],
                rotation: [self.finite()?, self.finite()?, self.finite()?],
                rotation_kind: self.u8()?,
            });
        }
        if self.flag()? {
            details.name = Some(self.string(width)?);
        }
        if self.flag()? {
            details.comment = Some(self.string(width)?);
        }
        if self.flag()? {
            let year = self.u16()?;
            let date = [self.u8()?, self.u8()?];
            let clock = [self.u8()?, self.u8()?, self.u8()?];
            details.time = Some(DeviceTime {
                year,
                month_to_second: [date[0], date[1], clock[0], clock[1], clock[2]],
                microsecond: self.u32()?,
            });
        }
        let is_event = self.flag()?;
        (is_event || self.rest.is_empty()).then_some(details)
    }
}

fn scan_data(values: &mut Values<'_>) -> Option<ScanData> {
    let _version = values.u16()?;
    let _device_number = values.u16()?;
    let serial_number = values.u32()?;
    let status = ScanStatus([values.u8()?, values.u8()?]);
    let (telegram_counter, scan_counter) = (values.u16()?, values.u16()?);
    let (power_up_time_us, transmission_time_us) = (values.u32()?, values.u32()?);
    let inputs_outputs = [values.u8()?, values.u8()?, values.u8()?, values.u8()?];
    let _layer = values.u16()?;
    let frequency_centihertz = values.u32()?;
    let _measurement_frequency = values.u32()?;
    let encoders = (0..values.count(MAX_ENCODERS)?).map(|_| {
        Some(Encoder {
            position_ticks: values.u32()?,
            speed: values.u16()?,
        })
    });
    let encoders = encoders.collect::<Option<_>>()?;
    let mut channels = Vec::new();
    for width in [2, 1] {
        for _ in 0..values.count(MAX_CHANNELS)? {
            channels.push(values.channel(width)?);
        }
    }
    Some(ScanData {
        serial_number,
        status,
        telegram_counter,
        scan_counter,
        power_up_time_us,
        transmission_time_us,
        inputs_outputs,
        frequency_centihertz,
        encoders,
        channels,
        details: values.details(1).or_else(|| values.details(2)),
    })
}
