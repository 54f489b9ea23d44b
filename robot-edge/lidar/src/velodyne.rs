//! Velodyne VLP-16 (Puck, Puck LITE), Puck Hi-Res and VLP-32C: data packets of UDP port 2368, with one return or two.
//!
//! Sources: Velodyne, "VLP-16 User Manual", 63-9243 Rev. E, chapter 9, and "VLP-32C User Manual", 63-9325 Rev. B, chapter 9:
//! 12 blocks of 32 ranges each, which are two firings of 16 lasers or one of 32, azimuths in hundredths of a degree clockwise
//! from the y axis. Numbers are little-endian. VLP-16 is held against four revolutions of `vlp16_packets.db3` and the cloud
//! that another decoder made of them (tests); of the other two no capture was at hand.
//!
//! Points are in the frame of the ROS driver: x where the azimuth is 0, y to the left, z up.

use measurement::cloud::CloudPoint;

use crate::revolution::{PacketError, Sink};

mod calibration;

use calibration::Correction;
pub use calibration::{Calibration, CalibrationError};

/// Bytes of a data packet.
pub const PACKET: usize = 1206;
const BLOCK: usize = 100;
const BLOCKS: usize = 12;
const MARK: [u8; 2] = [0xFF, 0xEE];
/// Ranges of a block.
const RANGES: usize = 32;
/// From a firing of all lasers to the next, and between two lasers, or pairs of lasers, seconds.
const FIRING_S: f64 = 55.296e-6;
const LASER_S: f64 = 2.304e-6;
/// Of a turn.
const AZIMUTHS: u16 = 36_000;
const DUAL: u8 = 0x39;
/// The sensor's clock counts microseconds of an hour.
const HOUR_S: f64 = 3600.0;
/// A longer pause between two packets, or a step back, is another recording or clock.
const LONGEST_PAUSE_S: f64 = 1.0;

/// A model that the packet names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Model {
    Vlp16,
    PuckHiRes,
    Vlp32c,
}

/// Elevations of a VLP-32C and how far its lasers are turned, degrees.
const VLP_32C: [(f64, f64); RANGES] = [
    (-25.0, 1.4),
    (-1.0, -4.2),
    (-1.667, 1.4),
    (-15.639, -1.4),
    (-11.31, 1.4),
    (0.0, -1.4),
    (-0.667, 4.2),
    (-8.843, -1.4),
    (-7.254, 1.4),
    (0.333, -4.2),
    (-0.333, 1.4),
    (-6.148, -1.4),
    (-5.333, 4.2),
    (1.333, -1.4),
    (0.667, 4.2),
    (-4.0, -1.4),
    (-4.667, 1.4),
    (1.667, -4.2),
    (1.0, 1.4),
    (-3.667, -4.2),
    (-3.333, 4.2),
    (3.333, -1.4),
    (2.333, 1.4),
    (-2.667, -1.4),
    (-3.0, 1.4),
    (7.0, -1.4),
    (4.667, 1.4),
    (-2.333, -4.2),
    (-2.0, 4.2),
    (15.0, -1.4),
    (10.333, 1.4),
    (-1.333, -1.4),
];

/// One of the 32 ranges of a block.
#[derive(Clone, Copy, Debug, Default)]
struct Laser {
    /// From the first range of the block, seconds.
    after_s: f64,
    /// Added to the azimuth, degrees.
    turned_deg: f64,
    cos_elevation: f64,
    sin_elevation: f64,
    /// Added to the range, metres.
    range_offset_m: f64,
    /// From the axis to the laser, to the left and up, metres.
    left_m: f64,
    up_m: f64,
    /// From 0 at the lowest.
    ring: u16,
}

