//! ROBOTIS Dynamixel X series, protocol 2.0.
//!
//! Written from the ROBOTIS e-Manual, `protocol2.md` and `x/xh430-w210.md`: FF FF FD 00, id, length,
//! instruction, parameters, CRC-16 (polynomial 8005).

use std::time::Duration;

use crate::{Device, take_request};

/// A servo.
#[derive(Debug)]
pub struct XSeries {
    /// Its number on the line.
    pub id: u8,
    /// Where it is; 2048 is the middle, 4096 a turn.
    pub position: i32,
    buffer: Vec<u8>,
}

impl Default for XSeries {
    fn default() -> Self {
        Self {
            id: 1,
            position: 2048,
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
    fn status(&self, parameters: &[u8]) -> Vec<u8> {
        let length = parameters.len() as u16 + 4;
        let mut packet = vec![0xFF, 0xFF, 0xFD, 0x00, self.id];
        packet.extend_from_slice(&length.to_le_bytes());
        packet.extend_from_slice(&[0x55, 0]);
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

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
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
                _ => {}
            }
        }
        replies
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
