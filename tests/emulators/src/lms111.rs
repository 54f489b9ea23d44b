//! SICK LMS111, CoLa A and B.
//!
//! Written from SICK's telegram tables as the operating instructions of the LMS500 (8013796, pages 82 to
//! 84) repeat them, and from a recorded session of an LMS111 (`20210302_lms111.pcapng.json` of
//! SICKAG/sick_scan_xd), which has the order and the widths of all replies here but those of
//! `DeviceIdent`, `LMPscancfg`, `mLMPsetscancfg` and `sFA`: these are from `LMS1xx.cpp` of
//! clearpathrobotics/LMS1xx and from the tables.

#![expect(
    clippy::doc_markdown,
    reason = "names of devices and of a protocol are no code"
)]

use std::time::Duration;

use crate::feed::Feed;
use crate::{Device, Ticks, take_request};

/// A scanner.
#[expect(clippy::struct_excessive_bools, reason = "what a test switches on")]
#[derive(Debug)]
pub struct Lms111 {
    /// Its serial number.
    pub serial_number: u32,
    /// Its clock when power comes, µs.
    pub clock_start_us: u32,
    /// It replies to another command than it was asked.
    pub replies_to_another: bool,
    /// It replies to nothing.
    pub is_mute: bool,
    /// It sends garbage between telegrams.
    pub has_garbage: bool,
    /// It repeats each scan.
    pub repeats: bool,
    /// It refuses a change of its scan configuration.
    pub is_stubborn: bool,
    /// Logins so far.
    pub logins: u32,
    is_logged_in: bool,
    is_subscribed: bool,
    is_text: bool,
    /// 1/100 Hz; 1/10,000°.
    frequency: u32,
    resolution: u32,
    output: [i32; 2],
    /// As in the request: 11 bytes and the interval.
    content: Vec<u32>,
    buffer: Vec<u8>,
    ticks: Ticks,
    /// Distances, mm.
    feed: Feed<Vec<u16>>,
    /// Sweeps of it so far.
    fed: u64,
}

impl Default for Lms111 {
    fn default() -> Self {
        Self {
            serial_number: 1_234_567,
            clock_start_us: 0,
            replies_to_another: false,
            is_mute: false,
            has_garbage: false,
            repeats: false,
            is_stubborn: false,
            logins: 0,
            is_logged_in: false,
            is_subscribed: false,
            is_text: false,
            frequency: 5000,
            resolution: 5000,
            output: [-450_000, 2_250_000],
            content: FACTORY_CONTENT.to_vec(),
            buffer: Vec::new(),
            ticks: Ticks::default(),
            feed: Feed::default(),
            fed: 0,
        }
    }
}

/// With signal strengths of 8 bits.
const FACTORY_CONTENT: [u32; 12] = [1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1];
/// A code below 16 is an error.
const ERROR: u16 = 1;
/// From the end of a sweep to its telegram, in the recorded session.
const SEND_DELAY_US: u32 = 3100;

/// A value of a telegram.
#[derive(Clone, Debug)]
enum Value {
    Number(u32, usize),
    /// A name of five characters.
    Name(&'static str),
    /// A text with its length.
    Text(String),
}

impl Lms111 {
    /// The distance of a beam, mm.
    pub fn distance_mm(beam: usize, scan: u16) -> u16 {
        1000 + 10 * (beam % 500) as u16 + scan % 10
    }

    /// Beams that are sent.
    pub fn beams(&self) -> usize {
        let [start, stop] = self.output;
        // The start is not quite on a beam.
        ((start.abs_diff(stop) + self.resolution / 2) / self.resolution) as usize + 1
    }

    /// Gives it a sweep whose first beam leaves at `at`; as many ranges as it sends. Infinite is no echo, what is no
    /// range an error.
    pub fn feed(&mut self, at: Duration, ranges_m: &[f32]) {
        let distance_mm = |range_m: &f32| match *range_m {
            f32::INFINITY => 0,
            range_m if range_m > 0.0 => (range_m * 1000.0).round() as u16,
            _ => ERROR,
        };
        self.feed
            .push(at, ranges_m.iter().map(distance_mm).collect());
    }

