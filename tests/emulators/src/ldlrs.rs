//! SICK LD-LRS, user service protocol.
//!
//! Written from `SickLD.cc`, `SickLDMessage.cc` and `SickLDBufferMonitor.cc` of
//! ros-drivers/sicktoolbox at 0d0b846: no bytes of a device were at hand.

use std::time::Duration;

use crate::feed::Feed;
use crate::{Device, Ticks, take_request};

/// A scanner.
#[derive(Debug)]
pub struct LdLrs {
    /// Its serial number.
    pub serial_number: String,
    /// Its clock when power comes, ms of 16 bits.
    pub clock_start_ms: u16,
    /// Time that the motor needs.
    pub spin_up: Duration,
    mode: u8,
    rotates_since: Duration,
    is_sending: bool,
    buffer: Vec<u8>,
    ticks: Ticks,
    /// Distances, 1/256 m.
    feed: Feed<Vec<u16>>,
    /// Turns of it so far.
    fed: u64,
}

impl Default for LdLrs {
    fn default() -> Self {
        Self {
            serial_number: "08151234".to_owned(),
            clock_start_ms: 0,
            spin_up: Duration::from_millis(300),
            mode: IDLE,
            rotates_since: Duration::ZERO,
            is_sending: false,
            buffer: Vec::new(),
            ticks: Ticks::default(),
            feed: Feed::default(),
            fed: 0,
        }
    }
}

const IDLE: u8 = 1;
const ROTATE: u8 = 2;
const MEASURE: u8 = 3;
/// Five turns per second, 0.25°, a whole turn.
const PERIOD: Duration = Duration::from_millis(200);
const POINTS: u16 = 1440;
/// Directions, 1/16°.
const STEP: u16 = 4;
const TURN: u16 = 5760;
const ASTERN: u16 = 2880;

fn telegram(words: &[u16], text: &str) -> Vec<u8> {
    let mut payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
    if !text.is_empty() {
        payload.extend_from_slice(text.as_bytes());
        payload.push(0);
    }
    let mut telegram = b"\x02USP".to_vec();
    telegram.extend_from_slice(&(payload.len() as u32).to_be_bytes());
    let mut sum = 0;
    for byte in &payload {
        sum ^= byte;
    }
    telegram.extend_from_slice(&payload);
    telegram.push(sum);
    telegram
}

impl LdLrs {
    /// Distance of a beam in 1/256 m; 0 for none.
    pub fn distance(beam: u16, turn: u16) -> u16 {
        if beam % 100 == 99 {
            return 0;
        }
        2560 + beam + turn % 20
    }

    /// Gives it a turn from astern counter-clockwise whose first beam leaves at `at`: 1440 ranges. What is no range is 0,
    /// with or without an echo.
    pub fn feed(&mut self, at: Duration, ranges_m: &[f32]) {
        let distance = |range_m: &f32| match *range_m {
            range_m if range_m.is_finite() && range_m > 0.0 => (range_m * 256.0).round() as u16,
            _ => 0,
        };
        self.feed.push(at, ranges_m.iter().map(distance).collect());
    }

    /// It sends turns.
    pub fn is_sending(&self) -> bool {
        self.is_sending && self.mode == MEASURE
    }

    fn reply(&mut self, words: &[u16], uptime: Duration) -> Vec<u8> {
        let state = |this: &Self| u16::from(this.mode);
        match words {
            [0x0101, 3] => telegram(&[0x8101], &self.serial_number),
            [0x0102] => telegram(&[0x8102, 0, state(self), 0, 0, 0], ""),
            [0x0402] => {
                self.mode = IDLE;
                telegram(&[0x8402, 0, state(self)], "")
            }
            [0x0403, 0] => {
                if self.mode != ROTATE {
                    self.rotates_since = uptime;
                }
                self.mode = ROTATE;
                telegram(&[0x8403, 0, state(self)], "")
            }
            [0x0404] => {
                if self.mode == ROTATE && uptime.saturating_sub(self.rotates_since) >= self.spin_up
                {
                    self.mode = MEASURE;
                }
                telegram(&[0x8404, 0, state(self), 0], "")
            }
            [0x0301, 0, 0x39FF] if self.mode == MEASURE => {
                self.is_sending = true;
                telegram(&[0x8301, 0x39FF], "")
            }
            [0x0302] => {
                self.is_sending = false;
                telegram(&[0x8302, 0], "")
            }
            _ => Vec::new(),
        }
    }

    fn turn(&self, turn: u16, at: Duration, first: u16, distances: &[u16]) -> Vec<u8> {
        let start_ms = self.clock_start_ms.wrapping_add(at.as_millis() as u16);
        let last = (first + STEP * (POINTS - 1)) % TURN;
        let mut words = vec![0x8301, 0x39FF, 1, turn, turn, 0];
        words.extend_from_slice(&[0, STEP, POINTS, start_ms, first]);
        words.extend_from_slice(distances);
        words.extend_from_slice(&[start_ms.wrapping_add(200), last, 0, u16::from(self.mode)]);
        telegram(&words, "")
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.windows(4).position(|mark| mark == b"\x02USP")?;
    let rest = &bytes[start..];
    let length = usize::from(*rest.get(7)?) + 9;
    (rest.len() >= length).then_some((start, length))
}

impl Device for LdLrs {
    fn power_on(&mut self) -> Vec<u8> {
        self.mode = IDLE;
        self.is_sending = false;
        self.buffer.clear();
        self.ticks.restart();
        Vec::new()
    }

    fn connect(&mut self) {
        self.buffer.clear();
        self.is_sending = false;
    }

    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(request) = take_request(&mut self.buffer, find) {
            let payload = &request[8..request.len() - 1];
            let words = payload.chunks_exact(2);
            let words: Vec<u16> = words
                .map(|word| u16::from_be_bytes([word[0], word[1]]))
                .collect();
            replies.extend(self.reply(&words, uptime));
        }
        replies
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, PERIOD);
        let fed = self.feed.take_until(uptime.saturating_sub(PERIOD));
        if !self.is_sending() {
            return Vec::new();
        }
        let Some(fed) = fed else {
            let turn = |turn: u64| {
                let distances = (0..POINTS).map(|beam| Self::distance(beam, turn as u16));
                let distances: Vec<u16> = distances.collect();
                self.turn(turn as u16, PERIOD * turn as u32, 0, &distances)
            };
            return due.map(turn).collect();
        };
        let first = self.fed;
        self.fed += fed.len() as u64;
        let turns = fed.into_iter().zip(first..);
        turns
            .map(|((at, distances), turn)| self.turn(turn as u16, at, ASTERN, &distances))
            .collect()
    }
}
