//! Ouster OS0, OS1, OS2 and `OSDome`: lidar packets of UDP port 7502 with the metadata of the sensor.
//!
//! Sources: Ouster, "Software User Manual" 2.3 (packet formats, metadata, conversion to points), and `ouster_client` of
//! `ouster-sdk` (BSD-3) for the places of fields. Numbers are little-endian. Held against the digests that the vendor's own
//! decoder gives of `os0-32_fw2.2.pcap`, profile `RNG19_RFL8_SIG16_NIR16_DUAL`, and by how well three revolutions of
//! `os1-128_fw2.3_3scans.pcap`, `RNG15_RFL8_NIR8`, lie on each other (tests). Of the profiles `LEGACY` and `RNG19_RFL8_SIG16_NIR16`
//! no capture was at hand.
//!
//! The measurements of the unit of gyroscopes and accelerometers inside, UDP port 7503, are in the same manual; in both captures
//! they have the length of gravity (tests).
//!
//! Points are in the frame `os_sensor`: x opposite to the connector, y to the left, z up.

use measurement::ImuSample;
use measurement::cloud::CloudPoint;
use nalgebra::{Matrix4, Point3, Vector3};
use serde_json::Value;

use crate::revolution::{PacketError, Sink};

/// Bytes of a packet of the unit of gyroscopes and accelerometers.
const IMU_PACKET: usize = 48;
const GRAVITY_MPS2: f64 = 9.806_65;
/// After more revolutions than these without a packet, the sensor has started again.
const LONGEST_PAUSE: u16 = 10;

/// Why metadata cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetadataError {
    /// It is no JSON.
    #[error("the metadata is no JSON: {0}")]
    NoJson(String),
    /// A key is missing or has another type or length.
    #[error("the metadata has no usable `{0}`")]
    Key(&'static str),
    /// A profile of packets that is not decoded.
    #[error(
        "packets of profile {0} are not decoded; set the sensor's `udp_profile_lidar` to RNG19_RFL8_SIG16_NIR16, \
         RNG19_RFL8_SIG16_NIR16_DUAL, RNG15_RFL8_NIR8 or LEGACY"
    )]
    Profile(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Profile {
    Legacy,
    Single,
    Dual,
    LowRate,
}

/// Where things are in a packet, bytes.
#[derive(Clone, Copy, Debug)]
struct Layout {
    packet_header: usize,
    column_header: usize,
    pixel: usize,
    column_footer: usize,
    packet_footer: usize,
}

impl Profile {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "LEGACY" => Self::Legacy,
            "RNG19_RFL8_SIG16_NIR16" => Self::Single,
            "RNG19_RFL8_SIG16_NIR16_DUAL" => Self::Dual,
            "RNG15_RFL8_NIR8" => Self::LowRate,
            _ => return None,
        })
    }

    const fn layout(self) -> Layout {
        let (pixel, is_legacy) = match self {
            Self::Legacy => (12, true),
            Self::Single => (12, false),
            Self::Dual => (16, false),
            Self::LowRate => (4, false),
        };
        if is_legacy {
            Layout {
                packet_header: 0,
                column_header: 16,
                pixel,
                column_footer: 4,
                packet_footer: 0,
            }
        } else {
            Layout {
                packet_header: 32,
                column_header: 12,
                pixel,
                column_footer: 0,
                packet_footer: 32,
            }
        }
    }

    /// Ranges, millimetres, and reflectivities of a pixel's returns.
    fn returns(self, pixel: &[u8]) -> [(u32, u8); 2] {
        let word = |at: usize| match pixel.get(at..at + 4) {
            Some(bytes) => u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]),
            None => 0,
        };
        match self {
            Self::Legacy => [(word(0) & 0xF_FFFF, pixel[4]), (0, 0)],
            Self::Single => [(word(0) & 0x7_FFFF, pixel[4]), (0, 0)],
            Self::Dual => [
                (word(0) & 0x7_FFFF, pixel[3]),
                (word(4) & 0x7_FFFF, pixel[7]),
            ],
            // In steps of 8 mm.
            Self::LowRate => [((word(0) & 0x7FFF) << 3, pixel[2]), (0, 0)],
        }
    }
}

