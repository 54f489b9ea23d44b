//! Livox Mid-360: packets with points, which it sends to UDP port 56301.
//!
//! Source: Livox, "Livox `LiDAR` Communication Protocol Mid-360", version 1.4.10, and `livox_lidar_def.h` of Livox-SDK2 (MIT). Numbers are
//! little-endian. **Not proved**: no capture was at hand, and the tests are of bytes made by the document.
//!
//! Its mirror does not turn all points past one place, and a pattern never repeats: there is no revolution to cut at. A cloud is what
//! was measured in a tenth of a second of the sensor's clock, the rate of its frames; full tenths, so that clouds do not depend on
//! when reception began. Points have no ring: the document does not name the laser of a point.

use measurement::cloud::CloudPoint;

use crate::revolution::{PacketError, Sink};

const HEADER: usize = 36;
/// Where the data begins that the checksum is of: the time, and the points.
const CHECKED: usize = 28;
const CLOUD_NS: u64 = 100_000_000;
/// After a longer pause, or a step back, the sensor has started again or its clock was set.
const LONGEST_PAUSE_NS: u64 = 1_000_000_000;

/// How points are sent.
#[derive(Clone, Copy, Debug)]
enum Coordinates {
    Millimetres,
    Centimetres,
    Spherical,
}

impl Coordinates {
    const fn of(data_type: u8) -> Option<Self> {
        match data_type {
            1 => Some(Self::Millimetres),
            2 => Some(Self::Centimetres),
            3 => Some(Self::Spherical),
            _ => None,
        }
    }

    /// Bytes of a point.
    const fn point(self) -> usize {
        match self {
            Self::Millimetres => 14,
            Self::Centimetres => 8,
            Self::Spherical => 10,
        }
    }

    /// x forward, y to the left, z up, metres.
    fn position_m(self, point: &[u8]) -> [f64; 3] {
        let half = |at: usize| [point[at], point[at + 1]];
        let word = |at: usize| [point[at], point[at + 1], point[at + 2], point[at + 3]];
        match self {
            Self::Millimetres => [0, 4, 8].map(|at| f64::from(i32::from_le_bytes(word(at))) * 1e-3),
            Self::Centimetres => [0, 2, 4].map(|at| f64::from(i16::from_le_bytes(half(at))) * 1e-2),
            Self::Spherical => {
                let range_m = f64::from(u32::from_le_bytes(word(0))) * 1e-3;
                let angle_rad = |at| (f64::from(u16::from_le_bytes(half(at))) * 1e-2).to_radians();
                let (sin_zenith, cos_zenith) = libm::sincos(angle_rad(4));
                let (sin, cos) = libm::sincos(angle_rad(6));
                [sin_zenith * cos, sin_zenith * sin, cos_zenith].map(|part| range_m * part)
            }
        }
    }
}

/// Decodes packets.
#[derive(Clone, Debug, Default)]
pub struct Livox {
    last: Option<Last>,
}

/// The last packet.
#[derive(Clone, Copy, Debug)]
struct Last {
    time_ns: u64,
    number: u16,
}

impl Livox {
    /// Puts the points of a packet into `sink`. One that the sensor itself has low confidence in, for rain, dust or an edge, is a
    /// beam without a return.
    pub(crate) fn decode(
        &mut self,
        datagram: &[u8],
        sink: &mut impl Sink,
    ) -> Result<(), PacketError> {
        let length = |expected| PacketError::Length {
            found: datagram.len(),
            expected,
        };
        let header: &[u8; HEADER] = datagram.first_chunk().ok_or_else(|| length(HEADER))?;
        let half = |at: usize| u16::from_le_bytes([header[at], header[at + 1]]);
        let coordinates = Coordinates::of(header[10]).ok_or(PacketError::UnknownModel)?;
        let points = usize::from(half(5));
        let expected = HEADER + points * coordinates.point();
        if datagram.len() != expected {
            return Err(length(expected));
        }
        if header[0] != 0 || usize::from(half(1)) != expected {
            return Err(PacketError::Damaged);
        }
        let checksum = u32::from_le_bytes([header[24], header[25], header[26], header[27]]);
        // Livox's own program does not look at it: 0 may stand for none.
        if checksum != 0 && checksum != crc32fast::hash(&datagram[CHECKED..]) {
            return Err(PacketError::Checksum);
        }
        let mut time_ns = [0; 8];
        time_ns.copy_from_slice(&header[CHECKED..]);
        let time_ns = u64::from_le_bytes(time_ns);
        let number = half(7);
        sink.packet(time_ns as f64 * 1e-9);
        sink.lost(
            self.last
                .map_or(0, |last| last.missing_before(time_ns, number)),
        );
        if self
            .last
            .is_none_or(|last| last.time_ns / CLOUD_NS != time_ns / CLOUD_NS)
        {
            sink.begin(time_ns as f64 * 1e-9);
        }
        self.last = Some(Last { time_ns, number });
        // From the first point to the last.
        let apart_s = f64::from(half(3)) * 1e-7 / points.saturating_sub(1).max(1) as f64;
        for (bytes, at) in datagram[HEADER..]
            .chunks_exact(coordinates.point())
            .zip(0..)
        {
            let position_m = coordinates.position_m(bytes);
            let [.., reflectivity, tag] = bytes else {
                continue;
            };
            // Three properties of two bits each: 0 and 1 are high and medium confidence.
            let is_doubtful = [0, 2, 4].iter().any(|shift| (tag >> shift) & 3 > 1);
            if is_doubtful || position_m.iter().all(|part| *part == 0.0) {
                sink.without_return();
                continue;
            }
            let point = CloudPoint {
                position_m: position_m.map(|metres| metres as f32),
                after_s: 0.0,
                intensity: (*reflectivity).into(),
                ring: None,
            };
            sink.point(time_ns as f64 * 1e-9 + apart_s * f64::from(at), point);
        }
        Ok(())
    }
}

