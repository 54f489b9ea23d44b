//! Three-dimensional lidars that send the packets of a recording, over and over, each at its time.
//!
//! What differs from one round to the next, so that the sensor's clock and numbers go on, is written from Velodyne's "VLP-16 User
//! Manual", 63-9243 Rev. E, chapter 9, and from Ouster's "Software User Manual" 2.3.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::time::Duration;

use rusqlite::{Connection, OpenFlags};

use crate::Device;

/// What a round changes in a packet.
#[derive(Clone, Copy, Debug)]
enum Layout {
    /// Microseconds of the hour.
    Velodyne,
    /// The frame, and nanoseconds of each of 16 columns of so many bytes.
    Ouster { column: usize },
}

/// A lidar. It sends nothing when the power comes before its first packet is due.
#[derive(Clone, Debug)]
pub struct Packets {
    /// Packets that are not sent, counted from power-on.
    pub lost: BTreeSet<usize>,
    /// Packets whose first two bytes are wrong and, of an Ouster, whose columns have impossible numbers.
    pub damaged: BTreeSet<usize>,
    /// Rounds; then it falls silent.
    pub rounds: usize,
    layout: Layout,
    /// With the time of each since the first.
    packets: Vec<(Duration, Vec<u8>)>,
    round: Duration,
    frames: u16,
    next: usize,
}

