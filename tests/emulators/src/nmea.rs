//! A satellite receiver with NMEA 0183 output and corrections as input, and an echo sounder.
//!
//! Written from gpsd's "NMEA Revealed" (fields of GGA, DPT and DBT; the checksum is the exclusive or
//! between `$` and `*`).

use std::time::Duration;

use crate::{Device, Ticks};

/// A receiver and an echo sounder on one line.
#[derive(Debug, Default)]
pub struct Nmea {
    /// What a host has sent: corrections.
    pub received: Vec<u8>,
    /// It says that it has no fix.
    pub has_no_fix: bool,
    /// Checksums are wrong.
    pub has_wrong_sums: bool,
    ticks: Ticks,
}

/// Five positions per second.
const PERIOD: Duration = Duration::from_millis(200);

fn sentence(body: &str, is_wrong: bool) -> Vec<u8> {
    let sum = body
        .bytes()
        .fold(u8::from(is_wrong), |sum, byte| sum ^ byte);
    format!("${body}*{sum:02X}\r\n").into_bytes()
}

impl Device for Nmea {
    fn power_on(&mut self) -> Vec<u8> {
        self.ticks.restart();
        Vec::new()
    }

    fn receive(&mut self, bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        self.received.extend_from_slice(bytes);
        Vec::new()
    }

    /// Its day begins with its power; 47° 22.5′ N, 8° 32.25′ E.
    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let mut sent = Vec::new();
        for tick in self.ticks.due(uptime, PERIOD) {
            let tenths = 2 * (tick + 1);
            let (minutes, seconds) = (tenths / 600, tenths % 600);
            let time = format!("00{minutes:02}{:02}.{}0", seconds / 10, seconds % 10);
            let quality = if self.has_no_fix { 0 } else { 4 };
            let gga = format!(
                "GPGGA,{time},4722.5000,N,00832.2500,E,{quality},12,0.8,410.0,M,48.0,M,1.0,0001"
            );
            let depth = format!("SDDPT,{}.{},0.5", 3 + tick % 4, tick % 10);
            let same_depth = "SDDBT,9.8,f,3.0,M,1.6,F";
            for body in [&gga, &depth, same_depth] {
                sent.push(sentence(body, self.has_wrong_sums));
            }
        }
        sent
    }
}
