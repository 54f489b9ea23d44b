//! Velodyne VLP-16 (Puck, Puck LITE and Hi-Res): data packets of UDP port 2368, with one return or two.
//!
//! Source: Velodyne, "VLP-16 User Manual", 63-9243 Rev. E, chapter 9: 12 blocks of two firings of 16 lasers
//! each, ranges in steps of 2 mm, azimuths in hundredths of a degree clockwise from the y axis. Numbers are
//! little-endian. Held against four revolutions of `vlp16_packets.db3` and the cloud that another decoder
//! made of them (tests).
//!
//! Points are in the frame of the ROS driver: x where the azimuth is 0, y to the left, z up.

use measurement::cloud::CloudPoint;

use crate::DropReason;
use crate::read_buffer::{Framed, Front, StreamDecoder, before_mark};

/// Bytes of a data packet.
pub const PACKET: usize = 1206;
const BLOCK: usize = 100;
const BLOCKS: usize = 12;
const MARK: &[u8] = &[0xFF, 0xEE];
const LASERS: usize = 16;
const FIRINGS: usize = 2;
/// Metres of a step of range.
const STEP_M: f32 = 0.002;
/// Between two firings of all lasers, and between two lasers, seconds.
const FIRING_S: f64 = 55.296e-6;
const LASER_S: f64 = 2.304e-6;
/// Of a turn.
const AZIMUTHS: u16 = 36_000;
const DUAL: u8 = 0x39;

/// A model that the packet names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// VLP-16 and Puck LITE.
    Vlp16,
    /// Puck Hi-Res.
    PuckHiRes,
}

impl Model {
    /// Least elevation, and between neighbouring lasers, degrees.
    const fn elevations_deg(self) -> [f64; 2] {
        match self {
            Self::Vlp16 => [-15.0, 2.0],
            Self::PuckHiRes => [-10.0, 4.0 / 3.0],
        }
    }
}

/// Twelve blocks.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// The sensor.
    pub model: Model,
    /// Blocks come in pairs of the same azimuth: the last return, and the strongest, or the second strongest
    /// where the strongest is the last.
    pub is_dual: bool,
    /// Of the first firing, microseconds past the full hour of the sensor's clock.
    pub time_us: u32,
    blocks: [Block; BLOCKS],
}

/// Two firings from an azimuth on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Block {
    /// Hundredths of a degree.
    azimuth: u16,
    /// Steps of range and reflectivity of each laser.
    returns: [[(u16, u8); LASERS]; FIRINGS],
}

/// A return and where it was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Clockwise from above, degrees, 0 to 360.
    pub azimuth_deg: f64,
    /// In the sensor's frame; [`CloudPoint::after_s`] is from the packet's time on.
    pub point: CloudPoint,
}

/// Decodes datagrams or a file of them.
pub type VelodyneDecoder = StreamDecoder<Packet>;

impl Framed for Packet {
    fn front(bytes: &[u8]) -> Front<Self> {
        let garbage = before_mark(bytes, MARK);
        if garbage > 0 {
            return Front::Skip(DropReason::Garbage, garbage);
        }
        let Some(bytes) = bytes.first_chunk::<PACKET>() else {
            return Front::Incomplete;
        };
        match packet(bytes) {
            Ok(packet) => Front::Message(packet, PACKET),
            Err(reason) => Front::Skip(reason, MARK.len()),
        }
    }
}

fn packet(bytes: &[u8; PACKET]) -> Result<Packet, DropReason> {
    let (blocks_bytes, end) = bytes.split_at(BLOCKS * BLOCK);
    let model = match end[5] {
        0x22 => Model::Vlp16,
        0x24 => Model::PuckHiRes,
        _ => return Err(DropReason::UnknownKind),
    };
    let is_dual = match end[4] {
        0x37 | 0x38 => false,
        DUAL => true,
        _ => return Err(DropReason::Field),
    };
    let mut blocks = [Block::default(); BLOCKS];
    for (block, bytes) in blocks.iter_mut().zip(blocks_bytes.chunks_exact(BLOCK)) {
        let (head, returns) = bytes.split_at(4);
        block.azimuth = u16::from_le_bytes([head[2], head[3]]);
        if !head.starts_with(MARK) || block.azimuth >= AZIMUTHS {
            return Err(DropReason::Field);
        }
        let lasers = block.returns.iter_mut().flatten();
        for (laser, bytes) in lasers.zip(returns.chunks_exact(3)) {
            *laser = (u16::from_le_bytes([bytes[0], bytes[1]]), bytes[2]);
        }
    }
    Ok(Packet {
        model,
        is_dual,
        time_us: u32::from_le_bytes([end[0], end[1], end[2], end[3]]),
        blocks,
    })
}