impl Model {
    const fn name(self) -> &'static str {
        match self {
            Self::Vlp16 => "VLP-16",
            Self::PuckHiRes => "Puck Hi-Res",
            Self::Vlp32c => "VLP-32C",
        }
    }

    const fn firings(self) -> usize {
        match self {
            Self::Vlp16 | Self::PuckHiRes => 2,
            Self::Vlp32c => 1,
        }
    }

    /// Metres of a step of range.
    const fn step_m(self) -> f64 {
        match self {
            Self::Vlp16 | Self::PuckHiRes => 0.002,
            Self::Vlp32c => 0.004,
        }
    }

    /// Elevation and turn of one of the 32 ranges of a block, degrees.
    fn angles_deg(self, range: usize) -> (f64, f64) {
        // The even ones of 16 lasers are the lower half.
        let of_16 = |least_deg: f64, apart_deg: f64| {
            let laser = range % 16;
            let ring = laser / 2 + 8 * (laser % 2);
            (least_deg + apart_deg * ring as f64, 0.0)
        };
        match self {
            Self::Vlp16 => of_16(-15.0, 2.0),
            Self::PuckHiRes => of_16(-10.0, 4.0 / 3.0),
            Self::Vlp32c => VLP_32C[range],
        }
    }

    /// Lasers as built, or as calibrated.
    fn lasers(self, calibration: Option<&Calibration>) -> Result<[Laser; RANGES], PacketError> {
        let count = RANGES / self.firings();
        if calibration.is_some_and(|calibration| calibration.lasers.len() != count) {
            return Err(PacketError::OtherCalibration(count));
        }
        let corrections: Vec<_> = (0..count)
            .map(|laser| {
                if let Some(calibration) = calibration {
                    return calibration.lasers[laser];
                }
                let (elevation_deg, turned_deg) = self.angles_deg(laser);
                Correction {
                    elevation_rad: elevation_deg.to_radians(),
                    turned_deg,
                    ..Correction::default()
                }
            })
            .collect();
        Ok(std::array::from_fn(|range| {
            let correction = corrections[range % count];
            let lower = corrections
                .iter()
                .filter(|other| other.elevation_rad < correction.elevation_rad);
            let after_s = match self {
                Self::Vlp16 | Self::PuckHiRes => {
                    FIRING_S * (range / 16) as f64 + LASER_S * (range % 16) as f64
                }
                // They fire in pairs.
                Self::Vlp32c => LASER_S * (range / 2) as f64,
            };
            let (sin_elevation, cos_elevation) = libm::sincos(correction.elevation_rad);
            Laser {
                after_s,
                turned_deg: correction.turned_deg,
                cos_elevation,
                sin_elevation,
                range_offset_m: correction.range_offset_m,
                left_m: correction.left_m,
                up_m: correction.up_m,
                ring: lower.count() as u16,
            }
        }))
    }
}

/// Decodes packets.
#[derive(Clone, Debug, Default)]
pub struct Velodyne {
    calibration: Option<Calibration>,
    lasers: Option<(Model, [Laser; RANGES])>,
    /// Of the last block.
    last_azimuth: Option<u16>,
    /// Of the last packet on the sensor's clock, and of the full hour before it, seconds.
    last_s: Option<f64>,
    hour_s: f64,
}

