//! Blue Robotics `Ping1D` echo sounder.
//!
//! Written from the README and the definitions of bluerobotics/ping-protocol (`common.json`,
//! `ping1d.json`): `BR`, length, message, source, destination, payload, sum; little-endian.

use std::time::Duration;

use crate::{Device, take_request};

/// A sounder.
#[derive(Debug)]
pub struct Ping1d {
    /// 1; 2 is a Ping360.
    pub device_type: u8,
    /// What a host set, mm/s.
    pub sound_speed_mmps: u32,
    /// Measurements so far.
    pub pings: u32,
    /// Sums are wrong.
    pub has_wrong_sums: bool,
    buffer: Vec<u8>,
}

impl Default for Ping1d {
    fn default() -> Self {
        Self {
            device_type: 1,
            sound_speed_mmps: 1_500_000,
            pings: 0,
            has_wrong_sums: false,
            buffer: Vec::new(),
        }
    }
}

impl Ping1d {
    /// The distance of a measurement, mm.
    pub fn distance_mm(ping: u32) -> u32 {
        2500 + ping % 100
    }

    fn message(&self, id: u16, payload: &[u8]) -> Vec<u8> {
        let mut message = b"BR".to_vec();
        message.extend_from_slice(&(payload.len() as u16).to_le_bytes());
        message.extend_from_slice(&id.to_le_bytes());
        message.extend_from_slice(&[1, 0]);
        message.extend_from_slice(payload);
        let sum = message.iter().map(|byte| u16::from(*byte)).sum::<u16>();
        let sum = sum + u16::from(self.has_wrong_sums);
        message.extend_from_slice(&sum.to_le_bytes());
        message
    }

    fn reply(&mut self, request: &[u8]) -> Vec<u8> {
        let word = |at: usize| u16::from_le_bytes([request[at], request[at + 1]]);
        match (word(4), request.len()) {
            (6, 12) => match word(8) {
                4 => self.message(4, &[self.device_type, 1, 3, 29, 0, 0]),
                1212 => {
                    self.pings += 1;
                    let mut payload = Self::distance_mm(self.pings).to_le_bytes().to_vec();
                    payload.extend_from_slice(&95_u16.to_le_bytes()); // Confidence.
                    payload.extend_from_slice(&300_u16.to_le_bytes()); // Pulse, µs.
                    for number in [self.pings, 200, 30_000, 3] {
                        payload.extend_from_slice(&number.to_le_bytes());
                    }
                    self.message(1212, &payload)
                }
                _ => self.message(2, &[&request[8..10], b"unknown\0"].concat()),
            },
            (1002, 14) => {
                self.sound_speed_mmps = u32::from(word(8)) | u32::from(word(10)) << 16;
                self.message(1, &request[4..6])
            }
            _ => Vec::new(),
        }
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.windows(2).position(|pair| pair == b"BR")?;
    let rest = &bytes[start..];
    let length = usize::from(*rest.get(2)?) + 10;
    (rest.len() >= length).then_some((start, length))
}

impl Device for Ping1d {
    fn power_on(&mut self) -> Vec<u8> {
        self.sound_speed_mmps = 1_500_000;
        self.pings = 0;
        self.buffer.clear();
        Vec::new()
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(request) = take_request(&mut self.buffer, find) {
            replies.extend(self.reply(&request));
        }
        replies
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
