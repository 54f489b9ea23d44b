//! Hokuyo UST-10LX, SCIP 2.2 on TCP.
//!
//! Written from the Communication Protocol Specification for SCIP2.0 (C-42-03320B): a reply is the
//! request, a status, lines of data and an empty line; each line ends with the sum of its bytes, six
//! bits and 0x30. The parameters are those that a UTM-30LX-EW replies, as a comment of the April Robotics
//! tool kit has them, with the turns of a UST.

use std::time::Duration;

use crate::{Device, Ticks, take_request};

/// A scanner.
#[derive(Debug)]
pub struct Hokuyo {
    /// Its serial number.
    pub serial_number: String,
    /// Its clock when power comes, ms of 24 bits.
    pub clock_start_ms: u32,
    /// The laser is faulty.
    pub is_faulty: bool,
    /// The request that it serves.
    measuring: Option<String>,
    buffer: Vec<u8>,
    ticks: Ticks,
}

/// Turns.
const PERIOD: Duration = Duration::from_millis(25);
const STEPS: usize = 1081;

impl Default for Hokuyo {
    fn default() -> Self {
        Self {
            serial_number: "H1234567".to_owned(),
            clock_start_ms: 0,
            is_faulty: false,
            measuring: None,
            buffer: Vec::new(),
            ticks: Ticks::default(),
        }
    }
}

fn sum(text: &str) -> char {
    let sum: u32 = text.bytes().map(u32::from).sum();
    char::from(((sum & 0x3F) + 0x30) as u8)
}

/// Six bits in each character.
fn encode(number: u32, characters: u32) -> String {
    let character =
        |at: u32| char::from(((number >> (6 * (characters - 1 - at)) & 0x3F) + 0x30) as u8);
    (0..characters).map(character).collect()
}

fn status(request: &str, status: &str) -> String {
    format!("{request}\n{status}{}\n\n", sum(status))
}

fn texts(request: &str, lines: &[String]) -> String {
    let lines: Vec<String> = lines
        .iter()
        .map(|line| format!("{line};{}\n", sum(line)))
        .collect();
    format!("{request}\n00P\n{}\n", lines.concat())
}

impl Hokuyo {
    /// Distance of a step, mm; an error code for each 100th.
    pub fn distance_mm(step: usize, turn: u64) -> u32 {
        if step % 100 == 99 {
            return 8;
        }
        2000 + step as u32 + (turn % 50) as u32
    }

    fn reply(&mut self, request: &str) -> String {
        let owned = |lines: &[&str]| {
            lines
                .iter()
                .map(|line| (*line).to_owned())
                .collect::<Vec<_>>()
        };
        match request {
            // Only SCIP 2: an unknown command.
            "SCIP2.0" => status(request, "0E"),
            "QT" => {
                self.measuring = None;
                status(request, "00")
            }
            "BM" => status(request, if self.is_faulty { "01" } else { "00" }),
            "VV" => {
                let mut lines = owned(&[
                    "VEND:Hokuyo Automatic Co.,Ltd.",
                    "PROD:UST-10LX",
                    "FIRM:1.1.0",
                    "PROT:SCIP 2.2",
                ]);
                lines.push(format!("SERI:{}", self.serial_number));
                texts(request, &lines)
            }
            "PP" => texts(
                request,
                &owned(&[
                    "MODL:UST-10LX",
                    "DMIN:20",
                    "DMAX:30000",
                    "ARES:1440",
                    "AMIN:0",
                    "AMAX:1080",
                    "AFRT:540",
                    "SCAN:2400",
                ]),
            ),
            "MD0000108001000" => {
                self.measuring = Some(request.to_owned());
                status(request, "00")
            }
            _ => status(request, "0D"),
        }
    }

    fn scan(request: &str, turn: u64, time_ms: u32) -> Vec<u8> {
        let distances: String = (0..STEPS)
            .map(|step| encode(Self::distance_mm(step, turn), 3))
            .collect();
        let time = encode(time_ms & 0xFF_FFFF, 4);
        let blocks = distances.as_bytes().chunks(64).map(String::from_utf8_lossy);
        let blocks: Vec<String> = blocks
            .map(|block| format!("{block}{}\n", sum(&block)))
            .collect();
        let head = format!("{request}\n99b\n{time}{}\n", sum(&time));
        (head + &blocks.concat() + "\n").into_bytes()
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let end = bytes.iter().position(|byte| *byte == b'\n')?;
    Some((0, end + 1))
}

impl Device for Hokuyo {
    fn power_on(&mut self) -> Vec<u8> {
        self.measuring = None;
        self.buffer.clear();
        self.ticks.restart();
        Vec::new()
    }

    fn connect(&mut self) {
        self.buffer.clear();
        self.measuring = None;
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = String::new();
        while let Some(request) = take_request(&mut self.buffer, find) {
            let request = String::from_utf8_lossy(&request).trim_end().to_owned();
            replies += &self.reply(&request);
        }
        replies.into_bytes()
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, PERIOD);
        let Some(request) = &self.measuring else {
            return Vec::new();
        };
        let scan = |turn: u64| {
            let started = PERIOD * turn as u32;
            let time_ms = self.clock_start_ms.wrapping_add(started.as_millis() as u32);
            Self::scan(request, turn, time_ms)
        };
        due.map(scan).collect()
    }
}