impl Packets {
    /// The VLP-16 of `vlp16_packets.db3`: four messages of 0.1 s.
    ///
    /// # Panics
    /// If the file is not as expected.
    pub fn of_velodyne(path: &Path) -> Self {
        const PACKET: usize = 1206;
        let file = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY);
        let file = file.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let query = file.prepare("SELECT data FROM messages ORDER BY id");
        let mut query = query.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let messages = query.query_map([], |row| row.get::<_, Vec<u8>>(0));
        let messages = messages.into_iter().flatten().flatten();
        let mut packets = Vec::new();
        for message in messages {
            let mut at = 0;
            let marks = |from: usize| {
                message[from..]
                    .windows(2)
                    .position(|bytes| bytes == [0xFF, 0xEE])
            };
            while let Some(mark) = marks(at)
                && let Some(packet) = message.get(at + mark..at + mark + PACKET)
            {
                packets.push(packet.to_vec());
                at += mark + PACKET;
            }
        }
        let micros = |packet: &[u8]| u64::from(word(packet, 1200));
        let first = micros(&packets[0]);
        let packets: Vec<_> = packets
            .into_iter()
            .map(|packet| (Duration::from_micros(micros(&packet) - first), packet))
            .collect();
        Self::new(Layout::Velodyne, packets, Duration::from_micros(664), 0)
    }

    /// The Ouster of a capture without fragments, which has so many frames of 0.1 s, with columns of so many bytes.
    ///
    /// # Panics
    /// If the file is not as expected.
    pub fn of_ouster(path: &Path, frames: u16, column: usize) -> Self {
        const HEADERS: usize = 14 + 20 + 8;
        let bytes = fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let mut packets = Vec::new();
        let mut rest = &bytes[24..];
        while let Some((record, after)) = rest.split_at_checked(16) {
            let (frame, after) = after.split_at(word(record, 8) as usize);
            let seconds = Duration::from_secs(word(record, 0).into());
            let at = seconds + Duration::from_micros(word(record, 4).into());
            // Of port 7502.
            if frame[36..38] == [0x1D, 0x4E] {
                packets.push((at, frame[HEADERS..].to_vec()));
            }
            rest = after;
        }
        let first = packets[0].0;
        for (at, _) in &mut packets {
            *at -= first;
        }
        let last = packets.last().map_or(Duration::ZERO, |(at, _)| *at);
        let rest = (Duration::from_millis(100) * frames.into()).saturating_sub(last);
        Self::new(Layout::Ouster { column }, packets, rest, frames)
    }

    /// `rest`: from the last packet to the first of the next round.
    fn new(layout: Layout, packets: Vec<(Duration, Vec<u8>)>, rest: Duration, frames: u16) -> Self {
        let last = packets.last().map_or(Duration::ZERO, |(at, _)| *at);
        Self {
            lost: BTreeSet::new(),
            damaged: BTreeSet::new(),
            rounds: usize::MAX,
            layout,
            packets,
            round: last + rest,
            frames,
            next: 0,
        }
    }

    /// How many were sent or lost since power-on.
    pub fn sent(&self) -> usize {
        self.next
    }

    /// A packet, counted from power-on, and its time.
    pub fn packet(&self, number: usize) -> (Duration, Vec<u8>) {
        let (round, at) = (number / self.packets.len(), number % self.packets.len());
        let (time, mut packet) = self.packets[at].clone();
        let later = self.round * round as u32;
        match self.layout {
            Layout::Velodyne => {
                let micros = u64::from(word(&packet, 1200)) + later.as_micros() as u64;
                packet[1200..1204]
                    .copy_from_slice(&((micros % 3_600_000_000) as u32).to_le_bytes());
            }
            Layout::Ouster { column } => {
                let frame = u16::from_le_bytes([packet[2], packet[3]]);
                let frame = frame.wrapping_add(self.frames.wrapping_mul(round as u16));
                packet[2..4].copy_from_slice(&frame.to_le_bytes());
                let end = packet.len() - 32;
                for column in packet[32..end].chunks_exact_mut(column) {
                    let mut nanos = [0; 8];
                    nanos.copy_from_slice(&column[..8]);
                    let nanos = u64::from_le_bytes(nanos) + later.as_nanos() as u64;
                    column[..8].copy_from_slice(&nanos.to_le_bytes());
                    if self.damaged.contains(&number) {
                        column[8..10].fill(0xFF);
                    }
                }
            }
        }
        if self.damaged.contains(&number) {
            packet[..2].fill(0);
        }
        (later + time, packet)
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

impl Device for Packets {
    fn power_on(&mut self) -> Vec<u8> {
        self.next = 0;
        Vec::new()
    }

    fn receive(&mut self, _bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        Vec::new()
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let mut due = Vec::new();
        while self.next / self.packets.len() < self.rounds {
            let (at, packet) = self.packet(self.next);
            if at > uptime {
                break;
            }
            if !self.lost.contains(&self.next) {
                due.push(packet);
            }
            self.next += 1;
        }
        due
    }
}

/// The page of an Ouster with its metadata, in HTTP 1.0 or 1.1.
#[derive(Debug)]
pub struct Metadata {
    /// What it replies; `None`, that there is no such page.
    pub metadata: Option<String>,
    /// How often it was asked.
    pub requests: usize,
    buffer: Vec<u8>,
    has_replied: bool,
}

impl Metadata {
    /// With this text.
    pub fn new(metadata: String) -> Self {
        Self {
            metadata: Some(metadata),
            requests: 0,
            buffer: Vec::new(),
            has_replied: false,
        }
    }
}

impl Device for Metadata {
    fn connect(&mut self) {
        self.buffer.clear();
        self.has_replied = false;
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let request = String::from_utf8_lossy(&self.buffer);
        if !request.ends_with("\r\n\r\n") {
            return Vec::new();
        }
        self.has_replied = true;
        self.requests += 1;
        let is_known = request.starts_with("GET /api/v1/sensor/metadata HTTP/1.");
        let (status, body) = match &self.metadata {
            Some(metadata) if is_known => ("200 OK", metadata.as_str()),
            _ => ("404 Not Found", ""),
        };
        let length = body.len();
        format!("HTTP/1.1 {status}\r\nContent-Type: application/json\r\nContent-Length: {length}\r\n\r\n{body}")
            .into_bytes()
    }

    fn hangs_up(&mut self) -> bool {
        std::mem::take(&mut self.has_replied)
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}