/// A row of pixels: the laser's direction, by the angle of the encoder.
#[derive(Clone, Copy, Debug)]
struct Pixel {
    azimuth_rad: f64,
    sin_altitude: f64,
    cos_altitude: f64,
}

/// One column of a packet that is valid.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Column<'a> {
    pub(crate) timestamp_ns: u64,
    /// From 0 to the columns of a revolution.
    pub(crate) measurement: u16,
    pub(crate) frame: u16,
    pixels: &'a [u8],
}

impl Column<'_> {
    /// On the sensor's clock, seconds.
    fn time_s(&self) -> f64 {
        self.timestamp_ns as f64 * 1e-9
    }
}

/// Decodes packets.
#[derive(Clone, Debug)]
pub struct Ouster {
    profile: Profile,
    columns: usize,
    columns_per_packet: usize,
    pixels: Vec<Pixel>,
    /// Distance of a laser from the axis, metres.
    beam_origin_m: f64,
    sensor_from_lidar: Matrix4<f64>,
    /// First and last column of a revolution that are sent. The last may come first.
    window: [usize; 2],
    /// Serial number, if the metadata has it.
    serial: Option<u64>,
    name: String,
    /// Revolution and column of the last column.
    last: Option<(u16, u16)>,
}

impl Ouster {
    /// For the sensor that has this metadata, as its page `api/v1/sensor/metadata` gives it, or older programs have saved it.
    ///
    /// # Errors
    /// If something that is needed is missing, or the profile of its packets is not decoded.
    pub fn new(metadata: &str) -> Result<Self, MetadataError> {
        let json: Value = serde_json::from_str(metadata)
            .map_err(|error| MetadataError::NoJson(error.to_string()))?;
        let profile = match find(&json, "udp_profile_lidar").and_then(Value::as_str) {
            // Firmware before 2.0 has no profiles.
            None => Profile::Legacy,
            Some(name) => {
                Profile::named(name).ok_or_else(|| MetadataError::Profile(name.to_owned()))?
            }
        };
        let count = |key: &'static str| {
            let count = find(&json, key).and_then(Value::as_u64);
            let count = count.filter(|count| (1..=4096).contains(count));
            count
                .map(|count| count as usize)
                .ok_or(MetadataError::Key(key))
        };
        let numbers = |key: &'static str, length: Option<usize>| {
            let numbers = find(&json, key).and_then(Value::as_array);
            let numbers: Option<Vec<f64>> =
                numbers.and_then(|numbers| numbers.iter().map(Value::as_f64).collect());
            numbers
                .filter(|numbers| length.is_none_or(|length| numbers.len() == length))
                .ok_or(MetadataError::Key(key))
        };
        let rows = count("pixels_per_column")?;
        let altitudes_deg = numbers("beam_altitude_angles", Some(rows))?;
        let azimuths_deg = numbers("beam_azimuth_angles", Some(rows))?;
        let pixels = altitudes_deg.iter().zip(&azimuths_deg);
        let pixels = pixels.map(|(altitude_deg, azimuth_deg): (&f64, &f64)| {
            let (sin_altitude, cos_altitude) = libm::sincos(altitude_deg.to_radians());
            Pixel {
                azimuth_rad: -azimuth_deg.to_radians(),
                sin_altitude,
                cos_altitude,
            }
        });
        let beam_origin_mm = find(&json, "lidar_origin_to_beam_origin_mm").and_then(Value::as_f64);
        let transform = numbers("lidar_to_sensor_transform", Some(16))?;
        let columns = count("columns_per_frame")?;
        let window = match find(&json, "column_window") {
            // Older firmware always sends all.
            None => [0, columns - 1],
            Some(_) => match numbers("column_window", Some(2))?[..] {
                [from, to]
                    if [from, to]
                        .iter()
                        .all(|at| (0.0..columns as f64).contains(at)) =>
                {
                    [from as usize, to as usize]
                }
                _ => return Err(MetadataError::Key("column_window")),
            },
        };
        let text = |key| {
            find(&json, key)
                .and_then(Value::as_str)
                .unwrap_or("unknown")
        };
        let mut sensor_from_lidar = Matrix4::from_row_slice(&transform);
        for metres in sensor_from_lidar.fixed_view_mut::<3, 1>(0, 3).iter_mut() {
            *metres *= 1e-3;
        }
        Ok(Self {
            profile,
            columns,
            columns_per_packet: count("columns_per_packet")?,
            pixels: pixels.collect(),
            beam_origin_m: 1e-3
                * beam_origin_mm.ok_or(MetadataError::Key("lidar_origin_to_beam_origin_mm"))?,
            sensor_from_lidar,
            window,
            name: format!("{}, serial number {}", text("prod_line"), text("prod_sn")),
            serial: find(&json, "prod_sn").and_then(|serial| serial.as_str()?.parse().ok()),
            last: None,
        })
    }

    /// Model and serial number, as the metadata has them.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Bytes of a packet.
    pub fn packet_bytes(&self) -> usize {
        let layout = self.profile.layout();
        let packet = layout.packet_header + layout.packet_footer;
        packet + self.columns_per_packet * self.column_bytes()
    }

    fn column_bytes(&self) -> usize {
        let layout = self.profile.layout();
        layout.column_header + self.pixels.len() * layout.pixel + layout.column_footer
    }

    /// The valid columns of a packet.
    pub(crate) fn columns<'a>(
        &self,
        datagram: &'a [u8],
    ) -> Result<impl Iterator<Item = Column<'a>>, PacketError> {
        if datagram.len() != self.packet_bytes() {
            return Err(PacketError::Length {
                found: datagram.len(),
                expected: self.packet_bytes(),
            });
        }
        let layout = self.profile.layout();
        let is_legacy = self.profile == Profile::Legacy;
        if !is_legacy {
            let mut serial = [0; 8];
            serial[..5].copy_from_slice(&datagram[7..12]);
            let found = u64::from_le_bytes(serial);
            if self.serial.is_some_and(|serial| serial != found) {
                return Err(PacketError::OtherSensor(found));
            }
        }
        let packet_frame = u16::from_le_bytes([datagram[2], datagram[3]]);
        let columns = datagram[layout.packet_header..].chunks_exact(self.column_bytes());
        let (header, footer) = (layout.column_header, layout.column_footer);
        Ok(columns
            .take(self.columns_per_packet)
            .filter_map(move |column| {
                let half = |at: usize| u16::from_le_bytes([column[at], column[at + 1]]);
                let end = column.len() - footer;
                let is_valid = if is_legacy {
                    column[end..] == [0xFF; 4]
                } else {
                    half(10) & 1 == 1
                };
                let mut timestamp = [0; 8];
                timestamp.copy_from_slice(&column[..8]);
                is_valid.then(|| Column {
                    timestamp_ns: u64::from_le_bytes(timestamp),
                    measurement: half(8),
                    frame: if is_legacy { half(10) } else { packet_frame },
                    pixels: &column[header..end],
                })
            }))
    }

    /// Puts the returns of a packet into `sink`, column by column.
    pub(crate) fn decode(
        &mut self,
        datagram: &[u8],
        sink: &mut impl Sink,
    ) -> Result<(), PacketError> {
        let columns: Vec<_> = self.columns(datagram)?.collect();
        let is_beyond = |column: &Column<'_>| usize::from(column.measurement) >= self.columns;
        if columns.iter().any(is_beyond) {
            return Err(PacketError::Damaged);
        }
        if let Some(first) = columns.first() {
            sink.packet(first.time_s());
        }
        let mut last = self.last;
        for column in columns {
            let time_s = column.time_s();
            if last.is_none_or(|(frame, _)| frame != column.frame) {
                sink.begin(time_s);
            }
            if let Some(last) = last {
                let left_out = self.columns_between(last, (column.frame, column.measurement));
                sink.lost(left_out / self.columns_per_packet as u64);
            }
            last = Some((column.frame, column.measurement));
            self.decode_column(&column, time_s, sink);
        }
        self.last = last;
        Ok(())
    }

    /// How many columns are sent between two.
    fn columns_between(&self, last: (u16, u16), next: (u16, u16)) -> u64 {
        let [from, to] = self.window;
        let sent_before = |column: usize| {
            if from <= to {
                column.clamp(from, to + 1) - from
            } else {
                column.min(to + 1) + column.saturating_sub(from)
            }
        };
        let revolutions = next.0.wrapping_sub(last.0);
        if revolutions > LONGEST_PAUSE {
            return 0;
        }
        let of_next =
            usize::from(revolutions) * sent_before(self.columns) + sent_before(next.1.into());
        of_next.saturating_sub(sent_before(last.1.into()) + 1) as u64
    }

    fn decode_column(&self, column: &Column<'_>, time_s: f64, sink: &mut impl Sink) {
        let turn = f64::from(column.measurement) / self.columns as f64;
        let encoder_rad = std::f64::consts::TAU * (1.0 - turn);
        let (sin_encoder, cos_encoder) = libm::sincos(encoder_rad);
        let origin = Vector3::new(cos_encoder, sin_encoder, 0.0) * self.beam_origin_m;
        let pixels = column.pixels.chunks_exact(self.profile.layout().pixel);
        for (row, (pixel, bytes)) in self.pixels.iter().zip(pixels).enumerate() {
            let [first, second] = self.profile.returns(bytes);
            let (sin, cos) = libm::sincos(encoder_rad + pixel.azimuth_rad);
            let level = pixel.cos_altitude;
            let direction = Vector3::new(level * cos, level * sin, pixel.sin_altitude);
            let second = (second != first).then_some(second);
            let mut has_return = false;
            for (range_mm, reflectivity) in [Some(first), second].into_iter().flatten() {
                if range_mm == 0 {
                    continue;
                }
                has_return = true;
                // The range counts from the axis.
                let along_m = 1e-3 * f64::from(range_mm) - self.beam_origin_m;
                let in_lidar = Point3::from(origin + direction * along_m);
                let position = self.sensor_from_lidar.transform_point(&in_lidar);
                let point = CloudPoint {
                    position_m: position.coords.map(|metres| metres as f32).into(),
                    after_s: 0.0,
                    intensity: reflectivity.into(),
                    ring: Some(row as u16),
                };
                sink.point(time_s, point);
            }
            if !has_return {
                sink.without_return();
            }
        }
    }
}

