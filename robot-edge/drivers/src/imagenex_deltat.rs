//! Imagenex 837 `DeltaT` multibeam sonar: the 83P profiles that the vendor's program sends over UDP or
//! writes to .83P files, one for each ping.
//!
//! Source: Imagenex, "`DeltaT` - 83P Profile Point Output" of 16 March 2010, called "manual" below, as
//! the comment in `src/mbio/mbsys_image83p.h` of dwcaress/MB-System quotes it (copyright 2008-2025). What the manual
//! does not say is from `mbr_image83p.c` there at 1754149: ranges are computed at 1500 m/s, a range of
//! 0 is no echo. Numbers are big-endian. No recording of a device was at hand.
//!
//! The sensor's x axis is the middle of the fan, beam angle 0; y is on the side of positive angles, to
//! starboard where the sonar looks down and is mounted as the program has it.

use measurement::scan::Scan;

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

mod session;

pub use session::ImagenexDeltat;

const MARK: &[u8] = b"83P";
const HEADER: usize = 256;
/// MB-System, `MBSYS_IMAGE83P_BEAMS`.
const MAX_BEAMS: usize = 480;
/// The sonars have range scales to 300 m; damaged data goes beyond.
const MAX_RANGE_M: f64 = 1000.0;

/// One ping.
#[derive(Clone, Debug, PartialEq)]
pub struct Ping {
    /// Counts pings.
    pub number: u32,
    /// The beams, all measured at once. Without an echo infinite, beyond the range scale NaN.
    pub scan: Scan,
    /// Strength of each beam's echo, normalised; empty if not sent.
    pub intensities: Vec<u16>,
    /// Speed of sound that the ranges are computed with, m/s.
    pub sound_speed_mps: f64,
    /// Frequency of the sound, Hz.
    pub frequency_hz: f64,
    /// Attitude by the sensor in the head, if it has one.
    pub attitude: Attitude,
    /// Rotation of the head about its y axis against the mounting, radians.
    pub tilt_rad: f64,
    /// Time from the ping to the sending of the datagram, seconds; not in version 1.00 and not while
    /// the program plays a file.
    pub age_s: Option<f64>,
    /// The beams are corrected for roll: do not turn them by [`Attitude::roll_rad`].
    pub is_roll_corrected: bool,
}

/// Attitude, radians, signs as the sonar has them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// About the transverse axis.
    pub pitch_rad: Option<f64>,
    /// About the longitudinal axis.
    pub roll_rad: Option<f64>,
    /// Clockwise from north.
    pub heading_rad: Option<f64>,
}

/// Decodes datagrams or a file.
pub type DeltatDecoder = StreamDecoder<Ping>;

impl Framed for Ping {
    fn front(bytes: &[u8]) -> Front<Self> {
        let garbage = before_mark(bytes, MARK);
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        // A datagram that was cut off ends where the next one starts. Only what stands in the header, and then in the whole datagram, is
        // searched: more may be there in one read than in another.
        if let Some(next) = next_start(&bytes[..bytes.len().min(HEADER)]) {
            return Front::Skip(DropReason::CutOff, next);
        }
        let Some(header) = bytes.first_chunk::<HEADER>() else {
            return Front::Incomplete;
        };
        let total = match total(header) {
            Ok(total) => total,
            Err(reason) => return Front::Skip(reason, 1),
        };
        let received = &bytes[..bytes.len().min(total)];
        if let Some(next) = next_start(received) {
            return Front::Skip(DropReason::CutOff, next);
        }
        match received.get(HEADER..total) {
            None => Front::Incomplete,
            Some(beams) => match ping(header, beams) {
                Some(ping) => Front::Message(ping, total),
                None => Front::Skip(DropReason::Field, 1),
            },
        }
    }
}

fn next_start(bytes: &[u8]) -> Option<usize> {
    (1..bytes.len()).find(|at| is_start(&bytes[*at..]))
}

/// Whether a mark, a version, a possible length and the reserved zeros stand at the front.
fn is_start(bytes: &[u8]) -> bool {
    let Some([mark @ .., version, high, low, 0, 0]) = bytes.first_chunk::<8>() else {
        return false;
    };
    let length = usize::from(u16::from_be_bytes([*high, *low]));
    mark == MARK
        && matches!(version, 0 | 10)
        && length.is_multiple_of(2)
        && (HEADER + 2..=HEADER + 4 * MAX_BEAMS).contains(&length)
}

