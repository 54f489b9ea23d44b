//! The program of an Imagenex 837 `DeltaT`, which sends 83P datagrams.
//!
//! Written from Imagenex's "83P Profile Point Output" of 16 March 2010, as the comment in
//! `src/mbio/mbsys_image83p.h` of dwcaress/MB-System quotes it.

use std::time::Duration;

use crate::feed::Feed;
use crate::{Device, Ticks};

/// The program.
#[derive(Debug, Default)]
pub struct Deltat {
    /// It sends each ping twice.
    pub repeats: bool,
    ticks: Ticks,
    /// Ranges, steps of the scale.
    feed: Feed<Vec<u16>>,
    /// Pings of it so far.
    fed: u64,
}

/// Ten pings per second.
const PERIOD: Duration = Duration::from_millis(100);
/// From a ping to its datagram.
const DELAY: Duration = Duration::from_millis(5);
const BEAMS: u16 = 480;

/// How the program is set.
struct Setting {
    /// First beam, 1/100° + 18,000.
    first: u16,
    /// Between beams, 1/100°.
    apart: u8,
    range_m: u16,
    step_mm: u16,
}

const MADE_UP: Setting = Setting {
    first: 12_000,
    apart: 25,
    range_m: 30,
    step_mm: 60,
};
/// 240 beams, the middles of the parts of 120°; the data sheet of the 837B has steps of 0.02 % of the range.
const FED: Setting = Setting {
    first: 12_025,
    apart: 50,
    range_m: 300,
    step_mm: 60,
};

impl Deltat {
    /// Range of a beam, steps of 60 mm; 0 for none.
    pub fn range(beam: u16, ping: u32) -> u16 {
        if beam % 50 == 49 {
            return 0;
        }
        100 + beam % 100 + (ping % 20) as u16
    }

    /// Gives it a ping of `at`: 240 ranges, the first at −59.75°. What is no range is 0, with or without an echo.
    pub fn feed(&mut self, at: Duration, ranges_m: &[f32]) {
        let step_m = f32::from(FED.step_mm) / 1000.0;
        let steps = |range_m: &f32| match *range_m {
            range_m if range_m.is_finite() && range_m > 0.0 => (range_m / step_m).round() as u16,
            _ => 0,
        };
        self.feed.push(at, ranges_m.iter().map(steps).collect());
    }

    /// `age`: time since the ping.
    fn datagram(ping: u32, setting: &Setting, age: Duration, ranges: &[u16]) -> Vec<u8> {
        let mut header = [0_u8; 256];
        header[..4].copy_from_slice(b"83P\x0A");
        let put = |header: &mut [u8; 256], at: usize, word: u16| {
            header[at..at + 2].copy_from_slice(&word.to_be_bytes());
        };
        for (at, word) in [
            (4, 256 + 2 * ranges.len() as u16),
            (70, ranges.len() as u16),
            (72, 0),   // Samples per beam.
            (74, 120), // Sector, degrees.
            (76, setting.first),
            (79, setting.range_m),
            (81, 260),             // kHz.
            (83, 0x8000 + 15_000), // 1500 m/s.
            (85, setting.step_mm),
            (89, 180), // Tilt: 0.
            (93, (ping >> 16) as u16),
            (95, ping as u16),
            (118, 0),
            (120, (age.as_micros() / 100) as u16),
        ] {
            put(&mut header, at, word);
        }
        header[78] = setting.apart;
        let ranges = ranges.iter().flat_map(|range| range.to_be_bytes());
        header.into_iter().chain(ranges).collect()
    }
}

impl Device for Deltat {
    fn power_on(&mut self) -> Vec<u8> {
        self.ticks.restart();
        Vec::new()
    }

    fn receive(&mut self, _bytes: &[u8], _uptime: Duration) -> Vec<u8> {
        Vec::new()
    }

    fn run(&mut self, uptime: Duration) -> Vec<Vec<u8>> {
        let due = self.ticks.due(uptime, PERIOD);
        let copies = if self.repeats { 2 } else { 1 };
        let Some(fed) = self.feed.take_until(uptime.saturating_sub(DELAY)) else {
            let datagram = |ping: u64| {
                let ping = ping as u32 + 1;
                let ranges: Vec<u16> = (0..BEAMS).map(|beam| Self::range(beam, ping)).collect();
                vec![Self::datagram(ping, &MADE_UP, DELAY, &ranges); copies]
            };
            return due.flat_map(datagram).collect();
        };
        let first = self.fed;
        self.fed += fed.len() as u64;
        let pings = fed.into_iter().zip(first..);
        let datagram = |((at, ranges), ping): ((Duration, Vec<u16>), u64)| {
            let age = uptime.saturating_sub(at);
            vec![Self::datagram(ping as u32 + 1, &FED, age, &ranges); copies]
        };
        pings.flat_map(datagram).collect()
    }
}
