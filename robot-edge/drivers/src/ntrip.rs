//! NTRIP: RTCM 3 corrections from a caster on the internet, TCP port 2101 by default.
//!
//! Source: RTCM 10410.1 (NTRIP version 2) and the document of version 1 by BKG, as casters and clients
//! repeat them (`gpsd/net_ntrip.c` of gpsd; a reply of a Trimble caster in the tests); RTCM 10403, frame
//! and CRC-24Q. A version 2 caster replies as HTTP/1.1, mostly in chunks; a version 1 caster with the
//! line `ICY 200 OK`. One that does not know the mountpoint sends its list of mountpoints instead.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use measurement::GeodeticFix;

use crate::nmea::checksum;
use crate::read_buffer::{Front, ReadBuffer, before_mark};
use crate::{Decoder, DropReason, Dropped};

mod session;

pub use session::Ntrip;

/// Version of the protocol. Casters of version 2 reply to both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum Version {
    One,
    Two,
}

/// Asks for the corrections of a mountpoint. `host` is the caster's name and port. `None` if a text has
/// characters that a request cannot hold.
pub fn request(
    version: Version,
    host: &str,
    mountpoint: &str,
    user_and_password: Option<(&str, &str)>,
) -> Option<Vec<u8>> {
    let is_word = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_graphic());
    let authorization = match user_and_password {
        // A colon ends the user's name.
        Some((user, _)) if user.contains(':') => return None,
        Some((user, password)) => {
            let encoded = BASE64_STANDARD.encode(format!("{user}:{password}"));
            format!("Authorization: Basic {encoded}\r\n")
        }
        None => String::new(),
    };
    let (http, version) = match version {
        Version::One => ("1.0", String::new()),
        Version::Two => (
            "1.1",
            format!("Host: {host}\r\nNtrip-Version: Ntrip/2.0\r\n"),
        ),
    };
    let request = format!(
        "GET /{mountpoint} HTTP/{http}\r\n{version}User-Agent: NTRIP Foreshore\r\n\
        {authorization}Connection: close\r\n\r\n"
    );
    (is_word(host) && is_word(mountpoint)).then(|| request.into_bytes())
}

/// A GGA sentence for casters that compute corrections for a place: sent after the request and every
/// few seconds, on the same connection. `None` without a position.
pub fn position_report(fix: &GeodeticFix, utc_time_of_day_s: f64) -> Option<Vec<u8>> {
    let is_possible = fix.status >= 0
        && fix.latitude_deg.abs() <= 90.0
        && fix.longitude_deg.abs() <= 180.0
        && (0.0..86_400.0).contains(&utc_time_of_day_s);
    if !is_possible {
        return None;
    }
    // Whole units of 0.01 s and 0.00001 minutes, so that no 60 comes out of rounding.
    let second_e2 = (utc_time_of_day_s * 100.0) as u32;
    let (minute, second_e2) = (second_e2 / 6000, second_e2 % 6000);
    let (hour, minute) = (minute / 60, minute % 60);
    let (second, second_e2) = (second_e2 / 100, second_e2 % 100);
    let parts = |degrees: f64| {
        let minutes_e5 = (degrees.abs() * 6e6).round() as u32;
        let (degrees, minutes_e5) = (minutes_e5 / 6_000_000, minutes_e5 % 6_000_000);
        (degrees, minutes_e5 / 100_000, minutes_e5 % 100_000)
    };
    let (latitude, minutes_north, fraction_north) = parts(fix.latitude_deg);
    let (longitude, minutes_east, fraction_east) = parts(fix.longitude_deg);
    let north = if fix.latitude_deg < 0.0 { 'S' } else { 'N' };
    let east = if fix.longitude_deg < 0.0 { 'W' } else { 'E' };
    // Casters need the place alone. The height is above the ellipsoid: separation 0.
    let height_m = if fix.altitude_m.is_finite() {
        fix.altitude_m
    } else {
        0.0
    };
    let body = format!(
        "GPGGA,{hour:02}{minute:02}{second:02}.{second_e2:02},\
        {latitude:02}{minutes_north:02}.{fraction_north:05},{north},\
        {longitude:03}{minutes_east:02}.{fraction_east:05},{east},1,10,1.0,{height_m:.1},M,0.0,M,,"
    );
    Some(format!("${body}*{:02X}\r\n", checksum(body.as_bytes())).into_bytes())
}

