//! Measurements that wait for older ones, in bounded memory.

use std::collections::BTreeMap;

use measurement::time::RobotTime;
use measurement::{Measurement, MeasurementData};

/// Items that may wait.
pub(super) const MAX_BUFFERED: usize = 20_000;

/// Bytes that may wait, counted without what is the same for all kinds.
pub(super) const MAX_BUFFERED_BYTES: usize = 128 << 20;

/// Measurements by stamp.
#[derive(Debug, Default)]
pub(super) struct ReorderBuffer {
    /// By stamp and arrival, so equal stamps keep their order.
    items: BTreeMap<(RobotTime, u64), Measurement>,
    payload_bytes: usize,
}

impl ReorderBuffer {
    /// Takes the measurement that was the `arrival`-th to come.
    pub(super) fn insert(&mut self, arrival: u64, measurement: Measurement) {
        self.payload_bytes += payload_bytes(&measurement.data);
        self.items.insert((measurement.stamp, arrival), measurement);
    }

    /// The oldest stamp.
    pub(super) fn oldest_stamp(&self) -> Option<RobotTime> {
        self.items.first_key_value().map(|((stamp, _), _)| *stamp)
    }

    /// Takes out the oldest.
    pub(super) fn pop_first(&mut self) -> Option<Measurement> {
        let (_, measurement) = self.items.pop_first()?;
        self.payload_bytes -= payload_bytes(&measurement.data);
        Some(measurement)
    }

    /// Whether the oldest must leave although its time has not come.
    pub(super) fn is_over_limit(&self) -> bool {
        self.items.len() > MAX_BUFFERED || self.payload_bytes > MAX_BUFFERED_BYTES
    }
}

/// Heap memory of the kinds that can be large.
fn payload_bytes(data: &MeasurementData) -> usize {
    match data {
        MeasurementData::Scan { scan, .. } => scan.ranges_m.len() * 4,
        MeasurementData::PointCloud(cloud) => {
            cloud.points_m.len() * 12 + cloud.rings.as_ref().map_or(0, |rings| rings.len() * 2)
        }
        MeasurementData::Joints(joints) => joints
            .iter()
            .map(|(name, _)| name.len() + size_of::<(String, f64)>())
            .sum(),
        MeasurementData::Transform { .. }
        | MeasurementData::Odometry { .. }
        | MeasurementData::Imu(_)
        | MeasurementData::Fix(_)
        | MeasurementData::Twist(_) => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use measurement::{PointCloud, StreamId};

    fn cloud(points: usize) -> Measurement {
        Measurement {
            stamp: RobotTime::default(),
            stream: StreamId(0),
            frame: "".into(),
            data: MeasurementData::PointCloud(PointCloud {
                points_m: vec![[0.0; 3]; points],
                width: 1,
                rings: None,
            }),
        }
    }

    #[test]
    fn items_and_bytes_are_bounded() {
        let mut room = ReorderBuffer::default();
        for arrival in 0..MAX_BUFFERED as u64 {
            room.insert(arrival, cloud(0));
        }
        assert!(!room.is_over_limit());
        room.insert(u64::MAX, cloud(0));
        assert!(room.is_over_limit());

        let mut room = ReorderBuffer::default();
        let points = MAX_BUFFERED_BYTES / 12;
        room.insert(0, cloud(points));
        assert!(!room.is_over_limit());
        room.insert(1, cloud(1));
        assert!(room.is_over_limit());
        assert_eq!(room.pop_first(), Some(cloud(points)));
        assert!(!room.is_over_limit());
    }
}