impl Last {
    /// How many packets did not come before this one. Numbers count from 0 in each frame; the end of a frame is not known.
    fn missing_before(self, time_ns: u64, number: u16) -> u64 {
        match time_ns.checked_sub(self.time_ns) {
            Some(1..=LONGEST_PAUSE_NS) => number
                .checked_sub(self.number)
                .map_or(number, |step| step.saturating_sub(1))
                .into(),
            _ => 0,
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use measurement::time::RobotTime;

    use super::*;
    use crate::{LidarDecoder, Sensor};

    /// A packet by the document, with a checksum.
    pub(crate) fn packet(time_ns: u64, number: u16, data_type: u8, points: &[Vec<u8>]) -> Vec<u8> {
        let data = points.concat();
        let mut packet = vec![0];
        packet.extend(((HEADER + data.len()) as u16).to_le_bytes());
        // From the first point to the last: 100 us.
        packet.extend(1000_u16.to_le_bytes());
        packet.extend((points.len() as u16).to_le_bytes());
        packet.extend(number.to_le_bytes());
        packet.extend([0, data_type, 0]);
        packet.extend([0; 12]);
        let checked = [&time_ns.to_le_bytes()[..], &data].concat();
        packet.extend(crc32fast::hash(&checked).to_le_bytes());
        packet.extend(checked);
        packet
    }

    pub(crate) fn millimetres(position: [i32; 3], tag: u8) -> Vec<u8> {
        let mut point: Vec<u8> = position.iter().flat_map(|mm| mm.to_le_bytes()).collect();
        point.extend([77, tag]);
        point
    }

    fn decoder() -> LidarDecoder {
        LidarDecoder::new(Sensor::Livox(Box::default()))
    }

    fn finish(mut decoder: LidarDecoder) -> crate::Revolution {
        decoder.finish().unwrap()
    }

    #[test]
    fn points_of_all_kinds_of_data() {
        let mut centimetres: Vec<u8> = [123_i16, -456, 7]
            .iter()
            .flat_map(|cm| cm.to_le_bytes())
            .collect();
        centimetres.extend([77, 0]);
        // 2 m, 60 degrees from above, 90 degrees to the left.
        let mut spherical = 2000_u32.to_le_bytes().to_vec();
        spherical.extend(
            [6000_u16, 9000]
                .iter()
                .flat_map(|angle| angle.to_le_bytes()),
        );
        spherical.extend([77, 0]);
        for (data_type, point, expected) in [
            (1, millimetres([1234, -5678, 90], 0), [1.234, -5.678, 0.09]),
            (2, centimetres, [1.23, -4.56, 0.07]),
            (3, spherical, [0.0, 1.732_050_8, 1.0]),
        ] {
            let mut decoder = decoder();
            let bytes = packet(2_000_000_000, 0, data_type, &vec![point; 3]);
            assert_eq!(decoder.push(RobotTime::default(), &bytes), Ok(vec![]));
            let revolution = finish(decoder);
            assert!((revolution.sensor_time_s - 2.0).abs() < 1e-9);
            let points = revolution.cloud.points;
            for (point, after_s) in points.iter().zip([0.0, 50e-6, 100e-6]) {
                let off = point
                    .position_m
                    .iter()
                    .zip(expected)
                    .map(|(a, b)| (a - b).abs());
                assert!(off.fold(0.0, f32::max) < 1e-6, "{data_type}: {point:?}");
                assert!((point.after_s - after_s).abs() < 1e-7, "{point:?}");
                assert_eq!((point.intensity, point.ring), (77.0, None));
            }
            assert_eq!(points.len(), 3);
        }
    }

    #[test]
    fn what_the_sensor_doubts_and_what_it_did_not_hit_is_without_return() {
        let mut decoder = decoder();
        let hit = [1000, 0, 0];
        let tags = [0, 1, 4, 0x10, 0x15, 0xC0, 2, 3, 8, 0x0C, 0x20, 0x30];
        let mut points = tags.map(|tag| millimetres(hit, tag)).to_vec();
        points.push(millimetres([0; 3], 0));
        decoder
            .push(RobotTime::default(), &packet(0, 0, 1, &points))
            .unwrap();
        let cloud = finish(decoder).cloud;
        assert_eq!((cloud.points.len(), cloud.without_return), (6, 7));
    }

    #[test]
    fn a_cloud_is_a_full_tenth_of_a_second() {
        let mut decoder = decoder();
        let mut clouds = Vec::new();
        for number in 0..300_u16 {
            let at_ns = 1_950_000_000 + u64::from(number) * 1_000_000;
            let bytes = packet(at_ns, number % 100, 1, &[millimetres([1000, 0, 0], 0)]);
            clouds.extend(
                decoder
                    .push(RobotTime::from_nanos(at_ns.cast_signed()), &bytes)
                    .unwrap(),
            );
        }
        clouds.extend(decoder.finish());
        let found: Vec<_> = clouds
            .iter()
            .map(|it| (it.cloud.points.len(), it.stamp.as_nanos() / 1_000_000))
            .collect();
        assert_eq!(found, [(50, 1950), (100, 2000), (100, 2100), (50, 2200)]);
        assert!((clouds[1].completed_s - 2.1).abs() < 1e-9);
        assert_eq!(decoder.counts().lost, 0);
    }

    #[test]
    fn missing_numbers_are_counted() {
        for (numbers, expected) in [
            (&[5, 6, 7][..], 0),
            (&[5, 7], 1),
            (&[5, 10, 12], 5),
            // A frame ends, or the counter does.
            (&[90, 0, 1], 0),
            (&[90, 2], 2),
            (&[65_535, 0], 0),
            (&[5, 5], 0),
        ] {
            let mut decoder = decoder();
            for (number, at) in numbers.iter().zip(1..) {
                let bytes = packet(at * 1_000_000, *number, 1, &[]);
                decoder.push(RobotTime::default(), &bytes).unwrap();
            }
            assert_eq!(decoder.counts().lost, expected, "{numbers:?}");
        }
        // After a start, or when the clock was set.
        for times_ns in [[5_000_000, 1_000_000], [0, 2_000_000_000]] {
            let mut decoder = decoder();
            for (time_ns, number) in times_ns.into_iter().zip([1, 9]) {
                decoder
                    .push(RobotTime::default(), &packet(time_ns, number, 1, &[]))
                    .unwrap();
            }
            assert_eq!(decoder.counts().lost, 0, "{times_ns:?}");
        }
    }

    #[test]
    fn what_is_no_packet_is_refused() {
        let good = packet(0, 0, 1, &[millimetres([1000, 0, 0], 0)]);
        let changed = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            bytes
        };
        let length = |found, expected| PacketError::Length { found, expected };
        for (bytes, expected) in [
            (vec![], length(0, 36)),
            (good[..35].to_vec(), length(35, 36)),
            (good[..49].to_vec(), length(49, 50)),
            (changed(5, 2), length(50, 64)),
            (changed(0, 1), PacketError::Damaged),
            (changed(1, 51), PacketError::Damaged),
            (changed(10, 0), PacketError::UnknownModel),
            (changed(10, 4), PacketError::UnknownModel),
            (changed(24, good[24] ^ 1), PacketError::Checksum),
            (changed(30, 1), PacketError::Checksum),
            (changed(40, 1), PacketError::Checksum),
        ] {
            let mut decoder = decoder();
            assert_eq!(decoder.push(RobotTime::default(), &bytes), Err(expected));
            assert_eq!(decoder.counts().refused, 1);
        }
        let mut without = good;
        without[24..28].fill(0);
        assert_eq!(decoder().push(RobotTime::default(), &without), Ok(vec![]));
    }
}
