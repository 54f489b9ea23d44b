//! A Livox Mid-360 in the middle of a round room.
//!
//! Written from Livox's "Livox `LiDAR` Communication Protocol Mid-360", version 1.4.10.

use std::collections::BTreeSet;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

use crate::{Device, Ticks};

/// Points of a packet.
pub const POINTS: u32 = 96;
/// Radius of the room, millimetres.
pub const RADIUS_MM: f64 = 5000.0;
/// A packet each 2 ms: fewer than a real one has, so that a slow machine follows.
const PERIOD: Duration = Duration::from_millis(2);
/// Packets of a frame of 0.1 s, after which they are numbered from 0 again.
pub const FRAME: u64 = 50;

/// Its points.
#[derive(Debug, Default)]
pub struct Points {
    /// Packets that are not sent, counted from power-on.
    pub lost: BTreeSet<u64>,
    /// Packets with a wrong bit.
    pub damaged: BTreeSet<u64>,
    ticks: Ticks,
    sent: u64,
}

impl Points {
    /// Packets sent or lost since power-on.
    pub fn sent(&self) -> u64 {
        self.sent
    }

    /// A point of the wall, 1 m above the sensor, millimetres; every tenth hits nothing.
    pub fn point_mm(point: u32) -> [i32; 3] {
        if point % 10 == 9 {
            return [0; 3];
        }
        let turn = f64::from(point) / f64::from(POINTS) * std::f64::consts::TAU;
        #[expect(
            clippy::disallowed_methods,
            reason = "the emulator's own; it is compared in millimetres"
        )]
        let (sin, cos) = turn.sin_cos();
        [
            (RADIUS_MM * cos).round() as i32,
            (RADIUS_MM * sin).round() as i32,
            1000,
        ]
    }

    fn packet(number: u64) -> Vec<u8> {
        let mut data = Vec::new();
        for point in 0..POINTS {
            data.extend(Self::point_mm(point).iter().flat_map(|mm| mm.to_le_bytes()));
            data.extend([50, 0]);
        }
        let time_ns = (number * PERIOD.as_nanos() as u64).to_le_bytes();
        let checked = [&time_ns[..], &data].concat();
        let mut packet = vec![0];
        packet.extend((36 + data.len() as u16).to_le_bytes());
        // 1.9 ms from the first point to the last.
        packet.extend(19_000_u16.to_le_bytes());
        packet.extend((POINTS as u16).to_le_bytes());
        packet.extend(((number % FRAME) as u16).to_le_bytes());
        packet.extend([(number / FRAME) as u8, 1, 0]);
        packet.extend([0; 12]);
        packet.extend(crc32(&checked).to_le_bytes());
        packet.extend(checked);
        packet
    }
}

impl Device for Points {
    fn power_on(&mut self) -> Vec<u8> {
        self.ticks.restart();
        self.sent = 0;
        Vec::new()
    }

    fn receive(&mut self, _bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        Vec::new()
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, PERIOD);
        self.sent = due.end;
        let due = due.filter(|number| !self.lost.contains(number));
        let packets = due.map(|number| {
            let mut packet = Self::packet(number);
            if self.damaged.contains(&number) {
                packet[100] ^= 1;
            }
            packet
        });
        packets.collect()
    }
}

/// Its port for commands.
#[derive(Debug, Default)]
pub struct Commands {
    /// The host that it is configured to send points to.
    pub host: Option<SocketAddrV4>,
    /// The work mode that it is configured to have: 1 is measuring.
    pub work_mode: Option<u8>,
    /// What it replies: 0 is success.
    pub code: u8,
}

impl Device for Commands {
    fn power_on(&mut self) -> Vec<u8> {
        (self.host, self.work_mode) = (None, None);
        Vec::new()
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        let half = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let is_request = bytes.len() > 28
            && bytes[..2] == [0xAA, 0]
            && usize::from(half(2)) == bytes.len()
            && half(8) == 0x0100
            && bytes[10..12] == [0, 0]
            && half(18) == crc16(&bytes[..18])
            && bytes[20..24] == crc32(&bytes[24..]).to_le_bytes();
        if !is_request {
            return Vec::new();
        }
        let (mut at, mut unknown) = (28, 0);
        for _ in 0..half(24) {
            let (key, length) = (half(at), usize::from(half(at + 2)));
            let value = &bytes[at + 4..at + 4 + length];
            match (key, value) {
                (0x0006, &[a, b, c, d, low, high, ..]) => {
                    let port = u16::from_le_bytes([low, high]);
                    self.host = Some(SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), port));
                }
                (0x001A, &[mode]) => self.work_mode = Some(mode),
                _ => unknown = key,
            }
            at += 4 + length;
        }
        let mut data = vec![if unknown == 0 { self.code } else { 0x20 }];
        data.extend(unknown.to_le_bytes());
        let mut reply = bytes[..18].to_vec();
        reply[2..4].copy_from_slice(&(24 + data.len() as u16).to_le_bytes());
        reply[10..12].fill(1);
        reply.extend(crc16(&reply).to_le_bytes());
        reply.extend(crc32(&data).to_le_bytes());
        reply.extend(data);
        reply
    }

    fn run(&mut self, _uptime: Duration) -> Vec<Vec<u8>> {
        Vec::new()
    }
}

/// Polynomial 0x1021 from 0xFFFF on.
fn crc16(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF_u16;
    for byte in bytes {
        crc ^= u16::from(*byte) << 8;
        for _ in 0..8 {
            let carry = crc & 0x8000 != 0;
            crc <<= 1;
            if carry {
                crc ^= 0x1021;
            }
        }
    }
    crc
}

/// As of Ethernet.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            let carry = crc & 1 != 0;
            crc >>= 1;
            if carry {
                crc ^= 0xEDB8_8320;
            }
        }
    }
    !crc
}
