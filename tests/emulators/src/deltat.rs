//! The program of an Imagenex 837 `DeltaT`, which sends 83P datagrams.
//!
//! Written from Imagenex's "83P Profile Point Output" of 16 March 2010, as the comment in
//! `src/mbio/mbsys_image83p.h` of dwcaress/MB-System quotes it.

use std::time::Duration;

use crate::{Device, Ticks};

/// The program.
#[derive(Debug, Default)]
pub struct Deltat {
    /// It sends each ping twice.
    pub repeats: bool,
    ticks: Ticks,
}

/// Ten pings per second.
const PERIOD: Duration = Duration::from_millis(100);
const BEAMS: u16 = 480;

impl Deltat {
    /// Range of a beam, steps of 60 mm; 0 for none.
    pub fn range(beam: u16, ping: u32) -> u16 {
        if beam % 50 == 49 {
            return 0;
        }
        100 + beam % 100 + (ping % 20) as u16
    }

    fn datagram(ping: u32) -> Vec<u8> {
        let mut header = [0_u8; 256];
        header[..4].copy_from_slice(b"83P\x0A");
        let put = |header: &mut [u8; 256], at: usize, word: u16| {
            header[at..at + 2].copy_from_slice(&word.to_be_bytes());
        };
        for (at, word) in [
            (4, 256 + 2 * BEAMS),
            (70, BEAMS),
            (72, 0),               // Samples per beam.
            (74, 120),             // Sector, degrees.
            (76, 12_000),          // First beam: (−60 + 180)·100.
            (79, 30),              // Range, m.
            (81, 260),             // kHz.
            (83, 0x8000 + 15_000), // 1500 m/s.
            (85, 60),              // Step, mm.
            (89, 180),             // Tilt: 0.
            (93, (ping >> 16) as u16),
            (95, ping as u16),
            (118, 0),
            (120, 50), // 5 ms after the ping.
        ] {
            put(&mut header, at, word);
        }
        header[78] = 25; // 0.25° between beams.
        let ranges = (0..BEAMS).flat_map(|beam| Self::range(beam, ping).to_be_bytes());
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
        due.flat_map(|ping| vec![Self::datagram(ping as u32 + 1); copies])
            .collect()
    }
}