/// A packet of the unit of gyroscopes and accelerometers: the time of the accelerometers on the sensor's clock, seconds, and what was
/// measured, without an orientation. `None` if it is none.
pub fn imu(datagram: &[u8]) -> Option<(f64, ImuSample)> {
    let bytes: &[u8; IMU_PACKET] = datagram.try_into().ok()?;
    let (times, values) = bytes.split_at(24);
    // Time of the packet, of the accelerometers, of the gyroscopes.
    let times_ns: Vec<_> = times
        .as_chunks()
        .0
        .iter()
        .copied()
        .map(u64::from_le_bytes)
        .collect();
    let vector = |from: usize, unit: f64| {
        let values = values.as_chunks().0;
        [0, 1, 2].map(|axis| f64::from(f32::from_le_bytes(values[from + axis])) * unit)
    };
    let sample = ImuSample {
        orientation_xyzw: None,
        angular_velocity_radps: vector(3, 1_f64.to_radians()),
        linear_acceleration_mps2: vector(0, GRAVITY_MPS2),
    };
    let vectors = [
        sample.angular_velocity_radps,
        sample.linear_acceleration_mps2,
    ];
    let is_finite = vectors.as_flattened().iter().all(|value| value.is_finite());
    is_finite.then(|| (times_ns[1] as f64 * 1e-9, sample))
}