/// What a caster sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// Corrections follow.
    Accepted,
    /// There will be no corrections: the first line of the reply, or that of another content.
    Refused(String),
    /// Corrections.
    Rtcm(Rtcm),
    /// The caster ended the corrections, or its reply is damaged: connect again.
    Ended,
}

/// A message of RTCM 3.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rtcm {
    /// Its number: 1005 for the position of a base.
    pub number: u16,
    /// All of it, for the receiver.
    pub frame: Vec<u8>,
}

const RTCM_MARK: u8 = 0xD3;
/// Mark and length; CRC.
const RTCM_HEADER: usize = 3;
const RTCM_CRC: usize = 3;
/// Longest line of a reply's header.
const MAX_LINE: usize = 1024;
/// Bytes of corrections that are taken at once.
const MAX_PIECE: usize = 4096;

/// Decodes the reply of a caster: a new one for each connection.
#[derive(Debug, Default)]
pub struct NtripDecoder {
    reply: ReadBuffer,
    state: State,
    corrections: ReadBuffer,
}

/// Where in the reply the next byte is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    #[default]
    StatusLine,
    Header {
        is_chunked: bool,
    },
    Corrections,
    ChunkLength,
    /// So many bytes of the chunk are left.
    Chunk(usize),
    /// The line end behind a chunk.
    ChunkEnd,
    Ended,
}

/// A piece of the reply.
enum Piece {
    Line(String),
    Corrections(Vec<u8>),
}

impl State {
    fn front(self, bytes: &[u8]) -> Front<Piece> {
        let available = match self {
            // The end of the last chunk, or the text of a refusal.
            Self::Ended => return Front::Blank(bytes.len()),
            Self::Corrections => MAX_PIECE,
            Self::Chunk(left) => MAX_PIECE.min(left),
            // Version 1: corrections follow the first line at once.
            Self::Header { .. } if bytes[0] == RTCM_MARK => MAX_PIECE,
            Self::StatusLine | Self::Header { .. } | Self::ChunkLength | Self::ChunkEnd => {
                return line(bytes);
            }
        };
        let piece = &bytes[..bytes.len().min(available)];
        Front::Message(Piece::Corrections(piece.to_vec()), piece.len())
    }
}

fn line(bytes: &[u8]) -> Front<Piece> {
    let within = &bytes[..bytes.len().min(MAX_LINE)];
    match within.iter().position(|byte| *byte == b'\n') {
        Some(length) => {
            let line = String::from_utf8_lossy(&bytes[..length])
                .trim_end()
                .to_owned();
            Front::Message(Piece::Line(line), length + 1)
        }
        None if within.len() < MAX_LINE => Front::Incomplete,
        None => Front::Skip(DropReason::Length, MAX_LINE),
    }
}

impl Decoder for NtripDecoder {
    type Message = Message;

    fn push(&mut self, bytes: &[u8]) {
        self.reply.push(bytes);
    }

    fn next_message(&mut self) -> Option<Message> {
        loop {
            let rtcm = self.corrections.next_message(front_of_rtcm);
            for (reason, count) in std::mem::take(&mut self.corrections.dropped).iter() {
                self.reply.dropped.add(reason, count as usize);
            }
            if rtcm.is_some() {
                return rtcm.map(Message::Rtcm);
            }
            let state = self.state;
            let piece = self.reply.next_message(|bytes| state.front(bytes))?;
            let message = match piece {
                Piece::Line(line) => self.line(&line),
                Piece::Corrections(piece) => self.take_corrections(&piece),
            };
            if message.is_some() {
                return message;
            }
        }
    }

    fn dropped(&self) -> &Dropped {
        &self.reply.dropped
    }
}

impl NtripDecoder {
    fn take_corrections(&mut self, piece: &[u8]) -> Option<Message> {
        self.corrections.push(piece);
        let begins = matches!(self.state, State::Header { .. });
        self.state = match self.state {
            State::Chunk(left) if left == piece.len() => State::ChunkEnd,
            State::Chunk(left) => State::Chunk(left - piece.len()),
            _ => State::Corrections,
        };
        begins.then_some(Message::Accepted)
    }