/// Length of the whole ping: header, two bytes for each range, two for each intensity.
fn total(header: &[u8; HEADER]) -> Result<usize, DropReason> {
    if !matches!(header[3], 0 | 10) {
        return Err(DropReason::UnknownKind);
    }
    let (total, beams) = (usize::from(word(header, 4)), usize::from(word(header, 70)));
    let beam_bytes = if has_intensities(header) { 4 } else { 2 };
    let is_possible = (1..=MAX_BEAMS).contains(&beams) && total == HEADER + beam_bytes * beams;
    is_possible.then_some(total).ok_or(DropReason::Length)
}

/// `None` if a field is impossible.
fn ping(header: &[u8; HEADER], beams: &[u8]) -> Option<Ping> {
    let sound_speed_mps = match flagged(header, 83) {
        Some(speed) => f64::from(speed) / 10.0,
        None => 1500.0,
    };
    let scale = sound_speed_mps / 1500.0;
    let step_m = f64::from(word(header, 85)) / 1000.0 * scale;
    let range_max_m = f64::from(word(header, 79)) * scale;
    let first_deg = f64::from(word(header, 76)) / 100.0 - 180.0;
    let increment_deg = f64::from(header[78]) / 100.0;
    let tilt_deg = match word(header, 89) {
        // Old versions of the program leave it out (MB-System).
        0 => 0.0,
        tilt => f64::from(tilt) - 180.0,
    };
    let count = usize::from(word(header, 70));
    let last_deg = first_deg + (count - 1) as f64 * increment_deg;
    let is_possible = (1300.0..=1700.0).contains(&sound_speed_mps)
        && (0.0..=MAX_RANGE_M).contains(&range_max_m)
        && step_m > 0.0
        && step_m < range_max_m
        && increment_deg > 0.0
        && first_deg >= -180.0
        && last_deg <= 180.0
        && (-90.0..=90.0).contains(&tilt_deg);
    let attitude = Attitude {
        pitch_rad: angle_rad(flagged(header, 64), 900.0),
        roll_rad: angle_rad(flagged(header, 66), 900.0),
        heading_rad: angle_rad(flagged(header, 68), 0.0),
    };
    let is_beyond =
        |range| u32::from(range) * u32::from(word(header, 85)) > u32::from(word(header, 79)) * 1000;
    let range_m = |range: u16| match range {
        0 => f32::INFINITY,
        _ if is_beyond(range) => f32::NAN,
        _ => (f64::from(range) * step_m) as f32,
    };
    let (ranges, intensities) = beams.split_at_checked(2 * count)?;
    let numbers = |bytes: &[u8]| -> Vec<u16> {
        let pairs = bytes.as_chunks().0.iter().copied();
        pairs.map(u16::from_be_bytes).collect()
    };
    // Units of 100 µs.
    let age = word(header, 120).checked_sub(word(header, 118));
    let age = age.filter(|_| header[3] >= 10 && word(header, 120) > 0);
    is_possible.then(|| Ping {
        number: u32::from(word(header, 93)) << 16 | u32::from(word(header, 95)),
        scan: Scan {
            angle_min_rad: first_deg.to_radians() as f32,
            angle_increment_rad: increment_deg.to_radians() as f32,
            time_increment_s: 0.0,
            range_min_m: step_m as f32,
            range_max_m: range_max_m as f32,
            ranges_m: numbers(ranges).into_iter().map(range_m).collect(),
        },
        intensities: numbers(intensities),
        sound_speed_mps,
        frequency_hz: f64::from(word(header, 81)) * 1000.0,
        attitude,
        tilt_rad: tilt_deg.to_radians(),
        age_s: age.map(|age| f64::from(age) / 10_000.0),
        is_roll_corrected: header[3] >= 10 && header[123] & 1 != 0,
    })
}

fn has_intensities(header: &[u8; HEADER]) -> bool {
    header[3] >= 10 && header[117] == 1
}

fn word(header: &[u8; HEADER], at: usize) -> u16 {
    u16::from_be_bytes([header[at], header[at + 1]])
}

/// 15 bits, if the highest bit says that they are valid.
fn flagged(header: &[u8; HEADER], at: usize) -> Option<u16> {
    let word = word(header, at);
    (word & 0x8000 != 0).then_some(word & 0x7FFF)
}

