//! Revolutions from the packets of any lidar.

use measurement::cloud::{Cloud, CloudPoint};
use measurement::time::RobotTime;

use crate::ouster::Ouster;
use crate::velodyne::Velodyne;

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
    /// A model or return mode that is not known.
    #[error("a packet of a model or return mode that is not known")]
    UnknownModel,
}

/// Which sensor sends the packets.
#[derive(Clone, Debug)]
pub enum Sensor {
    /// Velodyne VLP-16, Puck Hi-Res and VLP-32C.
    Velodyne(Box<Velodyne>),
    /// Ouster, with its metadata.
    Ouster(Box<Ouster>),
}

/// One turn of a sensor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Revolution {
    /// Stamp of the datagram that had the first point.
    pub stamp: RobotTime,
    /// The points; times count from the first.
    pub cloud: Cloud,
    /// Time of the first point on the sensor's clock, seconds; 0 is the full hour of Velodyne's, and of Ouster's its start, or 1970.
    pub sensor_time_s: f64,
}

/// Datagrams by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketCounts {
    /// Decoded.
    pub decoded: u64,
    /// Not decoded.
    pub refused: u64,
    /// Missing in the sensor's numbers or times.
    pub lost: u64,
}

/// Points of a datagram for the revolution under way.
pub(crate) trait Sink {
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
        };
        match decoded {
            Ok(()) => assembly.counts.decoded += 1,
            Err(_) => assembly.counts.refused += 1,
        }
        decoded.map(|()| std::mem::take(&mut assembly.complete))
    }

    /// The revolution that the end of the data left unfinished.
    pub fn finish(&mut self) -> Option<Revolution> {
        self.under_way.current.take()
    }

    /// Datagrams so far.
    pub const fn counts(&self) -> PacketCounts {
        self.under_way.counts
    }
}

impl Sink for Assembly {
    fn begin(&mut self, sensor_time_s: f64) {
        let begun = Revolution {
            stamp: self.stamp,
            sensor_time_s,
            ..Revolution::default()
        };
        self.complete.extend(self.current.replace(begun));
    }

    fn point(&mut self, sensor_time_s: f64, point: CloudPoint) {
        if self.current.is_none() {
            self.begin(sensor_time_s);
        }
        if let Some(Revolution {
            cloud,
            sensor_time_s: began_s,
            ..
        }) = &mut self.current
        {
            cloud.points.push(CloudPoint {
                after_s: (sensor_time_s - *began_s) as f32,
                ..point
            });
        }
    }

    fn without_return(&mut self) {
        if let Some(Revolution { cloud, .. }) = &mut self.current {
            cloud.without_return += 1;
        }
    }

    fn lost(&mut self, packets: u64) {
        self.counts.lost += packets;
    }
}
