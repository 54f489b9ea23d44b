//! ROBOTIS Dynamixel X series, protocol 2.0.
//!
//! Written from the ROBOTIS e-Manual, `protocol2.md` and `x/xh430-w210.md`: FF FF FD 00, id, length,
//! instruction, parameters, CRC-16 (polynomial 8005).

use std::f64::consts::TAU;
use std::time::Duration;

use crate::{Device, take_request};

/// A servo.
pub struct XSeries {
    /// Its number on the line.
    pub id: u8,
    /// Where it is; 2048 is the middle, 4096 a turn.
    pub position: i32,
    /// Where it is at an uptime, radians from the middle; then [`Self::position`] does not matter.
    pub angle_rad: Option<Box<dyn Fn(Duration) -> f64 + Send>>,
    /// What its status packets say is wrong: 0x80 is a hardware error.
    pub error: u8,
    /// Goals that it was given.
    pub goals: Vec<i32>,
    has_torque: bool,
    /// Units of 0.229 turns per minute.
    profile_velocity: u32,
    /// Where it was when it got its last goal, and when.
    began: (i32, Duration),
    buffer: Vec<u8>,
}

impl Default for XSeries {
    fn default() -> Self {
        Self {
            id: 1,
            position: 2048,
            angle_rad: None,
            error: 0,
            goals: Vec::new(),
            has_torque: false,
            profile_velocity: 0,
            began: (2048, Duration::ZERO),
            buffer: Vec::new(),
        }
    }
}

fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0_u16;
    for byte in bytes {
        crc ^= u16::from(*byte) << 8;
        for _ in 0..8 {
            let carry = crc & 0x8000 != 0;
            crc <<= 1;
            if carry {
                crc ^= 0x8005;
            }
        }
    }
    crc
}

impl XSeries {
    /// Turns towards its goal.
    fn turn(&mut self, uptime: Duration) {
        if let Some(angle_rad) = &self.angle_rad {
            self.position = 2048 + (angle_rad(uptime) * 4096.0 / TAU).round() as i32;
        } else if let Some(goal) = self.goals.last().filter(|_| self.has_torque) {
            let (from, since) = self.began;
            let turns_per_s = f64::from(self.profile_velocity) * 0.229 / 60.0;
            let steps = uptime.saturating_sub(since).as_secs_f64() * turns_per_s * 4096.0;
            let way = f64::from(goal - from).clamp(-steps, steps);
            self.position = from + way as i32;
        }
    }

    fn status(&self, parameters: &[u8]) -> Vec<u8> {
        let length = parameters.len() as u16 + 4;
        let mut packet = vec![0xFF, 0xFF, 0xFD, 0x00, self.id];
        packet.extend_from_slice(&length.to_le_bytes());
        packet.extend_from_slice(&[0x55, self.error]);
        packet.extend_from_slice(parameters);
        let crc = crc(&packet);
        packet.extend_from_slice(&crc.to_le_bytes());
        packet
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let mark = [0xFF, 0xFF, 0xFD, 0x00];
    let start = bytes.windows(4).position(|bytes| bytes == mark)?;
    let rest = &bytes[start..];
    let length = usize::from(*rest.get(5)?) + 256 * usize::from(*rest.get(6)?) + 7;
    (rest.len() >= length).then_some((start, length))
}

impl Device for XSeries {
    fn power_on(&mut self) -> Vec<u8> {
        self.buffer.clear();
        Vec::new()
    }

    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8> {
        self.turn(uptime);
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(packet) = take_request(&mut self.buffer, find) {
            let (content, sum) = packet.split_at(packet.len() - 2);
            if crc(content).to_le_bytes() != sum || content[4] != self.id {
                continue;
            }
            match &content[7..] {
                // Ping: model 1020, firmware 45.
                [0x01] => replies.extend(self.status(&[0xFC, 0x03, 45])),
                // Read 4 bytes at 132: present position.
                [0x02, 132, 0, 4, 0] => replies.extend(self.status(&self.position.to_le_bytes())),
                // Write: torque, profile velocity, goal position.
                [0x03, 64, 0, torque] => {
                    self.has_torque = *torque == 1;
                    replies.extend(self.status(&[]));
                }
                [0x03, 112, 0, a, b, c, d] => {
                    self.profile_velocity = u32::from_le_bytes([*a, *b, *c, *d]);
                    replies.extend(self.status(&[]));
                }
                [0x03, 116, 0, a, b, c, d] => {
                    self.goals.push(i32::from_le_bytes([*a, *b, *c, *d]));
                    self.began = (self.position, uptime);
                    replies.extend(self.status(&[]));
                }
                _ => {}
            }
        }
        replies
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