/// Twelve blocks, of which the marks, the azimuths and the model are checked.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Packet<'a> {
    model: Model,
    /// Blocks come in pairs of the same azimuth: the last return, and the strongest, or the second strongest
    /// where the strongest is the last.
    is_dual: bool,
    /// Of the first firing, microseconds past the full hour of the sensor's clock.
    time_us: u32,
    blocks: [(u16, &'a [u8]); BLOCKS],
}

impl<'a> Packet<'a> {
    pub(crate) fn parse(datagram: &'a [u8]) -> Result<Self, PacketError> {
        let bytes: &[u8; PACKET] = datagram.try_into().ok().ok_or(PacketError::Length {
            found: datagram.len(),
            expected: PACKET,
        })?;
        let (blocks, end) = bytes.split_at(BLOCKS * BLOCK);
        let model = match end[5] {
            0x22 => Model::Vlp16,
            0x24 => Model::PuckHiRes,
            0x28 => Model::Vlp32c,
            _ => return Err(PacketError::UnknownModel),
        };
        let is_dual = match end[4] {
            0x37 | 0x38 => false,
            DUAL => true,
            _ => return Err(PacketError::UnknownModel),
        };
        let mut parsed = [(0, &blocks[..0]); BLOCKS];
        for (parsed, block) in parsed.iter_mut().zip(blocks.chunks_exact(BLOCK)) {
            let (head, ranges) = block.split_at(4);
            let azimuth = u16::from_le_bytes([head[2], head[3]]);
            if !head.starts_with(&MARK) || azimuth >= AZIMUTHS {
                return Err(PacketError::Damaged);
            }
            *parsed = (azimuth, ranges);
        }
        Ok(Self {
            model,
            is_dual,
            time_us: u32::from_le_bytes([end[0], end[1], end[2], end[3]]),
            blocks: parsed,
        })
    }

    /// Steps of range and reflectivity of one of the 32 ranges of a block.
    fn return_of(&self, block: usize, range: usize) -> (u16, u8) {
        let bytes = &self.blocks[block].1[3 * range..][..3];
        (u16::from_le_bytes([bytes[0], bytes[1]]), bytes[2])
    }

    /// Blocks of one azimuth.
    const fn returns(&self) -> usize {
        if self.is_dual { 2 } else { 1 }
    }

    /// By how much the sensor turns in a second around a block, hundredths of a degree: up to the next block, or as between
    /// the two before where there is no next one.
    fn turn_rate(&self, block: usize) -> f64 {
        let azimuth = |block: usize| i32::from(self.blocks[block].0);
        let from = block.min(BLOCKS - 2 * self.returns());
        let turned = azimuth(from + self.returns()) - azimuth(from);
        f64::from(turned.rem_euclid(AZIMUTHS.into())) / self.block_s()
    }

    /// From a block to the next, seconds.
    fn block_s(&self) -> f64 {
        FIRING_S * self.model.firings() as f64
    }
}

impl Velodyne {
    /// One whose lasers are where its calibration says.
    pub fn calibrated(calibration: Calibration) -> Self {
        Self {
            calibration: Some(calibration),
            ..Self::default()
        }
    }

    /// Of the last packet.
    pub(crate) fn model_name(&self) -> Option<&'static str> {
        self.lasers.map(|(model, _)| model.name())
    }

    /// Puts the returns of a packet into `sink` in the order of measuring. Of two that are the same, as of a wall, one.
    ///
    /// The lasers of a block fire one after the other while the sensor turns: each has its own azimuth.
    pub(crate) fn decode(
        &mut self,
        datagram: &[u8],
        sink: &mut impl Sink,
    ) -> Result<(), PacketError> {
        let packet = Packet::parse(datagram)?;
        let lasers = match &self.lasers {
            Some((model, lasers)) if *model == packet.model => *lasers,
            _ => packet.model.lasers(self.calibration.as_ref())?,
        };
        let calibrated_step_m = self.calibration.as_ref().and_then(|it| it.step_m);
        let step_m = calibrated_step_m.unwrap_or(packet.model.step_m());
        self.lasers = Some((packet.model, lasers));
        let returns = packet.returns();
        let packet_s = self.time_of(&packet, sink);
        sink.packet(packet_s);
        for (at, block) in (0..BLOCKS).step_by(returns).enumerate() {
            let block_s = packet_s + packet.block_s() * at as f64;
            let (azimuth, _) = packet.blocks[block];
            if self.last_azimuth.is_none_or(|last| azimuth < last) {
                sink.begin(block_s);
            }
            self.last_azimuth = Some(azimuth);
            let rate = packet.turn_rate(block);
            for (range, laser) in lasers.iter().enumerate() {
                let azimuth = f64::from(azimuth) + rate * laser.after_s + 100.0 * laser.turned_deg;
                let (sin, cos) = libm::sincos((0.01 * azimuth).to_radians());
                let first = packet.return_of(block, range);
                let mut has_return = false;
                for which in 0..returns {
                    let (steps, reflectivity) = packet.return_of(block + which, range);
                    if steps == 0 || (which > 0 && (steps, reflectivity) == first) {
                        continue;
                    }
                    has_return = true;
                    let range_m = f64::from(steps) * step_m + laser.range_offset_m;
                    let level_m = range_m * laser.cos_elevation - laser.up_m * laser.sin_elevation;
                    let position = [
                        level_m * cos + laser.left_m * sin,
                        -level_m * sin + laser.left_m * cos,
                        range_m * laser.sin_elevation + laser.up_m * laser.cos_elevation,
                    ];
                    let point = CloudPoint {
                        position_m: position.map(|metres| metres as f32),
                        after_s: 0.0,
                        intensity: reflectivity.into(),
                        ring: Some(laser.ring),
                    };
                    sink.point(block_s + laser.after_s, point);
                }
                if !has_return {
                    sink.without_return();
                }
            }
        }
        Ok(())
    }

    /// Time of a packet on the sensor's clock, which begins again every hour. Counts packets that are missing before it.
    fn time_of(&mut self, packet: &Packet<'_>, sink: &mut impl Sink) -> f64 {
        let of_hour_s = f64::from(packet.time_us) * 1e-6;
        let mut packet_s = self.hour_s + of_hour_s;
        if let Some(last_s) = self.last_s {
            if packet_s < last_s - 0.5 * HOUR_S {
                self.hour_s += HOUR_S;
                packet_s += HOUR_S;
            }
            let pause_s = packet_s - last_s;
            if (0.0..LONGEST_PAUSE_S).contains(&pause_s) {
                let packets = pause_s / (packet.block_s() * (BLOCKS / packet.returns()) as f64);
                sink.lost((libm::round(packets) as u64).saturating_sub(1));
            } else {
                self.last_azimuth = None;
            }
        }
        self.last_s = Some(packet_s);
        packet_s
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::HashMap;
    use std::fs;

    use super::*;
    use crate::shared_data::shared_data;

    /// The packets of the four messages of `vlp16_packets.db3`.
    pub(crate) fn recorded() -> Option<Vec<Vec<u8>>> {
        let path = shared_data("velodyne")?.join("vlp16_packets.db3");
        let flags = rusqlite::OpenFlags::SQLITE_OPEN_READ_ONLY;
        let file = rusqlite::Connection::open_with_flags(path, flags).unwrap();
        let mut rows = file
            .prepare("select data from messages order by id")
            .unwrap();
        let messages = rows.query_map([], |row| row.get::<_, Vec<u8>>(0)).unwrap();
        let mut packets = Vec::new();
        for message in messages {
            let message = message.unwrap();
            let mut rest = &message[..];
            while let Some(at) = rest.windows(2).position(|bytes| bytes == MARK)
                && let Some(packet) = rest.get(at..at + PACKET)
            {
                packets.push(packet.to_vec());
                rest = &rest[at + PACKET..];
            }
        }
        Some(packets)
    }

    /// Keeps all points and when revolutions begin.
    #[derive(Default)]
    struct All {
        points: Vec<(f64, CloudPoint)>,
        begins: usize,
        lost: u64,
        without_return: usize,
    }

    impl Sink for All {
        fn packet(&mut self, _sensor_time_s: f64) {}

        fn begin(&mut self, _sensor_time_s: f64) {
            self.begins += 1;
        }

        fn point(&mut self, sensor_time_s: f64, point: CloudPoint) {
            self.points.push((sensor_time_s, point));
        }

        fn without_return(&mut self) {
            self.without_return += 1;
        }

        fn lost(&mut self, packets: u64) {
            self.lost += packets;
        }
    }

    /// Positions of the published cloud.
    fn published() -> Option<Vec<[f32; 3]>> {
        const POINT: usize = 32;
        let file = fs::read(shared_data("velodyne")?.join("vlp16_cloud.pcd")).unwrap();
        let mark = b"DATA binary\n";
        let header = file.windows(mark.len()).position(|at| at == mark).unwrap();
        let points = file[header + mark.len()..].chunks_exact(POINT);
        let float = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        Some(
            points
                .map(|point| [0, 4, 8].map(|at| float(&point[at..at + 4])))
                .collect(),
        )
    }

    /// Points by cells of 1 cm.
    #[derive(Default)]
    struct Index(HashMap<[i32; 3], Vec<[f32; 3]>>);

    impl Index {
        fn cell(point: [f32; 3]) -> [i32; 3] {
            point.map(|metres| (metres * 100.0).floor() as i32)
        }

        fn add(&mut self, point: [f32; 3]) {
            self.0.entry(Self::cell(point)).or_default().push(point);
        }

        fn has_within_3_mm(&self, point: [f32; 3]) -> bool {
            let [x, y, z] = Self::cell(point);
            let around = |at: i32| at - 1..=at + 1;
            let cells = around(x)
                .flat_map(|x| around(y).flat_map(move |y| around(z).map(move |z| [x, y, z])));
            let mut near = cells.filter_map(|cell| self.0.get(&cell)).flatten();
            near.any(|other| {
                let squares = other.iter().zip(point).map(|(a, b)| (a - b) * (a - b));
                squares.sum::<f32>() <= 0.003 * 0.003
            })
        }
    }

    /// A point that we found, as we place it and as the other decoder does in some places.
    struct Found {
        ways: [[f32; 3]; 3],
        packet: usize,
        /// Of two blocks.
        pair: usize,
        is_second: bool,
    }

    /// All points of the packets.
    fn found(packets: &[Vec<u8>], mut decoder: Velodyne) -> Vec<Found> {
        let mut found: Vec<Found> = Vec::new();
        let mut all = All::default();
        for (at, bytes) in packets.iter().enumerate() {
            let packet = Packet::parse(bytes).unwrap();
            assert!(packet.is_dual);
            all.points.clear();
            decoder.decode(bytes, &mut all).unwrap();
            let packet_s = decoder.last_s.unwrap();
            let mut before_s = None;
            for &(time_s, CloudPoint { position_m, .. }) in &all.points {
                // What the other decoder does otherwise: in the last pair of blocks of a packet no laser has an azimuth of
                // its own, and a second return has that of the next pair.
                let pair = ((time_s - packet_s) / packet.block_s()) as usize;
                let [x, y, z] = position_m.map(f64::from);
                let azimuth_deg = libm::atan2(-y, x).to_degrees();
                let turned = |pair: usize| {
                    let by = f64::from(packet.blocks[2 * pair].0) / 100.0 - azimuth_deg;
                    let (sin, cos) = libm::sincos(-by.to_radians());
                    [cos * x - sin * y, sin * x + cos * y, z].map(|metres| metres as f32)
                };
                let ways = [position_m, turned(pair), turned((pair + 1).min(5))];
                let is_second = before_s.replace(time_s) == Some(time_s);
                found.push(Found {
                    ways: if pair == 5 {
                        ways
                    } else {
                        [position_m, position_m, ways[2]]
                    },
                    packet: at,
                    pair,
                    is_second,
                });
            }
        }
        assert_eq!((all.lost, all.begins), (0, 5));
        found
    }

    fn index(points: impl Iterator<Item = [f32; 3]>) -> Index {
        let mut index = Index::default();
        points.for_each(|point| index.add(point));
        index
    }

    /// As built, and with the file of the sensor's calibration.
    fn decoders() -> Option<[Velodyne; 2]> {
        let text = fs::read_to_string(shared_data("velodyne")?.join("VLP16.yaml")).unwrap();
        let calibration = Calibration::read(&text).unwrap();
        Some([Velodyne::default(), Velodyne::calibrated(calibration)])
    }

    #[test]
    fn every_point_that_another_decoder_found_is_found() {
        let (Some(packets), Some(published), Some(decoders)) =
            (recorded(), published(), decoders())
        else {
            return;
        };
        assert_eq!((packets.len(), published.len()), (603, 14_831));
        for decoder in decoders {
            let found = found(&packets, decoder);
            let sets = [0, 1, 2].map(|way| index(found.iter().map(|point| point.ways[way])));
            let mut counts = [0; 4];
            for point in &published {
                let way = sets.iter().position(|set| set.has_within_3_mm(*point));
                counts[way.unwrap_or(3)] += 1;
            }
            assert_eq!(counts, [13_684, 1036, 111, 0]);
        }
    }

    #[test]
    fn every_point_that_only_we_found_has_its_reason() {
        let (Some(packets), Some(published), Some(decoders)) =
            (recorded(), published(), decoders())
        else {
            return;
        };
        let published = index(published.into_iter());
        // The other decoder published the last packet of the third message, where its revolution began, and the fourth message.
        let (first, last) = (packets.len() - 151, packets.len() - 1);
        for decoder in decoders {
            let found = found(&packets, decoder);
            let mut counts = [0; 5];
            for point in found.iter().filter(|point| point.packet >= first) {
                let [x, y, z] = point.ways[0];
                let reason = if point.ways.iter().any(|way| published.has_within_3_mm(*way)) {
                    0
                } else if point.is_second {
                    1
                } else if x * x + y * y + z * z < 0.5 * 0.5 {
                    2
                } else if point.packet == last && point.pair > 0 {
                    // Its revolution ended after the first pair of blocks: the rest belongs to the next cloud.
                    3
                } else {
                    4
                };
                counts[reason] += 1;
            }
            // Published; second return; nearer than 0.5 m; beyond the end of the revolution; unexplained.
            assert_eq!(counts, [14_840, 0, 0, 71, 0]);
        }
    }

    #[test]
    fn a_calibration_moves_the_points_of_its_lasers() {
        let Some(packets) = recorded() else {
            return;
        };
        let calibration = |laser: Correction| Calibration {
            lasers: vec![laser; 16],
            step_m: None,
        };
        let first = |correction: Correction| {
            let mut all = All::default();
            let mut decoder = Velodyne::calibrated(calibration(correction));
            decoder.decode(&packets[0], &mut all).unwrap();
            all.points[0].1.position_m.map(f64::from)
        };
        let level = Correction::default();
        let [x, y, z] = first(level);
        let range_m = libm::hypot(x, y);
        assert!(z.abs() < 1e-9);
        let (forward, left) = ([x / range_m, y / range_m], [-y / range_m, x / range_m]);
        let (sin, cos) = libm::sincos(0.1);
        for (correction, expected) in [
            (
                Correction {
                    range_offset_m: 0.5,
                    ..level
                },
                [x + 0.5 * forward[0], y + 0.5 * forward[1], 0.0],
            ),
            (
                Correction {
                    left_m: 0.5,
                    ..level
                },
                [x + 0.5 * left[0], y + 0.5 * left[1], 0.0],
            ),
            (Correction { up_m: 0.5, ..level }, [x, y, 0.5]),
            (
                Correction {
                    elevation_rad: 0.1,
                    ..level
                },
                [x * cos, y * cos, range_m * sin],
            ),
            // Clockwise.
            (
                Correction {
                    turned_deg: 0.1_f64.to_degrees(),
                    ..level
                },
                [x * cos + y * sin, y * cos - x * sin, 0.0],
            ),
        ] {
            let found = first(correction);
            let off = found
                .iter()
                .zip(expected)
                .map(|(found, expected)| (found - expected).abs());
            assert!(
                off.fold(0.0, f64::max) < 1e-5,
                "{correction:?}: {found:?} {expected:?}"
            );
        }
        let mut of_32 = Velodyne::calibrated(Calibration {
            lasers: vec![level; 32],
            step_m: None,
        });
        assert_eq!(
            of_32.decode(&packets[0], &mut All::default()),
            Err(PacketError::OtherCalibration(16))
        );
    }
}