    fn line(&mut self, line: &str) -> Option<Message> {
        let (state, message) = match self.state {
            State::StatusLine => match line.split_ascii_whitespace().collect::<Vec<_>>()[..] {
                ["ICY" | "HTTP/1.0" | "HTTP/1.1", "200", ..] => {
                    (State::Header { is_chunked: false }, None)
                }
                _ => (State::Ended, Some(Message::Refused(line.to_owned()))),
            },
            State::Header { is_chunked } => {
                let line = line.to_ascii_lowercase();
                match line
                    .split_once(':')
                    .map(|(name, value)| (name, value.trim()))
                {
                    Some(("content-type", "gnss/sourcetable")) => {
                        (State::Ended, Some(Message::Refused(line)))
                    }
                    Some(("transfer-encoding", "chunked")) => {
                        (State::Header { is_chunked: true }, None)
                    }
                    Some(_) => (self.state, None),
                    None if !line.is_empty() => (self.state, None),
                    None if is_chunked => (State::ChunkLength, Some(Message::Accepted)),
                    None => (State::Corrections, Some(Message::Accepted)),
                }
            }
            State::ChunkLength => {
                // Extensions follow a semicolon.
                let digits = line.split(';').next().unwrap_or_default().trim();
                match usize::from_str_radix(digits, 16) {
                    Ok(0) => (State::Ended, Some(Message::Ended)),
                    Ok(length) => (State::Chunk(length), None),
                    Err(_) => self.damaged(),
                }
            }
            State::ChunkEnd if line.is_empty() => (State::ChunkLength, None),
            _ => self.damaged(),
        };
        self.state = state;
        message
    }

    fn damaged(&mut self) -> (State, Option<Message>) {
        self.reply.dropped.add(DropReason::Field, 1);
        (State::Ended, Some(Message::Ended))
    }
}

fn front_of_rtcm(bytes: &[u8]) -> Front<Rtcm> {
    let garbage = before_mark(bytes, &[RTCM_MARK]);
    if garbage > 0 {
        return Front::Skip(DropReason::Garbage, garbage);
    }
    let Some(header) = bytes.first_chunk() else {
        return Front::Incomplete;
    };
    let Some(total) = total_length(*header) else {
        return Front::Skip(DropReason::Length, 1);
    };
    let received = &bytes[..bytes.len().min(total)];
    if let Some(at) = (1..received.len()).find(|at| is_rtcm(&received[*at..])) {
        return Front::Skip(DropReason::CutOff, at);
    }
    if received.len() < total {
        return Front::Incomplete;
    }
    if !is_rtcm(received) {
        return Front::Skip(DropReason::Checksum, 1);
    }
    match received[RTCM_HEADER..total - RTCM_CRC] {
        [first, second, ..] => {
            let rtcm = Rtcm {
                number: u16::from_be_bytes([first, second]) >> 4,
                frame: received.to_vec(),
            };
            Front::Message(rtcm, total)
        }
        // Filling.
        _ => Front::Blank(total),
    }
}

/// Length of a whole frame; `None` if one of the six reserved bits is set.
fn total_length([_, high, low]: [u8; RTCM_HEADER]) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([high, low]));
    (high & 0xFC == 0).then_some(RTCM_HEADER + length + RTCM_CRC)
}

/// Whether a frame with a right CRC is at the front.
fn is_rtcm(bytes: &[u8]) -> bool {
    let frame = || bytes.get(..total_length(*bytes.first_chunk()?)?);
    bytes.first() == Some(&RTCM_MARK) && frame().is_some_and(|frame| crc(frame) == 0)
}

/// CRC-24Q; 0 of a whole frame.
fn crc(bytes: &[u8]) -> u32 {
    let shift = |crc: u32, _bit| (crc << 1) ^ if crc & 0x80_0000 == 0 { 0 } else { 0x186_4CFB };
    let byte = |crc: u32, byte: &u8| (0..8).fold(crc ^ (u32::from(*byte) << 16), shift);
    bytes.iter().fold(0, byte)
}

#[cfg(test)]
mod tests;