/// The value of a key at any depth: firmwares nest them differently.
fn find<'a>(json: &'a Value, key: &str) -> Option<&'a Value> {
    let Value::Object(object) = json else {
        return None;
    };
    let own = object.get(key);
    own.or_else(|| object.values().find_map(|value| find(value, key)))
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::BTreeMap;
    use std::fs::{self, File};

    use etherparse::defrag::IpDefragPool;
    use etherparse::{SlicedPacket, TransportSlice};
    use md5::{Digest as _, Md5};
    use pcap_file::pcap::PcapReader;

    use super::*;
    use crate::shared_data::shared_data;
    use crate::{LidarDecoder, Sensor};
    use measurement::time::RobotTime;
    use nalgebra::{Isometry3, Matrix3, Matrix3x4, Rotation3};

    /// The metadata of a capture, and its datagrams.
    pub(crate) fn datagrams(name: &str) -> Option<(Ouster, Vec<Vec<u8>>)> {
        let folder = shared_data("ouster")?;
        let metadata =
            fs::read_to_string(folder.join(format!("{}.json", name.trim_end_matches("_3scans"))))
                .unwrap();
        let mut capture =
            PcapReader::new(File::open(folder.join(format!("{name}.pcap"))).unwrap()).unwrap();
        let mut pool = IpDefragPool::<(), ()>::new();
        let mut found = Vec::new();
        while let Some(packet) = capture.next_packet() {
            let packet = packet.unwrap();
            let sliced = SlicedPacket::from_ethernet(&packet.data).unwrap();
            if let Some(TransportSlice::Udp(udp)) = &sliced.transport {
                found.push(udp.payload().to_vec());
            } else if let Ok(Some(whole)) = pool.process_sliced_packet(&sliced, (), ()) {
                found.push(whole.payload[8..].to_vec());
            }
        }
        Some((Ouster::new(&metadata).unwrap(), found))
    }

    /// The planes as the vendor's decoder has them: a row for each laser, a column for each measurement.
    #[test]
    fn planes_are_those_of_the_vendor() {
        let Some((ouster, datagrams)) = datagrams("os0-32_fw2.2") else {
            return;
        };
        let folder = shared_data("ouster").unwrap();
        let digests = fs::read_to_string(folder.join("os0-32_fw2.2.digest.json")).unwrap();
        let digests: Value = serde_json::from_str(&digests).unwrap();
        let expected = &digests["scans"][0];
        let (columns, rows) = (ouster.columns, ouster.pixels.len());
        let mut ranges = [vec![0u32; columns * rows], vec![0; columns * rows]];
        let mut reflectivities = [vec![0u8; columns * rows], vec![0; columns * rows]];
        let (mut timestamps, mut measurements) = (vec![0u64; columns], vec![0u16; columns]);
        let lidar = datagrams
            .iter()
            .filter(|bytes| bytes.len() == ouster.packet_bytes());
        for column in lidar.flat_map(|bytes| ouster.columns(bytes).unwrap()) {
            let at = usize::from(column.measurement);
            (timestamps[at], measurements[at]) = (column.timestamp_ns, column.measurement);
            for (row, pixel) in column.pixels.chunks_exact(16).enumerate() {
                let returns = ouster.profile.returns(pixel);
                for (which, (range_mm, reflectivity)) in returns.into_iter().enumerate() {
                    ranges[which][row * columns + at] = range_mm;
                    reflectivities[which][row * columns + at] = reflectivity;
                }
            }
        }
        let bytes = |plane: &[u32]| {
            plane
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect::<Vec<_>>()
        };
        let of = BTreeMap::from([
            ("RANGE", bytes(&ranges[0])),
            ("RANGE2", bytes(&ranges[1])),
            ("REFLECTIVITY", reflectivities[0].clone()),
            ("REFLECTIVITY2", reflectivities[1].clone()),
            (
                "TIMESTAMP",
                timestamps
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect(),
            ),
            (
                "MEASUREMENT_ID",
                measurements
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect(),
            ),
        ]);
        for (name, plane) in of {
            let digest = Md5::digest(&plane);
            let number = u128::from_be_bytes(digest.into());
            assert_eq!(expected[name], *format!("{number:032x}"), "{name}");
        }
    }

    #[test]
    fn the_gyroscopes_and_accelerometers_measure_gravity_a_hundred_times_a_second() {
        for (name, count) in [("os0-32_fw2.2", 10), ("os1-128_fw2.3_3scans", 30)] {
            let Some((_, datagrams)) = datagrams(name) else {
                return;
            };
            let samples: Vec<_> = datagrams.iter().filter_map(|bytes| imu(bytes)).collect();
            assert_eq!(samples.len(), count, "{name}");
            for (_, sample) in &samples {
                let length = |vector: [f64; 3]| Vector3::from(vector).norm();
                let gravity_mps2 = length(sample.linear_acceleration_mps2);
                assert!(
                    (gravity_mps2 - GRAVITY_MPS2).abs() < 2.0,
                    "{name}: {gravity_mps2}"
                );
                assert!(
                    length(sample.angular_velocity_radps) < 0.3,
                    "{name}: {sample:?}"
                );
            }
            let seconds = (samples[count - 1].0 - samples[0].0) / (count - 1) as f64;
            assert!((seconds - 0.01).abs() < 1e-4, "{name}: {seconds}");
        }
        let (_, datagrams) = datagrams("os0-32_fw2.2").unwrap();
        let bytes = datagrams
            .iter()
            .find(|bytes| bytes.len() == IMU_PACKET)
            .unwrap();
        let (time_s, sample) = imu(bytes).unwrap();
        // By another program.
        assert!((time_s - 515.838_794_38).abs() < 1e-9, "{time_s}");
        let acceleration_g = sample.linear_acceleration_mps2[2] / GRAVITY_MPS2;
        assert!((acceleration_g - 1.014_404_296_875).abs() < 1e-9);
        let rate_degps = sample.angular_velocity_radps[1].to_degrees();
        assert!((rate_degps - 0.663_757_324_218_75).abs() < 1e-9);
        let mut bytes = bytes.clone();
        bytes[24..28].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(imu(&bytes), None);
        assert_eq!(imu(&bytes[1..]), None);
    }

    #[test]
    fn what_is_lost_is_counted_also_between_revolutions_and_beside_the_window() {
        let Some((whole, datagrams)) = datagrams("os1-128_fw2.3_3scans") else {
            return;
        };
        let lidar = datagrams
            .iter()
            .filter(|bytes| bytes.len() == whole.packet_bytes());
        let lidar: Vec<_> = lidar.collect();
        // Sixty-four packets of 16 columns in a revolution.
        assert_eq!(lidar.len(), 3 * 64);
        for (window, without, expected) in [
            ([0, 1023], 0..0, 0),
            ([0, 1023], 5..6, 1),
            ([0, 1023], 60..70, 10),
            ([0, 1023], 63..65, 2),
            ([0, 1023], 10..180, 170),
            // The first is not expected.
            ([0, 1023], 0..5, 0),
            // Others are outside, and were not sent.
            ([256, 767], 0..16, 0),
            ([256, 767], 48..80, 0),
            ([256, 767], 47..81, 2),
            ([768, 255], 16..48, 0),
            ([768, 255], 15..50, 3),
        ] {
            let mut ouster = whole.clone();
            ouster.window = window;
            let mut decoder = LidarDecoder::new(Sensor::Ouster(Box::new(ouster)));
            let came = lidar.iter().enumerate().filter(|(at, _)| {
                let column = 16 * (at % 64);
                let [from, to] = window;
                let is_sent = if from <= to {
                    (from..=to).contains(&column)
                } else {
                    column >= from || column <= to
                };
                is_sent && !without.contains(at)
            });
            for (_, bytes) in came {
                decoder.push(RobotTime::default(), bytes).unwrap();
            }
            assert_eq!(
                decoder.counts().lost,
                expected,
                "{window:?} without {without:?}"
            );
        }
    }

    /// Rows of KITTI: the upper three rows of a matrix.
    fn poses() -> Vec<Isometry3<f64>> {
        let folder = shared_data("ouster").unwrap();
        let rows = fs::read_to_string(folder.join("os1-128_fw2.3_3scans.poses.txt")).unwrap();
        let pose = |row: &str| {
            let numbers = row.split_whitespace().map(|number| number.parse().unwrap());
            let matrix = Matrix3x4::from_row_iterator(numbers);
            let rotation = matrix.fixed_view::<3, 3>(0, 0).into_owned();
            let translation = matrix.column(3).into_owned();
            let rotation = Rotation3::from_matrix_unchecked(rotation);
            Isometry3::from_parts(translation.into(), rotation.into())
        };
        rows.lines().map(pose).collect()
    }

    /// Median distance of the second cloud's points from the planes of the first, metres: in cubes of 1 m, where at least ten
    /// points of the first lie in a plane.
    fn residual_m(first: &[Point3<f64>], second: &[Point3<f64>]) -> f64 {
        let cube = |point: &Point3<f64>| point.coords.map(|metres| metres.floor() as i64);
        let mut cubes: BTreeMap<[i64; 3], Vec<Point3<f64>>> = BTreeMap::new();
        for point in first {
            cubes.entry(cube(point).into()).or_default().push(*point);
        }
        let planes = cubes.into_iter().filter(|(_, points)| points.len() >= 10);
        let planes = planes.filter_map(|(cube, points)| {
            let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
            let middle = sum / points.len() as f64;
            let spread = points.iter().map(|point| point.coords - middle);
            let spread: Matrix3<f64> = spread.map(|off| off * off.transpose()).sum();
            let eigen = (spread / points.len() as f64).symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            let is_plane = eigen.eigenvalues[least] < 0.03 * 0.03;
            let normal = eigen.eigenvectors.column(least).into_owned();
            is_plane.then_some((cube, (middle, normal)))
        });
        let planes: BTreeMap<_, _> = planes.collect();
        let distances = second.iter().filter_map(|point| {
            let (middle, normal) = planes.get(&<[i64; 3]>::from(cube(point)))?;
            Some((point.coords - middle).dot(normal).abs())
        });
        let mut distances: Vec<_> = distances.collect();
        assert!(distances.len() > 10_000, "{}", distances.len());
        let middle = distances.len() / 2;
        *distances.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    #[test]
    fn revolutions_in_motion_lie_on_each_other_by_their_poses() {
        let Some((ouster, datagrams)) = datagrams("os1-128_fw2.3_3scans") else {
            return;
        };
        let mut decoder = LidarDecoder::new(Sensor::Ouster(Box::new(ouster.clone())));
        let is_lidar = |bytes: &&Vec<u8>| bytes.len() == ouster.packet_bytes();
        let lidar = datagrams.iter().filter(is_lidar);
        let mut revolutions: Vec<_> = lidar
            .flat_map(|bytes| decoder.push(RobotTime::default(), bytes).unwrap())
            .collect();
        revolutions.extend(decoder.finish());
        let poses = poses();
        assert_eq!((revolutions.len(), poses.len()), (3, 3));
        let placed = |at: usize, pose: &Isometry3<f64>| {
            let points = revolutions[at].cloud.points.iter();
            let points = points.map(|point| pose * Point3::from(point.position_m.map(f64::from)));
            points.collect::<Vec<_>>()
        };
        for at in 1..3 {
            let by_poses = residual_m(&placed(0, &poses[0]), &placed(at, &poses[at]));
            let none = Isometry3::identity();
            let without = residual_m(&placed(0, &none), &placed(at, &none));
            println!("revolution {at}: {by_poses:.4} m, without poses {without:.4} m");
            assert!(
                by_poses <= 0.03 && by_poses <= 0.5 * without,
                "{by_poses} {without}"
            );
        }
    }
}