    /// A host has asked for scans.
    pub fn is_subscribed(&self) -> bool {
        self.is_subscribed
    }

    /// From the first beam to the zero index, which is opposite of the middle beam, at 270°: in the recorded session
    /// its time is [`SEND_DELAY_US`] before that of the telegram.
    fn to_index(&self) -> Duration {
        let first_deg = f64::from(self.output[0]) / 10_000.0;
        Duration::from_secs_f64((270.0 - first_deg) / 360.0 * 100.0 / f64::from(self.frequency))
    }

    fn telegram(&self, command: &str, values: &[Value]) -> Vec<u8> {
        if self.is_text {
            let token = |value: &Value| match value {
                Value::Number(number, _) => format!(" {number:X}"),
                Value::Name(name) => format!(" {name}"),
                Value::Text(value) => format!(" {:X} {value}", value.len()),
            };
            let tokens: Vec<String> = values.iter().map(token).collect();
            return format!("\x02{command}{}\x03", tokens.concat()).into_bytes();
        }
        let mut payload = command.as_bytes().to_vec();
        payload.push(b' ');
        for value in values {
            match value {
                Value::Number(number, width) => {
                    payload.extend_from_slice(&number.to_be_bytes()[4 - width..]);
                }
                Value::Name(name) => payload.extend_from_slice(name.as_bytes()),
                Value::Text(text) => {
                    payload.extend_from_slice(&(text.len() as u16).to_be_bytes());
                    payload.extend_from_slice(text.as_bytes());
                }
            }
        }
        let mut telegram = vec![2, 2, 2, 2];
        telegram.extend_from_slice(&(payload.len() as u32).to_be_bytes());
        telegram.extend_from_slice(&payload);
        telegram.push(payload.iter().fold(0, |sum, byte| sum ^ byte));
        telegram
    }

    /// Command and values of a request; the widths are those of CoLa B.
    fn arguments(&self, payload: &[u8], widths: &[usize]) -> Option<Vec<u32>> {
        let mut spaces = payload
            .iter()
            .enumerate()
            .filter(|(_, byte)| **byte == b' ');
        let (at, _) = spaces.nth(1)?;
        let rest = &payload[at + 1..];
        if self.is_text {
            let text = std::str::from_utf8(rest).ok()?;
            let number = |token: &str| match token.strip_prefix('+') {
                Some(decimal) => decimal.parse().ok(),
                None => u32::from_str_radix(token, 16).ok(),
            };
            let numbers: Vec<u32> = text.split(' ').map(number).collect::<Option<_>>()?;
            return (numbers.len() == widths.len()).then_some(numbers);
        }
        let mut at = 0;
        let mut numbers = Vec::new();
        for width in widths {
            let bytes = rest.get(at..at + width)?;
            numbers.push(
                bytes
                    .iter()
                    .fold(0, |number, byte| number << 8 | u32::from(*byte)),
            );
            at += width;
        }
        (at == rest.len()).then_some(numbers)
    }

