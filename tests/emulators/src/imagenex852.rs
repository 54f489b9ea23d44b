//! Imagenex 852 echo sounder.
//!
//! Written from the Model 852 Serial Interface Specification v1.04 as `src/Sensors/Imagenex852/Task.cpp`
//! of LSTS/dune and the recording of CIDCO's Poseidon (`hydroball.852`) show it: a switch command of 27
//! bytes, FE 44 to FD; a reply of 12 bytes, the echo, and FC.

use std::time::Duration;

use crate::{Device, take_request};

/// A sounder.
#[derive(Debug, Default)]
pub struct Imagenex852 {
    /// Shots so far.
    pub shots: u16,
    /// It hears no echo.
    pub has_no_echo: bool,
    buffer: Vec<u8>,
}

impl Imagenex852 {
    /// The range of a shot in cm, at 1500 m/s.
    pub fn range_cm(shot: u16) -> u16 {
        300 + shot % 100
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.windows(2).position(|pair| pair == [0xFE, 0x44])?;
    let end = bytes[start..].iter().position(|byte| *byte == 0xFD)?;
    Some((start, end + 1))
}

impl Device for Imagenex852 {
    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        while let Some(command) = take_request(&mut self.buffer, find) {
            if command.len() != 27 || command[2] != 0x11 {
                continue;
            }
            self.shots = self.shots.wrapping_add(1);
            let range = if self.has_no_echo {
                0
            } else {
                Self::range_cm(self.shots)
            };
            // Seven bits in each byte; bit 6 of the status: the switches are accepted.
            let low = (range & 0x7F) as u8;
            let high = (range >> 7) as u8;
            replies.extend_from_slice(b"IPX");
            replies.extend_from_slice(&[0x11, 0x40, 0, 0, command[3], low, high, 0, 0, 0xFC]);
        }
        replies
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
