//! An NTRIP caster of version 2.
//!
//! Written from RTCM 10410.1 as `gpsd/net_ntrip.c` of gpsd uses it (request, reply in chunks), and from
//! RTCM 10403 (frame, CRC-24Q) as RTKLIB's `rtkcmn.c` computes it.

use std::time::Duration;

use crate::{Device, Ticks};

/// A caster with one mountpoint.
#[derive(Debug)]
pub struct Caster {
    /// Its mountpoint.
    pub mountpoint: String,
    /// User and password in base 64, as the request has them.
    pub authorization: Option<String>,
    /// Lines that a host has sent after its request: positions.
    pub positions: Vec<String>,
    buffer: Vec<u8>,
    is_serving: bool,
    ticks: Ticks,
}

impl Caster {
    /// For everybody.
    pub fn new(mountpoint: &str) -> Self {
        Self {
            mountpoint: mountpoint.to_owned(),
            authorization: None,
            positions: Vec::new(),
            buffer: Vec::new(),
            is_serving: false,
            ticks: Ticks::default(),
        }
    }

    fn reply(&mut self, request: &str) -> Vec<u8> {
        let wanted = format!("GET /{} HTTP/1.1", self.mountpoint);
        let authorization = request
            .lines()
            .find_map(|line| line.strip_prefix("Authorization: Basic "));
        if self.authorization.as_deref() != authorization {
            return b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n".to_vec();
        }
        if !request.starts_with(&wanted) {
            let head = "HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\n";
            return format!("{head}STR;{};;;\r\nENDSOURCETABLE\r\n", self.mountpoint).into_bytes();
        }
        self.is_serving = true;
        b"HTTP/1.1 200 OK\r\nNtrip-Version: Ntrip/2.0\r\nTransfer-Encoding: chunked\r\n\
          Content-Type: gnss/data\r\n\r\n"
            .to_vec()
    }
}

/// A frame with message 1005 and a counter.
pub fn rtcm(counter: u8) -> Vec<u8> {
    let mut frame = vec![0xD3, 0, 6, 0x3E, 0xD0, 1, 2, 3, counter];
    let mut crc = 0_u32;
    for byte in &frame {
        crc ^= u32::from(*byte) << 16;
        for _ in 0..8 {
            crc <<= 1;
            if crc & 0x100_0000 != 0 {
                crc ^= 0x186_4CFB;
            }
        }
    }
    frame.extend_from_slice(&crc.to_be_bytes()[1..]);
    frame
}

impl Device for Caster {
    fn power_on(&mut self) -> Vec<u8> {
        self.ticks.restart();
        Vec::new()
    }

    fn connect(&mut self) {
        self.buffer.clear();
        self.is_serving = false;
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let text = String::from_utf8_lossy(&self.buffer).into_owned();
        if self.is_serving {
            let lines = text.split_inclusive("\r\n");
            for line in lines.filter(|line| line.ends_with("\r\n")) {
                self.positions.push(line.trim_end().to_owned());
                self.buffer.drain(..line.len());
            }
            return Vec::new();
        }
        let Some(end) = text.find("\r\n\r\n") else {
            return Vec::new();
        };
        self.buffer.drain(..end + 4);
        self.reply(&text)
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, Duration::from_millis(200));
        if !self.is_serving {
            return Vec::new();
        }
        due.map(|tick| {
            let frame = rtcm(tick as u8);
            let mut chunk = format!("{:X}\r\n", frame.len()).into_bytes();
            chunk.extend_from_slice(&frame);
            chunk.extend_from_slice(b"\r\n");
            chunk
        })
        .collect()
    }
}
