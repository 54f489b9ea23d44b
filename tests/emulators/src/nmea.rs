//! A satellite receiver with NMEA 0183 output and corrections as input, and an echo sounder.
//!
//! Written from gpsd's "NMEA Revealed" (fields of GGA, DPT and DBT; the checksum is the exclusive or
//! between `$` and `*`).

use std::time::Duration;

use crate::feed::Feed;
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
    feed: Feed<Position>,
}

/// Where a receiver is.
#[derive(Clone, Copy, Debug)]
pub struct Position {
    /// On WGS-84.
    pub latitude_deg: f64,
    /// On WGS-84.
    pub longitude_deg: f64,
    /// Above the ellipsoid.
    pub height_m: f64,
}

impl Nmea {
    /// Gives it a position of `at`, fixed by corrections.
    pub fn feed(&mut self, at: Duration, position: Position) {
        self.feed.push(at, position);
    }
}

/// Of the mean sea level above the ellipsoid, metres.
const GEOID_M: f64 = 48.0;

/// Time of day, with hundredths of a second.
fn time_of_day(hundredths: u128) -> String {
    let (minutes, rest) = (hundredths / 6000, hundredths % 6000);
    let (hours, minutes) = (minutes / 60 % 24, minutes % 60);
    format!("{hours:02}{minutes:02}{:02}.{:02}", rest / 100, rest % 100)
}

/// Degrees and minutes to 10⁻⁷′, as RTK receivers send them, and the letter of the half of the Earth.
fn angle(degrees: f64, digits: usize, [positive, negative]: [char; 2]) -> String {
    const PER_DEGREE: u64 = 600_000_000;
    let parts = (degrees.abs() * PER_DEGREE as f64).round() as u64;
    let minutes = (parts % PER_DEGREE) as f64 / 1e7;
    let half = if degrees < 0.0 { negative } else { positive };
    format!("{:0digits$}{minutes:010.7},{half}", parts / PER_DEGREE)
}

fn gga(time: &str, position: &Position, quality: u8) -> String {
    let latitude = angle(position.latitude_deg, 2, ['N', 'S']);
    let longitude = angle(position.longitude_deg, 3, ['E', 'W']);
    let altitude_m = position.height_m - GEOID_M;
    format!(
        "GPGGA,{time},{latitude},{longitude},{quality},12,0.8,{altitude_m:.3},M,{GEOID_M:.3},M,1.0,0001"
    )
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
        let quality = if self.has_no_fix { 0 } else { 4 };
        let due = self.ticks.due(uptime, PERIOD);
        if let Some(fed) = self.feed.take_until(uptime) {
            for (at, position) in fed {
                let gga = gga(&time_of_day(at.as_millis() / 10), &position, quality);
                sent.push(sentence(&gga, self.has_wrong_sums));
            }
            return sent;
        }
        for tick in due {
            let time = time_of_day(20 * (u128::from(tick) + 1));
            let place = Position {
                latitude_deg: 47.375,
                longitude_deg: 8.5375,
                height_m: 458.0,
            };
            let gga = gga(&time, &place, quality);
            let depth = format!("SDDPT,{}.{},0.5", 3 + tick % 4, tick % 10);
            let same_depth = "SDDBT,9.8,f,3.0,M,1.6,F";
            for body in [&gga, &depth, same_depth] {
                sent.push(sentence(body, self.has_wrong_sums));
            }
        }
        sent
    }
}