impl Packet {
    /// The returns in the order of measuring. Of two that are the same, as of a wall, one.
    ///
    /// The lasers of a block fire one after the other while the sensor turns: each has its own azimuth, between
    /// the block's and the next one's, or as far apart as the two before where there is no next one.
    pub fn returns(&self) -> impl Iterator<Item = Return> + '_ {
        let returns = if self.is_dual { 2 } else { 1 };
        let at_block = move |block: usize| {
            let azimuth = |block: usize| i32::from(self.blocks[block].azimuth);
            let turned =
                |from: usize| (azimuth(from + returns) - azimuth(from)).rem_euclid(AZIMUTHS.into());
            let last = BLOCKS - 1 - returns;
            let gap = turned(if block > last { block - returns } else { block });
            (
                f64::from(azimuth(block)),
                f64::from(gap) / (FIRINGS as f64 * FIRING_S),
            )
        };
        let [least_deg, apart_deg] = self.model.elevations_deg();
        (0..BLOCKS / returns).flat_map(move |time| {
            let (azimuth, turn_rate) = at_block(time * returns);
            (0..FIRINGS * LASERS * returns).filter_map(move |at| {
                let (at, which) = (at / returns, at % returns);
                let (firing, laser) = (at / LASERS, at % LASERS);
                let of = |which: usize| self.blocks[time * returns + which].returns[firing][laser];
                let (steps, reflectivity) = of(which);
                if steps == 0 || (which == 1 && of(0) == of(1)) {
                    return None;
                }
                let after_s = FIRING_S * firing as f64 + LASER_S * laser as f64;
                let azimuth_deg = (azimuth + turn_rate * after_s) / 100.0 % 360.0;
                // The even lasers are the lower half.
                let ring = laser / 2 + LASERS / 2 * (laser % 2);
                let elevation = (least_deg + apart_deg * ring as f64).to_radians();
                let azimuth = azimuth_deg.to_radians();
                let range_m = f64::from(steps) * f64::from(STEP_M);
                let level_m = range_m * libm::cos(elevation);
                let position = [
                    level_m * libm::cos(azimuth),
                    -level_m * libm::sin(azimuth),
                    range_m * libm::sin(elevation),
                ];
                Some(Return {
                    azimuth_deg,
                    point: CloudPoint {
                        position_m: position.map(|metres| metres as f32),
                        after_s: (FIRINGS as f64 * FIRING_S * time as f64 + after_s) as f32,
                        intensity: reflectivity.into(),
                        ring: Some(ring as u16),
                    },
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::fs;

    use super::*;
    use crate::Decoder as _;
    use crate::shared_data::shared_data;

    /// The packets of the four messages of `vlp16_packets.db3`.
    fn recorded() -> Option<Vec<Packet>> {
        let path = shared_data("velodyne")?.join("vlp16_packets.db3");
        let file =
            rusqlite::Connection::open_with_flags(path, rusqlite::OpenFlags::SQLITE_OPEN_READ_ONLY)
                .unwrap();
        let mut rows = file
            .prepare("select data from messages order by id")
            .unwrap();
        let messages = rows.query_map([], |row| row.get::<_, Vec<u8>>(0)).unwrap();
        let mut decoder = VelodyneDecoder::default();
        let mut packets = Vec::new();
        for message in messages {
            for bytes in message.unwrap().chunks(PACKET) {
                decoder.push(bytes);
                packets.extend(std::iter::from_fn(|| decoder.next_message()));
            }
        }
        Some(packets)
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
        for packet in &packets {
            assert!(packet.is_dual);
            for found in packet.returns() {
                let CloudPoint {
                    position_m,
                    after_s,
                    ..
                } = found.point;
                ours.add(position_m);
                // What the other decoder does otherwise: in the last pair of blocks of a packet no laser has an azimuth of
                // its own, and a second return has that of the next pair.
                let pair = (f64::from(after_s) / (FIRINGS as f64 * FIRING_S)) as usize;
                let turned = |pair: usize| {
                    let by = f64::from(packet.blocks[2 * pair].azimuth) / 100.0 - found.azimuth_deg;
                    let (sin, cos) = libm::sincos(-by.to_radians());
                    let [x, y, z] = position_m.map(f64::from);
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
