//! Slamtec RPLIDAR A1.
//!
//! Written from Slamtec's "Interface protocol and application notes" (LR001), as the answers of
//! cnwzhjs/rplidar.rs and `lidarprotocol.h` of StevePunak/RPLidarQt repeat it: requests A5 and a command;
//! replies A5 5A, length (30 bits), mode (2 bits), type; single nodes of 5 bytes.

use std::time::Duration;

use crate::{Device, Ticks};

/// A scanner.
#[derive(Debug)]
pub struct Rplidar {
    /// Its serial number.
    pub serial_number: [u8; 16],
    /// 0 good, 2 faulty.
    pub health: u8,
    is_scanning: bool,
    buffer: Vec<u8>,
    ticks: Ticks,
}

impl Default for Rplidar {
    fn default() -> Self {
        Self {
            serial_number: *b"0123456789ABCDEF",
            health: 0,
            is_scanning: false,
            buffer: Vec::new(),
            ticks: Ticks::default(),
        }
    }
}

/// 2000 samples per second, 400 in a turn.
const SAMPLE: Duration = Duration::from_micros(500);
const SAMPLES: u64 = 400;

fn descriptor(length: u32, repeats: bool, kind: u8) -> Vec<u8> {
    let word = length | u32::from(repeats) << 30;
    let mut bytes = vec![0xA5, 0x5A];
    bytes.extend_from_slice(&word.to_le_bytes());
    bytes.push(kind);
    bytes
}

impl Rplidar {
    /// Distance of a sample of a turn, mm.
    pub fn distance_mm(sample: u64) -> u16 {
        1000 + sample as u16
    }

    fn node(sample: u64) -> [u8; 5] {
        let in_turn = sample % SAMPLES;
        let start = u8::from(in_turn == 0);
        let angle_q6 = (in_turn * 360 * 64 / SAMPLES) as u16;
        let [angle_low, angle_high] = (angle_q6 << 1 | 1).to_le_bytes();
        let [distance_low, distance_high] = (Self::distance_mm(in_turn) * 4).to_le_bytes();
        let quality = 40 << 2 | (1 - start) << 1 | start;
        [quality, angle_low, angle_high, distance_low, distance_high]
    }

    fn reply(&mut self, command: u8) -> Vec<u8> {
        match command {
            0x25 => {
                self.is_scanning = false;
                Vec::new()
            }
            0x50 => {
                let mut reply = descriptor(20, false, 0x04);
                reply.extend_from_slice(&[0x18, 29, 1, 7]);
                reply.extend_from_slice(&self.serial_number);
                reply
            }
            0x52 => {
                let mut reply = descriptor(3, false, 0x06);
                reply.extend_from_slice(&[self.health, 0, 0]);
                reply
            }
            0x59 => {
                let mut reply = descriptor(4, false, 0x15);
                reply.extend_from_slice(&[0xF4, 1, 0xFA, 0]); // 500 µs, 250 µs.
                reply
            }
            0x20 if self.health != 2 => {
                self.is_scanning = true;
                descriptor(5, true, 0x81)
            }
            _ => Vec::new(),
        }
    }
}

impl Device for Rplidar {
    fn power_on(&mut self) -> Vec<u8> {
        self.is_scanning = false;
        self.buffer.clear();
        self.ticks.restart();
        b"RP LIDAR System.\r\n".to_vec()
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(start) = self.buffer.iter().position(|byte| *byte == 0xA5) {
            let rest = &self.buffer[start..];
            // Commands from 0x80 on have a payload and a sum.
            let length = match rest {
                [_, command, ..] if *command < 0x80 => 2,
                [_, _, length, ..] => usize::from(*length) + 4,
                _ => break,
            };
            if rest.len() < length {
                break;
            }
            let command = rest[1];
            self.buffer.drain(..start + length);
            replies.extend(self.reply(command));
        }
        replies
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, SAMPLE);
        if !self.is_scanning {
            return Vec::new();
        }
        due.map(|sample| Self::node(sample).to_vec()).collect()
    }
}
