//! Revolutions from the packets of any lidar.

use measurement::cloud::{Cloud, CloudPoint};
use measurement::time::RobotTime;

use crate::livox::Livox;
use crate::ouster::Ouster;
use crate::velodyne::Velodyne;

/// A revolution ends at the latest then: a motor that stands still turns past no mark, and a clock that is set goes back or ahead.
/// The slowest sensors turn five times a second.
const MAX_REVOLUTION_S: f64 = 1.0;
/// Two returns of 128 lasers in 2048 columns are half of that.
const MAX_POINTS: usize = 1 << 20;

/// Why a datagram is not decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PacketError {
    /// It has another length than packets of the sensor: of another model, profile or port.
    #[error("a packet of {found} bytes, where the sensor sends {expected}")]
    Length {
        /// Bytes of the datagram.
        found: usize,
        /// Bytes of a packet.
        expected: usize,
    },
    /// A mark, an angle or a number in it is none of the sensor's.
    #[error("a packet that is damaged, or of another sensor")]
    Damaged,
    /// Its sensor has this serial number, and the metadata are those of another one.
    #[error("a packet of the sensor with serial number {0}, which is not that of the metadata")]
    OtherSensor(u64),
    /// A model, return mode or kind of data that is not known.
    #[error("a packet of a model, return mode or kind of data that is not known")]
    UnknownModel,
    /// Its checksum is wrong.
    #[error("a packet with a wrong checksum")]
    Checksum,
    /// Its sensor has so many lasers, and the calibration is that of another model.
    #[error("a packet of a sensor with {0} lasers, which is not that of the calibration")]
    OtherCalibration(usize),
}

/// Which sensor sends the packets.
#[derive(Clone, Debug)]
pub enum Sensor {
    /// Velodyne VLP-16, Puck Hi-Res and VLP-32C.
    Velodyne(Box<Velodyne>),
    /// Ouster, with its metadata.
    Ouster(Box<Ouster>),
    /// Livox Mid-360.
    Livox(Box<Livox>),
}

impl Sensor {
    /// Which one it is, once that is known.
    pub fn identity(&self) -> Option<String> {
        match self {
            Self::Velodyne(velodyne) => velodyne.model_name().map(str::to_owned),
            Self::Ouster(ouster) => Some(ouster.name().to_owned()),
            Self::Livox(_) => None,
        }
    }
}

/// One turn of a sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Revolution {
    /// Stamp of the datagram that had the first point.
    pub stamp: RobotTime,
    /// The points; times count from the first.
    pub cloud: Cloud,
    /// Time of the first point on the sensor's clock, seconds; 0 is the full hour of Velodyne's, and of the others' their start,
    /// or 1970.
    pub sensor_time_s: f64,
    /// Time of the packet that completed it, on the same clock, seconds.
    pub completed_s: f64,
}

/// Datagrams by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketCounts {
    /// Decoded.
    pub decoded: u64,
    /// Not decoded.
    pub refused: u64,
    /// Missing in the sensor's numbers or times. One that was refused is not missing.
    pub lost: u64,
}

/// Points of a datagram for the revolution under way.
pub(crate) trait Sink {
    /// A packet that is decoded, whose first point was measured at this time of the sensor's clock, seconds.
    fn packet(&mut self, sensor_time_s: f64);
    /// A new revolution begins with the next point, at this time of the sensor's clock, seconds.
    fn begin(&mut self, sensor_time_s: f64);
    /// A point at this time of the sensor's clock, seconds; [`CloudPoint::after_s`] is set from it.
    fn point(&mut self, sensor_time_s: f64, point: CloudPoint);
    /// A beam without a return.
    fn without_return(&mut self);
    /// So many packets did not come.
    fn lost(&mut self, packets: u64);
}

/// Makes revolutions of datagrams.
#[derive(Clone, Debug)]
pub struct LidarDecoder {
    sensor: Sensor,
    under_way: Assembly,
}

