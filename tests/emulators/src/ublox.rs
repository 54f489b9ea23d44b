//! u-blox ZED-F9P, UBX.
//!
//! Written from the ZED-F9P Interface Description (UBX-18010854), sections "UBX frame structure",
//! UBX-ACK, UBX-CFG-VALSET and UBX-NAV-PVT.

use std::time::Duration;

use crate::{Device, Ticks, take_request};

/// A receiver on its UART1. Without a configuration it sends nothing.
#[derive(Debug, Default)]
pub struct Ublox {
    /// It refuses settings.
    pub refuses: bool,
    /// What came besides UBX: corrections.
    pub corrections: Vec<u8>,
    period: Option<Duration>,
    sends_pvt: bool,
    buffer: Vec<u8>,
    ticks: Ticks,
}

const PVT_ON_UART1: u32 = 0x2091_0007;
const MEASUREMENT_PERIOD: u32 = 0x3021_0001;

fn frame(class: u8, id: u8, payload: &[u8]) -> Vec<u8> {
    let mut body = vec![class, id];
    body.extend_from_slice(&(payload.len() as u16).to_le_bytes());
    body.extend_from_slice(payload);
    let (mut a, mut b) = (0_u8, 0_u8);
    for byte in &body {
        a = a.wrapping_add(*byte);
        b = b.wrapping_add(a);
    }
    [&[0xB5, 0x62][..], &body, &[a, b]].concat()
}

impl Ublox {
    fn set(&mut self, mut items: &[u8], uptime: Duration) {
        while let [a, b, c, d, rest @ ..] = items {
            let key = u32::from_le_bytes([*a, *b, *c, *d]);
            let size = match key >> 28 {
                1 | 2 => 1,
                3 => 2,
                4 => 4,
                _ => 8,
            };
            let value = rest.iter().take(size).rev();
            let value = value.fold(0_u64, |value, byte| value << 8 | u64::from(*byte));
            match key {
                PVT_ON_UART1 => self.sends_pvt = value > 0,
                MEASUREMENT_PERIOD => {
                    let period = Duration::from_millis(value);
                    self.period = Some(period);
                    self.ticks.change_period(uptime, period);
                }
                _ => {}
            }
            items = rest.get(size..).unwrap_or_default();
        }
    }

    /// 47.375° N, 8.5375° E, 410 m above the sea, RTK fixed; Monday after midnight.
    fn pvt(uptime: Duration) -> Vec<u8> {
        let mut payload = vec![0; 92];
        let time_ms = 86_400_000 + uptime.as_millis() as u32;
        let seconds = uptime.as_secs();
        let put = |payload: &mut Vec<u8>, at: usize, bytes: &[u8]| {
            payload[at..at + bytes.len()].copy_from_slice(bytes);
        };
        put(&mut payload, 0, &time_ms.to_le_bytes());
        put(&mut payload, 4, &2026_u16.to_le_bytes());
        let clock = [
            11,
            23,
            0,
            (seconds / 60 % 60) as u8,
            (seconds % 60) as u8,
            7,
        ];
        put(&mut payload, 6, &clock);
        // Fix: 3D. Valid, differential, carrier fixed.
        put(&mut payload, 20, &[3, 0x83, 0, 20]);
        put(&mut payload, 24, &85_375_000_i32.to_le_bytes());
        put(&mut payload, 28, &473_750_000_i32.to_le_bytes());
        put(&mut payload, 32, &458_000_i32.to_le_bytes());
        put(&mut payload, 36, &410_000_i32.to_le_bytes());
        put(&mut payload, 40, &14_u32.to_le_bytes());
        put(&mut payload, 44, &20_u32.to_le_bytes());
        frame(0x01, 0x07, &payload)
    }
}

fn find(bytes: &[u8]) -> Option<(usize, usize)> {
    let start = bytes.windows(2).position(|pair| pair == [0xB5, 0x62])?;
    let rest = &bytes[start..];
    let length = usize::from(*rest.get(4)?) + 256 * usize::from(*rest.get(5)?) + 8;
    (rest.len() >= length).then_some((start, length))
}

impl Device for Ublox {
    fn power_on(&mut self) -> Vec<u8> {
        self.period = None;
        self.sends_pvt = false;
        self.buffer.clear();
        self.ticks.restart();
        Vec::new()
    }

    fn receive(&mut self, bytes: &[u8], uptime: Duration) -> Vec<u8> {
        self.buffer.extend_from_slice(bytes);
        let mut replies = Vec::new();
        loop {
            let garbage = self.buffer.windows(2).position(|pair| pair == [0xB5, 0x62]);
            let garbage = garbage.unwrap_or_else(|| self.buffer.len().saturating_sub(1));
            self.corrections.extend(self.buffer.drain(..garbage));
            let Some(request) = take_request(&mut self.buffer, find) else {
                return replies;
            };
            let [_, _, class, id, _, _, payload @ .., _, _] = request.as_slice() else {
                continue;
            };
            if [*class, *id] == [0x06, 0x8A] {
                if !self.refuses {
                    self.set(payload.get(4..).unwrap_or_default(), uptime);
                }
                replies.extend(frame(0x05, u8::from(!self.refuses), &[*class, *id]));
            }
        }
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let Some(period) = self.period.filter(|_| self.sends_pvt) else {
            return Vec::new();
        };
        let due = self.ticks.due(uptime, period);
        due.map(|_| Self::pvt(uptime)).collect()
    }
}
