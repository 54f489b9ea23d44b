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
#[derive(Clone, Copy, Debug)]
struct Laser {
    /// From the first range of the block, seconds.
    after_s: f64,
    /// Added to the azimuth, degrees.
    turned_deg: f64,
    cos_elevation: f64,
    sin_elevation: f64,
    /// From 0 at the lowest.
    ring: u16,
}

impl Model {
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

    fn lasers(self) -> [Laser; RANGES] {
        std::array::from_fn(|range| {
            let (elevation_deg, turned_deg) = self.angles_deg(range);
            let lower = (0..RANGES / self.firings())
                .filter(|other| self.angles_deg(*other).0 < elevation_deg);
            let after_s = match self {
                Self::Vlp16 | Self::PuckHiRes => {
                    FIRING_S * (range / 16) as f64 + LASER_S * (range % 16) as f64
                }
                // They fire in pairs.
                Self::Vlp32c => LASER_S * (range / 2) as f64,
            };
            let (sin_elevation, cos_elevation) = libm::sincos(elevation_deg.to_radians());
            Laser {
                after_s,
                turned_deg,
                cos_elevation,
                sin_elevation,
                ring: lower.count() as u16,
            }
        })
    }
}

/// Decodes packets.
#[derive(Clone, Debug, Default)]
pub struct Velodyne {
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
            _ => packet.model.lasers(),
        };
        self.lasers = Some((packet.model, lasers));
        let returns = packet.returns();
        let packet_s = self.time_of(&packet, sink);
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
                    let range_m = f64::from(steps) * packet.model.step_m();
                    let level_m = range_m * laser.cos_elevation;
                    let position = [level_m * cos, -level_m * sin, range_m * laser.sin_elevation];
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
mod tests {
    use std::collections::HashMap;
    use std::fs;

    use super::*;
    use crate::shared_data::shared_data;

    /// The packets of the four messages of `vlp16_packets.db3`.
    fn recorded() -> Option<Vec<Vec<u8>>> {
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

    #[test]
    fn every_point_that_another_decoder_found_is_found() {
        let (Some(packets), Some(published)) = (recorded(), published()) else {
            return;
        };
        assert_eq!((packets.len(), published.len()), (603, 14_831));
        let (mut ours, mut frozen, mut next) =
            (Index::default(), Index::default(), Index::default());
        let mut decoder = Velodyne::default();
        let mut all = All::default();
        for bytes in &packets {
            let packet = Packet::parse(bytes).unwrap();
            assert!(packet.is_dual);
            all.points.clear();
            decoder.decode(bytes, &mut all).unwrap();
            let packet_s = decoder.last_s.unwrap();
            for &(time_s, CloudPoint { position_m, .. }) in &all.points {
                ours.add(position_m);
                // What the other decoder does otherwise: in the last pair of blocks of a packet no laser has an azimuth of
                // its own, and a second return has that of the next pair.
                let after_s = time_s - packet_s;
                let pair = (after_s / packet.block_s()) as usize;
                let [x, y, z] = position_m.map(f64::from);
                let azimuth_deg = libm::atan2(-y, x).to_degrees();
                let turned = |pair: usize| {
                    let by = f64::from(packet.blocks[2 * pair].0) / 100.0 - azimuth_deg;
                    let (sin, cos) = libm::sincos(-by.to_radians());
                    [cos * x - sin * y, sin * x + cos * y, z].map(|metres| metres as f32)
                };
                if pair == 5 {
                    frozen.add(turned(5));
                    next.add(turned(5));
                } else {
                    next.add(turned(pair + 1));
                }
            }
        }
        assert_eq!((all.lost, all.begins), (0, 5));
        let mut counts = [0; 4];
        for point in published {
            let sets = [&ours, &frozen, &next];
            let found = sets.into_iter().position(|set| set.has_within_3_mm(point));
            counts[found.unwrap_or(3)] += 1;
        }
        println!("{counts:?}");
        assert_eq!(counts[3], 0, "{counts:?}");
        assert!(counts[0] > 13_600, "{counts:?}");
    }
}