#[derive(Clone, Debug, Default)]
struct Assembly {
    current: Option<Revolution>,
    complete: Vec<Revolution>,
    counts: PacketCounts,
    /// Stamp of the newest datagram.
    stamp: RobotTime,
    /// Time of the newest packet on the sensor's clock, seconds.
    packet_s: f64,
    /// Packets since the last one that was decoded, which are missing in the sensor's numbers and did come.
    refused: u64,
}

impl LidarDecoder {
    /// For a sensor. The first revolution begins anywhere.
    pub fn new(sensor: Sensor) -> Self {
        Self {
            sensor,
            under_way: Assembly::default(),
        }
    }

    /// Decodes a datagram that was sent or received at `stamp`. Returns the revolutions that it completed.
    ///
    /// # Errors
    /// If it is no packet of the sensor. It is counted, and the next one may be good.
    pub fn push(
        &mut self,
        stamp: RobotTime,
        datagram: &[u8],
    ) -> Result<Vec<Revolution>, PacketError> {
        let assembly = &mut self.under_way;
        assembly.stamp = stamp;
        let decoded = match &mut self.sensor {
            Sensor::Velodyne(velodyne) => velodyne.decode(datagram, assembly),
            Sensor::Ouster(ouster) => ouster.decode(datagram, assembly),
            Sensor::Livox(livox) => livox.decode(datagram, assembly),
        };
        match decoded {
            Ok(()) => {
                assembly.counts.decoded += 1;
                assembly.refused = 0;
            }
            Err(error) => {
                assembly.counts.refused += 1;
                // Others were not sent in its place.
                let is_its = !matches!(
                    error,
                    PacketError::Length { .. } | PacketError::OtherSensor(_)
                );
                assembly.refused += u64::from(is_its);
            }
        }
        decoded.map(|()| std::mem::take(&mut assembly.complete))
    }

    /// The revolution that the end of the data left unfinished.
    pub fn finish(&mut self) -> Option<Revolution> {
        self.under_way.end_current();
        self.under_way.complete.pop()
    }

    /// Whose packets these are.
    pub const fn sensor(&self) -> &Sensor {
        &self.sensor
    }

    /// Datagrams so far.
    pub const fn counts(&self) -> PacketCounts {
        self.under_way.counts
    }
}

impl Assembly {
    fn end_current(&mut self) {
        let completed_s = self.packet_s;
        self.complete
            .extend(self.current.take().map(|revolution| Revolution {
                completed_s,
                ..revolution
            }));
    }
}

impl Sink for Assembly {
    fn packet(&mut self, sensor_time_s: f64) {
        self.packet_s = sensor_time_s;
    }

    fn begin(&mut self, sensor_time_s: f64) {
        self.end_current();
        self.current = Some(Revolution {
            stamp: self.stamp,
            sensor_time_s,
            ..Revolution::default()
        });
    }

    fn point(&mut self, sensor_time_s: f64, point: CloudPoint) {
        let continues = |current: &Revolution| {
            current.cloud.points.len() < MAX_POINTS
                && (0.0..MAX_REVOLUTION_S).contains(&(sensor_time_s - current.sensor_time_s))
        };
        if !self.current.as_ref().is_some_and(continues) {
            self.begin(sensor_time_s);
        }
        if let Some(current) = &mut self.current {
            current.cloud.points.push(CloudPoint {
                after_s: (sensor_time_s - current.sensor_time_s) as f32,
                ..point
            });
        }
    }

    fn without_return(&mut self) {
        if let Some(Revolution { cloud, .. }) = &mut self.current {
            cloud.without_return = cloud.without_return.saturating_add(1);
        }
    }

    fn lost(&mut self, packets: u64) {
        self.counts.lost += packets.saturating_sub(std::mem::take(&mut self.refused));
    }
}

#[cfg(test)]
mod tests;