/// Tenths of a degree above an offset.
fn angle_rad(tenths: Option<u16>, offset: f64) -> Option<f64> {
    let angle_deg = (f64::from(tenths?) - offset) / 10.0;
    (-360.0..=360.0)
        .contains(&angle_deg)
        .then(|| angle_deg.to_radians())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Dropped;
    use crate::test_decoding::*;

    /// By the manual: version 1.10, beams 0.25° apart from −60° on, range scale 30 m, steps of 60 mm,
    /// 260 kHz, 1480 m/s, pitch 1.5°, roll −2.0°, heading 271.3°, tilt −10°, ping 66051.
    fn datagram(ranges: &[u16], intensities: &[u16]) -> Vec<u8> {
        let mut header = [0; HEADER];
        header[..4].copy_from_slice(b"83P\x0A");
        let total = HEADER + 2 * (ranges.len() + intensities.len());
        header[8..20].copy_from_slice(b"16-MAR-2010\0");
        header[20..29].copy_from_slice(b"12:34:56\0");
        for (at, value) in [
            (4, total as u16),
            (64, 0x8000 + 915),
            (66, 0x8000 + 880),
            (68, 0x8000 + 2713),
            (70, ranges.len() as u16),
            (72, 500),
            (74, 120),
            (76, 12000),
            (79, 30),
            (81, 260),
            (83, 0x8000 + 14800),
            (85, 60),
            (89, 170),
            (93, 1),
            (95, 0x0203),
            (118, 12),
            (120, 312),
        ] {
            header[at..at + 2].copy_from_slice(&value.to_be_bytes());
        }
        header[78] = 25;
        header[117] = u8::from(!intensities.is_empty());
        let beams = [ranges, intensities].concat();
        let beams = beams.iter().flat_map(|value| value.to_be_bytes());
        header.into_iter().chain(beams).collect()
    }

    fn changed(at: usize, bytes: &[u8]) -> Vec<u8> {
        let mut datagram = datagram(&[100, 200], &[]);
        datagram[at..at + bytes.len()].copy_from_slice(bytes);
        datagram
    }

    #[track_caller]
    fn assert_near(value: impl Into<f64>, expected: f64) {
        let value = value.into();
        assert!((value - expected).abs() < 1e-5, "{value} {expected}");
    }

    #[test]
    fn all_fields() {
        let ping = decode_one(
            DeltatDecoder::default(),
            &datagram(&[0, 1, 100, 500, 501], &[0, 7, 8, 9, 65535]),
        );
        assert_eq!(ping.number, 66051);
        assert_near(ping.scan.angle_min_rad, -60_f64.to_radians());
        assert_near(ping.scan.angle_increment_rad, 0.25_f64.to_radians());
        assert!(ping.scan.sweep_duration().is_some());
        let step_m = 0.06 * 1480.0 / 1500.0;
        assert_near(ping.scan.range_min_m, step_m);
        assert_near(ping.scan.range_max_m, 500.0 * step_m);
        let ranges_m = &ping.scan.ranges_m;
        assert!(ranges_m[0].is_infinite());
        assert_near(ranges_m[1], step_m);
        assert_near(ranges_m[2], 100.0 * step_m);
        assert_near(ranges_m[3], 500.0 * step_m);
        assert!(ranges_m[4].is_nan());
        assert_eq!(ping.intensities, [0, 7, 8, 9, 65535]);
        assert_near(ping.sound_speed_mps, 1480.0);
        assert_near(ping.frequency_hz, 260_000.0);
        assert_near(ping.attitude.pitch_rad.unwrap(), 1.5_f64.to_radians());
        assert_near(ping.attitude.roll_rad.unwrap(), -2_f64.to_radians());
        assert_near(ping.attitude.heading_rad.unwrap(), 271.3_f64.to_radians());
        assert_near(ping.tilt_rad, -10_f64.to_radians());
        assert_near(ping.age_s.unwrap(), 0.03);
        assert!(!ping.is_roll_corrected);
    }

    #[test]
    fn what_may_be_missing() {
        let ping = decode_one(DeltatDecoder::default(), &changed(64, &[0; 6]));
        assert_eq!(ping.attitude, Attitude::default());
        let ping = decode_one(DeltatDecoder::default(), &changed(83, &[0x39, 0xD0]));
        assert_near(ping.sound_speed_mps, 1500.0);
        assert_near(
            decode_one(DeltatDecoder::default(), &changed(89, &[0, 0])).tilt_rad,
            0.0,
        );
        assert_eq!(
            decode_one(DeltatDecoder::default(), &changed(120, &[0, 0])).age_s,
            None
        );
        assert!(decode_one(DeltatDecoder::default(), &changed(123, &[1])).is_roll_corrected);
        // Version 1.00 has nothing there.
        let mut old = changed(117, &[1, 0, 12, 1, 56, 0, 1]);
        old[3] = 0;
        let ping = decode_one(DeltatDecoder::default(), &old);
        assert_eq!((ping.age_s, ping.is_roll_corrected), (None, false));
        assert!(ping.intensities.is_empty());
        assert_eq!(ping.scan.ranges_m.len(), 2);
    }

    #[test]
    fn bad_datagrams_are_dropped_and_the_next_is_found() {
        let whole = datagram(&[100; 480], &[5; 480]);
        let good = datagram(&[50; 120], &[]);
        for (bad, reason, count) in [
            (b"8 83 83 P83".to_vec(), DropReason::Garbage, 11),
            (b"837".to_vec(), DropReason::Garbage, 3),
            (changed(3, &[11]), DropReason::UnknownKind, 1),
            (changed(4, &[1, 6]), DropReason::Length, 1),
            (changed(70, &[0, 0]), DropReason::Length, 1),
            (changed(117, &[1]), DropReason::Length, 1),
            (datagram(&[1; 481], &[]), DropReason::Length, 1),
            (datagram(&[], &[]), DropReason::Length, 1),
            // First angle, increment, sector beyond a turn, scale, speed, resolution, tilt.
            (changed(76, &[0x9C, 0x40]), DropReason::Field, 1),
            (changed(78, &[0]), DropReason::Field, 1),
            (changed(79, &[0, 0]), DropReason::Field, 1),
            (changed(79, &[0xFF, 0xFF]), DropReason::Field, 1),
            (changed(83, &[0x80, 0]), DropReason::Field, 1),
            (changed(83, &[0xFF, 0xFF]), DropReason::Field, 1),
            (changed(85, &[0, 0]), DropReason::Field, 1),
            (changed(85, &[0xFF, 0xFF]), DropReason::Field, 1),
            (changed(89, &[0xFF, 0xFF]), DropReason::Field, 1),
            // A datagram that was cut off: the rest is not that of the next.
            (whole[..5].to_vec(), DropReason::CutOff, 1),
            (whole[..200].to_vec(), DropReason::CutOff, 1),
            (whole[..HEADER].to_vec(), DropReason::CutOff, 1),
            (whole[..1000].to_vec(), DropReason::CutOff, 1),
            // The next one starts in the header and goes on beyond it.
            (whole[..253].to_vec(), DropReason::CutOff, 1),
            (changed(70, &[0, 0])[..253].to_vec(), DropReason::Length, 1),
        ] {
            let bytes = [&bad[..], &good].concat();
            for length in [1, 5, usize::MAX] {
                let (pings, dropped) = decode_in(DeltatDecoder::default(), &bytes, &[length]);
                assert_eq!(pings.len(), 1, "{:?}", &bad[..bad.len().min(100)]);
                assert_eq!(pings[0].scan.ranges_m.len(), 120);
                assert_eq!(dropped.count(reason), count, "{dropped:?}");
            }
        }
    }

    fn any_datagram() -> impl Strategy<Value = Vec<u8>> {
        let beams = prop::collection::vec((0..500_u16, any::<u16>()), 1..=MAX_BEAMS);
        (beams, any::<bool>()).prop_map(|(beams, has_intensities)| {
            let (ranges, intensities): (Vec<u16>, Vec<u16>) = beams.into_iter().unzip();
            let sent: &[u16] = if has_intensities { &intensities } else { &[] };
            datagram(&ranges, sent)
        })
    }

    proptest! {
        #[test]
        fn any_split_gives_the_same_pings(
            datagrams in prop::collection::vec(any_datagram(), 1..5),
            lengths in read_lengths(),
        ) {
            let (pings, dropped) = decode_in(DeltatDecoder::default(), &datagrams.concat(), &lengths);
            prop_assert_eq!(pings.len(), datagrams.len());
            prop_assert_eq!(dropped, Dropped::default());
        }

        #[test]
        fn damage_neither_panics_nor_gives_senseless_pings(
            datagrams in prop::collection::vec(any_datagram(), 1..5),
            damage in damage(b"83P\x00\x0a\xff"),
        ) {
            for ping in damage.decode(DeltatDecoder::default, datagrams.concat()) {
                let scan = &ping.scan;
                prop_assert!(scan.sweep_duration().is_some(), "{scan:?}");
                prop_assert!((1..=MAX_BEAMS).contains(&scan.ranges_m.len()));
                let is_range = |range_m: &f32| {
                    range_m.is_nan()
                        || *range_m == f32::INFINITY
                        || (scan.range_min_m..=scan.range_max_m).contains(range_m)
                };
                prop_assert!(scan.ranges_m.iter().all(is_range));
                prop_assert!(ping.intensities.is_empty() || ping.intensities.len() == scan.ranges_m.len());
                prop_assert!(ping.age_s.is_none_or(|age_s| (0.0..=6.5536).contains(&age_s)));
            }
        }
    }
}