    fn reply(&mut self, payload: &[u8]) -> Option<Vec<u8>> {
        let text = String::from_utf8_lossy(payload);
        let mut words = text.split(' ');
        let (kind, name) = (words.next()?, words.next()?.to_owned());
        let byte = |number| Value::Number(number, 1);
        let sector = |this: &Self| {
            [
                Value::Number(this.resolution, 4),
                Value::Number(this.output[0].cast_unsigned(), 4),
                Value::Number(this.output[1].cast_unsigned(), 4),
            ]
        };
        if self.is_mute {
            return None;
        }
        if self.replies_to_another {
            return Some(self.telegram("sRA FirmwareVersion", &[Value::Text("V1.80".to_owned())]));
        }
        let denied = |this: &Self| Some(this.telegram("sFA", &[Value::Number(1, 2)]));
        Some(match (kind, name.as_str()) {
            ("sMN", "SetAccessMode") => {
                let arguments = self.arguments(payload, &[1, 4])?;
                self.is_logged_in = arguments == [3, 0xF472_4744];
                self.logins += u32::from(self.is_logged_in);
                self.telegram("sAN SetAccessMode", &[byte(self.is_logged_in.into())])
            }
            ("sRN", "DeviceIdent") => {
                let texts =
                    ["LMS10x_FieldEval", "V1.80.2  "].map(|text| Value::Text(text.to_owned()));
                self.telegram("sRA DeviceIdent", &texts)
            }
            ("sRN", "LMPscancfg") => {
                let mut values = vec![Value::Number(self.frequency, 4), Value::Number(1, 2)];
                values.extend(sector(self));
                self.telegram("sRA LMPscancfg", &values)
            }
            ("sRN", "LMPoutputRange") => {
                let mut values = vec![Value::Number(1, 2)];
                values.extend(sector(self));
                self.telegram("sRA LMPoutputRange", &values)
            }
            ("sRN", "LMDscandatacfg") => {
                let width = |at| if at == 11 { 2 } else { 1 };
                let content = self.content.iter().enumerate();
                let values: Vec<Value> = content
                    .map(|(at, number)| Value::Number(*number, width(at)))
                    .collect();
                self.telegram("sRA LMDscandatacfg", &values)
            }
            (
                "sMN" | "sWN",
                "mLMPsetscancfg" | "LMPoutputRange" | "LMDscandatacfg" | "LMCstartmeas",
            ) if !self.is_logged_in => {
                return denied(self);
            }
            ("sMN", "mLMPsetscancfg") => {
                let arguments = self.arguments(payload, &[4, 2, 4, 4, 4])?;
                // The listing: 25 Hz with 0.25° or 0.5°, 50 Hz with 0.5°.
                let is_possible = matches!(
                    (arguments[0], arguments[2]),
                    (2500, 2500 | 5000) | (5000, 5000)
                );
                if is_possible && !self.is_stubborn {
                    (self.frequency, self.resolution) = (arguments[0], arguments[2]);
                    self.ticks.restart();
                }
                let status = byte(u32::from(!is_possible));
                let mut values = vec![
                    status,
                    Value::Number(self.frequency, 4),
                    Value::Number(1, 2),
                ];
                values.extend(sector(self));
                self.telegram("sAN mLMPsetscancfg", &values)
            }
            ("sWN", "LMPoutputRange") => {
                let arguments = self.arguments(payload, &[2, 4, 4, 4])?;
                self.output = [arguments[2].cast_signed(), arguments[3].cast_signed()];
                // As the recorded device: it adds a little.
                self.output[0] += 3;
                self.telegram("sWA LMPoutputRange", &[])
            }
            ("sWN", "LMDscandatacfg") => {
                self.content = self.arguments(payload, &[1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2])?;
                self.telegram("sWA LMDscandatacfg", &[])
            }
            ("sMN", "LMCstartmeas") => self.telegram("sAN LMCstartmeas", &[byte(0)]),
            ("sMN", "Run") => {
                self.is_logged_in = false;
                self.telegram("sAN Run", &[byte(1)])
            }
            ("sEN", "LMDscandata") => {
                self.is_subscribed = self.arguments(payload, &[1])? == [1];
                self.telegram("sEA LMDscandata", &[byte(self.is_subscribed.into())])
            }
            _ => self.telegram("sFA", &[Value::Number(3, 2)]),
        })
    }

