//! `--record`: everything that came in, as ROS 2 messages.

use std::path::Path;
use std::time::Duration;

use crate::clock::Monotonic;
use crate::measurement::{Measurement, MeasurementData, OwnPose, Stream};
use crate::recording::writer::{McapWriter, WriteError};

/// A crash of a live run loses no more than this.
const FLUSH_PERIOD: Duration = Duration::from_secs(1);

/// Writes measurements as they come.
pub(super) struct Recorder {
    writer: McapWriter,
    /// Only runs in real time are flushed by the clock, so that others give the same file every time.
    flushed_at: Option<Monotonic>,
}

impl Recorder {
    pub(super) fn create(
        path: &Path,
        vehicle: &str,
        in_real_time: bool,
    ) -> Result<Self, WriteError> {
        let writer = McapWriter::create(path, Some(vehicle))?;
        Ok(Self {
            writer,
            flushed_at: in_real_time.then(Monotonic::now),
        })
    }

    pub(super) fn write(
        &mut self,
        stream: &Stream,
        measurement: &Measurement,
    ) -> Result<(), WriteError> {
        if let MeasurementData::Scan {
            own_pose: Some(pose),
            ..
        } = &measurement.data
        {
            self.write_own_pose(measurement, pose)?;
        }
        self.writer.write(&ros_stream(stream), measurement)?;
        if let Some(at) = self.flushed_at
            && at.elapsed() >= FLUSH_PERIOD
        {
            self.writer.flush()?;
            self.flushed_at = Some(Monotonic::now());
        }
        Ok(())
    }

    /// A `LaserScan` has no place for the pose that a log gives to its own scan: transforms have.
    fn write_own_pose(&mut self, scan: &Measurement, pose: &OwnPose) -> Result<(), WriteError> {
        let tf = Stream {
            name: "/tf".into(),
            type_name: "tf2_msgs/TFMessage".into(),
        };
        let base_from_sensor = pose.odom_from_base.inverse() * pose.odom_from_sensor;
        for (parent, child, parent_from_child) in [
            ("odom", "base_link", pose.odom_from_base),
            ("base_link", &*scan.frame, base_from_sensor),
        ] {
            let child = child.into();
            let data = MeasurementData::Transform {
                child,
                parent_from_child,
                is_static: false,
            };
            let transform = Measurement {
                frame: parent.into(),
                data,
                ..*scan
            };
            self.writer.write(&tf, &transform)?;
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<(), WriteError> {
        self.writer.finish()
    }
}

/// CARMEN's message names become topics.
fn ros_stream(stream: &Stream) -> Stream {
    let name = match stream.name.strip_prefix('/') {
        Some(_) => stream.name.clone(),
        None => format!("/{}", stream.name.to_lowercase()),
    };
    Stream {
        name,
        ..stream.clone()
    }
}