    fn scan(&self, scan: u16, sent_us: u32, distances_mm: &[u16]) -> Vec<u8> {
        let number = |number: u32, width| Value::Number(number, width);
        let mut values = vec![number(1, 2), number(1, 2), number(self.serial_number, 4)];
        values.extend([number(0, 1), number(0, 1)]);
        values.extend([number(u32::from(scan), 2), number(u32::from(scan), 2)]);
        values.extend([
            number(sent_us.wrapping_sub(SEND_DELAY_US), 4),
            number(sent_us, 4),
        ]);
        values.extend([0; 4].map(|byte| number(byte, 1)));
        values.extend([number(0, 2), number(self.frequency, 4), number(360, 4)]);
        values.push(number(0, 2)); // Encoders.
        values.push(number(1, 2)); // Channels of 16 bits.
        let channel = |values: &mut Vec<Value>, name: &'static str| {
            values.extend([
                Value::Name(name),
                number(1.0_f32.to_bits(), 4),
                number(0, 4),
            ]);
            values.extend([
                number(self.output[0].cast_unsigned(), 4),
                number(self.resolution, 2),
            ]);
            values.push(number(distances_mm.len() as u32, 2));
        };
        channel(&mut values, "DIST1");
        let distances = distances_mm.iter();
        values.extend(distances.map(|distance| number((*distance).into(), 2)));
        let has_strengths = self.content[2] == 1;
        values.push(number(has_strengths.into(), 2)); // Channels of 8 bits.
        if has_strengths {
            channel(&mut values, "RSSI1");
            values.extend(distances_mm.iter().map(|_| number(200, 1)));
        }
        // Position, name, comment, time, event.
        values.extend([0; 5].map(|flag| number(flag, 2)));
        self.telegram("sSN LMDscandata", &values)
    }
}

/// Where the first request is, with its frame.
fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.iter().position(|byte| *byte == 2)?;
    let rest = &bytes[start..];
    if rest.starts_with(&[2, 2, 2, 2]) {
        let length = rest.get(4..8)?;
        let length = length
            .iter()
            .fold(0, |length, byte| length << 8 | usize::from(*byte));
        (rest.len() >= length + 9).then_some((start, length + 9))
    } else {
        let end = rest.iter().position(|byte| *byte == 3)?;
        Some((start, end + 1))
    }
}

impl Device for Lms111 {
    fn power_on(&mut self) -> Vec<u8> {
        let kept = Self {
            serial_number: self.serial_number,
            clock_start_us: self.clock_start_us,
            replies_to_another: self.replies_to_another,
            is_mute: self.is_mute,
            has_garbage: self.has_garbage,
            repeats: self.repeats,
            is_stubborn: self.is_stubborn,
            logins: self.logins,
            ..Self::default()
        };
        *self = kept;
        Vec::new()
    }

    fn connect(&mut self) {
        self.is_logged_in = false;
        self.is_subscribed = false;
        self.buffer.clear();
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(telegram) = take_request(&mut self.buffer, find) {
            self.is_text = !telegram.starts_with(&[2, 2, 2, 2]);
            let (from, to) = if self.is_text { (1, 1) } else { (8, 1) };
            let payload = telegram[from..telegram.len() - to].to_vec();
            replies.extend(self.reply(&payload).unwrap_or_default());
        }
        replies
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let period = Duration::from_secs_f64(100.0 / f64::from(self.frequency));
        let delay = Duration::from_micros(SEND_DELAY_US.into());
        let due = self.ticks.due(uptime.saturating_sub(delay), period);
        let to_telegram = self.to_index() + delay;
        let fed = self.feed.take_until(uptime.saturating_sub(to_telegram));
        if !self.is_subscribed {
            return Vec::new();
        }
        let sweeps: Vec<(u16, Duration, Vec<u16>)> = match fed {
            Some(fed) => {
                let first = self.fed;
                self.fed += fed.len() as u64;
                let sweeps = fed.into_iter().zip(first..);
                sweeps
                    .map(|((at, distances), scan)| (scan as u16, at + to_telegram, distances))
                    .collect()
            }
            None => due
                .map(|scan| {
                    let beams = 0..self.beams();
                    let distances = beams.map(|beam| Self::distance_mm(beam, scan as u16));
                    let at = period * (scan as u32 + 1) + delay;
                    (scan as u16, at, distances.collect())
                })
                .collect(),
        };
        let mut sent = Vec::new();
        for (scan, at, distances) in sweeps {
            let sent_us = self.clock_start_us.wrapping_add(at.as_micros() as u32);
            let telegram = self.scan(scan, sent_us, &distances);
            if self.has_garbage {
                sent.push(vec![0xFF, 2, b's', b'S', 2, 2, 2, 2, 0xFF]);
            }
            if self.repeats {
                sent.push(telegram.clone());
            }
            sent.push(telegram);
        }
        sent
    }
}
